"""Table 1, "normal conditions": the Sun stands behind the scanner, the Earth below. Sunlight falls on nearly
all that is seen; the filter leaves little of it, and the exposure without the laser takes away the rest:
the range image is that of the dark, compare it with lighting_dark. With laser_off: 0, as in the paper, an
eighth of the voxels is refused, most of them on dark things beside sunlit bright ones. background.png
shows what the pixels collect of Sun and Earth, camera.png what a video camera would see.

The same in YAML: ``configs/lighting_normal.yaml``.
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
        "lighting": {"sun": {"direction": [-0.35, -0.45, -0.8]}, "earth": {"direction": [0, 1, 0]}},
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
