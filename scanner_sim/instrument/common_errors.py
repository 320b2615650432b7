"""What the errors of a calibration add to σ: last of all, since what compares voxels compares their noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import product
from scanner_sim.foundation.channels import JACOBIAN, MOVED
from scanner_sim.foundation.parameters import INDEX
from scanner_sim.ranging.believed import RangedBy
from scanner_sim.ranging.calibration import Calibration, parameter_effects
from scanner_sim.ranging.fusion import share_of_pulses
from scanner_sim.ranging.ranges import Geometry, Layers

Array = NDArray[np.float64]

_TOGETHER = 1 << 15
"""Voxels whose derivatives are held at once: some fifty megabytes."""
COMMON = "sigma_common_m"
"""Layer of the part of a range's σ that all voxels have in common."""


def ranged_by(rangefinders: Sequence[str], geometry: Geometry) -> dict[str, tuple[RangedBy, ...]]:
    """Return how the ranges of layers were measured, by the begin of their names; fused ones by two."""
    pulse = geometry.pulse_by
    if tuple(rangefinders) == ("tof",):
        return {"": (pulse,), "tof.": (pulse,)}
    if tuple(rangefinders) == ("triangulation",):
        return {"": ("triangulation",)}
    return {"": ("triangulation",), "tof.": (pulse,), "fused.": ("triangulation", pulse)}


def add_common_errors(
    layers: Layers, rangefinders: Sequence[str], geometry: Geometry, *, jacobian: bool = False
) -> None:
    """Add the calibration's share to σ and covariances, and the layer of it; ``layers`` change in place.

    Parameters
    ----------
    layers
        Layers of one shape, whose σ are those of noise.
    rangefinders
        What measured them.
    geometry
        With its calibration; without one, or with one that has no errors, nothing changes.
    jacobian
        Add the derivatives of points and ranges by each parameter that has an error, too
        (:data:`~scanner_sim.foundation.channels.DERIVATIVES`).
    """
    calibration = geometry.calibration
    if calibration is None or not calibration.is_uncertain:
        return
    ways = ranged_by(rangefinders, geometry)
    names = calibration.uncertain if jacobian else ()
    found = {prefix: _added(layers, prefix, by, calibration, geometry, names) for prefix, by in ways.items()}
    for new in found.values():
        layers.update(new)


def _added(
    layers: Layers,
    prefix: str,
    by: tuple[RangedBy, ...],
    calibration: Calibration,
    geometry: Geometry,
    parameters: Sequence[str],
) -> Layers:
    """Return the layers of one way of ranging with the calibration's share, and the derivatives by some parameters."""
    shape, kind = layers[f"{prefix}range_m"].shape, layers[f"{prefix}range_m"].dtype
    names = ("sigma_range_m", *_SIGMAS, *_PRODUCTS)
    sums = {name: layers[prefix + name].astype(np.float64).ravel() for name in names}
    common = np.full(sums["sigma_range_m"].shape, np.nan)
    slopes = {name: np.empty((len(MOVED), common.size), dtype=kind) for name in parameters}
    for part in _parts(common.size):
        range_by, point_by = _effects(layers, prefix, by, part, calibration, geometry)
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
            # What no parameter moves has a derivative only where there is a point.
            slope[:, part][:, np.isnan(common[part])] = np.nan
    sums[COMMON] = common
    for name, slope in slopes.items():
        sums |= {f"{JACOBIAN}{name}.{moved}": row for moved, row in zip(MOVED, slope, strict=True)}
    return {prefix + name: values.reshape(shape).astype(kind) for name, values in sums.items()}


_SIGMAS = ("sigma_x_m", "sigma_y_m", "sigma_z_m")
_PRODUCTS = {"cov_xy_m2": (0, 1), "cov_xz_m2": (0, 2), "cov_yz_m2": (1, 2)}


def _parts(count: int) -> Iterator[slice]:
    yield from (slice(first, first + _TOGETHER) for first in range(0, count, _TOGETHER))


def _effects(
    layers: Layers,
    prefix: str,
    by: tuple[RangedBy, ...],
    part: slice,
    calibration: Calibration,
    geometry: Geometry,
) -> tuple[Array, Array]:
    """Return the derivatives of some voxels' ranges, (n, parameters), and points, (n, 3, parameters)."""

    def flat(name: str) -> Array:
        return np.asarray(layers[name].ravel()[part].astype(np.float64))

    _, theta, phi = geometry.sight_of(*(flat(f"{prefix}P.{axis}") for axis in "XYZ"))
    design, period, r = calibration.design, calibration.encoder_period, flat(f"{prefix}range_m")
    effects = [parameter_effects(design, way, r, theta, phi, period) for way in by]
    parts = [(effect.range_by_parameters, effect.by_parameters) for effect in effects]
    if len(parts) == 1:
        return parts[0]
    common = [np.linalg.norm(product(range_by, calibration.root), axis=-1) for range_by, _ in parts]
    sigmas = (flat(f"{own}sigma_range_m") for own in ("", "tof."))
    totals = [np.hypot(sigma, own) for sigma, own in zip(sigmas, common, strict=True)]
    valid = (flat(f"{own}status") == 0 for own in ("", "tof."))
    share = share_of_pulses(*totals, *valid)[:, None]
    (range_1, point_1), (range_2, point_2) = parts
    return (
        (1.0 - share) * range_1 + share * range_2,
        (1.0 - share[..., None]) * point_1 + share[..., None] * point_2,
    )
