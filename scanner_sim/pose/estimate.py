"""Pose of an object from the angles and ranges of its targets: one case or a batch."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.errors import InputError
from scanner_sim.pose.inputs import PosePrior, Values, sightings_from
from scanner_sim.pose.robust import agreeing
from scanner_sim.pose.sightings import Sightings, several, shared
from scanner_sim.pose.solution import (
    ALTERNATIVES,
    Solution,
    fits_mirrored,
    residuals_of,
    solve,
    squared_lengths,
)
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.transforms import quaternion_from_rotation, yaw_pitch_roll_from_rotation
from scanner_sim.pose.weights import Method, PointWeights

Array = NDArray[np.float64]
Robust = Literal["huber", "ransac"]

_COLLINEAR = 1e-6
"""Width over length of the measured targets below which they lie on one line."""
_HUBER = 2.0
"""Standard deviations beyond which a target counts linearly."""
_POSES_AT_LEAST, _POSES_AT_ONCE = 1024, 4096
"""Poses of one pass: enough to hide the interpreter, few enough for a core's cache."""


@dataclass(frozen=True)
class Alternatives:
    """Further poses that fit, the best first; NaN where there are none.

    Attributes
    ----------
    position, rotation
        Shapes (..., 3, 3) and (..., 3, 3, 3): the third last axis of the rotations, and the second last of the
        positions [m], counts them.
    chi2
        Shape (..., 3).
    """

    position: Array
    rotation: Array
    chi2: Array


@dataclass(frozen=True)
class PoseEstimate:
    """Poses with their covariance; the leading axes (...) are those of the measurements.

    Attributes
    ----------
    position
        Of the object's origin in the scanner frame [m], shape (..., 3).
    rotation
        ``scanner_from_object``, shape (..., 3, 3).
    covariance
        Of (δt, δω) [m, rad] with position + δt and exp([δω]×) rotation, all along the scanner's axes, shape
        (..., 6, 6).
    residuals
        Measured less predicted (Θ, φ) [rad] or (Θ, φ, R) [rad, rad, m]; of ``xyz`` points (x, y, z) [m]; shape
        (..., targets, 2 or 3). NaN where not measured.
    weights
        Share with which each target counted: 0 hidden or rejected, 1 in full; shape (..., targets).
    chi2, dof
        Σ of the squared residuals in standard deviations, and the number of them less six, shape (...). Of ``huber``,
        Huber's function of them.
    alternatives
        Other poses that fit, ranked by χ².
    status
        :class:`~scanner_sim.pose.status.PoseStatus`, shape (...).
    """

    position: Array
    rotation: Array
    covariance: Array
    residuals: Array
    weights: Array
    chi2: Array
    dof: NDArray[np.int64]
    alternatives: Alternatives
    status: NDArray[np.int8]

    @property
    def quaternion(self) -> Array:
        """Unit quaternions (w, x, y, z) of the rotations, w ≥ 0, shape (..., 4)."""
        return quaternion_from_rotation(self.rotation)

    @property
    def yaw_pitch_roll(self) -> Array:
        """Yaw, pitch and roll [rad], shape (..., 3): see :mod:`scanner_sim.pose.transforms`."""
        return yaw_pitch_roll_from_rotation(self.rotation)

    @property
    def sigma(self) -> Array:
        """Standard deviations of (δt, δω) [m, rad], shape (..., 6)."""
        result: Array = np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))
        return result

    @property
    def scanner_from_object(self) -> Array:
        """4 × 4 matrices M of eq 8, shape (..., 4, 4)."""
        matrices = np.zeros((*self.position.shape[:-1], 4, 4))
        matrices[..., :3, :3], matrices[..., :3, 3], matrices[..., 3, 3] = self.rotation, self.position, 1.0
        return matrices


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
    point_weights: PointWeights = "covariance",
    prior: PosePrior | None = None,
    robust: Robust | None = None,
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
    point_weights
        Of ``xyz``: ``equal`` is eq 11 as printed. With the weights of the full covariance the lateral coordinates
        place the object in depth, too, so that to first order ``xyz`` is then ``joint``.
    prior
        Pose known before; it counts by its covariance.
    robust
        ``huber``: targets beyond two standard deviations count linearly; survives small errors of many targets.
        ``ransac``: the targets that agree on one pose count, others not at all; survives large errors of some. With
        angles alone four must agree, with ranges three.

    Returns
    -------
    PoseEstimate
        One pose, or a batch with the leading axes of the arguments. Poses that could not be estimated are NaN and their
        ``status`` says why; one that did not settle is given as it was last.

    Raises
    ------
    InputError
        Shapes or names that do not fit, coordinates that are not finite or not distinct, or points that fit only in a
        mirror (where that holds for every pose; in a mixed batch it is a status).

    Notes
    -----
    Minimised is Σ eᵀ C⁻¹ e over the six degrees of freedom, e the difference of measured and predicted quantities by
    the exact inverse of eq 3, C their covariance with the share of the surveyed points; the covariance of the pose is
    the inverse of the normal matrix, first order in the errors. Not modelled: errors common to all targets (a drift
    of the mirrors moves the pose with the scanner's frame), and a distortion of the scanner's geometry.
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
    if method != "uv" and (ranges is None or sigma_range is None):
        raise InputError(f"Method {method} needs ranges and sigma_range.", remedy="Give both, or take uv.")
    sightings, leading = sightings_from(
        object_points,
        theta,
        phi,
        ranges,
        sigma_theta=sigma_theta,
        sigma_phi=sigma_phi,
        sigma_range=sigma_range,
        covariance_theta_range=covariance_theta_range,
        sigma_object=sigma_object,
        axis_separation=axis_separation,
        prior=prior,
    )
    if method == "xyz":
        sightings = sightings.only(sightings.ranged)

    size = max(min(_POSES_AT_ONCE, -(-sightings.count // _cores())), _POSES_AT_LEAST)

    def work(first: int) -> PoseEstimate:
        last = min(first + size, sightings.count)
        if first == 0 and last == sightings.count > 1:
            chosen = sightings
        else:
            chosen = sightings.some(several(np.arange(first, last)))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return _estimate(chosen, method, point_weights, robust)

    starts = range(0, sightings.count, size)
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
    return _joined(parts, leading, sightings.count)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _estimate(
    sightings: Sightings, method: Method, point_weights: PointWeights, robust: Robust | None
) -> PoseEstimate:
    """Return the estimates of a pass, with one leading axis."""
    status = _measurable(sightings)
    if robust == "ransac":
        index = several(np.flatnonzero(status == PoseStatus.VALID))
        if index.size:
            kept, enough = agreeing(sightings.some(index), method)
            everywhere = np.ones(sightings.seen.shape, dtype=bool)
            everywhere[:, index] = kept
            sightings = sightings.only(everywhere)
            status[index[~enough]] = PoseStatus.NO_CONSENSUS
            again = _measurable(sightings)
            status = np.where(status == PoseStatus.VALID, again, status)
    index = several(np.flatnonzero(status == PoseStatus.VALID))
    every = len(index) == len(status)
    result = _empty(sightings, method, status)
    if not index.size:
        return result
    chosen = sightings if every else sightings.some(index)
    huber = _HUBER if robust == "huber" else 0.0
    solution = solve(chosen, method, point_weights, huber)
    if robust is None:
        mirrored = fits_mirrored(chosen, method, point_weights, solution)
        solution.status[mirrored] = PoseStatus.MIRRORED
    _fill(result, index, chosen, method, solution, huber)
    return result


def _measurable(sightings: Sightings) -> NDArray[np.int8]:
    """Return VALID, or why no pose can be had (B,)."""
    count = shared(sightings.seen).sum(axis=0)
    widths = sightings.principal[1]
    status = np.full(max(len(count), widths.shape[1]), PoseStatus.VALID, dtype=np.int8)
    status[widths[1] <= _COLLINEAR * widths[2]] = PoseStatus.COLLINEAR
    status = np.where(count < 3, np.where(count == 0, PoseStatus.HIDDEN, PoseStatus.TOO_FEW), status)
    return np.broadcast_to(status, (sightings.count,)).astype(np.int8)


def _empty(sightings: Sightings, method: Method, status: NDArray[np.int8]) -> PoseEstimate:
    batch, targets = len(status), len(sightings.seen)
    return PoseEstimate(
        position=np.full((batch, 3), np.nan),
        rotation=np.full((batch, 3, 3), np.nan),
        covariance=np.full((batch, 6, 6), np.nan),
        residuals=np.full((batch, targets, 2 if method == "uv" else 3), np.nan),
        weights=np.zeros((batch, targets)),
        chi2=np.full(batch, np.nan),
        dof=np.zeros(batch, dtype=np.int64),
        alternatives=Alternatives(
            np.full((batch, ALTERNATIVES, 3), np.nan),
            np.full((batch, ALTERNATIVES, 3, 3), np.nan),
            np.full((batch, ALTERNATIVES), np.nan),
        ),
        status=status,
    )


def _fill(
    result: PoseEstimate,
    index: NDArray[np.intp],
    sightings: Sightings,
    method: Method,
    solution: Solution,
    huber: float,
) -> None:
    """Write solutions to their places, from the centre of the array to the object's origin."""
    result.status[index] = solution.status
    good = (solution.status != PoseStatus.MIRRORED) & np.isfinite(solution.covariance).all(axis=(0, 1))
    into = index[good]
    arm = np.einsum(
        "ijb,jb->ib", solution.rotation, np.broadcast_to(sightings.centre, solution.position.shape)
    )
    covariance = _moved(solution.covariance, arm)
    residuals = residuals_of(sightings, method, solution)
    weights = sightings.seen.astype(np.float64)
    if huber:
        squares = squared_lengths(sightings, method, solution.rotation, solution.position)
        weights *= np.minimum(1.0, huber / np.sqrt(np.maximum(squares, 1e-300)))
    result.position[into] = (solution.position - arm).T[good]
    result.rotation[into] = np.moveaxis(solution.rotation, -1, 0)[good]
    result.covariance[into] = np.moveaxis(covariance, -1, 0)[good]
    result.residuals[into] = residuals.transpose(2, 1, 0)[good]
    result.weights[into] = weights.T[good]
    result.chi2[into], result.dof[into] = solution.chi2[good], solution.dof[good]
    centre = np.broadcast_to(sightings.centre[:, None], solution.other_position.shape)
    others = solution.other_position - np.einsum("ijab,jab->iab", solution.other_rotation, centre)
    result.alternatives.position[into] = others.transpose(2, 1, 0)[good]
    result.alternatives.rotation[into] = solution.other_rotation.transpose(3, 2, 0, 1)[good]
    result.alternatives.chi2[into] = solution.other_chi2.T[good]


def _moved(covariance: Array, arm: Array) -> Array:
    """Return the covariance (6, 6, B) for the origin, where X_origin = c − arm: δt = δc + arm × δω, arm (3, B)."""
    moved = covariance.copy()
    for _ in range(2):  # rows, then, by symmetry, columns
        turn = moved[3:]
        moved[:3] += np.stack(
            [
                arm[1] * turn[2] - arm[2] * turn[1],
                arm[2] * turn[0] - arm[0] * turn[2],
                arm[0] * turn[1] - arm[1] * turn[0],
            ]
        )
        moved = np.swapaxes(moved, 0, 1)
    return moved


def _joined(parts: list[PoseEstimate], leading: tuple[int, ...], count: int) -> PoseEstimate:
    """Return passes as one estimate with the leading axes of the measurements."""

    def join(values: list[NDArray[np.generic]]) -> NDArray[np.generic]:
        whole = values[0] if len(values) == 1 else np.concatenate(values)
        return whole[:count].reshape((*leading, *whole.shape[1:]))

    names = [name for name in PoseEstimate.__dataclass_fields__ if name != "alternatives"]
    others = {
        name: join([getattr(part.alternatives, name) for part in parts])
        for name in Alternatives.__dataclass_fields__
    }
    fields = {name: join([getattr(part, name) for part in parts]) for name in names}
    return PoseEstimate(**fields, alternatives=Alternatives(**others))  # type: ignore[arg-type]
