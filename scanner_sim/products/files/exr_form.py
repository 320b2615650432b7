"""What an OpenEXR file claims of itself, checked against its length before the library reads it.

A range image is a single part of plain scan lines of float32 (OpenEXR File Layout,
https://openexr.com/en/latest/OpenEXRFileLayout.html). Nothing else gets to the library: tiles, deep pixels, several
parts, other pixel types, attributes that no range image has, sizes and places beyond the file.
"""

from __future__ import annotations

import struct
from typing import BinaryIO

MAGIC = b"\x76\x2f\x31\x01"

_LONG_NAMES, _VERSION = 0x400, 2
_MOST_ATTRIBUTES, _LONGEST_NAME = 4096, 255
_LARGEST_HEADER = 1 << 26
"""Bytes of all attributes; the scenario is the longest of them."""
_MOST_CHANNELS = 512
_MOST_VOXELS = 16384
"""Rows or columns of the largest raster that a scenario may ask for."""
_LINES = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32}
"""Scan lines of a block by the number of the compression: none, rle, zips, zip, piz."""
_MOST_GAIN = {0: 1, 1: 128, 2: 1100, 3: 1100, 4: 1100}
"""Bounds of size over packed size; the blocks' own headers are counted with what is packed.

Two bytes of run-length coding stand for 128 at most, and zlib reaches 1032 (its technical details). For piz the number
is an assumption.
"""
_SIZES = {
    "box2f": 16,
    "box2i": 16,
    "chromaticities": 32,
    "compression": 1,
    "double": 8,
    "float": 4,
    "int": 4,
    "lineOrder": 1,
    "rational": 8,
    "timecode": 8,
    "v2d": 16,
    "v2f": 8,
    "v2i": 8,
    "v3d": 24,
    "v3f": 12,
    "v3i": 12,
}
"""Bytes of the attributes of fixed size."""
_NEEDED = {
    "channels": "chlist",
    "compression": "compression",
    "dataWindow": "box2i",
    "displayWindow": "box2i",
    "lineOrder": "lineOrder",
    "pixelAspectRatio": "float",
    "screenWindowCenter": "v2f",
    "screenWindowWidth": "float",
}


class ForeignError(Exception):
    """The file may be a good one, but a range image it is not."""


def check_form(stream: BinaryIO, size: int) -> None:
    """Check header and blocks of an OpenEXR file of so many bytes.

    Raises
    ------
    ForeignError
        If it is of a kind that no range image has.
    ValueError
        If it contradicts itself, or is cut; the message says how.
    """
    magic, version = struct.unpack("<4sI", _read(stream, 8))
    if magic != MAGIC or version & 0xFF != _VERSION:
        raise ForeignError("it is of another version")
    if version & ~(_LONG_NAMES | 0xFF):
        raise ForeignError("it has tiles, deep pixels or several parts")
    header = _attributes(stream)
    for name, kind in _NEEDED.items():
        if header.get(name, ("", b""))[0] != kind:
            raise ValueError(f"{name} is missing")
    if header.get("type", ("string", b"scanlineimage"))[1] != b"scanlineimage":
        raise ForeignError("it is no image of scan lines")
    compression, order = header["compression"][1][0], header["lineOrder"][1][0]
    if compression not in _LINES or order != 0:
        raise ForeignError("its compression or order of lines is another")
    channels = _channels(header["channels"][1])
    _box(header["displayWindow"][1])
    columns, rows, first = _box(header["dataWindow"][1])
    if 4 * columns * rows * channels > _MOST_GAIN[compression] * size:
        raise ValueError(f"{size} bytes cannot hold {rows} × {columns} voxels in {channels} channels")
    _check_blocks(stream, size, range(first, first + rows, _LINES[compression]))


def _attributes(stream: BinaryIO) -> dict[str, tuple[str, bytes]]:
    """Return type and bytes of each attribute by its name."""
    found: dict[str, tuple[str, bytes]] = {}
    room = _LARGEST_HEADER
    while name := _name(stream):
        kind = _name(stream)
        (size,) = struct.unpack("<i", _read(stream, 4))
        if kind not in ("string", "chlist") and kind not in _SIZES:
            raise ForeignError(f"its attribute {name[:60]} is of the type {kind[:60]}")
        room -= size
        if size < 0 or room < 0 or size != _SIZES.get(kind, size):
            raise ValueError(f"the attribute {name[:60]} cannot have {size} bytes")
        if name in found or len(found) == _MOST_ATTRIBUTES:
            raise ValueError("attributes are repeated or too many")
        found[name] = (kind, _read(stream, size))
    return found


def _channels(listed: bytes) -> int:
    """Return the number of channels in a list, all of float32 and for every voxel."""
    names: list[bytes] = []
    rest = listed
    while rest != b"\0":
        name, _, rest = rest.partition(b"\0")
        if not name or len(name) > _LONGEST_NAME or len(rest) < 16 or len(names) == _MOST_CHANNELS:
            raise ValueError("the list of channels is damaged")
        if struct.unpack("<i4x2i", rest[:16]) != (2, 1, 1):
            raise ForeignError("it has channels that are no float32, or are not there for every voxel")
        names.append(name)
        rest = rest[16:]
    if not names or names != sorted(set(names)):
        raise ValueError("the list of channels is damaged")
    return len(names)


def _box(corners: bytes) -> tuple[int, int, int]:
    """Return columns, rows and the first row of a window."""
    left, top, right, bottom = struct.unpack("<4i", corners)
    columns, rows = right - left + 1, bottom - top + 1
    if not (0 < columns <= _MOST_VOXELS and 0 < rows <= _MOST_VOXELS and max(abs(left), abs(top)) < 1 << 20):
        raise ValueError(f"no raster has {rows} × {columns} voxels, beginning at {left} {top}")
    return columns, rows, top


def _check_blocks(stream: BinaryIO, size: int, lines: range) -> None:
    """Check that every block of lines lies within the file, and says of which line it is."""
    places = struct.unpack(f"<{len(lines)}Q", _read(stream, 8 * len(lines)))
    start = stream.tell()
    for place, line in zip(places, lines, strict=True):
        if not start <= place <= size - 8:
            raise ValueError(f"the block of line {line} lies beyond the file")
        stream.seek(place)
        found, packed = struct.unpack("<2i", _read(stream, 8))
        if found != line or not 0 <= packed <= size - place - 8:
            raise ValueError(f"the block of line {line} is damaged")


def _name(stream: BinaryIO) -> str:
    """Return a text that ends with a zero byte; empty at the end of the header."""
    found = bytearray()
    while (byte := _read(stream, 1)) != b"\0":
        found += byte
        if len(found) > _LONGEST_NAME:
            raise ValueError("a name has no end")
    return found.decode("utf-8")


def _read(stream: BinaryIO, count: int) -> bytes:
    found = stream.read(count)
    if len(found) != count:
        raise ValueError("it is cut")
    return found
