"""Table 1, "partial target shadowing": the Sun is high, and the truss throws its shadow over the Node. In
camera.png the shadow is black and the rest is white; the edges in background.png do not show in
range.png.

The same in YAML: ``configs/lighting_partial_shadow.yaml``.
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
        "lighting": {
            "sun": {"direction": [-0.25, -0.85, -0.4], "spectrum": "astm_g173"},
            "earth": {"direction": [0, 1, 0]},
        },
        "scan": {
            "type": "raster",
            "rows": 192,
            "columns": 192,
            "horizontal": ["-15 deg", "15 deg"],
            "vertical": ["-15 deg", "15 deg"],
        },
        "processing": {"range_gate": ["6 m", "16 m"]},
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
