"""Triangulation: from the position on the sensor to the range, and its derivatives (eq 1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def range_from_position(p: ArrayLike, theta: ArrayLike, scale: float, d: float, slope: float = 0.0) -> Array:
    """Return the range R = h d cosΘ / p + d (sinΘ + g cosΘ) [m].

    For h = f and g = 0 eq 1 of Blais, Beraldin, El-Hakim (2000); else that of a tilted array, by
    :mod:`scanner_sim.optics.line_image`: a position looks at the tangent p/(h + g p) = d cosΘ/(R − d sinΘ).

    Parameters
    ----------
    p
        Position of the spot on the sensor [m], counted from the image of infinity.
    theta
        Deflection Θ [rad], broadcast against ``p``.
    scale, d
        Scale h of the array, the focal length f of an upright one in the focal plane, and triangulation base [m].
    slope
        Slope g of the array against the lens.
    """
    p = np.asarray(p, dtype=np.float64)
    result: Array = scale * d * np.cos(theta) / p + d * _sine(theta, slope)
    return result


def position_from_range(r: ArrayLike, theta: ArrayLike, scale: float, d: float, slope: float = 0.0) -> Array:
    """Return the position p = h d cosΘ / (R − d (sinΘ + g cosΘ)) [m] of a spot at range R [m].

    :func:`range_from_position` solved for p; arguments as there.
    """
    r = np.asarray(r, dtype=np.float64)
    result: Array = scale * d * np.cos(theta) / (r - d * _sine(theta, slope))
    return result


def range_jacobian(
    p: ArrayLike, theta: ArrayLike, scale: float, d: float, slope: float = 0.0
) -> tuple[Array, Array]:
    """Return the derivatives of :func:`range_from_position`; arguments as there.

    Returns
    -------
    tuple
        ∂R/∂p at constant Θ [m/m] and ∂R/∂Θ at constant p [m/rad]. The second is left out of the printed
        eq 5.
    """
    p = np.asarray(p, dtype=np.float64)
    sin, cos = np.sin(theta), np.cos(theta)
    return -scale * d * cos / p**2, -scale * d * sin / p + d * (cos - slope * sin)


def position_sigma(
    p: ArrayLike,
    sigma_peak: ArrayLike,
    scale: float,
    pitch: float,
    synchronisation: float,
    slope: float = 0.0,
) -> Array:
    """Return the standard deviation of the position p [m] about that of the true range and deflection.

    The peak's own (``sigma_peak`` [pixel] times the ``pitch`` [m]) and, independent of it, that of a receiver which
    looks past the laser by an angle e of standard deviation ``synchronisation`` [rad]: the tangent t becomes
    t + (1 + t²) e, hence σ_p = dp/dt (1 + t²) σ_e = ((h + g p)² + p²)/h σ_e, and a range error of nearly R² e/d.
    ``scale`` and ``slope`` as of :func:`range_from_position`.
    """
    p = np.asarray(p, dtype=np.float64)
    apart = (scale + p * p / scale + slope * p * (2.0 + slope * p / scale)) * synchronisation
    return np.asarray(np.hypot(np.asarray(sigma_peak) * pitch, apart))


def _sine(theta: ArrayLike, slope: float) -> Array:
    """Return sinΘ + g cosΘ."""
    return np.asarray(np.sin(theta) + slope * np.cos(theta))
