"""Poses by a video camera from frame to frame, of dots that stand where the poses say."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_dots import SIGMA, made_dots
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scanner_sim import load_scenario
from scanner_sim.config.scenario import Scenario
from scanner_sim.instrument import camera_poses
from scanner_sim.pose.status import PoseStatus
from scanner_sim.signals.dots.settings import DotStatus

Array = NDArray[np.float64]

MOUNT = {"position": ["0.2 m", "-0.1 m", "0.1 m"], "rotation": {"axis": [0.3, 1, 0.2], "angle": "4 deg"}}
DIAMETER, SPACING = 0.08, (0.5, 0.3)


def panel(name: str, x: float, angle: str, speed: str) -> dict[str, Any]:
    """Six dots of an array that drifts and turns."""
    array = {"diameter": f"{DIAMETER} m", "plate": "200 mm", "rows": 3, "columns": 2}
    return {
        "name": name,
        "array": {**array, "spacing": [f"{value} m" for value in SPACING]},
        "position": [f"{x} m", "-0.05 m", "5 m"],
        "rotation": {"axis": [1, 2, 0], "angle": angle},
        "motion": {
            "type": "twist",
            "velocity": [speed, "20 mm/s", "-40 mm/s"],
            "turn_rate": ["1 deg/s", "2 deg/s", "0 deg/s"],
        },
    }


def scenario(**more: Any) -> Scenario:
    """Two arrays before a camera that is mounted askew."""
    camera = {
        "interior": {"columns": 1300, "rows": 900, "pixel_pitch": "6 um"},
        "mount": MOUNT,
        "exposure": {"type": "fixed", "time": "4 ms"},
        "frame_rate": "10 Hz",
        "calibration": {"focal_length": "0.02 mm", "position": "1 mm"},
    }
    targets = [{"target": name, "offset": ["2 mrad", "-1 mrad", "0.02 m"]} for name in ("left", "right")]
    return load_scenario(
        {
            "schema": 1,
            "seed": 3,
            "scene": {
                "objects": [
                    panel("left", -0.5, "15 deg", "30 mm/s"),
                    panel("right", 0.6, "-12 deg", "-10 mm/s"),
                ]
            },
            "lighting": {"sun": {"direction": [0.3, -0.5, -0.8]}},
            "scan": {"type": "track", "duration": "0.35 s", "targets": targets},
            "pose": {"methods": ["camera"]},
            "camera": camera,
            **more,
        }
    )


def centres(made: Scenario, time: float) -> Array:
    """Return where the dots of both arrays are imaged [pixel], without distortion: f (x, y)/z off the middle."""
    found = []
    x, y = (np.arange(count) - 0.5 * (count - 1) for count in (2, 3))
    for item in made.scene.objects:
        pose = np.linalg.inv(made.camera.scanner_from_camera) @ item.pose_at(time)[0]
        points = np.array([[SPACING[0] * i, SPACING[1] * j, 0.0, 1.0] for j in y for i in x])
        u, v, w, _ = pose @ points.T
        lens = made.camera.interior
        scale = lens.focal_length / lens.pixel_pitch / w
        found.append(np.stack([u * scale + 649.5, v * scale + 449.5], axis=1))
    return np.concatenate(found)


class Shown:
    """Frames that hold the dots where they are, without noise; from a frame on they hold none."""

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        made: Scenario,
        duration: float,
        dark: int = 9,
        only: int | None = None,
    ) -> None:
        self.made, self.dark, self.only = made, dark, only
        self.windows: list[Any] = []
        self.asked: dict[str, Any] = {}
        self.begins = made.camera.frame_times(duration)
        for name in ("activate", "load_scene"):
            monkeypatch.setattr(camera_poses, name, lambda *_, **__: None)
        monkeypatch.setattr(camera_poses, "frames_in_turn", self.taken)
        monkeypatch.setattr(camera_poses, "_dots_in", self.dots)

    def taken(self, _: Any, camera: Any, lighting: Any, begins: Any, *, seed: int, look: Any) -> Any:
        """Yield one frame after the other, each as of the window that is asked for before it."""
        self.asked = {"camera": camera, "lighting": lighting, "seed": seed, "look": look}
        np.testing.assert_array_equal(begins, self.begins)
        for number, begin in enumerate(begins):
            self.windows.append(look() if look else None)
            yield SimpleNamespace(time_s=np.array([begin + 2e-3]), number=number)

    def dots(self, frame: Any, _: Any) -> Any:
        """Yield a frame's dots, as large as those of a disc straight ahead."""
        if frame.number >= self.dark:
            yield made_dots(np.empty((0, 2)), np.empty(0))
            return
        lens = self.made.camera.interior
        found = centres(self.made, float(frame.time_s[0]))
        if self.only is not None:
            found = found[6 * self.only :][:6]
        half = 0.5 * DIAMETER * lens.focal_length / lens.pixel_pitch / 5.0
        yield made_dots(found, np.full(len(found), half))


def test_frames_without_noise_show_the_true_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: arrays that drift are posed where they are at the middles of the exposures, each by its own dots; what the
    calibration leaves open is all that lasts, and a focal length known to so much makes the depth doubtful in its
    ratio. Told are one frame after the other.

    A window lies about the dots of both arrays in the frame before, with 24 pixels and a dot's diameter beside their
    centres, the first about the expected places; after a frame without dots all of the next is looked at.

    Expected: a disc's image is not centred on that of its centre, by r² sinτ cosτ/z² of its distance, 1e-5 here, and
    that is 0.1 mrad of attitude at most over the array; a millimetre is left to the depth.
    """
    made = scenario()
    shown = Shown(monkeypatch, made, 0.35, dark=2)
    told: list[tuple[int, int]] = []
    found = camera_poses.camera_series(made, 0.35, device="cpu", progress=lambda *done: told.append(done))
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert (shown.asked["camera"], shown.asked["lighting"]) == (made.camera, made.lighting)
    assert shown.asked["seed"] == 3
    for series, item in zip(found, made.scene.objects, strict=True):
        assert (series.name, series.relative_to, series.method) == (item.name, "", "camera")
        np.testing.assert_allclose(series.time, shown.begins + 2e-3, atol=1e-12)
        true = item.pose_at(series.time)
        np.testing.assert_array_equal(series.truth_position, true[:, :3, 3])
        np.testing.assert_array_equal(series.truth_rotation, true[:, :3, :3])
        np.testing.assert_allclose(series.position[:2], true[:2, :3, 3], atol=1e-3)
        turned = series.rotation[:2] @ np.swapaxes(true[:2, :3, :3], 1, 2)
        assert Rotation.from_matrix(turned).magnitude().max() < 2e-3
        assert (series.status == PoseStatus.VALID).tolist() == [True, True, False, False]
        assert series.targets.tolist() == [6, 6, 0, 0]
        assert series.dof[:2].tolist() == [6, 6]
        np.testing.assert_array_equal(series.lasting, series.common)
        # Along the line of sight: σ_f/f of the distance, and the mount's own millimetre.
        ahead = made.camera.scanner_from_camera[:3, 2]
        lasts = np.sqrt(np.einsum("i,nij,j->n", ahead, series.lasting[:2, :3, :3], ahead))
        away = (series.position[:2] - made.camera.scanner_from_camera[:3, 3]) @ ahead
        wanted = np.hypot(away * 0.02e-3 / made.camera.interior.focal_length, 1e-3)
        np.testing.assert_allclose(lasts, wanted, rtol=0.03)
    scale = made.camera.interior.focal_length / made.camera.interior.pixel_pitch
    size = DIAMETER * scale / 5.0
    first, *after, last = shown.windows
    assert last is None
    for window, begin in zip(after, shown.begins, strict=False):
        there = centres(made, float(begin) + 2e-3)
        (left, top), (right, bottom) = there.min(axis=0), there.max(axis=0)
        margin = 24.0 + size
        # The nearest discs stand 5 % nearer than 5 m, and are longer than wide by 4 % beside the lens's axis.
        slack = 1.0 + 0.09 * size
        assert window.left == pytest.approx(left - margin, abs=slack)
        assert window.top == pytest.approx(top - margin, abs=slack)
        assert window.right == pytest.approx(right + margin + 1.0, abs=slack)
        assert window.bottom == pytest.approx(bottom + margin + 1.0, abs=slack)
    # The expected places lie 2 mrad and 1 mrad beside the true ones, and 0.02 m farther: less than 3 mrad in all.
    turned = np.array([first.left - after[0].left, first.right - after[0].right])
    assert (np.abs(turned) < 3e-3 * scale + 2.0).all()
    assert np.abs(turned).max() > 1.0


@pytest.mark.parametrize("kept", ["by whom it asks", "frames"])
def test_frames_that_are_kept_are_lit_whole(monkeypatch: pytest.MonkeyPatch, kept: str) -> None:
    """Claim: who keeps frames gets each with the dots of every array in it, and all of each frame is lit."""
    made = scenario(**({"output": {"frames": True}} if kept == "frames" else {}))
    shown = Shown(monkeypatch, made, 0.05)
    seen: list[Any] = []

    def keep(frame: Any, dots: Any) -> None:
        seen.append((frame.number, [one.name for one in dots], [one.centre for one in dots]))

    camera_poses.camera_series(made, 0.05, device="cpu", keep=None if kept == "frames" else keep)
    assert shown.asked["look"] is None
    for number, names, places in seen:
        assert (number, names) == (0, ["left", "right"])
        np.testing.assert_allclose(np.concatenate(places), centres(made, 2e-3), atol=1e-9)
    assert len(seen) == (0 if kept == "frames" else 1)


def test_an_array_is_found_without_a_hint(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: arrays that are asked for are looked for alone; each target has the status of its dot, and σ of the
    centres moves the array across the sight by σ z p/(f √6)."""
    made = scenario()
    shown = Shown(monkeypatch, made, 0.05, only=1)
    frame: Any = SimpleNamespace(time_s=shown.begins + 2e-3, number=0)
    (right,) = camera_poses.camera_poses(made, [frame], arrays=[made.arrays_followed[1]])
    assert (right.name, right.targets) == ("right", tuple(f"right/{number}" for number in range(1, 7)))
    assert (right.dots == DotStatus.VALID).all()
    np.testing.assert_allclose(right.position, made.scene.objects[1].pose_at(right.time)[:, :3, 3], atol=1e-3)
    lens, sideways = made.camera.interior, made.camera.scanner_from_camera[:3, 0]
    own = (right.covariance - right.by_calibration)[:, :3, :3]
    moved = np.sqrt(np.einsum("i,nij,j->n", sideways, own, sideways))
    wanted = SIGMA * 5.0 * lens.pixel_pitch / lens.focal_length / 6.0**0.5
    np.testing.assert_allclose(moved, wanted, rtol=0.1)


RASTER = {"rows": 4, "columns": 4, "horizontal": [-0.1, 0.1], "vertical": [-0.1, 0.1]}


@pytest.mark.parametrize("followed", [("left", "right"), ("right",), ()], ids=len)
def test_all_arrays_of_a_scene_are_looked_for_where_none_is_named(
    monkeypatch: pytest.MonkeyPatch, followed: tuple[str, ...]
) -> None:
    """Claim: without ``arrays`` there is a series of each array, in the order of the scene, with all of the frames;
    whether a tracker follows them, or one of them, or the scan is none of targets, makes no difference."""
    tracks = {"type": "track", "duration": "0.35 s", "targets": list(followed)}
    made = scenario(scan=tracks if followed else RASTER, pose={})
    shown = Shown(monkeypatch, made, 0.25, dark=0)
    frames: Any = shown.taken(None, None, None, shown.begins, seed=3, look=None)
    found = camera_poses.camera_poses(made, frames)
    assert [one.name for one in found] == ["left", "right"]
    for one in found:
        np.testing.assert_allclose(one.time, shown.begins + 2e-3, atol=1e-12)
