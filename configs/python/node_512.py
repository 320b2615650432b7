"""The Node and Z1 at 512 × 512: the picture to show, and the scene that the benchmark measures.

The same in YAML: ``configs/node_512.yaml``.
"""

from pathlib import Path

from scanner_sim import load_scenario, simulate

CONFIGS = Path(__file__).resolve().parents[1]

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 2000,
        "scanner": {"preset": "nrc_2000"},
        "scene": {
            "objects": [
                {
                    "name": "module",
                    "file": CONFIGS / "../scenes/node_z1.xml",
                    "position": ["0 m", "0.9 m", "9 m"],
                    "rotation": {"axis": "y", "angle": "12 deg"},
                }
            ]
        },
        "scan": {
            "type": "raster",
            "rows": 512,
            "columns": 512,
            "horizontal": ["-15 deg", "15 deg"],
            "vertical": ["-15 deg", "15 deg"],
        },
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
