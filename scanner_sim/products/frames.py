"""Frames of a video camera: what is read of it, and apart from that what is true."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.frame.sensor import FrameSensor

Floats = NDArray[np.float64]

_DISPLAY_GAMMA = 2.2


@dataclass(frozen=True, eq=False)
class FrameTruth:
    """What no estimator sees.

    Attributes
    ----------
    electrons
        Mean photo-electrons of each pixel without noise and patterns, before anything overflows, shape (frames, rows,
        columns), float32.
    scanner_from_camera
        Poses of the camera, shape (frames, 4, 4).
    """

    electrons: NDArray[np.float32]
    scanner_from_camera: Floats


@dataclass(frozen=True, eq=False)
class ArrayDots:
    """What one frame shows of an array of n dots.

    Attributes
    ----------
    name, targets
        Of the object and of its targets.
    centre, covariance
        Centres (u, v) of the ellipses [pixel] and their covariance [pixel²], shapes (n, 2) and (n, 2, 2); NaN where
        there is none.
    shape
        (L_uu, L_uv, L_vv): the symmetric matrix that makes the ellipse of the unit circle [pixel], shape (n, 3).
    status
        :class:`~scanner_sim.signals.dots.settings.DotStatus`, shape (n,).
    """

    name: str
    targets: tuple[str, ...]
    centre: Floats
    covariance: Floats
    shape: Floats
    status: NDArray[np.int8]


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames in the order of their times; row 0 is the top.

    Attributes
    ----------
    counts
        Digital numbers, shape (frames, rows, columns), uint16.
    saturated
        Which pixels reached the full well or the end of the converter, of the same shape.
    exposure_s, time_s, available_s
        Exposures; their middles since the start of the scan; when the frames can be read [s], shape (frames,).
    sample_sigma
        Standard deviation of each pixel's charge by the finite number of paths of light [electron], shape (frames,
        rows, columns), float32: an error of the simulation, to be counted with the noise where it is not small beside
        it. It rather errs to the large side.
    noise_share
        Mean variance of a frame's pixels by samples over that by light and sensor, shape (frames,).
    truth
        What is true.
    notes
        Sentences on what was assumed.
    """

    counts: NDArray[np.uint16]
    saturated: NDArray[np.bool_]
    exposure_s: Floats
    time_s: Floats
    available_s: Floats
    sample_sigma: NDArray[np.float32]
    noise_share: Floats
    truth: FrameTruth
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.counts)


def shown(counts: NDArray[np.uint16], sensor: FrameSensor) -> NDArray[np.uint8]:
    """Return digital numbers as grey levels of a screen, 0 to 255: the share of the range above black, to the 1/2.2."""
    range_ = sensor.largest_number - sensor.black_level
    share = np.clip((counts.astype(np.float64) - sensor.black_level) / range_, 0.0, 1.0)
    grey: NDArray[np.uint8] = np.rint(255.0 * share ** (1.0 / _DISPLAY_GAMMA)).astype(np.uint8)
    return grey
