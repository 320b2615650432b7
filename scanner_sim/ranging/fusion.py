"""Fusion: ranges by triangulation and by time of flight combined by their covariance, with a check that they agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from scanner_sim.foundation.arithmetic import tan
from scanner_sim.foundation.status import Status
from scanner_sim.ranging.ranges import Deflections, Geometry, Ranges, ranges_with_points, with_status
from scanner_sim.ranging.time_of_flight import delay_from_range, echo_range_by_theta

Array = NDArray[np.float64]

CHANCE = 1e-4
"""Probability that two right ranges are taken for inconsistent."""


@dataclass(frozen=True)
class Fused:
    """Combined ranges, arrays of shape (n,).

    ``range`` and its ``sigma`` [m], NaN wherever ``status`` is not 0; ``weight`` share of time of flight in the range,
    0 to 1, NaN likewise; ``triangulation`` and ``time_of_flight`` the status of either after the check.
    """

    range: Array
    sigma: Array
    weight: Array
    status: NDArray[np.uint32]
    triangulation: NDArray[np.uint32]
    time_of_flight: NDArray[np.uint32]


def fuse(
    triangulation: tuple[Array, Array, NDArray[np.uint32]],
    time_of_flight: tuple[Array, Array, NDArray[np.uint32]],
    covariance: ArrayLike = 0.0,
    chance: float = CHANCE,
) -> Fused:
    """Combine two ranges of each voxel.

    Where both are valid and differ by no more than z √(σ₁² + σ₂² − 2c), the range is (1 − w) R₁ + w R₂ with the share w
    of :func:`share_of_pulses`. Where they differ by more, which happens by chance with the probability ``chance``, one
    of them is wrong: the rule is that the one with the larger σ is refused as ``INCONSISTENT`` and the other stands
    alone. Where one is valid it stands alone; where none is, the status is that of the triangulation.

    Parameters
    ----------
    triangulation, time_of_flight
        Range [m], its σ [m] and status, each of shape (n,).
    covariance
        c of both [m²], shape (n,) (:func:`range_covariance`); 0 where they are independent.
    chance
        Probability that two right ranges are taken for inconsistent; z is the normal quantile of it, two-sided.
    """
    (r1, s1, status1), (r2, s2, status2) = triangulation, time_of_flight
    first, second = status1 == Status.VALID, status2 == Status.VALID
    limit = float(-ndtri(0.5 * chance))
    shared = np.where(first & second, covariance, 0.0)
    with np.errstate(invalid="ignore"):
        spread = np.sqrt(np.maximum(s1 * s1 + s2 * s2 - 2.0 * shared, 0.0))
        apart = first & second & (np.abs(r1 - r2) > limit * spread)
        refuse1, refuse2 = apart & (s1 > s2), apart & ~(s1 > s2)
    after1 = np.where(refuse1, np.uint32(Status.INCONSISTENT), status1).astype(np.uint32)
    after2 = np.where(refuse2, np.uint32(Status.INCONSISTENT), status2).astype(np.uint32)
    use1, use2 = first & ~refuse1, second & ~refuse2
    weight = np.nan_to_num(share_of_pulses(s1, s2, use1, use2, shared))
    with np.errstate(invalid="ignore"):
        mixed = np.where(use1, (1.0 - weight) * r1, 0.0) + np.where(use2, weight * r2, 0.0)
        variance = np.where(use1, np.square((1.0 - weight) * s1), 0.0)
        variance += np.where(use2, np.square(weight * s2), 0.0) + 2.0 * weight * (1.0 - weight) * shared
    none = ~use1 & ~use2
    status = np.where(none, status1, np.uint32(Status.VALID)).astype(np.uint32)
    mixed[none] = variance[none] = weight[none] = np.nan
    return Fused(mixed, np.sqrt(variance), weight, status, after1, after2)


def fuse_points(
    triangulated: Ranges, echo: Ranges, deflections: Deflections, geometry: Geometry
) -> tuple[Ranges, Ranges, Ranges]:
    """Combine both ways of ranging, as :func:`fuse` does, with the point's covariance.

    Parameters
    ----------
    triangulated, echo
        Ranges of n shots by triangulation and by time of flight, both along the same measured deflections.
    deflections, geometry
        These deflections, and the triangulation's calibration.

    Returns
    -------
    tuple of Ranges
        Fused, and both again with ``INCONSISTENT`` where one was refused. With the share w of time of flight the range
        moves with Θ by (1 − w) ∂R/∂Θ of the triangulation and w times that of time of flight; σ is that of the errors
        of the peak, of the delay, and of Θ; the last is in both.
    """
    theta, phi = deflections.theta, deflections.phi
    # Two rangefinders err differently by the calibration: what compares and weighs them has its errors, too.
    common1 = geometry.range_in_common("triangulation", triangulated.range, theta, phi)
    common2 = geometry.range_in_common(geometry.pulse_by, echo.range, theta, phi)
    sigma1 = np.hypot(triangulated.sigma, np.linalg.norm(common1, axis=-1))
    sigma2 = np.hypot(echo.sigma, np.linalg.norm(common2, axis=-1))
    r1, r2 = np.nan_to_num(triangulated.range), np.nan_to_num(echo.range, nan=1.0)
    by_theta1, by_theta2 = slopes = slopes_by_theta(r1, r2, theta, geometry)
    both = fuse(
        (triangulated.range, sigma1, triangulated.status),
        (echo.range, sigma2, echo.status),
        range_covariance(slopes, deflections.sigma_theta, (common1, common2)),
    )
    share = both.weight
    by_theta = (1.0 - share) * by_theta1 + share * by_theta2
    alone = np.hypot(
        (1.0 - share) * _at_fixed_theta(triangulated, by_theta1, deflections),
        share * _at_fixed_theta(echo, by_theta2, deflections),
    )
    sigma = np.hypot(alone, by_theta * deflections.sigma_theta)
    fused = ranges_with_points(both.range, sigma, both.status, alone, by_theta, deflections, geometry)
    return fused, with_status(triangulated, both.triangulation), with_status(echo, both.time_of_flight)


def _at_fixed_theta(ranges: Ranges, by_theta: Array, deflections: Deflections) -> Array:
    """Return σ of ranges without what the error of Θ makes of them [m]; 0 where there is no range."""
    whole, part = np.nan_to_num(ranges.sigma), by_theta * deflections.sigma_theta
    return np.asarray(np.sqrt(np.maximum(np.square(whole) - np.square(part), 0.0)))


def slopes_by_theta(r1: Array, r2: Array, theta: Array, geometry: Geometry) -> tuple[Array, Array]:
    """Return ∂R/∂Θ [m] of ranges by triangulation and by time of flight, each (n,).

    The first is −(R − d sinΘ) tanΘ + d cosΘ (eq 1), the second that of
    :func:`~scanner_sim.ranging.time_of_flight.echo_range_by_theta`.

    Parameters
    ----------
    r1, r2, theta
        Ranges by triangulation and by time of flight [m], and measured Θ [rad], each (n,).
    geometry
        The triangulation's calibration, and where the photodiode looks.
    """
    d = geometry.baseline
    aside = d if geometry.pulse_by == "offset" else 0.0
    by_line = d * np.cos(theta) - (r1 - d * np.sin(theta)) * tan(theta)
    return by_line, echo_range_by_theta(r2, delay_from_range(r2, theta, aside), theta, aside)


def range_covariance(
    slopes: tuple[Array, Array], sigma_theta: Array, common: tuple[Array, Array] | None = None
) -> Array:
    """Return the covariance of ranges by triangulation and by time of flight [m²], shape (n,).

    Both have the errors of Θ and of the calibration: ∂R₁/∂Θ ∂R₂/∂Θ σ_Θ² + A₁·A₂.

    Parameters
    ----------
    slopes
        ∂R/∂Θ of both [m], each (n,) (:func:`slopes_by_theta`).
    sigma_theta
        σ of the reading of Θ [rad], shape (n,).
    common
        What k independent errors of the calibration, of unit variance each, make of both [m], each (n, k); None leaves
        them out.
    """
    found = slopes[0] * slopes[1] * np.square(sigma_theta)
    return found if common is None else found + np.sum(common[0] * common[1], axis=-1)


def share_of_pulses(
    sigma1: Array,
    sigma2: Array,
    valid1: NDArray[np.bool_],
    valid2: NDArray[np.bool_],
    covariance: ArrayLike = 0.0,
) -> Array:
    """Return the share of time of flight in combined ranges, shape (n,).

    (σ₁² − c)/(σ₁² + σ₂² − 2c) where both are valid, that of the best linear estimate (Aitken, *Proc. Roy. Soc.
    Edinburgh* 55, 1935), but within 0 and 1: where c is above one of the variances that range stands alone, and nothing
    lies beyond both. NaN where neither is valid, one half where both are exact.

    Parameters
    ----------
    sigma1, sigma2
        σ of triangulation and of time of flight [m], shape (n,).
    valid1, valid2
        Whether they are valid, shape (n,).
    covariance
        c of both [m²], shape (n,).
    """
    v1, v2 = np.where(valid1, sigma1, np.inf) ** 2, np.where(valid2, sigma2, np.inf) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        apart = v1 + v2 - 2.0 * np.asarray(covariance)
        both = np.where(apart > 0.0, np.clip((v1 - covariance) / apart, 0.0, 1.0), 0.5)
    return np.where(valid1 & valid2, both, np.where(valid1, 0.0, np.where(valid2, 1.0, np.nan)))


def crossing_distance(
    sigma_time_of_flight: ArrayLike, focal_length: float, baseline: float, sigma_position: float
) -> Array:
    """Return the range [m] at which both ways are equally precise, R = √(σ_TOF f d/Δp).

    Nearer, triangulation with σ = R² Δp/(f d) (eq 4) is the better one.

    Parameters
    ----------
    sigma_time_of_flight
        σ of the time of flight [m], constant over the range.
    focal_length, baseline
        f and d [m].
    sigma_position
        Δp, standard deviation of the position on the sensor [m].
    """
    scale = focal_length * baseline / sigma_position
    return np.sqrt(np.asarray(sigma_time_of_flight, dtype=np.float64) * scale)
