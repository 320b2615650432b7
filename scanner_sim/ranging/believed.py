"""The point that an instrument believes it has measured, as a function of its readings and of its parameters.

This is the observation equation of a calibration: all readings at once, any parameters, with the whole Jacobian in
closed form. What ranges voxels (:mod:`scanner_sim.ranging.ranges`) goes by the same laws.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.parameters import INDEX, PARAMETERS, PHI_ERRORS, THETA_ERRORS
from scanner_sim.optics.encoder_errors import (
    pointing_by_errors,
    pointing_error,
    pointing_slope,
)
from scanner_sim.ranging.coordinates import coordinates
from scanner_sim.ranging.departures import (
    axes_shift,
    ideal_way,
    point_derivatives,
    tangent_derivatives,
)

Array = NDArray[np.float64]

RangedBy: TypeAlias = Literal["triangulation", "coaxial", "offset"]
"""By the position on the line sensor; by the way of a pulse to a photodiode on the laser's axis, or at the base."""

_LENS = tuple(INDEX[name] for name in ("radial_1", "radial_2", "tangential"))


@dataclass(frozen=True)
class Design:
    """An instrument as it was designed, to which parameters are deviations.

    Attributes
    ----------
    image_distance
        Of the array behind the lens, where the image of infinity falls [m]; f of an upright array in the focal plane.
    baseline, axis_separation
        d and D_g [m].
    array_tilt
        Of the array against the lens [rad], positive where its near end (+p) leans away.
    """

    image_distance: float
    baseline: float
    axis_separation: float
    array_tilt: float = 0.0


@dataclass(frozen=True)
class VoxelReadings:
    """What an instrument reads of voxels, arrays of one shape (...).

    Attributes
    ----------
    theta, phi
        What the encoders read [rad].
    measured
        In triangulation the position of the spot as the array's design has it, ``offset`` + (pixel + ½) ``pitch`` [m],
        less what a blur out of focus shifts (:meth:`~scanner_sim.ranging.ranges.Geometry.blur_shift`);
        in time of flight the way c τ of the pulse there and back [m].
    by
        Which of them.
    """

    theta: Array
    phi: Array
    measured: Array
    by: RangedBy = "triangulation"


@dataclass(frozen=True)
class BelievedPoints:
    """Points with their derivatives; leading axes (...) are those of readings and parameters, broadcast.

    Attributes
    ----------
    point
        x, y, z in the scanner frame [m], shape (..., 3).
    range
        R [m], shape (...).
    deflections
        Θ and φ of the beam [rad], shape (..., 2).
    by_parameters
        ∂(x, y, z)/∂parameter, shape (..., 3, parameters), in the order of
        :data:`~scanner_sim.foundation.parameters.PARAMETERS`.
    range_by_parameters
        ∂R/∂parameter, shape (..., parameters).
    by_readings
        ∂(x, y, z)/∂(ϑ, φ, measured), shape (..., 3, 3).
    """

    point: Array
    range: Array
    deflections: Array
    by_parameters: Array
    range_by_parameters: Array
    by_readings: Array


def believed_points(
    readings: VoxelReadings, design: Design, parameters: ArrayLike, encoder_period: float = math.tau
) -> BelievedPoints:
    """Return the points that readings mean to an instrument with given parameters, with all derivatives.

    Parameters
    ----------
    readings
        Of any number of voxels.
    design
        The instrument as designed.
    parameters
        Deviations from the design in SI, in the order of :data:`~scanner_sim.foundation.parameters.PARAMETERS`, shape
        (parameters,) for all readings alike, or (..., parameters) whose leading axes broadcast against the readings'.
    encoder_period
        Period of the encoders' periodic error [rad].

    Returns
    -------
    BelievedPoints
        The encoders' errors give Θ and φ (:func:`~scanner_sim.optics.encoder_errors.pointing_error`); tilt, shift and
        scale of the array and the lens's distortion give the tangent x of the angle of sight and
        R = d (cosΘ/x + sinΘ), eq 1, or the pulse's zero and scale give R by eq 2; offset and skew of the second axis
        and D_g give the point, eq 3 (Blais, Beraldin, El-Hakim 2000). Nothing is linearised; the derivatives are those
        of the whole chain.
    """
    values = np.asarray(parameters, dtype=np.float64)
    theta = _deflection(readings.theta, values, THETA_ERRORS, encoder_period)
    phi = _deflection(readings.phi, values, PHI_ERRORS, encoder_period)
    ranged = _RANGED[readings.by](readings, design, values, theta.angle)
    return _points(design, values, theta, phi, ranged)


@dataclass(frozen=True)
class _Deflected:
    """A deflection [rad], its derivative by the reading, and those by its five parameters, at ``index``."""

    angle: Array
    by_reading: Array
    by_errors: Array
    index: list[int]


@dataclass(frozen=True)
class _Ranged:
    """Ranges [m] with derivatives by Θ, by what was measured, and by parameters: number and values of each."""

    range: Array
    by_theta: Array
    by_measured: Array
    by_parameter: dict[int, Array]


def _deflection(reading: Array, values: Array, index: list[int], period: float) -> _Deflected:
    errors = values[..., index]
    angle = reading + pointing_error(reading, errors, period)
    return _Deflected(
        angle, 1.0 + pointing_slope(reading, errors, period), pointing_by_errors(reading, period), index
    )


def _of_position(readings: VoxelReadings, design: Design, values: Array, theta: Array) -> _Ranged:
    """Return ranges by eq 1, with the tangent x of the angle of sight: R = d (cosΘ/x + sinΘ)."""
    d = design.baseline + values[..., INDEX["base"]]
    tilt = design.array_tilt + values[..., INDEX["array_tilt"]]
    slope, secant = np.sin(tilt) / np.cos(tilt), 1.0 / np.cos(tilt)
    scale = (design.image_distance + values[..., INDEX["focal_length"]]) * secant
    wider = 1.0 + values[..., INDEX["array_scale"]]
    p = np.asarray(readings.measured)
    position = p * wider + values[..., INDEX["array_offset"]]
    x, by_position, by_scale, by_slope, by_lens = tangent_derivatives(
        position, scale, slope, *(values[..., number] for number in _LENS)
    )
    sine, cosine = np.sin(theta), np.cos(theta)
    per_base = cosine / x + sine
    by_x = -d * cosine / (x * x)
    by = {
        INDEX["base"]: per_base,
        INDEX["focal_length"]: by_x * by_scale * secant,
        INDEX["array_tilt"]: by_x * (by_scale * scale * slope + by_slope * secant * secant),
        INDEX["array_offset"]: by_x * by_position,
        INDEX["array_scale"]: by_x * by_position * p,
    }
    by |= {number: by_x * by_lens[..., column] for column, number in enumerate(_LENS)}
    return _Ranged(
        np.asarray(d * per_base),
        np.asarray(d * (cosine - sine / x)),
        np.asarray(by_x * by_position * wider),
        by,
    )


def _of_way(readings: VoxelReadings, design: Design, values: Array, theta: Array, *, aside: bool) -> _Ranged:
    """Return ranges by eq 2, the lens on the laser's axis or at the base: R = (L² − d²)/(2 (L − d sinΘ))."""
    zero, scale = values[..., INDEX["tof_zero"]], values[..., INDEX["tof_scale"]]
    way = ideal_way(readings.measured, zero, scale)
    d = (design.baseline + values[..., INDEX["base"]]) if aside else np.zeros(())
    short = way - d * np.sin(theta)
    r = (way * way - d * d) / (2.0 * short)
    by_way = (way * way - 2.0 * way * d * np.sin(theta) + d * d) / (2.0 * short * short)
    by_measured = by_way / (1.0 + scale)
    by = {
        INDEX["tof_zero"]: -2.0 * by_way,
        INDEX["tof_scale"]: -by_measured * np.asarray(readings.measured) / (1.0 + scale),
    }
    if aside:
        by[INDEX["base"]] = (r * np.sin(theta) - d) / short
    return _Ranged(np.asarray(r), np.asarray(r * d * np.cos(theta) / short), np.asarray(by_measured), by)


def _coaxial(readings: VoxelReadings, design: Design, values: Array, theta: Array) -> _Ranged:
    return _of_way(readings, design, values, theta, aside=False)


def _offset(readings: VoxelReadings, design: Design, values: Array, theta: Array) -> _Ranged:
    return _of_way(readings, design, values, theta, aside=True)


_RANGED = {"triangulation": _of_position, "coaxial": _coaxial, "offset": _offset}


def _points(
    design: Design, values: Array, theta: _Deflected, phi: _Deflected, ranged: _Ranged
) -> BelievedPoints:
    """Return the points of ranges and deflections, with the derivatives of the whole chain."""
    separation = design.axis_separation + values[..., INDEX["axis_separation"]]
    axes = values[..., INDEX["axis_offset"]], values[..., INDEX["axis_skew"]]
    sine, cosine = np.sin(theta.angle), np.cos(theta.angle)
    aside, reach = ranged.range * sine, ranged.range * cosine - separation
    ideal = coordinates(ranged.range, theta.angle, phi.angle, separation)
    shift = axes_shift(aside, reach, phi.angle, *axes)
    point = np.stack(np.broadcast_arrays(*(one + other for one, other in zip(ideal, shift, strict=True))), -1)
    by_aside, by_reach, by_phi, by_offset, by_skew = point_derivatives(aside, reach, phi.angle, *axes)
    by_range = by_aside * sine[..., None] + by_reach * cosine[..., None]
    turned = by_aside * (ranged.range * cosine)[..., None] - by_reach * aside[..., None]
    by_theta = turned + by_range * ranged.by_theta[..., None]
    shape = point.shape[:-1]
    total, alone = np.zeros((*shape, 3, len(PARAMETERS))), np.zeros((*shape, len(PARAMETERS)))
    for column, number in enumerate(theta.index):
        total[..., number] = by_theta * theta.by_errors[..., column, None]
        alone[..., number] = ranged.by_theta * theta.by_errors[..., column]
    for column, number in enumerate(phi.index):
        total[..., number] = by_phi * phi.by_errors[..., column, None]
    for number, gradient in ranged.by_parameter.items():
        total[..., number] = by_range * np.asarray(gradient)[..., None]
        alone[..., number] = gradient
    total[..., INDEX["axis_separation"]] = np.array([0.0, 0.0, 1.0]) - by_reach
    total[..., INDEX["axis_offset"]] = by_offset
    total[..., INDEX["axis_skew"]] = by_skew
    by_readings = np.stack(
        np.broadcast_arrays(
            by_theta * theta.by_reading[..., None],
            by_phi * phi.by_reading[..., None],
            by_range * ranged.by_measured[..., None],
        ),
        axis=-1,
    )
    deflections = np.stack(np.broadcast_arrays(theta.angle, phi.angle), axis=-1)
    return BelievedPoints(point, ranged.range, deflections, total, alone, by_readings)
