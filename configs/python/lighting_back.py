"""Back illumination: the Sun is in the field of view, left of the Node. Pixels that look into it are full,
and anti-blooming keeps their charge from the neighbours. The receiver looks up to 7 degrees to the left
of the beam (the nearer the range, the more), so the Sun is on the line of all voxels of its rows from
there to the right; most of them still find the laser's spot beside it.

The same in YAML: ``configs/lighting_back.yaml``.
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
        "lighting": {"sun": {"direction": [-0.225, -0.068, 0.972]}, "earth": {"direction": [0, 1, 0]}},
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
