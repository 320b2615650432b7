"""The residuals of each method, and their weights from the variances of what was measured and surveyed."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import inverse
from scanner_sim.pose.adjustment import Problem
from scanner_sim.pose.collinearity import project
from scanner_sim.pose.observations import Observations
from scanner_sim.ranging.coordinates import coordinates

Array = NDArray[np.float64]

Method = Literal["uv", "xyz", "joint"]
PointWeights = Literal["covariance", "equal"]


def measured_points(observations: Observations) -> Array:
    """Return the measured points (x, y, z) [m] in the scanner frame by eq 3, shape (3, n, B).

    Those without a range stand on their beam at a range of no meaning; their weight must be zero.
    """
    theta, phi, r = observations.values
    r = np.where(observations.ranged, r, 1.0 + 2.0 * observations.axis_separation)
    return np.stack(coordinates(r, theta, phi, observations.axis_separation))


def problem_of(
    observations: Observations,
    method: Method,
    point_weights: PointWeights,
    *,
    huber: float = 0.0,
    pose: tuple[Array, Array] | None = None,
) -> Problem:
    """Return the residuals of a method.

    Parameters
    ----------
    observations
        B poses.
    method
        ``uv`` compares angles (eq 16), ``xyz`` points (eq 12), ``joint`` angles and ranges.
    point_weights
        Of ``xyz``: the inverse of each point's covariance, or all equal, which is eq 11 as printed.
    huber
        Standard deviations beyond which a target counts linearly; 0 for plain least squares.
    pose
        R (3, 3, B) and c (3, B) at which the errors of the surveyed points are carried over to what is measured: its
        covariance is then diag(σ²) + (G R) C_object (G R)ᵀ with G the gradients of the measured quantities. None
        leaves them out.
    """
    channels = 2 if method == "uv" else 3
    seen = np.broadcast_to(observations.seen, (channels, *observations.seen.shape)).copy()
    if method != "uv":
        seen[2] &= observations.ranged
    in_space = method == "xyz"
    whitening: Array
    if in_space:
        measured = measured_points(observations)
        _, gradients = project(measured, observations.axis_separation, with_range=True)
    else:
        measured, gradients = observations.values[:channels], None
    if in_space and point_weights == "equal":
        # Any common unit will do without a prior; that of the mean range keeps the cost near the number of residuals.
        squared = observations.variances[2].mean(axis=0)
        if observations.prior is not None:
            # A prior is weighed against what was measured: σ of the rest may be any number.
            measurable = observations.ranged.sum(axis=0)
            squared = (observations.variances[2] * observations.ranged).sum(axis=0) / np.maximum(
                measurable, 1
            )
        whitening = seen / np.sqrt(squared)
    elif not in_space and pose is None and _independent(observations, channels):
        whitening = seen / np.sqrt(observations.variances[:channels])
    else:
        if gradients is None and pose is not None:
            placed = np.einsum("ijb,jnb->inb", pose[0], observations.points) + pose[1][:, None]
            _, gradients = project(placed, observations.axis_separation, with_range=channels == 3)
        whitening = _inverse_root(_covariance(observations, channels, gradients, pose))
        whitening = whitening * seen
        if in_space and gradients is not None:
            whitening = np.einsum("cdnb,kdnb->cknb", whitening, gradients)
    return Problem(
        observations.points,
        measured,
        whitening,
        in_space,
        observations.axis_separation,
        huber,
        observations.prior,
        observations.centre,
    )


def point_covariances(observations: Observations, pose: tuple[Array, Array]) -> Array:
    """Return the covariances of measured less surveyed points [m²], shape (3, 3, n, B).

    J diag(σ_Θ², σ_φ², σ_R²) Jᵀ of eq 3, with the covariance of Θ and R where there is one, and R C_object Rᵀ.
    """
    _, gradients = project(measured_points(observations), observations.axis_separation, with_range=True)
    covariance = _covariance(
        observations, 3, gradients, pose if observations.object_variances is not None else None
    )
    back = inverse(np.moveaxis(gradients, (0, 1), (-1, -2)))  # ∂(x, y, z)/∂(Θ, φ, R)
    result: Array = np.einsum("nbij,jknb,nblk->ilnb", back, covariance, back)
    return result


def _independent(observations: Observations, channels: int) -> bool:
    """Whether the errors of Θ, φ and, of three channels, R are."""
    return observations.theta_phi is None and (channels == 2 or observations.theta_range is None)


def _covariance(
    observations: Observations, channels: int, gradients: Array | None, pose: tuple[Array, Array] | None
) -> Array:
    """Return the covariances of (Θ, φ[, R]), shape (c, c, n, B)."""
    covariance = np.zeros((channels, channels, *observations.seen.shape))
    index = np.arange(channels)
    covariance[index, index] = observations.variances[:channels]
    if channels == 3 and observations.theta_range is not None:
        covariance[0, 2] = covariance[2, 0] = observations.theta_range
    if observations.theta_phi is not None:
        covariance[0, 1] = covariance[1, 0] = observations.theta_phi
    if pose is not None and observations.object_variances is not None and gradients is not None:
        carried = np.einsum("icnb,ijb->cjnb", gradients, pose[0])
        covariance += np.einsum("cjnb,djnb->cdnb", carried * observations.object_variances, carried)
    return covariance


def _inverse_root(covariance: Array) -> Array:
    """Return W with WᵀW = C⁻¹, the inverse of the Cholesky factor, shape (c, c, n, B)."""
    size = len(covariance)
    lower, inverse = np.zeros_like(covariance), np.zeros_like(covariance)
    for i in range(size):
        for j in range(i + 1):
            rest = covariance[i, j] - np.sum(lower[i, :j] * lower[j, :j], axis=0)
            lower[i, j] = np.sqrt(rest) if i == j else rest / lower[j, j]
        inverse[i, i] = 1.0 / lower[i, i]
        for j in range(i):
            inverse[i, j] = -inverse[i, i] * np.sum(lower[i, j:i] * inverse[j:i, j], axis=0)
    return inverse
