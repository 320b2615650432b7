"""Table 1, "full target shadowing": the Sun stands behind the Node, above the field of view. What the
scanner sees has no sunlight but what the Earth and sunlit parts throw on it; the laser brings its own
light.

The same in YAML: ``configs/lighting_full_shadow.yaml``.
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
        "lighting": {"sun": {"direction": [0.3, -0.8, 0.5]}, "earth": {"direction": [0, 1, 0]}},
        "camera": {"exposure": 10},
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
