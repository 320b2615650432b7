"""A Lissajous figure in the open loop: it is run about one direction, whatever is seen there. A cylinder
drifts through it; each shot sees it where it is at the middle of its dwell. Both ways of ranging, and
their fusion.

The same in YAML: ``configs/shots_lissajous.yaml``.
"""

from scanner_sim import load_scenario, simulate_shots

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 1,
        "ranging": "both",
        "scene": {
            "objects": [
                {
                    "name": "wall",
                    "shape": "rectangle",
                    "size": ["3 m", "3 m"],
                    "position": ["0 m", "0 m", "9 m"],
                    "material": "grey_reference",
                },
                {
                    "name": "pipe",
                    "shape": "cylinder",
                    "diameter": "300 mm",
                    "length": "2 m",
                    "position": ["-0.3 m", "0 m", "7.5 m"],
                    "material": {"reflectance": 0.6},
                    "motion": {"type": "twist", "velocity": ["0.3 m/s", "0 m/s", "0 m/s"]},
                },
            ]
        },
        "scan": {
            "type": "lissajous",
            "centre": ["0 deg", "0 deg"],
            "patterns": 4,
            "pattern": {"ratio": "9:8", "points": 8192, "amplitude": "5 deg", "dither_position": "10 %"},
        },
    }
)

if __name__ == "__main__":
    print(simulate_shots(scenario))
