"""Rigid motions: poses at any time, and bad files of poses."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError
from scipy.spatial.transform import Rotation

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.frames import pose_matrix, rotation_about
from scanner_sim.foundation.units import FROM_FILE
from scanner_sim.scene.motion import COLUMNS, read_poses
from scanner_sim.scene.moves import RigidMotion, attitude

START = pose_matrix(rotation_about([0.0, 0.0, 1.0], 0.3), [1.0, 2.0, 10.0])
HEAD = ",".join(COLUMNS)


def motion(**keys: Any) -> Any:
    return TypeAdapter(RigidMotion).validate_python(keys, context=FROM_FILE)


def point(time: str, x: str, angle: str) -> dict[str, Any]:
    return {
        "time": time,
        "position": [x, "0 m", "10 m"],
        "rotation": {"axis": "y", "angle": angle},
    }


def test_a_twist_moves_and_turns_evenly() -> None:
    """10 mm/s and 1 deg/s: after 30 s 0.3 m and half a right angle, about the scanner's axis through the origin."""
    twist = motion(
        type="twist", velocity=["10 mm/s", "0 m/s", "-5 mm/s"], turn_rate=["0 deg/s", "1.5 deg/s", "0 deg/s"]
    )
    poses = twist.scanner_from_object([0.0, 30.0], START)
    np.testing.assert_allclose(poses[0], START, atol=1e-15)
    np.testing.assert_allclose(poses[1, :3, 3], [1.3, 2.0, 9.85], atol=1e-12)
    expected = rotation_about([0.0, 1.0, 0.0], np.pi / 4) @ START[:3, :3]
    np.testing.assert_allclose(poses[1, :3, :3], expected, atol=1e-12)


def test_a_twist_is_a_right_handed_turn() -> None:
    """Positive about y (down) brings x to −z: an object that is right of its origin comes nearer."""
    twist = motion(type="twist", turn_rate=["0 deg/s", "1 deg/s", "0 deg/s"])
    moved = twist.scanner_from_object(1.0, np.eye(4))[0] @ [1.0, 0.0, 0.0, 1.0]
    assert moved[2] == pytest.approx(-np.sin(np.pi / 180.0), rel=1e-12)


def test_linear_waypoints_are_even_between() -> None:
    path = motion(
        type="waypoints",
        interpolation="linear",
        points=[point("1 s", "0 m", "0 deg"), point("3 s", "1 m", "40 deg"), point("4 s", "1 m", "40 deg")],
    )
    poses = path.scanner_from_object([0.0, 1.5, 3.5, 9.0], START)
    np.testing.assert_allclose(poses[:, 0, 3], [0.0, 0.25, 1.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(poses[1, :3, :3], rotation_about([0, 1, 0], np.radians(10.0)), atol=1e-12)
    np.testing.assert_allclose(poses[0, :3, :3], np.eye(3), atol=1e-12)


def test_smooth_waypoints_pass_their_poses_without_a_kink() -> None:
    """The given poses are met; velocity has no step at them and none at the ends; matrices stay rotations."""
    path = motion(
        type="waypoints",
        points=[
            point(f"{t} s", f"{x} m", f"{a} deg")
            for t, x, a in ((0, 0, 0), (1, 1, 30), (3, 0.5, 80), (4, 2, 60))
        ],
    )
    poses = path.scanner_from_object([0.0, 1.0, 3.0, 4.0], START)
    np.testing.assert_allclose(poses[:, 0, 3], [0.0, 1.0, 0.5, 2.0], atol=1e-12)
    np.testing.assert_allclose(
        poses[:, :3, :3], [rotation_about([0, 1, 0], np.radians(a)) for a in (0, 30, 80, 60)], atol=1e-9
    )
    small = 1e-4
    for time in (0.0, 1.0, 3.0, 4.0):
        before, at, after = path.scanner_from_object([time - small, time, time + small], START)
        np.testing.assert_allclose((after - at)[:3, 3], (at - before)[:3, 3], atol=20.0 * small**2)
        if 0.0 < time < 4.0:
            np.testing.assert_allclose((after - at)[:3, :3], (at - before)[:3, :3], atol=20.0 * small**2)
    inside = path.scanner_from_object(np.linspace(0.0, 4.0, 200), START)[:, :3, :3]
    np.testing.assert_allclose(
        inside @ np.swapaxes(inside, 1, 2), np.tile(np.eye(3), (200, 1, 1)), atol=1e-12
    )


def test_a_file_of_poses_is_read(tmp_path: Path) -> None:
    """Columns in any order, quaternions of any length, empty lines passed over."""
    file = tmp_path / "poses.csv"
    names = [*COLUMNS[4:], *COLUMNS[:4]]
    file.write_text(f"{','.join(names)}\n2,0,0,0,0,0,0,5\n\n2,0,2,0,2,1,0,5\n", encoding="utf-8")
    poses = motion(type="file", file=str(file)).scanner_from_object([1.0, 2.0], START)
    np.testing.assert_allclose(poses[:, :3, 3], [[0.5, 0.0, 5.0], [1.0, 0.0, 5.0]])
    np.testing.assert_allclose(poses[1, :3, :3], rotation_about([0, 1, 0], np.pi / 2), atol=1e-12)
    np.testing.assert_allclose(poses[0, :3, :3], rotation_about([0, 1, 0], np.pi / 4), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no column time_s"),
        ("time_s,x_m,y_m,z_m\n0,0,0,0\n", "no column qw, qx, qy, qz"),
        (f"{HEAD}\n0,0,0,5,1,0,0,0\n", "fewer than two poses"),
        (f"{HEAD}\n0,0,0,5,1,0,0,0\n1,0,x,5,1,0,0,0\n", "Row 3 of bad.csv is not a row of numbers"),
        (f"{HEAD}\n0,0,0,5,1,0,0,0\n1,0,0\n", "Row 3 of bad.csv is not a row of numbers"),
        (
            f"{HEAD}\n0,0,0,5,1,0,0,0\n1,0,nan,5,1,0,0,0\n",
            "Row 3 of bad.csv holds a number that is not finite",
        ),
        (f"{HEAD}\n0,0,0,5,0,0,0,0\n1,0,0,5,1,0,0,0\n", "quaternion in row 2 of bad.csv is zero"),
        (f"{HEAD}\n1,0,0,5,1,0,0,0\n1,0,0,5,1,0,0,0\n", "time in row 3 of bad.csv is not after"),
        # What is finite may still have no square, and no rate.
        (f"{HEAD}\n0,0,0,5,1,0,0,0\n1e-200,0,0,5,1,0,0,0\n", "time in row 3 of bad.csv is not after"),
        (f"{HEAD}\n0,0,0,5,1,0,0,0\n1e300,0,0,5,1,0,0,0\n", "time in row 3 of bad.csv is beyond 1e\\+09 s"),
        (f"{HEAD}\n0,0,0,5,1e-300,0,0,0\n1,0,0,5,1,0,0,0\n", "quaternion in row 2 of bad.csv is 1e-300 long"),
        (f"{HEAD}\n0,0,0,5,1,0,0,0\n1,0,0,5,1e300,1e300,0,0\n", "row 3 of bad.csv is 1.41e\\+300 long"),
        (f"{HEAD}\n0,0,0,5,1,0,0,0\n1,0,-1e300,5,1,0,0,0\n", "Row 3 of bad.csv is 1e\\+300 m away"),
        (f"{HEAD}\n0,0,0,5,1,0,0,0\n1,1.001e5,0,5,1,0,0,0\n", "Row 3 of bad.csv is 1e\\+05 m away"),
        (f"{HEAD}\n0,0,0,-1.001e5,1,0,0,0\n1,0,0,5,1,0,0,0\n", "Row 2 of bad.csv is 1e\\+05 m away"),
        (
            f"{HEAD}\n-1.001e9,0,0,5,1,0,0,0\n1,0,0,5,1,0,0,0\n",
            "time in row 2 of bad.csv is beyond 1e\\+09 s",
        ),
    ],
)
def test_bad_files_are_refused_with_the_row(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "bad.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_poses(file)
    with pytest.raises(ValidationError, match=message):
        motion(type="file", file=str(file))


def test_bytes_are_no_table(tmp_path: Path) -> None:
    file = tmp_path / "bad.csv"
    file.write_bytes(b"\xff\xfe\x00\x9c")
    with pytest.raises(InputError, match="no text in UTF-8"):
        read_poses(file)


def test_waypoints_in_the_wrong_order_are_refused() -> None:
    with pytest.raises(ValidationError, match=r"points\[1\].time: 1 s is not after the 2 s"):
        motion(type="waypoints", points=[point("2 s", "0 m", "0 deg"), point("1 s", "1 m", "0 deg")])


def test_waypoints_that_no_rate_connects_are_refused() -> None:
    with pytest.raises(ValidationError, match="not by a nanosecond"):
        motion(type="waypoints", points=[point("0 s", "0 m", "0 deg"), point("5e-324 s", "1 m", "0 deg")])


def test_speeds_are_bounded() -> None:
    with pytest.raises(ValidationError, match="velocity"):
        motion(type="twist", velocity=["1e300 m/s", "0 m/s", "0 m/s"])
    with pytest.raises(ValidationError, match="turn_rate"):
        motion(type="twist", turn_rate=["1e300 deg/s", "0 deg/s", "0 deg/s"])


def test_speeds_need_units() -> None:
    with pytest.raises(ValidationError, match="no unit"):
        motion(type="twist", velocity=[0.01, 0.0, 0.0])
    with pytest.raises(ValidationError):
        motion(type="twist", turn_rate=["1 Hz", "0 deg/s", "0 deg/s"])


def test_moves_hold_from_their_times_on() -> None:
    """Claim: each move counts until the next one and goes on evenly; before the first another motion does, or it."""
    read = TypeAdapter(RigidMotion).validate_python
    first = {"time": 1.0, "position": (1.0, 0.0, 5.0), "velocity": (0.5, 0.0, 0.0)}
    half = math.sqrt(0.5)
    then = {
        "time": 2.0,
        "position": (9.0, 0.0, 5.0),
        "quaternion": (half, 0.0, 0.0, half),
        "turn_rate": (0, 0, 0.1),
    }
    told = read({"type": "moves", "moves": [first, then]})
    poses = told.scanner_from_object([0.0, 1.5, 2.5], np.eye(4))
    np.testing.assert_allclose(poses[:, 0, 3], [0.5, 1.25, 9.0])
    turned = 0.5 * math.pi + 0.05
    np.testing.assert_allclose(poses[2, :2, 0], [math.cos(turned), math.sin(turned)], atol=1e-12)
    np.testing.assert_allclose(poses[:2, :3, :3], np.tile(np.eye(3), (2, 1, 1)), atol=1e-15)
    before = read({"type": "moves", "moves": [first], "before": {"type": "twist", "velocity": (0, 2, 0)}})
    np.testing.assert_allclose(
        before.scanner_from_object([0.5, 1.0], np.eye(4))[:, :3, 3], [[0, 1, 0], [1, 0, 5]]
    )
    one, other = told.moves
    assert [told.in_force(time) for time in (0.5, 1.0, 1.999, 2.0, 9.0)] == [one, one, one, other, other]
    assert [before.in_force(time) for time in (0.999, 1.0)] == [None, one]
    with pytest.raises(ValidationError, match="not after"):
        read({"type": "moves", "moves": [first, first]})
    with pytest.raises(ValidationError, match="no attitude"):
        read({"type": "moves", "moves": [first | {"quaternion": (0, 0, 0, 0)}]})


def test_quaternions_of_any_length_are_attitudes() -> None:
    """Expected: what SciPy makes of them."""
    for w, x, y, z in [(2.0, 0.0, 0.0, 0.0), *np.random.default_rng(5).normal(size=(100, 4)).tolist()]:
        wanted = Rotation.from_quat([x, y, z, w]).as_matrix()
        np.testing.assert_allclose(attitude((w, x, y, z)), wanted, rtol=0.0, atol=1e-15)


def test_a_file_of_poses_reaches_as_far_and_as_late_as_may_be(tmp_path: Path) -> None:
    """Claim: 100 km along each axis and 10⁹ s before and after the start are poses still, in the columns' order."""
    file = tmp_path / "far.csv"
    file.write_text(f"{HEAD}\n-1e9,1e5,-1e5,1e5,1,2,3,4\n1e9,-1e5,1e5,-1e5,-4,3,2,1\n", encoding="utf-8")
    found = read_poses(file)
    np.testing.assert_array_equal(found.time, [-1e9, 1e9])
    np.testing.assert_array_equal(found.position, [[1e5, -1e5, 1e5], [-1e5, 1e5, -1e5]])
    np.testing.assert_array_equal(found.quaternion, [[1, 2, 3, 4], [-4, 3, 2, 1]])


def test_a_file_has_so_many_poses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "many.csv"
    rows = "".join(f"{time},0,0,5,1,0,0,0\n" for time in range(23))
    file.write_text(f"{HEAD}\n{rows}", encoding="utf-8")
    monkeypatch.setattr("scanner_sim.scene.motion.MOST_ROWS", 23)
    assert len(read_poses(file).time) == 23
    monkeypatch.setattr("scanner_sim.scene.motion.MOST_ROWS", 22)
    with pytest.raises(InputError, match="more than 22 rows"):
        read_poses(file)
