"""The door: arrays or mappings by name become observations, or a clear error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.arithmetic import cholesky, inverse, product
from scanner_sim.foundation.errors import InputError
from scanner_sim.pose.observations import Observations, Prior

Array = NDArray[np.float64]
Values = ArrayLike | Mapping[str, ArrayLike]

DUPLICATE = 1e-9
"""Distance of two targets, over the size of the array, below which they are one."""


@dataclass(frozen=True)
class PosePrior:
    """A pose known before the measurement: an observation like any other.

    Attributes
    ----------
    position, rotation
        Of the object's origin [m], shape (..., 3), and ``scanner_from_object``, shape (..., 3, 3).
    covariance
        Of (δt, δω) along the scanner's axes, shape (..., 6, 6): see :mod:`scanner_sim.pose.transforms`.
    """

    position: ArrayLike
    rotation: ArrayLike
    covariance: ArrayLike


def observations_from(
    object_points: Values,
    theta: Values,
    phi: Values,
    ranges: Values | None,
    *,
    sigma_theta: ArrayLike,
    sigma_phi: ArrayLike,
    sigma_range: ArrayLike | None,
    covariance_theta_range: ArrayLike | None,
    covariance_theta_phi: ArrayLike | None = None,
    sigma_object: ArrayLike | None,
    axis_separation: float,
    prior: PosePrior | None,
) -> tuple[Observations, tuple[int, ...]]:
    """Return the observations and the leading axes of the batch.

    See :func:`~scanner_sim.pose.estimate.estimate_pose` for the arguments.

    Raises
    ------
    InputError
        Names that do not match, shapes that do not fit, coordinates that are not finite or not distinct, standard
        deviations that are not positive.
    """
    object_points, theta, phi, ranges = _by_name(object_points, theta, phi, ranges)
    points = _numbers("object_points", object_points)
    if points.ndim < 2 or points.shape[-1] != 3:
        raise InputError(f"object_points has the shape {points.shape}; (..., targets, 3) is wanted.")
    if not points.shape[-2]:
        raise InputError("object_points holds no target.", remedy="Give the surveyed ones.")
    if not np.isfinite(points).all():
        raise InputError(
            "object_points holds coordinates that are not finite.", remedy="Leave such targets out."
        )
    count = points.shape[-2]
    angles = {"theta": _numbers("theta", theta), "phi": _numbers("phi", phi)}
    if ranges is not None:
        angles["ranges"] = _numbers("ranges", ranges)
    for name, values in angles.items():
        if values.ndim < 1 or values.shape[-1] != count:
            raise InputError(
                f"{name} has the shape {values.shape}, but there are {count} targets.",
                remedy="Its last axis counts the targets; NaN stands for one that was not measured.",
            )
        if np.isinf(values).any():
            raise InputError(f"{name} is infinite.", remedy="NaN stands for a target that was not measured.")
    if ranges is not None and (angles["ranges"] <= 0.0).any():
        raise InputError("ranges must be positive.")
    if not (np.isfinite(axis_separation) and axis_separation >= 0.0):
        raise InputError(f"axis_separation is {axis_separation}; a length of zero or more is wanted.")
    _distinct(points)
    prior_arrays = () if prior is None else _prior_arrays(prior)
    try:
        leading = np.broadcast_shapes(
            points.shape[:-2], *(a.shape[:-1] for a in angles.values()), *(a.shape[:-2] for a in prior_arrays)
        )
    except ValueError as error:
        raise InputError("The leading axes of the arguments do not fit together.") from error

    values = np.zeros((3, *leading, count))
    for channel, measured in enumerate(angles.values()):
        values[channel] = measured
    if ranges is None:
        values[2] = np.nan
    flat = np.ascontiguousarray(np.moveaxis(values.reshape(3, -1, count), 1, -1))
    known = np.isfinite(flat)
    seen = known[0] & known[1]
    sigmas = np.stack(
        [
            _deviation("sigma_theta", sigma_theta, leading, count, seen),
            _deviation("sigma_phi", sigma_phi, leading, count, seen),
            _deviation(
                "sigma_range", 1.0 if sigma_range is None else sigma_range, leading, count, seen & known[2]
            ),
        ]
    )
    object_sigma = None if sigma_object is None else _object_deviation(sigma_object, count)
    about = points.reshape(-1, count, 3).transpose(2, 1, 0)
    if about.shape[-1] > 1:
        about = np.broadcast_to(points, (*leading, count, 3)).reshape(-1, count, 3).transpose(2, 1, 0)
    centre = about.mean(axis=1)
    return (
        Observations(
            points=np.ascontiguousarray(about - centre[:, None]),
            centre=centre,
            values=np.where(known, flat, 0.0),
            seen=seen,
            ranged=seen & known[2],
            variances=_common(sigmas**2),
            theta_range=_cross("theta_range", covariance_theta_range, leading, sigmas[0] * sigmas[2]),
            theta_phi=_cross("theta_phi", covariance_theta_phi, leading, sigmas[0] * sigmas[1]),
            object_variances=None if object_sigma is None else (object_sigma**2)[:, :, None],
            axis_separation=float(axis_separation),
            prior=None if prior is None else _prior(prior_arrays, leading),
        ),
        leading,
    )


def _by_name(*given: Any) -> list[Any]:
    """Put mappings from names into the order of the first; all must have the same names."""
    maps = [isinstance(value, Mapping) for value in given if value is not None]
    if not any(maps):
        return list(given)
    if not all(maps):
        raise InputError(
            "Some arguments go by the names of targets and some do not.", remedy="Name all, or none."
        )
    names = list(given[0])
    for label, values in zip(("theta", "phi", "ranges"), given[1:], strict=True):
        if values is not None and set(values) != set(names):
            missing, unknown = sorted(set(names) - set(values)), sorted(set(values) - set(names))
            raise InputError(
                f"The targets of {label} are not those of object_points:"
                + (f" {', '.join(missing)} missing" if missing else "")
                + (" and" if missing and unknown else "")
                + (f" {', '.join(unknown)} unknown" if unknown else "")
                + ".",
                remedy="Give NaN for a target that was not measured.",
            )
    labels, axes = ("object_points", "theta", "phi", "ranges"), (-2, -1, -1, -1)
    return [
        None if values is None else _side_by_side(label, [values[name] for name in names], axis)
        for label, values, axis in zip(labels, given, axes, strict=True)
    ]


def _side_by_side(label: str, values: list[ArrayLike], axis: int) -> Array:
    """Return what was given for each target as one array."""
    numbers = [_numbers(label, value) for value in values]
    shapes = dict.fromkeys(str(one.shape) for one in numbers)
    if len(shapes) > 1:
        raise InputError(
            f"The targets of {label} have the shapes {', '.join(shapes)}; one for all is wanted."
        )
    return np.stack(numbers, axis=axis)


def _numbers(name: str, values: ArrayLike | Mapping[str, ArrayLike]) -> Array:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is not an array of numbers.") from error


def _distinct(points: Array) -> None:
    """Raise where two targets of an object stand on the same position."""
    flat = points.reshape(-1, *points.shape[-2:])
    size = np.ptp(flat, axis=1).max(axis=1)
    for step in range(1, flat.shape[1]):
        apart = np.abs(flat[:, step:] - flat[:, :-step]).max(axis=2)
        if (apart <= DUPLICATE * size[:, None]).any():
            first = int(np.argwhere(apart <= DUPLICATE * size[:, None])[0, 1])
            raise InputError(
                f"Targets {first} and {first + step} of object_points stand on the same place.",
                remedy="Give each target once.",
            )


def _deviation(
    name: str, sigma: ArrayLike, leading: tuple[int, ...], count: int, wanted: NDArray[np.bool_]
) -> Array:
    """Return standard deviations as (n, B) or (n, 1); where nothing was measured 1 stands for any number."""
    values = _numbers(name, sigma)
    try:
        if values.ndim <= 1:
            flat = np.broadcast_to(values, (count,))[:, None]
        else:
            flat = np.broadcast_to(values, (*leading, count)).reshape(-1, count).T
    except ValueError as error:
        raise InputError(
            f"{name} has the shape {values.shape}; one of {(*leading, count)} is wanted."
        ) from error
    good = np.isfinite(flat) & (flat > 0.0)
    if (~good & wanted).any():
        raise InputError(f"{name} must be positive and finite for every target that was measured.")
    spread = np.broadcast_to(np.where(good, flat, 1.0), wanted.shape if flat.shape[1] > 1 else flat.shape)
    return np.broadcast_to(spread, wanted.shape)


def _common(values: Array) -> Array:
    """Return (c, n, B) as (c, n, 1) where all poses have the same, so that it is computed with once."""
    first = values[..., :1]
    return np.ascontiguousarray(first if (values == first).all() else values)


def _object_deviation(sigma: ArrayLike, count: int) -> Array:
    values = _numbers("sigma_object", sigma)
    if values.ndim == 1 and values.shape == (count,):
        values = values[:, None]
    try:
        spread = np.broadcast_to(values, (count, 3)).T
    except ValueError as error:
        raise InputError(
            f"sigma_object has the shape {values.shape}; (), ({count},) or ({count}, 3) is wanted."
        ) from error
    if not (np.isfinite(spread) & (spread >= 0.0)).all():
        raise InputError("sigma_object must be zero or more, and finite.")
    return spread


def _cross(name: str, given: ArrayLike | None, leading: tuple[int, ...], most: Array) -> Array | None:
    """Return covariances of two quantities as (n, B), each less than the product ``most`` of their deviations."""
    if given is None:
        return None
    values, count = _numbers(f"covariance_{name}", given), len(most)
    try:
        flat = np.broadcast_to(values, (*leading, count)).reshape(-1, count).T
    except ValueError as error:
        raise InputError(f"covariance_{name} has the shape {values.shape}, which does not fit.") from error
    flat = np.nan_to_num(flat)
    if (np.abs(flat) >= most).any():
        one, other = name.split("_")
        raise InputError(f"covariance_{name} must be less than sigma_{one} times sigma_{other}.")
    return np.ascontiguousarray(flat)


def _prior_arrays(prior: PosePrior) -> tuple[Array, Array, Array]:
    """Return position (..., 3, 1), rotation (..., 3, 3) and covariance (..., 6, 6), checked."""
    position, rotation = (
        _numbers("prior.position", prior.position),
        _numbers("prior.rotation", prior.rotation),
    )
    covariance = _numbers("prior.covariance", prior.covariance)
    if position.shape[-1:] != (3,) or rotation.shape[-2:] != (3, 3) or covariance.shape[-2:] != (6, 6):
        raise InputError(
            "A prior needs a position (..., 3), a rotation (..., 3, 3) and a covariance (..., 6, 6)."
        )
    if not all(np.isfinite(values).all() for values in (position, rotation, covariance)):
        raise InputError("The prior holds numbers that are not finite.")
    apart = product(rotation, np.swapaxes(rotation, -1, -2)) - np.eye(3)
    if np.abs(apart).max() > 1e-6 or (np.linalg.det(rotation) < 0.0).any():
        raise InputError(
            "prior.rotation is not a rotation.", remedy="Its columns are right-handed unit vectors."
        )
    return position[..., None], rotation, covariance


def _prior(arrays: tuple[Array, ...], leading: tuple[int, ...]) -> Prior:
    position, rotation, covariance = (
        np.broadcast_to(values, (*leading, *values.shape[-2:])).reshape(-1, *values.shape[-2:])
        for values in arrays
    )
    root = inverse(cholesky(covariance))
    if not np.isfinite(root).all():
        raise InputError("prior.covariance is not positive definite.")
    return Prior(*(np.ascontiguousarray(np.moveaxis(v, 0, -1)) for v in (rotation, position[..., 0], root)))
