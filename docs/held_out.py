"""A spacecraft that nobody here drew: ``python docs/held_out.py hst.bmf [-o OUT]`` flies up to it under three lights.

The meshes are OpenUniverse's (GPL-2+, not shipped), those of the Hubble Space Telescope in Debian's package:

    apt-get download openuniverse-common && dpkg-deb -x openuniverse-common_*.deb .
    python docs/held_out.py usr/share/openuniverse/3dmodels/hst.bmf
"""

from __future__ import annotations

import argparse
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

SCENE = """\
schema: 1
seed: 22
scanner: {preset: nrc_2000}
scene:
  objects:
    - {name: telescope, mesh: body.obj, length_unit: 63.5 m, material: aluminised_kapton, position: [0 m, 0 m, 17.3 m]}
    - {name: wings, mesh: wings.obj, length_unit: 63.5 m, material: solar_cell, parent: telescope}
    - name: panel # before the aft bulkhead
      array: {diameter: 100 mm, plate: 300 mm, rows: 2, columns: 2, spacing: [1 m, 1 m]}
      parent: telescope
      position: [0 m, 0 m, -8.3 m]
lighting:
  orbit: {altitude: 540 km, inclination: 28.5 deg, beta: 30 deg, anomaly: 75 deg, attitude: {forward: ram, down: nadir}}
scan: {type: track, targets: [panel]}
camera:
  mount: {position: [0.2 m, 0 m, 0 m], rotation: {axis: y, angle: -1 deg}}
  exposure: {type: automatic, measure: percentile, percentile: 95 %, target: 70 %}
  sampling: {edge_samples: 256}
"""
APPROACH = """\
schema: 1
base: scene.yaml
seed: 3
object: telescope
trajectory:
  type: waypoints
  interpolation: linear
  points: [{time: 0 s, position: [0 m, 0 m, 17.3 m]}, {time: 100 s, position: [0 m, 0 m, 12.3 m]}]
epochs: {count: 3} # 9 m, 6.5 m and 4 m before the panel
arrays: [{array: panel}]
offset: [2 mrad, -2 mrad, 50 mm]
tries: 2
duration: 0.24 s
orbits:
  - {beta: 30 deg, anomaly: 75 deg} # the Sun stands behind the scanner
  - {beta: 15 deg, anomaly: 40 deg} # it grazes the aft end
  - {beta: 15 deg, anomaly: -40 deg} # the aft end lies in shadow, before sunlit wings
"""
WINGS = "PANELS.JPG"
"""Texture of the solar arrays."""


def groups(data: bytes) -> Iterator[tuple[str, list[tuple[float, ...]], list[tuple[int, int, int]]]]:
    """Yield texture, vertices and triangles of the groups of a BMF file, which are strips."""
    at = 0

    def take(form: str) -> tuple[int, ...]:
        nonlocal at
        found = struct.unpack_from("<" + form, data, at)
        at += struct.calcsize("<" + form)
        return found

    for _ in range(take("2H")[0]):
        name = bytes(take(f"{take('H')[0]}B"))[:-1].decode("latin-1")
        take("12f")
        corners = [take("8f")[5:] for _ in range(take("H")[0])]  # texture, normal, place
        lengths = take(f"{take('H')[0]}H")
        order, triangles, begin = take(f"{take('H')[0]}H"), [], 0
        for length in lengths:
            strip = order[begin : begin + length]
            begin += length
            for number, (a, b, c) in enumerate(zip(strip, strip[1:], strip[2:], strict=False)):
                if len({a, b, c}) == 3:
                    triangles.append((b, a, c) if number % 2 else (a, b, c))
        yield name, corners, triangles


def write_meshes(source: Path, folder: Path) -> None:
    """Write the solar arrays and all else as two OBJ files."""
    lines: dict[str, list[str]] = {"body": [], "wings": []}
    counts = dict.fromkeys(lines, 0)
    for name, corners, triangles in groups(source.read_bytes()):
        part = "wings" if name == WINGS else "body"
        first = counts[part] + 1
        lines[part] += ["v " + " ".join(f"{value:.8f}" for value in corner) for corner in corners]
        lines[part] += ["f " + " ".join(str(first + corner) for corner in three) for three in triangles]
        counts[part] += len(corners)
    for part, text in lines.items():
        (folder / f"{part}.obj").write_text("\n".join(text) + "\n", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("mesh", type=Path)
    parser.add_argument("-o", dest="folder", type=Path, default=Path("output/held_out"))
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    write_meshes(asked.mesh, asked.folder)
    (asked.folder / "scene.yaml").write_text(SCENE, encoding="utf-8")
    (asked.folder / "approach.yaml").write_text(APPROACH, encoding="utf-8")
    fly = ["approach", str(asked.folder / "approach.yaml"), "-o", str(asked.folder / "approach")]
    subprocess.run([sys.executable, "-m", "scanner_sim", *fly, "--workers", "0"], check=True)


if __name__ == "__main__":
    main()
