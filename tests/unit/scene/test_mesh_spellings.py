"""A mesh in every spelling of a file: polygons of unlike size, what stands beside them, and where files break off."""

from __future__ import annotations

import json
import struct
from itertools import pairwise, permutations
from pathlib import Path

import numpy as np
import pytest
import trimesh

from scanner_sim.foundation.errors import InputError
from scanner_sim.scene.files.foreign_reader import _arrays, _unit
from scanner_sim.scene.files.mesh_files import files_of_mesh, read_mesh_file
from scanner_sim.scene.files.obj_files import obj_mesh
from scanner_sim.scene.files.obj_materials import colours_of_libraries, files_of_libraries
from scanner_sim.scene.files.ply_files import ply_triangles
from scanner_sim.scene.files.triangles import MeshError

PLACES = [(0.0, 0.0, 0.5), (1.0, 0.25, 0.0), (1.5, 1.0, 0.0), (0.5, 2.0, 0.25), (-1.0, 1.0, 0.0)]
POLYGONS = [(0, 1, 2), (4, 3, 2, 1, 0), (2, 3, 4), (0, 2, 3, 4)]
TRIANGLES = {(0, 1, 2), (4, 3, 2), (4, 2, 1), (4, 1, 0), (2, 3, 4), (0, 2, 3), (0, 3, 4)}
FLAGS = [(7,), (), (8, 9), (1,)]
EDGES = [(0, 1), (3, 4), (2, 0)]
HEADER = """\
ply
format {} 1.0
element vertex 5
property double x
property double y
property double z
element face 4
property short before
property list uchar short flags
property list uint ushort vertex_indices
property double quality
element edge 3
property int vertex1
property int vertex2
end_header
"""


def numbers(order: str) -> list[tuple[str, float]]:
    """Return all numbers of the file with their formats."""
    found = [("d", value) for place in PLACES for value in place]
    for number, (polygon, flags) in enumerate(zip(POLYGONS, FLAGS, strict=True)):
        found += [("h", -number), ("B", len(flags)), *(("h", flag) for flag in flags), ("I", len(polygon))]
        found += [*(("H", corner) for corner in polygon), ("d", 0.5 * number)]
    return [(order + kind, value) for kind, value in found + [("i", end) for edge in EDGES for end in edge]]


def ply(form: str, left_out: int = 0, more: tuple[tuple[str, float], ...] = ()) -> bytes:
    """Return the file in a form, its last numbers left out or others added."""
    rows = numbers({"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[form])
    rows = [*rows[: len(rows) - left_out], *more]
    head = HEADER.format(form).encode()
    if form == "ascii":
        return head + " ".join(f"{value:g}" for _, value in rows).encode() + b"\n"
    return head + b"".join(
        struct.pack(kind, int(value) if kind[-1] != "d" else value) for kind, value in rows
    )


FORMS = ["ascii", "binary_little_endian", "binary_big_endian"]


@pytest.mark.parametrize("name", [b"vertex_indices", b"vertex_index"])
@pytest.mark.parametrize("form", FORMS)
def test_polygons_of_unlike_size_are_fans_wherever_they_stand(form: str, name: bytes) -> None:
    """Between other columns and lists, by either name of the corners, and with another element behind: each polygon is
    a fan of its first corner."""
    mesh = ply_triangles(ply(form).replace(b"vertex_indices", name))
    assert mesh.vertices.tolist() == [list(place) for place in PLACES]
    assert set(map(tuple, mesh.faces.tolist())) == TRIANGLES
    assert len(mesh.faces) == len(TRIANGLES)


@pytest.mark.parametrize("form", FORMS)
def test_a_file_that_breaks_off_anywhere_is_refused(form: str) -> None:
    """Claim: a file is taken with all of its numbers only, not with one less or more, nor with any fewer."""
    ply_triangles(ply(form))
    for left_out in range(1, len(numbers("<"))):
        with pytest.raises(MeshError):
            ply_triangles(ply(form, left_out))
    with pytest.raises(MeshError, match="more data"):
        ply_triangles(ply(form, more=(("<B", 0),)))


COLUMNS = {
    "property list uchar short flags": [("B", 4.0), ("h", 9.0), ("h", 8.0), ("h", 7.0), ("h", 6.0)],
    "property double quality": [("d", 0.5)],
    "property list uint ushort vertex_indices": [("I", 3.0)],
    "property short before": [("h", -1.0)],
}
"""Columns of a face in the order of their lines, with what each row has of them before the corners."""


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("corners", [[(0, 1, 2), (2, 3, 4)], [(0, 1, 2), (4, 3, 2, 0)]])
def test_columns_of_a_face_stand_in_any_order(form: str, corners: list[tuple[int, ...]]) -> None:
    """Claim: numbers before, between and behind two lists, of one length or of unlike ones, make the same triangles."""
    order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[form]
    wanted = {(0, 1, 2), *((face[0], one, two) for face in corners[1:] for one, two in pairwise(face[1:]))}
    for columns in permutations(COLUMNS):
        rows = [("d", value) for place in PLACES for value in place]
        for face in corners:
            for column in columns:
                rows += COLUMNS[column]
                if "vertex_indices" in column:
                    rows[-1:] = [("I", len(face)), *(("H", corner) for corner in face)]
        head = HEADER.format(form).partition("element face")[0]
        head += "\n".join([f"element face {len(corners)}", *columns, "end_header\n"])
        if form == "ascii":
            data = " ".join(f"{value:g}" for _, value in rows).encode()
        else:
            data = b"".join(
                struct.pack(order + kind, value if kind == "d" else int(value)) for kind, value in rows
            )
        found = ply_triangles(head.encode() + data)
        assert set(map(tuple, found.faces.tolist())) == wanted, columns


@pytest.mark.parametrize(("kind", "code"), [("uchar", "B"), ("short", "h"), ("ushort", "H"), ("int", "i")])
def test_a_polygon_has_as_many_corners_as_its_count_holds(kind: str, code: str) -> None:
    """Claim: 200 corners, in a byte without a sign too, are 198 triangles about the first."""
    many = 200
    turn = 2.0 * np.pi * np.arange(many) / many
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {many}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face 1\nproperty list {kind} int vertex_indices\nend_header\n"
    )
    corners = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1).astype("<f4").tobytes()
    face = struct.pack(f"<{code}", many) + np.arange(many, dtype="<i4").tobytes()
    mesh = ply_triangles(head.encode() + corners + face)
    assert mesh.faces.tolist() == [[0, corner, corner + 1] for corner in range(1, many - 1)]


OBJ = """\
v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0.5
vt 0.1 0.2\nvt 0.6 0.3\nvt 0.7 0.9\n{texture}
vn 0 0 1\nvn 0 0.6 0.8\nvn 0 1 0\n{normal}
f 1/1/1 2/2/2 3/3/3
f -4/-4/-4 -2/-2/-2 -1/{corner}
"""


def test_normals_and_texture_go_with_their_corners() -> None:
    mesh = obj_mesh(OBJ.format(texture="vt 0.4", normal="vn 1 0 0", corner="-1/-1").encode(), Path("a.obj"))
    triangles = mesh.triangles
    assert triangles.texture is not None
    assert triangles.normals is not None
    assert mesh.notes == ()
    found = {
        tuple(place): (tuple(at), tuple(normal))
        for place, at, normal in zip(
            triangles.vertices.round(6).tolist(),
            triangles.texture.round(6).tolist(),
            triangles.normals.round(6).tolist(),
            strict=True,
        )
    }
    exact = np.float32([[0.1, 0.2], [0.6, 0.3], [0.7, 0.9], [0.4, 0.0]]).round(6).tolist()
    normals = np.float32([[0, 0, 1], [0, 0.6, 0.8], [0, 1, 0], [1, 0, 0]]).round(6).tolist()
    places = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 1.0, 0.0), (0.0, 1.0, 0.5)]
    assert found == {
        place: (tuple(at), tuple(normal)) for place, at, normal in zip(places, exact, normals, strict=True)
    }


@pytest.mark.parametrize("more", ["", " 2", " 0.9 0.1 0.2", " 0.9 0.1 0.2 1"])
def test_the_first_numbers_of_a_line_are_a_place(more: str) -> None:
    """Claim: a weight, a colour or a depth behind them, as many programs write, moves neither corners nor texture."""
    places, at = (
        [[0.0, 0.0, 0.5], [2.0, 0.25, 0.0], [2.0, 1.0, -1.0]],
        [[0.5, 0.25], [1.0, 0.0], [0.125, 0.75]],
    )
    lines = [f"v {x} {y} {z}{more}" for x, y, z in places] + [f"vt {u} {v}{more[:2]}" for u, v in at]
    mesh = obj_mesh("\n".join([*lines, "vn 0 0 1", "f 1/1/1 2/2/1 3/3/1"]).encode(), Path("a.obj")).triangles
    assert mesh.faces.tolist() == [[0, 1, 2]]
    assert mesh.vertices.tolist() == places
    assert mesh.texture is not None
    assert mesh.texture.tolist() == at


@pytest.mark.parametrize(
    ("changes", "lacks", "words"),
    [
        ({"texture": "vt a b"}, "texture", "1 × texture coordinate that is not finite"),
        ({"texture": "vt"}, "texture", "1 × texture coordinate that is not finite"),
        ({"normal": "vn 0 1"}, "normals", "1 × normal that is not finite"),
        ({"normal": "vn 1e60 0 0"}, "normals", "1 × normal that is not finite"),
        ({"corner": "-1"}, "normals", "1 × corner without normal"),
        ({"corner": "/-1"}, "texture", "1 × corner without texture coordinate"),
        ({"corner": "-1/5"}, "normals", "1 × corner whose normal is not there"),
        ({"corner": "-5/-1"}, "texture", "1 × corner whose texture coordinate is not there"),
    ],
)
def test_what_is_odd_beside_the_corners_is_left_out_and_said(
    changes: dict[str, str], lacks: str, words: str
) -> None:
    """Claim: the triangles stay, of normals and texture what is sound, and a note counts what was left out."""
    given = {"texture": "vt 0.4 0.8", "normal": "vn 1 0 0", "corner": "-1/-1"} | changes
    mesh = obj_mesh(OBJ.format(**given).encode(), Path("a.obj"))
    assert len(mesh.triangles.faces) == 2
    assert getattr(mesh.triangles, lacks) is None
    assert getattr(mesh.triangles, {"texture": "normals", "normals": "texture"}[lacks]) is not None
    assert any(note.startswith(words) for note in mesh.notes), mesh.notes


def test_colours_of_libraries_count_from_the_librarys_folder(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    (inner / "t.png").write_bytes(b"picture")
    text = "Kd 9 9 9\nnewmtl a b\nKd 0.1 0.2 0.3 0.9\nmap_Kd -mm 0 1 -clamp on t.png\nnewmtl c\nKd 1 0 0.5\nnewmtl d\n"
    (inner / "one.mtl").write_text(text)
    (tmp_path / "two.mtl").write_text(
        "newmtl c\nKd 0 0 0\nnewmtl e\nmap_kd -blendu off inner\\t.png\nKd 0 1 0\n"
    )
    found = colours_of_libraries(("inner\\one.mtl", "two.mtl"), tmp_path)
    assert {name: (colour.factor, colour.image) for name, colour in found.items()} == {
        "a b": ((0.1, 0.2, 0.3), b"picture"),
        "c": ((1.0, 0.0, 0.5), None),
        "d": ((1.0, 1.0, 1.0), None),
        "e": ((0.0, 1.0, 0.0), b"picture"),
    }
    assert files_of_libraries(("inner/one.mtl", "gone.mtl"), tmp_path) == {inner / "one.mtl", inner / "t.png"}


@pytest.mark.parametrize(
    ("line", "encoding"),
    [
        ("mtllib parts.mtl", "latin-1"), ("  mtllib\tparts.mtl", "latin-1"), ("mtllib \\\nparts.mtl", "latin-1"),
        ("mtllib parts.mtl", "utf-16"),
    ],
)  # fmt: skip
def test_the_files_of_a_mesh_are_those_that_it_is_coloured_by(
    line: str, encoding: str, tmp_path: Path
) -> None:
    """Claim: wherever a library's colours are found, with spaces before its name, on a line that goes on or in an
    encoding of its own, it is known as a file of the mesh; a remark that names one is none."""
    (tmp_path / "parts.mtl").write_text("newmtl panel\nKd 0 1 0\n")
    (tmp_path / "other.mtl").write_text("newmtl panel\nKd 1 0 0\n")
    text = f"# mtllib other.mtl\n{line}\nmtllibrary other.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl panel\nf 1 2 3\n"
    path = tmp_path / "a.obj"
    path.write_bytes(text.encode(encoding))
    mesh = read_mesh_file(path)
    assert mesh.colours is not None
    (colour,) = mesh.colours()
    assert colour is not None
    assert colour.factor == (0.0, 1.0, 0.0)
    assert files_of_mesh(path) == {tmp_path / "parts.mtl"}


@pytest.mark.parametrize(
    "line",
    [
        "map_Kd",
        "map_Kd -clamp on",
        "map_Kd -mm 0 1",
        "map_Kd -s 1 1 1 t.png",
        "Kd 0 1",
        "Kd 0 1.1 0",
        "Kd a b c",
    ],
)
def test_a_colour_that_is_not_understood_is_a_fault_of_the_file(line: str, tmp_path: Path) -> None:
    (tmp_path / "t.png").write_bytes(b"picture")
    (tmp_path / "a.mtl").write_text(f"newmtl a\n{line}\n")
    with pytest.raises((InputError, MeshError)):
        colours_of_libraries(("a.mtl",), tmp_path)


def test_a_foreign_scene_is_that_of_its_peer() -> None:
    """Three parts, moved, turned and mirrored: corners lie where trimesh puts them, and faces look the same way."""
    scene = trimesh.Scene()
    shapes = (
        trimesh.creation.box((1.0, 2.0, 3.0)),
        trimesh.creation.icosphere(1),
        trimesh.creation.cone(0.5, 2.0),
    )
    for number, shape in enumerate(shapes):
        matrix = trimesh.transformations.rotation_matrix(0.4 + number, (1.0, 2.0, 3.0 - number))
        matrix[:3, :3] *= (1.5, -2.0, 0.7)[number]
        matrix[:3, 3] = 3.0 * number, -1.0, 0.5
        if number != 1:
            shape.visual = trimesh.visual.TextureVisuals(
                material=trimesh.visual.material.PBRMaterial(f"paint {number}")
            )
        scene.add_geometry(shape, node_name=f"node {number}", geom_name=f"part {number}", transform=matrix)
    found = _arrays(scene.export(file_type="glb"), "glb")
    names = json.loads(bytes(found["names"]))
    assert sorted(names) == [
        ["", "part 1", "node 1"],
        *([f"paint {n}", f"part {n}", f"node {n}"] for n in (0, 2)),
    ]
    assert found["unit"] == 1.0
    for number, shape in enumerate(shapes):
        peer = shape.copy()
        peer.apply_transform(scene.graph[f"node {number}"][0])
        (place,) = (at for at, (*_, node) in enumerate(names) if node == f"node {number}")
        faces = found["faces"][found["part_of"] == place]
        own = found["vertices"][faces]
        assert len(own) == len(shape.faces)
        volume = np.einsum("ij,ij->i", own[:, 0], np.cross(own[:, 1], own[:, 2])).sum() / 6.0
        assert volume == pytest.approx(abs(peer.volume), rel=1e-6)
        assert own.reshape(-1, 3).min(axis=0) == pytest.approx(peer.bounds[0], rel=1e-5, abs=1e-6)
        assert own.reshape(-1, 3).max(axis=0) == pytest.approx(peer.bounds[1], rel=1e-5, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "unit"), [("inch", 0.0254), ("mm", 1e-3), (None, 0.0), ("", 0.0), ("parsnip", 0.0)]
)
def test_units_of_foreign_files_are_metres(name: str | None, unit: float) -> None:
    assert _unit(name) == pytest.approx(unit, rel=1e-9)
