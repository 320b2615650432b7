"""CCSDS orbits and attitudes: two circular orbits in closed form are written as files, read, and met again."""

from __future__ import annotations

import datetime
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scanner_sim.foundation.errors import InputError
from scanner_sim.scene.ccsds import parse_epoch, read_attitude, read_orbit
from scanner_sim.scene.ephemeris import EphemerisMotion, _RelativePath

RADIUS, SPEED = 6.8e6, 7656.0
RATE = SPEED / RADIUS
BEGIN = datetime.datetime(2026, 3, 20, 12)
TILT = 0.9
AHEAD = 15.0 / RADIUS
"""The target flies 15 m ahead, along the arc."""


def place(time: float, ahead: float) -> np.ndarray:
    turn = RATE * time + ahead
    return RADIUS * np.array([np.cos(turn), np.sin(turn) * np.cos(TILT), np.sin(turn) * np.sin(TILT)])


def velocity(time: float, ahead: float) -> np.ndarray:
    turn = RATE * time + ahead
    return SPEED * np.array([-np.sin(turn), np.cos(turn) * np.cos(TILT), np.cos(turn) * np.sin(TILT)])


def body(time: float, ahead: float) -> Rotation:
    """EME2000 from the body: z along the way, y down to the Earth."""
    along, down = velocity(time, ahead) / SPEED, -place(time, ahead) / RADIUS
    return Rotation.from_matrix(np.stack([np.cross(down, along), down, along], axis=1))


def orbit_file(
    path: Path,
    ahead: float,
    *,
    step: int = 30,
    interpolation: str = "HERMITE",
    degree: int = 7,
    since: int = 0,
) -> Path:
    lines = [
        "CCSDS_OEM_VERS = 2.0", "CREATION_DATE = 2026-01-01T00:00:00", "ORIGINATOR = TEST", "META_START",
        "OBJECT_NAME = A", "OBJECT_ID = 2026-001A", "CENTER_NAME = EARTH", "REF_FRAME = EME2000", "TIME_SYSTEM = UTC",
        "START_TIME = 2026-03-20T12:00:00", "STOP_TIME = 2026-03-20T12:20:00", f"INTERPOLATION = {interpolation}",
        f"INTERPOLATION_DEGREE = {degree}", "META_STOP", "COMMENT a remark",
    ]  # fmt: skip
    for second in range(since, 1201, step):
        row = [*place(second, ahead) / 1e3, *velocity(second, ahead) / 1e3]
        epoch = (BEGIN + datetime.timedelta(seconds=second)).isoformat()
        lines.append(f"{epoch} " + " ".join(f"{value:.12f}" for value in row))
    path.write_text("\n".join([*lines, "COVARIANCE_START", "1.0", "COVARIANCE_STOP"]))
    return path


def attitude_file(
    path: Path,
    ahead: float,
    *,
    frames: str = "EME2000 SC_BODY_1",
    direction: str = "A2B",
    first: bool = False,
    more: tuple[str, ...] = (),
    since: int = 0,
) -> Path:
    a, b = frames.split()
    lines = [
        "CCSDS_AEM_VERS = 1.0", "CREATION_DATE = 2026-01-01T00:00:00", "ORIGINATOR = TEST", "META_START",
        "OBJECT_NAME = A", "OBJECT_ID = 2026-001A", f"REF_FRAME_A = {a}", f"REF_FRAME_B = {b}",
        f"ATTITUDE_DIR = {direction}", "TIME_SYSTEM = UTC", "START_TIME = x", "STOP_TIME = x",
        "ATTITUDE_TYPE = QUATERNION", f"QUATERNION_TYPE = {'FIRST' if first else 'LAST'}", *more,
        "META_STOP", "DATA_START",
    ]  # fmt: skip
    for second in range(since, 1201, 5):
        # Which of a body's two quaternions stands there is chance: every other one has the other sign.
        quaternion = (-1.0) ** (second % 2) * body(second, ahead).as_quat()
        if (direction == "B2A") != (b == "EME2000"):
            quaternion = quaternion * [-1.0, -1.0, -1.0, 1.0]
        row = np.roll(quaternion, 1) if first else quaternion
        epoch = (BEGIN + datetime.timedelta(seconds=second)).strftime("%Y-%jT%H:%M:%SZ")
        lines.append(f"{epoch} " + " ".join(f"{value:.13f}" for value in row))
    path.write_text("\n".join([*lines, "DATA_STOP"]))
    return path


@pytest.mark.parametrize(
    "spelling",
    [{}, {"direction": "B2A"}, {"frames": "SC_BODY_1 EME2000"}, {"frames": "SC_BODY_1 EME2000", "direction": "B2A"},
     {"first": True}, {"more": ("INTERPOLATION_METHOD = LAGRANGE", "INTERPOLATION_DEGREE = 7")}],
)  # fmt: skip
def test_the_relative_pose_is_that_of_the_orbits(spelling: dict, tmp_path: Path) -> None:
    """Claim: the target is where two closed forms put it, within what Hermite's polynomials and the digits leave.

    The digits are 1e-12 km. Hermite of degree 7 over 30 s errs by h⁸/8! · (3/2)² (1/2)² … n⁸ r, below a nanometre here;
    slerp over 5 s of a body that turns evenly is exact.
    """
    motion = EphemerisMotion(
        type="ccsds",
        orbit=orbit_file(tmp_path / "t.oem", AHEAD),
        attitude=attitude_file(tmp_path / "t.aem", AHEAD, **spelling),
        scanner={
            "orbit": orbit_file(tmp_path / "c.oem", 0.0),
            "attitude": attitude_file(tmp_path / "c.aem", 0.0, **spelling),
            "position": (0.0, 0.2, 1.0),
            "rotation": {"axis": "z", "angle": 0.5},
        },
        start="2026-03-20T12:05:07.25",
    )
    time = np.array([0.0, 11.3, 400.7])
    poses = motion.scanner_from_object(time, np.eye(4))
    for pose, at in zip(poses, time + 307.25, strict=True):
        chaser, mount = body(at, 0.0), Rotation.from_rotvec([0.0, 0.0, 0.5])
        apart = mount.inv().apply(chaser.inv().apply(place(at, AHEAD) - place(at, 0.0)) - [0.0, 0.2, 1.0])
        np.testing.assert_allclose(pose[:3, 3], apart, atol=5e-8)
        turned = (mount.inv() * chaser.inv() * body(at, AHEAD)).as_matrix()
        np.testing.assert_allclose(pose[:3, :3], turned, atol=1e-11)


@pytest.mark.parametrize(
    "begins", [(30, 65, 90, 125), (120, 85, 60, 25), (60, 0, 30, 95), (0, 120, 90, 30)], ids=str
)
def test_each_file_may_begin_at_an_epoch_of_its_own(
    begins: tuple[int, int, int, int], tmp_path: Path
) -> None:
    """Claim: a pose is that of both closed forms at its time, whichever of the four files begins first: the scan begins
    where the last of them does. Tolerances: as above."""
    orbit, attitude, carrier, turned = begins
    motion = EphemerisMotion(
        type="ccsds",
        orbit=orbit_file(tmp_path / "t.oem", AHEAD, since=orbit),
        attitude=attitude_file(tmp_path / "t.aem", AHEAD, since=attitude),
        scanner={
            "orbit": orbit_file(tmp_path / "c.oem", 0.0, since=carrier),
            "attitude": attitude_file(tmp_path / "c.aem", 0.0, since=turned),
        },
    )
    time = np.array([0.0, 7.3, 400.7])
    poses = motion.scanner_from_object(time, np.eye(4))
    for pose, at in zip(poses, time + max(begins), strict=True):
        chaser = body(at, 0.0).inv()
        apart = chaser.apply(place(at, AHEAD) - place(at, 0.0))
        np.testing.assert_allclose(pose[:3, 3], apart, atol=5e-8)
        np.testing.assert_allclose(pose[:3, :3], (chaser * body(at, AHEAD)).as_matrix(), atol=1e-11)


@pytest.mark.parametrize(
    ("method", "degree", "error"), [("LAGRANGE", 7, 1e-5), ("LINEAR", 1, 1e3), ("HERMITE", 3, 0.1)]
)
def test_interpolation_is_the_one_that_the_file_names(
    method: str, degree: int, error: float, tmp_path: Path
) -> None:
    """Between epochs 30 s apart: linear errs by h² n² r / 8 = 970 m, cubic Hermite by h⁴ n⁴ r / 384 = 23 mm."""
    orbit_file(tmp_path / "t.oem", AHEAD, interpolation=method, degree=degree)
    orbit_file(tmp_path / "c.oem", 0.0)
    motion = EphemerisMotion(
        type="ccsds",
        orbit=tmp_path / "t.oem",
        scanner={"orbit": tmp_path / "c.oem", "attitude": attitude_file(tmp_path / "c.aem", 0.0)},
    )
    found = motion.scanner_from_object(615.0, np.eye(4))[0, :3, 3]
    off = float(np.linalg.norm(found - body(615.0, 0.0).inv().apply(place(615.0, AHEAD) - place(615.0, 0.0))))
    assert error * (1e-6 if method == "LAGRANGE" else 0.1) * (method != "LAGRANGE") <= off <= error


@pytest.mark.parametrize(
    ("file", "was", "now", "words"),
    [
        *((file, "= UTC", "= TAI", f"{key} counts time in TAI, and orbit in UTC")
          for file, key in (("t.aem", "attitude"), ("c.oem", "scanner.orbit"), ("c.aem", "scanner.attitude"))),
        ("c.oem", "= EARTH", "= MOON", "scanner.orbit is in EME2000 about MOON, and orbit in EME2000 about EARTH"),
        ("c.oem", "= EME2000", "= TEME", "scanner.orbit is in TEME about EARTH, and orbit in EME2000 about EARTH"),
    ],
)  # fmt: skip
def test_files_that_do_not_belong_together_are_refused(
    file: str, was: str, now: str, words: str, tmp_path: Path
) -> None:
    """Claim: every file counts time as the object's orbit does, and both orbits are in one frame about one centre."""
    for name in ("t", "c"):
        orbit_file(tmp_path / f"{name}.oem", AHEAD)
        attitude_file(tmp_path / f"{name}.aem", AHEAD)
    motion = EphemerisMotion(
        type="ccsds",
        orbit=tmp_path / "t.oem",
        attitude=tmp_path / "t.aem",
        scanner={"orbit": tmp_path / "c.oem", "attitude": tmp_path / "c.aem"},
    )
    motion.scanner_from_object(0.0, np.eye(4))
    (tmp_path / file).write_text((tmp_path / file).read_text().replace(was, now))
    with pytest.raises(InputError, match=words):
        motion.model_copy().scanner_from_object(0.0, np.eye(4))


def test_a_leap_second_is_counted() -> None:
    before, after = (parse_epoch(text, "UTC") for text in ("2016-12-31T23:59:59", "2017-01-01T00:00:01"))
    assert after.since(before) == pytest.approx(3.0)
    assert parse_epoch("2016-366T23:59:60.5", "UTC").since(before) == pytest.approx(1.5)
    assert parse_epoch("2017-01-01T00:00:01", "TAI").since(parse_epoch("2016-12-31T23:59:59", "TAI")) == 2.0
    # Leap seconds of the years to come nobody knows yet; that is no warning, which is an error here.
    before, after = (parse_epoch(text, "UTC") for text in ("2099-12-31T23:59:59", "2100-01-01T00:00:01"))
    assert after.since(before) == 2.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace("CCSDS_OEM_VERS", "<oem>"), "line 1 .*KVN"),
        (lambda text: text.replace("TIME_SYSTEM = UTC\n", ""), "line 13 .*lack TIME_SYSTEM"),
        (lambda text: text.replace("= UTC", "= MET"), "line 14 .*time system"),
        (lambda text: text.replace("T12:00:30", "T12:00:00"), "line 17 .*not after"),
        (lambda text: text.replace("T12:00:30", "T25:00:30"), "line 17 .*no epoch"),
        (lambda text: text.replace("T12:00:30 ", "T12:00:30 nan "), "line 17 .*not finite"),
        (lambda text: text.replace("T12:00:30 ", "T12:00:30 x "), "line 17 .*not a number"),
        (lambda text: text.replace("T12:00:30 ", "T12:00:30 1.0 "), "line 17 .*7 numbers"),
        (lambda text: text[: text.index("2026-03-20T12:00:30")], "fewer than two epochs"),
    ],
)
def test_faults_have_their_line(change: Callable[[str], str], words: str, tmp_path: Path) -> None:
    path = orbit_file(tmp_path / "t.oem", 0.0)
    path.write_text(change(path.read_text()))
    with pytest.raises(InputError, match=words):
        read_orbit(path)


def test_attitudes_have_faults_with_lines_too(tmp_path: Path) -> None:
    path = attitude_file(tmp_path / "t.aem", 0.0)
    text = path.read_text()
    path.write_text(text.replace("TYPE = QUATERNION\n", "TYPE = EULER_ANGLE\n"))
    with pytest.raises(InputError, match=r"line 17 .*EULER_ANGLE"):
        read_attitude(path)
    path.write_text(text.replace("2026-079T12:00:05Z ", "2026-079T12:00:05Z 9"))
    with pytest.raises(InputError, match=r"line 18 .*long, not 1"):
        read_attitude(path)


def test_files_must_belong_together(tmp_path: Path) -> None:
    orbit = orbit_file(tmp_path / "t.oem", AHEAD)
    with pytest.raises(ValueError, match="nothing says where the scanner is"):
        EphemerisMotion(type="ccsds", orbit=orbit)
    other = {"orbit": orbit_file(tmp_path / "c.oem", 0.0), "attitude": attitude_file(tmp_path / "c.aem", 0.0)}
    with pytest.raises(ValueError, match="Choose a start between"):
        EphemerisMotion(type="ccsds", orbit=orbit, scanner=other, start="2026-03-20T13:00:00")
    text = orbit.read_text()
    orbit.write_text(text.replace("EME2000", "TEME"))
    with pytest.raises(ValueError, match="in one frame"):
        EphemerisMotion(type="ccsds", orbit=orbit, scanner=other)
    orbit.write_text(text.replace("= UTC", "= GPS"))
    with pytest.raises(ValueError, match="one time system"):
        EphemerisMotion(type="ccsds", orbit=orbit, scanner=other)


def test_an_orbit_about_the_scanner_needs_no_other(tmp_path: Path) -> None:
    """A file of relative motion: its frame is the scanner's."""
    path = orbit_file(tmp_path / "t.oem", 0.0)
    lines = path.read_text().replace("= EARTH", "= CHASER").split("\n")[:15]
    lines += [f"2026-03-20T12:00:{second:02d} 0 0 {0.010 - 1e-4 * second} 0 0 -1e-4" for second in range(9)]
    path.write_text("\n".join(lines))
    motion = EphemerisMotion(type="ccsds", orbit=path)
    found = motion.scanner_from_object([0.0, 2.5, 99.0], np.eye(4))
    np.testing.assert_allclose(found[:, 2, 3], [10.0, 9.75, 9.2], atol=1e-9)


def test_what_files_have_in_common_is_from_the_last_start_to_the_first_end() -> None:
    """Claim: in seconds since the scan's start, which is some seconds after the first epoch of the orbit's file."""

    def file(start: float, length: float) -> Any:
        return SimpleNamespace(
            start=SimpleNamespace(since=lambda other, own=start: own - other.at, at=start),
            segments=[
                SimpleNamespace(time=np.array([0.0, 1.0])),
                SimpleNamespace(time=np.array([2.0, length])),
            ],
        )

    orbit, attitude = file(100.0, 60.0), file(130.0, 90.0)
    found = _RelativePath._common({"orbit": orbit, "attitude": attitude}, orbit, 20.0)
    assert found == pytest.approx((10.0, 40.0))


@pytest.mark.parametrize("degree", [2, 3, 5])
def test_a_polynomial_of_the_files_degree_is_met_exactly(degree: int, tmp_path: Path) -> None:
    """Claim: Lagrange's interpolation of degree d passes any polynomial of degree d, of the place and of the
    quaternion's parts, between all of its epochs; one of a degree more it does not, so that the test can fail."""
    span = 11
    meta = [f"INTERPOLATION_METHOD = LAGRANGE\nINTERPOLATION_DEGREE = {degree}"]
    orbit = orbit_file(tmp_path / "t.oem", 0.0, interpolation="LAGRANGE", degree=degree)
    lines = orbit.read_text().replace("= EARTH", "= CHASER").split("\n")[:15]
    attitude = attitude_file(tmp_path / "t.aem", 0.0, more=tuple(meta))
    turns = attitude.read_text().split("\n")
    turns = turns[: turns.index("DATA_START") + 1]
    for power in (degree, degree + 1):
        rows, bodies = list(lines), list(turns)
        for second in range(span + 1):
            epoch, part = f"2026-03-20T12:00:{second:02d}", (second / span) ** power
            rows.append(f"{epoch} {0.002 * part:.15f} {-0.003 * part:.15f} {0.01 + 0.001 * part:.15f} 0 0 0")
            bodies.append(f"{epoch} {0.02 * part:.15f} {-0.03 * part:.15f} 0.0 1.0")
        orbit.write_text("\n".join(rows))
        attitude.write_text("\n".join([*bodies, "DATA_STOP"]))
        # One file of each text: what was read is known by its time and length.
        motion = EphemerisMotion(
            type="ccsds",
            orbit=orbit.rename(tmp_path / f"{power}.oem"),
            attitude=attitude.rename(tmp_path / f"{power}.aem"),
        )
        time = np.array([0.0, 0.3, 1.7, 4.5, 5.5, 8.2, 10.9, 11.0])
        part = (time / span) ** power
        poses = motion.scanner_from_object(time, np.eye(4))
        place_off = poses[:, :3, 3] - np.outer(part, [2.0, -3.0, 1.0]) - [0.0, 0.0, 10.0]
        wanted = Rotation.from_quat(np.outer(part, [0.02, -0.03, 0.0, 0.0]) + np.eye(4)[3])
        turn_off = Rotation.from_matrix(poses[:, :3, :3]) * wanted.inv()
        exact = np.abs(place_off).max() < 1e-9, turn_off.magnitude().max() < 1e-9
        assert exact == (power == degree, power == degree)


def lines_of(
    path: Path, times: list[float], polynomial: Callable[[float], list[float]], *, more: int = 0
) -> None:
    """Write an orbit of segments of a relative motion, each with its own epochs [s], between which it is linear."""
    head = "META_START\nCENTER_NAME = CHASER\nREF_FRAME = LVLH\nTIME_SYSTEM = TAI\nINTERPOLATION = LINEAR\nMETA_STOP\n"
    parts = [times] if not more else [times[: more + 1], times[more:]]
    text = "CCSDS_OEM_VERS = 2.0\n"
    for part in parts:
        text += head
        for time in part:
            row = " ".join(f"{1e-3 * value:.12f}" for value in polynomial(time))
            text += f"2026-03-20T12:00:{time:09.6f} {row} 0 0 0\n"
    path.write_text(text)


def test_each_segment_serves_its_own_times(tmp_path: Path) -> None:
    """Claim: in a file of segments that touch, times are met by the epochs of the segment in which they lie, so that a
    kink between two is one, and a file of one segment of all epochs gives the same."""
    times = [0.0, 2.0, 5.0, 9.0, 11.0]

    def kinked(time: float) -> list[float]:
        return [time, abs(time - 5.0) ** 1.5, 10.0 + np.sin(time)]

    time = np.array([0.0, 1.0, 3.5, 4.99, 5.0, 5.01, 7.0, 10.5, 11.0])
    wanted = np.stack(
        [np.interp(time, times, [kinked(at)[axis] for at in times]) for axis in range(3)], axis=1
    )
    for more in (0, 2, 3):
        path = tmp_path / f"{more}.oem"
        lines_of(path, times, kinked, more=more)
        found = EphemerisMotion(type="ccsds", orbit=path).scanner_from_object(time, np.eye(4))
        np.testing.assert_allclose(found[:, :3, 3], wanted, atol=1e-8)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize(
    ("away", "possible"), [(0.999e5, True), (-0.999e5, True), (1.001e5, False), (-1.001e5, False)]
)
def test_an_object_begins_within_a_hundred_kilometres(
    axis: int, away: float, possible: bool, tmp_path: Path
) -> None:
    """Claim: each coordinate at the start is within the farthest that a scene holds; the message has it."""
    path = tmp_path / "far.oem"
    lines_of(path, [0.0, 10.0], lambda _: [away if at == axis else 10.0 for at in range(3)])
    if possible:
        found = EphemerisMotion(type="ccsds", orbit=path).scanner_from_object(5.0, np.eye(4))
        assert found[0, axis, 3] == pytest.approx(away)
        return
    with pytest.raises(ValueError, match=r"1e\+05 m from the scanner at the start"):
        EphemerisMotion(type="ccsds", orbit=path)


def test_files_that_only_touch_have_no_time_in_common(tmp_path: Path) -> None:
    """Claim: an attitude that begins where the orbit ends leaves no time; one that begins before leaves what both hold,
    and the pose is held at its ends."""
    path, attitude = tmp_path / "a.oem", tmp_path / "a.aem"
    lines_of(path, [0.0, 4.0, 8.0], lambda time: [time, 0.0, 10.0])
    for first, possible in ((8.0, False), (5.0, True)):
        head = (
            "CCSDS_AEM_VERS = 1.0\nMETA_START\nREF_FRAME_A = LVLH\nREF_FRAME_B = BODY\nTIME_SYSTEM = TAI\n"
            "ATTITUDE_TYPE = QUATERNION\nMETA_STOP\n"
        )
        rows = "".join(f"2026-03-20T12:00:{first + 3 * row:09.6f} 0 0 0 1\n" for row in range(2))
        attitude.write_text(head + rows + " " * int(first))
        if not possible:
            with pytest.raises(ValueError, match="no time in common"):
                EphemerisMotion(type="ccsds", orbit=path, attitude=attitude)
            continue
        motion = EphemerisMotion(type="ccsds", orbit=path, attitude=attitude)
        found = motion.scanner_from_object([-9.0, 0.0, 1.5, 3.0, 99.0], np.eye(4))
        np.testing.assert_allclose(found[:, 0, 3], [5.0, 5.0, 6.5, 8.0, 8.0], atol=1e-9)
