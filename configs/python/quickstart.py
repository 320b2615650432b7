"""The first run: the front of a Space Station Node under its Z1 truss, nine metres away.

scanner-sim run configs/quickstart.yaml

takes some seconds and writes output/quickstart: look at range.png and shaded.png there. Then change a
value below, or on the command line:

scanner-sim run configs/quickstart.yaml -o output/closer --set 'scene.objects.module.position=[0 m, 0 m, 4
m]'

Every number with a dimension needs its unit. Axes: x to the right, y DOWN, z away from the scanner.

The same in YAML: ``configs/quickstart.yaml``.
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
            "rows": 256,
            "columns": 256,
            "horizontal": ["-15 deg", "15 deg"],
            "vertical": ["-15 deg", "15 deg"],
        },
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
