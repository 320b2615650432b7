"""The quick way for one pose: from plain arguments to an estimate, or to nothing where the general way is needed."""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from scanner_sim.pose.alone import MOST_TARGETS, LoneCase, LoneFit, inverse_of, lone_fits, lone_status
from scanner_sim.pose.inputs import DUPLICATE
from scanner_sim.pose.result import Alternatives, PoseEstimate
from scanner_sim.pose.solution import APART, DOUBTFUL, MISFIT, SAME
from scanner_sim.pose.starts import ALTERNATIVES

Array = NDArray[np.float64]


def lone_estimate(
    object_points: Any,
    theta: Any,
    phi: Any,
    ranges: Any,
    *,
    sigma_theta: Any,
    sigma_phi: Any,
    sigma_range: Any,
    axis_separation: float,
) -> PoseEstimate | None:
    """Return the pose of a planar array from the angles of all its targets, where all is ordinary.

    Parameters
    ----------
    object_points, theta, phi, ranges, sigma_theta, sigma_phi, sigma_range, axis_separation
        As given to :func:`scanner_sim.pose.estimate.estimate_pose`. Ranges are not used, but must be good.

    Returns
    -------
    PoseEstimate or None
        None for a batch, for names, for anything hidden, wrong or doubtful: the general way says why.
    """
    points = _floats(object_points)
    if points is None or points.ndim != 2 or points.shape[1] != 3 or not 4 <= len(points) <= MOST_TARGETS:
        return None
    count = len(points)
    across, down = _column(theta, count), _column(phi, count)
    sigma_across, sigma_down = (_column(sigma, count, alike=True) for sigma in (sigma_theta, sigma_phi))
    distance = _column(ranges, count) if ranges is not None else [1.0]
    sigma_distance = _column(sigma_range, count, alike=True) if sigma_range is not None else [1.0]
    if across is None or down is None or sigma_across is None or sigma_down is None:
        return None
    if distance is None or sigma_distance is None:
        return None
    if min(*sigma_across, *sigma_down, *distance, *sigma_distance) <= 0.0:
        return None
    if not (isfinite(axis_separation) and axis_separation >= 0.0) or not np.isfinite(points).all():
        return None
    centre = points.mean(axis=0)
    about = points - centre
    rows = about.tolist()
    if not _distinct(rows):
        return None
    case = LoneCase(
        points=rows,
        theta=across,
        phi=down,
        by_theta=[1.0 / sigma for sigma in sigma_across],
        by_phi=[1.0 / sigma for sigma in sigma_down],
        axis_separation=float(axis_separation),
    )
    try:
        fits = lone_fits(case)
    except (
        ZeroDivisionError,
        OverflowError,
        ValueError,
    ):  # a point on an axis, or a target's beam at a right angle
        return None
    if fits is None or not float(chdtrc(2 * count - 6, fits[0].cost)) >= MISFIT:
        return None
    covariance = inverse_of(fits[0].normal)
    return None if covariance is None else _estimate(case, centre, *fits, covariance)


def _estimate(
    case: LoneCase, centre: Array, best: LoneFit, other: LoneFit, covariance: Array
) -> PoseEstimate:
    """Return a pose for the object's origin, X_origin = c − R r̄, so that δt = δc + (R r̄) × δω."""
    count = len(case.points)
    x, y, z = (best.rotation @ centre).tolist()
    change = np.eye(6)
    change[:3, 3:] = ((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))
    status, new = lone_status(best, other, SAME, DOUBTFUL, APART)
    alternatives = Alternatives(
        np.full((ALTERNATIVES, 3), np.nan),
        np.full((ALTERNATIVES, 3, 3), np.nan),
        np.full(ALTERNATIVES, np.nan),
    )
    if new:
        alternatives.position[0] = other.position - other.rotation @ centre
        alternatives.rotation[0], alternatives.chi2[0] = other.rotation, other.cost
    return PoseEstimate(
        position=best.position - (x, y, z),
        rotation=best.rotation,
        covariance=change @ covariance @ change.T,
        residuals=best.rest.reshape(count, 2) / np.array([case.by_theta, case.by_phi]).T,
        weights=np.ones(count),
        chi2=np.array(best.cost),
        dof=np.array(2 * count - 6),
        alternatives=alternatives,
        status=np.array(status, dtype=np.int8),
    )


def _floats(values: Any) -> Array | None:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        return None


def _column(values: Any, count: int, *, alike: bool = False) -> list[float] | None:
    """Return one finite number for each target; ``alike`` lets one stand for all."""
    if alike and isinstance(values, float):
        return [values] * count if isfinite(values) else None
    column = _floats(values)
    if column is None or column.shape != (count,):
        if column is None or column.ndim or not alike:
            return None
        column = np.full(count, column)
    numbers: list[float] = column.tolist()
    return numbers if all(map(isfinite, numbers)) else None


def _distinct(rows: list[list[float]]) -> bool:
    """Return whether no two targets stand on the same place."""
    least = DUPLICATE * max(max(column) - min(column) for column in zip(*rows, strict=True))
    return all(
        max(abs(a - d), abs(b - e), abs(c - f)) > least
        for number, (a, b, c) in enumerate(rows)
        for d, e, f in rows[:number]
    )
