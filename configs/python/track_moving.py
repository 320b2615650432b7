"""Four targets of one moving object: it drifts by 10 mm/s and turns by 1 deg/s, as in a docking.

The same in YAML: ``configs/track_moving.yaml``.
"""

from scanner_sim import load_scenario, track

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 2,
        "scene": {
            "objects": [
                {
                    "name": "node",
                    "array": {
                        "diameter": "100 mm",
                        "rows": 2,
                        "columns": 2,
                        "spacing": ["0.8 m", "0.8 m"],
                        "plate": "400 mm",
                    },
                    "position": ["-0.1 m", "0.1 m", "9 m"],
                    "motion": {
                        "type": "twist",
                        "velocity": ["10 mm/s", "0 m/s", "0 m/s"],
                        "turn_rate": ["0 deg/s", "0 deg/s", "1 deg/s"],
                    },
                }
            ]
        },
        "scan": {"type": "track", "duration": "4 s", "targets": ["node"]},
    }
)

if __name__ == "__main__":
    for record in track(scenario).records:
        print(f"{record.time:.4f} s {record.target} {record.mode.name} {record.position}")
