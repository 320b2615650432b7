"""Coordinates: from range and deflections to a point, and back (eq 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.arithmetic import arctan2

Array = NDArray[np.float64]


def coordinates(
    r: ArrayLike, theta: ArrayLike, phi: ArrayLike, axis_separation: float | Array
) -> tuple[Array, Array, Array]:
    """Return the point (x, y, z) [m] at range R [m] and deflections Θ, φ [rad].

    x = R sinΘ, y = (R cosΘ − D_g) sinφ, z = D_g + (R cosΘ − D_g) cosφ (Blais, Beraldin, El-Hakim 2000,
    eq 3); ``axis_separation`` is D_g [m]. R is the path from the first deflection axis, not |(x, y, z)|.
    """
    r, theta, phi = (np.asarray(value, dtype=np.float64) for value in (r, theta, phi))
    reach = r * np.cos(theta) - axis_separation
    return r * np.sin(theta), reach * np.sin(phi), axis_separation + reach * np.cos(phi)


def angles_and_range(
    x: ArrayLike, y: ArrayLike, z: ArrayLike, axis_separation: float
) -> tuple[Array, Array, Array]:
    """Return (R, Θ, φ) of a point in front of the scanner: the exact inverse of :func:`coordinates`.

    φ = atan2(y, z − D_g), q = hypot(y, z − D_g), Θ = atan2(x, q + D_g), R = hypot(x, q + D_g).
    """
    x, y, z = (np.asarray(value, dtype=np.float64) for value in (x, y, z))
    reach = np.hypot(y, z - axis_separation) + axis_separation
    return np.hypot(x, reach), arctan2(x, reach), arctan2(y, z - axis_separation)
