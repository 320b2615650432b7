"""From sightings to poses: start, adjust, rank, and give the covariance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chdtri

from scanner_sim.pose.adjustment import (
    FINE,
    Fit,
    adjust,
    begin,
    jacobian,
    linearise,
    place_points,
    predict,
    whiten,
)
from scanner_sim.pose.sightings import Sightings, several
from scanner_sim.pose.starts import ALTERNATIVES, ranked_fits
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.weights import Method, PointWeights, point_covariances, problem_of

Array = NDArray[np.float64]

SAME = 0.25
"""Squared Mahalanobis distance within which two poses are one."""
DOUBTFUL = 9.0
"""Difference of χ² to the next pose below which the best one is ambiguous: odds of 1 in 90."""
APART = float(chdtri(6, 0.01))
"""Squared Mahalanobis distance beyond which another pose is not covered by the covariance (99 %)."""
MISFIT = 1e-6
"""Probability of χ² below which a fit is looked at again, from another start and in a mirror."""


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
    sightings: Sightings,
    method: Method,
    point_weights: PointWeights,
    huber: float,
    *,
    by_three: bool = False,
) -> Solution:
    """Return the poses of sightings with at least three targets that are not on a line.

    Parameters
    ----------
    sightings
        B poses.
    method, point_weights
        See :func:`~scanner_sim.pose.weights.problem_of`.
    huber
        Standard deviations beyond which a target counts linearly; 0 for plain least squares.
    by_three
        Start resection from three targets, whatever the array.

    Returns
    -------
    Solution
        Status VALID, AMBIGUOUS or NOT_CONVERGED.
    """
    ranked = ranked_fits(sightings, method, point_weights, by_three=by_three)
    best = Fit(*(getattr(ranked, name)[..., 0, :].copy() for name in ranked.__dataclass_fields__))
    carried = sightings.object_variances is not None
    for _ in range(2 if carried else 1):
        pose = (best.rotation, best.position) if carried else None
        problem = problem_of(sightings, method, point_weights, huber=huber, pose=pose)
        if carried or huber:
            best = begin(problem, best.rotation, best.position)
        best = adjust(problem, best, until=FINE)
    usable = np.isfinite(best.cost)
    covariance = _inverse(np.where(usable, best.normal, np.eye(6)[:, :, None]))
    chi2, dof = best.cost, _dof(sightings, method)
    if method == "xyz" and point_weights == "equal":
        pose = (best.rotation, best.position)
        covariance = _sandwich(sightings, pose, covariance)
        full = problem_of(sightings, method, "covariance", pose=pose if carried else None)
        chi2 = linearise(full, *pose)[0]
    solution = _with_others(ranked, best, covariance, chi2, dof)
    if not by_three and method != "xyz":
        bad = ~best.settled | (_probability(chi2, dof) < MISFIT) if not huber else ~best.settled
        _try_again(solution, np.flatnonzero(bad), sightings, method, point_weights, huber)
    return solution


def fits_mirrored(
    sightings: Sightings, method: Method, point_weights: PointWeights, solution: Solution
) -> NDArray[np.bool_]:
    """Return which poses (B,) fit badly, and at least a hundred times better with the mirror image of the object.

    A planar array has no handedness that angles and ranges could show: it looks like itself from behind.
    """
    mirrored = np.zeros(sightings.count, dtype=bool)
    bad = np.flatnonzero((_probability(solution.chi2, solution.dof) < MISFIT) | ~np.isfinite(solution.chi2))
    bad = several(bad)
    if bad.size:
        other = solve(sightings.some(bad).mirrored(), method, point_weights, 0.0, by_three=True)
        with np.errstate(invalid="ignore"):
            mirrored[bad] = 100.0 * other.chi2 < np.nan_to_num(solution.chi2[bad], nan=np.inf)
        mirrored[bad] &= other.status != PoseStatus.NOT_CONVERGED
    return mirrored


def residuals_of(sightings: Sightings, method: Method, solution: Solution) -> Array:
    """Return measured less predicted, shape (c, n, B): angles [rad] and range [m], or points [m]; NaN if hidden."""
    problem = problem_of(sightings, method, "equal")
    _, placed = place_points(problem, solution.rotation, solution.position)
    seen = np.broadcast_to(sightings.seen, problem.measured.shape).copy()
    if method != "uv":
        seen[2] &= sightings.ranged
    return np.where(seen, problem.measured - predict(problem, placed)[0], np.nan)


def squared_lengths(sightings: Sightings, method: Method, rotation: Array, position: Array) -> Array:
    """Return each target's squared whitened residual, shape (n, B)."""
    pose = (rotation, position) if sightings.object_variances is not None else None
    problem = problem_of(sightings, method, "covariance", pose=pose)
    _, placed = place_points(problem, rotation, position)
    whitened = whiten(problem, problem.measured - predict(problem, placed)[0])
    result: Array = np.sum(whitened * whitened, axis=0)
    return result


def _with_others(ranked: Fit, best: Fit, covariance: Array, chi2: Array, dof: NDArray[np.int64]) -> Solution:
    """Return the best poses with the other ones that are different, the ambiguous marked."""
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
    known = [(best.rotation, best.position)]
    filled = np.zeros(batch, dtype=np.intp)
    poses = np.arange(batch)
    for s in range(1, ranked.cost.shape[0]):
        rotation, position = ranked.rotation[..., s, :], ranked.position[..., s, :]
        new = ranked.settled[s].copy()
        far = np.full(batch, np.inf)
        for number, earlier in enumerate(known):
            distance = _distance(rotation, position, *earlier, best.normal)
            far = distance if number == 0 else far
            new &= ~(distance < SAME)
        known.append((rotation, position))
        place, index = filled[new], poses[new]
        solution.other_rotation[:, :, place, index] = rotation[..., new]
        solution.other_position[:, place, index] = position[..., new]
        solution.other_chi2[place, index] = ranked.cost[s, new]
        filled += new
        doubtful = new & (ranked.cost[s] - best.cost < DOUBTFUL) & (far > APART)
        solution.status[doubtful & (solution.status == PoseStatus.VALID)] = PoseStatus.AMBIGUOUS
    return solution


def _distance(rotation: Array, position: Array, other: Array, place: Array, normal: Array) -> Array:
    """Return the squared Mahalanobis distance (B,) of two poses; infinite where they differ by a quarter turn."""
    apart = np.einsum("ijb,kjb->ikb", rotation, other)
    turn = 0.5 * np.stack([apart[2, 1] - apart[1, 2], apart[0, 2] - apart[2, 0], apart[1, 0] - apart[0, 1]])
    change = np.concatenate([position - place, turn])
    distance: Array = np.einsum("ab,acb,cb->b", change, normal, change)
    return np.where(np.trace(apart) < 1.0, np.inf, distance)


def _try_again(
    solution: Solution,
    index: NDArray[np.intp],
    sightings: Sightings,
    method: Method,
    point_weights: PointWeights,
    huber: float,
) -> None:
    """Solve the poses ``index`` once more from three targets, and keep what fits better."""
    if not index.size:
        return
    index = several(index)
    other = solve(sightings.some(index), method, point_weights, huber, by_three=True)
    before = np.where(
        solution.status[index] == PoseStatus.NOT_CONVERGED,
        np.inf,
        np.nan_to_num(solution.chi2[index], nan=np.inf),
    )
    better = (other.status != PoseStatus.NOT_CONVERGED) & (other.chi2 < before - 1e-3)
    for name in solution.__dataclass_fields__:
        getattr(solution, name)[..., index[better]] = getattr(other, name)[..., better]


def _dof(sightings: Sightings, method: Method) -> NDArray[np.int64]:
    """Return the number of measured quantities less six, a prior's six added (B,)."""
    seen, ranged = sightings.seen.sum(axis=0), (sightings.seen & sightings.ranged).sum(axis=0)
    quantities = {"uv": 2 * seen, "xyz": 3 * ranged, "joint": 2 * seen + ranged}[method]
    result: NDArray[np.int64] = quantities - (6 if sightings.prior is None else 0)
    return result


def _probability(chi2: Array, dof: NDArray[np.int64]) -> Array:
    """Return the probability of a larger χ² (B,); 1 without a degree of freedom."""
    result: Array = np.where(dof > 0, chdtrc(np.maximum(dof, 1), np.nan_to_num(chi2, nan=np.inf)), 1.0)
    return result


def _inverse(normal: Array) -> Array:
    """Return the inverse of normal matrices (6, 6, B); the pseudo-inverse where one of them is exactly singular."""
    stacked = np.moveaxis(normal, -1, 0)
    try:
        inverse = np.linalg.inv(stacked)
    except np.linalg.LinAlgError:
        inverse = np.linalg.pinv(stacked, hermitian=True)
    inverse = 0.5 * (inverse + np.swapaxes(inverse, 1, 2))
    return np.ascontiguousarray(np.moveaxis(inverse, 0, -1))


def _sandwich(sightings: Sightings, pose: tuple[Array, Array], inverse: Array) -> Array:
    """Return N⁻¹ (Σ Jᵀ W C W J) N⁻¹: the covariance of equal weights W under the true covariances C of the points."""
    problem = problem_of(sightings, "xyz", "equal")
    turned, _ = place_points(problem, *pose)
    rows = jacobian(problem, turned, None)[:6]
    weighted = rows * problem.whitening
    spread = np.einsum("acnb,cdnb,ednb->aeb", weighted, point_covariances(sightings, pose), weighted)
    result: Array = np.einsum("acb,cdb,deb->aeb", inverse, spread, inverse)
    return result
