"""The scanner's poses of an object beside the video camera's: their difference at common times, and its σ."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import product
from scanner_sim.pose.series import PoseSeries
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
    cameras = {one.label: one for one in poses if one.method == "camera"}
    for one in poses:
        if one.method != "camera" and one.label in cameras:
            yield _beside(one, cameras[one.label])


def _beside(scanner: PoseSeries, camera: PoseSeries) -> Beside:
    """Return the difference at the scanner's times that lie between two valid poses of the camera.

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
    rotation = product(rotation_from_vector(share[:, None] * turn), camera.rotation[first])
    position = _between(camera.position, first, last, share)
    apart = vector_from_rotation(product(scanner.rotation[row], np.swapaxes(rotation, 1, 2)))
    difference = np.concatenate([scanner.position[row] - position, apart], axis=1)
    covariance = scanner.covariance[row] + _between(camera.covariance, first, last, share)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    return Beside(scanner, camera, scanner.time[row], difference, sigma)


def _between(values: Array, first: NDArray[np.intp], last: NDArray[np.intp], share: Array) -> Array:
    weight = share.reshape(-1, *(1,) * (values.ndim - 1))
    return np.asarray((1.0 - weight) * values[first] + weight * values[last])
