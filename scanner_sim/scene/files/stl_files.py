"""Reading STL files, binary or text; each solid of a text is a part."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from scanner_sim.scene.files.file_meshes import MOST_PARTS, FileMesh, FilePart
from scanner_sim.scene.files.triangles import MeshError, check_triangles

_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])


def stl_mesh(content: bytes) -> FileMesh:
    """Return the triangles of an STL file; each has corners of its own, and normals follow from them.

    Raises
    ------
    MeshError
        If it is no STL file, or breaks off.
    """
    count = struct.unpack_from("<I", content, 80)[0] if len(content) >= 84 else -1
    named = content.lstrip()[:5].lower() == b"solid"
    notes: tuple[str, ...] = ()
    if len(content) == 84 + 50 * count or (len(content) > 84 + 50 * count > 84 and not named):
        corners = np.frombuffer(content, _RECORD, count, 84)["corners"].reshape(-1, 3)
        starts, names = [0], [""]
        if len(content) > 84 + 50 * count:
            notes = (f"{len(content) - 84 - 50 * count:,} bytes after the last triangle left out",)
    elif named:
        corners, starts, names = _text(content)
    else:
        raise MeshError("it is no STL file, or its length is not that of the triangles that it announces")
    triangles = check_triangles(corners, np.arange(len(corners)).reshape(-1, 3))
    part_of = np.searchsorted(np.array(starts), np.arange(len(triangles.faces)), side="right") - 1
    return FileMesh(
        triangles, part_of, tuple(FilePart((name,)) for name in names), notes, flat=True, split=True
    )


def _text(content: bytes) -> tuple[NDArray[np.float64], list[int], list[str]]:
    """Return the corners of an STL file in text, (3 n, 3), the first face of each solid, and the solids' names."""
    corners: list[list[float]] = []
    starts: list[int] = []
    names: list[str] = []
    ended = facets = 0
    # Names may be in any encoding; Latin-1 knows every byte.
    for line in content.decode("latin-1").replace("\r", "\n").split("\n"):
        words = line.split()
        match [word.lower() for word in words[:2]]:
            case ["solid", *_]:
                if starts and starts[-1] == facets:
                    starts.pop(), names.pop()
                starts.append(facets)
                names.append(" ".join(words[1:])[:200])
            case ["facet", *_]:
                facets += 1
            case ["endfacet", *_]:
                ended += 1
                if ended != facets or len(corners) != 3 * facets:
                    raise MeshError("a facet has not three corners")
            case ["vertex", *_]:
                try:
                    corners.append([float(word) for word in words[1:4]])
                except ValueError:
                    raise MeshError("a corner is not three numbers") from None
                if len(corners[-1]) != 3:
                    raise MeshError("a corner is not three numbers")
        if len(starts) > MOST_PARTS:
            raise MeshError(f"it has more than {MOST_PARTS} solids")
    if ended != facets or len(corners) != 3 * facets:
        raise MeshError("a facet has not three corners, or the file breaks off")
    if len(starts) > 1 and starts[-1] == facets:
        starts.pop(), names.pop()
    return np.array(corners, dtype=np.float64).reshape(-1, 3), starts, names
