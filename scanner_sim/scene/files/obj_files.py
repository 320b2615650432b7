"""Reading Wavefront OBJ files: vertices, normals, texture coordinates and faces; materials are never opened."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from scanner_sim.scene.files.triangles import MeshError, Triangles, check_triangles

_COLUMNS = {"v": 3, "vt": 2, "vn": 3}
_ORDER = ("v", "vt", "vn")
Corner = tuple[int, int, int]
"""Indices of vertex, texture coordinate and normal, from 0; −1 for none."""


def obj_triangles(content: bytes) -> Triangles:
    """Return the triangles of an OBJ file.

    Raises
    ------
    MeshError
        If a line cannot be read, a face names what is not there, or the mesh is unsound.
    """
    rows: dict[str, list[list[float]]] = {name: [] for name in _ORDER}
    numbers: dict[Corner, int] = {}
    faces: list[tuple[int, int, int]] = []
    # Names and comments may be in any encoding; Latin-1 knows every byte. A backslash continues a line.
    text = content.decode("latin-1").replace("\\\r\n", " ").replace("\\\n", " ")
    for line, words in enumerate((entry.split() for entry in text.split("\n")), start=1):
        if not words:
            continue
        try:
            if words[0] in _COLUMNS:
                rows[words[0]].append(_numbers(words[1:], _COLUMNS[words[0]], words[0]))
            elif words[0] == "f":
                corners = [_corner(word, rows) for word in words[1:]]
                if len(corners) < 3:
                    raise MeshError("a face has fewer than three corners")
                found = [numbers.setdefault(corner, len(numbers)) for corner in corners]
                faces += [(found[0], one, two) for one, two in pairwise(found[1:])]
        except ValueError:
            raise MeshError(f"line {line} holds something that is not a number") from None
        except MeshError as fault:
            raise MeshError(f"line {line}: {fault}") from None
    return _mesh(rows, list(numbers), faces)


def _numbers(words: list[str], wanted: int, kind: str) -> list[float]:
    """Return the numbers of a line; a texture coordinate may lack its second one."""
    found = [float(word) for word in words[:wanted]]
    if kind == "vt" and len(found) == 1:
        found.append(0.0)
    if len(found) < wanted:
        raise MeshError(f"'{kind}' has fewer than {wanted} numbers")
    return found


def _corner(word: str, rows: dict[str, list[list[float]]]) -> Corner:
    """Return the indices of a corner such as ``3/1/2``, ``3//2`` or ``-1``."""
    parts = word.split("/")
    if len(parts) > 3 or not parts[0]:
        raise MeshError("a corner of a face is not understood")
    found = [_index(part, len(rows[kind])) for part, kind in zip(parts, _ORDER, strict=False)]
    vertex, texture, normal = (*found, -1, -1)[:3]
    return vertex, texture, normal


def _index(part: str, count: int) -> int:
    """Return an index from 0: the file counts from 1, or with a minus sign backwards from the last one."""
    if not part:
        return -1
    number = int(part)
    index = number + count if number < 0 else number - 1
    if number == 0 or not 0 <= index < count:
        raise MeshError(f"a face names entry {part[:20]} of {count}")
    return index


def _mesh(
    rows: dict[str, list[list[float]]], corners: list[Corner], faces: list[tuple[int, int, int]]
) -> Triangles:
    """Return the mesh; normals and texture coordinates only where every corner has them."""
    if not faces:
        raise MeshError("it has no faces, and a point cloud cannot be scanned")
    index = np.array(corners, dtype=np.int64)
    columns: list[NDArray[np.float64] | None] = [
        np.array(rows[kind])[index[:, column]] if (index[:, column] >= 0).all() else None
        for column, kind in enumerate(_ORDER)
    ]
    vertices, texture, normals = columns
    assert vertices is not None  # every corner has a vertex
    return check_triangles(vertices, np.array(faces, dtype=np.int64), normals, texture)
