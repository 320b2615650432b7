"""What an instrument's departures from its design do to what it measures: on the array, in time, between the axes.

Each law is the inverse of what happens to the light: from what was read to what an ideal instrument would have read.
Where a departure is zero the result is the same number, to the last bit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_STEPS = 6
"""Newton steps of the distortion's inverse: from 10 % of distortion on, three reach the last bit."""


def undistorted_position(
    position: ArrayLike,
    scale: ArrayLike,
    slope: ArrayLike,
    radial_1: ArrayLike = 0.0,
    radial_2: ArrayLike = 0.0,
    tangential: ArrayLike = 0.0,
) -> Array:
    """Return where a lens without distortion would image on the array [m].

    Parameters
    ----------
    position
        s, from the image of infinity [m].
    scale, slope
        Scale h [m] and slope g of the array: s = h x/(1 − g x), x the tangent of the angle of sight
        (:mod:`scanner_sim.optics.line_image`).
    radial_1, radial_2, tangential
        k₁, k₂ and p₂ of x' = x (1 + k₁ x² + k₂ x⁴) + 3 p₂ x² on the line (Brown, *Photogramm. Eng.* 37, 1971, 855-866;
        signs as in OpenCV's ``projectPoints``).
    """
    s, h, g = (np.asarray(value, dtype=np.float64) for value in (position, scale, slope))
    seen = s / (h + g * s)
    x = _undistorted(seen, radial_1, radial_2, tangential)
    # The way from the one to the other: without distortion it is 0, and s stays what it is.
    return np.asarray(
        s - h * _distortion(x, radial_1, radial_2, tangential) / ((1.0 - g * seen) * (1.0 - g * x))
    )


def tangent_derivatives(
    position: ArrayLike,
    scale: ArrayLike,
    slope: ArrayLike,
    radial_1: ArrayLike,
    radial_2: ArrayLike,
    tangential: ArrayLike,
) -> tuple[Array, Array, Array, Array, Array]:
    """Return the tangent x of the angle at which a position on the array looks, and its derivatives.

    Returns
    -------
    tuple
        x; ∂x/∂s [1/m]; ∂x/∂h [1/m]; ∂x/∂g; and ∂x/∂(k₁, k₂, p₂), shape (..., 3). Arguments as those of
        :func:`undistorted_position`.
    """
    s, h, g = (np.asarray(value, dtype=np.float64) for value in (position, scale, slope))
    along = h + g * s
    x = _undistorted(s / along, radial_1, radial_2, tangential)
    shrink = 1.0 / (1.0 + _distortion_slope(x, radial_1, radial_2, tangential))
    by_seen = shrink / (along * along)
    x2 = x * x
    lens = np.broadcast_arrays(-x2 * x * shrink, -x2 * x2 * x * shrink, -3.0 * x2 * shrink)
    return x, h * by_seen, -s * by_seen, -s * s * by_seen, np.stack(lens, axis=-1)


def _distortion(x: Array, radial_1: ArrayLike, radial_2: ArrayLike, tangential: ArrayLike) -> Array:
    x2 = x * x
    radial = np.asarray(radial_1) + np.asarray(radial_2) * x2
    return np.asarray(x2 * (x * radial + 3.0 * np.asarray(tangential)))


def _distortion_slope(x: Array, radial_1: ArrayLike, radial_2: ArrayLike, tangential: ArrayLike) -> Array:
    x2 = x * x
    radial = 3.0 * np.asarray(radial_1) * x2 + 5.0 * np.asarray(radial_2) * x2 * x2
    return np.asarray(radial + 6.0 * np.asarray(tangential) * x)


def _undistorted(x: Array, radial_1: ArrayLike, radial_2: ArrayLike, tangential: ArrayLike) -> Array:
    """Return the x whose distorted one is given, by Newton's method."""
    found = x
    for _ in range(_STEPS):
        step = found + _distortion(found, radial_1, radial_2, tangential) - x
        found = found - step / (1.0 + _distortion_slope(found, radial_1, radial_2, tangential))
    return np.asarray(found)


def ideal_way(way: ArrayLike, zero: ArrayLike = 0.0, scale: ArrayLike = 0.0) -> Array:
    """Return the way of a pulse there and back [m], from the one that its delay tells: L = W/(1 + k) − 2z.

    Parameters
    ----------
    way
        W = c τ [m].
    zero, scale
        z [m], by which ranges read too far, and k, by which delays read too long.
    """
    return np.asarray(np.asarray(way, dtype=np.float64) / (1.0 + np.asarray(scale)) - 2.0 * np.asarray(zero))


def axes_shift(
    x: ArrayLike, reach: ArrayLike, phi: ArrayLike, offset: ArrayLike, skew: ArrayLike
) -> tuple[Array, Array, Array]:
    """Return by how much points move because the second axis is not where eq 3 has it, (δx, δy, δz) [m].

    The second mirror turns the plane of triangulation by φ about the line through (0, e, D_g) along
    (cos s, sin s, 0). With w = (x, −e, ζ), ζ = R cosΘ − D_g the reach beyond that axis, Rodrigues's formula less
    eq 3 is carried out.

    Parameters
    ----------
    x, reach
        R sinΘ and ζ [m].
    phi
        φ [rad].
    offset, skew
        e [m] and s [rad].
    """
    sine, versed = np.sin(phi), 1.0 - np.cos(phi)
    across, along = np.sin(skew), np.cos(skew)
    x, reach, e = (np.asarray(value, dtype=np.float64) for value in (x, reach, offset))
    # 1 − cos s without the loss of digits.
    bent = 2.0 * np.sin(0.5 * np.asarray(skew)) ** 2
    return (
        -versed * across * (across * x + along * e) - sine * across * reach,
        -sine * bent * reach + versed * along * (along * e + across * x),
        sine * (across * x + along * e),
    )


def point_derivatives(
    x: ArrayLike, reach: ArrayLike, phi: ArrayLike, offset: ArrayLike, skew: ArrayLike
) -> tuple[Array, Array, Array, Array, Array]:
    """Return the derivatives of points, eq 3 with :func:`axes_shift`, each of shape (..., 3).

    Returns
    -------
    tuple
        By x = R sinΘ, by the reach ζ (at a fixed D_g), by φ, by the offset e and by the skew s.
    """
    x, reach, phi, e, s = np.broadcast_arrays(
        *(np.asarray(value, dtype=np.float64) for value in (x, reach, phi, offset, skew))
    )
    sine, cosine, across, along = np.sin(phi), np.cos(phi), np.sin(s), np.cos(s)
    versed = 1.0 - cosine
    double, both = along * along - across * across, along * across

    def vectors(*parts: Array) -> Array:
        return np.stack(parts, axis=-1)

    return (
        vectors(1.0 - versed * across * across, versed * both, sine * across),
        vectors(-sine * across, sine * along, cosine),
        vectors(
            -sine * across * (across * x + along * e) - cosine * across * reach,
            cosine * along * reach + sine * along * (along * e + across * x),
            -sine * reach + cosine * (across * x + along * e),
        ),
        vectors(-versed * both, versed * along * along, sine * along),
        vectors(
            -versed * (2.0 * both * x + double * e) - sine * along * reach,
            -sine * across * reach + versed * (double * x - 2.0 * both * e),
            sine * (along * x - across * e),
        ),
    )
