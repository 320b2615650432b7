"""A calibration: what an instrument believes of its departures from its design, and how well it knows them.

Its errors are common to all that the instrument measures: no mean makes them smaller.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.arithmetic import eigen, inverse, product
from scanner_sim.foundation.parameters import INDEX, NAMES, PHI_ERRORS, THETA_ERRORS
from scanner_sim.optics.encoder_errors import pointing_error
from scanner_sim.optics.vibration import Vibration
from scanner_sim.ranging.believed import BelievedPoints, Design, RangedBy, VoxelReadings, believed_points

Array = NDArray[np.float64]

_SETTLED = 4
"""Steps by which the encoders' errors are taken off their readings: each leaves a thousandth of the last."""
_NOISE_OF_ROUNDING = 1e-12
"""Share of the largest variance below which a combination of parameters is known exactly."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """The believed instrument.

    Attributes
    ----------
    values
        Believed parameters in SI, in the order of :data:`~scanner_sim.foundation.parameters.PARAMETERS`, shape
        (parameters,).
    covariance
        Of their errors, shape (parameters, parameters); zero rows for those that are taken to be exact.
    design
        The instrument to which they are deviations.
    encoder_period
        Period of the encoders' periodic errors [rad].
    vibration
        How the platform is known to shake; None for not at all.
    power_noise, pulse_noise
        Known standard deviations of the laser's power and of the pulses' energy from shot to shot, relative.
    """

    values: Array
    covariance: Array
    design: Design
    encoder_period: float = math.tau
    vibration: Vibration | None = None
    power_noise: float = 0.0
    pulse_noise: float = 0.0

    def value(self, name: str) -> float:
        """Return a believed parameter."""
        return float(self.values[INDEX[name]])

    @cached_property
    def root(self) -> Array:
        """L with L Lᵀ the covariance, shape (parameters, k): k independent errors, of unit variance."""
        scale = np.sqrt(np.diagonal(self.covariance))
        unit = np.where(scale > 0.0, scale, 1.0)
        squares, axes = eigen(self.covariance / unit / unit[:, None])
        kept = squares > _NOISE_OF_ROUNDING * squares.max(initial=0.0)
        return np.asarray(unit[:, None] * axes[:, kept] * np.sqrt(squares[kept]))

    @property
    def uncertain(self) -> tuple[str, ...]:
        """Names of the parameters that have an error."""
        return tuple(name for name in NAMES if self.covariance[INDEX[name], INDEX[name]] > 0.0)

    @property
    def is_uncertain(self) -> bool:
        """Whether any of it has an error."""
        return bool(self.covariance.any())

    def deflections(self, theta: Array, phi: Array) -> tuple[Array, Array]:
        """Return where the mirrors are believed to point [rad] when the encoders read so."""
        period = self.encoder_period
        return (
            theta + pointing_error(theta, self.values[THETA_ERRORS], period),
            phi + pointing_error(phi, self.values[PHI_ERRORS], period),
        )

    def readings(self, theta: Array, phi: Array) -> tuple[Array, Array]:
        """Return what encoders read when the mirrors are believed to point so: :meth:`deflections` solved."""
        read = theta, phi
        for _ in range(_SETTLED):
            seen = self.deflections(*read)
            read = read[0] + theta - seen[0], read[1] + phi - seen[1]
        return read


def ideal_readings(
    design: Design, by: RangedBy, r: ArrayLike, theta: ArrayLike, phi: ArrayLike
) -> VoxelReadings:
    """Return what an instrument as designed would read of ranges [m] and deflections [rad]."""
    r, theta, phi = (np.asarray(value, dtype=np.float64) for value in (r, theta, phi))
    if by == "triangulation":
        tangent = design.baseline * np.cos(theta) / (r - design.baseline * np.sin(theta))
        along = np.cos(design.array_tilt) - np.sin(design.array_tilt) * tangent
        return VoxelReadings(theta, phi, design.image_distance * tangent / along, by)
    d = 0.0 if by == "coaxial" else design.baseline
    return VoxelReadings(theta, phi, r + np.sqrt(r * r + d * d - 2.0 * r * d * np.sin(theta)), by)


def errors_in_common(
    calibration: Calibration, by: RangedBy, r: ArrayLike, theta: ArrayLike, phi: ArrayLike
) -> tuple[Array, Array]:
    """Return what the errors of a calibration make of measured ranges and points.

    Parameters
    ----------
    calibration
        With its covariance.
    by
        How the ranges were measured.
    r, theta, phi
        R [m], Θ and φ [rad], arrays of one shape (...).

    Returns
    -------
    tuple
        A, shape (..., k), and B, shape (..., 3, k): range and point err by A z and B z, where z are k independent
        numbers of unit variance, the same for every voxel and shot. The covariance of two points is B₁ B₂ᵀ. The
        derivatives are those at the design; what the deviations change of them is of second order.
    """
    found = parameter_effects(calibration.design, by, r, theta, phi, calibration.encoder_period)
    root = calibration.root
    return product(found.range_by_parameters, root), product(found.by_parameters, root)


def parameter_effects(
    design: Design,
    by: RangedBy,
    r: ArrayLike,
    theta: ArrayLike,
    phi: ArrayLike,
    encoder_period: float = math.tau,
) -> BelievedPoints:
    """Return points with their derivatives by every parameter, for ranges [m] and deflections [rad] of any shape."""
    readings = ideal_readings(design, by, r, theta, phi)
    return believed_points(readings, design, np.zeros(len(NAMES)), encoder_period)


def position_in_common(calibration: Calibration, by: RangedBy, position: Array) -> Array:
    """Return what the errors of a calibration make of measured positions.

    Parameters
    ----------
    calibration, by
        As of :func:`errors_in_common`.
    position
        (Θ, φ, R) of targets by eq 3 as designed [rad, m], shape (..., 3).

    Returns
    -------
    ndarray
        C, shape (..., 3, k): positions err by C z, so that the points err by B z.
    """
    theta, phi, r = np.moveaxis(position, -1, 0)
    separation = calibration.design.axis_separation
    _, moved = errors_in_common(calibration, by, r, theta, phi)
    sine, cosine, down, ahead = np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi)
    reach, none = r * cosine - separation, 0.0 * r
    rows = (
        (r * cosine, none, sine),
        (-r * sine * down, reach * ahead, cosine * down),
        (-r * sine * ahead, -reach * down, cosine * ahead),
    )
    by_place = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return product(inverse(by_place), moved)
