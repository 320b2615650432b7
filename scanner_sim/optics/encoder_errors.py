"""From what an angle encoder reads to where the mirror points: zero, scale, third order, and the period of its lines."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class EncoderErrors(NamedTuple):
    """Errors of one encoder: ``zero`` [rad], ``scale``, ``cubic`` [rad⁻²], ``sine`` and ``cosine`` [rad].

    Numbers, or arrays that broadcast against the readings. ``period`` [rad] is that of the last two.
    """

    zero: ArrayLike = 0.0
    scale: ArrayLike = 0.0
    cubic: ArrayLike = 0.0
    sine: ArrayLike = 0.0
    cosine: ArrayLike = 0.0
    period: float = math.tau


def pointing_error(reading: ArrayLike, errors: EncoderErrors) -> Array:
    """Return by how much a mirror points further than its encoder reads [rad].

    Θ − ϑ = z + k ϑ + c ϑ³ + a sin(2π ϑ/P) + b cos(2π ϑ/P): zero and scale, the lowest order of a sensor's
    non-linearity that is no scale, and the lines of an encoder (Lichti, *ISPRS J. Photogramm. Remote Sens.* 61, 2007,
    307-324, whose a and b parameters of terrestrial scanners have the same terms).

    Parameters
    ----------
    reading
        ϑ [rad], any shape.
    errors
        Of the encoder.
    """
    angle = np.asarray(reading, dtype=np.float64)
    phase = (math.tau / errors.period) * angle
    smooth = (
        np.asarray(errors.zero)
        + (np.asarray(errors.scale) + np.asarray(errors.cubic) * angle * angle) * angle
    )
    return np.asarray(
        smooth + np.asarray(errors.sine) * np.sin(phase) + np.asarray(errors.cosine) * np.cos(phase)
    )


def pointing_slope(reading: ArrayLike, errors: EncoderErrors) -> Array:
    """Return the derivative of :func:`pointing_error` by the reading, of its shape."""
    angle = np.asarray(reading, dtype=np.float64)
    rate = math.tau / errors.period
    turn = np.asarray(errors.sine) * np.cos(rate * angle) - np.asarray(errors.cosine) * np.sin(rate * angle)
    return np.asarray(np.asarray(errors.scale) + 3.0 * np.asarray(errors.cubic) * angle * angle + rate * turn)


def pointing_by_errors(reading: ArrayLike, period: float) -> Array:
    """Return the derivatives of :func:`pointing_error` by zero, scale, cubic, sine and cosine, shape (..., 5)."""
    angle = np.asarray(reading, dtype=np.float64)
    phase = (math.tau / period) * angle
    return np.stack(
        [np.ones_like(angle), angle, angle * angle * angle, np.sin(phase), np.cos(phase)], axis=-1
    )
