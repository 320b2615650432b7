"""Write the scenes of this folder: Mitsuba XML files and their meshes.

Run as ``python scenes/generate.py``; the same version gives the same bytes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from modelling import measuring
from modelling.assembly import node_and_z1
from modelling.writing import write_scene


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--output", type=Path, default=Path(__file__).resolve().parent, help="folder to write to"
    )
    folder: Path = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    write_scene(folder, "plane", measuring.plane(), "A grey plane of 4 m × 4 m in z = 0.")
    write_scene(folder, "tilted_plane", measuring.tilted_plane(), "The plane, right edge 30 degrees away.")
    write_scene(folder, "step", measuring.step(), "Left half in z = 0, right half 100 mm behind it.")
    write_scene(folder, "material_edge", measuring.material_edge(), "One plane, black left and white right.")
    write_scene(folder, "sphere", measuring.sphere(), "A sphere of 1 m diameter about the origin.")
    write_scene(
        folder, "target_board", measuring.target_board(), "Four targets on 1 m × 1 m, faces in z = 0."
    )
    model, targets = node_and_z1()
    write_scene(
        folder, "node_z1", model, "Node and Z1; origin at the centre of the front ring's mating plane."
    )
    targets.write(folder / "node_z1_targets.json")


if __name__ == "__main__":
    main()
