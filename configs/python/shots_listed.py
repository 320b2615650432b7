"""Shots at the angles of a file, here a rose of five leaves: any way that a beam shall go. The file's first
line names its columns and their units. Its times leave half of each tenth of a millisecond free.

The same in YAML: ``configs/shots_listed.yaml``.
"""

from pathlib import Path

from scanner_sim import load_scenario, simulate_shots

CONFIGS = Path(__file__).resolve().parents[1]

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 1,
        "scene": {
            "objects": [
                {
                    "name": "wall",
                    "shape": "rectangle",
                    "size": ["3 m", "3 m"],
                    "position": ["0 m", "0 m", "6 m"],
                    "rotation": {"axis": "y", "angle": "30 deg"},
                    "material": "grey_reference",
                }
            ]
        },
        "scan": {"type": "listed", "file": CONFIGS / "angles.csv", "motion": "continuous"},
    }
)

if __name__ == "__main__":
    print(simulate_shots(scenario))
