"""Retro-reflecting targets on black plates: near ones are seen from far beside the way back and are no
brighter than paint; far ones fill the wells and say so. A receiver around the laser sees all of them
bright.

The same in YAML: ``configs/retro_targets.yaml``.
"""

from scanner_sim import load_scenario, simulate

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 6,
        "scanner": {"preset": "nrc_2000"},
        "scene": {
            "objects": [
                {
                    "name": "near",
                    "array": {
                        "diameter": "60 mm",
                        "plate": "120 mm",
                        "rows": 2,
                        "columns": 2,
                        "spacing": ["200 mm", "200 mm"],
                    },
                    "disc": "retro_sheet",
                    "material": "black_paint",
                    "position": ["-0.3 m", "0 m", "2 m"],
                },
                {
                    "name": "middle",
                    "array": {
                        "diameter": "150 mm",
                        "plate": "300 mm",
                        "rows": 2,
                        "columns": 2,
                        "spacing": ["500 mm", "500 mm"],
                    },
                    "disc": "retro_sheet",
                    "material": "black_paint",
                    "position": ["0.1 m", "0 m", "5 m"],
                },
                {
                    "name": "far",
                    "array": {
                        "diameter": "300 mm",
                        "plate": "600 mm",
                        "rows": 1,
                        "columns": 2,
                        "spacing": ["1 m", "1 m"],
                    },
                    "disc": "retro_sheet",
                    "material": "black_paint",
                    "position": ["1.6 m", "-0.7 m", "10 m"],
                },
                {
                    "name": "prisms",
                    "array": {
                        "diameter": "300 mm",
                        "plate": "600 mm",
                        "rows": 1,
                        "columns": 2,
                        "spacing": ["1 m", "1 m"],
                    },
                    "disc": {
                        "type": "retroreflector",
                        "kind": "corner_cube",
                        "reflectance": 0.65,
                        "retro_share": "40 %",
                        "half_width": "0.34 deg",
                        "refractive_index": 1.57,
                    },
                    "material": "black_paint",
                    "position": ["1.6 m", "0.7 m", "10 m"],
                },
                {
                    "name": "wall",
                    "shape": "rectangle",
                    "size": ["8 m", "8 m"],
                    "material": {"reflectance": "20 %"},
                    "position": ["0 m", "0 m", "11 m"],
                },
            ]
        },
        "scan": {
            "type": "raster",
            "rows": 192,
            "columns": 256,
            "horizontal": ["-13 deg", "15 deg"],
            "vertical": ["-10 deg", "10 deg"],
        },
        "transport": {"uneven_beamlets": 256},
        "processing": {"validation": {"max_reflectance": 4000}},
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
