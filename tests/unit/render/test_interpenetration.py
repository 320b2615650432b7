"""Objects that stand in one another are named with the depth; those that touch, or stand apart, are not."""

from __future__ import annotations

import struct
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from scanner_sim import load_scenario
from scanner_sim.cli import app
from scanner_sim.instrument.scene_warnings import scene_warnings
from scanner_sim.render import interpenetration
from scanner_sim.render.interpenetration import Interpenetration, interpenetrations
from scanner_sim.scene.files.loader import load_scene
from scanner_sim.scene.objects import Scene

pytestmark = pytest.mark.usefixtures("device")

GREY = {"reflectance": 0.5}
WALL = {"name": "wall", "shape": "rectangle", "size": (4, 4), "position": (0, 0, 10), "material": GREY}
BOX = {"name": "box", "shape": "box", "size": (1, 1, 1), "position": (0, 0, 9.5), "material": GREY}
BALL = {"name": "ball", "shape": "sphere", "diameter": 1, "position": (0.3, 0.1, 9.8), "material": GREY}
CAN = {
    "name": "can",
    "shape": "cylinder",
    "diameter": 0.5,
    "length": 3,
    "position": (0, 0, 9.5),
    "material": GREY,
}
BOARD: dict[str, Any] = {"name": "board", "position": (0, 0, 9)}
BOARD |= {"array": {"diameter": 0.05, "plate": 0.2, "rows": 2, "columns": 2, "spacing": (0.3, 0.3)}}
TURN = {"axis": (1, 2, 3), "angle": 0.4}
POINTS_APART = 0.02
"""Distance of neighbours among 4096 points on a box or a ball of 1 m, a bound [m]."""
FAN = 0.03
"""By how much the shortest way of a fan of 60 directions may be longer than the shortest one, where faces meet."""


def found(*objects: dict[str, Any], times: tuple[float, ...] = (0.0,)) -> tuple[Interpenetration, ...]:
    return interpenetrations(load_scene(Scene(objects=objects)), times)


@pytest.mark.parametrize(
    ("one", "other", "depth"),
    [
        (WALL, BALL, 0.3),
        (WALL, BOX | {"position": (0, 0, 9.52)}, 0.02),
        (WALL, BOX | {"position": (0, 0, 9.5004)}, 0.0004),
        (BOX, BALL | {"position": (0, 0, 8.7)}, 0.2),
        (BOX, BOX | {"name": "other", "position": (0.9, 0.3, 9.5)}, 0.1),
        (BOX, CAN, 0.5 - 0.25 / np.sqrt(2.0)),
        (BOX, BOARD | {"position": (0, 0, 9.01)}, 0.01),
    ],
    ids=lambda value: value["name"] if isinstance(value, dict) else f"{value:.3g}",
)
def test_the_depth_is_that_of_geometry(one: dict[str, Any], other: dict[str, Any], depth: float) -> None:
    """Claim: in either order, to the distance of the points and the coarseness of the fan."""
    for pair in ((one, other), (other, one)):
        (only,) = found(*pair)
        assert only.objects == (pair[0]["name"], pair[1]["name"])
        assert depth * 0.98 - 1e-5 - POINTS_APART**2 <= only.depth <= depth * (1.0 + FAN) + 1e-5


def test_the_depth_of_two_that_move_together_is_that_of_both_at_rest() -> None:
    """Claim: each is seen from the other's frame, wherever both have gone."""
    moving = {"motion": {"type": "twist", "velocity": (0.4, 0.0, 0.2)}}
    (seen,) = found(BOX | moving, BALL | moving | {"position": (0, 0, 8.7)}, times=(3.0,))
    assert seen.depth == pytest.approx(0.2, rel=FAN)


@pytest.mark.parametrize(
    "objects",
    [
        (WALL, BOX),
        (BOX, BOX | {"name": "other", "position": (1.0, 0.3, 9.5)}),
        (BOX, BALL | {"position": (0, 0, 8.5)}),
        (BOX, BOARD),
        (BOX, BALL | {"position": (0.9, 0.9, 8.8)}),
        (BOX | {"rotation": TURN}, BOX | {"name": "other", "position": (1.2, 1.2, 9.5), "rotation": TURN}),
    ],
    ids=lambda objects: "-".join(item["name"] for item in objects),
)
def test_contact_is_none(objects: tuple[dict[str, Any], ...]) -> None:
    """Claim: faces on faces, a ball or plates on one; and solids apart from one another whose bounding boxes meet."""
    assert found(*objects) == ()


def test_contact_is_what_coordinates_round_to_from_the_scanner_on() -> None:
    """Claim: of two boxes that drift together one stands 4 mm in the other: that is seen at 100 m, and at 1000 m it is
    less than 2⁻¹⁷ of the distance, which is contact."""
    drift = {"motion": {"type": "twist", "velocity": (0.0, 0.0, 0.01)}}
    for distance, seen in ((100.0, True), (1000.0, False)):
        one, other = (
            BOX | drift | {"name": name, "position": (0, 0, distance + aside)}
            for name, aside in (("near", 0.0), ("far", 0.996))
        )
        depths = [item.depth for item in found(one, other, times=(0.0,))]
        assert depths == ([pytest.approx(4e-3, rel=0.03)] if seen else [])


def test_objects_that_move_are_seen_at_their_time() -> None:
    """Claim: a ball that touches at the start is 0.2 m deep after 2 s, in the frame that turns with the box."""
    fall = {"type": "twist", "velocity": (0, 0, 0.1)}
    (one,) = found(BOX, BALL | {"position": (0, 0, 8.5), "motion": fall}, times=(0.0, 1.0, 2.0))
    assert one.objects == ("box", "ball")
    assert (one.time, one.depth) == (2.0, pytest.approx(0.2, abs=1e-3))
    spin = {"type": "twist", "velocity": (0, 0, 0), "turn_rate": (0, 0, 1.0)}
    turned = BOX | {"motion": spin}
    assert found(turned, BALL | {"position": (0, 1.05, 9.5)}, times=(0.0,)) == ()
    (other,) = found(turned, BALL | {"position": (0, 1.05, 9.5)}, times=(0.0, np.pi / 4))
    assert other.depth == pytest.approx(np.sqrt(0.5) + 0.5 - 1.05, abs=POINTS_APART)


def test_only_pairs_that_may_tell_something_new_count(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Claim: parts of one mesh, and what rests at a later time, take no place among the pairs that are looked at: with
    room for one, boxes beside a mesh of two parts are looked at, and a ball that falls into a box beside two others.
    Whatever is looked at counts as 1 m deep here."""
    monkeypatch.setattr(interpenetration, "MOST_PAIRS", 1)
    monkeypatch.setattr(interpenetration, "_depth", lambda *_: 1.0)
    square = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nusemtl a\nf 1 2 3\nusemtl b\nf 1 3 4\n"
    (tmp_path / "two.obj").write_text(square)
    mesh = {"name": "sheet", "mesh": tmp_path / "two.obj", "position": (9, 0, 30), "label_parts": True}
    boxes = BOX, BOX | {"name": "other", "position": (0.9, 0.3, 9.5)}
    (only,) = found(mesh | {"materials": {"default": GREY}}, *boxes)
    assert only.objects == ("box", "other")
    falls = {"position": (5, 0, 8.5), "motion": {"type": "twist", "velocity": (0, 0, 0.1)}}
    seen = found(*boxes, BOX | {"name": "floor", "position": (5, 0, 9.5)}, BALL | falls, times=(0.0, 2.0))
    assert [one.objects for one in seen] == [("box", "other"), ("floor", "ball")]


def hollow_box(folder: Path) -> dict[str, Any]:
    """Return a hollow box of 2 m whose wall is 0.1 m thick, about (0, 0, 9)."""

    def cube(half: float) -> np.ndarray:
        corner = half * (2 * np.indices((2, 2, 2)).reshape(3, -1).T - 1)
        quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        return np.array([corner[list(face)] for a, b, c, d in quads for face in ((a, b, c), (a, c, d))])

    triangles = np.concatenate([cube(1.0), cube(0.9)])
    path = folder / "shell.stl"
    records = b"".join(struct.pack("<12fH", 0, 0, 0, *part.ravel(), 0) for part in triangles)
    path.write_bytes(bytes(80) + struct.pack("<I", len(triangles)) + records)
    return {"name": "shell", "mesh": str(path), "position": (0, 0, 9), "material": GREY}


def test_the_way_out_ends_where_a_solid_is_left_first(tmp_path: Path) -> None:
    """Claim: from within a wall of a hollow box, by its hollow and the wall beyond, a ray leaves 0.05 m on, though it
    meets three surfaces; outwards as well, by one; and from the hollow, by two, it is not inside."""
    loaded = load_scene(Scene(objects=[hollow_box(tmp_path)]))
    (solid,) = interpenetration._solids(loaded)
    points = np.array([[0.95, 0.03, 9.02], [0.95, 0.03, 9.02], [0.5, 0.03, 9.02]])
    directions = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    inside, way, normal = interpenetration._Way(loaded, solid).out(points, directions)
    assert inside.tolist() == [True, True, False]
    np.testing.assert_allclose(way, [0.05, 0.05, 1.4], atol=1e-4)
    np.testing.assert_allclose(normal, directions, atol=1e-6)


def test_a_shell_has_an_inside_only_where_it_is_closed(tmp_path: Path) -> None:
    """Claim: a ball in a hollow box whose wall is 0.1 m stands free; in the wall, or in a solid box, it does not."""
    shell = hollow_box(tmp_path)
    small = BALL | {"diameter": 0.5}
    assert found(shell, small | {"position": (0, 0, 9)}) == ()
    (one,) = found(shell, small | {"position": (0, 0, 9.75)})
    # The inner face lies 0.1 m deep in the ball, its points 0.1 m from one another.
    assert 0.08 < one.depth < 0.1 * (1.0 + FAN)
    (solid,) = found(BOX, small | {"position": (0, 0, 9.5)})
    assert solid.depth == pytest.approx(0.5 - 0.25 / np.sqrt(3.0), rel=FAN)


def test_a_scenario_is_told_in_words() -> None:
    objects = [WALL, BALL]
    scan = {"rows": 4, "columns": 4, "horizontal": [-0.1, 0.1], "vertical": [-0.1, 0.1]}
    (words,) = scene_warnings(
        load_scenario({"schema": 1, "scene": {"objects": objects}, "scan": scan}), device="cpu"
    )
    assert words == "scene: 'wall' and 'ball' stand in one another by about 0.3 m, as no solid bodies do"


def test_what_moves_is_looked_at_at_the_start_in_the_middle_and_at_the_end() -> None:
    """Claim: a ball that flies past is told of with the time at which it is deepest, be that the scan's start, its
    middle or its end; where it meets the box at other times only, it is not.

    Set-up: a scan of 16 s: 4 × 4 voxels at 1 Hz. The ball of 1 m is in the middle of the box of 1 m at the time asked
    and 2 m farther on each 4 s later, which is a metre clear of it.
    """
    given: dict[str, Any] = {
        "schema": 1,
        "scanner": {"rate": "1 Hz"},
        "scan": {"rows": 4, "columns": 4, "horizontal": [-0.1, 0.1], "vertical": [-0.1, 0.1]},
    }
    for met, told in ((0.0, True), (8.0, True), (16.0, True), (4.0, False), (12.0, False)):
        flies = BALL | {
            "position": (-0.5 * met, 0.0, 9.5),
            "motion": {"type": "twist", "velocity": (0.5, 0.0, 0.0)},
        }
        made = load_scenario(given | {"scene": {"objects": [BOX, flies]}})
        assert made.scan.scan_time(made.scan_setup) == 16.0
        said = scene_warnings(made, device="cpu")
        assert len(said) == told
        if told:
            assert "'box' and 'ball' stand in one another" in said[0]
            assert f" at {met:.3g} s" in said[0]


def test_check_and_run_tell_it(small_scenario: str, tmp_path: Path) -> None:
    """Claim: both say it once and go on; of the scenario without the ball they say nothing."""
    (tmp_path / "small.yaml").write_text(small_scenario, encoding="utf-8")
    ball = "{name: ball, shape: sphere, diameter: 1 m, position: [0 m, 0 m, 9.2 m], material: nickel}"
    wall = "{name: wall, shape: rectangle, size: [8 m, 8 m], position: [0 m, 0 m, 9 m], material: nickel}"
    for verb, more in (("check", ()), ("run", ("-o", str(tmp_path / "out")))):
        for objects, times in ((f"[{wall}, {ball}]", 1), (f"[{wall}]", 0)):
            overwrite = ("--overwrite",) if verb == "run" else ()
            change = ("--set", f"scene.objects={objects}")
            told = CliRunner().invoke(app, [verb, str(tmp_path / "small.yaml"), *change, *more, *overwrite])
            assert told.exit_code == 0, told.output
            assert " ".join(told.stderr.split()).count("'wall' and 'ball' stand in one another") == times


def test_a_point_behind_more_surfaces_than_are_looked_through_is_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: a ball 0.2 m deep in a box is found where nine surfaces may be passed, and not where one may."""
    deep = BALL | {"position": (0, 0, 8.7)}
    for most, count in ((9, 1), (1, 0)):
        monkeypatch.setattr(interpenetration, "_MOST_SURFACES", most)
        assert len(found(BOX, deep)) == count


def test_boxes_that_meet_are_looked_at_pair_by_pair() -> None:
    """Claim: of four boxes in a row, which are one wide and stand 0.9, 1.1 and 0.8 apart, the first two and the last
    two meet; their poses count, not where they were drawn."""
    solids: Any = [SimpleNamespace(box=np.array([[-0.5] * 3, [0.5] * 3])) for _ in range(4)]
    poses = [np.eye(4) for _ in solids]
    for pose, place in zip(poses, (0.0, 0.9, 2.0, 2.8), strict=True):
        pose[1, 3] = place
    assert interpenetration._near(solids, poses) == [(0, 1), (2, 3)]
    poses[2][2, 3] = 1.2
    assert interpenetration._near(solids, poses) == [(0, 1)]
    assert interpenetration._near(solids, [np.eye(4)] * 4) == [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]


def test_boxes_turn_with_their_objects() -> None:
    """Claim: a rod from the origin to (2, 0, 0) has its end at 2 (cos t, sin t) when it has turned by t about z: there
    it meets a cube of 0.2 m, and none at the mirror image of that place, where it would be, had it turned the other
    way. So for turns about −y."""
    rod = SimpleNamespace(box=np.array([[0.0, -0.05, -0.05], [2.0, 0.05, 0.05]]))
    cube = SimpleNamespace(box=np.array([[-0.1] * 3, [0.1] * 3]))
    solids: Any = [rod, cube, cube]
    for turn, away in (((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)), ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0))):
        poses = [np.eye(4) for _ in solids]
        poses[0][:3, :3] = Rotation.from_rotvec(0.6 * np.array(turn)).as_matrix()
        for pose in poses:
            pose[:3, 3] = 0.0, 0.3, 9.0
        for pose, side in zip(poses[1:], (1.0, -1.0), strict=True):
            pose[:3, 3] += 2.0 * np.cos(0.6) * np.eye(3)[0] + side * 2.0 * np.sin(0.6) * np.array(away)
        assert interpenetration._near(solids, poses) == [(0, 1)]


def test_a_rod_that_turns_is_found_where_its_end_has_come() -> None:
    """Claim: a rod of 4 m along x that a third of a turn about (1, 1, 1) lays along y stands in a ball about its end by
    then, and not in one about the end that it would have along z, turned the other way."""
    rod = {"name": "rod", "shape": "box", "size": (4.0, 0.2, 0.2), "position": (0, 0, 9), "material": GREY}
    rate = 2.0 * np.pi / 3.0 / np.sqrt(3.0) / 6.0
    rod |= {"motion": {"type": "twist", "velocity": (0, 0, 0), "turn_rate": (rate, rate, rate)}}
    along_y = BALL | {"diameter": 0.3, "position": (0.0, 1.9, 9.0)}
    along_z = along_y | {"name": "other", "position": (0.0, 0.0, 10.9)}
    assert found(rod, along_y, along_z, times=(0.0,)) == ()
    (one,) = found(rod, along_y, along_z, times=(0.0, 6.0))
    assert (set(one.objects), one.time) == ({"rod", "ball"}, 6.0)


def test_directions_of_a_fan_leave_no_side_out() -> None:
    """Claim: the four directions are a tetrahedron's, so that none of them is the mean of others; those of the spiral
    cover the sphere: none of it lies farther from the nearest than the radius of a cap of four times their share."""
    four, even = interpenetration._fan()
    np.testing.assert_allclose(four @ four.T, np.where(np.eye(4) > 0.0, 1.0, -1.0 / 3.0), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(even, axis=1), 1.0, atol=1e-12)
    every = np.random.default_rng(3).normal(size=(20_000, 3))
    every /= np.linalg.norm(every, axis=1, keepdims=True)
    # A cap of the share q of the sphere ends at the cosine 1 − 2q.
    assert (every @ even.T).max(axis=1).min() > 1.0 - 2.0 * 4.0 / len(even)


@pytest.mark.parametrize(("corners", "kept"), [(3000, 3000), (4095, 4095), (4096, 2048), (12_287, 4096)])
def test_of_many_corners_every_so_manyeth_is_looked_up(corners: int, kept: int) -> None:
    """Claim: all corners of a mesh of fewer than 4096; of more an even part, at most 4096; beside 4096 points of it."""
    import mitsuba as mi

    mesh: Any = mi.Mesh("dust", vertex_count=corners, face_count=1)
    at = np.random.default_rng(5).uniform(1.0, 2.0, (corners, 3)).astype(np.float32)
    at[:3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = mi.Float(at.ravel())
    parameters["faces"] = mi.UInt32([0, 1, 2])
    parameters.update()
    points = interpenetration.surface_points([mesh])
    assert len(points) == 4096 + kept
    step = -(-corners // kept)
    np.testing.assert_array_equal(points[4096:], at[::step])
    on = points[:4096]
    assert on.min() >= 0.0
    assert (on[:, 0] + on[:, 1]).max() <= 1.0 + 1e-6
    # Evenly: a quarter of the triangle within half of its height, by a sequence that misses it by a percent at most.
    assert np.mean(on[:, 1] > 0.5) == pytest.approx(0.25, abs=0.01)
