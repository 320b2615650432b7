"""Objects that move while they are scanned: each voxel sees them at its own instant, so that the board comes
out sheared and the ball drawn out. truth.range_m is that of each voxel's instant too.

The same in YAML: ``configs/moving_plate.yaml``.
"""

from scanner_sim import load_scenario, simulate

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 1,
        "scanner": {"preset": "nrc_2000"},
        "scene": {
            "objects": [
                {
                    "name": "board",
                    "array": {
                        "diameter": "160 mm",
                        "plate": "400 mm",
                        "rows": 2,
                        "columns": 2,
                        "spacing": ["400 mm", "400 mm"],
                    },
                    "position": ["-250 mm", "0 m", "6 m"],
                    "rotation": {"axis": "y", "angle": "15 deg"},
                    "motion": {
                        "type": "twist",
                        "velocity": ["200 mm/s", "0 mm/s", "0 mm/s"],
                        "turn_rate": ["0 deg/s", "0 deg/s", "20 deg/s"],
                    },
                },
                {
                    "name": "ball",
                    "shape": "sphere",
                    "diameter": "300 mm",
                    "material": "grey_reference",
                    "motion": {
                        "type": "waypoints",
                        "points": [
                            {"time": "0 s", "position": ["400 mm", "-350 mm", "5.5 m"]},
                            {"time": "0.4 s", "position": ["550 mm", "0 m", "5.5 m"]},
                            {"time": "0.82 s", "position": ["350 mm", "350 mm", "5.2 m"]},
                        ],
                    },
                },
                {
                    "name": "wall",
                    "shape": "rectangle",
                    "size": ["4 m", "4 m"],
                    "position": ["0 m", "0 m", "8 m"],
                    "material": {"reflectance": 0.3},
                },
            ]
        },
        "scan": {
            "type": "raster",
            "rows": 128,
            "columns": 128,
            "horizontal": ["-8 deg", "8 deg"],
            "vertical": ["-7 deg", "7 deg"],
        },
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
