"""The centre of a disc by a fit of its response, blurred by the spot and by its travel during the dwell."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import erfc

from scanner_sim.tracking.centroid import Centroid, centroid_of
from scanner_sim.tracking.response import Response
from scanner_sim.tracking.samples import PatternSamples

Array = NDArray[np.float64]

_ROUNDS = 12
"""Steps of the adjustment; from a circle or a mean of hits six do."""
_MOST = 0.3
"""Largest step of centre and radius in one round, over the radius."""
_AT_REST = 1e-6
"""Step, over radius and amplitude, from which a fit has come to rest: a thousandth of any σ."""
_SHORTEST = 1e-3
"""Travel over spot below which the mean along it is taken as the value in its middle."""
_ROOT_PI = float(np.sqrt(2.0 * np.pi))


def disc_fit(
    samples: PatternSamples,
    response: Response,
    start: Centroid,
    *,
    spot: ArrayLike,
    shining: float = 1.0,
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
        Standard deviation of the spot's irradiance across the beam, as an angle: w/(2 R) [rad], () or (patterns,).
    shining
        Share of the dwell in which the laser shines.
    radius, sigma_radius
        The disc's radius where it is known and how well [rad], () or (patterns,); without them it is free.

    Returns
    -------
    Centroid
        Values are b + a D, with ground b, amplitude a and the share D of the spot on the disc (:func:`blurred_edge`),
        averaged along the travel of the dwell. Minimises Σ (v − b − a D)²/σ² over (c, r, a, b) by Gauss–Newton;
        covariance (JᵀWJ)⁻¹, times the misfit χ²/dof where that is above 1 (speckle, texture). Not modelled: a disc that
        its tilt makes an ellipse, which widens the residuals but by its symmetry does not move the centre; cosine and
        range over the disc.
    """
    angles = np.stack([samples.theta, samples.phi], axis=-1)
    travel = shining * np.gradient(angles, axis=1, edge_order=2)
    usable = response.clear & start.found
    rows = len(usable)
    centre = np.where(usable[:, None], start.centre, angles.mean(axis=1))
    size = np.where(usable, start.radius, 1.0)
    blur = np.broadcast_to(np.asarray(spot, dtype=np.float64), (rows,))
    weight = np.where(response.used, 1.0 / response.sigma**2, 0.0)
    prior = np.zeros(rows)
    known = size
    if radius is not None:
        known = np.broadcast_to(np.asarray(radius, dtype=np.float64), (rows,))
        size = np.where(usable, known, 1.0)
        loose = 1e-3 * known if sigma_radius is None else np.asarray(sigma_radius, dtype=np.float64)
        prior = 1.0 / np.broadcast_to(loose, (rows,)) ** 2
    amplitude, ground = response.target - response.ground, response.ground
    # A row that has come to rest stays as it is, whatever its neighbours still do: no result depends on the batch. The
    # last round only evaluates: covariance and misfit are those at the solution.
    moving = usable
    for round_ in range(_ROUNDS + 1):
        share, by_distance, direction = _share(angles - centre[:, None], travel, size, blur)
        model = ground[:, None] + amplitude[:, None] * share
        residual = response.value - model
        steep = amplitude[:, None] * by_distance
        jacobian = np.stack(
            [-steep * direction[..., 0], -steep * direction[..., 1], -steep, share, np.ones_like(share)],
            axis=-1,
        )
        # Columns of like size keep the normal matrix well conditioned.
        unit = np.stack([size, size, size, *2 * [np.maximum(np.abs(amplitude), 1e-300)]], axis=-1)
        jacobian = jacobian * unit[:, None]
        weighted = jacobian * weight[..., None]
        normal = np.einsum("pni,pnj->pij", weighted, jacobian)
        right = np.einsum("pni,pn->pi", weighted, residual)
        normal[:, 2, 2] += prior * size**2
        right[:, 2] += prior * size * (known - size)
        trace = np.einsum("pii->p", normal)
        normal += (1e-12 * np.where(trace > 0.0, trace, 1.0))[:, None, None] * np.eye(5)
        if round_ == _ROUNDS or not moving.any():
            break
        change = np.linalg.solve(normal, right[..., None])[..., 0]
        change[:, :3] = np.clip(change[:, :3], -_MOST, _MOST)
        change[~moving] = 0.0
        moving = moving & (np.abs(change).max(axis=1) > _AT_REST)
        change *= unit
        centre, size = centre + change[:, :2], np.maximum(size + change[:, 2], 0.1 * size)
        amplitude, ground = amplitude + change[:, 3], ground + change[:, 4]
    chi = np.einsum("pn,pn->p", weight, residual**2)
    freedom = np.maximum(response.used.sum(axis=1) - 5 + (prior > 0.0), 1)
    misfit = chi / freedom
    covariance = np.linalg.inv(normal)[:, :3, :3] * (size**2 * np.maximum(misfit, 1.0))[:, None, None]
    reach = np.abs(angles - centre[:, None]).min(axis=1).max(axis=1)
    found = usable & (reach < 2.0 * size) & (np.sign(amplitude) == np.sign(response.target - response.ground))
    return centroid_of(
        centre, covariance[:, :2, :2], size, np.sqrt(np.maximum(covariance[:, 2, 2], 0.0)), misfit, found
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
    u = inside / spot
    length = np.maximum(np.abs(travel) / spot, _SHORTEST)
    first, last = u - 0.5 * length, u + 0.5 * length
    share = (_integral(last) - _integral(first)) / length
    slope = (_normal(last) - _normal(first)) / length
    return share, slope / spot


def _share(away: Array, travel: Array, radius: Array, spot: Array) -> tuple[Array, Array, Array]:
    """Return D, ∂D/∂ρ (over the distance ρ) and the unit vectors from the centre; the first two (patterns, points).

    The circle's edge is straight across the spot; its bend puts the line of half response s²/(2r) inside of it, and a
    travel t along the edge carries the spot away from the centre by t²/(24 ρ) in the mean.
    """
    distance = np.maximum(np.linalg.norm(away, axis=-1), 1e-12)
    direction = away / distance[..., None]
    across = np.einsum("pni,pni->pn", travel, direction)
    along = np.einsum("pni,pni->pn", travel, travel) - across**2
    r, s = radius[:, None], spot[:, None]
    mean = distance + along / (24.0 * np.maximum(distance, 0.5 * r))
    share, slope = blurred_edge(r - 0.5 * s**2 / r - mean, across, np.broadcast_to(s, across.shape))
    return share, -slope, direction


def _normal(z: Array) -> Array:
    return np.asarray(0.5 * erfc(-z / np.sqrt(2.0)))


def _integral(z: Array) -> Array:
    return np.asarray(z * _normal(z) + np.exp(-0.5 * z**2) / _ROOT_PI)
