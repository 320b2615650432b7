"""A spiral over a ball before a wall: shots at even distances on arms at even distances, without a single
flyback. The result is a table, one line for each shot, where a raster gives an image.

The same in YAML: ``configs/shots_spiral.yaml``.
"""

from scanner_sim import load_scenario, simulate_shots

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
                    "position": ["0 m", "0 m", "8 m"],
                    "material": "grey_reference",
                },
                {
                    "name": "ball",
                    "shape": "sphere",
                    "diameter": "600 mm",
                    "position": ["0.15 m", "0.1 m", "7 m"],
                    "material": "target_white",
                },
            ]
        },
        "scan": {"type": "spiral", "radius": "5 deg", "turns": 30, "points": 16384},
    }
)

if __name__ == "__main__":
    print(simulate_shots(scenario))
