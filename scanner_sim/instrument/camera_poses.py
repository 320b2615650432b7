"""From frames of the video camera to the poses of objects that carry arrays of dots, as they are or beside a track."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.foundation.arithmetic import product
from scanner_sim.instrument.photograph import frames_in_turn
from scanner_sim.optics.interior_orientation import InteriorOrientation
from scanner_sim.pose.camera import estimate_camera_pose, moved_to
from scanner_sim.pose.dot_images import DotArray
from scanner_sim.pose.identify_dots import identify
from scanner_sim.pose.result import PoseEstimate
from scanner_sim.pose.series import PoseSeries
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.frames import Frames
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
    chi2: Array
    dof: NDArray[np.int64]
    status: NDArray[np.int8]
    dots: NDArray[np.int8]


def camera_poses(
    scenario: Scenario,
    frames: Frames | Iterable[Frames],
    *,
    arrays: Sequence[TargetArray] | None = None,
    calibration: ArrayLike | None = None,
    mount_covariance: Array | None = None,
) -> tuple[CameraPoses, ...]:
    """Return the poses of a scenario's arrays of targets, as their dots in frames tell them.

    Parameters
    ----------
    scenario
        Camera and objects. Of an object its survey is used, and its attitude at time 0, as an operator would know it,
        to 40°: a regular grid looks the same from several sides.
    frames
        From :func:`~scanner_sim.instrument.photograph.take_frames`, all together or part by part; their truth is not
        looked at. What the finite number of paths of light leaves, ``sample_sigma``, counts with the sensor's noise.
    arrays
        Those that are looked for; by default all of the scene.
    calibration
        See :func:`~scanner_sim.pose.camera.estimate_camera_pose`.
    mount_covariance
        See :func:`~scanner_sim.pose.camera.moved_to`.
    """
    if arrays is None:
        arrays = [item for item in scenario.scene.objects if isinstance(item, TargetArray)]
    found: list[Dots] = []
    middles: list[float] = []
    for part in (frames,) if isinstance(frames, Frames) else frames:
        found += _dots_in(part, scenario.camera)
        middles += part.time_s.tolist()
    time = np.array(middles)
    camera, mount = scenario.camera.interior, scenario.camera.scanner_from_camera
    results = []
    for item in arrays:
        array = dots_of(item)
        expected = product(mount[:3, :3].T, item.pose_at(0.0)[0, :3, :3])
        seen = _followed(camera, array, found, expected)
        pose = estimate_camera_pose(camera, array, seen.centres, seen.covariance, calibration=calibration)
        placed = moved_to(mount, pose.position, pose.rotation, pose.covariance, mount_covariance)
        doubtful = seen.ambiguous & (pose.status == PoseStatus.VALID)
        outcome = np.where(doubtful, PoseStatus.AMBIGUOUS, pose.status).astype(np.int8)
        results.append(
            CameraPoses(item.name, array.names, time, *placed, pose.chi2, pose.dof, outcome, seen.status)
        )
    return tuple(results)


@guest()
def camera_series(
    scenario: Scenario,
    duration: float,
    *,
    device: DeviceChoice = "auto",
    progress: Callable[[int, int], None] | None = None,
) -> tuple[PoseSeries, ...]:
    """Return the poses that a scenario's camera finds while the scanner works, as series with their truth.

    Parameters
    ----------
    scenario
        Scene, lighting and camera.
    duration
        Of the scanner's run [s]; frames are taken at the camera's rate and looked at one by one.
    device
        Where to compute.
    progress
        Called with the frames taken and the frames in all.

    Returns
    -------
    tuple of PoseSeries
        By the method ``camera``, one of each array that is followed, at the middles of the exposures; a frame without
        a pose has its status. How much of their covariances neighbouring frames share, the pixels' pattern, is not told
        apart: ``lasting`` and ``common`` are NaN. The camera is taken to be what its calibration says, without doubt.

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

    def counted() -> Iterable[Frames]:
        taken = frames_in_turn(loaded, scenario.camera, scenario.lighting, begins, seed=scenario.seed)
        for number, frame in enumerate(taken, start=1):
            yield frame
            if progress is not None:
                progress(number, len(begins))

    arrays = scenario.arrays_followed
    found = camera_poses(scenario, counted(), arrays=arrays)
    return tuple(_series_of(one, item.pose_at(one.time)) for one, item in zip(found, arrays, strict=True))


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
        lasting=np.full_like(poses.covariance, np.nan),
        common=np.full_like(poses.covariance, np.nan),
    )


def _dots_in(frames: Frames, camera: VideoCamera) -> list[Dots]:
    """Return the dots of each frame."""
    gain = camera.sensor.electrons_per_number
    return [
        find_dots(counts, frame_calibration(camera, float(exposure)), sigma=sigma / gain)
        for counts, exposure, sigma in zip(frames.counts, frames.exposure_s, frames.sample_sigma, strict=True)
    ]


class _Seen(NamedTuple):
    """Centres (f, n, 2), covariances (f, n, 2, 2) and statuses (f, n) of targets in frames, and doubts (f,)."""

    centres: Array
    covariance: Array
    status: NDArray[np.int8]
    ambiguous: NDArray[np.bool_]


def _followed(camera: InteriorOrientation, array: DotArray, frames: Sequence[Dots], expected: Array) -> _Seen:
    """Return the targets of an array in the dots of frames, each named by the pose of the frame before."""
    shape = (len(frames), len(array.points))
    centres, covariance = np.full((*shape, 2), np.nan), np.full((*shape, 2, 2), np.nan)
    status, ambiguous = np.empty(shape, dtype=np.int8), np.zeros(len(frames), dtype=bool)
    last: PoseEstimate | None = None
    for number, dots in enumerate(frames):
        predicted = None if last is None else (last.rotation, last.position)
        named = identify(camera, array, dots, predicted=predicted, expected=expected, reach=_MOVED)
        there = named.dot >= 0
        centres[number, there] = dots.centre[named.dot[there]]
        covariance[number, there] = dots.covariance[named.dot[there]]
        status[number], ambiguous[number] = named.status, named.ambiguous
        last = None if named.ambiguous else named.pose
    return _Seen(centres, covariance, status, ambiguous)


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
