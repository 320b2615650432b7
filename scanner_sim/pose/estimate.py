"""Pose of an object from the angles and ranges of its targets: one case or a batch."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.errors import InputError
from scanner_sim.pose.common_errors import common_errors, with_common_errors
from scanner_sim.pose.inputs import PosePrior, Values, observations_from
from scanner_sim.pose.observations import Observations, at_least_two, shared
from scanner_sim.pose.result import PoseEstimate, empty_result, fill_result, joined_results
from scanner_sim.pose.robust import agreeing
from scanner_sim.pose.solution import fits_mirrored, solve
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.weights import Method, PointWeights

Array = NDArray[np.float64]
Robust = Literal["huber", "ransac"]

_COLLINEAR = 1e-6
"""Width over length of the measured targets below which they lie on one line."""
_HUBER = 2.0
"""Standard deviations beyond which a target counts linearly."""
_POSES_AT_LEAST, _POSES_AT_ONCE = 1024, 4096
"""Poses of one pass: enough to hide the interpreter, few enough for a core's cache."""


def estimate_pose(
    object_points: Values,
    theta: Values,
    phi: Values,
    ranges: Values | None = None,
    *,
    sigma_theta: ArrayLike,
    sigma_phi: ArrayLike,
    sigma_range: ArrayLike | None = None,
    axis_separation: float,
    method: Method = "uv",
    sigma_object: ArrayLike | None = None,
    covariance_theta_range: ArrayLike | None = None,
    covariance_theta_phi: ArrayLike | None = None,
    point_weights: PointWeights = "covariance",
    prior: PosePrior | None = None,
    robust: Robust | None = None,
    common: Values | None = None,
) -> PoseEstimate:
    """Return the pose of an object from what the scanner measured of its targets.

    Parameters
    ----------
    object_points
        Surveyed targets along the object's axes [m], shape (n, 3), or (..., n, 3) for objects that differ. Or a mapping
        from names to (..., 3); then the measurements are mappings with the same names.
    theta, phi
        Optical deflections at which the targets were found [rad], shape (..., n). NaN: not measured.
    ranges
        R [m], the path from the first axis, shape (..., n); NaN: not measured. Needed by ``xyz`` and ``joint``.
    sigma_theta, sigma_phi, sigma_range
        Standard deviations [rad, rad, m]: a number, (n,) or (..., n).
    axis_separation
        D_g [m].
    method
        ``uv``: resection on (Θ, φ) (eq 16). ``xyz``: fit of points (eq 11), each weighted by the inverse of its
        covariance. ``joint``: (Θ, φ, R); a target without a range still counts with its angles.
    sigma_object
        Standard deviation of the surveyed coordinates [m]: a number, (n,) or (n, 3) along the object's axes. The
        errors are common to all poses of a series, so the errors of these poses are not independent.
    covariance_theta_range
        Covariance of Θ and R [rad m]: a number, (n,) or (..., n). In triangulation R follows Θ at fixed p, and it is
        ∂R/∂Θ σ_Θ². None: independent, as in time of flight.
    covariance_theta_phi
        Covariance of Θ and φ [rad²], of the same shapes: the pixels of a camera are square to other directions.
    point_weights
        Of ``xyz``: ``equal`` is eq 11 as printed. With the weights of the full covariance the lateral coordinates
        place the object in depth, too, so that to first order ``xyz`` is then ``joint``.
    prior
        Pose known before; it counts by its covariance.
    robust
        ``huber``: targets beyond two standard deviations count linearly; survives small errors of many targets.
        ``ransac``: the targets that agree on one pose count, others not at all; survives large errors of some. With
        angles alone four must agree, with ranges three.
    common
        Errors that all targets share, as those of a calibration: what k independent ones of unit variance do to
        (Θ, φ, R) of each target [rad, rad, m], shape (n, 3, k) or (..., n, 3, k), or a mapping by name. They enter the
        covariance (:mod:`scanner_sim.pose.common_errors`), not the weights, and not χ². σ are then of noise alone.

    Returns
    -------
    PoseEstimate
        One pose, or a batch with the leading axes of the arguments. Poses that could not be estimated are NaN and their
        ``status`` says why; one that did not settle is given as it was last. What fits worse than chance allows once
        in 10⁴ is IMPLAUSIBLE, but for ``huber`` and equal weights, whose χ² follow other laws.

    Raises
    ------
    InputError
        Shapes or names that do not fit, coordinates that are not finite or not distinct, or points that fit only in a
        mirror (where that holds for every pose; in a mixed batch it is a status).

    Notes
    -----
    A pose does not depend on the others of its batch, to the last bit.

    Minimised is Σ eᵀ C⁻¹ e over the six degrees of freedom, e the difference of measured and predicted quantities:
    angles and ranges by the exact inverse of eq 3, points of ``xyz`` by eq 3 itself; C is their
    covariance with the share of the surveyed points. The covariance of the pose is the inverse of the normal matrix,
    first order in the errors, with the share of ``common``.
    """
    if method not in get_args(Method):
        raise InputError(f"method is {method!r}.", remedy="Give one of uv, xyz and joint.")
    if robust is not None and robust not in get_args(Robust):
        raise InputError(f"robust is {robust!r}.", remedy="Give huber, ransac or None.")
    if point_weights not in get_args(PointWeights):
        raise InputError(f"point_weights is {point_weights!r}.", remedy="Give covariance or equal.")
    if robust is not None and point_weights == "equal":
        raise InputError(
            "Equal weights and a robust method exclude one another.", remedy="Leave one of them out."
        )
    if common is not None and point_weights == "equal":
        raise InputError(
            "Equal weights and common errors exclude one another.", remedy="Leave one of them out."
        )
    if method != "uv" and (ranges is None or sigma_range is None):
        raise InputError(f"Method {method} needs ranges and sigma_range.", remedy="Give both, or take uv.")
    observations, leading = observations_from(
        object_points,
        theta,
        phi,
        ranges,
        sigma_theta=sigma_theta,
        sigma_phi=sigma_phi,
        sigma_range=sigma_range,
        covariance_theta_range=covariance_theta_range,
        covariance_theta_phi=covariance_theta_phi,
        sigma_object=sigma_object,
        axis_separation=axis_separation,
        prior=prior,
    )
    if method == "xyz":
        observations = observations.only(observations.ranged)
    shared_by_all = None if common is None else common_errors(common, object_points, leading)

    size = max(min(_POSES_AT_ONCE, -(-observations.count // _cores())), _POSES_AT_LEAST)

    def work(first: int) -> PoseEstimate:
        last = min(first + size, observations.count)
        if first == 0 and last == observations.count > 1:
            chosen = observations
        else:
            chosen = observations.take(at_least_two(np.arange(first, last)))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return _estimate(chosen, method, point_weights, robust)

    starts = range(0, max(observations.count, 1), size)
    if len(starts) == 1:
        parts = [work(0)]
    else:
        with ThreadPoolExecutor(min(len(starts), _cores())) as pool:
            parts = list(pool.map(work, starts))
    mirrored = np.concatenate([part.status for part in parts]) == PoseStatus.MIRRORED
    if mirrored.size and mirrored.all():
        raise InputError(
            "The measured targets fit the mirror image of object_points, and a reflection is not a rotation.",
            remedy="Check the signs and the order of the axes of the surveyed points.",
        )
    found = joined_results(parts, leading, observations.count)
    return found if shared_by_all is None else with_common_errors(found, observations, method, shared_by_all)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _estimate(
    observations: Observations, method: Method, point_weights: PointWeights, robust: Robust | None
) -> PoseEstimate:
    """Return the estimates of a pass, with one leading axis."""
    status = _measurable(observations)
    if robust == "ransac":
        index = at_least_two(np.flatnonzero(status == PoseStatus.VALID))
        if index.size:
            kept, enough = agreeing(observations.take(index), method)
            everywhere = np.ones(observations.seen.shape, dtype=bool)
            everywhere[:, index] = kept
            observations = observations.only(everywhere)
            status[index[~enough]] = PoseStatus.NO_CONSENSUS
            again = _measurable(observations)
            status = np.where(status == PoseStatus.VALID, again, status)
    index = at_least_two(np.flatnonzero(status == PoseStatus.VALID))
    every = len(index) == len(status)
    result = empty_result(observations, method, status)
    if not index.size:
        return result
    chosen = observations if every else observations.take(index)
    huber = _HUBER if robust == "huber" else 0.0
    solution = solve(chosen, method, point_weights, huber)
    if robust is None:
        mirrored = fits_mirrored(chosen, method, point_weights, solution)
        solution.status[mirrored] = PoseStatus.MIRRORED
    fill_result(result, index, chosen, method, solution, huber)
    return result


def _measurable(observations: Observations) -> NDArray[np.int8]:
    """Return VALID, or why no pose can be had (B,)."""
    count = shared(observations.seen).sum(axis=0)
    widths = observations.principal[1]
    status = np.full(max(len(count), widths.shape[1]), PoseStatus.VALID, dtype=np.int8)
    status[widths[1] <= _COLLINEAR * widths[2]] = PoseStatus.COLLINEAR
    status = np.where(count < 3, np.where(count == 0, PoseStatus.HIDDEN, PoseStatus.TOO_FEW), status)
    return np.broadcast_to(status, (observations.count,)).astype(np.int8)
