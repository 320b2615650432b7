"""The Node and Z1 by time of flight alone: tof.png is the range in grey levels, as in the paper's Figure 2b.

The same in YAML: ``configs/tof_node.yaml``.
"""

from pathlib import Path

from scanner_sim import load_scenario, simulate

CONFIGS = Path(__file__).resolve().parents[1]

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 2000,
        "ranging": "tof",
        "scanner": {
            "preset": "nrc_2000",
            "lidar": {
                "pulse": {"peak_power": "100 W", "width": "2 ns"},
                "photodiode": {"gain": 10, "bandwidth": "200 MHz", "place": "coaxial"},
                "digitiser": {"rate": "1 GHz", "gate": ["2 m", "20 m"]},
            },
        },
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
            "rows": 384,
            "columns": 384,
            "horizontal": ["-15 deg", "15 deg"],
            "vertical": ["-15 deg", "15 deg"],
        },
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
