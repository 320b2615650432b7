"""The part of a visit's error that stays from visit to visit: the speckle of the target's own surface.

A pattern follows its target, so that its beam runs over the same curve on the surface again and again, and meets the
same speckle. Only the positions of the dwells on the curve change (the dither of the sampling). What remains when they
are averaged over the curve *lasts*: until the surface turns beneath the pattern by about the beam's radius.

With the gains g_i of an estimate by its voxels, δ = Σ g_i σ_i z_i, σ_i the standard deviation of a voxel by speckle and
z_i its normal number, which belongs to the position of the dwell's middle. Two visits whose dwells begin anywhere
between those of an average one have in common

    Σ_ij g_i σ_i g_j σ_j ⟨ρ(r_i + u t_i − r_j − u′ t_j)⟩,   u, u′ even in ±½,

with t_i the way from voxel to voxel, ρ = exp(−δ²/w²) of the light and (1 − 2δ_x²/w²) exp(−δ²/w²) of its position along
the line (:mod:`scanner_sim.optics.speckle`). One visit has the same sum with ρ(r_i − r_j), of which the voxels' own
variances are the terms i = j: where the beam is as wide as the way from voxel to voxel, neighbours err alike and the
others count, too. The white part is the rest.

Of two visits whose places are known more is: with dwells u and u′ of a point further along the curve they have the sum
K(Δ) in common, Δ = u − u′, which comes back after a whole point, K(Δ) = C₀ + Σ_h C_h cos(2π h Δ). C₀ is what lasts, the
others are the part of the white one that the *dither* moves. Visits whose dwells lie near each other, as those of a
figure and of its inverted do for many lags of the mirrors, share most of it. From K at every fourth of a point follow
C₀, C₁ and C₂ (a discrete Fourier transform); what is beyond stays white. In the ranges' sums the voxels at the rim
count for less (:data:`_KEPT_AT_ENDS`).

A pattern that lies elsewhere on the surface, by δ radii of the beam, meets other speckle where it runs across δ, and
the same where it runs along: of parts in all directions the mean of exp(−(n·δ)²) is left, exp(−δ²/2) I₀(δ²/2), which
falls no faster than 1/δ. What of it counts for a filter is its integral (:data:`LASTING_RADII`). Ranges go sooner:
with x = u cosα − v sinα, u along and v = n·δ across a part in the direction α, the integral of
(1 − 2κ x²) exp(−u² − v²) over u goes as (1 − κ cos²α − 2κ v² sin²α) exp(−v²), κ the share
:attr:`SurfaceSpeckle.on_surface`, and the mean over α and over the directions of δ as
((1 − κ/2) ⟨exp(−v²)⟩ − κ ⟨v² exp(−v²)⟩)/(1 − κ/2) (:func:`range_fades`).

Not modelled, as in :mod:`scanner_sim.detector.line.speckle`: what overlapping dwells have in common beyond their
middles. Of a beam that sweeps three of its radii in a dwell it would make nearly all of the speckle last, instead of
half of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import exp, product
from scanner_sim.tracking.errors import HARMONICS
from scanner_sim.tracking.measurement import Measurement, Sight
from scanner_sim.tracking.samples import PatternSamples, rise_per_point

Array = NDArray[np.float64]
Numbers = NDArray[np.intp]

_SHIFTS = np.array([0.0, 0.25, -0.25, 0.5, -0.5])
"""Δ at which two visits are compared [point]; each sum over pairs takes both signs."""
_BY_HARMONIC = (
    np.array([[2.0, 2.0, 2.0, 1.0, 1.0], [4.0, 0.0, 0.0, -2.0, -2.0], [2.0, -2.0, -2.0, 1.0, 1.0]]) / 8.0
)
"""Weights of the shifts in C₀, C₁ and C₂."""
_REACH_RADII = 2.5
"""Radii of the beam beyond which two points have nothing in common, 2e-3."""
LASTING_RADII = 2.0
"""By how many radii of the beam a pattern is moved over a surface until its speckle is another: the length of an
exponential that has the integral of exp(−δ²/2) I₀(δ²/2) over the six radii or so in which the parts of a pattern by
which a disc is seen are straight. That of the tracker's own patterns is 1.7 to 2.3 for Θ and φ, 0.9 to 2.0 for R; of
one of 1.6 of the disc's radii, which crosses the rim steeply, it is 1.1."""
_ACROSS = 0.3545
"""Integral of ⟨v² exp(−v²)⟩ over the same six radii, over that of ⟨exp(−v²)⟩."""
_KEPT_AT_ENDS = 7.0 / 8.0
"""Share that another visit keeps of the range error of the first and last voxel of each way across a target: dwells lie
up to half a point from them there, and beyond the rim with the mean chance of ∫₀^½ (½ − x) dx."""
_NEGLIGIBLE_SHARE = 0.01
"""Share of the largest error of a voxel that does not count."""
_THREE = np.eye(3)
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
        Variance of each voxel's range without speckle [m²], shape (patterns, points).
    """

    radius: Array
    light: Array
    on_surface: Array
    range_noise: Array


@dataclass(frozen=True)
class SurfaceParts:
    """What flat targets' surfaces do to (Θ, φ, R) of patterns [rad, rad, m].

    Attributes
    ----------
    lasting
        Covariance of what stays from visit to visit, shape (patterns, 3, 3).
    neighbours
        What neighbouring voxels have in common in one visit, by which its covariance is beyond that of voxels
        independent of each other, shape (patterns, 3, 3).
    dither
        Covariances C_h of what goes with the places of the dwells on the curve, shape (patterns, HARMONICS, 3, 3).
    """

    lasting: Array
    neighbours: Array
    dither: Array


def surface_parts(samples: PatternSamples, seen: Measurement, speckle: SurfaceSpeckle) -> SurfaceParts:
    """Return the parts of the covariance of measured positions that flat targets' surfaces make.

    Parameters
    ----------
    samples, seen
        Patterns, and where their voxels show the target, with their covariance.
    speckle
        The speckle there.

    Returns
    -------
    SurfaceParts
        What stays is at most nine tenths of the whole in every direction, and each harmonic of what is left then, so
        that the rest is a covariance.
    """
    result = np.zeros((2 + HARMONICS, *seen.covariance.shape))
    rows = np.flatnonzero(seen.found & (seen.radius > 0.0))
    if seen.sight is not None and len(rows):
        # Nothing is known of patterns that hardly show a target.
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            slope = seen.sight.plane.slope[rows]
            moved = _range_errors(samples, seen.sight, speckle)
            neighbours, *harmonics = _surface(seen.sight, speckle, moved, rows)
            left = _on_slope(seen.covariance[rows], -slope) + neighbours
            parts = [neighbours]
            for part in harmonics:
                parts.append(_limit(part, left))
                left = left - parts[-1]
            found = _on_slope(np.array(parts), slope)
        known = np.isfinite(found).all(axis=(0, 2, 3))
        result[:, rows[known]] = found[:, known]
    return SurfaceParts(result[1], result[0], np.moveaxis(result[2:], 0, 1))


def range_fades(on_surface: Array) -> Array:
    """Return how many times sooner than angles ranges meet other speckle, by the share ``on_surface`` κ (n,)."""
    upright = 1.0 - 0.5 * on_surface
    return np.asarray(upright / (upright - _ACROSS * on_surface))


def _on_slope(covariance: Array, slope: Array) -> Array:
    """Return covariances (..., n, 3, 3) of (Θ, φ, R + g·δ) from those of (Θ, φ, R), with the errors δ of Θ and φ.

    A range is asked for at the centre that was found, on a plane of the slope g, (n, 2); −g takes the two apart again.
    """
    carried = np.zeros(covariance.shape[-3:])
    carried[:] = _THREE
    carried[:, 2, :2] = slope
    return np.asarray(product(carried, covariance, carried.transpose(0, 2, 1)))


def _limit(part: Array, whole: Array) -> Array:
    """Return parts of covariances, of (Θ, φ) and of R, that leave a tenth of the whole in every direction."""
    a, b, c = whole[:, 0, 0], whole[:, 0, 1], whole[:, 1, 1]
    p, q, r = part[:, 0, 0], part[:, 0, 1], part[:, 1, 1]
    # The larger root λ of det(part − λ whole) = 0.
    area = a * c - b * b
    middle = 0.5 * (a * r + c * p - 2.0 * b * q) / area
    spread = middle**2 - (p * r - q * q) / area
    largest = middle + np.sqrt(np.maximum(spread, 0.0)), part[:, 2, 2] / whole[:, 2, 2]
    angles, distance = (
        np.minimum(1.0, _LARGEST_SHARE / np.maximum(share, _LARGEST_SHARE)) for share in largest
    )
    return np.asarray(part * np.stack([angles, angles, distance], axis=1)[:, None])


def _surface(sight: Sight, speckle: SurfaceSpeckle, moved: Array, rows: NDArray[np.intp]) -> Array:
    """Return what neighbours share, C₀, C₁, …, (2 + HARMONICS, n, 3, 3), as gains give them, R at a known centre."""
    result, radius = np.zeros((2 + HARMONICS, len(rows), 3, 3)), speckle.radius[rows]
    position = sight.plane.distance[rows, None, None] * sight.place[rows]
    by_range = moved[rows, None]
    by_light = np.zeros_like(by_range)
    if sight.light_gains is not None:
        by_light = np.sqrt(speckle.light[rows, None]) * sight.light_gains[rows]
    rise = rise_per_point(position)
    lit, kept = _common(position, rise, by_light, by_range, radius, speckle.on_surface[rows])
    if sight.light_gains is not None:
        back = sight.plane.back[rows]
        result[..., :2, :2] = product(back, lit, back.transpose(0, 2, 1))
    result[:, :, 2, 2] = kept[:, :, 0, 0]
    result[1:] = _positive(result[1:])
    return result


def _positive(part: Array) -> Array:
    """Return parts (..., 3, 3), of (Θ, φ) and of R, without the negative variances that a finite sum leaves."""
    part = part.copy()
    for axis in range(3):
        part[..., axis, axis] = np.maximum(part[..., axis, axis], 0.0)
    most = np.sqrt(part[..., 0, 0] * part[..., 1, 1])
    part[..., 0, 1] = part[..., 1, 0] = np.clip(part[..., 0, 1], -most, most)
    return part


def _range_errors(samples: PatternSamples, sight: Sight, speckle: SurfaceSpeckle) -> Array:
    """Return what the speckle of each voxel's range does to the target's [m], shape (patterns, points)."""
    sigma, noise = np.where(samples.valid, samples.sigma_range, 0.0), speckle.range_noise
    return np.asarray(sight.range_gains * np.sqrt(np.maximum(sigma**2 - noise, 0.0)))


def _counted(errors: Array) -> Array:
    """Return the errors (p, k, n) of voxels that count; 0 for those that do not."""
    size = np.abs(errors).max(axis=1, keepdims=True)
    return np.where(size > _NEGLIGIBLE_SHARE * size.max(axis=2, keepdims=True), errors, 0.0)


def _common(
    position: Array, rise: Array, light: Array, place: Array, radius: Array, on_surface: Array
) -> tuple[Array, Array]:
    """Return what sums of voxels' errors (p, k, n) have in common by light and by place, (2 + HARMONICS, p, k, k).

    First what different voxels add to the variances of their own, then C₀, C₁, ….

    Parameters
    ----------
    position, rise
        Of the voxels on the surfaces, and from voxel to voxel, shape (p, 2, n).
    light, place
        Errors by the voxels' light, and by its position along the line.
    radius, on_surface
        Of :class:`SurfaceSpeckle`, shape (p,).
    """
    light, place = _counted(light), _counted(place)
    lit, told = np.asarray(light.any(axis=1)), np.asarray(place.any(axis=1))
    used = lit | told
    # Those that count stand first, in their order, and no more of the others than the company needs.
    order = np.argsort(~used, axis=1, kind="stable")[:, : int(used.sum(axis=1).max())]
    row = np.arange(len(order))[:, None]
    lit, told, scaled = lit[row, order], told[row, order], np.concatenate([position, rise], axis=1)
    scaled = (scaled / radius[:, None, None])[row, :, order]
    across, down = scaled[..., 0], scaled[..., 1]
    reach = 0.5 * (np.hypot(scaled[..., 2], scaled[..., 3]) + _REACH_RADII)
    # Every pair but once, of voxels that both err by their light, or both by its position.
    index = np.arange(order.shape[1])
    square = (across[:, :, None] - across[:, None]) ** 2 + (down[:, :, None] - down[:, None]) ** 2
    near = (square < (reach[:, :, None] + reach[:, None]) ** 2) & (index[:, None] <= index)
    near &= (lit[:, :, None] & lit[:, None]) | (told[:, :, None] & told[:, None])
    own, one, other = np.unravel_index(np.flatnonzero(near), near.shape)
    here, there = scaled[own, one].T, scaled[own, other].T
    # By axis, shift and pair.
    apart = (here[:2] - there[:2])[:, None] + _SHIFTS[:, None] * (0.5 * (here[2:] + there[2:]))[:, None]
    square = apart**2
    decay = exp(-square[0] - square[1])
    along = decay * (1.0 - 2.0 * on_surface[own] * square[0])
    once, first, second = np.where(one == other, 0.5, 1.0), order[own, one], order[own, other]
    kept = _kept(place)
    return (
        _sums_of_pairs(light, (own, first, second), decay, once),
        _sums_of_pairs(place, (own, first, second), along, once * (kept[own, first] * kept[own, second])),
    )


def _sums_of_pairs(
    errors: Array, pairs: tuple[Numbers, Numbers, Numbers], by_shift: Array, share: Array
) -> Array:
    """Return the sums over pairs of products of errors (p, k, n), (2 + HARMONICS, p, k, k), as :func:`_common` does.

    ``pairs`` are the pattern of each and its two voxels, ``by_shift`` what these have in common, (shifts, pairs), and
    ``share`` what of it counts, half of it for one voxel with itself: every pair counts both ways.
    """
    counts: NDArray[np.bool_] = np.asarray(errors.any(axis=1))
    own, first, second = pairs
    some = np.flatnonzero(counts[own, first] & counts[own, second])
    own, first, second = own[some], first[some], second[some]
    by_shift = by_shift[:, some]
    weights = np.concatenate(
        [np.where(first == second, 0.0, by_shift[:1]), share[some] * _by_harmonic(by_shift)]
    )
    one, other = (errors[own, :, voxel].T.copy() for voxel in (first, second))
    weighed = one[:, None] * other * weights[:, None, None]
    # Adds up in the order of the pairs, whatever other patterns there are.
    shape = (*weighed.shape[:-1], len(errors))
    place = own + np.arange(0, math.prod(shape), len(errors))[:, None]
    sums = np.bincount(place.ravel(), weighed.ravel(), math.prod(shape)).reshape(shape)
    sums = sums.transpose(0, 3, 1, 2)
    return np.asarray(sums + sums.transpose(0, 1, 3, 2))


def _kept(errors: Array) -> Array:
    """Return the roots of the shares of voxels' errors (p, k, n) that other visits have in common, (p, n)."""
    counts: NDArray[np.bool_] = np.asarray(errors.any(axis=1))
    inner = counts.copy()
    inner[:, 1:] &= counts[:, :-1]
    inner[:, :-1] &= counts[:, 1:]
    return np.where(inner, 1.0, math.sqrt(_KEPT_AT_ENDS))


def _by_harmonic(values: Array) -> Array:
    """Return C₀, C₁, … of values by shift (shifts, n), each the weighted sum of them, added up one after the other."""
    total = _BY_HARMONIC[:, :1] * values[0]
    for number, value in enumerate(values[1:], 1):
        total += _BY_HARMONIC[:, number : number + 1] * value
    return np.asarray(total)
