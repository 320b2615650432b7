"""Ranges of many shots: from peaks on the line to range and coordinates, with σ and status."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.ranging.coordinates import coordinates
from scanner_sim.ranging.triangulation import range_from_position, range_sigma
from scanner_sim.status import Status

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Geometry:
    """The calibration that turns a pixel into a range, SI.

    ``focal_length``, ``baseline``, ``axis_separation`` of the optics; ``pitch`` and ``offset`` of the sensor;
    ``sigma_angle`` the standard deviation of each deflection.
    """

    focal_length: float
    baseline: float
    axis_separation: float
    pitch: float
    offset: float
    sigma_angle: float

    def position(self, peak: Array) -> Array:
        """Return the position p on the sensor [m] of a fractional pixel."""
        return self.offset + (peak + 0.5) * self.pitch

    def pixel(self, position: Array) -> Array:
        """Return the fractional pixel of a position p [m]."""
        return (position - self.offset) / self.pitch - 0.5


@dataclass(frozen=True)
class Ranges:
    """Measured ranges, arrays of shape (n,); NaN wherever ``status`` is not 0.

    ``range`` and ``sigma`` [m], ``x``, ``y``, ``z`` [m] in the scanner frame, ``status`` codes.
    """

    range: Array
    sigma: Array
    x: Array
    y: Array
    z: Array
    status: NDArray[np.uint32]


def ranges_from_peaks(
    peak: Array,
    sigma_peak: Array,
    status: NDArray[np.uint32],
    theta: Array,
    phi: Array,
    geometry: Geometry,
    gate: tuple[float, float] | None,
) -> Ranges:
    """Return the ranges of n shots.

    Parameters
    ----------
    peak, sigma_peak
        Position and its standard deviation [pixel], shape (n,).
    status
        Status so far, shape (n,).
    theta, phi
        Measured deflections [rad], shape (n,).
    geometry
        Calibration.
    gate
        Nearest and farthest range accepted [m], or None.

    Returns
    -------
    Ranges
    """
    f, d = geometry.focal_length, geometry.baseline
    p = geometry.position(peak)
    r = range_from_position(p, theta, f, d)
    sigma = range_sigma(p, theta, f, d, sigma_peak * geometry.pitch, geometry.sigma_angle)
    status = status.copy()
    if gate is not None:
        status[(status == Status.VALID) & ~((r >= gate[0]) & (r <= gate[1]))] = Status.OUT_OF_GATE
    invalid = status != Status.VALID
    r[invalid] = np.nan
    sigma[invalid] = np.nan
    return Ranges(r, sigma, *coordinates(r, theta, phi, geometry.axis_separation), status)
