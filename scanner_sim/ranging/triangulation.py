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


def range_sigma(
    p: ArrayLike, theta: ArrayLike, f: float, d: float, sigma_p: ArrayLike, sigma_theta: float
) -> Array:
    """Return the standard deviation of the range [m].

    First order, with independent errors of the position (``sigma_p`` [m]) and of the deflection
    (``sigma_theta`` [rad]): σ_R² = (∂R/∂p σ_p)² + (∂R/∂Θ σ_Θ)².
    """
    by_position, by_angle = range_jacobian(p, theta, f, d)
    result: Array = np.hypot(by_position * np.asarray(sigma_p), by_angle * sigma_theta)
    return result
