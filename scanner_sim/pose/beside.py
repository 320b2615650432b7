"""The scanner's poses of an object and the video camera's: their difference at common times, and both as one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from scanner_sim.foundation.arithmetic import product
from scanner_sim.pose.camera import Placed, combined_poses
from scanner_sim.pose.series import PoseSeries
from scanner_sim.pose.solution import LEAST_PROBABILITY
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.transforms import rotation_from_vector, vector_from_rotation

Array = NDArray[np.float64]


class Beside(NamedTuple):
    """Scanner less camera where both have valid poses.

    Attributes
    ----------
    scanner, camera
        The series.
    time
        The scanner's, shape (n,) [s].
    difference, sigma
        (δt, δω) from the camera's pose to the scanner's, and its standard deviation [m, rad], shapes (n, 6).
    """

    scanner: PoseSeries
    camera: PoseSeries
    time: Array
    difference: Array
    sigma: Array


def beside_camera(poses: Sequence[PoseSeries]) -> Iterator[Beside]:
    """Yield the differences of the scanner's poses from the camera's, by object and method of the scanner."""
    for scanner, camera in _pairs(poses):
        row, seen = _between_frames(scanner, camera)
        apart = vector_from_rotation(product(scanner.rotation[row], np.swapaxes(seen.placed.rotation, 1, 2)))
        difference = np.concatenate([scanner.position[row] - seen.placed.position, apart], axis=1)
        sigma = np.sqrt(np.diagonal(scanner.covariance[row] + seen.placed.covariance, axis1=1, axis2=2))
        yield Beside(scanner, camera, scanner.time[row], difference, sigma)


def combined_series(poses: Sequence[PoseSeries]) -> Iterator[PoseSeries]:
    """Yield for each object with poses of both the poses that scanner and camera make together, by their covariances.

    Of the scanner's methods ``joint`` is taken, else the first. The poses are those of its times that lie between two
    valid poses of the camera (:func:`~scanner_sim.pose.camera.combined_poses`). χ² is that of the two's difference,
    with six degrees of freedom; where chance gives it less than once in 10⁴, the pose is IMPLAUSIBLE. Not modelled is
    what frames in between leave of an acceleration.
    """
    pairs = list(_pairs(poses))
    for label in dict.fromkeys(scanner.label for scanner, _ in pairs):
        own = [pair for pair in pairs if pair[0].label == label]
        scanner, camera = next((pair for pair in own if pair[0].method == "joint"), own[0])
        row, seen = _between_frames(scanner, camera)
        one = Placed(*(values[row] for values in (scanner.position, scanner.rotation, scanner.covariance)))
        both = combined_poses(one, seen.placed)
        kept = np.eye(6) - both.gain
        lasting, common = (
            product(kept, part[row], np.swapaxes(kept, 1, 2))
            + product(both.gain, other, np.swapaxes(both.gain, 1, 2))
            for part, other in ((scanner.lasting, seen.lasting), (scanner.common, seen.common))
        )
        doubtful = chdtrc(6.0, both.chi2) < LEAST_PROBABILITY
        yield PoseSeries(
            name=scanner.name,
            relative_to=scanner.relative_to,
            method="combined",
            time=scanner.time[row],
            position=both.position,
            rotation=both.rotation,
            covariance=both.covariance,
            chi2=both.chi2,
            dof=np.full(len(row), 6),
            targets=scanner.targets[row] + seen.targets,
            status=np.where(doubtful, PoseStatus.IMPLAUSIBLE, PoseStatus.VALID).astype(np.int8),
            truth_position=scanner.truth_position[row],
            truth_rotation=scanner.truth_rotation[row],
            lasting=lasting,
            common=common,
        )


def _pairs(poses: Sequence[PoseSeries]) -> Iterator[tuple[PoseSeries, PoseSeries]]:
    """Yield the series of the scanner, each with the camera's of the same object."""
    cameras = {one.label: one for one in poses if one.method == "camera"}
    for one in poses:
        if one.method not in ("camera", "combined") and one.label in cameras:
            yield one, cameras[one.label]


class _Seen(NamedTuple):
    """Poses of the camera at the scanner's times, parts of their covariances, and numbers of dots."""

    placed: Placed
    lasting: Array
    common: Array
    targets: NDArray[np.int64]


def _between_frames(scanner: PoseSeries, camera: PoseSeries) -> tuple[NDArray[np.intp], _Seen]:
    """Return which poses of the scanner lie between two valid ones of the camera, and the camera's at their times.

    Between frames the camera's pose goes straight and turns evenly: an acceleration a leaves a T²/8, T the time from
    frame to frame. Covariances of two frames are put together as if their errors were one, by the pattern of the
    pixels: σ is right for what rests, and up to √2 of the camera's part too large for dots that pass from pixel to
    pixel.
    """
    after = np.searchsorted(camera.time, scanner.time, side="right").clip(1, max(len(camera.time) - 1, 1))
    good = (scanner.status == PoseStatus.VALID) & (len(camera.time) > 1)
    if good.any():
        seen = camera.status == PoseStatus.VALID
        good &= seen[after - 1] & seen[after]
        good &= (scanner.time >= camera.time[0]) & (scanner.time <= camera.time[-1])
    row, last, first = np.flatnonzero(good), after[good], after[good] - 1
    share = (scanner.time[row] - camera.time[first]) / (camera.time[last] - camera.time[first])
    turn = vector_from_rotation(product(camera.rotation[last], np.swapaxes(camera.rotation[first], 1, 2)))
    placed = Placed(
        _between(camera.position, first, last, share),
        product(rotation_from_vector(share[:, None] * turn), camera.rotation[first]),
        _between(camera.covariance, first, last, share),
    )
    lasting, common = (_between(part, first, last, share) for part in (camera.lasting, camera.common))
    return row, _Seen(placed, lasting, common, camera.targets[first])


def _between(values: Array, first: NDArray[np.intp], last: NDArray[np.intp], share: Array) -> Array:
    weight = share.reshape(-1, *(1,) * (values.ndim - 1))
    return np.asarray((1.0 - weight) * values[first] + weight * values[last])
