"""Reading Wavefront OBJ files: vertices, normals, texture coordinates, faces, and the names of their parts."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scanner_sim.scene.files.file_meshes import MOST_PARTS, Colour, FileMesh, FilePart, counted
from scanner_sim.scene.files.obj_materials import colours_of_libraries, files_of_libraries
from scanner_sim.scene.files.triangles import MAKE_FACES, NO_FACES, MeshError, check_triangles

_COLUMNS = {"v": 3, "vt": 2, "vn": 3}
_ORDER = ("v", "vt", "vn")
_NAMES = {"usemtl": 0, "g": 1, "o": 2}
_FREE_FORM = {"curv", "curv2", "surf"}
_NO_NUMBER = float("nan")
Corner = tuple[int, int, int]
"""Indices of vertex, texture coordinate and normal, from 0; −1 for none."""


def obj_mesh(content: bytes, path: Path) -> FileMesh:
    """Return the mesh of an OBJ file; its material libraries are opened only when its colours are asked for.

    Normals and texture coordinates that are odd are left out, with a note: the renderer makes normals from the faces.

    Raises
    ------
    MeshError
        If a line cannot be read, a face names what is not there, or the mesh is unsound.
    """
    reader = _Reader()
    for line, words in enumerate(map(str.split, _lines(content)), start=1):
        if not words:
            continue
        try:
            reader.read(words)
        except ValueError:
            raise MeshError(f"line {line} holds something that is not a number") from None
        except MeshError as fault:
            raise MeshError(f"line {line}: {fault}", fault.remedy) from None
    return reader.mesh(path)


def files_of_obj(content: bytes, path: Path) -> set[Path]:
    """Return the files that an OBJ file names and that are there: libraries of materials, and their textures."""
    lines = (line.split() for line in _lines(content) if "mtllib" in line)
    names = tuple(" ".join(words[1:])[:1000] for words in lines if words[0] == "mtllib")
    return files_of_libraries(names, path.parent.resolve())


def _lines(content: bytes) -> list[str]:
    """Return the lines of an OBJ file; a backslash continues one."""
    # Names and comments may be in any encoding; Latin-1 knows every byte.
    encoding = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "latin-1"
    return content.decode(encoding, "replace").replace("\\\r\n", " ").replace("\\\n", " ").split("\n")


class _Reader:
    """What was read of a file so far."""

    def __init__(self) -> None:
        self._rows: dict[str, list[list[float]]] = {name: [] for name in _ORDER}
        self._corners: dict[Corner, int] = {}
        self._faces: list[tuple[int, int, int]] = []
        self._part_of: list[int] = []
        self._parts: dict[tuple[str, ...], int] = {}
        self._names = ["", "", ""]
        self._libraries: list[str] = []
        self._odd: Counter[str] = Counter()

    def read(self, words: list[str]) -> None:
        """Take one line, in words."""
        match words[0]:
            case "v":
                self._rows["v"].append(_numbers(words[1:], 3, "v"))
            case "vt" | "vn":
                self._rows[words[0]].append(self._lenient(words))
            case "f" | "fo":
                self._face(words[1:])
            case "usemtl" | "g" | "o":
                self._names[_NAMES[words[0]]] = " ".join(words[1:])[:200]
            case "mtllib":
                self._libraries.append(" ".join(words[1:])[:1000])
            case kind if kind in _FREE_FORM:
                self._odd["free-form curve or surface"] += 1

    def _lenient(self, words: list[str]) -> list[float]:
        """Return a normal or a texture coordinate; not numbers where it is none."""
        try:
            return _numbers(words[1:], _COLUMNS[words[0]], words[0])
        except (ValueError, MeshError):
            return [_NO_NUMBER] * _COLUMNS[words[0]]

    def _face(self, words: list[str]) -> None:
        corners = [self._corner(word) for word in words]
        if len(corners) < 3:
            self._odd["face of fewer than three corners"] += 1
            return
        found = [self._corners.setdefault(corner, len(self._corners)) for corner in corners]
        triangles = [(found[0], one, two) for one, two in pairwise(found[1:])]
        part = self._parts.setdefault(tuple(self._names), len(self._parts))
        if len(self._parts) > MOST_PARTS:
            raise MeshError(f"it has more than {MOST_PARTS} parts")
        self._faces += triangles
        self._part_of += [part] * len(triangles)

    def _corner(self, word: str) -> Corner:
        """Return the indices of a corner such as ``3/1/2``, ``3//2`` or ``-1``."""
        parts = word.split("/")
        if len(parts) > 3 or not parts[0]:
            raise MeshError("a corner of a face is not understood")
        found = [self._index(part, kind) for part, kind in zip(parts, _ORDER, strict=False)]
        vertex, texture, normal = (*found, -1, -1)[:3]
        return vertex, texture, normal

    def _index(self, part: str, kind: str) -> int:
        """Return an index from 0: the file counts from 1, or with a minus sign backwards from the last one."""
        if not part:
            return -1
        number, count = int(part), len(self._rows[kind])
        index = number + count if number < 0 else number - 1
        if number == 0 or not 0 <= index < count:
            if kind == "v":
                raise MeshError(f"a face names entry {part[:20]} of {count}")
            self._odd[f"corner whose {_SHOWN[kind]} is not there"] += 1
            return -1
        return index

    def mesh(self, path: Path) -> FileMesh:
        """Return the mesh; normals and texture coordinates only where every corner has sound ones."""
        if not self._faces:
            raise MeshError(NO_FACES, MAKE_FACES)
        index = np.array(list(self._corners), dtype=np.int64)
        vertices = np.array(self._rows["v"])[index[:, 0]]
        texture, normals = (self._column(kind, index[:, at]) for at, kind in ((1, "vt"), (2, "vn")))
        faces = np.array(self._faces, dtype=np.int64)
        names = [FilePart(part) for part in self._parts]
        libraries = tuple(self._libraries)

        def colours() -> tuple[Colour | None, ...]:
            known = colours_of_libraries(libraries, path.parent.resolve())
            return tuple(known.get(part.names[0]) for part in names)

        return FileMesh(
            check_triangles(vertices, faces, normals, texture),
            np.array(self._part_of, dtype=np.intp),
            tuple(names),
            tuple(f"{number:,} × {what}: left out" for what, number in self._odd.items()),
            rows_from_below=True,
            colours=colours if libraries else None,
        )

    def _column(self, kind: str, index: NDArray[np.int64]) -> NDArray[np.float64] | None:
        """Return normals or texture coordinates of the corners; None where some corner has none that is sound."""
        if not self._rows[kind] or (index < 0).all():
            return None
        if (index < 0).any():
            self._odd[f"corner without {_SHOWN[kind]}, so that those of all"] = int((index < 0).sum())
            return None
        found = np.array(self._rows[kind])[index]
        single = np.abs(found) <= np.finfo(np.float32).max
        if not single.all():
            self._odd[f"{_SHOWN[kind]} that is not finite, so that all"] = int((~single.all(axis=1)).sum())
            return None
        return found


_SHOWN = {"vt": "texture coordinate", "vn": "normal"}


def _numbers(words: list[str], wanted: int, kind: str) -> list[float]:
    """Return the numbers of a line; a texture coordinate may lack its second one."""
    found = [float(word) for word in words[:wanted]]
    if kind == "vt" and len(found) == 1:
        found.append(0.0)
    if len(found) < wanted:
        raise MeshError(f"'{kind}' has fewer than {counted(wanted, 'number')}")
    return found
