"""From observations to poses: start, adjust, rank, and give the covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chdtri

from scanner_sim.foundation.arithmetic import inverse as invert
from scanner_sim.pose.adjustment import (
    SETTLED_STEP,
    PoseFit,
    adjust,
    begin,
    jacobian,
    linearise,
    place_points,
    predict,
    prior_residual,
    whiten,
)
from scanner_sim.pose.curvature import bent
from scanner_sim.pose.observations import Observations, at_least_two
from scanner_sim.pose.resection import PLANAR, plane_strength
from scanner_sim.pose.starts import ALTERNATIVES, ranked_fits
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.weights import Method, PointWeights, point_covariances, problem_of

Array = NDArray[np.float64]

SAME_POSE = 0.25
"""Squared Mahalanobis distance within which two poses are one."""
AMBIGUOUS_DIFFERENCE = 9.0
"""Difference of χ² to the next pose below which the best one is ambiguous: odds of 1 in 90."""
NOT_COVERED = float(chdtri(6, 0.01))
"""Squared Mahalanobis distance beyond which another pose is not covered by the covariance (99 %)."""
LEAST_PROBABILITY = 1e-4
"""Probability of χ² below which a pose is not valid."""
_SUSPECT_PROBABILITY = 0.01
"""Probability of χ² below which other poses are looked for from all starts: a wrong one may fit as badly as this."""
_WEAK, _NARROW, _THICK, _SOLID = 0.15, 0.1, 1e-3, 0.2
"""Strength of a plane's homography, width over length, and thickness of few targets over their lesser width from which
they are no plane and up to which they are nearly one: there other poses are looked for from all starts."""
_LARGEST_GROWTH = 1e13
"""Growth of a variance by what the other unknowns leave open from which rounding tells it: ε times this is 0.002."""
_MIRROR_PROBABILITY = 1e-6
"""Probability of χ² below which a fit is looked at in a mirror."""
_UNSETTLED = (PoseStatus.NOT_CONVERGED, PoseStatus.UNDETERMINED)


@dataclass
class Solution:
    """Poses of the centre of the array, before they are put into the user's terms.

    Attributes
    ----------
    rotation, position
        (3, 3, B) and (3, B) [m].
    covariance
        Of (δc, δω), shape (6, 6, B).
    chi2, dof
        Σ of the squared whitened residuals, and their number less six (B,).
    status
        :class:`~scanner_sim.pose.status.PoseStatus` (B,).
    other_rotation, other_position, other_chi2
        The next best poses, (3, 3, 3, B), (3, 3, B), (3, B); NaN where there are none; the second last axis
        counts them.
    """

    rotation: Array
    position: Array
    covariance: Array
    chi2: Array
    dof: NDArray[np.int64]
    status: NDArray[np.int8]
    other_rotation: Array
    other_position: Array
    other_chi2: Array


def solve(
    observations: Observations,
    method: Method,
    point_weights: PointWeights,
    huber: float,
    *,
    thorough: bool = False,
) -> Solution:
    """Return the poses of observations with at least three targets that are not on a line.

    Parameters
    ----------
    observations
        B poses.
    method, point_weights
        See :func:`~scanner_sim.pose.weights.problem_of`.
    huber
        Standard deviations beyond which a target counts linearly; 0 for plain least squares.
    thorough
        Start resection from the plane and from many threes of targets, whatever the array.

    Returns
    -------
    Solution
        Status VALID, AMBIGUOUS, NOT_CONVERGED, IMPLAUSIBLE or UNDETERMINED.
    """
    ranked = ranked_fits(observations, method, point_weights, thorough=thorough)
    best = PoseFit(*(getattr(ranked, name)[..., 0, :].copy() for name in ranked.__dataclass_fields__))
    surveyed = observations.object_variances is not None
    for _ in range(2 if surveyed else 1):
        pose = (best.rotation, best.position) if surveyed else None
        problem = problem_of(observations, method, point_weights, huber=huber, pose=pose)
        if surveyed or huber:
            best = begin(problem, best.rotation, best.position)
        best = adjust(problem, best, until=SETTLED_STEP)
    covariance, determined = _inverse(best.normal)
    chi2, dof = best.cost, _dof(observations, method)
    if method == "xyz" and point_weights == "equal":
        pose = (best.rotation, best.position)
        covariance = _sandwich(observations, pose, covariance)
        full = problem_of(observations, method, "covariance", pose=pose if surveyed else None)
        chi2 = linearise(full, *pose)[0]
    curved = bent(problem, best, covariance, observations.principal)
    # Of poses that need all starts the first-order covariance does not tell which others it covers.
    solution = _with_others(ranked, best, covariance, chi2, dof, SAME_POSE if thorough else NOT_COVERED)
    # Along a bent valley other poses fit as well that the covariance does not cover.
    solution.status[curved & (solution.status == PoseStatus.VALID)] = PoseStatus.AMBIGUOUS
    solution.status[~determined] = PoseStatus.UNDETERMINED
    if not thorough and method != "xyz":
        bad = ~best.settled | ~determined | curved
        if not huber:
            bad |= _probability(chi2, dof) < _SUSPECT_PROBABILITY
        if method == "uv":
            # A start that has not settled has not shown its pose, which may be the best one.
            lost = ~ranked.settled & np.isfinite(ranked.cost)
            bad |= _few(observations) | lost.any(axis=0)
        _try_again(solution, np.flatnonzero(bad), observations, method, point_weights, huber)
    if not huber and point_weights != "equal":  # whose χ² is no least one, and follows another law
        misfit = (_probability(solution.chi2, dof) < LEAST_PROBABILITY) & (
            solution.status <= PoseStatus.AMBIGUOUS
        )
        solution.status[misfit] = PoseStatus.IMPLAUSIBLE
    return solution


def fits_mirrored(
    observations: Observations, method: Method, point_weights: PointWeights, solution: Solution
) -> NDArray[np.bool_]:
    """Return which poses (B,) fit badly, and at least a hundred times better with the mirror image of the object.

    A planar array has no handedness that angles and ranges could show: it looks like itself from behind.
    """
    mirrored = np.zeros(observations.count, dtype=bool)
    bad = np.flatnonzero(
        (_probability(solution.chi2, solution.dof) < _MIRROR_PROBABILITY) | ~np.isfinite(solution.chi2)
    )
    bad = at_least_two(bad)
    if bad.size:
        other = solve(observations.take(bad).mirrored(), method, point_weights, 0.0, thorough=True)
        with np.errstate(invalid="ignore"):
            mirrored[bad] = 100.0 * other.chi2 < np.nan_to_num(solution.chi2[bad], nan=np.inf)
        mirrored[bad] &= ~np.isin(other.status, _UNSETTLED)
    return mirrored


def residuals_of(observations: Observations, method: Method, solution: Solution) -> Array:
    """Return measured less predicted, shape (c, n, B): angles [rad] and range [m], or points [m]; NaN if hidden."""
    problem = problem_of(observations, method, "equal")
    _, placed = place_points(problem, solution.rotation, solution.position)
    seen = np.broadcast_to(observations.seen, problem.measured.shape).copy()
    if method != "uv":
        seen[2] &= observations.ranged
    return np.where(seen, problem.measured - predict(problem, placed)[0], np.nan)


def squared_lengths(observations: Observations, method: Method, rotation: Array, position: Array) -> Array:
    """Return each target's squared whitened residual, shape (n, B)."""
    pose = (rotation, position) if observations.object_variances is not None else None
    problem = problem_of(observations, method, "covariance", pose=pose)
    _, placed = place_points(problem, rotation, position)
    whitened = whiten(problem, problem.measured - predict(problem, placed)[0])
    result: Array = np.sum(whitened * whitened, axis=0)
    return result


def _with_others(
    ranked: PoseFit, best: PoseFit, covariance: Array, chi2: Array, dof: NDArray[np.int64], apart: float
) -> Solution:
    """Return the best poses with the other ones that are different; those ``apart`` that fit as well mark doubt."""
    batch = len(chi2)
    solution = Solution(
        best.rotation,
        best.position,
        covariance,
        chi2,
        dof,
        np.where(best.settled, PoseStatus.VALID, PoseStatus.NOT_CONVERGED).astype(np.int8),
        np.full((3, 3, ALTERNATIVES, batch), np.nan),
        np.full((3, ALTERNATIVES, batch), np.nan),
        np.full((ALTERNATIVES, batch), np.nan),
    )
    filled = np.zeros(batch, dtype=np.intp)
    poses = np.arange(batch)
    for s in range(1, ranked.cost.shape[0]):
        rotation, position = ranked.rotation[..., s, :], ranked.position[..., s, :]
        far = _distance(rotation, position, best.rotation, best.position, best.normal)
        new = ranked.settled[s] & ~(far < SAME_POSE) & (filled < ALTERNATIVES)
        for k in range(int(filled.max())):  # an empty slot is NaN, and nearer to nothing
            other = solution.other_rotation[:, :, k], solution.other_position[:, k]
            new &= ~(_distance(rotation, position, *other, best.normal) < SAME_POSE)
        slot, index = filled[new], poses[new]
        solution.other_rotation[:, :, slot, index] = rotation[..., new]
        solution.other_position[:, slot, index] = position[..., new]
        solution.other_chi2[slot, index] = ranked.cost[s, new]
        filled += new
        doubtful = new & (ranked.cost[s] - best.cost < AMBIGUOUS_DIFFERENCE) & (far > apart)
        solution.status[doubtful & (solution.status == PoseStatus.VALID)] = PoseStatus.AMBIGUOUS
        # What fits nearly as well and has not settled may lead to what fits better.
        going = ~ranked.settled[s] & (ranked.cost[s] - best.cost < AMBIGUOUS_DIFFERENCE)
        solution.status[going & (solution.status == PoseStatus.VALID)] = PoseStatus.AMBIGUOUS
    # Nothing checks an exact fit, of which there are two nearly always, at times too near to one another to be told.
    solution.status[(dof == 0) & (solution.status == PoseStatus.VALID)] = PoseStatus.AMBIGUOUS
    return solution


def _distance(rotation: Array, position: Array, other: Array, other_position: Array, normal: Array) -> Array:
    """Return the squared Mahalanobis distance (B,) of two poses; infinite where they differ by a quarter turn."""
    apart = np.einsum("ijb,kjb->ikb", rotation, other)
    turn = 0.5 * np.stack([apart[2, 1] - apart[1, 2], apart[0, 2] - apart[2, 0], apart[1, 0] - apart[0, 1]])
    change = np.concatenate([position - other_position, turn])
    distance: Array = np.einsum("ab,acb,cb->b", change, normal, change)
    return np.where(np.trace(apart) < 1.0, np.inf, distance)


def _try_again(
    solution: Solution,
    index: NDArray[np.intp],
    observations: Observations,
    method: Method,
    point_weights: PointWeights,
    huber: float,
) -> None:
    """Solve the poses ``index`` from all starts, and keep what fits as well or better: it knows more others."""
    if not index.size:
        return
    index = at_least_two(index)
    other = solve(observations.take(index), method, point_weights, huber, thorough=True)
    before = np.where(
        np.isin(solution.status[index], _UNSETTLED),
        np.inf,
        np.nan_to_num(solution.chi2[index], nan=np.inf),
    )
    better = ~np.isin(other.status, _UNSETTLED) & ~(other.chi2 > before + 1e-3)
    for name in solution.__dataclass_fields__:
        getattr(solution, name)[..., index[better]] = getattr(other, name)[..., better]


def _few(observations: Observations) -> NDArray[np.bool_]:
    """Return which poses (B,) rest on so few targets that two starts may miss the best pose.

    Planes with a weak homography, arrays that are nearly a line, and four targets, or five nearly in a plane, that are
    not a plane: to them both poses of the plane are strangers.
    """
    widths, count = observations.principal[1], observations.seen.sum(axis=0)
    thickness = widths[0] / widths[1]
    solid = (count == 4) & (thickness > _THICK) | (count == 5) & (thickness > _THICK) & (thickness < _SOLID)
    weak = (plane_strength(observations) < _WEAK) & (thickness < PLANAR)
    narrow = widths[1] < _NARROW * widths[2]
    return np.asarray((count > 3) & (weak | narrow | solid))


def _dof(observations: Observations, method: Method) -> NDArray[np.int64]:
    """Return the number of measured quantities less six, a prior's six added (B,)."""
    seen, ranged = observations.seen.sum(axis=0), (observations.seen & observations.ranged).sum(axis=0)
    quantities = {"uv": 2 * seen, "xyz": 3 * ranged, "joint": 2 * seen + ranged}[method]
    result: NDArray[np.int64] = quantities - (6 if observations.prior is None else 0)
    return result


def _probability(chi2: Array, dof: NDArray[np.int64]) -> Array:
    """Return the probability of a larger χ² (B,); 1 without a degree of freedom."""
    result: Array = np.where(dof > 0, chdtrc(np.maximum(dof, 1), np.nan_to_num(chi2, nan=np.inf)), 1.0)
    return result


def _inverse(normal: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return the inverses of normal matrices N (6, 6, B), and whether N tells all six unknowns (B,).

    N_ii (N⁻¹)_ii is the growth of variance i by the others' being unknown too: 1 or more in a positive definite N, and
    beyond 1/ε, or without meaning, where N is singular to rounding (Belsley, Kuh, Welsch, *Regression Diagnostics*,
    1980, section 3.2).
    """
    inverse = invert(np.moveaxis(normal, -1, 0))
    inverse = 0.5 * (inverse + np.swapaxes(inverse, 1, 2))
    inverse = np.ascontiguousarray(np.moveaxis(inverse, 0, -1))
    growth = np.einsum("aab,aab->ab", normal, inverse)
    determined = ((growth > 0.5) & (growth < _LARGEST_GROWTH)).all(axis=0) & np.isfinite(inverse).all(
        axis=(0, 1)
    )
    return np.where(determined, inverse, np.nan), determined


def _sandwich(observations: Observations, pose: tuple[Array, Array], inverse: Array) -> Array:
    """Return N⁻¹ (Σ Jᵀ W C W J + P) N⁻¹: the covariance of equal weights W under the true covariances C of the points.

    P is the information of a prior, whose weight is its own.
    """
    problem = problem_of(observations, "xyz", "equal")
    turned, _ = place_points(problem, *pose)
    rows = jacobian(problem, turned, None)[:6]
    weighted = rows * problem.whitening
    spread = np.einsum("acnb,cdnb,ednb->aeb", weighted, point_covariances(observations, pose), weighted)
    if problem.prior is not None:
        _, change = prior_residual(problem.prior, problem.centre, *pose)
        spread = spread + np.einsum("kab,kcb->acb", change, change)
    result: Array = np.einsum("acb,cdb,deb->aeb", inverse, spread, inverse)
    return result
