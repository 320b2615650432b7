"""What errors that all targets share do to a pose: they are carried through the estimate, and no weight knows them.

The estimate stays what it is; its covariance is that of an estimate with *considered* parameters (Bierman,
*Factorization Methods for Discrete Sequential Estimation*, 1977, ch. VIII): C + B Bᵀ, with B = C Σ Jᵢᵀ Wᵢ Kᵢ, the
targets' derivatives J by the pose, weights W of the estimate, and K what k errors of unit variance do to each target.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import inverse, product
from scanner_sim.foundation.errors import InputError
from scanner_sim.pose.collinearity import project
from scanner_sim.pose.inputs import Values
from scanner_sim.pose.observations import Observations
from scanner_sim.pose.result import PoseEstimate
from scanner_sim.pose.weights import Method

Array = NDArray[np.float64]


def common_errors(common: Values, object_points: Values, leading: tuple[int, ...]) -> Array:
    """Return what common errors do to the targets of every pose, shape (B, n, 3, k), checked at the door.

    Raises
    ------
    InputError
        Names or shapes that do not fit, and numbers that are not finite.
    """
    names = list(object_points) if isinstance(object_points, Mapping) else None
    if isinstance(common, Mapping) != (names is not None) or (
        names is not None and isinstance(common, Mapping) and set(common) != set(names)
    ):
        raise InputError(
            "common and object_points name other targets.", remedy="Give both by the same names."
        )
    try:
        if isinstance(common, Mapping):
            parts = [np.asarray(common[name], dtype=np.float64) for name in names or ()]
            given = np.stack(np.broadcast_arrays(*parts), axis=-3)
        else:
            given = np.asarray(common, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(
            "common is not an array of numbers.", remedy="Give one of the shape (3, k) for each target."
        ) from None
    count = len(names) if names is not None else np.asarray(object_points).shape[-2]
    if given.ndim < 3 or given.shape[-3:-1] != (count, 3):
        raise InputError(
            f"common has the shape {given.shape}; (..., {count}, 3, k) is wanted.",
            remedy="For each target give what k errors of unit variance do to Θ, φ and R.",
        )
    if not np.isfinite(given).all():
        raise InputError(
            "common holds numbers that are not finite.", remedy="Write 0 for what has no part in them."
        )
    try:
        every = np.broadcast_to(given, (*leading, *given.shape[-3:]))
    except ValueError:
        raise InputError("the leading axes of common do not fit the measurements'.") from None
    return np.ascontiguousarray(every.reshape(math.prod(leading), *given.shape[-3:]))


def with_common_errors(
    found: PoseEstimate, observations: Observations, method: Method, common: Array
) -> PoseEstimate:
    """Return estimates whose covariance holds the errors that their targets share.

    Parameters
    ----------
    found, observations, method
        The estimates, and what they were made of.
    common
        From :func:`common_errors`.
    """
    rotation = found.rotation.reshape(-1, 3, 3)
    points = np.moveaxis(observations.points + observations.centre[:, None], 0, -1)
    arm = np.einsum("bij,nbj->bni", rotation, np.broadcast_to(points, (*points.shape[:1], len(rotation), 3)))
    placed = np.moveaxis(arm + found.position.reshape(-1, 1, 3), -1, 0)
    _, gradients = project(placed, observations.axis_separation, with_range=True)
    by_shift = np.moveaxis(gradients, (0, 1), (-1, -2))
    rows = np.concatenate([by_shift, np.cross(arm[:, :, None], by_shift)], axis=-1)
    counted = found.weights.reshape(-1, found.weights.shape[-1])
    known = (counted > 0.0) & np.isfinite(rows).all(axis=(2, 3))
    rows = np.where(known[..., None, None], rows, 0.0)
    weight = counted[..., None, None] * _weights(observations, method, by_shift, rotation, known)
    moved = product(np.swapaxes(rows, -1, -2), weight, common).sum(axis=1)
    spread = found.covariance.reshape(-1, 6, 6)
    by_common = product(np.nan_to_num(spread), moved)
    total = spread + product(by_common, np.swapaxes(by_common, -1, -2))
    return replace(found, covariance=total.reshape(found.covariance.shape))


def _weights(
    observations: Observations, method: Method, by_shift: Array, rotation: Array, known: NDArray[np.bool_]
) -> Array:
    """Return the weights W of (Θ, φ, R) of every target, shape (B, n, 3, 3); 0 for what was not measured."""
    shape = (*known.shape, 3, 3)
    covariance = np.zeros(shape)
    variances = np.broadcast_to(observations.variances, (3, *known.T.shape))
    for channel in range(3):
        covariance[..., channel, channel] = variances[channel].T
    if observations.theta_range is not None:
        covariance[..., 0, 2] = covariance[..., 2, 0] = np.broadcast_to(
            observations.theta_range, known.T.shape
        ).T
    if observations.theta_phi is not None:
        covariance[..., 0, 1] = covariance[..., 1, 0] = np.broadcast_to(
            observations.theta_phi, known.T.shape
        ).T
    if observations.object_variances is not None:
        carried = product(np.where(known[..., None, None], by_shift, 0.0), rotation[:, None])
        survey = np.moveaxis(np.broadcast_to(observations.object_variances, (3, *known.T.shape)), 0, -1)
        survey = np.swapaxes(survey, 0, 1)[..., None, :]
        covariance += product(carried * survey, np.swapaxes(carried, -1, -2))
    ranged = (observations.ranged & (method != "uv")).T
    angles = inverse(np.where(known[..., None, None], covariance[..., :2, :2], np.eye(2)))
    alone = np.zeros(shape)
    alone[..., :2, :2] = angles
    whole = inverse(np.where((known & ranged)[..., None, None], covariance, np.eye(3)))
    found = np.where(ranged[..., None, None], whole, alone)
    return np.where(known[..., None, None], found, 0.0)
