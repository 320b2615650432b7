"""The poses that are looked at before one is chosen: starts of each method, adjusted as far as they can be compared."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scanner_sim.pose.adjustment import COARSE, Fit, adjust, begin, linearise
from scanner_sim.pose.points import point_fit
from scanner_sim.pose.resection import PLANAR, planar_starts, three_point_starts, widest_three
from scanner_sim.pose.sightings import Sightings
from scanner_sim.pose.weights import Method, PointWeights, measured_points, problem_of

Array = NDArray[np.float64]

ALTERNATIVES = 3
"""Further poses that are kept: three points have up to four in all, a plane two."""


def ranked_fits(sightings: Sightings, method: Method, point_weights: PointWeights, *, by_three: bool) -> Fit:
    """Return the best poses by their cost, up to four, with an axis (S,) before the batch.

    Parameters
    ----------
    sightings
        B poses.
    method, point_weights
        See :func:`~scanner_sim.pose.weights.problem_of`.
    by_three
        Start resection from three targets, whatever the array.
    """
    rotations, positions = _starts(sightings, method, by_three)
    return _ranked(sightings, method, point_weights, rotations, positions)


def _starts(sightings: Sightings, method: Method, by_three: bool) -> tuple[Array, Array]:
    """Return poses to start from: R (3, 3, S, B) and c (3, S, B), NaN where there is none."""
    rotations, positions = [], []
    if method != "uv":
        measured, used = measured_points(sightings), sightings.seen & sightings.ranged
        rotation, position = point_fit(sightings.points, measured, used)
        lacking = used.sum(axis=0) < 3
        rotations.append(np.where(lacking, np.nan, rotation)[:, :, None])
        positions.append(np.where(lacking, np.nan, position)[:, None])
    if method != "xyz":
        rotation, position = _resection_starts(sightings, by_three)
        rotations.append(rotation)
        positions.append(position)
    if sightings.prior is not None:
        turned = np.broadcast_to(sightings.prior.rotation, (3, 3, sightings.count))
        centre = np.broadcast_to(sightings.centre, (3, sightings.count))
        placed = sightings.prior.position + np.einsum("ijb,jb->ib", turned, centre)
        rotations.append(turned[:, :, None])
        positions.append(placed[:, None])
    return np.concatenate(rotations, axis=2), np.concatenate(positions, axis=1)


def _resection_starts(sightings: Sightings, by_three: bool) -> tuple[Array, Array]:
    """Return two starts of planar arrays of four targets and more, four of any three targets of all others."""
    used = sightings.seen
    flat = np.zeros(sightings.count, dtype=bool)
    if not by_three:
        widths = sightings.principal[1]
        flat = np.broadcast_to(widths[0] < PLANAR * widths[1], flat.shape) & (used.sum(axis=0) > 3)
    if flat.all():
        return planar_starts(sightings)
    rotations = np.full((3, 3, 4, sightings.count), np.nan)
    positions = np.full((3, 4, sightings.count), np.nan)
    if flat.any():
        index = np.flatnonzero(flat)
        rotations[:, :, :2, index], positions[:, :2, index] = planar_starts(sightings.some(index))
    index = np.flatnonzero(~flat)
    chosen = sightings.some(index)
    candidates = three_point_starts(chosen, widest_three(chosen.points, chosen.seen))
    problem = problem_of(chosen, "uv", "covariance")
    costs = np.stack(
        [
            linearise(problem, candidates[0][:, :, s], candidates[1][:, s])[0]
            for s in range(candidates[0].shape[2])
        ]
    )
    order = np.argsort(np.nan_to_num(costs, nan=np.inf), axis=0)[:4]
    rotations[..., index] = np.take_along_axis(candidates[0], order[None, None], axis=2)
    positions[..., index] = np.take_along_axis(candidates[1], order[None], axis=1)
    return rotations, positions


def _ranked(
    sightings: Sightings, method: Method, point_weights: PointWeights, rotations: Array, positions: Array
) -> Fit:
    """Adjust all starts far enough to compare them, and return them by their cost, an axis (S,) before the batch."""
    count = positions.shape[1]
    every = np.tile(np.arange(sightings.count), count)
    many = sightings.some(every) if count > 1 else sightings
    problem = problem_of(many, method, point_weights)
    flat = adjust(
        problem, begin(problem, rotations.reshape(3, 3, -1), positions.reshape(3, -1)), until=COARSE
    )
    if sightings.object_variances is not None:
        problem = problem_of(many, method, point_weights, pose=(flat.rotation, flat.position))
        flat = adjust(problem, begin(problem, flat.rotation, flat.position), until=COARSE)
    fits = {
        name: getattr(flat, name).reshape(*getattr(flat, name).shape[:-1], count, sightings.count)
        for name in flat.__dataclass_fields__
    }
    worth = np.where(np.isfinite(fits["cost"]), fits["cost"], np.inf) + np.where(fits["settled"], 0.0, 1e200)
    order = np.argsort(worth, axis=0, kind="stable")[: ALTERNATIVES + 1]
    return Fit(
        *(
            np.take_along_axis(values, order.reshape((1,) * (values.ndim - 2) + order.shape), axis=-2)
            for values in fits.values()
        )
    )
