"""What is found of poses: the estimates of a batch, and how passes of solutions become them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.pose.observations import Observations
from scanner_sim.pose.solution import Solution, residuals_of, squared_lengths
from scanner_sim.pose.starts import ALTERNATIVES
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.transforms import quaternion_from_rotation, yaw_pitch_roll_from_rotation
from scanner_sim.pose.weights import Method

Array = NDArray[np.float64]


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


def empty_result(observations: Observations, method: Method, status: NDArray[np.int8]) -> PoseEstimate:
    """Return estimates of a pass that hold nothing but their status (B,), with one leading axis."""
    batch, targets = len(status), len(observations.seen)
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


def fill_result(
    result: PoseEstimate,
    index: NDArray[np.intp],
    observations: Observations,
    method: Method,
    solution: Solution,
    huber: float,
) -> None:
    """Write solutions to their positions, from the centre of the array to the object's origin."""
    result.status[index] = solution.status
    good = (solution.status != PoseStatus.MIRRORED) & np.isfinite(solution.covariance).all(axis=(0, 1))
    into = index[good]
    arm = np.einsum(
        "ijb,jb->ib", solution.rotation, np.broadcast_to(observations.centre, solution.position.shape)
    )
    covariance = _moved(solution.covariance, arm)
    residuals = residuals_of(observations, method, solution)
    weights = observations.seen.astype(np.float64)
    if huber:
        squares = squared_lengths(observations, method, solution.rotation, solution.position)
        weights *= np.minimum(1.0, huber / np.sqrt(np.maximum(squares, 1e-300)))
    result.position[into] = (solution.position - arm).T[good]
    result.rotation[into] = np.moveaxis(solution.rotation, -1, 0)[good]
    result.covariance[into] = np.moveaxis(covariance, -1, 0)[good]
    result.residuals[into] = residuals.transpose(2, 1, 0)[good]
    result.weights[into] = weights.T[good]
    result.chi2[into], result.dof[into] = solution.chi2[good], solution.dof[good]
    centre = np.broadcast_to(observations.centre[:, None], solution.other_position.shape)
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


def joined_results(parts: list[PoseEstimate], leading: tuple[int, ...], count: int) -> PoseEstimate:
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
