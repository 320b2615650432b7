"""A sphere of one metre before a wall: every angle of incidence in one picture, and a shadow of the receiver
beside the sphere, where the laser hits the wall but the lens does not see the spot.

The same in YAML: ``configs/sphere.yaml``.
"""

from pathlib import Path

from scanner_sim import load_scenario, simulate

CONFIGS = Path(__file__).resolve().parents[1]

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 1,
        "scanner": {"preset": "nrc_2000"},
        "scene": {
            "objects": [
                {"name": "ball", "file": CONFIGS / "../scenes/sphere.xml", "position": ["0 m", "0 m", "4 m"]},
                {
                    "name": "wall",
                    "shape": "rectangle",
                    "size": ["6 m", "6 m"],
                    "material": {"reflectance": "20 %"},
                    "position": ["0 m", "0 m", "5.5 m"],
                },
            ]
        },
        "scan": {
            "type": "raster",
            "rows": 192,
            "columns": 192,
            "horizontal": ["-12 deg", "12 deg"],
            "vertical": ["-12 deg", "12 deg"],
        },
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
