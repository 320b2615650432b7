"""A glTF file in which nothing is plain: rows apart, sparse ones, shares for numbers, turned and mirrored nodes."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scanner_sim.foundation.errors import InputError
from scanner_sim.scene.files.file_meshes import FileMesh
from scanner_sim.scene.files.gltf_files import _matrix, files_of_gltf, gltf_mesh
from scanner_sim.scene.files.triangles import MeshError

PLACES = np.float32([[0, 0, 0], [2, 0, 0.5], [2, 1, 0], [0, 1.5, 0.25], [-1, 0.5, 0]])
MOVED = {1: (2.5, 0.25, 0.5), 3: (0.5, 1.75, 0.0)}
SPARSE = np.array([MOVED.get(n, place) for n, place in enumerate(PLACES)])
NORMALS = np.array([[0, 0, 127], [0, 76, 102], [-128, 76, 0], [0, -102, -76], [127, 0, 0]], np.int8)
TEXTURE = np.array([[0, 65535], [13107, 26214], [39321, 52428], [65535, 0], [6553, 1000]], np.uint16)
CORNERS = [0, 1, 2, 0, 2, 3, 4, 0, 3]
TURN = Rotation.from_rotvec([0.3, -0.5, 0.7])
MIRROR = np.array([[-1.0, 0.5, 0.0, 3.0], [0.0, 2.0, 0.0, -1.0], [0.25, 0.0, 1.5, 0.5], [0.0, 0.0, 0.0, 1.0]])


def blocks() -> list[bytes]:
    """Return what the five views hold: rows of 20 and of 4 bytes, corners, and what is sparse, 2 and 4 bytes late."""
    rows = b"".join(
        place.tobytes() + at.tobytes() + b"\xff" * 4 for place, at in zip(PLACES, TEXTURE, strict=True)
    )
    return [
        rows[:-4],
        b"".join(one.tobytes() + b"\x11" for one in NORMALS),
        bytes(CORNERS),
        b"\x04\x00" + np.array(list(MOVED), "<u2").tobytes(),
        b"\xff" * 4 + np.float32(list(MOVED.values())).tobytes(),
    ]


def description(**changes: Any) -> tuple[dict[str, Any], bytes]:
    """Return a file's description, and its buffer, in which the views stand five bytes apart."""
    views: list[dict[str, Any]] = []
    data = b"?????"
    for block, more in zip(blocks(), ({"byteStride": 20}, {"byteStride": 4}, {}, {}, {}), strict=True):
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(block), **more})
        data += block + b"?????"
    sparse = {
        "count": 2,
        "indices": {"bufferView": 3, "byteOffset": 2, "componentType": 5123},
        "values": {"bufferView": 4, "byteOffset": 4},
    }
    found = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": views,
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 5, "type": "VEC3"},
            {"bufferView": 0, "componentType": 5126, "count": 5, "type": "VEC3", "sparse": sparse},
            {"bufferView": 0, "byteOffset": 12, "componentType": 5123, "count": 5, "type": "VEC2", "normalized": True},
            {"bufferView": 1, "componentType": 5120, "count": 5, "type": "VEC3", "normalized": True},
            {"bufferView": 2, "componentType": 5121, "count": 9, "type": "SCALAR"},
            {"bufferView": 2, "byteOffset": 3, "componentType": 5121, "count": 6, "type": "SCALAR"},
        ],
        "materials": [{"name": "paint"}, {"name": "foil"}],
        "meshes": [
            {
                "name": "panel",
                "primitives": [
                    {"attributes": {"POSITION": 0, "NORMAL": 3, "TEXCOORD_0": 2}, "indices": 4, "material": 1},
                    {"attributes": {"POSITION": 1, "NORMAL": 3}, "indices": 5},
                ],
            },
            {"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 3}, "mode": 6, "material": 0}]},
        ],
        "nodes": [
            {"mesh": 1, "name": "alone"},
            {"name": "root", "translation": [1.0, -2.0, 3.0], "rotation": TURN.as_quat().tolist(), "children": [2],
             "scale": [1.5, 1.0, 0.5]},
            {"name": "wing", "mesh": 0, "matrix": MIRROR.T.ravel().tolist()},
        ],
        "scenes": [{"nodes": []}, {"nodes": [1, 0]}],
        "scene": 1,
    }  # fmt: skip
    return found | changes, data


def as_glb(about: dict[str, Any], data: bytes) -> bytes:
    """Return one binary file; chunks are filled up to fours."""
    text = json.dumps(about).encode()
    text += b" " * (-len(text) % 4)
    chunk = data + b"\0" * (-len(data) % 4)
    head = struct.pack("<4s2I", b"glTF", 2, 28 + len(text) + len(chunk))
    return (
        head
        + struct.pack("<I4s", len(text), b"JSON")
        + text
        + struct.pack("<I4s", len(chunk), b"BIN\0")
        + chunk
    )


def read(about: dict[str, Any], data: bytes, folder: Path = Path()) -> FileMesh:
    """Return the mesh of a text with its buffer within it."""
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    buffers = [about["buffers"][0] | {"uri": uri}, *about["buffers"][1:]]
    return gltf_mesh(json.dumps(about | {"buffers": buffers}).encode(), folder / "a.gltf")


def wanted() -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Return the faces' corners, normals and texture of the three parts by hand, and the parts' matrices."""
    root = np.eye(4)
    root[:3, :3] = TURN.as_matrix() * [1.5, 1.0, 0.5]
    root[:3, 3] = 1.0, -2.0, 3.0
    shares = np.maximum(NORMALS / 127.0, -1.0)
    turned = root @ MIRROR
    faces = np.array(CORNERS).reshape(3, 3)
    fan = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4]])
    found = []
    for places, texture, own, matrix in (
        (PLACES, TEXTURE / 65535.0, faces, turned),
        (SPARSE, 0.0 * TEXTURE, faces[1:], turned),
        (PLACES, 0.0 * TEXTURE, fan, np.eye(4)),
    ):
        at = places @ matrix[:3, :3].T + matrix[:3, 3]
        normals = shares @ np.linalg.inv(matrix[:3, :3])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        index = own[:, [0, 2, 1]] if np.linalg.det(matrix[:3, :3]) < 0.0 else own
        found.append((at[index], normals[index], texture[index], matrix))
    return found


@pytest.mark.parametrize("kept", ["data", "file", "glb"])
def test_every_number_stands_where_the_file_puts_it(kept: str, tmp_path: Path) -> None:
    """Claim: strides, offsets, sparse rows, shares of bytes, nested nodes and mirrors give what plain sums give."""
    about, data = description()
    if kept == "data":
        mesh = read(about, data)
    elif kept == "glb":
        mesh = gltf_mesh(as_glb(about, data), tmp_path / "a.glb")
    else:
        (tmp_path / "b c.bin").write_bytes(data)
        text = json.dumps(about | {"buffers": [{"byteLength": len(data), "uri": "b%20c.bin"}]}).encode()
        mesh = gltf_mesh(text, tmp_path / "a.gltf")
        assert files_of_gltf(text, tmp_path / "a.gltf") == {(tmp_path / "b c.bin").resolve()}
    names = [("foil", "panel", "wing"), ("", "panel", "wing"), ("paint", "", "alone")]
    assert [part.names for part in mesh.parts] == names
    assert mesh.unit == 1.0
    assert mesh.notes == ()
    assert not mesh.split
    triangles = mesh.triangles
    assert triangles.normals is not None
    assert triangles.texture is not None
    for number, (corners, normals, texture, _) in enumerate(wanted()):
        own = triangles.faces[mesh.part_of == number]
        np.testing.assert_allclose(triangles.vertices[own], corners, atol=2e-6)
        np.testing.assert_allclose(triangles.normals[own], normals, atol=2e-6)
        np.testing.assert_allclose(triangles.texture[own], texture, atol=2e-7)


def test_without_normals_faces_are_flat_and_without_indices_corners_follow_each_other() -> None:
    about, data = description()
    about["meshes"][1]["primitives"] = [{"attributes": {"POSITION": 1, "TEXCOORD_0": 2}}]
    about["scenes"] = [{"nodes": [0]}]
    del about["scene"]
    mesh = read(about, data)
    assert mesh.split
    np.testing.assert_allclose(mesh.triangles.vertices[mesh.triangles.faces], SPARSE[None, :3], atol=1e-7)
    a, b, c = SPARSE[:3]
    normal = np.cross(b - a, c - a)
    assert mesh.triangles.normals is not None
    assert mesh.triangles.texture is not None
    np.testing.assert_allclose(
        mesh.triangles.normals, np.tile(normal / np.linalg.norm(normal), (3, 1)), atol=1e-6
    )
    np.testing.assert_allclose(mesh.triangles.texture, TEXTURE[:3] / 65535.0, atol=1e-7)


@pytest.mark.parametrize(
    ("changes", "places"),
    [
        ({"scenes": []}, ["alone", "wing"]),
        ({"scenes": [], "nodes": []}, ["", ""]),
        ({"scene": 1, "scenes": [{}, {"nodes": [2]}]}, ["wing"]),
        ({"scenes": [{"nodes": [2, 0]}], "scene": 0}, ["wing", "alone"]),
    ],
)
def test_a_scene_is_the_one_that_is_named_or_all_there_is(changes: dict[str, Any], places: list[str]) -> None:
    about, data = description(**changes)
    found = [part.names[2] for part in read(about, data).parts]
    assert list(dict.fromkeys(found)) == list(dict.fromkeys(places))


def test_what_does_not_count_is_said() -> None:
    about, data = description(
        animations=[{}], skins=[{}], extensionsUsed=["KHR_texture_transform"],
        extensionsRequired=["KHR_materials_ior", "EXT_texture_webp", "KHR_mesh_quantization", "KHR_materials_unlit"],
    )  # fmt: skip
    first = about["meshes"][0]["primitives"][0]
    about["meshes"][0]["primitives"] += [
        {"attributes": {"POSITION": 0}, "mode": 1}, {"attributes": {"POSITION": 0}, "mode": 0},
        {"attributes": {"NORMAL": 3}}, first | {"targets": [{}]}, {"attributes": {"POSITION": 0}, "indices": 6},
    ]  # fmt: skip
    about["accessors"].append(about["accessors"][4] | {"count": 2})
    mesh = read(about, data)
    assert len(mesh.parts) == 4
    assert set(mesh.notes) == {
        "2 × points or lines left out", "1 × primitive without positions left out", "1 × morph targets left out",
        "1 × primitive without a face left out", "animations are not played",
        "skins are not applied: the mesh stands as it was drawn", "KHR_texture_transform is not applied",
    }  # fmt: skip
    about["extensionsRequired"].append("KHR_draco_mesh_compression")
    with pytest.raises(MeshError, match="needs KHR_draco_mesh_compression, which"):
        read(about, data)


LIMITS: list[tuple[str, tuple[Any, ...], Any, Any]] = [
    ("the last byte of a view is that of its buffer", ("bufferViews", 4, "byteLength"), 29, 30),
    ("the last number of an accessor is that of its view", ("accessors", 0, "count"), 5, 6),
    ("it may begin later", ("accessors", 2, "byteOffset"), 12, 13),
    ("an index is that of a vertex", ("accessors", 4, "byteOffset"), 0, 1),
    ("a sparse row is one of its accessor", ("accessors", 1, "count"), 5, 3),
    ("rows may lie as near as they are wide", ("bufferViews", 1, "byteStride"), 3, 2),
    ("as many normals as vertices", ("accessors", 3, "count"), 5, 4),
    ("a number of columns", ("accessors", 3, "type"), "VEC3", "VEC4"),
    ("a kind of number", ("accessors", 4, "componentType"), 5121, 5124),
    (
        "sparse rows are counted by whole numbers",
        ("accessors", 1, "sparse", "indices", "componentType"),
        5123,
        5122,
    ),
    ("a mesh", ("nodes", 0, "mesh"), 1, 2),
    ("a node", ("scenes", 1, "nodes"), [1, 0], [1, 3]),
    ("a scene", ("scene",), 1, 2),
    ("a material", ("meshes", 1, "primitives", 0, "material"), 1, 2),
    ("each node once", ("nodes", 1, "children"), [2], [2, 2]),
    ("no node within itself", ("nodes", 2, "children"), [], [1]),
    ("a version", ("asset", "version"), "2.1", "1.0"),
    ("a whole number", ("bufferViews", 0, "byteOffset"), 5, True),
    ("a list", ("nodes", 1, "children"), [], 2),
    ("lists of objects", ("materials",), [{}, {}], [{}, 1]),
    ("a scale", ("nodes", 1, "scale"), [1, 1, 1e12], [1, 1, 1.1e12]),
]


@pytest.mark.parametrize(
    ("place", "taken", "refused"), [row[1:] for row in LIMITS], ids=[row[0] for row in LIMITS]
)
def test_a_number_that_leads_nowhere_is_refused(place: tuple[Any, ...], taken: Any, refused: Any) -> None:
    """Claim: the last that is possible is taken, and the next one is not."""
    for value, possible in ((taken, True), (refused, False)):
        about, data = description()
        if place[:2] == ("bufferViews", 4):
            data = data[: about["bufferViews"][4]["byteOffset"] + 29]
            about["bufferViews"][4]["byteLength"] = 24
        holder: Any = about
        for key in place[:-1]:
            holder = holder[key]
        holder[place[-1]] = value
        if possible:
            read(about, data)
        else:
            with pytest.raises(MeshError):
                read(about, data)


def test_a_binary_file_that_breaks_off_or_is_of_another_version_is_refused(tmp_path: Path) -> None:
    """Claim: every length but the right one, and every header but that of version 2, is a fault of the file."""
    whole = as_glb(*description())
    gltf_mesh(whole, tmp_path / "a.glb")
    gltf_mesh(whole + b"more", tmp_path / "a.glb")
    for count in (4, 19, 20, 40, len(whole) // 2, len(whole) - 1):
        with pytest.raises(MeshError):
            gltf_mesh(whole[:count], tmp_path / "a.glb")
    size = struct.unpack_from("<I", whole, 12)[0]
    for at, value in ((4, 1), (4, 3), (8, len(whole) + 1), (12, size + 4), (16, 0), (20 + size, len(whole))):
        changed = whole[:at] + struct.pack("<I", value) + whole[at + 4 :]
        with pytest.raises(MeshError):
            gltf_mesh(changed, tmp_path / "a.glb")
    alone = json.dumps(description()[0]).encode()
    head = struct.pack("<4s2I", b"glTF", 2, 20 + len(alone)) + struct.pack("<I4s", len(alone), b"JSON")
    with pytest.raises(MeshError, match="no data"):
        gltf_mesh(head + alone, tmp_path / "a.glb")


def test_a_base_colour_is_three_shares_and_a_picture_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "a b.png").write_bytes(b"beside")
    about, data = description(
        images=[{"uri": "a%20b.png"}, {"bufferView": 3}, {"uri": "https://example.org/a.png"}],
        textures=[{"source": 0}, {"source": 1}, {"source": 2}, {}],
    )

    def colours(factor: Any, texture: Any) -> list[Any]:
        look = {} if texture is None else {"baseColorTexture": texture}
        about["materials"][1]["pbrMetallicRoughness"] = {"baseColorFactor": factor, **look}
        opened = read(about, data, tmp_path).colours
        assert opened is not None
        return [None if one is None else (one.factor, one.image) for one in opened()]

    white = ((1.0, 1.0, 1.0), None)
    assert colours([0.1, 0.2, 1.0, 0.5], None) == [((0.1, 0.2, 1.0), None), None, white]
    assert colours([0.0, 0.2, 0.3], {"index": 0})[0] == ((0.0, 0.2, 0.3), b"beside")
    assert colours([0.0, 0.2, 0.3], {"index": 1, "texCoord": 0})[0] == ((0.0, 0.2, 0.3), blocks()[3])
    for factor, texture in (
        ([0.1, 0.2], None), ([0.1, 0.2, 1.01], None), ([-0.01, 0.2, 1.0], None), ("red", None),
        ([0.1, 0.2, 1.0], {"index": 0, "texCoord": 1}), ([0.1, 0.2, 1.0], {"index": 4}),
        ([0.1, 0.2, 1.0], {"index": 3}), ([0.1, 0.2, 1.0], {"index": 2}),
    ):  # fmt: skip
        with pytest.raises((MeshError, InputError)):
            colours(factor, texture)


@pytest.mark.parametrize(("limit", "most"), [("MOST_PARTS", 23), ("MOST_FACES", 68), ("LONGEST_JSON", None)])
def test_a_file_holds_as_much_as_may_be(
    monkeypatch: pytest.MonkeyPatch, limit: str, most: int | None
) -> None:
    """Claim: 23 parts of 68 faces, and a description of its length, are read where so many may be, and not where one
    fewer may: so many that a limit off by a tenth is another one."""
    about, data = description()
    about["nodes"] += [{"mesh": 1}] * 20
    about["scenes"][1]["nodes"] += range(3, 23)
    binary = as_glb(about, data)
    if most is None:
        most = struct.unpack_from("<I", binary, 12)[0]
    assert most is not None
    monkeypatch.setattr(f"scanner_sim.scene.files.gltf_files.{limit}", most)
    assert len(gltf_mesh(binary, Path("a.glb")).parts) == 23
    monkeypatch.setattr(f"scanner_sim.scene.files.gltf_files.{limit}", most - 1)
    with pytest.raises(MeshError, match="more than"):
        gltf_mesh(binary, Path("a.glb"))


def test_a_node_is_turned_by_a_quaternion_of_any_length() -> None:
    """Claim: the turn is that of the quaternion's direction; scale comes first, then the turn, then the way."""
    quaternion = np.array([0.2, -0.5, 0.7, 0.4])
    node = {
        "rotation": (3.0 * quaternion).tolist(),
        "scale": [2.0, 0.5, -1.5],
        "translation": [4.0, 5.0, 6.0],
    }
    found = _matrix(node)
    turn = Rotation.from_quat(quaternion).as_matrix()
    np.testing.assert_allclose(found[:3, :3], turn @ np.diag([2.0, 0.5, -1.5]), atol=1e-12)
    np.testing.assert_array_equal(found[:, 3], [4.0, 5.0, 6.0, 1.0])
    np.testing.assert_array_equal(_matrix({"rotation": [0.0, 0.0, 0.0, 0.0]}), np.eye(4))


def test_a_sparse_accessor_without_rows_of_its_own_is_zero_elsewhere() -> None:
    """Claim: its rows are zero but for those that it puts; what has neither has no data."""
    about, data = description()
    del about["accessors"][1]["bufferView"]
    mesh = read(about, data)
    places = np.zeros_like(PLACES)
    for row, place in MOVED.items():
        places[row] = place
    matrix = wanted()[1][3]
    # Two faces of the second part, 0 2 3 and 4 0 3, of which the mirror turns each.
    own = np.array([[0, 3, 2], [4, 3, 0]])
    at = (places @ matrix[:3, :3].T + matrix[:3, 3])[own]
    triangles = mesh.triangles
    np.testing.assert_allclose(triangles.vertices[triangles.faces[mesh.part_of == 1]], at, atol=2e-6)
    del about["accessors"][1]["sparse"]
    with pytest.raises(MeshError, match="no data"):
        read(about, data)
