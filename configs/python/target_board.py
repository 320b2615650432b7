"""Four circular targets, black on white, on a square of one metre: what a pose is measured from.

The same in YAML: ``configs/target_board.yaml``.
"""

from pathlib import Path

from scanner_sim import load_scenario, simulate

CONFIGS = Path(__file__).resolve().parents[1]

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 4,
        "scanner": {"preset": "nrc_2000"},
        "scene": {
            "objects": [
                {
                    "name": "board",
                    "file": CONFIGS / "../scenes/target_board.xml",
                    "position": ["0 m", "0 m", "5 m"],
                    "rotation": {"axis": "y", "angle": "15 deg"},
                },
                {
                    "name": "strip",
                    "array": {
                        "diameter": "80 mm",
                        "plate": "150 mm",
                        "rows": 1,
                        "columns": 5,
                        "spacing": ["250 mm", "250 mm"],
                    },
                    "disc": "target_black",
                    "material": {"reflectance": 0.8},
                    "position": ["0 m", "1.05 m", "5.2 m"],
                },
            ]
        },
        "scan": {
            "type": "raster",
            "rows": 256,
            "columns": 256,
            "horizontal": ["-12 deg", "12 deg"],
            "vertical": ["-12 deg", "15 deg"],
        },
        "processing": {"peak": "maximum_likelihood"},
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
