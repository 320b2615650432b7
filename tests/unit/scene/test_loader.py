"""Scenes are loaded with the poses, names and materials of their description; faults are reported together."""

from __future__ import annotations

import errno
import math
import os
import shutil
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.foundation.errors import InputError, RunError, ScenarioError
from scanner_sim.scene.files import shapes
from scanner_sim.scene.objects import Scene

GREY = {"reflectance": 0.5}
TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])

pytestmark = pytest.mark.usefixtures("device")


def load(*objects: dict[str, Any]) -> Any:
    from scanner_sim.scene.files.loader import load_scene

    return load_scene(Scene(objects=objects))


def first_hit(
    loaded: Any, origin: list[float], direction: list[float]
) -> tuple[float, str, str, list[float]]:
    """Return distance, object, material and normal of what a ray meets."""
    import drjit as dr
    import mitsuba as mi

    si = loaded.mitsuba.ray_intersect(mi.Ray3f(mi.Point3f(origin), mi.Vector3f(direction)))
    index = dr.reinterpret_array(mi.UInt32, si.shape)
    names = [
        table[int(dr.gather(mi.UInt32, numbers, index)[0]) - 1]
        for table, numbers in ((loaded.objects, loaded.object_of), (loaded.materials, loaded.material_of))
    ]
    return float(si.t[0]), names[0], names[1], si.n.numpy().ravel().tolist()


@pytest.mark.parametrize(
    ("item", "distance"),
    [
        ({"shape": "rectangle", "size": (1, 1)}, 10.0),
        ({"shape": "disc", "diameter": 1}, 10.0),
        ({"shape": "sphere", "diameter": 1}, 9.5),
        ({"shape": "box", "size": (1, 2, 3)}, 8.5),
        ({"shape": "cylinder", "diameter": 1, "length": 3}, 9.5),
        (
            {"shape": "cylinder", "diameter": 1, "length": 3, "rotation": {"axis": "x", "angle": np.pi / 2}},
            8.5,
        ),
        ({"shape": "rectangle", "size": (1, 1), "rotation": {"axis": "y", "angle": np.pi / 4}}, 10.0),
    ],
)
def test_shapes_stand_where_they_should_and_face_the_scanner(item: dict[str, Any], distance: float) -> None:
    loaded = load({"name": "thing", "position": (0, 0, 10), "material": GREY, **item})
    t, name, material, normal = first_hit(loaded, [0.01, 0.02, 0.0], [0.0, 0.0, 1.0])
    tilt = 0.01 if "rotation" in item and item["shape"] == "rectangle" else 0.0
    assert t == pytest.approx(distance - tilt, abs=1e-3) or t == pytest.approx(distance + tilt, abs=1e-3)
    assert (name, material) == ("thing", "reflectance_0.5")
    assert normal[2] < -0.5


@pytest.mark.parametrize("kind", ["ply", "obj", "stl"])
def test_a_users_mesh_is_scaled_turned_and_moved(tmp_path: Path, kind: str) -> None:
    import trimesh

    path = tmp_path / f"thing.{kind}"
    trimesh.Trimesh(1000.0 * TETRAHEDRON, FACES).export(path)
    loaded = load(
        {
            "name": "thing",
            "mesh": path,
            "length_unit": 1e-3,
            "position": (0, 0, 5),
            "rotation": {"axis": "y", "angle": np.pi / 2},
            "material": "grey_reference",
        }
    )
    # Turned by 90° about y, the corner at +z goes to +x and the one at +x to −z.
    t, name, material, _ = first_hit(loaded, [0.05, 0.05, 0.0], [0.0, 0.0, 1.0])
    assert t == pytest.approx(5.0 - 0.9, abs=1e-5)
    assert (name, material) == ("thing", "grey_reference")
    assert loaded.triangles == 4


def test_a_mitsuba_file_moves_as_one_body(tmp_path: Path) -> None:
    path = tmp_path / "pair.xml"
    path.write_text(
        """<scene version="3.0.0">
        <bsdf type="diffuse" id="paint"><spectrum name="reflectance" value="0.25"/></bsdf>
        <shape type="sphere"><float name="radius" value="0.5"/><ref id="paint"/></shape>
        <shape type="cube"><transform name="to_world"><scale value="0.1"/><translate x="1"/></transform>
        <ref id="paint"/></shape>
        <emitter type="constant"/></scene>"""
    )
    turned = {"axis": "z", "angle": np.pi / 2}
    loaded = load({"name": "pair", "file": path, "position": (0, 0, 4), "rotation": turned})
    assert first_hit(loaded, [0, 0, 0], [0, 0, 1])[:3] == (pytest.approx(3.5, abs=1e-5), "pair", "paint")
    assert first_hit(loaded, [0, 1, 0], [0, 0, 1])[0] == pytest.approx(3.9, abs=1e-5)
    assert not loaded.mitsuba.emitters()


def test_a_scene_knows_which_lobes_are_narrow(tmp_path: Path) -> None:
    """Claim: retro-reflectors and roughnesses up to 0.1, by the library, by numbers, and in a Mitsuba file, where the
    lobe may be nested or blended."""
    lobe = '<bsdf type="retroreflector" name="nested"><spectrum name="reflectance" value="0.4"/></bsdf>'
    metal = '<bsdf type="roughconductor"><float name="alpha" value="{}"/></bsdf>'
    blend = '<float name="weight" value="0.5"/><bsdf type="diffuse"/>'
    kinds = (
        ("twosided", lobe, True), ("blendbsdf", blend + lobe, True), ("diffuse", "", False),
        ("twosided", metal.format(0.1), True), ("blendbsdf", blend + metal.format(0.11), False),
    )  # fmt: skip
    path, own = tmp_path / "paint.xml", {"type": "retroreflector", "reflectance": 0.4}
    for kind, inside, narrow in kinds:
        path.write_text(
            f'<scene version="3.0.0"><bsdf type="{kind}" id="paint">{inside}</bsdf>'
            '<shape type="sphere"><ref id="paint"/></shape></scene>'
        )
        loaded = load({"name": "file", "file": path})
        assert (loaded.narrow.numpy().tolist(), loaded.has_narrow) == ([False, narrow], narrow)
    wall = {"name": "wall", "shape": "rectangle", "size": (1.0, 1.0), "position": (0, 0, 3)}
    plain = wall | {"name": "plain", "material": "z93_white"}
    for material, narrow in (
        ("retro_sheet", True),
        (own, True),
        ("nickel", True),
        ("aluminised_kapton", False),
        ("weathered_aluminium", False),
    ):
        assert load(plain, wall | {"material": material}).narrow.numpy().tolist() == [False, False, narrow]


def test_a_target_array_is_black_on_white_in_one_plane() -> None:
    array = {"diameter": 0.1, "plate": 0.2, "rows": 2, "columns": 2, "spacing": (1.0, 1.0)}
    loaded = load({"name": "targets", "array": array, "position": (0, 0, 3)})
    assert first_hit(loaded, [0.5, 0.5, 0], [0, 0, 1])[:3] == (pytest.approx(3.0), "targets", "target_black")
    assert first_hit(loaded, [0.59, 0.5, 0], [0, 0, 1])[:3] == (pytest.approx(3.0), "targets", "target_white")


def test_every_fault_is_reported_with_its_object(tmp_path: Path) -> None:
    broken, cloud, scene = tmp_path / "broken.ply", tmp_path / "cloud.ply", tmp_path / "broken.xml"
    broken.write_text("ply\nformat ascii 1.0\nelement vertex 2\n")
    cloud.write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 0\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n"
    )
    scene.write_text("<scene version='3.0.0'><shape type='sphare'/></scene>")
    with pytest.raises(ScenarioError) as caught:
        load(
            {"name": "a", "mesh": broken, "material": GREY},
            {"name": "b", "mesh": cloud, "material": GREY},
            {"name": "c", "file": scene},
        )
    assert [fault.location for fault in caught.value.faults] == [
        "scene.objects[0] (a)",
        "scene.objects[1] (b)",
        "scene.objects[2] (c)",
    ]
    message = str(caught.value)
    assert "broken.ply" in message
    assert "sphare" in message


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EACCES])
def test_a_disk_that_takes_no_copy_of_a_mesh_is_told_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, repo_root: Path, code: int
) -> None:
    """Claim: of a mesh and of one that a Mitsuba file names it is a fault of the run, with what the system says and the
    remedy; nothing stays where the copies are made. A folder for them that is gone is told of as well."""
    mesh, scene, room = (tmp_path / name for name in ("triangle.ply", "scene.xml", "room"))
    shutil.copy(repo_root / "tests" / mesh.name, mesh)
    scene.write_text(
        '<scene version="3.0.0"><shape type="ply"><string name="filename" value="triangle.ply"/></shape></scene>'
    )
    room.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(room))

    def fails(path: Path, content: bytes) -> None:
        raise OSError(code, os.strerror(code), str(path))

    with monkeypatch.context() as full:
        full.setattr(Path, "write_bytes", fails)
        for item in ({"mesh": mesh, "material": GREY}, {"file": scene}):
            with pytest.raises(RunError, match=f"cannot be written: {os.strerror(code)}") as caught:
                load({"name": "thing", **item})
            assert caught.value.remedy == "Make room on the disk, or set TMPDIR to another folder."
            assert list(room.iterdir()) == []
    room.rmdir()
    with pytest.raises(RunError, match=os.strerror(errno.ENOENT)):
        load({"name": "thing", "mesh": mesh, "material": GREY})


def test_an_empty_scene_can_be_loaded() -> None:
    loaded = load()
    assert loaded.objects == ()


@pytest.mark.parametrize(
    ("diagonal", "flat"),
    [((1.0, 2.0, 3.0), False), ((-2.0, -1.0, -1e-3), False), ((-1.0, 0.0, -1.0), True), ((0.0, 0.0, 0.0), True),
     ((math.nan, 1.0, 1.0), True), ((1e-6, 2e-6, 1e-6), False)],
)  # fmt: skip
def test_a_transform_that_flattens_is_refused_and_one_that_mirrors_is_not(
    diagonal: tuple[float, float, float], flat: bool
) -> None:
    given: Any = SimpleNamespace(matrix=np.diag([*diagonal, 1.0]))
    if flat:
        with pytest.raises(InputError, match="flattens"):
            shapes._refuse_singular("to_world", given)
    else:
        shapes._refuse_singular("to_world", given)
