"""Which meshes of a folder load, which are refused and why, and how long each takes.

    python benchmarks/meshes.py FOLDER [-o table.csv]

Meshes of public packages serve: Debian's assimp-testmodels, and the wheels of pyvista, vedo, dm_control and
gymnasium-robotics, unpacked.
Every file with an ending that is read is opened, each by itself, but no scene is built.
"""

from __future__ import annotations

import argparse
import csv
import re
import time
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from scanner_sim.foundation.errors import InputError
from scanner_sim.scene.files.mesh_files import KINDS, read_mesh_file


class Row(NamedTuple):
    """What became of one file."""

    file: str
    kind: str
    loaded: bool
    triangles: int
    parts: int
    seconds: float
    said: str


def opened(path: Path, folder: Path) -> Row:
    """Read one mesh; anything but a mesh or a refusal ends the program."""
    start, name = time.process_time(), str(path.relative_to(folder))
    try:
        mesh = read_mesh_file(path)
    except InputError as refusal:
        return Row(name, path.suffix.lower(), False, 0, 0, time.process_time() - start, str(refusal))
    seconds = time.process_time() - start
    return Row(
        name,
        path.suffix.lower(),
        True,
        len(mesh.triangles.faces),
        len(mesh.parts),
        seconds,
        "; ".join(mesh.notes),
    )


def main() -> None:
    """Walk a folder, print a table by kind and the reasons, and write each file's row if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("-o", "--output", type=Path, help="CSV with a row for each file")
    asked = parser.parse_args()
    endings = {f".{kind}" for kind in KINDS}
    files = sorted(
        path for path in asked.folder.rglob("*") if path.suffix.lower() in endings and path.is_file()
    )
    rows = [opened(path, asked.folder) for path in files]
    print(f"{'kind':8}{'files':>7}{'loaded':>8}{'refused':>9}{'triangles':>12}{'CPU s':>8}")
    for kind in (*sorted({row.kind for row in rows}), "all"):
        own = [row for row in rows if kind in (row.kind, "all")]
        loaded = sum(row.loaded for row in own)
        triangles, seconds = sum(row.triangles for row in own), sum(row.seconds for row in own)
        print(f"{kind:8}{len(own):7}{loaded:8}{len(own) - loaded:9}{triangles:12,}{seconds:8.1f}")
    reasons = Counter(re.sub(r"'[^']*'|\d[\d,]*", "…", row.said) for row in rows if not row.loaded)
    for reason, count in reasons.most_common():
        example = next(
            row.file
            for row in rows
            if not row.loaded and re.sub(r"'[^']*'|\d[\d,]*", "…", row.said) == reason
        )
        print(f"{count:4} × {reason}\n       {example}")
    if asked.output is not None:
        with asked.output.open("w", newline="", encoding="utf-8") as stream:
            table = csv.writer(stream)
            table.writerow(Row._fields)
            table.writerows(rows)


if __name__ == "__main__":
    main()
