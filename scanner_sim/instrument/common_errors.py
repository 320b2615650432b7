"""What the errors of a calibration add to σ: last of all, since what compares voxels compares their noise."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from scanner_sim.ranging.believed import RangedBy
from scanner_sim.ranging.calibration import Calibration, errors_in_common
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


def add_common_errors(layers: Layers, rangefinders: Sequence[str], geometry: Geometry) -> None:
    """Add the calibration's share to σ and covariances, and the layer of it; ``layers`` change in place.

    Parameters
    ----------
    layers
        Layers of one shape, whose σ are those of noise.
    rangefinders
        What measured them.
    geometry
        With its calibration; without one, or with one that has no errors, nothing changes.
    """
    calibration = geometry.calibration
    if calibration is None or not calibration.is_uncertain:
        return
    ways = ranged_by(rangefinders, geometry)
    found = {prefix: _added(layers, prefix, by, calibration, geometry) for prefix, by in ways.items()}
    for new in found.values():
        layers.update(new)


def _added(
    layers: Layers, prefix: str, by: tuple[RangedBy, ...], calibration: Calibration, geometry: Geometry
) -> Layers:
    """Return the layers of one way of ranging with the calibration's share."""
    shape, kind = layers[f"{prefix}range_m"].shape, layers[f"{prefix}range_m"].dtype
    names = ("sigma_range_m", *_SIGMAS, *_PRODUCTS)
    sums = {name: layers[prefix + name].astype(np.float64).ravel() for name in names}
    common = np.full(sums["sigma_range_m"].shape, np.nan)
    for part in _parts(common.size):
        r, moved = _errors(layers, prefix, by, part, calibration, geometry)
        common[part] = np.sqrt((r * r).sum(axis=-1))
        shared = np.einsum("nik,njk->nij", moved, moved)
        sums["sigma_range_m"][part] = np.hypot(sums["sigma_range_m"][part], common[part])
        for axis, name in enumerate(_SIGMAS):
            sums[name][part] = np.sqrt(sums[name][part] ** 2 + shared[:, axis, axis])
        for name, (one, other) in _PRODUCTS.items():
            sums[name][part] += shared[:, one, other]
    sums[COMMON] = common
    return {prefix + name: values.reshape(shape).astype(kind) for name, values in sums.items()}


_SIGMAS = ("sigma_x_m", "sigma_y_m", "sigma_z_m")
_PRODUCTS = {"cov_xy_m2": (0, 1), "cov_xz_m2": (0, 2), "cov_yz_m2": (1, 2)}


def _parts(count: int) -> Iterator[slice]:
    yield from (slice(first, first + _TOGETHER) for first in range(0, count, _TOGETHER))


def _errors(
    layers: Layers,
    prefix: str,
    by: tuple[RangedBy, ...],
    part: slice,
    calibration: Calibration,
    geometry: Geometry,
) -> tuple[Array, Array]:
    """Return what the calibration's errors make of ranges, (n, k), and points, (n, 3, k), of some voxels."""

    def flat(name: str) -> Array:
        return np.asarray(layers[name].ravel()[part].astype(np.float64))

    point = (flat(f"{prefix}P.{axis}") for axis in "XYZ")
    _, theta, phi = geometry.sight_of(*point)
    parts = [errors_in_common(calibration, way, flat(f"{prefix}range_m"), theta, phi) for way in by]
    if len(parts) == 1:
        return parts[0]
    sigmas = (flat(f"{own}sigma_range_m") for own in ("", "tof."))
    totals = [
        np.hypot(sigma, np.sqrt((r * r).sum(axis=-1))) for sigma, (r, _) in zip(sigmas, parts, strict=True)
    ]
    valid = (flat(f"{own}status") == 0 for own in ("", "tof."))
    share = share_of_pulses(*totals, *valid)[:, None]
    (r1, moved1), (r2, moved2) = parts
    return (1.0 - share) * r1 + share * r2, (1.0 - share[..., None]) * moved1 + share[..., None] * moved2
