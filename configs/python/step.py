"""A step of 100 mm: at the edge the spot falls on both levels, and the estimator sees two peaks or one
between them.

The same in YAML: ``configs/step.yaml``.
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
                {"name": "step", "file": CONFIGS / "../scenes/step.xml", "position": ["0 m", "0 m", "3 m"]}
            ]
        },
        "scan": {
            "type": "raster",
            "rows": 64,
            "columns": 256,
            "horizontal": ["-4 deg", "4 deg"],
            "vertical": ["-1 deg", "1 deg"],
        },
        "transport": {"edge_beamlets": 512},
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
