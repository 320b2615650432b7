"""Triangles of a mesh file keep to their vertices, normals, texture and parts whatever is left out of the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scanner_sim.foundation.errors import InputError
from scanner_sim.scene.files import obj_files, shapes, stl_files
from scanner_sim.scene.files.file_meshes import FileMesh, FilePart
from scanner_sim.scene.files.mesh_cleaning import cleaned
from scanner_sim.scene.files.obj_files import obj_mesh
from scanner_sim.scene.files.ply_files import ply_triangles
from scanner_sim.scene.files.stl_files import stl_mesh
from scanner_sim.scene.files.triangles import MeshError, Triangles, check_triangles
from scanner_sim.scene.objects import MitsubaFile, Scene

FOUR = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
TWO = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
FACET = "facet normal 0 0 1\nouter loop\nvertex 0 0 {0}\nvertex 1 0 {0}\nvertex 0 1 {0}\nendloop\nendfacet\n"


def test_missing_points_leave_each_vertex_its_normal_and_texture() -> None:
    """Points that no face names and that are no numbers go; the others keep all that was theirs."""
    rng = np.random.default_rng(5)
    vertices = rng.normal(size=(9, 3))
    normals, texture = rng.normal(size=(9, 3)), rng.normal(size=(9, 2))
    vertices[[0, 4]] = np.nan
    faces = np.array([[8, 2, 5], [3, 8, 7]])
    mesh = check_triangles(vertices, faces, normals, texture)
    assert mesh.normals is not None
    assert mesh.texture is not None
    assert len(mesh.vertices) == 5
    for kept, given in ((mesh.vertices, vertices), (mesh.normals, normals), (mesh.texture, texture)):
        assert np.array_equal(kept[mesh.faces], given[faces].astype(np.float32))


@pytest.mark.parametrize(("zero", "kept"), [([], True), ([2], False), ([0, 1, 2, 3], False)])
def test_normals_count_only_where_every_vertex_has_one(zero: list[int], kept: bool) -> None:
    normals = np.tile(np.float32([0, 0, 1]), (4, 1))
    normals[zero] = 0.0
    assert (check_triangles(FOUR, TWO, normals).normals is not None) == kept


@pytest.mark.parametrize("before", [0, 1, 49, 50, 51, 400])
def test_one_face_with_an_area_is_enough_wherever_it_stands(before: int) -> None:
    slivers = np.tile(np.uint32([[1, 1, 2]]), (before, 1))
    assert len(check_triangles(FOUR, np.concatenate([slivers, TWO])).faces) == before + 2
    if before:
        with pytest.raises(MeshError, match="area"):
            check_triangles(FOUR, slivers)


@pytest.mark.parametrize("place", [(0, 0, 0), (0, 0, 1), (-1, 0, 0), (0, -1, 0), (3, -2, 5)])
def test_an_area_is_one_wherever_the_mesh_lies(place: tuple[int, int, int]) -> None:
    """Claim: a right angle has an area and three points of a line have none, whichever corner is the origin."""
    for corner in range(3):
        turned = np.roll(TWO[:1], corner, axis=1)
        check_triangles(FOUR[:3] + np.float32(place), turned)
        with pytest.raises(MeshError, match="area"):
            check_triangles(FOUR[[0, 1, 1]] * [[1], [1], [2]] + np.float32(place), turned)


def test_faces_keep_their_parts_when_slivers_go() -> None:
    faces = np.concatenate([[[1, 1, 1]], TWO[:1], [[2, 2, 3]], TWO[1:]]).astype(np.uint32)
    own = FileMesh(Triangles(FOUR, faces), np.array([2, 0, 0, 1]), tuple(FilePart((n,)) for n in "abc"))
    mended = cleaned(own)
    assert mended.triangles.faces.tolist() == TWO.tolist()
    assert mended.part_of.tolist() == [0, 1]


def test_vertices_that_stand_twice_are_merged_in_the_order_of_the_file() -> None:
    corners = FOUR[[2, 0, 3, 2, 1, 0]]
    mended = cleaned(FileMesh.whole(Triangles(corners, np.uint32([[0, 2, 1], [3, 5, 4]])), flat=True))
    assert mended.triangles.vertices.tolist() == FOUR[[2, 0, 3, 1]].tolist()
    assert np.array_equal(mended.triangles.vertices[mended.triangles.faces], corners[[[0, 2, 1], [3, 5, 4]]])


def test_the_fewer_faces_of_a_surface_are_turned() -> None:
    """Of a sheet of seven faces of which two look the other way those two are turned, and of which five, again two."""
    rim = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.linspace(0.0, 6.0, 8)], np.float32)
    vertices = np.concatenate([[[0.0, 0.0, 0.0]], rim]).astype(np.float32)
    right = np.array([[0, k, k + 1] for k in range(1, 8)], np.uint32)
    for turned, expected in (([1, 4], right), ([0, 2, 3, 5, 6], right[:, [0, 2, 1]])):
        faces = right.copy()
        faces[turned] = faces[turned][:, [0, 2, 1]]
        mended = cleaned(FileMesh.whole(Triangles(vertices, faces)))
        assert mended.triangles.faces.tolist() == expected.tolist()
        assert mended.notes[-1].startswith("2 faces turned")


def solids(*facets: int) -> bytes:
    return "".join(
        f"solid s{n}\n" + FACET.format(n) * count + "endsolid\n" for n, count in enumerate(facets)
    ).encode()


@pytest.mark.parametrize(
    ("facets", "parts", "names"),
    [
        ((2, 1), [0, 0, 1], ["s0", "s1"]),
        ((1, 0), [0], ["s0"]),
        ((0, 1), [0], ["s1"]),
        ((1, 0, 2, 0), [0, 1, 1], ["s0", "s2"]),
    ],
)
def test_solids_without_a_facet_are_no_parts(
    facets: tuple[int, ...], parts: list[int], names: list[str]
) -> None:
    mesh = stl_mesh(solids(*facets))
    assert mesh.part_of.tolist() == parts
    assert [part.names[0] for part in mesh.parts] == names


def test_a_file_may_have_so_many_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\n" + "".join(f"g part{n}\nf 1 2 3\n" for n in range(24))
    for reader, own, name in (
        (obj_files, lambda: obj_mesh(text.encode(), Path("a.obj")), "parts"),
        (stl_files, lambda: stl_mesh(solids(*[1] * 24)), "solids"),
    ):
        monkeypatch.setattr(reader, "MOST_PARTS", 24)
        assert len(own().parts) == 24
        monkeypatch.setattr(reader, "MOST_PARTS", 23)
        with pytest.raises(MeshError, match=f"more than 23 {name}"):
            own()


@pytest.mark.parametrize("names", [("u", "v"), ("s", "t")])
def test_texture_goes_by_either_name(names: tuple[str, str]) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(
        f"property float {name}\n" for name in ("x", "y", "z", *names)
    )
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    mesh = ply_triangles((head + "0 0 0 0.1 0.2\n1 0 0 0.3 0.4\n1 1 0 0.5 0.6\n3 0 1 2\n").encode())
    assert mesh.texture is not None
    assert np.allclose(mesh.texture[mesh.faces[0]], [[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]])


def load(*objects: Any) -> Any:
    from scanner_sim.scene.files.loader import load_scene

    return load_scene(Scene(objects=objects))


@pytest.mark.usefixtures("device")
def test_the_meshes_of_a_scene_have_so_many_triangles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that stands twelve times counts twelve times."""
    (tmp_path / "one.obj").write_text("v 0 0 5\nv 1 0 5\nv 1 1 5\nv 0 1 5\nf 1 2 3\nf 1 3 4\n")
    shape = '<shape type="obj"><string name="filename" value="one.obj"/></shape>'
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0">{12 * shape}</scene>')
    item = MitsubaFile(name="m", file=tmp_path / "scene.xml")
    monkeypatch.setattr(shapes, "MOST_TRIANGLES", 23)
    with pytest.raises(InputError, match="more than 2e"):
        load(item)
    monkeypatch.setattr(shapes, "MOST_TRIANGLES", 24)
    load(item)


@pytest.mark.usefixtures("device")
@pytest.mark.parametrize(("reach", "taken"), [(0.9e6, True), (1.1e6, False), (0.9e7, False)])
def test_a_mesh_reaches_a_thousand_kilometres_at_most(reach: float, taken: bool, tmp_path: Path) -> None:
    (tmp_path / "one.obj").write_text(f"v 0 0 5\nv {reach} 0 5\nv 1 1 5\nf 1 2 3\n")
    shape = '<shape type="obj"><string name="filename" value="one.obj"/></shape>'
    (tmp_path / "scene.xml").write_text(f'<scene version="3.0.0">{shape}</scene>')
    item = MitsubaFile(name="m", file=tmp_path / "scene.xml")
    if taken:
        load(item)
    else:
        with pytest.raises(InputError, match="reaches beyond"):
            load(item)


@pytest.mark.usefixtures("device")
def test_surfaces_of_one_name_and_unlike_numbers_are_two() -> None:
    import mitsuba as mi

    loaded = load(
        *(
            {
                "name": f"plate{n}", "shape": "rectangle", "size": (1.0, 1.0), "position": (2.0 * n, 0.0, 5.0),
                "material": {"name": "paint", "reflectance": reflectance},
            }
            for n, reflectance in enumerate((0.2, 0.6))
        )
    )  # fmt: skip
    for n, reflectance in enumerate((0.2, 0.6)):
        si = loaded.mitsuba.ray_intersect(mi.Ray3f([2.0 * n + 0.01, 0.01, 0.0], [0.0, 0.0, 1.0]))
        assert float(si.bsdf().eval_diffuse_reflectance(si)[0][0]) == pytest.approx(reflectance, rel=1e-5)
    assert list(loaded.material_labels.names).count("paint") == 1
