"""The centre of a disc by a fit of its response, blurred by the spot and by its travel during the dwell."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

from scanner_sim.foundation.arithmetic import applied, exp, inverse, product, solve_linear
from scanner_sim.tracking.centroid import Centroid, centroid_of
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
_LARGEST_VARIANCE = float(np.pi**2)
"""Largest variance of centre and radius [rad²] that tells anything: beyond it lie all directions."""
_ROOT_PI = float(np.sqrt(2.0 * np.pi))
_IDENTITY = np.eye(5)


def disc_fit(
    samples: PatternSamples,
    response: Response,
    start: Centroid,
    *,
    spot: ArrayLike,
    duty_cycle: float = 1.0,
    pointing: ArrayLike = 0.0,
    radius: ArrayLike | None = None,
    sigma_radius: ArrayLike | None = None,
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
    radius, sigma_radius
        The disc's radius where it is known and how well [rad], () or (patterns,); without them it is free.

    Returns
    -------
    Centroid
        Values are b + a D, with ground b, amplitude a and the share D of the spot on the disc (:func:`blurred_edge`),
        averaged along the travel of the dwell. Minimises Σ (v − b − a D)²/σ² over (c, r, a, b) by Gauss–Newton;
        covariance (JᵀWJ)⁻¹, times the misfit χ²/dof where that is above 1 (speckle, texture), and what the pointing
        adds by the slope of each voxel's response, (JᵀWJ)⁻¹ JᵀW diag(a D′ σ)² WJ (JᵀWJ)⁻¹. Not modelled: a disc that
        its tilt makes an ellipse, which widens the residuals but by its symmetry does not move the centre; cosine and
        range over the disc.
    """
    theta, phi = samples.theta, samples.phi
    travel = duty_cycle * rise_per_point(theta), duty_cycle * rise_per_point(phi)
    usable = response.clear & start.found
    rows = len(usable)
    centre, size = start.centre, start.radius
    if not usable.all():
        middle = np.stack([theta.mean(axis=1), phi.mean(axis=1)], axis=1)
        centre, size = np.where(usable[:, None], centre, middle), np.where(usable, size, 1.0)
    wide = np.asarray(spot, dtype=np.float64)
    blur = np.zeros((rows, 1)) + (wide if wide.ndim == 2 else wide.reshape(-1, 1))
    weight = np.where(response.used, 1.0 / response.sigma**2, 0.0)
    prior = np.zeros(rows)
    known = size
    if radius is not None:
        known = np.broadcast_to(np.asarray(radius, dtype=np.float64), (rows,))
        size = np.where(usable, known, 1.0)
        loose = 1e-3 * known if sigma_radius is None else np.asarray(sigma_radius, dtype=np.float64)
        prior = 1.0 / np.broadcast_to(loose, (rows,)) ** 2
    amplitude, ground = response.target - response.ground, response.ground
    jacobian = np.ones((rows, 5, theta.shape[1]))
    unit = np.empty((rows, 5))
    state = np.concatenate([centre, size[:, None], amplitude[:, None], ground[:, None]], axis=1)
    # The state of least χ² so far, and the step from there, which is halved until χ² falls; its length over the units.
    best, step, length, least = state, np.zeros((rows, 5)), np.zeros(rows), np.full(rows, np.inf)
    # A row that has come to rest stays as it is, whatever its neighbours still do: no result depends on the batch.
    # Covariance and misfit are those before its last step, which is too small to tell.
    moving = usable
    kept: tuple[Array, ...] = ()
    for _ in range(_MOST_STEPS):
        centre, size, amplitude, ground = state[:, :2], state[:, 2], state[:, 3], state[:, 4]
        away = theta - centre[:, :1], phi - centre[:, 1:]
        share, by_distance, direction = _share(away, travel, size, blur)
        residual = response.value - ground[:, None] - amplitude[:, None] * share
        # Columns of like size keep the normal matrix well conditioned.
        unit[:, :3], unit[:, 3:] = size[:, None], np.maximum(np.abs(amplitude), 1e-300)[:, None]
        steep = amplitude[:, None] * by_distance
        jacobian[:, 2] = -unit[:, 2:3] * steep
        jacobian[:, 0], jacobian[:, 1] = jacobian[:, 2] * direction[0], jacobian[:, 2] * direction[1]
        jacobian[:, 3], jacobian[:, 4] = unit[:, 3:4] * share, unit[:, 4:]
        weighted = jacobian * weight[:, None]
        normal = product(weighted, jacobian.transpose(0, 2, 1))
        right = applied(weighted, residual)
        if radius is not None:
            normal[:, 2, 2] += prior * size**2
            right[:, 2] += prior * size * (known - size)
        # No matrix is singular, not even that of a pattern without weights.
        normal.reshape(rows, 25)[:, ::6] *= 1.0 + 1e-12
        normal.reshape(rows, 25)[:, ::6] += 1e-300
        change = solve_linear(normal, right[..., None])[..., 0]
        np.clip(change, -_LARGEST_STEP, _LARGEST_STEP, out=change)
        chi = (weight * residual**2).sum(axis=1) + prior * (known - size) ** 2
        better = moving & (chi <= least * (1.0 + _RISE))
        kept = _newer(better, (normal, residual, weighted, steep), kept)
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
    normal, residual, weighted, steep = kept
    chi = (weight * residual**2).sum(axis=1)
    error = np.asarray(pointing, dtype=np.float64)
    turned = weighted * ((error[:, None] if error.ndim == 1 else error) * steep)[:, None]
    normal = np.where(usable[:, None, None], normal, _IDENTITY)
    freedom = np.maximum(response.used.sum(axis=1) - 5 + (prior > 0.0), 1)
    misfit = chi / freedom
    # What the values do not tell at all has a variance beyond all angles, or all numbers, and is not found.
    with np.errstate(over="ignore", invalid="ignore"):
        inverted = inverse(normal)
        of_pointing = product(inverted, product(turned, turned.transpose(0, 2, 1)), inverted)
        covariance = inverted * np.maximum(misfit, 1.0)[:, None, None] + of_pointing
        covariance = covariance[:, :3, :3] * (size**2)[:, None, None]
    usable &= (np.diagonal(covariance, axis1=1, axis2=2) <= _LARGEST_VARIANCE).all(axis=1)  # NaN is not
    reach = np.maximum(np.abs(theta - centre[:, :1]).min(axis=1), np.abs(phi - centre[:, 1:]).min(axis=1))
    found = usable & (reach < 2.0 * size) & (np.sign(amplitude) == np.sign(response.target - response.ground))
    return centroid_of(
        centre, covariance[:, :2, :2], size, np.sqrt(np.maximum(covariance[:, 2, 2], 0.0)), misfit, found
    )


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
    u = inside / spot
    first, last = u - half, u + half
    normal_first, normal_last = ndtr(first), ndtr(last)
    over = 0.5 / half
    density = (exp(-0.5 * last**2) - exp(-0.5 * first**2)) / _ROOT_PI
    share = (last * normal_last - first * normal_first + density) * over
    return share, (normal_last - normal_first) * over / spot


def _share(
    away: tuple[Array, Array], travel: tuple[Array, Array], radius: Array, spot: Array
) -> tuple[Array, Array, tuple[Array, Array]]:
    """Return D, ∂D/∂ρ (over the distance ρ) and the unit vectors from the centre; all (patterns, points).

    The circle's edge is straight across the spot; its bend puts the line of half response s²/(2r) inside of it, and a
    travel t along the edge carries the spot away from the centre by t²/(24 ρ) in the mean.
    """
    distance = np.maximum(np.sqrt(away[0] ** 2 + away[1] ** 2), 1e-12)
    direction = away[0] / distance, away[1] / distance
    across = travel[0] * direction[0] + travel[1] * direction[1]
    along = travel[0] ** 2 + travel[1] ** 2 - across**2
    r, s = radius[:, None], spot
    mean = distance + along / (24.0 * np.maximum(distance, 0.5 * r))
    share, slope = blurred_edge(r - 0.5 * s**2 / r - mean, across, s)
    return share, -slope, direction
