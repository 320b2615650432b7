"""Parts of meshes: materials by name, colours of the file as reflectance, labels, and units."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from scanner_sim.foundation.errors import InputError, ScenarioError
from scanner_sim.scene.files.file_meshes import Colour
from scanner_sim.scene.files.mesh_pieces import _MOST_NAMES, _listed
from scanner_sim.scene.files.reflectance_maps import reflectance_map
from scanner_sim.scene.objects import Mesh, Scene
from scanner_sim.scene.surfaces import FileColours
from scanner_sim.scene.visible import Band

pytestmark = pytest.mark.usefixtures("device")

PARTS = """\
mtllib parts.mtl
v -1 -1 0\nv 0 -1 0\nv 0 1 0\nv -1 1 0\nv 1 -1 0\nv 1 1 0
vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1
g bus
usemtl Painted_Alu
f 1/1 2/2 3/3 4/4
usemtl kapton
f 2/1 5/2 6/3 3/4
"""
GREYS = np.array([[0, 85], [170, 255]], np.uint8)
"""A texture: upper row, lower row."""
REFLECTANCES = np.array([[0.0, 0.0908], [0.4020, 1.0]])
"""Their luminance, from the table of IEC 61966-2-1: 85 of 255 is 0.0908, 170 is 0.4020."""


def load(*objects: dict[str, Any], band: Band = "laser") -> Any:
    from scanner_sim.scene.files.loader import load_scene

    return load_scene(Scene(objects=objects), band)


def seen_at(loaded: Any, places: list[tuple[float, float]]) -> tuple[list[str], list[str], np.ndarray]:
    """Object, material and diffuse reflectance that rays along z meet at places (x, y)."""
    import drjit as dr
    import mitsuba as mi

    x, y = np.array(places, np.float32).T
    si = loaded.mitsuba.ray_intersect(mi.Ray3f(mi.Point3f(x, y, -5.0), mi.Vector3f(0.0, 0.0, 1.0)))
    index = dr.reinterpret_array(mi.UInt32, si.shape)
    numbers = [dr.gather(mi.UInt32, table, index).numpy() for table in (loaded.object_of, loaded.material_of)]
    reflectance = si.bsdf().eval_diffuse_reflectance(si).numpy().ravel()
    labels = (loaded.object_labels, loaded.material_labels)
    named = [
        [one.names[one.number_of[n] - 1] for n in found] for one, found in zip(labels, numbers, strict=True)
    ]
    return named[0], named[1], reflectance


@pytest.fixture
def parts(tmp_path: Path) -> Path:
    (tmp_path / "parts.mtl").write_text(
        "newmtl Painted_Alu\nKd 0.5 0.5 0.5\nnewmtl kapton\nmap_Kd colours.png\n"
    )
    Image.fromarray(GREYS).save(tmp_path / "colours.png")
    (tmp_path / "parts.obj").write_text(PARTS)
    return tmp_path / "parts.obj"


def test_materials_go_by_names(parts: Path) -> None:
    """Patterns are of any name of a part, capitals or not; the first that fits counts, and the rest has the default."""
    choice = {"*ALU*": "weathered_aluminium", "bus": {"reflectance": 0.2}, "default": "z93_white"}
    loaded = load({"name": "sat", "mesh": parts, "materials": choice})
    objects, materials, _ = seen_at(loaded, [(-0.5, 0.0), (0.5, 0.0)])
    assert objects == ["sat", "sat"]
    assert materials == ["weathered_aluminium", "reflectance_0.2"]


def test_parts_are_labelled_where_asked(parts: Path) -> None:
    moves = {"type": "twist", "velocity": (0.1, 0.0, 0.0)}
    loaded = load(
        {"name": "sat", "mesh": parts, "material": "z93_white", "label_parts": True, "motion": moves},
        {
            "name": "wall",
            "shape": "rectangle",
            "size": (9.0, 9.0),
            "material": "z93_white",
            "position": (0, 0, 3),
        },
    )
    assert loaded.objects == ("sat.Painted_Alu", "sat.kapton", "wall")
    assert loaded.numbers_of("sat") == (1, 2)
    assert loaded.numbers_of("wall") == (3, 3)


def test_what_no_pattern_fits_is_said_with_the_nearest_names(parts: Path) -> None:
    with pytest.raises(ScenarioError, match=r"'kapton'.*did you mean 'Painted_Alu'"):
        load({"name": "sat", "mesh": parts, "materials": {"painted_al": "z93_white", "*alu*": "z93_white"}})
    loaded = load({"name": "sat", "mesh": parts, "materials": {"captn": "z93_white", "default": "z93_white"}})
    assert any("'captn' fits no part; did you mean 'kapton'" in note for note in loaded.notes)


@pytest.mark.parametrize("kind", ["obj", "glb"])
def test_a_texture_is_a_map_of_reflectance(kind: str, parts: Path) -> None:
    """Claim: reflectance = scale × luminance of linear colours, each texel where the format puts it; to the video
    camera it is the luminance itself, whatever the scale.

    OBJ counts texture rows from below, glTF from above; in both the image's upper row lies at larger y here.
    """
    colours = {"type": "file_colours", "scale": 0.8}
    if kind == "glb":
        mesh = trimesh.Trimesh(
            [[0, -1, 0], [1, -1, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], process=False
        )
        image = Image.open(io.BytesIO((parts.parent / "colours.png").read_bytes()))
        material = trimesh.visual.material.PBRMaterial(baseColorTexture=image, name="kapton")
        mesh.visual = trimesh.visual.TextureVisuals(uv=[[0, 0], [1, 0], [1, 1], [0, 1]], material=material)
        parts = parts.with_suffix(".glb")
        parts.write_bytes(trimesh.Scene(mesh).export(file_type="glb"))
    loaded = load({"name": "sat", "mesh": parts, "material": colours})
    places = [(0.25, 0.5), (0.75, 0.5), (0.25, -0.5), (0.75, -0.5)]
    _, materials, reflectance = seen_at(loaded, places)
    np.testing.assert_allclose(reflectance, 0.8 * REFLECTANCES.ravel(), atol=2e-4)
    assert set(materials) == {"file_colours"}
    assert any("assumed to be 0.8 × the luminance" in note for note in loaded.notes)
    if kind == "obj":  # Kd is linear
        assert seen_at(loaded, [(-0.5, 0.0)])[2] == pytest.approx([0.4])
    to_the_eye = load({"name": "sat", "mesh": parts, "material": colours}, band="visible")
    assert to_the_eye.unknown_visible == ()
    np.testing.assert_allclose(seen_at(to_the_eye, places)[2], REFLECTANCES.ravel(), atol=2e-4)
    if kind == "obj":
        assert seen_at(to_the_eye, [(-0.5, 0.0)])[2] == pytest.approx([0.5])


@pytest.mark.parametrize(
    ("scales", "told"),
    [((1.0, 0.8), ["0.8", "1"]), ((1.0, 1.0), ["1"]), ((None, 0.5), ["0.5"]), ((None, None), [])],
)
def test_each_scale_of_a_files_colours_is_told_once(
    parts: Path, scales: tuple[float | None, ...], told: list[str]
) -> None:
    """Claim: that reflectance is assumed to be so many times the luminance, a scale of 1 too, is said of each scale."""
    choices = [
        {"reflectance": 0.2} if scale is None else {"type": "file_colours", "scale": scale}
        for scale in scales
    ]
    loaded = load({"name": "sat", "mesh": parts, "materials": {"*alu*": choices[0], "default": choices[1]}})
    said = [note for note in loaded.notes if "is assumed to be" in note]
    assert len(said) == len(told)
    for note, scale in zip(said, told, strict=True):
        assert f"assumed to be {scale} × the luminance of the colours in the file" in note


def test_colours_of_a_file_count_whole_by_default() -> None:
    assert FileColours(type="file_colours").scale == 1.0


def test_a_colour_multiplies_its_texture() -> None:
    """Claim: scale × (0.2126 R + 0.7152 G + 0.0722 B) of the products of linear colours, and 1 at most (BT.709)."""
    file = io.BytesIO()
    Image.fromarray(np.array([[[255, 255, 255], [255, 0, 0], [0, 0, 255]]], dtype=np.uint8)).save(file, "PNG")
    found = reflectance_map(Colour((0.5, 0.25, 0.8), file.getvalue()), 0.9, Path("it.glb"))
    parts = np.array([0.2126 * 0.5, 0.7152 * 0.25, 0.0722 * 0.8])
    np.testing.assert_allclose(found, 0.9 * np.array([[parts.sum(), parts[0], parts[2]]]), rtol=1e-6)
    bright = reflectance_map(Colour((1.0, 1.0, 1.0), file.getvalue()), 1.2, Path("it.glb"))
    np.testing.assert_allclose(bright, [[1.0, 1.2 * 0.2126, 1.2 * 0.0722]], rtol=1e-6)


@pytest.mark.parametrize(
    ("texture", "words"), [("../colours.png", "out of its folder"), ("broken.png", "no PNG or JPEG")]
)
def test_textures_lie_in_the_folder_and_are_pictures(texture: str, words: str, parts: Path) -> None:
    (parts.parent / "parts.mtl").write_text(f"newmtl Painted_Alu\nnewmtl kapton\nmap_Kd {texture}\n")
    (parts.parent / "broken.png").write_bytes(b"GIF89a")
    (parts.parent.parent / "colours.png").write_bytes((parts.parent / "colours.png").read_bytes())
    with pytest.raises(ScenarioError, match=words):
        load({"name": "sat", "mesh": parts, "material": {"type": "file_colours"}})


def test_cut_into_parts_a_mesh_looks_as_before(tmp_path: Path) -> None:
    """Claim: interpolated normals do not see where one material ends, as they do not without materials by name."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    lines = [f"v {x} {y} {z}" for x, y, z in ball.vertices]
    faces = [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in ball.faces]
    (tmp_path / "ball.obj").write_text(
        "\n".join([*lines, "usemtl a", *faces[:150], "usemtl b", *faces[150:]])
    )
    import mitsuba as mi

    normals = []
    for choice in ({"material": "z93_white"}, {"materials": {"a": "z93_white", "b": {"reflectance": 0.2}}}):
        loaded = load({"name": "ball", "mesh": tmp_path / "ball.obj", **choice})
        x, y = np.random.default_rng(1).uniform(-0.6, 0.6, (2, 400)).astype(np.float32)
        si = loaded.mitsuba.ray_intersect(mi.Ray3f(mi.Point3f(x, y, -5.0), mi.Vector3f(0.0, 0.0, 1.0)))
        normals.append(si.sh_frame.n.numpy())
    np.testing.assert_allclose(normals[1], normals[0], atol=2e-6)


def test_the_unit_is_the_scenarios_or_the_files(tmp_path: Path) -> None:
    box = trimesh.creation.box((2.0, 2.0, 2.0))
    (tmp_path / "a.glb").write_bytes(trimesh.Scene(box).export(file_type="glb"))
    for given, extent in (({}, 1.0), ({"length_unit": 0.001}, 0.001)):
        loaded = load({"name": "a", "mesh": tmp_path / "a.glb", "material": "z93_white", **given})
        assert loaded.shapes[0].bbox().max[0] == pytest.approx(extent)


def test_a_mesh_has_one_material_or_several() -> None:
    for both in ({}, {"material": "z93_white", "materials": {"default": "z93_white"}}):
        with pytest.raises(ValueError, match="material"):
            Mesh(name="a", mesh=Path(__file__).parents[2] / "triangle.ply", **both)


def test_a_texture_has_as_many_pixels_as_may_be(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the limit counts width times height; one pixel more is refused, with both and the limit."""
    monkeypatch.setattr("scanner_sim.scene.files.reflectance_maps.MOST_PIXELS", 35)
    made = {}
    for size in ((7, 5), (5, 7), (36, 1), (4, 9)):
        file = io.BytesIO()
        Image.new("RGB", size, (255, 255, 255)).save(file, "PNG")
        made[size] = Colour((1.0, 1.0, 1.0), file.getvalue())
    for size in ((7, 5), (5, 7)):
        assert reflectance_map(made[size], 1.0, Path("it.glb")).shape == size[::-1]
    for size in ((36, 1), (4, 9)):
        with pytest.raises(InputError, match=f"{size[0]} × {size[1]} pixels; 35 are possible"):
            reflectance_map(made[size], 1.0, Path("it.glb"))


@pytest.mark.parametrize(
    ("count", "more"), [(0, ""), (1, ""), (_MOST_NAMES, ""), (_MOST_NAMES + 7, " and 7 more")]
)
def test_many_names_are_told_in_part(count: int, more: str) -> None:
    """Claim: so many names are told, and how many more there are; of long ones the beginning."""
    names = [f"n{number}" for number in range(count)]
    told = _listed(names)
    assert told == ", ".join(f"'n{number}'" for number in range(min(count, _MOST_NAMES))) + more
    assert _listed(["x" * 99]) == "'" + "x" * 60 + "'"
