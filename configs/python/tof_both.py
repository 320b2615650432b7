"""Boards at 3, 7, 14 and 24 m by triangulation, by time of flight and by both: near ones are measured better
by the first, far ones by the second, and fused.* is as good as the better everywhere.

The same in YAML: ``configs/tof_both.yaml``.
"""

from scanner_sim import load_scenario, simulate

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 9,
        "ranging": "both",
        "scene": {
            "objects": [
                {
                    "name": "board_3",
                    "shape": "rectangle",
                    "size": ["0.5 m", "0.5 m"],
                    "material": {"reflectance": "40 %"},
                    "position": ["-0.6 m", "0 m", "3 m"],
                },
                {
                    "name": "board_7",
                    "shape": "rectangle",
                    "size": ["1.2 m", "1.2 m"],
                    "material": {"reflectance": "40 %"},
                    "position": ["-0.35 m", "0 m", "7 m"],
                },
                {
                    "name": "board_14",
                    "shape": "rectangle",
                    "size": ["2.4 m", "2.4 m"],
                    "material": {"reflectance": "40 %"},
                    "position": ["1.6 m", "0 m", "14 m"],
                },
                {
                    "name": "wall",
                    "shape": "rectangle",
                    "size": ["16 m", "12 m"],
                    "material": {"reflectance": "40 %"},
                    "position": ["0 m", "0 m", "24 m"],
                },
            ]
        },
        "scan": {
            "type": "raster",
            "rows": 192,
            "columns": 256,
            "horizontal": ["-16 deg", "16 deg"],
            "vertical": ["-9 deg", "9 deg"],
        },
        "output": {"waveforms": [[0, 0], [12, 8], [12, 12]]},
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
