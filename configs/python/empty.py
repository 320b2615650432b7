"""Nothing is hit: a valid image of no returns, with a warning.

The same in YAML: ``configs/empty.yaml``.
"""

from scanner_sim import load_scenario, simulate

scenario = load_scenario(
    {
        "schema": 1,
        "scan": {
            "type": "raster",
            "rows": 32,
            "columns": 32,
            "horizontal": ["-15 deg", "15 deg"],
            "vertical": ["-15 deg", "15 deg"],
        },
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
