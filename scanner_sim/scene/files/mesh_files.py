"""Reading PLY, OBJ and STL files into triangles that are safe to trace.

The renderer's own readers trust a file: a face that names a missing vertex ends the process. So files are read and
checked here, and the renderer only sees what :func:`scanner_sim.scene.files.triangles.canonical_ply` writes.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.named_files import LARGEST_MESH, read_ordinary
from scanner_sim.scene.files.obj_files import obj_triangles
from scanner_sim.scene.files.ply_files import ply_triangles
from scanner_sim.scene.files.triangles import MeshError, Triangles, check_triangles


def read_mesh(path: Path) -> Triangles:
    """Return the triangles of a PLY, OBJ or STL file; polygons are cut into triangles.

    Raises
    ------
    InputError
        If the file cannot be read, contradicts itself, holds no face, or a number that is not finite.
    """
    readers = {".ply": ply_triangles, ".obj": obj_triangles, ".stl": stl_triangles}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path.name!r} is no PLY, OBJ or STL file.", remedy="Convert the mesh.")
    content = read_ordinary(path, LARGEST_MESH)
    try:
        if not content:
            raise MeshError("it is empty")
        return reader(content)
    except MeshError as fault:
        raise InputError(
            f"the mesh {str(path)!r} cannot be used: {fault}.",
            remedy="Export it again, as triangles with finite coordinates.",
        ) from None
    except MemoryError:
        raise InputError(f"the mesh {str(path)!r} does not fit into memory.", remedy="Simplify it.") from None


def stl_triangles(content: bytes) -> Triangles:
    """Return the triangles of an STL file, binary or text; each has corners of its own."""
    count = struct.unpack_from("<I", content, 80)[0] if len(content) >= 84 else -1
    if len(content) == 84 + 50 * count:
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
        corners = np.frombuffer(content, record, count, 84)["corners"].reshape(-1, 3)
    elif content.lstrip()[:5].lower() == b"solid":
        corners = _stl_text(content)
    else:
        raise MeshError("it is no STL file, or its length is not that of the triangles that it announces")
    return check_triangles(corners, np.arange(len(corners)).reshape(-1, 3))


def _stl_text(content: bytes) -> NDArray[np.float64]:
    """Return the corners of an STL file in text, (3 n, 3)."""
    words = content.lower().split()
    starts = [number for number, word in enumerate(words) if word == b"vertex"]
    if not 3 * words.count(b"facet") == 3 * words.count(b"endfacet") == len(starts):
        raise MeshError("a facet has not three corners, or the file breaks off")
    try:
        return np.array([[float(word) for word in words[at + 1 : at + 4]] for at in starts]).reshape(-1, 3)
    except ValueError:
        raise MeshError("a corner is not three numbers") from None
