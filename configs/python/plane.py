"""A grey plane met at right angles, 10 m away: the scene in which noise is measured. The spread of the range
here is the scanner's precision; take terms of the noise away to see which one limits it.

The same in YAML: ``configs/plane.yaml``.
"""

from pathlib import Path

from scanner_sim import load_scenario, simulate

CONFIGS = Path(__file__).resolve().parents[1]

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 1,
        "scanner": {
            "preset": "nrc_2000",
            "position_sensor": {
                "noise": {
                    "shot": True,
                    "read": True,
                    "dark": True,
                    "prnu": True,
                    "saturation": True,
                    "quantisation": True,
                }
            },
        },
        "scene": {
            "objects": [
                {"name": "plane", "file": CONFIGS / "../scenes/plane.xml", "position": ["0 m", "0 m", "10 m"]}
            ]
        },
        "scan": {
            "type": "raster",
            "rows": 128,
            "columns": 128,
            "horizontal": ["-8 deg", "8 deg"],
            "vertical": ["-8 deg", "8 deg"],
        },
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
