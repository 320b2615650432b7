"""Mutants of glTF, GLB and OFF files, and of orbit files: sound ones in which a few values are changed."""

from __future__ import annotations

import base64
import copy
import json
import random
import struct
from typing import Any

_POINTS = struct.pack("<15f", -1, -1, 0, 1, -1, 0, 1, 1, 0.1, -1, 1, 0.1, 0, 0, -0.5)
_INDEX = struct.pack("<12H", 0, 4, 1, 1, 4, 2, 2, 4, 3, 3, 4, 0)
_PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR42mNoAAAAggCB2vlR4wAAAABJRU5ErkJggg=="
)
_DATA = _POINTS + _INDEX + _PIXEL
BASE: dict[str, Any] = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0]}],
    "nodes": [
        {"name": "hull", "children": [1], "translation": [0, 0, 0.1], "rotation": [0, 0, 0.1, 1], "scale": [1, 1, 1]},
        {"name": "tip", "mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]},
    ],
    "meshes": [
        {"name": "bus", "primitives": [
            {"attributes": {"POSITION": 0, "NORMAL": 0, "TEXCOORD_0": 3}, "indices": 1, "material": 0, "mode": 4},
            {"attributes": {"POSITION": 2}, "mode": 5},
        ]}
    ],
    "materials": [{"name": "alu", "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1],
                                                           "baseColorTexture": {"index": 0}}}],
    "textures": [{"source": 0}],
    "images": [{"bufferView": 2, "mimeType": "image/png"}],
    "accessors": [
        {"bufferView": 0, "componentType": 5126, "count": 5, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"},
        {"bufferView": 0, "componentType": 5126, "count": 5, "type": "VEC3", "sparse": {
            "count": 1, "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 0}}},
        {"bufferView": 0, "componentType": 5123, "normalized": True, "count": 5, "type": "VEC2", "byteOffset": 4},
    ],
    "bufferViews": [
        {"buffer": 0, "byteLength": len(_POINTS), "byteStride": 12},
        {"buffer": 0, "byteOffset": len(_POINTS), "byteLength": len(_INDEX)},
        {"buffer": 0, "byteOffset": len(_POINTS) + len(_INDEX), "byteLength": len(_PIXEL)},
    ],
    "buffers": [{"byteLength": len(_DATA)}],
}  # fmt: skip
_VALUES: tuple[Any, ...] = (
    -1, 0, 1, 2, 3, 5, 7, 255, 65535, 2**31, 2**32, 2**63, 10**30, 0.5, 1e300, -1e39, None, True, "", "x", [], {}, [0],
    [-1], ["a"], {"a": 1}, "VEC4", "MAT4", "SCALAR", 5120, 5121, 5125, 5126, "../a.bin", "/dev/zero", "file:///etc/passwd",
    "http://example.org/a", "data:;base64,AAAA", "data:;base64,*", "data:,x", "part.gltf", "\x00", [1e300] * 16,
    [0] * 16, [float("nan")] * 3, "KHR_draco_mesh_compression", ["KHR_draco_mesh_compression"], "a" * 5000, "\x1b[31m",
)  # fmt: skip


def gltf(rng: random.Random) -> tuple[str, bytes]:
    """Return the ending of a name, and a file of a few triangles in which up to three values are changed."""
    description = copy.deepcopy(BASE)
    for _ in range(rng.choice((0, 1, 1, 2, 3))):
        _change(rng, description)
    if rng.random() < 0.5:
        buffers = description.get("buffers")
        if isinstance(buffers, list) and buffers and isinstance(buffers[0], dict):
            buffers[0].setdefault("uri", "data:;base64," + base64.b64encode(_DATA).decode())
        return "gltf", json.dumps(description).encode("utf-8", "replace")
    text = json.dumps(description).encode("utf-8", "replace")
    text += b" " * (-len(text) % 4)
    data = _DATA + b"\0" * (-len(_DATA) % 4)
    chunks = (
        struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
    )
    length = rng.choice((12 + len(chunks),) * 6 + (0, 12, 2**32 - 1))
    return "glb", b"glTF" + struct.pack("<II", rng.choice((2,) * 8 + (1, 3)), length) + chunks


def _change(rng: random.Random, description: dict[str, Any]) -> None:
    """Replace, remove or put in one value anywhere."""
    holders: list[Any] = [description]
    for holder in holders:
        inside = holder.values() if isinstance(holder, dict) else holder
        holders += [one for one in inside if isinstance(one, dict | list) and one]
    holder = rng.choice(holders)
    key = rng.choice(list(holder) if isinstance(holder, dict) else range(len(holder)))
    if rng.random() < 0.2:
        del holder[key]
    elif rng.random() < 0.2 and isinstance(holder, dict):
        name = rng.choice(
            ("uri", "byteStride", "sparse", "mesh", "children", "extensionsRequired", "mode", "count")
        )
        holder[name] = rng.choice(_VALUES)
    else:
        holder[key] = rng.choice(_VALUES)


def orbit(rng: random.Random) -> bytes:
    """Return an orbit file of relative motion with lines changed, lost and doubled."""
    lines = [
        "CCSDS_OEM_VERS = 2.0", "CREATION_DATE = 2026-01-01T00:00:00", "ORIGINATOR = TEST", "META_START",
        "OBJECT_NAME = A", "OBJECT_ID = 2026-001A", "CENTER_NAME = CHASER", "REF_FRAME = LVLH", "TIME_SYSTEM = UTC",
        "INTERPOLATION = HERMITE", "INTERPOLATION_DEGREE = 3", "META_STOP",
        *(f"2026-03-20T12:00:0{second}.5 0 0 0.00{5 + second} 0 0 0.001" for second in range(4)),
    ]  # fmt: skip
    extra = (
        "META_START", "META_STOP", "COVARIANCE_START", "COMMENT x", "INTERPOLATION = LAGRANGE", "TIME_SYSTEM = X",
        "INTERPOLATION_DEGREE = 99999", "INTERPOLATION_DEGREE = x", "2026-13-40T99:00:00 0 0 0 0 0 0", "=", "= x",
        "2026-03-20T12:00:09 0 0 1e300 0 0 0", "2026-03-20T12:00:09 nan 0 0 0 0 0", "2026-03-20T12:00:09 0 0",
        "x " * 5000, "9999-366T23:59:60 0 0 0 0 0 0", "0000-001T00:00:00 0 0 0 0 0 0", "CENTER_NAME = EARTH",
        "\x1b[31m = \x00",
    )  # fmt: skip
    for _ in range(rng.choice((0, 1, 1, 2, 4))):
        at = rng.randrange(len(lines))
        match rng.randrange(3):
            case 0:
                del lines[at]
            case 1:
                lines.insert(at, rng.choice(lines))
            case _:
                lines.insert(at, rng.choice(extra))
    return "\n".join(lines).encode()
