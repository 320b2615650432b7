"""One disc of 100 mm at 10 m, at rest: how well is its centre found, pattern by pattern? The tracker expects
it 6 mrad beside its place and has to search for it.

The same in YAML: ``configs/track_still.yaml``.
"""

from scanner_sim import load_scenario, track

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 1,
        "scene": {
            "objects": [
                {
                    "name": "plate",
                    "array": {"diameter": "100 mm", "plate": "400 mm"},
                    "position": ["0.3 m", "0.2 m", "10 m"],
                }
            ]
        },
        "scan": {
            "type": "track",
            "duration": "2 s",
            "targets": [{"target": "plate", "offset": ["6 mrad", "-3 mrad", "50 mm"]}],
        },
    }
)

if __name__ == "__main__":
    for record in track(scenario).records:
        print(f"{record.time:.4f} s {record.target} {record.mode.name} {record.position}")
