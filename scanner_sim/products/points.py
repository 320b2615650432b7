"""Point clouds as binary PLY files, which CloudCompare, MeshLab, Open3D and trimesh read."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from scanner_sim.foundation.channels import CHANNELS
from scanner_sim.foundation.errors import printable
from scanner_sim.products.layers import LayeredResult, numbered

_FIRST = ("x", "y", "z", "intensity")
"""Properties of a vertex that programs look for; the others follow in the order of the channels."""
_PLY_TYPE = {"<f4": "float", "<i4": "int"}


def write_ply(path: str | Path, image: LayeredResult) -> None:
    """Write the measured points of an image, row by row, or of a table of shots; an existing file is overwritten.

    Every vertex has ``x y z`` [m] in the scanner frame, the other channels that are properties of vertices where the
    result holds them, and its ``row`` and ``column`` in the image or the number of its ``shot``. What has no range is
    left out, so a file may hold no vertex at all.

    Raises
    ------
    KeyError
        If the image has no points.
    OSError
        If the file cannot be written.
    """
    valid = image.valid
    used = [
        channel
        for channel in CHANNELS
        if channel.vertex and (channel.name in image or channel.vertex in "xyz")
    ]
    used.sort(key=lambda channel: (*_FIRST, channel.vertex).index(channel.vertex))
    index = ("row", "column") if valid.ndim == 2 else ("shot",)
    fields = [(channel.vertex, "<i4" if channel.whole else "<f4") for channel in used]
    fields += [(name, "<i4") for name in index]
    vertices = np.empty(np.count_nonzero(valid), dtype=fields)
    for channel in used:
        vertices[channel.vertex] = image[channel.name][valid]
    for name, numbers in zip(index, np.nonzero(valid), strict=True):
        vertices[name] = numbers
    header = "\n".join(
        [
            "ply",
            "format binary_little_endian 1.0",
            "comment simulated laser scanner; x to the right, y down, z away from the scanner [m]",
            "comment intensity in electrons; truth numbers are those of the names below",
            *(
                f"comment object {number} {printable(name)}"
                for number, name in numbered(image.objects).items()
            ),
            *(
                f"comment material {number} {printable(name)}"
                for number, name in numbered(image.materials).items()
            ),
            f"element vertex {vertices.size}",
            *(f"property {_PLY_TYPE[kind]} {name}" for name, kind in fields),
            "end_header\n",
        ]
    )
    # Not ndarray.tofile: on a full disk its error lacks the operating system's code.
    with open(path, "wb") as stream:
        stream.write(header.encode())
        stream.write(vertices.tobytes())
