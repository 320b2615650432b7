"""Two objects: a target array that approaches the other, which stands still, and a sphere on a third way.

The same in YAML: ``configs/track_two_objects.yaml``.
"""

from scanner_sim import load_scenario, track

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 3,
        "scene": {
            "objects": [
                {
                    "name": "module",
                    "array": {
                        "diameter": "100 mm",
                        "rows": 2,
                        "columns": 2,
                        "spacing": ["0.6 m", "0.6 m"],
                        "plate": "300 mm",
                    },
                    "position": ["-0.8 m", "0 m", "8 m"],
                    "motion": {
                        "type": "twist",
                        "velocity": ["20 mm/s", "0 m/s", "5 mm/s"],
                        "turn_rate": ["0 deg/s", "0.5 deg/s", "0 deg/s"],
                    },
                },
                {
                    "name": "station",
                    "array": {
                        "diameter": "100 mm",
                        "rows": 2,
                        "columns": 2,
                        "spacing": ["0.6 m", "0.6 m"],
                        "plate": "300 mm",
                    },
                    "position": ["0.9 m", "0 m", "9 m"],
                    "rotation": {"axis": "y", "angle": "10 deg"},
                },
                {
                    "name": "ball",
                    "shape": "sphere",
                    "diameter": "120 mm",
                    "material": {"reflectance": 0.5},
                    "motion": {
                        "type": "waypoints",
                        "points": [
                            {"time": "0 s", "position": ["0 m", "-0.8 m", "7 m"]},
                            {"time": "2 s", "position": ["0.05 m", "-0.8 m", "7.05 m"]},
                            {"time": "4 s", "position": ["0 m", "-0.75 m", "7 m"]},
                        ],
                    },
                },
            ]
        },
        "scan": {"type": "track", "duration": "4 s", "targets": ["module", "station", "ball"]},
    }
)

if __name__ == "__main__":
    for record in track(scenario).records:
        print(f"{record.time:.4f} s {record.target} {record.mode.name} {record.position}")
