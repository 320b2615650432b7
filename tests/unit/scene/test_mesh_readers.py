"""Mesh files as this package reads them: held to trimesh, to numbers written by hand, and to what may not happen."""

from __future__ import annotations

import base64
import io
import json
import math
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from scanner_sim.foundation.errors import InputError
from scanner_sim.scene.files import gltf_files, gltf_geometry
from scanner_sim.scene.files.file_meshes import FileMesh
from scanner_sim.scene.files.gltf_geometry import triangles_of
from scanner_sim.scene.files.mesh_cleaning import cleaned
from scanner_sim.scene.files.mesh_files import files_of_mesh, read_mesh_file
from scanner_sim.scene.files.triangles import Triangles


def corners(mesh: FileMesh) -> np.ndarray:
    return mesh.triangles.vertices.astype(float)[mesh.triangles.faces]


def written(folder: Path, name: str, content: bytes | str) -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode("latin-1"))
    return path


def scene_of_two() -> trimesh.Scene:
    """A box and a sphere, turned, scaled and mirrored, the sphere's node within the box's."""
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.7, (1.0, 2.0, 3.0))
    turn[:3, 3] = 1.0, -2.0, 3.0
    scene.add_geometry(
        trimesh.creation.box((1.0, 2.0, 3.0)), node_name="hull", geom_name="bus", transform=turn
    )
    mirrored = np.diag([-2.0, 1.0, 0.5, 1.0])
    ball = trimesh.creation.icosphere(subdivisions=1)
    scene.add_geometry(ball, node_name="tip", geom_name="dome", transform=mirrored, parent_node_name="hull")
    return scene


@pytest.mark.parametrize("kind", ["glb", "gltf"])
def test_gltf_is_what_trimesh_makes_of_it(kind: str, tmp_path: Path) -> None:
    """Claim: every triangle stands where a reader written elsewhere puts it, and looks the same way."""
    scene = scene_of_two()
    if kind == "glb":
        path = written(tmp_path, "a.glb", scene.export(file_type="glb", include_normals=True))
    else:
        for name, content in scene.export(file_type="gltf").items():
            written(tmp_path, name, content)
        path = tmp_path / "model.gltf"
    mesh = read_mesh_file(path)
    peer = trimesh.load_scene(path)
    for number, part in enumerate(mesh.parts):
        assert part.names[1:] in (("bus", "hull"), ("dome", "tip"))
        matrix, geometry = peer.graph[part.names[2]]
        other = peer.geometry[geometry].copy()
        other.apply_transform(matrix)
        own = trimesh.Trimesh(mesh.triangles.vertices, mesh.triangles.faces[mesh.part_of == number])
        assert own.area == pytest.approx(other.area, rel=1e-6)
        assert own.volume == pytest.approx(abs(other.volume), rel=1e-5)
        np.testing.assert_allclose(own.triangles_center.mean(0), other.triangles_center.mean(0), atol=1e-5)
    facing = np.cross(*(corners(mesh)[:, k] - corners(mesh)[:, 0] for k in (1, 2)))
    assert mesh.triangles.normals is not None
    normals = mesh.triangles.normals[mesh.triangles.faces].mean(axis=1)
    assert ((facing * normals).sum(axis=1) > 0.0).all()


def gltf(**changes: Any) -> dict[str, Any]:
    """A quad of two triangles, its numbers within the file."""
    data = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4").tobytes()
    data += np.array([0, 1, 2, 0, 2, 3], "<u2").tobytes()
    description = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 60, "uri": "data:;base64," + base64.b64encode(data).decode()}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 12},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    return description | changes


@pytest.mark.parametrize(
    ("mode", "index", "triangles"),
    [
        (5, [0, 1, 2, 3], [(0, 1, 2), (1, 3, 2)]),
        (5, [3, 2, 0, 1], [(3, 2, 0), (2, 1, 0)]),
        (6, [0, 1, 2, 3], [(0, 1, 2), (0, 2, 3)]),
        (6, [1, 2, 3, 0], [(1, 2, 3), (1, 3, 0)]),
        (6, [3, 0, 1, 2], [(3, 0, 1), (3, 1, 2)]),
        (4, [0, 1, 2, 3], [(0, 1, 2)]),
        (4, [2, 3, 1, 0], [(2, 3, 1)]),
    ],
)
def test_strips_and_fans(
    mode: int, index: list[int], triangles: list[tuple[int, ...]], tmp_path: Path
) -> None:
    """Claim: as in the specification, section 3.7.2.1, of a strip every other triangle is turned, and a fan turns
    about its own first corner, whichever vertex of the file that is."""
    description = gltf()
    blob = base64.b64decode(description["buffers"][0]["uri"].split(",")[1])[:48]
    blob += np.array(index, "<u2").tobytes()
    description["buffers"][0] = {"byteLength": 56, "uri": "data:;base64," + base64.b64encode(blob).decode()}
    description["bufferViews"][1]["byteLength"] = 8
    description["accessors"][1]["count"] = 4
    description["meshes"][0]["primitives"][0]["mode"] = mode
    mesh = read_mesh_file(written(tmp_path, "a.gltf", json.dumps(description)))
    place = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    own = {tuple(sorted(map(tuple, one))) for one in corners(mesh).tolist()}
    kind = {4: "triangles", 5: "strip", 6: "fan"}[mode]
    assert sorted(map(tuple, triangles_of(np.array(index), kind).tolist())) == sorted(triangles)
    assert own == {tuple(sorted(map(tuple, place[list(one)].tolist()))) for one in triangles}


def accessor(**changes: Any) -> dict[str, Any]:
    first, second = gltf()["accessors"]
    return {"accessors": [first | changes, second]}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (accessor(count=10**9), "reaches beyond its buffer"),
        (accessor(count=-1), "no number of bytes or entries"),
        (accessor(count=3), "names the vertex 3"),
        (accessor(byteOffset=2), "reaches beyond"),
        (accessor(bufferView=7), "not there"),
        ({"accessors": [{"componentType": 5126, "count": 10**12, "type": "VEC3"}]}, "no number of bytes"),
        ({"nodes": [{"mesh": 0, "children": [0]}]}, "stands at two places"),
        ({"nodes": [{"mesh": 0, "matrix": [1e300] * 16}]}, "sensible size"),
        ({"nodes": [{"mesh": 0, "matrix": [-1e300] * 16}]}, "sensible size"),
        ({"buffers": [{"byteLength": 60, "uri": "../secret.bin"}]}, "out of its folder"),
        ({"buffers": [{"byteLength": 60, "uri": "%2e%2e/secret.bin"}]}, "out of its folder"),
        ({"buffers": [{"byteLength": 60, "uri": "/etc/passwd"}]}, "absolute path"),
        ({"buffers": [{"byteLength": 60, "uri": "http://example.org/a.bin"}]}, "nothing is fetched"),
        ({"buffers": [{"byteLength": 60, "uri": "link.bin"}]}, "out of its folder"),
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "without compression"),
        ({"asset": {"version": "1.0"}}, "glTF 2.0"),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 0}]}]}, "points or lines"),
    ],
)
def test_a_gltf_that_cannot_be_is_refused(changes: dict[str, Any], words: str, tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "secret.bin").write_bytes(b"\0" * 60)
    (inside / "link.bin").symlink_to(tmp_path / "secret.bin")
    with pytest.raises(InputError) as caught:
        read_mesh_file(written(inside, "a.gltf", json.dumps(gltf(**changes))))
    assert words in str(caught.value)


VTK = """\
ply
format {form} 1.0
comment VTK generated PLY File
obj_info vtkPolyData points and polygons: vtk4.0
element vertex 4
property float x
property float y
property float z
property uchar red
element face {faces}
property list uchar int vertex_indices
property list uchar float texcoord
{strips}end_header
"""


def test_ply_as_vtk_and_meshlab_write_it(tmp_path: Path) -> None:
    """Two lists of odd length in each row, a remark of VTK's, and big-endian strips of triangles."""
    header = VTK.format(form="ascii", faces=2, strips="")
    text = header + "0 0 0 9\n1 0 0 9\n1 1 0 9\n0 1 0 9\n3 0 1 2 2 0.5 0.5\n4 0 1 2 3 0\n"
    assert len(read_mesh_file(written(tmp_path, "a.ply", text)).triangles.faces) == 3
    strips = "element tristrips 1\nproperty list int int vertex_indices\n"
    header = VTK.format(form="binary_big_endian", faces=0, strips=strips)
    data = b"".join(struct.pack(">3fB", *place, 9) for place in [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    data += struct.pack(">i8i", 8, 0, 1, 2, 3, -1, 0, 1, 3)
    mesh = read_mesh_file(written(tmp_path, "b.ply", header.encode() + data + b"\n"))
    # The third runs along 0–1 as the first does, so it is turned.
    assert mesh.triangles.faces.tolist() == [[0, 1, 2], [1, 3, 2], [0, 3, 1]]
    # The first of all vertices ends no strip.
    header = VTK.format(form="ascii", faces=0, strips=strips)
    text = header + "0 0 0 9\n1 0 0 9\n1 1 0 9\n0 1 0 9\n4 2 0 1 3\n"
    mesh = read_mesh_file(written(tmp_path, "c.ply", text))
    assert mesh.triangles.faces.tolist() == [[2, 0, 1], [0, 3, 1]]


OBJ = """\
mtllib parts.mtl
o satellite
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0
vn 0 0 nan\nvn 0 0 1
vt 0 0
g bus
usemtl painted_alu
f 1//1 2//2 3//9
g
usemtl panel
f 1/1 3/1 4/1
f 1 2
l 1 2
curv 0 1 1 2
surf 0 1 0 1 1 2
curv2 1 2
s off
"""


def test_obj_with_odd_normals_has_parts_by_name(tmp_path: Path) -> None:
    mesh = read_mesh_file(written(tmp_path, "a.obj", OBJ))
    assert [part.names for part in mesh.parts] == [
        ("painted_alu", "bus", "satellite"),
        ("panel", "", "satellite"),
    ]
    assert mesh.part_of.tolist() == [0, 1]
    assert mesh.triangles.normals is None
    said = "; ".join(mesh.notes)
    assert "normal" in said
    assert "1 × face of fewer than three corners: left out" in said
    assert "3 × free-form curve or surface: left out" in said


def test_stl_solids_are_parts(tmp_path: Path) -> None:
    facet = (
        "facet normal 0 0 1\nouter loop\nvertex 0 0 {z}\nvertex 1 0 {z}\nvertex 0 1 {z}\nendloop\nendfacet\n"
    )
    text = "".join(
        f"solid {name}\n{facet.format(z=z)}endsolid\n" for z, name in enumerate(("bus", "solar panel"))
    )
    mesh = read_mesh_file(written(tmp_path, "a.stl", text))
    assert [part.shown for part in mesh.parts] == ["bus", "solar panel"]
    assert corners(mesh)[mesh.part_of == 1][:, :, 2].tolist() == [[1.0, 1.0, 1.0]]


def test_the_clean_up_mends_what_it_says() -> None:
    """A closed surface with turned faces and slivers: afterwards its volume is the sphere's, and nothing has moved."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    faces = ball.faces.copy()
    faces[5:40] = faces[5:40][:, [0, 2, 1]]
    with_sliver = np.concatenate([faces, [[3, 3, 7], [2, 2, 2]]]).astype(np.uint32)
    twice = ball.vertices[with_sliver].reshape(-1, 3).astype(np.float32)
    soup = Triangles(twice, np.arange(len(twice), dtype=np.uint32).reshape(-1, 3))
    mended = cleaned(FileMesh.whole(soup, flat=True))
    own = trimesh.Trimesh(mended.triangles.vertices, mended.triangles.faces, process=False)
    assert own.is_watertight
    assert own.volume == pytest.approx(ball.volume, rel=1e-5)
    assert len(mended.triangles.vertices) == len(ball.vertices)
    assert [note.split()[0] for note in mended.notes] == ["2", str(3 * 322 - 162), "35"]


def test_a_surface_of_one_side_and_sharp_edges_stay() -> None:
    """Möbius's strip has no winding; vertices that stand twice in a file without normals keep its edges sharp."""
    turn = np.linspace(0.0, 2.0 * np.pi, 31)[:-1]
    rims = [
        np.stack([(2 + s * np.cos(turn / 2)) * np.cos(turn), (2 + s * np.cos(turn / 2)) * np.sin(turn),
                  s * np.sin(turn / 2)], axis=1)
        for s in (-0.5, 0.5)
    ]  # fmt: skip
    n = len(turn)
    quads = [(k, k + 1, n + k + 1, n + k) for k in range(n - 1)] + [(n - 1, n, 0, 2 * n - 1)]
    faces = np.array([[a, b, c] for a, b, c, _ in quads] + [[a, c, d] for a, _, c, d in quads], np.uint32)
    strip = FileMesh.whole(Triangles(np.concatenate(rims).astype(np.float32), faces))
    assert cleaned(strip) == strip
    box = trimesh.creation.box()
    split = box.vertices[box.faces].reshape(-1, 3).astype(np.float32)
    sharp = FileMesh.whole(Triangles(split, np.arange(36, dtype=np.uint32).reshape(-1, 3)))
    assert len(cleaned(sharp).triangles.vertices) == 36


def test_a_tie_turns_one_of_two_faces() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
    mesh = cleaned(FileMesh.whole(Triangles(square, np.array([[0, 1, 2], [0, 3, 2]], np.uint32))))
    assert mesh.triangles.faces.tolist() in ([[0, 1, 2], [0, 2, 3]], [[0, 2, 1], [0, 3, 2]])


def test_an_edge_of_three_faces_joins_none_of_them() -> None:
    """Claim: leaves on one spine have no common side, whichever way each is wound; a pair along another edge has."""
    spine_and_tips = np.array(
        [[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, -1, 0], [2, 0, 1]], np.float32
    )
    leaves = np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4]], np.uint32)
    book = FileMesh.whole(Triangles(spine_and_tips, leaves))
    assert cleaned(book).triangles.faces.tolist() == leaves.tolist()
    # The first leaf is longer by a face that is wound otherwise, which alone is turned, or the leaf in its place.
    longer = FileMesh.whole(
        Triangles(spine_and_tips, np.concatenate([leaves, [[1, 2, 5]]]).astype(np.uint32))
    )
    found = cleaned(longer).triangles.faces
    assert found[1:3].tolist() == leaves[1:].tolist()
    assert [found[0].tolist(), found[3].tolist()] in (
        [[0, 1, 2], [1, 5, 2]],
        [[0, 2, 1], [1, 2, 5]],
    )


def three_mf(xml: str) -> bytes:
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as held:
        held.writestr("3D/3dmodel.model", xml)
    return archive.getvalue()


@pytest.mark.slow
def test_trimesh_reads_off_in_a_process_of_its_own(tmp_path: Path) -> None:
    text = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"
    mesh = read_mesh_file(written(tmp_path, "a.off", text))
    assert sorted(corners(mesh).sum(axis=(0, 1)).tolist()) == [0.0, 3.0, 3.0]
    with pytest.raises(InputError, match="trimesh, stopped with"):
        read_mesh_file(written(tmp_path, "b.off", "OFF\n4000000000 1 0\n0 0 0\n"))


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        (
            "a.3mf",
            three_mf("<!DOCTYPE a [<!ENTITY b SYSTEM 'file:///etc/passwd'>]><model>&b;</model>"),
            "document type",
        ),
        ("a.3mf", b"PK\x03\x04 no archive", "no archive"),
        ("a.dae", b"<!ENTITY a 'b'><COLLADA/>", "document type"),
        ("a.dae", "<COLLADA/>".encode("utf-16"), "UTF-8"),
    ],
)
def test_archives_and_xml_are_looked_at_before(name: str, content: bytes, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        read_mesh_file(written(tmp_path, name, content))


def test_an_archive_that_unpacks_to_gigabytes_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("scanner_sim.scene.files.foreign_files.LARGEST_MESH", 1 << 20)
    with pytest.raises(InputError, match="unpacks to more than"):
        read_mesh_file(written(tmp_path, "a.3mf", three_mf(" " * (1 << 21))))


@pytest.mark.parametrize(
    ("obj", "gltf_", "glb"), [("obj", "gltf", "glb"), ("OBJ", "GLTF", "GLB"), ("Obj", "glTF", "Glb")]
)
def test_the_files_of_a_mesh_are_known(obj: str, gltf_: str, glb: str, tmp_path: Path) -> None:
    """Claim: what a campaign notes of its inputs, buffers, libraries of materials and their textures, are known
    however the ending of the mesh's own name is written; images that it does without hide none of them."""
    written(tmp_path, "t.png", b"\x89PNG")
    written(tmp_path, "parts.mtl", "newmtl panel\nmap_Kd -clamp on t.png\n")
    path = written(tmp_path, f"a.{obj}", OBJ)
    assert len(read_mesh_file(path).triangles.faces) == 2
    assert files_of_mesh(path) == {tmp_path / "parts.mtl", tmp_path / "t.png"}
    about = gltf()
    data = base64.b64decode(about["buffers"][0]["uri"].split(",")[1])
    written(tmp_path, "a.bin", data)
    images = [{"uri": "../t.png"}, {"uri": "http://example.org/t.png"}, {"uri": "gone.png"}, {"uri": "t.png"}]
    named = {"buffers": [{"byteLength": len(data), "uri": "a.bin"}], "images": images}
    text = json.dumps(about | named).encode()
    text += b" " * (-len(text) % 4)
    binary = struct.pack("<4s4I", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text
    for name, content in ((f"a.{gltf_}", text), (f"a.{glb}", binary)):
        path = written(tmp_path, name, content)
        assert len(read_mesh_file(path).triangles.faces) == 2
        assert files_of_mesh(path) == {tmp_path / "a.bin", tmp_path / "t.png"}


def test_a_gltf_node_scales_then_turns_then_moves() -> None:
    """Claim: (1, 1, 1) scaled by 2, 3, 4, turned by 90° about z and moved by 1 along x comes to (−2, 2, 4)."""
    half = math.sqrt(0.5)
    node = {"scale": [2.0, 3.0, 4.0], "rotation": [0.0, 0.0, half, half], "translation": [1.0, 0.0, 0.0]}
    np.testing.assert_allclose(gltf_files._matrix(node) @ np.ones(4), [-2.0, 2.0, 4.0, 1.0], atol=1e-12)


@pytest.mark.parametrize("length", [1.0, 0.3])
def test_a_gltf_node_turns_by_its_quaternion(length: float) -> None:
    """Claim: x, y, z, w as SciPy reads them, of any length, about any axis; a matrix is given column by column."""
    for own in np.random.default_rng(3).normal(size=(5, 4)):
        node = {"rotation": (length * own).tolist(), "scale": [1.0, 2.0, 3.0]}
        wanted = Rotation.from_quat(own).as_matrix() * [1.0, 2.0, 3.0]
        np.testing.assert_allclose(gltf_files._matrix(node)[:3, :3], wanted, atol=1e-12)
    columns = np.arange(16.0)
    np.testing.assert_array_equal(gltf_files._matrix({"matrix": columns.tolist()}), columns.reshape(4, 4).T)
    np.testing.assert_array_equal(gltf_files._matrix({}), np.eye(4))


def test_normals_of_a_mesh_have_length_one() -> None:
    """Claim: whatever length a file gives them, and along z where it gives none; they turn as surfaces do."""
    given = np.array([[3.0, 0.0, 4.0], [1e-3, 0.0, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(
        gltf_geometry._unit(given), [[0.6, 0.0, 0.8], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    )
    matrix = np.random.default_rng(5).normal(size=(3, 3))
    wanted = np.linalg.inv(matrix).T * np.linalg.det(matrix)
    np.testing.assert_allclose(gltf_geometry._cofactors(matrix), wanted, rtol=1e-9)


@pytest.mark.parametrize("scale", [(2.0, 1.0, 0.5), (-2.0, 1.0, 0.5), (-2.0, -1.0, 0.5)])
def test_a_ball_that_is_stretched_has_the_normals_of_an_ellipsoid(scale: tuple[float, float, float]) -> None:
    """Claim: outwards, along the gradient of Σ(xᵢ/aᵢ)² at each place, mirrored or not; the ball's faces look outwards
    as well."""
    ball = trimesh.creation.icosphere(subdivisions=1)
    turn = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn * np.array(scale), (1.0, -2.0, 3.0)
    piece = gltf_geometry.Geometry(ball.vertices, ball.faces, ball.vertices, None).moved(matrix)
    own = (piece.vertices - matrix[:3, 3]) @ turn
    gradient = own / np.square(scale) @ turn.T
    wanted = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    np.testing.assert_allclose(piece.normals, wanted, atol=1e-9)
    assert trimesh.Trimesh(piece.vertices, piece.faces, process=False).volume > 0.0


@pytest.mark.parametrize(("most", "examined"), [(12, True), (11, False)])
def test_so_large_a_mesh_is_looked_at(most: int, examined: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of a box whose twelve faces have corners of their own they are put together where as many are examined."""
    box = trimesh.creation.box()
    apart = box.vertices[box.faces].reshape(-1, 3).astype(np.float32)
    normals = np.repeat([[0.0, 0.0, 1.0]], 36, axis=0).astype(np.float32)
    soup = Triangles(apart, np.arange(36, dtype=np.uint32).reshape(-1, 3), normals)
    monkeypatch.setattr("scanner_sim.scene.files.mesh_cleaning.MOST_EXAMINED", most)
    found = cleaned(FileMesh.whole(soup, flat=True))
    assert len(found.triangles.vertices) == (8 if examined else 36)
