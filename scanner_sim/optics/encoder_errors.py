"""From what an angle encoder reads to where its mirror points: zero, scale, third order, and the encoder's lines.

Errors of an encoder are five numbers along the last axis of an array: zero [rad], scale, third order [rad⁻²], and the
amplitudes of sine and cosine [rad] over the period of the lines.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def pointing_error(reading: ArrayLike, errors: ArrayLike, period: float) -> Array:
    """Return by how much a mirror points further than its encoder reads [rad].

    Θ − ϑ = z + k ϑ + c ϑ³ + a sin(2π ϑ/P) + b cos(2π ϑ/P): zero and scale, the lowest order of a sensor's
    non-linearity that is no scale, and the lines of an encoder (Lichti, *ISPRS J. Photogramm. Remote Sens.* 61, 2007,
    307-324, whose additional parameters of terrestrial scanners have the same terms).

    Parameters
    ----------
    reading
        ϑ [rad], any shape.
    errors
        (z, k, c, a, b), shape (5,), or (..., 5) whose leading axes broadcast against the readings.
    period
        P [rad].
    """
    angle, own = np.asarray(reading, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    zero, scale, cubic, sine, cosine = (own[..., part] for part in range(5))
    phase = (math.tau / period) * angle
    smooth = zero + (scale + cubic * angle * angle) * angle
    return np.asarray(smooth + sine * np.sin(phase) + cosine * np.cos(phase))


def pointing_slope(reading: ArrayLike, errors: ArrayLike, period: float) -> Array:
    """Return the derivative of :func:`pointing_error` by the reading, of its shape."""
    angle, own = np.asarray(reading, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    _, scale, cubic, sine, cosine = (own[..., part] for part in range(5))
    rate = math.tau / period
    lines = sine * np.cos(rate * angle) - cosine * np.sin(rate * angle)
    return np.asarray(scale + 3.0 * cubic * angle * angle + rate * lines)


def pointing_by_errors(reading: ArrayLike, period: float) -> Array:
    """Return the derivatives of :func:`pointing_error` by the five errors, shape (..., 5)."""
    angle = np.asarray(reading, dtype=np.float64)
    phase = (math.tau / period) * angle
    return np.stack(
        [np.ones_like(angle), angle, angle * angle * angle, np.sin(phase), np.cos(phase)], axis=-1
    )
