"""Figure 18b, the worst case: the edge of a shadow falls across targets at the same range. A screen that the
scanner does not see stands between them and the Sun. Beside the laser's spot the background then has a
step that does not weaken with range as the spot does. With the filter it is a tenth of the spot on the
same white, and higher than the spot on a black disc. The exposure without the laser takes it away; with
laser_off: 0, as in the paper, voxels at the rims of sunlit discs are refused, and the others are right.

The same in YAML: ``configs/lighting_worst_case.yaml``.
"""

from scanner_sim import load_scenario, simulate

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 6,
        "scanner": {"preset": "nrc_2000", "laser_off": 0.5},
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
