"""Triangulation: from the position on the sensor to the range, and its derivatives (eq 1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def range_from_position(p: ArrayLike, theta: ArrayLike, f: float, d: float) -> Array:
    """Return the range R = f d cosΘ / p + d sinΘ [m] (Blais, Beraldin, El-Hakim 2000, eq 1).

    Parameters
    ----------
    p
        Position of the spot on the sensor [m], counted from the image of infinity.
    theta
        Deflection Θ [rad], broadcast against ``p``.
    f, d
        Focal length and triangulation base [m].
    """
    p = np.asarray(p, dtype=np.float64)
    result: Array = f * d * np.cos(theta) / p + d * np.sin(theta)
    return result


def position_from_range(r: ArrayLike, theta: ArrayLike, f: float, d: float) -> Array:
    """Return the position p = f d cosΘ / (R − d sinΘ) [m] of a spot at range R [m]: eq 1 solved for p."""
    r = np.asarray(r, dtype=np.float64)
    result: Array = f * d * np.cos(theta) / (r - d * np.sin(theta))
    return result


def range_jacobian(p: ArrayLike, theta: ArrayLike, f: float, d: float) -> tuple[Array, Array]:
    """Return the derivatives of eq 1.

    Returns
    -------
    tuple
        ∂R/∂p at constant Θ [m/m] and ∂R/∂Θ at constant p [m/rad]. The second is left out of the printed
        eq 5.
    """
    p = np.asarray(p, dtype=np.float64)
    sin, cos = np.sin(theta), np.cos(theta)
    return -f * d * cos / p**2, -f * d * sin / p + d * cos


def position_sigma(
    p: ArrayLike, sigma_peak: ArrayLike, f: float, pitch: float, synchronisation: float
) -> Array:
    """Return the standard deviation of the position p [m] about that of the true range and deflection.

    The peak's own (``sigma_peak`` [pixel] times the ``pitch`` [m]) and, independent of it, that of a receiver which
    looks past the laser by an angle e of standard deviation ``synchronisation`` [rad]: p = f tanα becomes
    f tan(α + e), hence σ_p = f (1 + p²/f²) σ_e, and a range error of nearly R² e/d.
    """
    p = np.asarray(p, dtype=np.float64)
    apart = (f + p * p / f) * synchronisation
    return np.asarray(np.hypot(np.asarray(sigma_peak) * pitch, apart))
