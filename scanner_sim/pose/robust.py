"""Which targets agree on one pose, where some are not what they are taken for.

Fischler and Bolles, *Comm. ACM* 24 (1981) 381 (RANSAC), with the truncated squares of Torr and Zisserman (2000) and a
fit to what agrees before it is judged (Chum, Matas, Kittler 2003). With the few targets of an object all threes can
be tried, so nothing is drawn at random; of more than 84 threes every so many-th is.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from scanner_sim.foundation.arithmetic import inverse, solve_linear
from scanner_sim.pose.adjustment import (
    COARSE_DECREASE,
    Problem,
    adjust,
    begin,
    jacobian,
    place_points,
    predict,
    whiten,
)
from scanner_sim.pose.observations import Flags, Observations, at_least_two
from scanner_sim.pose.point_fit import point_fit
from scanner_sim.pose.resection import MOST_THREES, three_point_starts
from scanner_sim.pose.solution import solve
from scanner_sim.pose.weights import Method, measured_points, problem_of

Array = NDArray[np.float64]

_REJECTION_PROBABILITY = 1e-3
"""Probability with which a good target is left out."""
_GATE_WIDENING = 4.0
"""Widening of that limit for the poses of three targets, whose covariance is good to first order only."""
_MOST_ROUNDS = 3


def agreeing(observations: Observations, method: Method) -> tuple[Flags, Flags]:
    """Return the targets that agree on one pose.

    Each three gives a pose and its covariance C; a further target agrees with it if its residual e does within its own
    error and that of the pose, eᵀ(1 + J C Jᵀ)⁻¹e < 4 χ²(99.9 %), whitened. A fit to those that agree is then judged by
    the sum of all squared residuals, each cut at χ²(99.9 %); the least sum wins.

    Parameters
    ----------
    observations
        B poses of n targets.
    method
        What the pose will be estimated from.

    Returns
    -------
    tuple
        Which targets agree (n, B), and whether they are enough (B,): four for ``uv``, since the angles of three always
        have a pose, three otherwise.
    """
    channels, needed = (2, 4) if method == "uv" else (3, 3)
    limit = float(chdtri(channels, _REJECTION_PROBABILITY))
    # All of them first: a lone three of a small square says little about the fourth. Most often that is all.
    plain = solve(observations, method, "covariance", 0.0)
    squares, kept = _refitted(observations, method, plain.rotation, plain.position, observations.seen, limit)
    doubtful = np.flatnonzero((kept != observations.seen).any(axis=0))
    if doubtful.size:
        doubtful = at_least_two(doubtful)
        least = np.minimum(squares[:, doubtful], limit).sum(axis=0)
        kept[:, doubtful] = _best_of_threes(
            observations.take(doubtful), method, limit, least, kept[:, doubtful]
        )
    return kept, kept.sum(axis=0) >= needed


def _best_of_threes(
    observations: Observations, method: Method, limit: float, least: Array, kept: Flags
) -> Flags:
    """Return the targets (n, B) that agree with the best of the threes, where it is better than ``least`` (B,)."""
    threes = list(combinations(range(len(observations.seen)), 3))
    for three in threes[:: -(-len(threes) // MOST_THREES)]:
        chosen = np.full(observations.count, np.inf)
        rotation, position = (
            np.tile(np.eye(3)[:, :, None], observations.count),
            np.ones((3, observations.count)),
        )
        agree = np.zeros_like(observations.seen)
        for turned, placed in _poses_of(observations, three, method):
            apart = _distances(_problem(observations, method, (turned, placed)), turned, placed, three)
            apart = np.where(observations.seen & np.isfinite(apart), apart, np.inf)
            score = np.minimum(apart, _GATE_WIDENING * limit).sum(axis=0)
            score = np.where(
                np.isfinite(placed).all(axis=0) & np.isfinite(turned).all(axis=(0, 1)), score, np.inf
            )
            better = score < chosen
            chosen[better] = score[better]
            agree[:, better] = apart[:, better] < _GATE_WIDENING * limit
            rotation[..., better], position[..., better] = turned[..., better], placed[..., better]
        squares, agree = _refitted(observations, method, rotation, position, agree, limit)
        score = np.where(np.isfinite(chosen), np.minimum(squares, limit).sum(axis=0), np.inf)
        better = score < least
        least = np.where(better, score, least)
        kept = np.where(better, agree, kept)
    return kept


def _refitted(
    observations: Observations, method: Method, rotation: Array, position: Array, agree: Flags, limit: float
) -> tuple[Array, Flags]:
    """Fit to the targets that agree, and choose them again; return all squared residuals and the choice (n, B)."""
    squares = np.full(agree.shape, np.inf)
    for _ in range(_MOST_ROUNDS):
        problem = _problem(observations.only(agree), method, (rotation, position))
        fit = adjust(problem, begin(problem, rotation, position), until=COARSE_DECREASE)
        rotation, position = fit.rotation, fit.position
        whole = _problem(observations, method, (rotation, position))
        _, placed = place_points(whole, rotation, position)
        whitened = whiten(whole, whole.measured - predict(whole, placed)[0])
        squares = np.nan_to_num(np.sum(whitened * whitened, axis=0), nan=np.inf)
        squares = np.where(observations.seen, squares, np.inf)
        agree = squares < limit
    return squares, agree


def _problem(observations: Observations, method: Method, pose: tuple[Array, Array]) -> Problem:
    return problem_of(
        observations, method, "covariance", pose=pose if observations.object_variances is not None else None
    )


def _distances(problem: Problem, rotation: Array, position: Array, three: tuple[int, ...]) -> Array:
    """Return eᵀ(1 + J C Jᵀ)⁻¹e of all targets (n, B) for poses of three of them, C the inverse of JᵀJ of these."""
    turned, placed = place_points(problem, rotation, position)
    predicted, gradients = predict(problem, placed)
    whitened = whiten(problem, problem.measured - predicted)
    rows = np.nan_to_num(jacobian(problem, turned, gradients)[:6])
    own = rows[:, :, list(three)].reshape(6, -1, rows.shape[-1])
    normal = np.einsum("akb,ckb->bac", own, own)
    size = np.einsum("baa->ba", normal)[:, :, None] * np.eye(6)
    # The ridge keeps the poses of three targets nearly on a line, or hidden, from being singular.
    covariance = inverse(normal + 1e-12 * size + 1e-12 * np.eye(6))
    spread = np.einsum("dcnb,denb->nbce", np.einsum("acnb,bad->dcnb", rows, covariance), rows)
    spread = spread + np.eye(len(whitened))
    errors = np.nan_to_num(np.moveaxis(whitened, 0, -1))[..., None]
    return np.asarray((errors * solve_linear(spread, errors)).sum(axis=(-2, -1)))


def _poses_of(
    observations: Observations, three: tuple[int, ...], method: Method
) -> list[tuple[Array, Array]]:
    """Return the poses R (3, 3, B), c (3, B) of three targets, NaN where they were not all measured."""
    chosen = np.zeros_like(observations.seen)
    chosen[list(three)] = True
    seen = observations.seen[list(three)].all(axis=0)
    ranged = seen & observations.ranged[list(three)].all(axis=0)
    found = []
    if method != "uv" and ranged.any():
        rotation, position = point_fit(observations.points, measured_points(observations), chosen)
        found.append((rotation, np.where(ranged, position, np.nan)))
    if method == "uv" or (method == "joint" and not ranged.all()):
        index = np.tile(np.array(three)[:, None], observations.count)
        rotations, positions = three_point_starts(observations, index)
        positions = np.where(seen, positions, np.nan)
        found += [(rotations[:, :, s], positions[:, s]) for s in range(rotations.shape[2])]
    return found
