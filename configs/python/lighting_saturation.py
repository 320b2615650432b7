"""Table 1, "saturation in the field of view": a polished sheet beside the targets throws the Sun straight
into the lens. Its image is some ten thousand times as bright as the white of the targets and fills the
pixels that look at it. Only the rows of the glint notice: there the Sun takes twenty pixels of the line,
and the spot is found beside them.

The same in YAML: ``configs/lighting_saturation.yaml``.
"""

from pathlib import Path

from scanner_sim import load_scenario, simulate

CONFIGS = Path(__file__).resolve().parents[1]

scenario = load_scenario(
    {
        "schema": 1,
        "seed": 5,
        "scanner": {"preset": "nrc_2000", "laser_off": 0.5},
        "scene": {
            "objects": [
                {
                    "name": "board",
                    "file": CONFIGS / "../scenes/target_board.xml",
                    "position": ["-0.3 m", "0 m", "6 m"],
                },
                {
                    "name": "sheet",
                    "file": CONFIGS / "meshes/polished_sheet.xml",
                    "position": ["0.75 m", "-0.1 m", "6 m"],
                    "rotation": {"axis": [-0.6768, 0.7362, 0], "angle": "19.86 deg"},
                },
            ]
        },
        "lighting": {"sun": {"direction": [-0.35, -0.45, -0.8]}, "earth": {"direction": [0, 1, 0]}},
        "scan": {
            "type": "raster",
            "rows": 192,
            "columns": 256,
            "horizontal": ["-10 deg", "12 deg"],
            "vertical": ["-8 deg", "8 deg"],
        },
    }
)

if __name__ == "__main__":
    print(simulate(scenario))
