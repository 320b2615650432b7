"""Retro-reflecting targets at 25 m for a receiver on the laser's own axis: they outshine paint so far that
the amplifier clips; clipped pulses are timed by their edges.

The same in YAML: ``configs/tof_retro.yaml``.
"""

from scanner_sim import load_scenario, simulate

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 25,
        "ranging": "tof",
        "scene": {
            "objects": [
                {
                    "name": "targets",
                    "array": {
                        "diameter": "300 mm",
                        "plate": "600 mm",
                        "rows": 2,
                        "columns": 3,
                        "spacing": ["1.6 m", "1.6 m"],
                    },
                    "disc": "retro_sheet",
                    "material": "black_paint",
                    "position": ["0 m", "0 m", "25 m"],
                },
                {
                    "name": "wall",
                    "shape": "rectangle",
                    "size": ["12 m", "10 m"],
                    "material": {"reflectance": "20 %"},
                    "position": ["0 m", "0 m", "27 m"],
                },
            ]
        },
        "scan": {
            "type": "raster",
            "rows": 192,
            "columns": 256,
            "horizontal": ["-6 deg", "6 deg"],
            "vertical": ["-4.5 deg", "4.5 deg"],
        },
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
