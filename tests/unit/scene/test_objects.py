"""What a scene of objects may be: how large arrays are, who is fixed to whom, and the names that results know."""

from __future__ import annotations

import io
import json
import zipfile
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from scanner_sim.scene.files import foreign_files
from scanner_sim.scene.files.foreign_files import _check_archive, _check_xml, _mesh
from scanner_sim.scene.files.shapes import Surfaces
from scanner_sim.scene.files.triangles import MeshError
from scanner_sim.scene.materials import MATERIALS
from scanner_sim.scene.objects import DEEPEST, MOST_TARGETS, Scene, TargetPattern, materials_of
from scanner_sim.scene.surfaces import Surface

BALL = {"shape": "sphere", "diameter": 1.0, "material": "z93_white"}


def ball(name: str, **more: Any) -> dict[str, Any]:
    return {"name": name, **BALL, **more}


def grid(name: str = "grid", **more: Any) -> dict[str, Any]:
    return {"name": name, "array": {"diameter": 0.1, "plate": 0.2, "spacing": (0.2, 0.2), **more}}


def said_of(*objects: dict[str, Any]) -> str:
    """Return what is said of a scene, nothing if it is possible."""
    try:
        Scene.model_validate({"objects": objects})
    except ValidationError as error:
        return str(error)
    return ""


def chain(count: int) -> list[dict[str, Any]]:
    """Return so many objects beside the first, each fixed to the one before."""
    return [ball("b0"), *(ball(f"b{n}", parent=f"b{n - 1}") for n in range(1, count + 1))]


@pytest.mark.parametrize(
    ("possible", "impossible", "words"),
    [
        ([grid(diameter=0.1999)], [grid(diameter=0.2)], "a disc of 0.2 m does not fit on a plate of 0.2 m"),
        ([grid(columns=3)], [grid(columns=3, spacing=(0.199, 0.2))], "the horizontal spacing of 0.199 m"),
        ([grid(rows=3)], [grid(rows=3, spacing=(0.2, 0.199))], "the vertical spacing of 0.199 m"),
        ([grid(rows=3, spacing=(0.1, 0.2))], [grid(columns=2, spacing=(0.1, 0.2))], "the horizontal spacing of 0.1 m"),
        ([ball("a"), ball("b")], [ball("a"), ball("b"), ball("a")], "'a' is already the name of objects[0]"),
        ([ball("a", parent="b"), ball("b")], [ball("aa", parent="ac"), ball("ab")], "Did you mean"),
        ([ball("a", parent="b"), ball("b")], [ball("a", parent="zz")], "The scene's objects: a."),
        ([ball("a", parent="b"), ball("b")], [ball("a", parent="b"), ball("b", parent="a")], "by way of 'a'"),
        (chain(DEEPEST), chain(DEEPEST + 2), "is fixed to itself"),
        ([ball("a")], [{"name": "a", **BALL, "mesh": "a.ply"}], "exactly one of the keys"),
        ([grid()], [{**grid(), "mesh": "a.ply"}], "exactly one of the keys"),
        ([grid()], [{**grid(), "file": "a.xml"}], "exactly one of the keys"),
        ([grid()], [{"name": "a", "mesh": "a.ply", "file": "a.xml"}], "exactly one of the keys"),
    ],
)  # fmt: skip
def test_a_scene_is_possible_up_to_its_limits(possible: list[Any], impossible: list[Any], words: str) -> None:
    assert said_of(*possible) == ""
    assert words in said_of(*impossible)


def test_so_many_targets_may_there_be() -> None:
    """Claim: 10 000, of one array or of all together."""
    half = {"columns": 100, "rows": 50}
    TargetPattern.model_validate({**grid()["array"], "columns": 100, "rows": 100})
    with pytest.raises(ValidationError, match=f"101 × 100 are 10100 targets; {MOST_TARGETS} are possible"):
        TargetPattern.model_validate({**grid()["array"], "columns": 100, "rows": 101})
    assert said_of(grid("a", **half), grid("b", **half)) == ""
    assert "its arrays have 10001 targets" in said_of(grid("a", **half), grid("b", **half), grid("c"))


def test_results_know_objects_and_materials_in_the_order_of_the_scene() -> None:
    scene = Scene.model_validate(
        {
            "objects": [
                {**grid("grid"), "disc": "black_paint", "material": "solar_cell"},
                ball("ball"),
                ball("other", material="solar_cell"),
                ball("own", material={"reflectance": 0.5}),
            ]
        }
    )
    names, materials = scene.names
    assert names == ("grid", "ball", "other", "own")
    assert materials[:3] == ("black_paint", "solar_cell", "z93_white")
    assert len(materials) == 4
    assert [len(materials_of(item)) for item in scene.objects] == [2, 1, 1, 1]


def test_what_is_fixed_to_something_stands_where_that_puts_it() -> None:
    """Claim: poses multiply along the chain, whatever the order in the file."""
    turn = {"axis": "z", "angle": "90 deg"}
    scene = Scene.model_validate(
        {
            "objects": [
                ball("tip", parent="arm", position=(0.0, 3.0, 0.0)),
                ball("base", position=(1.0, 0.0, 5.0), rotation=turn),
                ball("arm", parent="base", position=(2.0, 0.0, 1.0), rotation=turn),
            ]
        }
    )
    found = [item.pose_at(np.array([0.0]))[0, :3, 3].tolist() for item in scene.objects]
    assert found == [
        pytest.approx(place, abs=1e-9) for place in ([1.0, -1.0, 6.0], [1.0, 0.0, 5.0], [1.0, 2.0, 6.0])
    ]


def archive(**changes: Any) -> bytes:
    """Return what the reader of foreign meshes hands over: two triangles of two parts."""
    held = {
        "vertices": np.array([[0.0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 4]]),
        "faces": np.array([[0, 1, 2], [0, 2, 3]]),
        "part_of": np.array([0, 1]),
        "names": np.frombuffer(b'[["paint", "bus", "n1"], ["", "wing", "n2"]]', np.uint8),
        "unit": np.float64(0.0254),
    }
    file = io.BytesIO()
    np.savez(file, **held | changes)
    return file.getvalue()


def test_a_foreign_mesh_is_what_its_reader_hands_over(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = _mesh(archive())
    assert [part.names for part in mesh.parts] == [("paint", "bus", "n1"), ("", "wing", "n2")]
    assert (mesh.part_of.tolist(), mesh.unit, mesh.flat) == ([0, 1], 0.0254, True)
    assert mesh.triangles.vertices[mesh.triangles.faces].sum(axis=(1, 2)).tolist() == [5.0, 7.0]
    assert _mesh(archive(unit=np.float64(0.0))).unit is None
    many = np.frombuffer(json.dumps([["", f"part {n}", ""] for n in range(24)]).encode(), np.uint8)
    monkeypatch.setattr(foreign_files, "MOST_PARTS", 24)
    _mesh(archive(names=many))
    monkeypatch.setattr(foreign_files, "MOST_PARTS", 23)
    with pytest.raises(MeshError, match="more than 23 parts"):
        _mesh(archive(names=many))


@pytest.mark.parametrize(
    ("content", "possible"),
    [
        (b'<?xml version="1.0"?><a/>', True), (b"<?xml version='1.0' encoding='UTF-8'?><a/>", True),
        (b'<?xml encoding = "iso-8859-1"?><a/>', True), (b'<?xml encoding="utf-16"?><a/>', False),
        (b"<a>" + b" " * 200 + b"encoding</a>", True), (b"\xff\xfe<\0a\0", False), (b"\xfe\xff\0<\0a", False),
        (b"<a>\0</a>", False), (b"<a/>" + 1000 * b" " + b"\0", True), (b"<!doctype a><a/>", False),
        (b"<!ENTITY a 'b'>", False),
    ],
)  # fmt: skip
def test_xml_is_in_an_encoding_in_which_nothing_hides(content: bytes, possible: bool) -> None:
    if possible:
        _check_xml(content)
    else:
        with pytest.raises(MeshError):
            _check_xml(content)


def test_an_archive_unpacks_to_as_much_as_a_mesh_may_have(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the sum of its files, and how many there are, up to the limits themselves; XML within is looked at."""

    def packed(**files: str) -> bytes:
        held = io.BytesIO()
        with zipfile.ZipFile(held, "w") as made:
            for name, text in files.items():
                made.writestr(name.replace("_", "."), text)
        return held.getvalue()

    content = packed(a_model="<a/>", b_png="12345678", c_rels="<b/>", **{f"n{n}_png": "." for n in range(20)})
    for name, value, possible in (
        ("LARGEST_MESH", 36, True), ("LARGEST_MESH", 35, False), ("MOST_PARTS", 23, True), ("MOST_PARTS", 22, False),
    ):  # fmt: skip
        with monkeypatch.context() as limited:
            limited.setattr(foreign_files, name, value)
            if possible:
                _check_archive(content)
            else:
                with pytest.raises(MeshError, match="unpacks to more"):
                    _check_archive(content)
    _check_archive(packed(a_png="<!DOCTYPE a>"))
    for name in ("a_model", "a_rels", "a_xml", "a_MODEL"):
        with pytest.raises(MeshError, match="document type"):
            _check_archive(packed(**{name: "<!DOCTYPE a>"}))
    with pytest.raises(MeshError, match="no archive"):
        _check_archive(content[:-10])


@pytest.mark.usefixtures("device")
def test_a_scenes_materials_are_known_by_what_they_reflect() -> None:
    """Claim: out of the filter's band its reflectance counts there over that in the band, 1 where nobody says; of
    what is black in band that there by itself, and this is told of it where it is not black there, too; its speckle's
    squared contrast is (1 + P²)/2 of light polarised to P, the share that is not depolarised."""
    surfaces = Surfaces()
    told = Surface(reflectance=0.4, reflectance_out_of_band=0.1)
    black = (Surface(reflectance=0.0, reflectance_out_of_band=0.3), Surface(reflectance=0.0))
    for choice in (told, Surface(reflectance=0.7), *black):
        surfaces(choice)
    names = [name for name in surfaces._described if name not in MATERIALS]
    assert [surfaces.out_of_band_ratio(name) for name in names] == pytest.approx([0.25, 1.0, 0.3, 0.0])
    assert [surfaces.is_dark_in_band(name) for name in names] == [False, False, True, False]
    assert not any(map(surfaces.is_dark_in_band, (*MATERIALS, "of a file")))
    to_the_eye = Surfaces("visible")
    to_the_eye(black[0].changed(reflectance_visible=0.4))
    assert not any(map(to_the_eye.is_dark_in_band, to_the_eye._described))
    assert surfaces.known_as(names[0]) == told.known_as
    shares = {name: known.depolarised_share for name, known in MATERIALS.items()}
    assert len(set(shares.values())) > 2
    for name, share in shares.items():
        assert surfaces.coherence(name) == pytest.approx(0.5 * (1.0 + (1.0 - share) ** 2), rel=1e-9)
        known = MATERIALS[name]
        if known.reflectance_out_of_band is not None:
            ratio = known.reflectance_out_of_band / known.reflectance
            assert surfaces.out_of_band_ratio(name) == pytest.approx(ratio, rel=1e-12)
    assert surfaces.coherence("of a file") == pytest.approx(0.5)
    assert surfaces.out_of_band_ratio("of a file") == 1.0
