"""``scan.tracker.start: camera``, and what a calibration of the camera leaves open."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scanner_sim import load_scenario
from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.foundation.errors import ScenarioError
from scanner_sim.instrument import camera_poses
from scanner_sim.instrument.camera_poses import (
    _Follower,
    camera_series,
    expected_pose,
    frame_calibration,
)
from scanner_sim.instrument.closed_loop import start
from scanner_sim.instrument.closed_loop.start import _place, start_of
from scanner_sim.optics.pixel_window import PixelWindow
from scanner_sim.pose.status import PoseStatus
from scanner_sim.ranging.coordinates import angles_and_range
from scanner_sim.tracking.prediction import predict

pytestmark = pytest.mark.usefixtures("device")

OFFSET = ["15 mrad", "-10 mrad", "0.2 m"]


def scenario(**changes: Any) -> Scenario:
    """An array of four dots at 5 m before a small camera, looked for in a wrong place."""
    blocks: dict[str, Any] = {
        "schema": 1,
        "seed": 3,
        "scene": {
            "objects": [
                {
                    "name": "panel",
                    "array": {"diameter": "100 mm", "plate": "300 mm", "rows": 2, "columns": 2,
                              "spacing": ["0.6 m", "0.6 m"]},
                    "position": ["0.1 m", "-0.05 m", "5 m"],
                    "rotation": {"axis": [1, 2, 0], "angle": "15 deg"},
                }
            ]
        },
        "lighting": {"sun": {"direction": [0.3, -0.5, -0.8]}},
        "scan": {
            "type": "track",
            "duration": "0.3 s",
            "targets": [{"target": "panel", "offset": OFFSET}],
            "tracker": {"start": "camera"},
        },
        "camera": {
            "interior": {"columns": 160, "rows": 120, "pixel_pitch": "30 um"},
            "lens": {"aberration": "15 um"},
            "exposure": {"type": "fixed", "time": "0.03 ms"},
            "sampling": {"edge_samples": 256, "bounces": 1},
        },
    }  # fmt: skip
    return load_scenario(blocks | changes)


def test_the_search_begins_where_a_frame_shows_the_targets() -> None:
    """Claim: the first search points at the true places within 5 σ of the camera's pose, when the frame can be read."""
    made = scenario()
    state = start_of(made, "cpu")
    assert not state.said
    assert state.clock == pytest.approx(0.03e-3 + made.camera.latency)
    pose = made.scene.objects[0].pose_at(0.0)[0]
    for target, track in zip(made.targets, state.tracks, strict=True):
        x, y, z = pose[:3, :3] @ target.centre + pose[:3, 3]
        distance, theta, phi = angles_and_range(x, y, z, made.scanner.mirrors.axis_separation)
        off = track.motion.mean[:3] - [theta, phi, distance]
        assert (np.abs(off) < 5.0 * np.sqrt(np.diagonal(track.motion.covariance)[:3])).all()
        assert (np.abs(off) < [1e-3, 1e-3, 50e-3]).all()
        np.testing.assert_array_equal(track.expected, target.expected)


def test_a_target_may_have_moved_since_the_frame_was_exposed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: where a search begins, var = var(pose) + var(rate) t² + q t³/3, with t from the exposure to when the frame
    can be read, and the density q of the acceleration."""
    exposed, readable, known = 0.02, 0.35, np.diag([4e-8, 9e-8, 1e-4, 1e-8, 1e-8, 1e-8])
    panel = SimpleNamespace(
        name="panel", time=np.array([exposed]), status=np.array([PoseStatus.VALID]),
        rotation=np.eye(3)[None], position=np.array([[0.1, -0.05, 5.0]]), covariance=known[None],
    )  # fmt: skip
    frame = SimpleNamespace(available_s=np.array([readable]))
    monkeypatch.setattr(start, "take_frames", lambda *given, **more: frame)
    monkeypatch.setattr(start, "camera_poses", lambda *given, **more: [panel])
    settings = (made := scenario()).following.tracker
    state = start_of(made)
    assert state.clock == readable
    rate = np.array([settings.fastest, settings.fastest, settings.fastest_range])
    density = np.array([settings.acceleration_psd] * 2 + [settings.range_acceleration_psd])
    moved = rate**2 * (readable - exposed) ** 2 + density * (readable - exposed) ** 3 / 3.0
    pose: Any = panel
    for target, track in zip(made.targets, state.tracks, strict=True):
        begun = np.diagonal(_place(made, pose, target)[1])
        found = np.diagonal(predict(track.motion, state.clock, density).covariance)
        np.testing.assert_allclose(found[:3], begun + moved, rtol=1e-9)


def test_without_a_pose_it_begins_where_it_is_expected_and_says_so() -> None:
    made = scenario(lighting={"sun": {"direction": [0.1, -0.2, 0.9]}})
    state = start_of(made, "cpu")
    (said,) = state.said
    assert "'panel'" in said
    for target, track in zip(made.targets, state.tracks, strict=True):
        np.testing.assert_array_equal(track.motion.mean[:3], target.expected)


def test_a_camera_that_cannot_begin_is_a_fault() -> None:
    with pytest.raises(ScenarioError, match=r"scan\.tracker\.start"):
        scenario(lighting={})


def test_where_it_is_expected_is_the_true_place_and_what_is_added_to_it() -> None:
    scan = {"type": "track", "targets": ["panel"]}
    rotation, position = expected_pose(made := scenario(scan=scan), made.arrays_followed[0])
    np.testing.assert_allclose(position, [0.1, -0.05, 5.0], atol=1e-9)
    np.testing.assert_allclose(rotation, made.scene.objects[0].pose_at(0.0)[0, :3, :3])


@pytest.mark.slow
def test_what_the_calibration_leaves_open_lasts() -> None:
    """Claim: a focal length known to 1 % makes the depth doubtful by 1 % of it in all frames; nothing else lasts.

    Set-up: three frames, the first in a window about the expected place; noise may leave a frame a second pose. Errors
    stay within 5 σ.
    """
    camera = {**scenario().model_dump(mode="json")["camera"], "frame_rate": "10 Hz"}
    scan = {"type": "track", "duration": "0.3 s", "targets": ["panel"]}
    known = scenario(scan=scan, pose={"methods": ["camera"]}, camera=camera)
    doubted = known.replace({"camera.calibration.focal_length": 0.01 * 12e-3})
    (sure,), (open_,) = (camera_series(one, 0.3, device="cpu") for one in (known, doubted))
    assert np.isin(open_.status, (PoseStatus.VALID, PoseStatus.AMBIGUOUS)).all()
    np.testing.assert_array_equal(open_.status, sure.status)
    np.testing.assert_array_equal(open_.position, sure.position)
    np.testing.assert_allclose(open_.covariance - open_.lasting, sure.covariance, atol=1e-15)
    np.testing.assert_allclose(np.sqrt(open_.lasting[:, 2, 2]), 0.05, rtol=0.03)
    assert np.abs(sure.lasting).max() == 0.0
    assert np.abs(sure.error / sure.sigma).max() < 5.0


def test_a_frame_is_looked_at_where_the_array_is_said_to_be() -> None:
    """Claim: camera_from_object = scanner_from_camera⁻¹ scanner_from_object, as matrices of 4 × 4."""
    made = scenario(
        camera={
            "interior": {"columns": 160, "rows": 120, "pixel_pitch": "30 um"},
            "mount": {
                "position": ["0.2 m", "-0.3 m", "0.1 m"],
                "rotation": {"axis": [0, 1, 2], "angle": "9 deg"},
            },
        }
    )
    item = made.scene.objects[0]
    pose = item.pose_at(0.0)[0]
    found = _Follower(made, item, (pose[:3, :3], pose[:3, 3]))._predicted
    wanted = np.linalg.inv(made.camera.scanner_from_camera) @ pose
    assert found is not None
    np.testing.assert_allclose(found[0], wanted[:3, :3], atol=1e-12)
    np.testing.assert_allclose(found[1], wanted[:3, 3], atol=1e-12)


@pytest.mark.parametrize(("ambiguous", "posed"), [(False, True), (True, True), (False, False)])
def test_a_frame_is_followed_from_a_pose_that_is_sure(
    monkeypatch: pytest.MonkeyPatch, ambiguous: bool, posed: bool
) -> None:
    """Claim: targets have the centres and covariances of the dots that are named for them, the others none; the pose
    is where the next frame is looked at, unless there is none or dots have two meanings."""
    rng = np.random.default_rng(4)
    made = scenario()
    pose = SimpleNamespace(rotation=Rotation.random(rng=rng).as_matrix(), position=np.array([0.1, 0.2, 4.0]))
    dots: Any = SimpleNamespace(
        centre=rng.uniform(0.0, 99.0, (5, 2)),
        covariance=rng.normal(size=(5, 2, 2)),
        shape=rng.normal(size=(5, 3)),
    )
    named = SimpleNamespace(
        dot=np.array([3, -1, 0, 2]), status=np.arange(4), pose=pose if posed else None, ambiguous=ambiguous
    )
    monkeypatch.setattr(camera_poses, "identify", lambda *given, **more: named)
    follower = _Follower(made, made.arrays_followed[0])
    seen = follower.look_at(dots)
    for found, told in (
        (seen.centre, dots.centre),
        (seen.covariance, dots.covariance),
        (seen.shape, dots.shape),
    ):
        np.testing.assert_array_equal(found[[0, 2, 3]], told[[3, 0, 2]])
        assert np.isnan(found[1]).all()
    assert seen.status.tolist() == [0, 1, 2, 3]
    if posed and not ambiguous:
        assert follower._predicted == (pose.rotation, pose.position)
        assert follower.window is not None
    else:
        assert follower._predicted is None
        assert follower.window is None


@pytest.mark.parametrize(("columns", "rows"), [(900, 700), (900, 160), (160, 900)])
def test_the_window_of_a_frame_holds_its_dots_with_room_to_move(columns: int, rows: int) -> None:
    """Claim: it goes 24 px and twice the largest half axis beyond the middles of all dots, whose rims are imaged by the
    pinhole's equation, to the pixel, and no farther than the frame; without a pose there is no window."""
    camera = {"interior": {"columns": columns, "rows": rows, "pixel_pitch": "8 um", "focal_length": "9 mm"}}
    made = scenario(camera=camera)
    item = made.scene.objects[0]
    pose = item.pose_at(0.0)[0]
    assert _Follower(made, item).window is None
    window = _Follower(made, item, (pose[:3, :3], pose[:3, 3])).window
    assert window is not None
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    circle = 0.05 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)
    middles, longest = [], 0.0
    for target in made.targets:
        x, y, z = ((circle + target.centre) @ pose[:3, :3].T + pose[:3, 3]).T
        principal = 0.5 * np.array([columns - 1, rows - 1])
        rim = principal + 1125.0 * np.stack([x / z, y / z], axis=-1)
        middles.append(rim[:-1].mean(axis=0))
        longest = max(longest, 0.5 * float(np.linalg.norm(rim - rim[:, None], axis=-1).max()))
    sides = ((window.left, window.right, columns), (window.top, window.bottom, rows))
    for axis, (first, end, size) in enumerate(sides):
        places = np.array(middles)[:, axis]
        low = float(places.min()) - 24.0 - 2.0 * longest - 0.5
        high = float(places.max()) + 24.0 + 2.0 * longest + 0.5
        assert (low < 0.0 and high > size) is (size == 160)
        assert first == (0 if low < 0.0 else pytest.approx(low, abs=0.6))
        assert end == (size if high > size else pytest.approx(high + 1.0, abs=0.6))


def test_what_is_believed_of_frames_is_on_the_data_sheet() -> None:
    """Claim: black is the level and the dark charge of the exposure; what is full is the well or the converter's end,
    whichever comes first; the blur is the lens's in pixels."""
    sensor = {"black_level": 12, "dark_current": 2000.0, "gain": 20.0, "full_well": 12_345.0}
    camera = VideoCamera.model_validate({"sensor": {**sensor, "read_noise": 17.0, "prnu": 0.01, "bits": 10}})
    found = frame_calibration(camera, 0.02)
    assert found.black == pytest.approx(12.0 + 2000.0 * 0.02 / 20.0)
    assert found.saturation == 12 + 617
    assert (found.electrons_per_number, found.read_noise, found.uneven) == (20.0, 17.0, 0.01)
    assert found.blur == pytest.approx(camera.lens.point_spread / camera.interior.pixel_pitch)
    deep = VideoCamera.model_validate({"sensor": {**sensor, "full_well": 1e5, "bits": 10}})
    assert frame_calibration(deep, 0.02).saturation == 1023.0


def test_dots_of_a_window_stand_in_their_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: what was not looked at is left out, σ of the light counts in digital numbers, and the exposure is the
    frame's own; centres count from the frame's first pixel, not from the window's."""
    camera = VideoCamera.model_validate({"sensor": {"gain": 25.0, "dark_current": 2000.0}})
    counts = np.random.default_rng(2).integers(0, 999, (2, 10, 12)).astype(np.uint16)
    sigma = np.full((2, 10, 12), np.nan)
    windows = (np.s_[3:8, 2:11], np.s_[0:10, 5:6])
    for number, where in enumerate(windows):
        sigma[number][where] = 1.0 + np.arange(counts[number][where].size).reshape(
            counts[number][where].shape
        )
    seen: list[Any] = []

    def find(given: Any, known: Any, sigma: Any) -> Any:
        seen.append((given, known.black, sigma))
        return SimpleNamespace(centre=np.array([[1.5, 2.25], [0.0, 4.0]]))

    monkeypatch.setattr(camera_poses, "find_dots", find)
    frames: Any = SimpleNamespace(counts=counts, exposure_s=np.array([0.01, 0.03]), sample_sigma=sigma)
    found = list(camera_poses._dots_in(frames, camera))
    for number, (where, corner) in enumerate(zip(windows, ((2.0, 3.0), (5.0, 0.0)), strict=True)):
        given, black, told = seen[number]
        np.testing.assert_array_equal(given, counts[number][where])
        np.testing.assert_allclose(told, sigma[number][where] / 25.0)
        assert black == pytest.approx(camera.sensor.black_level + 2000.0 * (0.01, 0.03)[number] / 25.0)
        np.testing.assert_allclose(found[number].centre, np.array([[1.5, 2.25], [0.0, 4.0]]) + corner)


def test_windows_of_all_arrays_are_looked_at_together() -> None:
    windows = [PixelWindow(5, 20, 30, 41), PixelWindow(7, 33, 12, 19), PixelWindow(9, 10, 25, 60)]
    assert camera_poses._hull(windows) == PixelWindow(5, 33, 12, 60)


def test_poses_are_told_in_the_scanners_frame_with_what_the_mount_leaves_open(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: places and attitudes are moved by the mount, covariances turn with it; its own δt and δω add δt + δω × r,
    what the calibration adds is told apart, and dots of two meanings make a valid pose ambiguous and no other."""
    rng, count = np.random.default_rng(9), 3
    mount = {"position": ["0.2 m", "-0.3 m", "0.1 m"], "rotation": {"axis": [0, 1, 2], "angle": "40 deg"}}
    calibration = {"focal_length": "0.1 mm", "position": "2 mm", "rotation": "3 mrad"}
    camera = {**scenario().model_dump(mode="json")["camera"], "mount": mount, "calibration": calibration}
    made = scenario(camera=camera)
    position = rng.uniform(-1.0, 5.0, (count, 3))
    rotation = Rotation.random(count, rng).as_matrix()
    roots = rng.normal(0.0, 1e-3, (2, count, 6, 6))
    own, added = (root @ np.swapaxes(root, -1, -2) for root in roots)
    status = np.array([PoseStatus.VALID, PoseStatus.VALID, PoseStatus.NOT_CONVERGED], dtype=np.int8)

    def estimate(*given: Any, calibration: Any = None) -> Any:
        np.testing.assert_array_equal(given[2], centres)
        covariance = own if calibration is None else own + added
        return SimpleNamespace(
            position=position, rotation=rotation, covariance=covariance, status=status,
            chi2=np.array([1.0, 2.0, 3.0]), dof=np.array([2, 3, 4]),
        )  # fmt: skip

    monkeypatch.setattr(camera_poses, "estimate_camera_pose", estimate)
    centres = rng.uniform(0.0, 100.0, (count, 4, 2))
    follower = _Follower(made, made.arrays_followed[0])
    follower._found = [
        (SimpleNamespace(centre=centre, covariance=np.eye(2), status=np.arange(4)), twofold)  # type: ignore[misc]
        for centre, twofold in zip(centres, (False, True, True), strict=True)
    ]
    found = follower.poses(np.array([0.1, 0.2, 0.3]))
    matrix = made.camera.scanner_from_camera
    turn = matrix[:3, :3]
    np.testing.assert_allclose(found.position, position @ turn.T + matrix[:3, 3], atol=1e-12)
    np.testing.assert_allclose(found.rotation, turn @ rotation, atol=1e-12)
    both = np.kron(np.eye(2), turn)
    for number in range(count):
        arm = turn @ position[number]
        moves = np.eye(6)
        moves[:3, 3:] = np.stack([np.cross(axis, arm) for axis in np.eye(3)], axis=1)
        known = moves @ np.diag([4e-6] * 3 + [9e-6] * 3) @ moves.T
        by_calibration = both @ added[number] @ both.T + known
        np.testing.assert_allclose(found.by_calibration[number], by_calibration, atol=1e-12)
        np.testing.assert_allclose(
            found.covariance[number], both @ own[number] @ both.T + by_calibration, atol=1e-12
        )
    assert found.status.tolist() == [PoseStatus.VALID, PoseStatus.AMBIGUOUS, PoseStatus.NOT_CONVERGED]
    assert (found.chi2.tolist(), found.dof.tolist()) == ([1.0, 2.0, 3.0], [2, 3, 4])
    assert (found.time.tolist(), found.name, len(found.targets)) == ([0.1, 0.2, 0.3], "panel", 4)


def test_a_targets_place_is_as_uncertain_as_the_pose_makes_it() -> None:
    """Claim: the covariance of (Θ, φ, R) is that of the pose through the differences that small shifts of the array and
    small turns about its middle make, of a target off the middle."""
    made = scenario()
    generator = np.random.default_rng(5)
    turned, middle = Rotation.from_rotvec([0.3, -0.2, 0.5]), np.array([0.4, -0.3, 5.0])
    root = generator.normal(size=(6, 6)) * np.repeat([2e-3, 5e-3], 3)[:, None]
    pose: Any = SimpleNamespace(
        rotation=turned.as_matrix()[None], position=middle[None], covariance=(root @ root.T)[None]
    )
    target: Any = SimpleNamespace(centre=np.array([0.6, -0.35, 0.1]))
    separation = made.scanner.mirrors.axis_separation

    def seen(change: Any) -> Any:
        x, y, z = middle + change[:3] + Rotation.from_rotvec(change[3:]).apply(turned.apply(target.centre))
        distance, theta, phi = angles_and_range(x, y, z, separation)
        return np.array([theta, phi, distance])

    step = 1e-6
    rows = np.array([(seen(step * one) - seen(-step * one)) / (2.0 * step) for one in np.eye(6)]).T
    place, covariance = _place(made, pose, target)
    np.testing.assert_allclose(place, seen(np.zeros(6)), rtol=1e-12)
    wanted = rows @ root @ root.T @ rows.T
    scale = np.sqrt(np.diagonal(wanted))
    np.testing.assert_allclose(
        covariance / np.outer(scale, scale), wanted / np.outer(scale, scale), atol=1e-6
    )
