"""Reading PLY files: text, little-endian and big-endian, with lists of any whole-number type."""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.named_files import LARGEST_MESH
from scanner_sim.scene.files.file_meshes import FileMesh
from scanner_sim.scene.files.triangles import (
    MAKE_FACES,
    NO_FACES,
    MeshError,
    Triangles,
    check_triangles,
    fans,
)

LONGEST_HEADER = 1 << 20
"""Bytes before the data: comments may be long."""

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_WHOLE = {name for name, kind in _TYPES.items() if kind[0] != "f"}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class _Property:
    """A column of an element: a number, or a list where ``count`` is the type of its length."""

    name: str
    kind: str
    count: str = ""


@dataclass
class _Element:
    """A table of the file."""

    name: str
    rows: int
    properties: list[_Property] = field(default_factory=list)

    @property
    def lists(self) -> list[_Property]:
        return [column for column in self.properties if column.count]


Table = dict[str, NDArray[np.generic]]


def ply_mesh(content: bytes) -> FileMesh:
    """Return the mesh of a PLY file, of one part; faults as :func:`ply_triangles`."""
    return FileMesh.whole(ply_triangles(content))


def ply_triangles(content: bytes) -> Triangles:
    """Return the triangles of a PLY file: of its faces, and of strips of triangles.

    Raises
    ------
    MeshError
        If the header is none, the data contradict it, or the mesh is unsound.
    """
    order, elements, start = _header(content)
    source = _Text(content[start:]) if not order else _Binary(content, start, order)
    tables: dict[str, Table] = {}
    for element in elements:
        if element.rows * _least(element, text=not order) > source.left:
            raise MeshError(
                f"the header announces {element.rows} rows of '{element.name}', and the data end before"
            )
        tables[element.name] = _table(element, source)
    if source.left and source.rest.strip():
        raise MeshError("there are more data than the header announces")
    return _mesh(tables)


def _header(content: bytes) -> tuple[str, list[_Element], int]:
    """Return byte order (empty for text), elements and the offset at which the data start."""
    end = re.compile(rb"\nend_header[ \t]*\r?(\n|\Z)").search(content, 0, LONGEST_HEADER)
    if content[:3] != b"ply" or content[3:4] not in (b"\n", b"\r") or end is None:
        raise MeshError("it has no PLY header")
    order: str | None = None
    elements: list[_Element] = []
    # Comments may be in any encoding; Latin-1 knows every byte.
    for line in content[: end.start()].decode("latin-1").split("\n")[1:]:
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                continue
            case ["format", name, "1.0"] if name in _ORDERS and order is None:
                order = _ORDERS[name]
            case ["element", name, rows] if re.fullmatch(r"[0-9]{1,12}", rows) and name.isprintable():
                elements.append(_Element(name, int(rows)))
            case ["property", kind, name] if kind in _TYPES and elements:
                elements[-1].properties.append(_Property(name, _TYPES[kind]))
            case ["property", "list", count, kind, name] if count in _WHOLE and kind in _TYPES and elements:
                elements[-1].properties.append(_Property(name, _TYPES[kind], _TYPES[count]))
            case ["format" | "element" | "property", *_]:
                raise MeshError("a line of its header is not understood")
            case _:
                # Some programs write a remark without the word for it.
                continue
    names = [element.name for element in elements]
    columns = [[column.name for column in element.properties] for element in elements]
    if order is None or len(set(names)) < len(names) or any(len(set(row)) < len(row) for row in columns):
        raise MeshError("its header names no format, or something twice")
    return order, elements, end.end()


def _least(element: _Element, *, text: bool) -> int:
    """Return the fewest bytes, or numbers of a text, that a row can have."""
    if text:
        return len(element.properties)
    return sum(_size(column.count or column.kind) for column in element.properties)


class _Binary:
    """The data of a binary file, from an offset on."""

    def __init__(self, content: bytes, start: int, order: str) -> None:
        self._content, self._at, self._order = content, start, order

    @property
    def left(self) -> int:
        return len(self._content) - self._at

    @property
    def rest(self) -> bytes:
        return self._content[self._at :]

    def rows(self, element: _Element, lengths: tuple[int, ...]) -> Table | None:
        """Return all rows if their lists have these lengths, and move on; else None."""
        spans = iter(lengths)
        fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
        for number, column in enumerate(element.properties):
            if column.count:
                fields.append((f"count {number}", self._order + column.count))
                fields.append((column.name, self._order + column.kind, (next(spans),)))
            else:
                fields.append((column.name, self._order + column.kind))
        if (
            element.rows * sum(np.dtype(kind).itemsize * np.prod(rest or 1) for _, kind, *rest in fields)
            > self.left
        ):
            return None
        table = np.frombuffer(self._content, np.dtype(fields), element.rows, self._at)
        counts = [name for name, *_ in fields if name.startswith("count ")]
        if any((table[name] != length).any() for name, length in zip(counts, lengths, strict=True)):
            return None
        self._at += table.nbytes
        return {column.name: table[column.name] for column in element.properties}

    def lengths(self, element: _Element) -> tuple[int, ...]:
        """Return the lengths of the lists of the next row."""
        at, found = self._at, []
        for column in element.properties:
            if column.count:
                found.append(self._length(at, column))
                at += _size(column.count) + found[-1] * _size(column.kind)
            else:
                at += _size(column.kind)
        return tuple(found)

    def polygons(self, element: _Element, column: _Property) -> list[NDArray[np.generic]]:
        """Return the lists of a column, one array (n, length) for each length; and move on."""
        starts, lengths, at = [], [], self._at
        for _ in range(element.rows):
            for one in element.properties:
                length = self._length(at, one) if one.count else 1
                at += _size(one.count) if one.count else 0
                if one is column:
                    lengths.append(length)
                    starts.append(at)
                at += length * _size(one.kind)
        if at > len(self._content):
            raise MeshError(_ENDS)
        self._at = at
        data = np.frombuffer(self._content, np.uint8)
        kind = np.dtype(self._order + column.kind)
        return [
            data[offset[:, None] + np.arange(length * kind.itemsize)].view(kind)
            for length, offset in _by_length(lengths, starts)
        ]

    def _length(self, at: int, column: _Property) -> int:
        size = _size(column.count)
        if at + size > len(self._content):
            raise MeshError(_ENDS)
        order: Literal["little", "big"] = "little" if self._order == "<" else "big"
        number = int.from_bytes(self._content[at : at + size], order, signed=column.count[0] == "i")
        return _whole(number)


class _Text:
    """The data of a text file: numbers one after the other."""

    def __init__(self, content: bytes) -> None:
        self._numbers = _numbers(content)
        self._at = 0

    @property
    def left(self) -> int:
        return len(self._numbers) - self._at

    @property
    def rest(self) -> bytes:
        return b"numbers"

    def rows(self, element: _Element, lengths: tuple[int, ...]) -> Table | None:
        """Return all rows if their lists have these lengths, and move on; else None."""
        width = len(element.properties) + sum(lengths)
        if element.rows * width > self.left:
            return None
        block = self._numbers[self._at : self._at + element.rows * width].reshape(element.rows, width)
        table: Table = {}
        spans, at = iter(lengths), 0
        for column in element.properties:
            if column.count:
                length = next(spans)
                if (block[:, at] != length).any():
                    return None
                table[column.name] = block[:, at + 1 : at + 1 + length]
                at += 1 + length
            else:
                table[column.name] = block[:, at]
                at += 1
        self._at += block.size
        return table

    def lengths(self, element: _Element) -> tuple[int, ...]:
        """Return the lengths of the lists of the next row."""
        at, found = self._at, []
        for column in element.properties:
            if column.count:
                found.append(self._length(at))
            at += 1 + (found[-1] if column.count else 0)
        return tuple(found)

    def polygons(self, element: _Element, column: _Property) -> list[NDArray[np.generic]]:
        """Return the lists of a column, one array (n, length) for each length; and move on."""
        starts, lengths, at = [], [], self._at
        for _ in range(element.rows):
            for one in element.properties:
                length = self._length(at) if one.count else 1
                at += 1 if one.count else 0
                if one is column:
                    lengths.append(length)
                    starts.append(at)
                at += length
        if at > len(self._numbers):
            raise MeshError(_ENDS)
        self._at = at
        return [
            self._numbers[offset[:, None] + np.arange(length)]
            for length, offset in _by_length(lengths, starts)
        ]

    def _length(self, at: int) -> int:
        if at >= len(self._numbers):
            raise MeshError(_ENDS)
        return _whole(self._numbers[at])


_ENDS = "the data end within a row"


def _size(kind: str) -> int:
    return int(kind[1:])


def _by_length(lengths: list[int], starts: list[int]) -> list[tuple[int, NDArray[np.int64]]]:
    """Return each length with the offsets of the lists that have it."""
    every, offset = np.array(lengths), np.array(starts, dtype=np.int64)
    return [(int(length), offset[every == length]) for length in np.unique(every)]


def _numbers(content: bytes) -> NDArray[np.float64]:
    """Return the numbers of a text."""
    text = content.decode("latin-1")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(text, dtype=np.float64, sep=" ") if text.strip() else np.empty(0)
        except (DeprecationWarning, ValueError):
            raise MeshError("its data hold something that is not a number") from None


def _whole(length: float) -> int:
    """Return the length of a list; none has more entries than a file has bytes."""
    if not 0 <= length <= LARGEST_MESH or length != int(length):
        raise MeshError("the length of a list is not possible")
    return int(length)


def _table(element: _Element, source: _Binary | _Text) -> Table:
    """Return the columns of an element, that of a face's vertices as triangles ``corners``."""
    if not element.rows or not element.properties:
        return {}
    # Nearly always every row is like the first one, and the table is read at once.
    table = source.rows(element, source.lengths(element))
    lists = element.lists
    corners = next((one for one in lists if one.name in ("vertex_indices", "vertex_index")), None)
    if table is None and (not lists or element.name == "vertex"):
        raise MeshError(f"the lists of '{element.name}' differ in length from row to row" if lists else _ENDS)
    if table is None:
        polygons = source.polygons(element, corners or lists[0])
    else:
        polygons = [table[corners.name]] if corners is not None else []
    if corners is None or element.name not in ("face", "tristrips"):
        return table or {}
    if element.name == "tristrips":
        return {"corners": _strips(polygons)}
    if min(entry.shape[1] for entry in polygons) < 3:
        raise MeshError("a face has fewer than three corners")
    return {"corners": np.concatenate([fans(entry) for entry in polygons])}


def _strips(lists: list[NDArray[np.generic]]) -> NDArray[np.generic]:
    """Return the triangles of strips, (n, 3); −1 ends a strip, and every other triangle is turned."""
    found = [np.empty((0, 3))]
    for strip in (row for entry in lists for row in entry.astype(np.float64)):
        ends = np.flatnonzero(strip < 0.0)
        for run in np.split(strip, ends):
            corners = run[run >= 0.0]
            number = np.arange(max(len(corners) - 2, 0))
            odd = number % 2
            found.append(
                np.stack([corners[number], corners[number + 1 + odd], corners[number + 2 - odd]], axis=1)
            )
    return np.concatenate(found)


def _mesh(tables: dict[str, Table]) -> Triangles:
    """Return the mesh of the elements ``vertex`` and ``face``."""
    vertex = tables.get("vertex", {})
    held = [tables[name]["corners"] for name in ("face", "tristrips") if "corners" in tables.get(name, {})]
    if not held:
        raise MeshError(NO_FACES, MAKE_FACES)
    vertices = _columns(vertex, "x", "y", "z")
    if vertices is None:
        raise MeshError("its vertices have no x, y and z")
    corners = held[0] if len(held) == 1 else np.concatenate(held)
    if corners.dtype.kind == "f" and not (corners == np.floor(corners)).all():
        raise MeshError("a face names a vertex by a number that is not whole")
    texture = _columns(vertex, "u", "v")
    texture = _columns(vertex, "s", "t") if texture is None else texture
    return check_triangles(vertices, corners, _columns(vertex, "nx", "ny", "nz"), texture)


def _columns(table: Table, *names: str) -> NDArray[np.generic] | None:
    """Return columns side by side, (n, …), or None where one is missing or holds lists."""
    if any(name not in table or table[name].ndim != 1 for name in names):
        return None
    return np.stack([table[name] for name in names], axis=1)
