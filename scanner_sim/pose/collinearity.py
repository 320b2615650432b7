"""The exact collinearity of the two mirrors: which (Θ, φ, R) a point has, and how they change with it.

Blais, Beraldin, El-Hakim (2000) print the inverse of eq 3 as a projection u = x/z, v = y/z that still contains the
range through ψ = D_g/R (eq 15). The angles themselves need no range:

    φ = atan2(y, z − D_g),   q = hypot(y, z − D_g),   Θ = atan2(x, q + D_g),   R = hypot(x, q + D_g),

so that resection is done on (Θ, φ) and nothing is approximated.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import arctan2

Array = NDArray[np.float64]


def project(points: Array, axis_separation: float, *, with_range: bool) -> tuple[Array, Array]:
    """Return the measured quantities of points, and their gradients.

    Parameters
    ----------
    points
        Shape (≥ 3, ...): x, y, z [m] in the scanner frame first; further rows are ignored.
    axis_separation
        D_g [m].
    with_range
        Whether R is measured beside Θ and φ.

    Returns
    -------
    tuple
        (Θ, φ[, R]), shape (2 or 3, ...) [rad, rad, m], and the gradients ∂/∂(x, y, z), shape (3, 2 or 3, ...).
        NaN on the second axis of deflection (y = 0, z = D_g), which no beam leaves.
    """
    x, y = points[0], points[1]
    ahead = points[2] - axis_separation
    q_squared = y * y + ahead * ahead
    q = np.sqrt(q_squared)
    w = q + axis_separation
    r_squared = x * x + w * w
    channels = 3 if with_range else 2
    values = np.empty((channels, *x.shape))
    gradients = np.empty((3, channels, *x.shape))
    values[0], values[1] = arctan2(x, w), arctan2(y, ahead)
    # ∂Θ/∂q = −x/R², and ∂q/∂(y, z) = (y, z − D_g)/q.
    by_q = x / (r_squared * q)
    gradients[0, 0] = w / r_squared
    gradients[1, 0] = -by_q * y
    gradients[2, 0] = -by_q * ahead
    gradients[0, 1] = 0.0
    gradients[1, 1] = ahead / q_squared
    gradients[2, 1] = -y / q_squared
    if with_range:
        r = np.sqrt(r_squared, out=values[2])
        by_q = w / (r * q)
        gradients[0, 2] = x / r
        gradients[1, 2] = by_q * y
        gradients[2, 2] = by_q * ahead
    return values, gradients


def bearings(theta: Array, phi: Array) -> Array:
    """Return the directions u = (sinΘ, cosΘ sinφ, cosΘ cosφ) of the beams, shape (3, ...)."""
    cos = np.cos(theta)
    return np.stack([np.sin(theta), cos * np.sin(phi), cos * np.cos(phi)])


def virtual_origin(phi: Array, axis_separation: float) -> Array:
    """Return from where the beam at φ seems to come, (0, −D_g sinφ, D_g (1 − cosφ)) [m], shape (3, ...)."""
    return axis_separation * np.stack([np.zeros_like(phi), -np.sin(phi), 1.0 - np.cos(phi)])
