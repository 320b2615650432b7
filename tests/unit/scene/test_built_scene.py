"""A scene is built once for all runs before it, and anew as soon as anything about it is another."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scanner_sim.foundation.errors import ScenarioError
from scanner_sim.scene.objects import Scene

pytestmark = pytest.mark.usefixtures("device")

WALL = {
    "name": "wall",
    "shape": "rectangle",
    "size": (1.0, 1.0),
    "position": (0.0, 0.0, 10.0),
    "material": "z93_white",
}
TRIANGLE = "o m\nv -1 -1 {depth}\nv 1 -1 {depth}\nv 0 1 {depth}\nf 1 3 2\n"
XML = """<scene version="3.0.0"><include filename="part.xml"/></scene>"""
PART = """<scene version="3.0.0"><shape type="obj"><string name="filename" value="part.obj"/>
<bsdf type="diffuse" id="{name}"><spectrum name="reflectance" value="{reflectance}"/></bsdf></shape></scene>"""


def load(*objects: dict[str, Any], **more: Any) -> Any:
    from scanner_sim.scene.files.loader import load_scene

    return load_scene(Scene.model_validate({"objects": objects, **more}))


def distance(loaded: Any) -> float:
    """Return how far away the scene is along the axis."""
    import mitsuba as mi

    return float(loaded.mitsuba.ray_intersect(mi.Ray3f([0.01, 0.01, 0.0], [0.0, 0.0, 1.0])).t[0])


def reflected(loaded: Any) -> float:
    """Return the BSDF of what is met along the axis, seen straight on."""
    import mitsuba as mi

    si = loaded.mitsuba.ray_intersect(mi.Ray3f([0.01, 0.01, 0.0], [0.0, 0.0, 1.0]))
    return float(si.bsdf().eval(mi.BSDFContext(), si, mi.Vector3f(0.0, 0.0, 1.0))[0][0])


def files(folder: Path, depth: int = 5, name: str = "grey", reflectance: float = 0.5) -> Path:
    """Write a scene of one triangle in three files; return the first."""
    (folder / "scene.xml").write_text(XML)
    (folder / "part.xml").write_text(PART.format(name=name, reflectance=reflectance))
    (folder / "part.obj").write_text(TRIANGLE.format(depth=depth))
    return folder / "scene.xml"


def test_the_same_scene_is_built_once(tmp_path: Path) -> None:
    file = files(tmp_path)
    first = load(WALL, file=file)
    again = load(WALL, file=file)
    assert again.mitsuba is first.mitsuba
    assert (again.objects, again.materials) == (first.objects, first.materials)
    np.testing.assert_array_equal(again.frames.numpy(), first.frames.numpy())


def test_runs_of_one_scene_read_the_same_tables() -> None:
    """Claim: to Dr.Jit the tables of both are the same arrays: what was recorded of one run serves the other."""
    first, again = load(WALL), load(WALL)
    for table in ("object_of", "material_of", "out_of_band_ratio", "coherence", "narrow", "dark_in_band"):
        assert getattr(first, table).index == getattr(again, table).index, table


@pytest.mark.parametrize(
    "change",
    [
        {"position": (0.0, 0.0, 9.0)},
        {"rotation": {"axis": "y", "angle": 0.5}},
        {"size": (1.0, 2.0)},
        {"name": "other"},
        {"material": "nickel"},
        {"material": {"reflectance": 0.25}},
        {"material": {"reflectance": 0.25, "depolarisation": 0.5}},
        {"material": {"reflectance": 0.25, "reflectance_out_of_band": 0.5}},
        {"material": {"reflectance": 0.0, "reflectance_out_of_band": 0.5}},
        {"motion": {"type": "twist", "velocity": (0.0, 0.0, 1.0)}},
    ],
    ids=str,
)
def test_another_object_makes_another_scene(change: dict[str, Any]) -> None:
    """A scene in whose place an older one came would be that one."""
    from scanner_sim.scene.files.built_scene import Named, SceneKeeper

    first, anew = load(WALL), SceneKeeper()
    scene = {**WALL, **change}
    other = load(scene)
    assert other.mitsuba is not first.mitsuba
    (one,) = Scene.model_validate({"objects": [scene]}).objects
    expected = anew.built([Named(one, one.name, "")])
    assert (expected.objects, expected.materials) == (other.objects, other.materials)
    for table in ("out_of_band_ratio", "coherence", "dark_in_band"):
        np.testing.assert_array_equal(getattr(expected, table).numpy(), getattr(other, table).numpy())
    assert str(expected.resting.bbox()) == str(other.mitsuba.bbox())


def test_changed_files_are_read_again_whatever_their_date(tmp_path: Path) -> None:
    """Claim: the mesh, the included file and the file itself are what they are now; dates and sizes stay here."""
    file = files(tmp_path)
    before = {path: path.stat() for path in tmp_path.iterdir()}
    assert distance(load(file=file)) == pytest.approx(5.0)
    for changes, expected in (
        ({"depth": 7}, (7.0, "grey", 0.5)),
        ({"depth": 7, "name": "gray"}, (7.0, "gray", 0.5)),
        ({"depth": 7, "name": "gray", "reflectance": 0.2}, (7.0, "gray", 0.2)),
        ({}, (5.0, "grey", 0.5)),
    ):
        files(tmp_path, **changes)  # type: ignore[arg-type]
        for path, status in before.items():
            assert path.stat().st_size == status.st_size
            os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
        loaded = load(file=file)
        assert distance(loaded) == pytest.approx(expected[0])
        assert loaded.materials == (expected[1],)
        assert reflected(loaded) == pytest.approx(expected[2] / np.pi, rel=1e-5)


def test_a_file_that_is_gone_is_missed(tmp_path: Path) -> None:
    file = files(tmp_path)
    load(file=file)
    (tmp_path / "part.obj").unlink()
    with pytest.raises(ScenarioError, match="cannot be opened"):
        load(file=file)


def test_a_mesh_of_the_scenario_is_looked_at_too(tmp_path: Path) -> None:
    mesh = files(tmp_path).with_name("part.obj")
    part = {"name": "part", "mesh": mesh, "material": "z93_white"}
    assert distance(load(part)) == pytest.approx(5.0)
    mesh.write_text(TRIANGLE.format(depth=7))
    assert distance(load(part)) == pytest.approx(7.0)
    assert distance(load({**part, "length_unit": 0.5})) == pytest.approx(3.5)


def test_a_motion_moves_what_is_built_already() -> None:
    moving = [
        {**WALL, "motion": {"type": "twist", "velocity": (0.0, 0.0, speed)}, "position": (0.0, 0.0, start)}
        for speed, start in ((1.0, 10.0), (2.0, 12.0))
    ]
    (first, second) = (load(item) for item in moving)
    assert second.bodies[0].mitsuba is first.bodies[0].mitsuba
    for loaded, start, later in ((first, 10.0, 11.0), (second, 12.0, 14.0)):
        assert loaded.poses[0].position.z[0] == start
        assert loaded.frames.numpy()[12 + 11] == start
        assert loaded.poses_at([1.0])[0].position.z[0] == later


@pytest.mark.parametrize("kind", ["mesh", "rectangle"])
def test_whoever_changes_the_scene_changes_no_later_run(tmp_path: Path, kind: str) -> None:
    import drjit as dr
    import mitsuba as mi

    mesh = {"name": "part", "mesh": files(tmp_path).with_name("part.obj"), "material": "z93_white"}
    item = {"mesh": mesh, "rectangle": WALL}[kind]
    first = load(item)
    was = distance(first)
    parameters = mi.traverse(first.mitsuba)
    (key,) = (key for key, _ in parameters if key.endswith(("vertex_positions", "to_world")))
    if kind == "mesh":
        parameters[key] = parameters[key] + 1.0
    else:
        parameters[key] = mi.Transform4f().translate([0.0, 0.0, 3.0])
    parameters.update()
    assert distance(first) != was
    assert distance(load(item)) == was

    # A change in place, and of a material only.
    second = load(item)
    light = reflected(second)
    parameters = mi.traverse(second.mitsuba)
    key = next(key for key, _ in parameters if key.endswith("reflectance.value"))
    dr.scatter(parameters[key], mi.Float(0.1), mi.UInt32(0))
    parameters.update()
    assert reflected(load(item)) == light


def test_tables_are_the_users_own() -> None:
    first = load(WALL)
    table = first.coherence
    table += 1.0
    np.testing.assert_array_equal(load(WALL).coherence.numpy() + 1.0, table.numpy())


def test_one_scene_is_kept_and_no_larger_one_than_memory_bears(monkeypatch: pytest.MonkeyPatch) -> None:
    from scanner_sim.scene.files import built_scene

    board = {"name": "board", "array": {"diameter": 0.1, "plate": 0.2}, "position": (0.0, 0.0, 3.0)}
    first = load(board)
    assert load(board).mitsuba is first.mitsuba
    load(WALL)
    other = load(board)
    assert other.mitsuba is not first.mitsuba
    monkeypatch.setattr(built_scene, "MOST_KEPT", other.triangles - 1)
    load(WALL)
    assert load(board).mitsuba is not load(board).mitsuba
