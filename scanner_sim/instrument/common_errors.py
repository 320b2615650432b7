"""What the errors of a calibration add to σ: last of all, since what compares voxels compares their noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import product
from scanner_sim.foundation.channels import JACOBIAN, MOVED
from scanner_sim.foundation.parameters import INDEX
from scanner_sim.optics.deflection import Mirrors
from scanner_sim.ranging.believed import Design, RangedBy
from scanner_sim.ranging.calibration import Calibration, parameter_effects
from scanner_sim.ranging.covariance import shaken_covariance
from scanner_sim.ranging.fusion import range_covariance, share_of_pulses, slopes_by_theta
from scanner_sim.ranging.ranges import Columns, Geometry, Layers

Array = NDArray[np.float64]

_TOGETHER = 1 << 15
"""Voxels whose derivatives are held at once: some fifty megabytes."""
COMMON = "sigma_common_m"
"""Layer of the part of a range's σ that all voxels have in common."""


class ReadingsOfTheta(NamedTuple):
    """What the mirrors' readings of Θ err by: the deflections [rad] and times [s] of shots, each (voxels,)."""

    mirrors: Mirrors
    theta: Array
    time: Array

    def sigma(self, part: slice) -> Array:
        """Return σ of the readings of some of the shots [rad], shape (voxels,)."""
        return self.mirrors.reading_sigma(self.theta[part], self.time[part])


def ranged_by(rangefinders: Sequence[str], geometry: Geometry) -> dict[str, tuple[RangedBy, ...]]:
    """Return how the ranges of layers were measured, by the begin of their names; fused ones by two."""
    pulse = geometry.pulse_by
    if tuple(rangefinders) == ("tof",):
        return {"": (pulse,), "tof.": (pulse,)}
    if tuple(rangefinders) == ("triangulation",):
        return {"": ("triangulation",)}
    return {"": ("triangulation",), "tof.": (pulse,), "fused.": ("triangulation", pulse)}


def add_common_errors(
    layers: Layers,
    rangefinders: Sequence[str],
    geometry: Geometry,
    readings: ReadingsOfTheta,
    *,
    jacobian: bool = False,
) -> None:
    """Add the calibration's share to σ and covariances, and the layer of it; ``layers`` change in place.

    The vibration that it knows comes to the points' covariances, and to no range.

    Parameters
    ----------
    layers
        Layers of one shape, whose σ are those of noise.
    rangefinders
        What measured them.
    geometry
        With its calibration; without one, or with one that knows of no errors, nothing changes.
    readings
        Of the voxels' shots.
    jacobian
        Add the derivatives of points and ranges by each parameter that has an error, too
        (:data:`~scanner_sim.foundation.channels.DERIVATIVES`).
    """
    calibration, ways = geometry.calibration, ranged_by(rangefinders, geometry)
    if calibration is None:
        return
    if calibration.vibration is not None:
        for prefix in ways:
            layers.update(_shaken(layers, prefix, *calibration.vibration.deviations))
    if not calibration.is_uncertain:
        return
    names = calibration.uncertain if jacobian else ()
    # Fused ranges come last: they are weighed by the whole σ of both others.
    for prefix, by in ways.items():
        layers.update(_added(layers, prefix, by, calibration, geometry, readings, names))


def _added(
    layers: Layers,
    prefix: str,
    by: tuple[RangedBy, ...],
    calibration: Calibration,
    geometry: Geometry,
    readings: ReadingsOfTheta,
    parameters: Sequence[str],
) -> Layers:
    """Return the layers of one way of ranging with the calibration's share, and the derivatives by some parameters."""
    shape, kind = layers[f"{prefix}range_m"].shape, layers[f"{prefix}range_m"].dtype
    names = ("sigma_range_m", *_SIGMAS, *_PRODUCTS)
    sums = {name: layers[prefix + name].astype(np.float64).ravel() for name in names}
    common = np.full(sums["sigma_range_m"].shape, np.nan)
    slopes = {name: np.empty((len(MOVED), common.size), dtype=kind) for name in parameters}
    for part in _parts(common.size):
        range_by, point_by = derivatives(
            layers, prefix, by, geometry, readings, calibration.design, calibration.encoder_period, part
        )
        r, moved = product(range_by, calibration.root), product(point_by, calibration.root)
        common[part] = np.sqrt((r * r).sum(axis=-1))
        shared = np.einsum("nik,njk->nij", moved, moved)
        sums["sigma_range_m"][part] = np.hypot(sums["sigma_range_m"][part], common[part])
        for axis, name in enumerate(_SIGMAS):
            sums[name][part] = np.sqrt(sums[name][part] ** 2 + shared[:, axis, axis])
        for name, (one, other) in _PRODUCTS.items():
            sums[name][part] += shared[:, one, other]
        for name, slope in slopes.items():
            slope[:3, part], slope[3, part] = point_by[..., INDEX[name]].T, range_by[..., INDEX[name]]
    sums[COMMON] = common
    for name, slope in slopes.items():
        sums |= {f"{JACOBIAN}{name}.{moved}": row for moved, row in zip(MOVED, slope, strict=True)}
    return {prefix + name: values.reshape(shape).astype(kind) for name, values in sums.items()}


def _shaken(layers: Layers, prefix: str, turn: float, shift: float) -> Layers:
    """Return the layers of one way of ranging with what a platform that shakes adds to their points' covariances."""
    x, y, z = (layers[f"{prefix}P.{axis}"].astype(np.float64) for axis in "XYZ")
    added, found = shaken_covariance(x, y, z, turn, shift), Layers()
    for name, more in zip(_SIGMAS, (added.xx, added.yy, added.zz), strict=True):
        own = layers[prefix + name]
        found[prefix + name] = np.sqrt(own.astype(np.float64) ** 2 + more).astype(own.dtype)
    for name, more in zip(_PRODUCTS, (added.xy, added.xz, added.yz), strict=True):
        own = layers[prefix + name]
        found[prefix + name] = (own + more).astype(own.dtype)
    return found


_SIGMAS = ("sigma_x_m", "sigma_y_m", "sigma_z_m")
_PRODUCTS = {"cov_xy_m2": (0, 1), "cov_xz_m2": (0, 2), "cov_yz_m2": (1, 2)}


def _parts(count: int) -> Iterator[slice]:
    yield from (slice(first, first + _TOGETHER) for first in range(0, count, _TOGETHER))


def derivatives(
    layers: Columns,
    prefix: str,
    by: tuple[RangedBy, ...],
    geometry: Geometry,
    readings: ReadingsOfTheta,
    design: Design,
    encoder_period: float,
    part: slice = slice(None),
) -> tuple[Array, Array]:
    """Return the derivatives of voxels' ranges, (n, parameters), and points, (n, 3, parameters).

    Parameters
    ----------
    layers
        Layers of any one shape; σ of what is fused are whole ones.
    prefix, by
        Begin of the layers' names, and how they were measured (:func:`ranged_by`).
    geometry
        With its calibration.
    readings
        Of the voxels' shots; read of fused ranges alone.
    design, encoder_period
        The instrument, and the period of its encoders' errors [rad].
    part
        Which of the voxels, in the order of rows.
    """

    def flat(name: str) -> Array:
        return np.asarray(layers[name].ravel()[part].astype(np.float64))

    _, theta, phi = geometry.sight_of(*(flat(f"{prefix}P.{axis}") for axis in "XYZ"))
    r = flat(f"{prefix}range_m")
    effects = [parameter_effects(design, way, r, theta, phi, encoder_period) for way in by]
    parts = [(effect.range_by_parameters, effect.by_parameters) for effect in effects]
    # What no parameter moves has a derivative only where there is a point.
    for own in (own for pair in parts for own in pair):
        own[np.isnan(r)] = np.nan
    if len(parts) == 1:
        return parts[0]
    one, other = (flat(f"{own}sigma_range_m") for own in ("", "tof."))
    one_valid, other_valid = (flat(f"{own}status") == 0 for own in ("", "tof."))
    (range_1, point_1), (range_2, point_2) = parts
    known, common = geometry.calibration, None
    if known is not None and known.is_uncertain:
        common = product(range_1, known.root), product(range_2, known.root)
    covariance = range_covariance(slopes_by_theta(r, r, theta, geometry), readings.sigma(part), common)
    share = share_of_pulses(one, other, one_valid, other_valid, covariance)[:, None]
    return (
        (1.0 - share) * range_1 + share * range_2,
        (1.0 - share[..., None]) * point_1 + share[..., None] * point_2,
    )
