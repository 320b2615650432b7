"""A plane whose right edge is turned away: the spot is drawn out into an ellipse, and range falls off along
the row.

The same in YAML: ``configs/tilted_plane.yaml``.
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
                {
                    "name": "plane",
                    "file": CONFIGS / "../scenes/tilted_plane.xml",
                    "position": ["0 m", "0 m", "6 m"],
                }
            ]
        },
        "scan": {
            "type": "raster",
            "rows": 128,
            "columns": 128,
            "horizontal": ["-15 deg", "15 deg"],
            "vertical": ["-12 deg", "12 deg"],
        },
        "processing": {"range_gate": ["3 m", "12 m"]},
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
