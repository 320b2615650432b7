"""Resection by a camera: from the centres of dots in a frame to the pose of their object in the camera's frame.

A camera is the scanner with one centre of projection: directions of pixels have angles (Θ, φ) by the collinearity of
:mod:`scanner_sim.pose.collinearity` with D_g = 0, and the adjustment, its starts and its covariance are the scanner's.
Squared residuals are those in pixels to first order: a residual of 0.1 pixel differs by 1e-5 of itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.arithmetic import arctan2, cholesky, inverse, product
from scanner_sim.foundation.errors import InputError
from scanner_sim.optics.interior_orientation import PARAMETERS, InteriorOrientation
from scanner_sim.pose.dot_images import DotArray, dot_images
from scanner_sim.pose.estimate import Robust, estimate_pose
from scanner_sim.pose.inputs import PosePrior
from scanner_sim.pose.result import PoseEstimate
from scanner_sim.pose.transforms import rotation_from_vector, vector_from_rotation

Array = NDArray[np.float64]

_ROUNDS = 4
"""Estimates, each with the perspective of the one before: what is left falls by r²/z² a round."""


class Angles(NamedTuple):
    """Directions of pixels: Θ, φ [rad] (...), and their change with (u, v) [rad/pixel], shape (..., 2, 2)."""

    theta: Array
    phi: Array
    by_pixel: Array


def pixel_angles(camera: InteriorOrientation, pixels: ArrayLike) -> Angles:
    """Return the angles of pixels (..., 2), NaN where a pixel has no direction.

    With tangents a = x/z, b = y/z: φ = atan b, Θ = atan(a/√(1 + b²)).
    """
    tangents = camera.tangents_of(pixels)
    a, b = tangents[..., 0], tangents[..., 1]
    w = np.sqrt(1.0 + b * b)
    square = 1.0 + a * a + b * b
    by_tangent = np.zeros((*a.shape, 2, 2))
    by_tangent[..., 0, 0], by_tangent[..., 0, 1] = w / square, -a * b / (w * square)
    by_tangent[..., 1, 1] = 1.0 / (w * w)
    (p, q), (r, s) = np.moveaxis(camera.tangent_jacobian(tangents), (-2, -1), (0, 1))
    back = np.stack([np.stack([s, -q], axis=-1), np.stack([-r, p], axis=-1)], axis=-2)
    back = back / (p * s - q * r)[..., None, None]
    return Angles(arctan2(a, w), arctan2(b, np.ones_like(b)), product(by_tangent, back))


def estimate_camera_pose(
    camera: InteriorOrientation,
    dots: DotArray,
    centres: ArrayLike,
    covariance: ArrayLike,
    *,
    sigma_object: ArrayLike | None = None,
    calibration: ArrayLike | None = None,
    prior: PosePrior | None = None,
    robust: Robust | None = None,
) -> PoseEstimate:
    """Return the pose of an object from the centres of its dots in frames.

    Parameters
    ----------
    camera
        The interior orientation that is believed.
    dots
        The surveyed array.
    centres
        Centres (u, v) of the ellipses [pixel], shape (..., n, 2); NaN: not seen. They are taken to where the discs'
        centres are imaged by the perspective of the pose (:mod:`scanner_sim.pose.dot_images`).
    covariance
        Theirs [pixel²], shape (..., n, 2, 2).
    sigma_object, prior, robust
        As in :func:`~scanner_sim.pose.estimate.estimate_pose`; a prior is of the camera's frame.
    calibration
        Covariance of the camera's :data:`~scanner_sim.optics.interior_orientation.PARAMETERS`, shape (8, 8), zero where
        one is known: an error that all dots and frames share.

    Returns
    -------
    PoseEstimate
        ``camera_from_object``: position and rotation in the camera's frame, with residuals in (Θ, φ).

    Raises
    ------
    InputError
        As :func:`~scanner_sim.pose.estimate.estimate_pose`, and for covariances of another shape or that are none.
    """
    seen, spread = np.asarray(centres, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    if seen.shape[-2:] != (len(dots.points), 2) or spread.shape != (*seen.shape, 2):
        raise InputError(
            f"centres and covariance have the shapes {seen.shape} and {spread.shape}; "
            f"(..., {len(dots.points)}, 2) and (..., {len(dots.points)}, 2, 2) are wanted."
        )
    known = np.asarray(np.isfinite(seen).all(axis=-1) & np.isfinite(spread).all(axis=(-2, -1)))
    seen = np.where(known[..., None], seen, np.nan)
    spread = np.where(known[..., None, None], spread, np.eye(2))
    uu, uv, vv = spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]
    if not ((uu > 0.0) & (uu * vv > uv * uv)).all():
        raise InputError(
            "covariance is not positive definite for every centre that was seen.",
            remedy="Write NaN for dots that were not.",
        )
    root = None if calibration is None else _root(np.asarray(calibration, dtype=np.float64))
    shift = np.zeros_like(seen)
    for _ in range(_ROUNDS):
        angles = pixel_angles(camera, seen - shift)
        own = product(angles.by_pixel, spread, np.swapaxes(angles.by_pixel, -1, -2))
        found = estimate_pose(
            dots.points,
            angles.theta,
            angles.phi,
            sigma_theta=np.sqrt(own[..., 0, 0]),
            sigma_phi=np.sqrt(own[..., 1, 1]),
            covariance_theta_phi=own[..., 0, 1],
            axis_separation=0.0,
            method="uv",
            sigma_object=sigma_object,
            prior=prior,
            robust=robust,
            common=None if root is None else _shared(camera, angles, seen - shift, root),
        )
        images = dot_images(camera, dots, found.rotation, found.position)
        shift = np.nan_to_num(images.ellipse - images.centre)
    return found


def _shared(camera: InteriorOrientation, angles: Angles, pixels: Array, root: Array) -> Array:
    """Return what errors of the calibration do to (Θ, φ, R) of dots, shape (..., n, 3, k)."""
    directions = np.nan_to_num(camera.directions(pixels), nan=1.0)
    moved = product(np.nan_to_num(angles.by_pixel), camera.parameter_jacobian(directions), root)
    return np.concatenate([-moved, np.zeros_like(moved[..., :1, :])], axis=-2)


def _root(covariance: Array) -> Array:
    """Return a square root (8, k) of a covariance (8, 8), of the parameters that are not known."""
    if covariance.shape != (len(PARAMETERS),) * 2:
        raise InputError(f"calibration has the shape {covariance.shape}; (8, 8) is wanted.")
    free = np.flatnonzero(np.diagonal(covariance) > 0.0)
    root = np.zeros((len(PARAMETERS), max(len(free), 1)))
    root[free, : len(free)] = cholesky(covariance[np.ix_(free, free)])
    if not np.isfinite(root).all():
        raise InputError("calibration is not a covariance: it is not positive definite.")
    return root


def moved_to(
    mount: Array, position: Array, rotation: Array, covariance: Array, mount_covariance: Array | None = None
) -> tuple[Array, Array, Array]:
    """Return poses and covariances of the camera's frame in that of the scanner.

    Parameters
    ----------
    mount
        ``scanner_from_camera``, shape (4, 4).
    position, rotation, covariance
        Poses (..., 3), (..., 3, 3), (..., 6, 6).
    mount_covariance
        Of the mount's (δt, δω) along the scanner's axes, shape (6, 6): with t the object from the camera along the
        scanner's axes, δt' = δt_m + δω_m × t.
    """
    turn = mount[:3, :3]
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = turn
    arm = np.einsum("ij,...j->...i", turn, position)
    spread = product(both, covariance, both.T)
    if mount_covariance is not None:
        change = np.zeros((*arm.shape[:-1], 6, 6))
        change[..., :3, :3] = change[..., 3:, 3:] = np.eye(3)
        x, y, z = np.moveaxis(arm, -1, 0)
        change[..., 0, 4], change[..., 0, 5] = z, -y
        change[..., 1, 3], change[..., 1, 5] = -z, x
        change[..., 2, 3], change[..., 2, 4] = y, -x
        spread = spread + product(change, mount_covariance, np.swapaxes(change, -1, -2))
    return arm + mount[:3, 3], product(turn, rotation), spread


class Placed(NamedTuple):
    """Poses with nothing beside them."""

    position: Array
    rotation: Array
    covariance: Array


class Combined(NamedTuple):
    """One pose of two: position (..., 3), rotation (..., 3, 3), covariance (..., 6, 6), χ² of their difference.

    ``gain`` is the share K of the difference by which the first is moved, shape (..., 6, 6).
    """

    position: Array
    rotation: Array
    covariance: Array
    chi2: Array
    gain: Array


def combined_poses(one: PoseEstimate | Placed, other: PoseEstimate | Placed) -> Combined:
    """Return the poses that two independent estimates of the same moments make together.

    With d = (t₂ − t₁, log(R₂R₁ᵀ)) and K = C₁ (C₁ + C₂)⁻¹ the first is moved by K d; the covariance is C₁ − K C₁, and
    dᵀ(C₁ + C₂)⁻¹d is χ² with six degrees of freedom where both σ hold (Gauss and Markov; first order in d).
    """
    turned = vector_from_rotation(product(other.rotation, np.swapaxes(one.rotation, -1, -2)))
    apart = np.concatenate([other.position - one.position, turned], axis=-1)
    between = inverse(one.covariance + other.covariance)
    gain = product(one.covariance, between)
    step = np.einsum("...ij,...j->...i", gain, apart)
    covariance = one.covariance - product(gain, one.covariance)
    return Combined(
        one.position + step[..., :3],
        product(rotation_from_vector(step[..., 3:]), one.rotation),
        0.5 * (covariance + np.swapaxes(covariance, -1, -2)),
        np.einsum("...i,...ij,...j->...", apart, between, apart),
        gain,
    )
