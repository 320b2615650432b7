"""The berthing ring of the same module from close by. At 2 to 3 m the image of the spot is large and lies
far from the axis: the pixels' height clips it, and the base of the triangulation hides what stands behind
edges.

The same in YAML: ``configs/node_near.yaml``.
"""

from pathlib import Path

from scanner_sim import load_scenario, simulate

CONFIGS = Path(__file__).resolve().parents[1]

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 2000,
        "scanner": {"preset": "nrc_2000", "laser": {"power": "2 mW"}},
        "scene": {
            "objects": [
                {
                    "name": "module",
                    "file": CONFIGS / "../scenes/node_z1.xml",
                    "position": ["0.6 m", "0.6 m", "2.5 m"],
                    "rotation": [{"axis": "y", "angle": "-20 deg"}, {"axis": "x", "angle": "5 deg"}],
                }
            ]
        },
        "scan": {
            "type": "raster",
            "rows": 384,
            "columns": 384,
            "horizontal": ["-25 deg", "25 deg"],
            "vertical": ["-25 deg", "25 deg"],
        },
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
