"""The part of a visit's error that stays from visit to visit: the speckle of the target's own surface.

A pattern follows its target, so that its beam runs over the same curve on the surface again and again, and meets the
same speckle. Only the positions of the dwells on the curve change (the dither of the sampling). What remains when they
are averaged over the curve *lasts*: until the surface turns beneath the pattern by about the beam's radius.

With the gains g_i of an estimate by its voxels, δ = Σ g_i σ_i z_i, σ_i the standard deviation of a voxel by speckle and
z_i its normal number, which belongs to the position of the dwell's middle. Two visits whose dwells begin anywhere
between those of an average one have in common

    Σ_ij g_i σ_i g_j σ_j ⟨ρ(r_i + u t_i − r_j − u′ t_j)⟩,   u, u′ even in ±½,

with t_i the way from voxel to voxel, ρ = exp(−δ²/w²) of the light and (1 − 2δ_x²/w²) exp(−δ²/w²) of its position along
the line (:mod:`scanner_sim.optics.speckle`). The white part is the rest.

Not modelled, as in :mod:`scanner_sim.detector.line.speckle`: what overlapping dwells have in common beyond their
middles. Of a beam that sweeps three of its radii in a dwell it would make nearly all of the speckle last, instead of
half of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import exp, product
from scanner_sim.tracking.measurement import Measurement, Sight
from scanner_sim.tracking.samples import PatternSamples, rise_per_point

Array = NDArray[np.float64]

_POINTS_PER_VOXEL = 3
"""Points of the curve for each voxel: the beam is wider than the way between two of them."""
_REACH_RADII = 2.5
"""Radii of the beam beyond which two points have nothing in common, 2e-3."""
_NEGLIGIBLE_SHARE = 0.01
"""Share of the largest error of a voxel that does not count."""
_LARGEST_SHARE = 0.9
"""Share of a variance that may last: no dither leaves the dwells where they were."""


@dataclass(frozen=True)
class SurfaceSpeckle:
    """What the instrument knows of the speckle of surfaces at a range, by pattern.

    Attributes
    ----------
    radius
        1/e² radius w of the beam [m], shape (patterns,).
    light
        Relative variance of each voxel's light, C²/M with what its dwell leaves of it, shape (patterns, points).
    on_surface
        Share of the variance of the light's position that comes from its position on the surface; the rest follows the
        light (:class:`~scanner_sim.optics.speckle.Packets`), shape (patterns,).
    range_noise
        Variance of a voxel's range without speckle [m²], shape (patterns,).
    """

    radius: Array
    light: Array
    on_surface: Array
    range_noise: Array


def surface_covariance(
    samples: PatternSamples,
    seen: Measurement,
    speckle: SurfaceSpeckle,
) -> Array:
    """Return the covariance of (Θ, φ, R) that flat targets' surfaces give to all visits alike.

    Parameters
    ----------
    samples, seen
        Patterns, and where their voxels show the target, with their covariance.
    speckle
        The speckle there.

    Returns
    -------
    ndarray
        Shape (patterns, 3, 3) [rad, rad, m]; at most nine tenths of the variance that the voxels tell.
    """
    result = np.zeros_like(seen.covariance)
    if seen.sight is None:
        return result
    # Nothing is known of patterns that hardly show a target.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        moved = _range_errors(samples, seen.sight, speckle)
        for row in np.flatnonzero(seen.found & (seen.radius > 0.0)).tolist():
            limited = _limit(_surface(seen.sight, speckle, moved, row), seen.covariance[row])
            if np.isfinite(limited).all():
                result[row] = limited
    return result


def _limit(part: Array, whole: Array) -> Array:
    """Return a part of a covariance, of (Θ, φ) and of R, that leaves a tenth of the whole in every direction."""
    (a, b), (_, c) = whole[:2, :2]
    (p, q), (_, r) = part[:2, :2]
    # The larger root λ of det(part − λ whole) = 0.
    area = a * c - b * b
    middle = 0.5 * (a * r + c * p - 2.0 * b * q) / area
    spread = middle**2 - (p * r - q * q) / area
    largest = np.array([middle + np.sqrt(np.maximum(spread, 0.0)), part[2, 2] / whole[2, 2]])
    scale = np.minimum(1.0, _LARGEST_SHARE / np.maximum(largest, _LARGEST_SHARE))[[0, 0, 1]]
    return np.asarray(part * scale)


def _surface(sight: Sight, speckle: SurfaceSpeckle, moved: Array, row: int) -> Array:
    """Return :func:`surface_covariance` of a pattern as its voxels' gains give it."""
    result, reach, radius = np.zeros((3, 3)), float(sight.plane.distance[row]), float(speckle.radius[row])
    position, rise = reach * sight.place[row], reach * rise_per_point(sight.place[row])
    if sight.light_gains is not None:
        light = np.sqrt(speckle.light[row]) * sight.light_gains[row]
        back = sight.plane.back[row]
        result[:2, :2] = product(back, _common(position, rise, light, radius, 0.0), back.T)
    kept = _common(position, rise, moved[row, None], radius, float(speckle.on_surface[row]))[0, 0]
    result[2, 2] = np.maximum(kept, 0.0)
    return result


def _range_errors(samples: PatternSamples, sight: Sight, speckle: SurfaceSpeckle) -> Array:
    """Return what the speckle of each voxel's range does to the target's [m], shape (patterns, points)."""
    sigma, noise = np.where(samples.valid, samples.sigma_range, 0.0), speckle.range_noise[:, None]
    return np.asarray(sight.range_gains * np.sqrt(np.maximum(sigma**2 - noise, 0.0)))


def _common(position: Array, rise: Array, errors: Array, radius: float, on_surface: float) -> Array:
    """Return the covariance (k, k) that sums of voxels' errors (k, n) share with those of another dither."""
    size = np.abs(errors).max(axis=0)
    used = size > _NEGLIGIBLE_SHARE * size.max()
    at, way, along = position[:, used] / radius, rise[:, used] / radius, errors[:, used]
    reach = 0.5 * (np.hypot(way[0], way[1]) + _REACH_RADII)
    # Every pair but once.
    apart = ((at[:, :, None] - at[:, None]) ** 2).sum(axis=0)
    index = np.arange(len(reach))
    one, other = np.nonzero((apart < (reach[:, None] + reach) ** 2) & (index[:, None] <= index))
    steps = (np.arange(_POINTS_PER_VOXEL) + 0.5) / _POINTS_PER_VOXEL - 0.5
    points = at[:, :, None] + way[:, :, None] * steps
    across, down = points[:, one, :, None] - points[:, other, None]
    decay = exp(-(across**2) - down**2)
    shared = ((1.0 - 2.0 * on_surface * across**2) * decay).mean(axis=(1, 2))
    shared = np.where(one == other, 0.5, 1.0) * shared
    found = np.einsum("kp,lp->kl", along[:, one] * shared, along[:, other])
    return np.asarray(found + found.T)
