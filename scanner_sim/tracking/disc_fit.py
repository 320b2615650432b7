"""The centre of a disc by a fit of its response, blurred by the spot and by its travel during the dwell."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from scanner_sim.foundation.arithmetic import exp, product, solve_linear
from scanner_sim.tracking.centroid import ALL_ANGLES, Centroid, centroid_of
from scanner_sim.tracking.response import Response
from scanner_sim.tracking.samples import PatternSamples, rise_per_point

Array = NDArray[np.float64]

_MOST_STEPS = 40
"""Steps of the adjustment; from a circle or a mean of hits six do, along a valley of χ² many more."""
_RISE = 1e-6
"""Rise of χ², over itself, by which a step has gone too far: rounding makes far less."""
_LARGEST_STEP = 0.3
"""Largest step in one round, of centre and radius over the radius, of levels over their distance."""
_CONVERGED_STEP = 1e-3
"""Step, over radius and amplitude, with which a fit comes to rest: the next is a tenth of it, far below any σ."""
_SHORTEST_TRAVEL = 1e-3
"""Travel over spot below which the mean along it is taken as the value in its middle."""
_ROOT_PI = float(np.sqrt(2.0 * np.pi))
_IDENTITY = np.eye(5)
_ENDS = np.array([-1.0, 1.0])


def disc_fit(
    samples: PatternSamples,
    response: Response,
    start: Centroid,
    *,
    spot: ArrayLike,
    duty_cycle: float = 1.0,
    pointing: ArrayLike = 0.0,
) -> Centroid:
    """Return the disc whose blurred response fits the values best.

    Parameters
    ----------
    samples, response
        The patterns, and what of them counts.
    start
        Where the search begins: :func:`~scanner_sim.tracking.centroid.circle_fit`, or the mean of hits where that has
        none (:func:`~scanner_sim.tracking.centroid.better_of`).
    spot
        Standard deviation of the spot's irradiance across the rim, as an angle: w/(2 R) [rad], (), (patterns,) or
        (patterns, points).
    duty_cycle
        Share of the dwell in which the laser shines.
    pointing
        Standard deviation of the read angles about the true ones, per axis and independent from voxel to voxel [rad],
        (), (patterns,) or (patterns, points).

    Returns
    -------
    Centroid
        Values are b + a D, with ground b, amplitude a and the share D of the spot on the disc (:func:`blurred_edge`),
        averaged along the travel of the dwell. Minimises Σ (v − b − a D)²/σ² over (c, r, a, b) by Gauss–Newton;
        covariance (JᵀWJ)⁻¹, times the misfit χ²/dof where that is above 1 (speckle, texture), and what the pointing
        adds by the slope of each voxel's response, G diag(a D′ σ)² Gᵀ with the gains G = (JᵀWJ)⁻¹JᵀW. Not modelled: a
        disc that its tilt makes an ellipse, which widens the residuals but by its symmetry does not move the centre;
        cosine and range over the disc.
    """
    place = samples.angles
    travel = duty_cycle * rise_per_point(place)
    way = (travel**2).sum(axis=1)
    usable = response.clear & start.found
    rows = len(usable)
    centre, size = start.centre, start.radius
    if not usable.all():
        centre, size = np.where(usable[:, None], centre, place.mean(axis=2)), np.where(usable, size, 1.0)
    blur = by_voxel(spot, rows)
    weight = np.where(response.used, 1.0 / response.sigma**2, 0.0)
    amplitude, ground = response.target - response.ground, response.ground
    # Columns of the five unknowns, and the residual behind them: their products are all that a step needs.
    design = np.ones((rows, 6, place.shape[2]))
    unit = np.empty((rows, 5))
    right = np.zeros((rows, 5, 6))
    right[:, :, 1:] = _IDENTITY
    state = np.concatenate([centre, size[:, None], amplitude[:, None], ground[:, None]], axis=1)
    # The state of least χ² so far, and the step from there, which is halved until χ² falls; its length over the units.
    best, step, length, least = state, np.zeros((rows, 5)), np.zeros(rows), np.full(rows, np.inf)
    # A row that has come to rest stays as it is, whatever its neighbours still do: no result depends on the batch.
    # Covariance and misfit are those before its last step, which is too small to tell.
    moving = usable
    kept: tuple[Array, ...] = ()
    for _ in range(_MOST_STEPS):
        size, amplitude = state[:, 2], state[:, 3, None]
        share, by_distance, direction = share_on_disc(
            place - state[:, :2, None], travel, way, size[:, None], blur
        )
        # Columns of like size keep the normal matrix well conditioned.
        unit[:, :3], unit[:, 3:] = size[:, None], np.maximum(np.abs(amplitude), 1e-300)
        steep = amplitude * by_distance
        design[:, 2] = -unit[:, 2:3] * steep
        design[:, :2] = design[:, 2:3] * direction
        design[:, 3], design[:, 4] = unit[:, 3:4] * share, unit[:, 4:]
        design[:, 5] = response.value - state[:, 4:] - amplitude * share
        weighted = design * weight[:, None]
        normal = product(weighted, design.transpose(0, 2, 1))
        right[:, :, 0], chi = normal[:, :5, 5], normal[:, 5, 5]
        # No matrix is singular, not even that of a pattern without weights.
        diagonal = normal.reshape(rows, 36)[:, :35:7]
        diagonal *= 1.0 + 1e-12
        diagonal += 1e-300
        solved = solve_linear(normal[:, :5, :5], right)
        change = solved[:, :, 0]
        np.minimum(np.maximum(change, -_LARGEST_STEP), _LARGEST_STEP, out=change)
        better = moving & (chi <= least * (1.0 + _RISE))
        kept = _newer(better, (solved, chi, weighted, steep), kept)
        best, least = np.where(better[:, None], state, best), np.where(better, chi, least)
        step = np.where(better[:, None], change * unit, 0.5 * step)
        length = np.where(better, np.abs(change).max(axis=1), 0.5 * length)
        tried = best + step
        tried[:, 2] = np.maximum(tried[:, 2], 0.1 * best[:, 2])
        state = np.where(moving[:, None], tried, state)
        moving = moving & (length > _CONVERGED_STEP)
        if not moving.any():
            break
    state = np.where(moving[:, None], best, state)
    centre, size, amplitude = state[:, :2], state[:, 2], state[:, 3]
    solved, chi, weighted, steep = kept
    error = np.asarray(pointing, dtype=np.float64)
    freedom = np.maximum(response.used.sum(axis=1) - 5, 1)
    misfit = chi / freedom
    # What the values do not tell at all has a variance beyond all angles, or all numbers, and is not found.
    with np.errstate(over="ignore", invalid="ignore"):
        inverted = solved[:, :3, 1:]
        gains = size[:, None, None] * product(inverted, weighted[:, :5])
        turned = gains * ((error[:, None] if error.ndim == 1 else error) * steep)[:, None]
        scale = np.maximum(misfit, 1.0) * size**2
        covariance = inverted[:, :, :3] * scale[:, None, None] + product(turned, turned.transpose(0, 2, 1))
    usable &= (np.diagonal(covariance, axis1=1, axis2=2) <= ALL_ANGLES**2).all(axis=1)  # NaN is not
    reach = np.abs(place - centre[:, :, None]).min(axis=2).max(axis=1)
    found = usable & (reach < 2.0 * size) & (np.sign(amplitude) == np.sign(response.target - response.ground))
    sigma = np.sqrt(np.maximum(covariance[:, 2, 2], 0.0))
    return centroid_of(centre, covariance[:, :2, :2], size, sigma, misfit, found, gains[:, :2])


def _newer(
    moving: NDArray[np.bool_], values: tuple[Array, ...], before: tuple[Array, ...]
) -> tuple[Array, ...]:
    """Return new values of the rows that still move, and those before of the others."""
    if not before or moving.all():
        return values
    return tuple(
        np.where(moving.reshape(-1, *[1] * (new.ndim - 1)), new, old)
        for new, old in zip(values, before, strict=True)
    )


def by_voxel(given: ArrayLike, rows: int) -> Array:
    """Return (), (rows,) or (rows, points) as (rows, 1) or (rows, points)."""
    part = np.asarray(given, dtype=np.float64)
    return np.zeros((rows, 1)) + (part if part.ndim == 2 else part.reshape(-1, 1))


def blurred_edge(inside: Array, travel: Array, spot: Array) -> tuple[Array, Array]:
    """Return the share of a Gaussian spot inside of a straight edge, mean along a travel, and its slope.

    Parameters
    ----------
    inside
        Distance of the spot's middle from the edge, positive inside, any shape.
    travel
        Travel across the edge in the dwell; the same unit.
    spot
        Standard deviation of the spot.

    Returns
    -------
    share, slope
        [G(u + L/2) − G(u − L/2)]/L, G(z) = z Φ(z/s) + s φ(z/s), the integral of Φ(z/s); and its derivative
        [Φ((u + L/2)/s) − Φ((u − L/2)/s)]/L.
    """
    half = np.maximum(np.abs(travel) / spot, _SHORTEST_TRAVEL) * 0.5
    ends = inside / spot + half * _ENDS.reshape(2, *[1] * half.ndim)
    normal = ndtr(ends)
    primitive = ends * normal + exp(-0.5 * ends**2) / _ROOT_PI
    over = 0.5 / half
    return (primitive[1] - primitive[0]) * over, (normal[1] - normal[0]) * over / spot


def share_on_disc(
    away: Array, travel: Array, way: Array, radius: Array, spot: Array
) -> tuple[Array, Array, Array]:
    """Return the share D of spots on discs, ∂D/∂ρ over the distance ρ, both (patterns, points), and the ways out.

    The last are unit vectors from the centre. The circle's edge is straight across the spot; its bend puts the line of
    half response s²/(2r) inside of it, and a travel t along the edge carries the spot away from the centre by
    t²/(24 ρ) in the mean. ``away``, ``travel`` and the vectors have the shape (patterns, 2, points), ``way`` is t² with
    what goes across, (patterns, points).
    """
    distance = np.maximum(np.sqrt((away**2).sum(axis=1)), 1e-12)
    direction = away / distance[:, None]
    across = (travel * direction).sum(axis=1)
    mean = distance + (way - across**2) / (24.0 * np.maximum(distance, 0.5 * radius))
    share, slope = blurred_edge(radius - 0.5 * spot**2 / radius - mean, across, spot)
    return share, -slope, direction
