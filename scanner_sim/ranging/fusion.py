"""Fusion: ranges by triangulation and by time of flight combined by their σ, with a check that they agree."""

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

    ``range`` and its ``sigma`` where both are independent [m], NaN wherever ``status`` is not 0; ``weight`` share of
    time of flight in the range, 0 to 1, NaN likewise; ``triangulation`` and ``time_of_flight`` the status of either
    after the check.
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
    chance: float = CHANCE,
) -> Fused:
    """Combine two independent ranges of each voxel.

    Where both are valid and differ by no more than z √(σ₁² + σ₂²), the range is the mean weighted by 1/σ² and its
    variance 1/(1/σ₁² + 1/σ₂²), the best linear estimate (Aitken, *Proc. Roy. Soc. Edinburgh* 55, 1935). Where they
    differ by more, which happens by chance with the probability ``chance``, one of them is wrong: the rule is that the
    one with the larger σ is refused as ``INCONSISTENT`` and the other stands alone. Where one is valid it stands alone;
    where none is, the status is that of the triangulation.

    Parameters
    ----------
    triangulation, time_of_flight
        Range [m], its σ [m] and status, each of shape (n,).
    chance
        Probability that two right ranges are taken for inconsistent; z is the normal quantile of it, two-sided.
    """
    (r1, s1, status1), (r2, s2, status2) = triangulation, time_of_flight
    first, second = status1 == Status.VALID, status2 == Status.VALID
    limit = float(-ndtri(0.5 * chance))
    both = first & second
    with np.errstate(invalid="ignore"):
        apart = both & (np.abs(r1 - r2) > limit * np.hypot(s1, s2))
        refuse1, refuse2 = apart & (s1 > s2), apart & ~(s1 > s2)
    after1 = np.where(refuse1, np.uint32(Status.INCONSISTENT), status1).astype(np.uint32)
    after2 = np.where(refuse2, np.uint32(Status.INCONSISTENT), status2).astype(np.uint32)
    use1, use2 = first & ~refuse1, second & ~refuse2
    # Shares rather than 1/σ²: a σ of 0 is allowed, and two of them share alike.
    v1, v2 = np.where(use1, s1, np.inf) ** 2, np.where(use2, s2, np.inf) ** 2
    weight = np.nan_to_num(share_of_pulses(s1, s2, use1, use2))
    with np.errstate(invalid="ignore", divide="ignore"):
        mixed = np.where(use1, (1.0 - weight) * r1, 0.0) + np.where(use2, weight * r2, 0.0)
        variance = np.where(use1 & use2, weight * v2, np.where(use1, v1, v2))
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
        moves with Θ by (1 − w) ∂R/∂Θ of the triangulation, which is −(R − d sinΘ) tanΘ + d cosΘ (eq 1), and w times
        that of time of flight; σ is that of the errors of the peak, of the delay, and of Θ; the last is in both.
    """
    theta, d = deflections.theta, geometry.baseline
    sigma1, sigma2 = _with_common(triangulated, echo, deflections, geometry)
    both = fuse((triangulated.range, sigma1, triangulated.status), (echo.range, sigma2, echo.status))
    share = both.weight
    r1, r2 = np.nan_to_num(triangulated.range), np.nan_to_num(echo.range, nan=1.0)
    aside = d if geometry.pulse_by == "offset" else 0.0
    by_theta1 = d * np.cos(theta) - (r1 - d * np.sin(theta)) * tan(theta)
    by_theta2 = echo_range_by_theta(r2, delay_from_range(r2, theta, aside), theta, aside)
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


def _with_common(
    triangulated: Ranges, echo: Ranges, deflections: Deflections, geometry: Geometry
) -> tuple[Array, Array]:
    """Return σ of both ranges with what the calibration's errors make of them: two rangefinders do not share it."""
    if geometry.calibration is None:
        return triangulated.sigma, echo.sigma
    along = deflections.theta, deflections.phi
    common1 = geometry.range_in_common("triangulation", triangulated.range, *along)
    common2 = geometry.range_in_common(geometry.pulse_by, echo.range, *along)
    return np.hypot(triangulated.sigma, common1), np.hypot(echo.sigma, common2)


def share_of_pulses(
    sigma1: Array, sigma2: Array, valid1: NDArray[np.bool_], valid2: NDArray[np.bool_]
) -> Array:
    """Return the share of time of flight in combined ranges, by σ of both [m] and whether each is valid: see `fuse`.

    NaN where neither is.
    """
    v1, v2 = np.where(valid1, sigma1, np.inf) ** 2, np.where(valid2, sigma2, np.inf) ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        both = np.where(v1 + v2 > 0.0, v1 / (v1 + v2), 0.5)
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
