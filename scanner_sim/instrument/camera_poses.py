"""From frames of the video camera to the poses of objects that carry arrays of dots, as they are or beside a track."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.foundation.arithmetic import applied, product
from scanner_sim.instrument.photograph import frames_in_turn
from scanner_sim.optics.pixel_window import PixelWindow
from scanner_sim.pose.camera import estimate_camera_pose, moved_to
from scanner_sim.pose.dot_images import DotArray, dot_images
from scanner_sim.pose.identify_dots import identify
from scanner_sim.pose.series import PoseSeries
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.frames import ArrayDots, Frames
from scanner_sim.ranging.coordinates import coordinates
from scanner_sim.render.device import activate
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scene.files.loader import load_scene
from scanner_sim.scene.objects import TargetArray
from scanner_sim.scene.targets import target_positions
from scanner_sim.signals.dots.fit import Dots, find_dots
from scanner_sim.signals.dots.settings import DotStatus, FrameCalibration

Array = NDArray[np.float64]

_MOVED = 6.0
"""Pixels, beside half a dot, by which an array may have moved since the frame before."""
_BESIDE = 24.0
"""Pixels beyond the outermost dots, and a dot's diameter, that are looked at about them."""


KeepFrame = Callable[[Frames, Sequence[ArrayDots]], None]
"""Takes one frame after the other, with the dots of the arrays in it."""


class CameraPoses(NamedTuple):
    """Poses of one object in the scanner's frame, one for each frame.

    Attributes
    ----------
    name, targets
        Of the object and of its n targets.
    time
        Middles of the exposures [s], shape (frames,).
    position, rotation, covariance
        ``scanner_from_object`` and the covariance of (δt, δω), shapes (frames, 3), (frames, 3, 3), (frames, 6, 6).
    by_calibration
        The part of the covariance that the camera's calibration leaves open, which all frames share.
    chi2, dof
        Of the adjustments, shape (frames,).
    status
        :class:`~scanner_sim.pose.status.PoseStatus`; AMBIGUOUS where the dots have more than one meaning.
    dots
        :class:`~scanner_sim.signals.dots.settings.DotStatus` of each target, shape (frames, n).
    """

    name: str
    targets: tuple[str, ...]
    time: Array
    position: Array
    rotation: Array
    covariance: Array
    by_calibration: Array
    chi2: Array
    dof: NDArray[np.int64]
    status: NDArray[np.int8]
    dots: NDArray[np.int8]


def camera_poses(
    scenario: Scenario,
    frames: Frames | Iterable[Frames],
    *,
    arrays: Sequence[TargetArray] | None = None,
) -> tuple[CameraPoses, ...]:
    """Return the poses of a scenario's arrays of targets, as their dots in frames tell them.

    Parameters
    ----------
    scenario
        Camera and objects. Of an object its survey is used, and its attitude at time 0, as an operator would know it,
        to 40°: a regular grid looks the same from several sides. What ``camera.calibration`` leaves open counts in the
        covariances.
    frames
        From :func:`~scanner_sim.instrument.photograph.take_frames`, all together or part by part; their truth is not
        looked at. What the finite number of paths of light leaves, ``sample_sigma``, counts with the sensor's noise.
    arrays
        Those that are looked for; by default all of the scene.
    """
    if arrays is None:
        arrays = [item for item in scenario.scene.objects if isinstance(item, TargetArray)]
    return _poses_in(scenario, frames, [_Follower(scenario, item) for item in arrays])


def _poses_in(
    scenario: Scenario,
    frames: Frames | Iterable[Frames],
    followers: Sequence[_Follower],
    keep: KeepFrame | None = None,
) -> tuple[CameraPoses, ...]:
    """Return the poses of arrays, each by who follows it through the frames."""
    middles: list[float] = []
    for part in (frames,) if isinstance(frames, Frames) else frames:
        for dots in _dots_in(part, scenario.camera):
            seen = [follower.look_at(dots) for follower in followers]
            if keep is not None:
                keep(part, seen)
        middles += part.time_s.tolist()
    return tuple(follower.poses(np.array(middles)) for follower in followers)


@guest()
def camera_series(
    scenario: Scenario,
    duration: float,
    *,
    device: DeviceChoice = "auto",
    progress: Callable[[int, int], None] | None = None,
    keep: KeepFrame | None = None,
) -> tuple[PoseSeries, ...]:
    """Return the poses that a scenario's camera finds while the scanner works, as series with their truth.

    Parameters
    ----------
    scenario
        Scene, lighting and camera.
    duration
        Of the scanner's run [s]; frames are taken at the camera's rate and looked at one by one: the first where the
        tracker is told to look, the others where the dots were in the frame before, and all of a frame where there is
        no pose to go by. With ``output.frames`` light is followed to all of each.
    device
        Where to compute.
    progress
        Called with the frames taken and the frames in all.
    keep
        Called with each frame and the dots in it; light is then followed to all of the frames.

    Returns
    -------
    tuple of PoseSeries
        By the method ``camera``, one of each array that is followed, at the middles of the exposures; a frame without
        a pose has its status. ``lasting`` and ``common`` are what ``camera.calibration`` leaves open. What the pattern
        of the pixels makes neighbouring frames share is not told apart.

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the device cannot be used.
    """
    activate(device)
    loaded = load_scene(scenario.scene, band="visible")
    begins = scenario.camera.frame_times(duration)
    arrays = scenario.arrays_followed
    followers = [_Follower(scenario, item, first=expected_pose(scenario, item)) for item in arrays]

    def look() -> PixelWindow | None:
        windows = [follower.window for follower in followers]
        return _hull([one for one in windows if one is not None]) if None not in windows else None

    def counted() -> Iterable[Frames]:
        taken = frames_in_turn(
            loaded,
            scenario.camera,
            scenario.lighting,
            begins,
            seed=scenario.seed,
            look=None if keep or scenario.output.frames else look,
        )
        for number, frame in enumerate(taken, start=1):
            yield frame
            if progress is not None:
                progress(number, len(begins))

    found = _poses_in(scenario, counted(), followers, keep)
    return tuple(_series_of(one, item.pose_at(one.time)) for one, item in zip(found, arrays, strict=True))


def expected_pose(scenario: Scenario, item: TargetArray) -> tuple[Array, Array]:
    """Return attitude and place ``scanner_from_object`` of an array, as the tracker is told where its targets are.

    The attitude is that at time 0; the place is the mean of what its targets' expected places say with it.
    """
    rotation = item.pose_at(0.0)[0, :3, :3]
    own = [target for target in scenario.targets if target.object == item.name]
    theta, phi, distance = np.array([target.expected for target in own]).T
    placed = np.stack(coordinates(distance, theta, phi, scenario.scanner.mirrors.axis_separation), axis=-1)
    centres = np.array([target.centre for target in own])
    return rotation, np.mean(placed - product(centres, rotation.T), axis=0)


def _hull(windows: Sequence[PixelWindow]) -> PixelWindow:
    top, bottom, left, right = zip(*windows, strict=True)
    return PixelWindow(min(top), max(bottom), min(left), max(right))


def _series_of(poses: CameraPoses, truth: Array) -> PoseSeries:
    return PoseSeries(
        name=poses.name,
        relative_to="",
        method="camera",
        time=poses.time,
        position=poses.position,
        rotation=poses.rotation,
        covariance=poses.covariance,
        chi2=poses.chi2,
        dof=poses.dof,
        targets=np.count_nonzero(poses.dots == DotStatus.VALID, axis=1).astype(np.int64),
        status=poses.status,
        truth_position=truth[:, :3, 3],
        truth_rotation=truth[:, :3, :3],
        lasting=poses.by_calibration,
        common=poses.by_calibration,
    )


def _dots_in(frames: Frames, camera: VideoCamera) -> Iterator[Dots]:
    """Yield the dots of each frame, of the window of it that was looked at."""
    gain = camera.sensor.electrons_per_number
    for counts, exposure, sigma in zip(frames.counts, frames.exposure_s, frames.sample_sigma, strict=True):
        rows, columns = (np.flatnonzero(np.isfinite(sigma).any(axis=axis)) for axis in (1, 0))
        where = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        dots = find_dots(counts[where], frame_calibration(camera, float(exposure)), sigma=sigma[where] / gain)
        dots.centre[:] += (columns[0], rows[0])
        yield dots


class _Follower:
    """Finds an array in frames, one after the other, each by the pose of the frame before.

    Parameters
    ----------
    scenario
        Camera and mount, as they are believed.
    item
        The array.
    first
        Attitude and place ``scanner_from_object`` at which the first frame is looked at; by default nobody knows.
    """

    def __init__(
        self, scenario: Scenario, item: TargetArray, first: tuple[Array, Array] | None = None
    ) -> None:
        self._camera, self._array, self._name = scenario.camera, dots_of(item), item.name
        back = self._camera.scanner_from_camera[:3, :3].T
        self._expected = product(back, item.pose_at(0.0)[0, :3, :3])
        self._predicted: tuple[Array, Array] | None = None
        if first is not None:
            apart = first[1] - self._camera.scanner_from_camera[:3, 3]
            self._predicted = product(back, first[0]), applied(back, apart)
        self._found: list[tuple[ArrayDots, bool]] = []

    @property
    def window(self) -> PixelWindow | None:
        """The pixels in which the next frame's dots are looked for; None where they may be anywhere."""
        if self._predicted is None:
            return None
        interior = self._camera.interior
        images = dot_images(interior, self._array, *self._predicted)
        margin = _BESIDE + 2.0 * float(np.max(images.half_axes))
        return PixelWindow.about(images.ellipse, margin, (interior.rows, interior.columns))

    def look_at(self, dots: Dots) -> ArrayDots:
        """Name the targets among the dots of the next frame."""
        camera, array, count = self._camera.interior, self._array, len(self._array.points)
        named = identify(
            camera, array, dots, predicted=self._predicted, expected=self._expected, reach=_MOVED
        )
        there = named.dot >= 0
        seen = ArrayDots(
            self._name,
            array.names,
            np.full((count, 2), np.nan),
            np.full((count, 2, 2), np.nan),
            np.full((count, 3), np.nan),
            named.status,
        )
        chosen = named.dot[there]
        seen.centre[there], seen.covariance[there] = dots.centre[chosen], dots.covariance[chosen]
        seen.shape[there] = dots.shape[chosen]
        self._found.append((seen, named.ambiguous))
        known = named.pose is not None and not named.ambiguous
        self._predicted = (named.pose.rotation, named.pose.position) if known and named.pose else None
        return seen

    def poses(self, time: Array) -> CameraPoses:
        """Return the poses of all frames, of the middles of their exposures [s]."""
        seen = [one for one, _ in self._found]
        ambiguous = np.array([twofold for _, twofold in self._found])
        centres, covariance, dots = (
            np.array([getattr(one, name) for one in seen]) for name in ("centre", "covariance", "status")
        )
        camera, known = self._camera, self._camera.calibration
        of_all = camera.interior, self._array, centres, covariance
        pose = whole = estimate_camera_pose(*of_all)
        if known.covariance.any():
            whole = estimate_camera_pose(*of_all, calibration=known.covariance)
        mount = camera.scanner_from_camera
        placed = moved_to(mount, pose.position, pose.rotation, whole.covariance, known.mount_covariance)
        alone = moved_to(mount, pose.position, pose.rotation, pose.covariance)
        doubtful = ambiguous & (pose.status == PoseStatus.VALID)
        outcome = np.where(doubtful, PoseStatus.AMBIGUOUS, pose.status).astype(np.int8)
        by_calibration = placed[2] - alone[2]
        about = self._name, self._array.names, time
        return CameraPoses(*about, *placed, by_calibration, pose.chi2, pose.dof, outcome, dots)


def dots_of(item: TargetArray) -> DotArray:
    """Return the surveyed dots of an array of targets, which face −z of their object."""
    layout = item.array
    points = target_positions(layout.rows, layout.columns, *layout.spacing)
    count = len(points)
    names = tuple(f"{item.name}/{number}" for number in range(1, count + 1))
    return DotArray(
        names, points, np.tile([0.0, 0.0, -1.0], (count, 1)), np.full(count, 0.5 * layout.diameter)
    )


def frame_calibration(camera: VideoCamera, exposure: float) -> FrameCalibration:
    """Return what is believed of a camera's frames of an exposure [s]: its data sheet and its mean dark current."""
    sensor, gain = camera.sensor, camera.sensor.electrons_per_number
    # What reaches the full well below the converter's end is no more to be trusted than what reaches the end.
    full = sensor.black_level + sensor.full_well / gain
    return FrameCalibration(
        black=sensor.black_level + sensor.dark_current * exposure / gain,
        electrons_per_number=gain,
        read_noise=sensor.read_noise,
        saturation=min(float(sensor.largest_number), np.floor(full)),
        blur=camera.lens.point_spread / camera.interior.pixel_pitch,
        uneven=sensor.prnu,
    )
