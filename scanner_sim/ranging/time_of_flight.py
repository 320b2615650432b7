"""Time of flight: from delays to ranges with σ (eq 2), along the beam from the first deflection axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.status import Status

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EchoRanges:
    """Ranges by time of flight, arrays of shape (n,); NaN wherever ``status`` is not 0.

    ``range`` and ``sigma`` [m], ``status`` codes.
    """

    range: Array
    sigma: Array
    status: NDArray[np.uint32]


def range_from_delay(delay: ArrayLike, theta: ArrayLike, baseline: float = 0.0) -> Array:
    """Return the range R [m] of a pulse that came back after a delay.

    On the laser's axis R = c τ/2 (Blais, Beraldin, El-Hakim 2000, eq 2). With the lens at the distance d beside it the
    way is L = c τ = R + √(R² + d² − 2 R d sinΘ), hence R = (L² − d²)/(2 (L − d sinΘ)).

    Parameters
    ----------
    delay
        τ [s].
    theta
        Deflection Θ [rad], broadcast against ``delay``.
    baseline
        Distance d of the lens from the laser [m]; 0 for a coaxial receiver.
    """
    way = SPEED_OF_LIGHT * np.asarray(delay, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((way**2 - baseline**2) / (2.0 * (way - baseline * np.sin(theta))))


def delay_from_range(r: ArrayLike, theta: ArrayLike, baseline: float = 0.0) -> Array:
    """Return the delay [s] of a pulse from range R [m]: the inverse of :func:`range_from_delay`."""
    r = np.asarray(r, dtype=np.float64)
    back = np.sqrt(r**2 + baseline**2 - 2.0 * r * baseline * np.sin(theta))
    return np.asarray((r + back) / SPEED_OF_LIGHT)


def echo_range_sigma(
    delay: ArrayLike, theta: ArrayLike, sigma_delay: ArrayLike, jitter: float, baseline: float = 0.0
) -> Array:
    """Return the standard deviation of the range [m], |∂R/∂τ| √(σ_τ² + jitter²).

    On the axis that is σ_R² = (c σ_τ/2)² + (c jitter/2)²: the second part is the floor that does not fall with the
    signal. ∂R/∂L = (L² − 2 L d sinΘ + d²)/(2 (L − d sinΘ)²).

    Parameters
    ----------
    delay, sigma_delay
        τ and its standard deviation from the waveform's noise [s], shape (n,).
    theta
        Deflection [rad].
    jitter
        Standard deviation of the clock against the pulse [s].
    baseline
        Distance of the lens from the laser [m].
    """
    way = SPEED_OF_LIGHT * np.asarray(delay, dtype=np.float64)
    aside = baseline * np.sin(theta)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (way**2 - 2.0 * way * aside + baseline**2) / (2.0 * (way - aside) ** 2)
    return np.asarray(np.abs(slope) * SPEED_OF_LIGHT * np.hypot(sigma_delay, jitter))


def echo_range_by_theta(r: ArrayLike, delay: ArrayLike, theta: ArrayLike, baseline: float) -> Array:
    """Return ∂R/∂Θ [m] at a known delay, R d cosΘ/(L − d sinΘ) with L = c τ: 0 on the laser's own axis.

    Arguments as of :func:`range_from_delay`, beside the range R [m] itself.
    """
    r, way = np.asarray(r, dtype=np.float64), SPEED_OF_LIGHT * np.asarray(delay, dtype=np.float64)
    return np.asarray(r * baseline * np.cos(theta) / (way - baseline * np.sin(theta)))


def ranges_from_delays(
    delay: Array,
    sigma_delay: Array,
    status: NDArray[np.uint32],
    theta: Array,
    jitter: float,
    gate: tuple[float, float],
    baseline: float = 0.0,
) -> EchoRanges:
    """Return the ranges of n shots.

    Parameters
    ----------
    delay, sigma_delay
        τ and its standard deviation from the waveform's noise [s], shape (n,).
    status
        Status so far, shape (n,).
    theta
        Measured deflections [rad], shape (n,).
    jitter
        Standard deviation of the clock against the pulse [s].
    gate
        Nearest and farthest range accepted [m].
    baseline
        Distance of the lens from the laser [m]; 0 for a coaxial receiver.
    """
    r = range_from_delay(delay, theta, baseline)
    sigma = echo_range_sigma(delay, theta, sigma_delay, jitter, baseline)
    status = status.copy()
    status[(status == Status.VALID) & ~((r >= gate[0]) & (r <= gate[1]))] = Status.OUT_OF_GATE
    invalid = status != Status.VALID
    r[invalid] = np.nan
    sigma[invalid] = np.nan
    return EchoRanges(r, sigma, status)
