"""What follows from the covariance of a pose: points of the object, error ellipsoids, one object seen from another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.arithmetic import applied, eigen, product
from scanner_sim.pose.transforms import cross_matrix

Array = NDArray[np.float64]


class UncertainPose(Protocol):
    """Poses with leading axes (...), and the covariance of (δt, δω): a ``PoseEstimate``, or a series of poses."""

    @property
    def position(self) -> Array:
        """Of the object's origin [m], shape (..., 3)."""
        ...

    @property
    def rotation(self) -> Array:
        """``scanner_from_object``, shape (..., 3, 3)."""
        ...

    @property
    def covariance(self) -> Array:
        """Of (δt, δω) along the scanner's axes, shape (..., 6, 6)."""
        ...


@dataclass(frozen=True)
class RelativePose:
    """Pose of an object b in the frame of an object a.

    Attributes
    ----------
    position, rotation
        Of b's origin [m], shape (..., 3), and ``a_from_b``, shape (..., 3, 3).
    covariance
        Of (δt, δω) along a's axes, shape (..., 6, 6).
    """

    position: Array
    rotation: Array
    covariance: Array


def point_on_object(pose: UncertainPose, point: ArrayLike) -> tuple[Array, Array]:
    """Return where a point of the object is, and its covariance.

    Parameters
    ----------
    pose
        Poses with leading axes (...).
    point
        Along the object's axes [m], shape (3,) or (..., 3).

    Returns
    -------
    tuple
        X = t + R p in the scanner frame [m], shape (..., 3), and J C Jᵀ [m²], shape (..., 3, 3), with
        J = [1, −[R p]×], since δX = δt + δω × R p.
    """
    arm = np.einsum("...ij,...j->...i", pose.rotation, np.asarray(point, dtype=np.float64))
    change = np.concatenate([np.broadcast_to(np.eye(3), (*arm.shape, 3)), -cross_matrix(arm)], axis=-1)
    covariance: Array = product(change, pose.covariance, np.swapaxes(change, -1, -2))
    return pose.position + arm, covariance


def error_ellipsoid(covariance: ArrayLike) -> tuple[Array, Array]:
    """Return the half-axes of the one-sigma ellipsoid of a point.

    Parameters
    ----------
    covariance
        Shape (..., 3, 3) [m²]; NaN gives NaN.

    Returns
    -------
    tuple
        Half lengths [m], the longest first, shape (..., 3), and their directions, the columns of (..., 3, 3). It holds
        the point with a probability of 19.9 %; 2.80 times as long 95 % (χ² of three degrees of freedom).
    """
    matrices = np.asarray(covariance, dtype=np.float64)
    known = np.asarray(np.isfinite(matrices).all(axis=(-2, -1)))[..., None, None]
    squares, axes = eigen(np.where(known, matrices, np.eye(3)))
    lengths = np.where(known[..., 0], np.sqrt(np.maximum(squares, 0.0)), np.nan)
    return lengths[..., ::-1], np.where(known, axes, np.nan)[..., ::-1]


def relative_pose(a: UncertainPose, b: UncertainPose, between: Array | None = None) -> RelativePose:
    """Return the pose of b in the frame of a, M_a⁻¹ M_b.

    Parameters
    ----------
    a, b
        Poses with leading axes that broadcast.
    between
        Covariance of the pose of a (rows) with that of b along the scanner's axes, shape (..., 6, 6); None for objects
        measured independently.

    Returns
    -------
    RelativePose
        t = R_aᵀ(t_b − t_a), R = R_aᵀ R_b. With d = t_b − t_a the changes are
        δt = R_aᵀ(δt_b − δt_a + d × δω_a) and δω = R_aᵀ(δω_b − δω_a), and the covariances of both add. An error common
        to both measurements that ``between`` does not know, as a drift of the mirrors, cancels in part.
    """
    back = np.swapaxes(a.rotation, -1, -2)
    apart = b.position - a.position
    shape = np.broadcast_shapes(back.shape[:-2], apart.shape[:-1])
    by_a, by_b = np.zeros((*shape, 6, 6)), np.zeros((*shape, 6, 6))
    by_b[..., :3, :3] = by_b[..., 3:, 3:] = back
    by_a[..., :3, :3] = by_a[..., 3:, 3:] = -back
    by_a[..., :3, 3:] = product(back, cross_matrix(apart))
    covariance: Array = product(by_a, a.covariance, np.swapaxes(by_a, -1, -2))
    covariance = covariance + product(by_b, b.covariance, np.swapaxes(by_b, -1, -2))
    if between is not None:
        shared = product(by_a, between, np.swapaxes(by_b, -1, -2))
        covariance = covariance + shared + np.swapaxes(shared, -1, -2)
    return RelativePose(applied(back, apart), product(back, b.rotation), covariance)
