"""Table 1, "no light": the night side of the orbit, ideal for a laser scanner. There is nothing to see in
visible light, so no pictures of background and camera are written. This is what the other lighting_
scenarios are compared with, and their instrument: its laser pauses for half of each dwell though there is
nothing to subtract.

The same in YAML: ``configs/lighting_dark.yaml``.
"""

from pathlib import Path

from scanner_sim import load_scenario, simulate

CONFIGS = Path(__file__).resolve().parents[1]

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 2000,
        "scanner": {"preset": "nrc_2000", "laser_off": 0.5},
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
        "lighting": {"sun": "none", "earth": "none"},
        "scan": {
            "type": "raster",
            "rows": 192,
            "columns": 192,
            "horizontal": ["-15 deg", "15 deg"],
            "vertical": ["-15 deg", "15 deg"],
        },
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
