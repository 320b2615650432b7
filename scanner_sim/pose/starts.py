"""The poses that are looked at before one is chosen: starts of each method, adjusted as far as they can be compared."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scanner_sim.pose.adjustment import COARSE_DECREASE, PoseFit, adjust, begin, linearise
from scanner_sim.pose.observations import Observations
from scanner_sim.pose.point_fit import point_fit
from scanner_sim.pose.resection import PLANAR, planar_starts, three_point_starts, wide_threes, widest_three
from scanner_sim.pose.transforms import exponential
from scanner_sim.pose.weights import Method, PointWeights, measured_points, problem_of

Array = NDArray[np.float64]

ALTERNATIVES = 3
"""Further poses that are kept: three points have up to four in all, a plane two."""


def ranked_fits(
    observations: Observations, method: Method, point_weights: PointWeights, *, thorough: bool
) -> PoseFit:
    """Return poses by their cost, the best first, with an axis (S,) before the batch; some may be the same.

    Parameters
    ----------
    observations
        B poses.
    method, point_weights
        See :func:`~scanner_sim.pose.weights.problem_of`.
    thorough
        Start resection from the plane and from many threes of targets, whatever the array.
    """
    rotations, positions = _starts(observations, method, thorough)
    fits = _adjusted(observations, method, point_weights, rotations, positions)
    if thorough:
        best = _by_cost(fits)
        again = _adjusted(observations, method, point_weights, *_beside(observations, best))
        fits = PoseFit(
            *(
                np.concatenate([getattr(fits, name), getattr(again, name)], axis=-2)
                for name in fits.__dataclass_fields__
            )
        )
    return _by_cost(fits)


def _starts(observations: Observations, method: Method, thorough: bool) -> tuple[Array, Array]:
    """Return poses to start from: R (3, 3, S, B) and c (3, S, B), NaN where there is none."""
    rotations, positions = [], []
    if method != "uv":
        measured, used = measured_points(observations), observations.seen & observations.ranged
        rotation, position = point_fit(observations.points, measured, used)
        lacking = used.sum(axis=0) < 3
        rotations.append(np.where(lacking, np.nan, rotation)[:, :, None])
        positions.append(np.where(lacking, np.nan, position)[:, None])
    if method != "xyz":
        rotation, position = _resection_starts(observations, thorough)
        rotations.append(rotation)
        positions.append(position)
    if observations.prior is not None:
        turned = np.broadcast_to(observations.prior.rotation, (3, 3, observations.count))
        centre = np.broadcast_to(observations.centre, (3, observations.count))
        placed = observations.prior.position + np.einsum("ijb,jb->ib", turned, centre)
        rotations.append(turned[:, :, None])
        positions.append(placed[:, None])
    return np.concatenate(rotations, axis=2), np.concatenate(positions, axis=1)


def _resection_starts(observations: Observations, thorough: bool) -> tuple[Array, Array]:
    """Return two starts of planar arrays of four targets and more, four of any three targets of all others."""
    used = observations.seen
    widths = observations.principal[1]
    flat = np.broadcast_to(widths[0] < PLANAR * widths[1], (observations.count,)) & (used.sum(axis=0) > 3)
    if thorough:
        by_plane, by_threes = (
            planar_starts(observations),
            _three_starts(observations, wide_threes(observations), 4),
        )
        return (
            np.concatenate([by_plane[0], by_threes[0]], axis=2),
            np.concatenate([by_plane[1], by_threes[1]], axis=1),
        )
    if flat.all():
        return planar_starts(observations)
    rotations = np.full((3, 3, 4, observations.count), np.nan)
    positions = np.full((3, 4, observations.count), np.nan)
    if flat.any():
        index = np.flatnonzero(flat)
        rotations[:, :, :2, index], positions[:, :2, index] = planar_starts(observations.take(index))
    index = np.flatnonzero(~flat)
    chosen = observations.take(index)
    widest = widest_three(chosen.points, chosen.seen)
    rotations[..., index], positions[..., index] = _three_starts(chosen, widest[None], 4)
    return rotations, positions


def _three_starts(observations: Observations, threes: NDArray[np.intp], most: int) -> tuple[Array, Array]:
    """Return the poses of threes (k, 3, B) that fit all targets best, ``most`` of each, with an axis for them."""
    problem = problem_of(observations, "uv", "covariance")
    rotations, positions = [], []
    for three in threes:
        turned, placed = three_point_starts(observations, three)
        costs = np.stack(
            [linearise(problem, turned[:, :, s], placed[:, s])[0] for s in range(placed.shape[1])]
        )
        order = np.argsort(np.nan_to_num(costs, nan=np.inf), axis=0)[:most]
        rotations.append(np.take_along_axis(turned, order[None, None], axis=2))
        positions.append(np.take_along_axis(placed, order[None], axis=1))
    return np.concatenate(rotations, axis=2), np.concatenate(positions, axis=1)


def _beside(observations: Observations, fits: PoseFit) -> tuple[Array, Array]:
    """Return starts R (3, 3, 8, B) and c (3, 8, B) that see the array much as the best of the fits does.

    The plane of the array tilted to the other side of the sight s, (1 − 2 s sᵀ) R (1 − 2 m mᵀ) with m its normal: from
    afar it looks the same. And the array turned about its length in steps of an eighth: all targets but one on a line
    say little of that turn.
    """
    rotation, position = fits.rotation[..., 0, :], fits.position[:, 0]
    sight = position / np.sqrt(np.sum(position * position, axis=0))
    normal, length = (np.broadcast_to(observations.principal[2][:, k], sight.shape) for k in (0, 2))
    seen, away = (np.eye(3)[:, :, None] - 2.0 * np.einsum("ib,jb->ijb", v, v) for v in (sight, normal))
    rotations = [np.einsum("ijb,jkb,klb->ilb", seen, rotation, away)]
    for part in range(1, 8):
        rotations.append(np.einsum("ijb,jkb->ikb", rotation, exponential(0.25 * np.pi * part * length)))
    return np.stack(rotations, axis=2), np.repeat(position[:, None], 8, axis=1)


def _adjusted(
    observations: Observations,
    method: Method,
    point_weights: PointWeights,
    rotations: Array,
    positions: Array,
) -> PoseFit:
    """Adjust all starts far enough to compare them, an axis (S,) before the batch."""
    count = positions.shape[1]
    every = np.tile(np.arange(observations.count), count)
    many = observations.take(every) if count > 1 else observations
    problem = problem_of(many, method, point_weights)
    flat = adjust(
        problem, begin(problem, rotations.reshape(3, 3, -1), positions.reshape(3, -1)), until=COARSE_DECREASE
    )
    if observations.object_variances is not None:
        problem = problem_of(many, method, point_weights, pose=(flat.rotation, flat.position))
        flat = adjust(problem, begin(problem, flat.rotation, flat.position), until=COARSE_DECREASE)
    return PoseFit(
        *(
            getattr(flat, name).reshape(*getattr(flat, name).shape[:-1], count, observations.count)
            for name in flat.__dataclass_fields__
        )
    )


def _by_cost(fits: PoseFit) -> PoseFit:
    """Return fits by their cost, the settled ones first."""
    cost = np.where(np.isfinite(fits.cost), fits.cost, np.inf)
    order = np.lexsort((cost, ~fits.settled), axis=0)
    return PoseFit(
        *(
            np.take_along_axis(values, order.reshape((1,) * (values.ndim - 2) + order.shape), axis=-2)
            for values in (getattr(fits, name) for name in fits.__dataclass_fields__)
        )
    )
