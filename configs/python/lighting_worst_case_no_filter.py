"""The worst case without the interference filter, as in the experiment of Figure 18: the sensor then takes
the Sun's light from 0.9 to 1.7 µm, fifty times as much. The step of the shadow outshines the spot, and
shot noise buries it on dark discs. Voxels are lost along the shadow and on sunlit discs; status says why.
The laser shines all the time, as the paper's does: with laser_off: 0.5 even this instrument keeps them,
as long as no pixel is full.

The same in YAML: ``configs/lighting_worst_case_no_filter.yaml``.
"""

from scanner_sim import load_scenario, simulate

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 6,
        "scanner": {"preset": "nrc_2000", "filter": "none"},
        "scene": {
            "objects": [
                {
                    "name": "board",
                    "array": {
                        "diameter": "160 mm",
                        "plate": "300 mm",
                        "rows": 4,
                        "columns": 5,
                        "spacing": ["300 mm", "300 mm"],
                    },
                    "position": ["0 m", "0 m", "8 m"],
                },
                {
                    "name": "screen",
                    "shape": "rectangle",
                    "size": ["2 m", "4 m"],
                    "material": "black_paint",
                    "position": ["3.430 m", "0 m", "6.200 m"],
                },
            ]
        },
        "lighting": {"sun": {"direction": [0.8, 0, -0.6]}},
        "scan": {
            "type": "raster",
            "rows": 192,
            "columns": 224,
            "horizontal": ["-7 deg", "7 deg"],
            "vertical": ["-6 deg", "6 deg"],
        },
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
