"""Ranges of many shots: from peaks on the line to range and coordinates, with σ and status."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.status import VALID, Status
from scanner_sim.optics.line_image import LineImage
from scanner_sim.ranging.axes import Axes
from scanner_sim.ranging.believed import RangedBy
from scanner_sim.ranging.calibration import Calibration, errors_in_common
from scanner_sim.ranging.covariance import PointCovariance, point_covariance
from scanner_sim.ranging.departures import undistorted_position
from scanner_sim.ranging.spot_light import swept_shift
from scanner_sim.ranging.triangulation import (
    position_sigma,
    range_from_position,
    range_jacobian,
)

Array = NDArray[np.float64]

Layers: TypeAlias = dict[str, NDArray[Any]]
"""Columns of shots by name, all of one shape: quantities as floats; status codes and counts as whole numbers."""
Columns: TypeAlias = Mapping[str, NDArray[Any]]
"""The same, to be read only."""


@dataclass(frozen=True)
class Geometry:
    """The calibration that turns a pixel into a range, SI.

    ``scale`` h and ``slope`` g of the array as the lens images it (:mod:`scanner_sim.optics.line_image`);
    ``baseline``, ``axis_separation`` of the optics; ``pitch`` and ``offset`` of the sensor; ``synchronisation`` the
    standard deviation of the angle between projection and reception; ``focus`` of the lens, None for one that is sharp
    everywhere. ``calibration`` has what else is known of the instrument, which is as designed without one; the lengths
    are those that it believes. ``pulse_by`` says where the photodiode of the time of flight looks.
    """

    scale: float
    baseline: float
    axis_separation: float
    pitch: float
    offset: float
    synchronisation: float
    slope: float = 0.0
    focus: LineImage | None = None
    calibration: Calibration | None = None
    pulse_by: RangedBy = "coaxial"

    def position(self, peak: Array) -> Array:
        """Return the position p on the sensor [m] of a fractional pixel, as a lens without distortion would have it."""
        position = self.offset + (peak + 0.5) * self.pitch
        if self.calibration is None:
            return position
        lens = (self.calibration.value(name) for name in ("radial_1", "radial_2", "tangential"))
        return undistorted_position(position, self.scale, self.slope, *lens)

    @property
    def axes(self) -> Axes:
        """The axes of the mirrors, by which points are placed."""
        if self.calibration is None:
            return Axes(self.axis_separation)
        known = self.calibration.value
        return Axes(self.axis_separation, known("axis_offset"), known("axis_skew"))

    def point(self, r: Array, theta: Array, phi: Array) -> tuple[Array, Array, Array]:
        """Return the point (x, y, z) [m] at ranges and deflections."""
        return self.axes.point(r, theta, phi)

    def range_in_common(self, by: RangedBy, r: Array, theta: Array, phi: Array) -> Array:
        """Return what k errors of the calibration, of unit variance each, make of ranges [m], (..., k); k may be 0."""
        if self.calibration is None or not self.calibration.is_uncertain:
            return np.zeros((*np.shape(r), 0))
        return errors_in_common(self.calibration, by, r, theta, phi)[0]

    def sight_of(self, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
        """Return (R, Θ, φ) of points: the inverse of :meth:`point`."""
        return self.axes.sight_of(x, y, z)

    def blur_shift(self, position: Array, theta: ArrayLike) -> Array | float:
        """Return how far the centroid of a spot at a position [m] lies from its chief ray, by defocus [m]."""
        if self.focus is None:
            return 0.0
        return np.asarray(self.focus.at(position, self.baseline * np.cos(theta), 1.0).shift)


@dataclass(frozen=True)
class Deflections:
    """Measured deflections in the middle of the dwell and their standard deviations about the true ones [rad].

    ``sweep_theta`` and ``sweep_phi`` are the angles by which the beam moves while there is light, 0 for one at rest.
    Arrays of shape (n,).
    """

    theta: Array
    phi: Array
    sigma_theta: Array
    sigma_phi: Array
    sweep_theta: ArrayLike = 0.0
    sweep_phi: ArrayLike = 0.0


@dataclass(frozen=True)
class Ranged:
    """Ranges without points, arrays of shape (n,); ``range`` and ``sigma`` NaN wherever ``status`` is not 0.

    ``range`` and ``sigma`` [m], ``status`` codes; ``alone`` the part of σ at a fixed Θ [m], ``by_theta`` ∂R/∂Θ [m].
    """

    range: Array
    sigma: Array
    status: NDArray[np.uint32]
    alone: Array
    by_theta: Array


@dataclass(frozen=True)
class Ranges:
    """Measured ranges, arrays of shape (n,); NaN wherever ``status`` is not 0.

    ``range`` and ``sigma`` [m], ``x``, ``y``, ``z`` [m] in the scanner frame with their ``covariance``, ``status``
    codes.
    """

    range: Array
    sigma: Array
    x: Array
    y: Array
    z: Array
    covariance: PointCovariance
    status: NDArray[np.uint32]


def ranges_from_peaks(
    peak: Array,
    sigma_peak: Array,
    status: NDArray[np.uint32],
    deflections: Deflections,
    geometry: Geometry,
    gate: tuple[float, float] | None,
) -> Ranges:
    """Return the ranges of n shots with their points; arguments as of :func:`ranged_peaks`.

    The points' covariance is :func:`~scanner_sim.ranging.covariance.point_covariance`.
    """
    found = ranged_peaks(peak, sigma_peak, status, deflections, geometry, gate)
    return ranges_with_points(
        found.range, found.sigma, found.status, found.alone, found.by_theta, deflections, geometry
    )


def ranged_peaks(
    peak: Array,
    sigma_peak: Array,
    status: NDArray[np.uint32],
    deflections: Deflections,
    geometry: Geometry,
    gate: tuple[float, float] | None,
) -> Ranged:
    """Return the ranges of n shots.

    Parameters
    ----------
    peak, sigma_peak
        Position and its standard deviation [pixel], shape (n,).
    status
        Status so far, shape (n,).
    deflections
        Measured deflections.
    geometry
        Calibration.
    gate
        Nearest and farthest range accepted [m], or None.

    Returns
    -------
    Ranged
        What a beam that moves does to the range of a surface that faces it is taken off
        (:func:`~scanner_sim.ranging.spot_light.swept_shift`). σ is to first order, from independent errors of p, Θ and
        φ: σ_R² = (∂R/∂p σ_p)² + (∂R/∂Θ σ_Θ)².
    """
    h, d, g, theta = geometry.scale, geometry.baseline, geometry.slope, deflections.theta
    p = geometry.position(peak)
    p = p - geometry.blur_shift(p, theta)
    r = range_from_position(p, theta, h, d, g)
    by_position, by_theta = range_jacobian(p, theta, h, d, g)
    sigma_p = position_sigma(p, sigma_peak, h, geometry.pitch, geometry.synchronisation, g)
    alone = by_position * sigma_p
    sigma = np.hypot(alone, by_theta * deflections.sigma_theta)
    sweep = deflections.sweep_theta, deflections.sweep_phi
    r = r - swept_shift(r, theta, d, geometry.axis_separation, sweep)
    status = status.copy()
    if gate is not None:
        status[(status == VALID) & ~((r >= gate[0]) & (r <= gate[1]))] = Status.OUT_OF_GATE
    invalid = status != VALID
    r[invalid] = np.nan
    sigma[invalid] = np.nan
    return Ranged(r, sigma, status, alone, by_theta)


def ranges_with_points(
    r: Array,
    sigma: Array,
    status: NDArray[np.uint32],
    alone: Array,
    by_theta: Array,
    deflections: Deflections,
    geometry: Geometry,
) -> Ranges:
    """Return ranges of n shots with their points and covariances.

    Parameters
    ----------
    r, sigma, status
        Ranges [m], NaN where ``status`` is not 0, and their σ [m], shape (n,).
    alone
        σ of the ranges at a fixed Θ [m], shape (n,).
    by_theta
        ∂R/∂Θ [m], shape (n,).
    deflections
        Measured deflections.
    geometry
        The two deflection axes.
    """
    theta, phi = deflections.theta, deflections.phi
    covariance = point_covariance(
        r,
        theta,
        phi,
        geometry.axis_separation,
        alone,
        by_theta,
        deflections.sigma_theta,
        deflections.sigma_phi,
    )
    return Ranges(r, sigma, *geometry.point(r, theta, phi), covariance, status)


def with_status(ranges: Ranges, status: NDArray[np.uint32]) -> Ranges:
    """Return ranges of n shots with another status, shape (n,): NaN wherever it is not 0."""

    def kept(values: Array) -> Array:
        return np.where(status == Status.VALID, values, np.nan)

    covariance = ranges.covariance
    entries = (kept(getattr(covariance, field.name)) for field in dataclasses.fields(covariance))
    return Ranges(
        kept(ranges.range),
        kept(ranges.sigma),
        kept(ranges.x),
        kept(ranges.y),
        kept(ranges.z),
        PointCovariance(*entries),
        status,
    )


def layers_of(ranges: Ranges, prefix: str = "") -> Layers:
    """Return ranges as layers of an image, shape (n,), whose names begin with a prefix."""
    covariance = ranges.covariance
    layers = {
        "range_m": ranges.range,
        "sigma_range_m": ranges.sigma,
        "P.X": ranges.x,
        "P.Y": ranges.y,
        "P.Z": ranges.z,
        "sigma_x_m": np.sqrt(covariance.xx),
        "sigma_y_m": np.sqrt(covariance.yy),
        "sigma_z_m": np.sqrt(covariance.zz),
        "cov_xy_m2": covariance.xy,
        "cov_xz_m2": covariance.xz,
        "cov_yz_m2": covariance.yz,
        "status": ranges.status,
    }
    return {prefix + name: values for name, values in layers.items()}
