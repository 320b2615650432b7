"""A mesh of your own: PLY, OBJ or STL. Here an angle bracket drawn in millimetres, on a table of closed
shapes. The scanner stands half a metre above the table and looks down on it: y and φ count downwards.

The same in YAML: ``configs/own_mesh.yaml``.
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
            "laser": {"power": "3 mW", "waist_distance": "1.9 m"},
            "receiver": {"baseline": "200 mm"},
        },
        "scene": {
            "objects": [
                {
                    "name": "bracket",
                    "mesh": CONFIGS / "meshes/bracket.obj",
                    "length_unit": "1 mm",
                    "material": "weathered_aluminium",
                    "position": ["-50 mm", "460 mm", "1.9 m"],
                    "rotation": {"axis": [0, 1, 0], "angle": "35 deg"},
                },
                {
                    "name": "ball",
                    "shape": "sphere",
                    "diameter": "60 mm",
                    "material": "grey_reference",
                    "position": ["80 mm", "470 mm", "1.85 m"],
                },
                {
                    "name": "table",
                    "shape": "box",
                    "size": ["500 mm", "20 mm", "500 mm"],
                    "material": {"reflectance": 0.1},
                    "position": ["0 m", "510 mm", "1.95 m"],
                },
            ]
        },
        "scan": {
            "type": "raster",
            "rows": 192,
            "columns": 256,
            "horizontal": ["-6 deg", "6 deg"],
            "vertical": ["10 deg", "19 deg"],
        },
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
