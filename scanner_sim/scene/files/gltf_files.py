"""Reading glTF 2.0, as text with its files beside it or as one binary file (GLB).

Written from the specification (Khronos Group, *glTF 2.0 Specification*, 2.0.1, sections 3 to 5). Every number of the
file is held against what is there before it is used; nothing is fetched from a network.
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.named_files import LARGEST_MESH, file_beside, read_ordinary
from scanner_sim.scene.files.file_meshes import MOST_PARTS, Colour, FileMesh, FilePart, counted
from scanner_sim.scene.files.gltf_geometry import Geometry, joined, triangles_of
from scanner_sim.scene.files.triangles import MAKE_FACES, MeshError

LONGEST_JSON = 1 << 28
"""Characters of the description: buffers in base64 count."""
MOST_FACES = 30_000_000
"""Faces, those of a mesh counted at each place where it stands."""
_MAGIC, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942
_KINDS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_UNDERSTOOD = {"KHR_mesh_quantization", "KHR_materials_unlit"}
_MODES = {4: "triangles", 5: "strip", 6: "fan"}

Floats = NDArray[np.float64]


class _Placed(NamedTuple):
    """A mesh at one place: its number, the matrix of its node, and the node's name."""

    mesh: int
    matrix: Floats
    name: str


def gltf_mesh(content: bytes, path: Path) -> FileMesh:
    """Return the mesh of a glTF or GLB file; other files that it names must lie in its folder.

    Raises
    ------
    MeshError
        If it contradicts itself, needs an extension that is not understood, or holds no triangles.
    InputError
        If a file that it names cannot be read, or leads out of its folder.
    """
    description, chunk = _split(content)
    return _File(description, chunk, path.parent.resolve()).mesh()


def files_of_gltf(content: bytes, path: Path) -> set[Path]:
    """Return the files that a glTF file names; a name that leads out of its folder is left out."""
    description, _ = _split(content)
    found: set[Path] = set()
    for entry in (*_list(description, "buffers"), *_list(description, "images")):
        name = entry.get("uri", "")
        if isinstance(name, str) and name and not name.startswith("data:"):
            # The mesh may be read without what such a name stands for, as without its colours.
            with suppress(InputError):
                found.add(file_beside(unquote(name), path.parent.resolve()))
    return found


def _split(content: bytes) -> tuple[dict[str, Any], bytes | None]:
    """Return the description, and the binary chunk of a GLB file."""
    chunk = None
    text = content
    if content[:4] == b"glTF":
        if len(content) < 20:
            raise MeshError("it breaks off in its header")
        _, version, length, size, kind = struct.unpack_from("<5I", content)
        if version != 2:
            raise MeshError(f"it is glTF {version}, and version 2 is read", "Export it as glTF 2.0.")
        if length > len(content) or kind != _JSON or 20 + size > length:
            raise MeshError("its length is not the one that its header announces")
        text = content[20 : 20 + size]
        at = 20 + size + -size % 4
        if at + 8 <= length:
            size, kind = struct.unpack_from("<2I", content, at)
            if kind == _BIN:
                chunk = content[at + 8 : at + 8 + size]
                if len(chunk) != size:
                    raise MeshError("its binary chunk breaks off")
    if len(text) > LONGEST_JSON:
        raise MeshError(f"its description has more than {LONGEST_JSON >> 20} MiB")
    try:
        description = json.loads(text.decode("utf-8-sig"))
    except (ValueError, RecursionError):
        raise MeshError("its description is no JSON") from None
    if not isinstance(description, dict):
        raise MeshError("its description is no JSON object")
    return description, chunk


def _list(holder: dict[str, Any], key: str) -> list[dict[str, Any]]:
    """Return a list of objects, empty where there is none."""
    found = holder.get(key, [])
    if not isinstance(found, list) or not all(isinstance(entry, dict) for entry in found):
        raise MeshError(f"'{key}' is not a list of objects")
    return found


def _entry(entries: list[dict[str, Any]], index: object, what: str) -> dict[str, Any]:
    if not isinstance(index, int) or not _is_index(index) or index >= len(entries):
        raise MeshError(f"it names a {what} that is not there")
    return entries[index]


def _is_index(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _whole(holder: dict[str, Any], key: str, default: int | None = None) -> int:
    value = holder.get(key, default)
    if not _is_index(value) or value > LARGEST_MESH:  # type: ignore[operator]
        raise MeshError(f"'{key}' is no number of bytes or entries that is possible")
    return value  # type: ignore[return-value]


def _kind(holder: dict[str, Any]) -> str | None:
    """Return NumPy's name of the numbers that an accessor counts in; None for none."""
    code = holder.get("componentType")
    return _KINDS.get(code) if isinstance(code, int) else None


def _name(entry: dict[str, Any]) -> str:
    name = entry.get("name", "")
    return name if isinstance(name, str) else ""


class _File:
    """One file while it is read."""

    def __init__(self, description: dict[str, Any], chunk: bytes | None, folder: Path) -> None:
        self._all, self._chunk, self._folder = description, chunk, folder
        self._buffers: dict[int, bytes] = {}
        self._left_out: dict[str, int] = {}
        self._split = False
        asset = description.get("asset")
        version = str(asset.get("version", "")) if isinstance(asset, dict) else ""
        if not version.startswith("2."):
            raise MeshError(
                f"it is glTF {version[:10] or 'of no version'}, and version 2 is read",
                "Export it as glTF 2.0.",
            )
        self._refuse_extensions()

    def mesh(self) -> FileMesh:
        """Return all triangles of the scene."""
        pieces: list[Geometry] = []
        parts: list[FilePart] = []
        materials: list[int | None] = []
        faces = 0
        meshes = _list(self._all, "meshes")
        for placed in self._placed():
            mesh = _entry(meshes, placed.mesh, "mesh")
            for number, primitive in enumerate(_list(mesh, "primitives")):
                try:
                    found = self._primitive(primitive, placed.matrix)
                except MeshError as fault:
                    shown = f"primitive {number} of mesh {placed.mesh}"
                    raise MeshError(f"{shown}: {fault}", fault.remedy) from None
                if found is None:
                    continue
                material = primitive.get("material")
                own = [] if material is None else [_name(_entry(self._materials, material, "material"))]
                pieces.append(found)
                parts.append(FilePart((*(own or [""]), _name(mesh), placed.name)))
                materials.append(material)
                faces += len(found.faces)
                if faces > MOST_FACES or len(parts) > MOST_PARTS:
                    raise MeshError(f"it has more than {MOST_FACES:.0e} triangles or {MOST_PARTS} parts")
        if not pieces:
            left_out = ", ".join(f"{number:,} × {what}" for what, number in self._left_out.items())
            raise MeshError(f"its scene has no triangles{': ' if left_out else ''}{left_out}", MAKE_FACES)
        return FileMesh(
            joined(pieces),
            np.repeat(np.arange(len(pieces)), [len(piece.faces) for piece in pieces]),
            tuple(parts),
            self._notes(),
            unit=1.0,
            split=self._split,
            colours=lambda: tuple(map(self._colour, materials)),
        )

    @property
    def _materials(self) -> list[dict[str, Any]]:
        return _list(self._all, "materials")

    def _refuse_extensions(self) -> None:
        """Find an extension without which the file means something else."""
        required = self._all.get("extensionsRequired", [])
        names = [str(name)[:60] for name in required] if isinstance(required, list) else []
        # What only says how a surface looks to the eye is not needed here.
        unknown = [
            name
            for name in names
            if name not in _UNDERSTOOD
            and not name.startswith(("KHR_materials_", "KHR_texture_", "EXT_texture_"))
        ]
        if unknown:
            raise MeshError(
                f"it needs {', '.join(unknown)[:200]}, which is not read",
                "Export it without compression and extensions.",
            )

    def _notes(self) -> tuple[str, ...]:
        """Return what of the file does not count here."""
        notes = [f"{number:,} × {what} left out" for what, number in self._left_out.items()]
        ignored = {
            "animations": "animations are not played",
            "skins": "skins are not applied: the mesh stands as it was drawn",
        }
        notes += [said for key, said in ignored.items() if self._all.get(key)]
        transforms = "KHR_texture_transform"
        if transforms in (self._all.get("extensionsUsed") or ()):
            notes.append(f"{transforms} is not applied")
        return tuple(notes)

    def _skip(self, what: str) -> None:
        self._left_out[what] = self._left_out.get(what, 0) + 1

    def _placed(self) -> list[_Placed]:
        """Return the meshes of the scene with their places; where there is no scene, each as it is."""
        nodes, scenes = _list(self._all, "nodes"), _list(self._all, "scenes")
        if scenes:
            roots = _entry(scenes, self._all.get("scene", 0), "scene").get("nodes", [])
        else:
            children = [child for node in nodes for child in _indices(node, "children")]
            roots = sorted({*range(len(nodes))} - set(children))
        found: list[_Placed] = []
        seen: set[int] = set()
        waiting = [(root, np.eye(4)) for root in reversed(_indices({"nodes": roots}, "nodes"))]
        while waiting:
            index, above = waiting.pop()
            node = _entry(nodes, index, "node")
            if index in seen:
                raise MeshError("a node stands at two places, or within itself")
            seen.add(index)
            matrix = above @ _matrix(node)
            if "mesh" in node:
                found.append(_Placed(node["mesh"], matrix, _name(node)))
            waiting += [(child, matrix) for child in reversed(_indices(node, "children"))]
        if not nodes:
            found = [_Placed(number, np.eye(4), "") for number in range(len(_list(self._all, "meshes")))]
        return found

    def _primitive(self, primitive: dict[str, Any], matrix: Floats) -> Geometry | None:
        """Return the triangles of a primitive where they stand, or None if it is made of points or lines."""
        mode = primitive.get("mode", 4)
        if not isinstance(mode, int) or mode not in _MODES:
            self._skip("points or lines")
            return None
        if primitive.get("targets"):
            self._skip("morph targets")
        attributes = primitive.get("attributes")
        if not isinstance(attributes, dict) or "POSITION" not in attributes:
            self._skip("primitive without positions")
            return None
        vertices = self._accessor(attributes["POSITION"], 3)
        others = [
            self._accessor(attributes[key], columns) if key in attributes else None
            for key, columns in (("NORMAL", 3), ("TEXCOORD_0", 2))
        ]
        if any(column is not None and len(column) != len(vertices) for column in others):
            raise MeshError("it has fewer normals or texture coordinates than vertices")
        if "indices" in primitive:
            index = self._accessor(primitive["indices"], 1).ravel()
        else:
            index = np.arange(len(vertices), dtype=np.float64)
        if len(index) and not index.max() < len(vertices):
            raise MeshError(f"a face names the vertex {index.max():.0f}, and {len(vertices)} are there")
        faces = triangles_of(index.astype(np.int64), _MODES[mode])
        if not len(faces):
            self._skip("primitive without a face")
            return None
        self._split |= others[0] is None
        return Geometry(vertices, faces, others[0], others[1]).moved(matrix)

    def _accessor(self, index: object, columns: int) -> Floats:
        """Return the numbers of an accessor, shape (n, columns)."""
        accessor = _entry(_list(self._all, "accessors"), index, "accessor")
        kind, count = _kind(accessor), _whole(accessor, "count")
        if kind is None or _COLUMNS.get(str(accessor.get("type"))) != columns:
            raise MeshError("an accessor is not of the kind that belongs there")
        if "bufferView" in accessor:
            place = accessor["bufferView"], _whole(accessor, "byteOffset", 0)
            values = self._rows(*place, count, columns, np.dtype(kind)).astype(np.float64)
        else:
            if "sparse" not in accessor:
                raise MeshError("an accessor has no data; they may be compressed")
            values = np.zeros((min(count, LARGEST_MESH // (8 * columns)), columns))
        if "sparse" in accessor:
            self._put_sparse(accessor["sparse"], values, np.dtype(kind))
        if accessor.get("normalized") and kind != "<f4":
            values = np.maximum(values / np.iinfo(kind).max, -1.0)
        return values

    def _put_sparse(self, sparse: Any, values: Floats, kind: np.dtype[Any]) -> None:
        """Replace some rows of an accessor."""
        where, what = (sparse.get(key) if isinstance(sparse, dict) else None for key in ("indices", "values"))
        if not isinstance(where, dict) or not isinstance(what, dict):
            raise MeshError("a sparse accessor has no indices or no values")
        count, index_kind = _whole(sparse, "count"), _kind(where)
        if index_kind not in ("u1", "<u2", "<u4"):
            raise MeshError("a sparse accessor counts by no whole numbers")
        places = where.get("bufferView"), _whole(where, "byteOffset", 0)
        rows = self._rows(*places, count, 1, np.dtype(index_kind)).ravel()
        if len(rows) and not rows.max() < len(values):
            raise MeshError("a sparse accessor names a row that is not there")
        held = what.get("bufferView"), _whole(what, "byteOffset", 0)
        values[rows] = self._rows(*held, count, values.shape[1], kind)

    def _rows(
        self, view_index: object, offset: int, count: int, columns: int, kind: np.dtype[Any]
    ) -> NDArray[Any]:
        """Return rows of a buffer's view; nothing is made that the buffer does not hold."""
        view = _entry(_list(self._all, "bufferViews"), view_index, "view of a buffer")
        data = self._buffer(view.get("buffer"))
        start, length = _whole(view, "byteOffset", 0), _whole(view, "byteLength")
        width = columns * kind.itemsize
        stride = _whole(view, "byteStride", 0) or width
        if start + length > len(data) or stride < width:
            raise MeshError("a view reaches beyond its buffer")
        if count and offset + (count - 1) * stride + width > length:
            raise MeshError(f"an accessor of {count} entries reaches beyond its buffer")
        record = np.dtype(
            {"names": ["row"], "formats": [(kind, (columns,))], "offsets": [0], "itemsize": stride}
        )
        if not count:
            return np.empty((0, columns), kind)
        block = data[start + offset : start + offset + (count - 1) * stride + width]
        padded = block.ljust(count * stride, b"\0")
        return np.frombuffer(padded, record, count)["row"]

    def _buffer(self, index: object) -> bytes:
        buffer = _entry(_list(self._all, "buffers"), index, "buffer")
        number: int = index  # type: ignore[assignment]
        if number not in self._buffers:
            if "uri" in buffer:
                self._buffers[number] = self._resource(buffer["uri"])
            elif number == 0 and self._chunk is not None:
                self._buffers[number] = self._chunk
            else:
                raise MeshError("a buffer has no data")
        return self._buffers[number]

    def _resource(self, name: object) -> bytes:
        """Return what a URI stands for: data in base64, or a file in the folder."""
        if not isinstance(name, str):
            raise MeshError("the name of a buffer or an image is no text")
        if name.startswith("data:"):
            head, comma, text = name.partition(",")
            if not comma or not head.endswith(";base64"):
                raise MeshError("data within it are not in base64")
            try:
                return base64.b64decode(text, validate=True)
            except (binascii.Error, ValueError):
                raise MeshError("data within it are not in base64") from None
        if "://" in name[:20]:
            raise InputError(
                "the mesh names an address of the network, and nothing is fetched.",
                remedy="Put the file beside the mesh, or export one GLB file.",
            )
        return read_ordinary(file_beside(unquote(name), self._folder), LARGEST_MESH)

    def _colour(self, material: int | None) -> Colour | None:
        """Return the base colour of a material."""
        if material is None:
            return None
        found = _entry(self._materials, material, "material").get("pbrMetallicRoughness", {})
        found = found if isinstance(found, dict) else {}
        factor = found.get("baseColorFactor", [1.0, 1.0, 1.0, 1.0])
        if not isinstance(factor, list) or len(factor) < 3 or not all(_is_share(one) for one in factor[:3]):
            raise MeshError("a base colour is not three shares")
        texture = found.get("baseColorTexture")
        image = None
        if isinstance(texture, dict):
            if texture.get("texCoord", 0) != 0:
                raise MeshError("a texture uses a second set of coordinates; bake it onto the first")
            source = _entry(_list(self._all, "textures"), texture.get("index"), "texture").get("source")
            image = self._image(_entry(_list(self._all, "images"), source, "image of a known kind"))
        red, green, blue = (float(one) for one in factor[:3])
        return Colour((red, green, blue), image)

    def _image(self, image: dict[str, Any]) -> bytes:
        if "uri" in image:
            return self._resource(image["uri"])
        view = _entry(_list(self._all, "bufferViews"), image.get("bufferView"), "view of a buffer")
        data = self._buffer(view.get("buffer"))
        start, length = _whole(view, "byteOffset", 0), _whole(view, "byteLength")
        return data[start : start + length]


def _is_share(value: object) -> bool:
    return isinstance(value, int | float) and 0.0 <= value <= 1.0


def _indices(holder: dict[str, Any], key: str) -> list[int]:
    found = holder.get(key, [])
    if not isinstance(found, list) or not all(map(_is_index, found)):
        raise MeshError(f"'{key}' is not a list of numbers")
    return found


def _matrix(node: dict[str, Any]) -> Floats:
    """Return the transform of a node: its matrix, or scale, rotation and translation one after the other."""

    def numbers(key: str, default: list[float]) -> Floats:
        found = node.get(key, default)
        plain = isinstance(found, list) and all(isinstance(one, int | float) for one in found)
        values = np.array(found, dtype=np.float64) if plain else np.empty(0)
        if values.shape != (len(default),) or not (np.abs(values) <= 1e12).all():
            raise MeshError(f"the {key} of a node is not {counted(len(default), 'number')} of sensible size")
        return values

    if "matrix" in node:
        return numbers("matrix", np.eye(4).ravel().tolist()).reshape(4, 4).T
    x, y, z, w = numbers("rotation", [0.0, 0.0, 0.0, 1.0])
    length = x * x + y * y + z * z + w * w
    s = 2.0 / length if length > 0.0 else 0.0
    matrix = np.eye(4)
    turn = np.array(
        [
            [1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)],
        ]
    )
    matrix[:3, :3] = turn * numbers("scale", [1.0, 1.0, 1.0])
    matrix[:3, 3] = numbers("translation", [0.0, 0.0, 0.0])
    return matrix
