"""Where the middle of a spot's light lies on a matt surface that leans or bends, and what that does to a range.

The beam's axis meets the surface at the range R. The light that comes back has its middle elsewhere: the lens stands on
one side, the surface leans, and of a body the side that turns away is darker. The spot's image then stands where that
of another range would, by R/d times the middle's way across the beam: some micrometres on a plate, a third of a
millimetre on the side of a sphere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def spot_shift(
    range_m: ArrayLike,
    theta: ArrayLike,
    baseline: float,
    slope: tuple[ArrayLike, ArrayLike],
    spot: ArrayLike,
    curvature: float = 0.0,
) -> Array:
    """Return by how much triangulation measures matt surfaces too far [m]; all arguments broadcast.

    Parameters
    ----------
    range_m, theta
        R [m] and Θ [rad] of the beam's axis.
    baseline
        d [m].
    slope
        Rise of the surface's depth along the beam with a way across it, in the plane of triangulation (towards +Θ) and
        normal to that (towards +φ).
    spot
        Standard deviation of the beam's irradiance, per axis [m].
    curvature
        One over the radius of a sphere [1/m]; 0 of a plane.

    Returns
    -------
    ndarray
        To the second order in the spot. Beamlets at (a, b) across the beam meet the surface at the depth
        ζ = R + g a + h b + ½ (1 + g²) (a²)/w + …, w = cos i/curvature with the incidence i, and the lens, at l = d cosΘ
        across and k = d sinΘ along the beam, has of each the light L = cosθ cosψ/r² and sees it at the tangent
        x = (l − a)/(ζ − k): θ from the normal and ψ from the lens's axis, Lambert's law and the solid angle of the
        aperture. The tangent of the middle is x₀ + ½ s² (x_aa + x_bb) + s² ∇lnL·∇x, which eq 1 takes for that of a
        point. Without the beam's divergence; what spreads light evenly about its image moves nothing.
    """
    r, angle = np.asarray(range_m, dtype=np.float64), np.asarray(theta, dtype=np.float64)
    g, h = (np.asarray(one, dtype=np.float64) for one in slope)
    across, ahead = baseline * np.cos(angle), r - baseline * np.sin(angle)
    tangent = across / ahead
    secant = np.sqrt(1.0 + g * g + h * h)
    way = across * across + ahead * ahead
    # Gradient of ln L: of cosψ/r² on every surface, and of cosθ r on one that bends.
    facing = curvature * secant / (across * g + ahead)
    light = (
        g / ahead + 4.0 * (across - ahead * g) / way + facing * (across - g * ahead),
        h / ahead - 4.0 * ahead * h / way - facing * h * ahead,
    )
    # All derivatives of x times the distance to the lens, and of the second order times its square.
    gradient = -(1.0 + tangent * g), -tangent * h
    bend = curvature * secant * (1.0 + secant * secant) * ahead
    second = 2.0 * g + 2.0 * tangent * (g * g + h * h) - tangent * bend
    moved = 0.5 * second + ahead * (light[0] * gradient[0] + light[1] * gradient[1])
    return np.asarray(-np.square(spot) * moved / across)


def swept_shift(
    range_m: ArrayLike,
    theta: ArrayLike,
    baseline: float,
    axis_separation: float,
    sweep: tuple[ArrayLike, ArrayLike],
) -> Array:
    """Return by how much triangulation measures surfaces too far that face a beam which moves while it is seen [m].

    Parameters
    ----------
    range_m, theta
        R [m] and Θ [rad] of the beam's axis in the middle of its way; all arguments broadcast.
    baseline, axis_separation
        d and D_g [m].
    sweep
        Angles W and V by which Θ and φ change while there is light [rad].

    Returns
    -------
    ndarray
        To the second order in the angles, which pass evenly. On a plane that faces the beam at Θ, a beam at Θ + τ has
        the range R/cosτ, and its light the tangent x = d cos(Θ + τ)/(R/cosτ − d sin(Θ + τ)) at the lens and the
        strength L = cosθ cosψ/r² of :func:`spot_shift`, the lens's axis turning with the beam. The mean tangent is
        x₀ + (W²/12) (½ x_ττ + (ln L)_τ x_τ), hence with x = l/(R − k), l = d cosΘ and k = d sinΘ

            δR = (W²/12) R (1 − 4 (x² − k/(R − k))/(1 + x²)) + (V²/24) (R cosΘ − D_g) cosΘ,

        the second because φ turns about an axis D_g behind which the plane lies R cosΘ − D_g away. Of surfaces that
        lean by g along the sweep (−3 g² + 4 g (2 x − tanΘ)) R W²/12 is left out, and −3 g² R V²/12 for one along φ.
    """
    r, angle = np.asarray(range_m, dtype=np.float64), np.asarray(theta, dtype=np.float64)
    along, down = (np.square(np.asarray(one, dtype=np.float64)) / 12.0 for one in sweep)
    cosine, lens_ahead = np.cos(angle), baseline * np.sin(angle)
    ahead = r - lens_ahead
    squared = np.square(baseline * cosine / ahead)
    by_theta = r * (1.0 - 4.0 * (squared - lens_ahead / ahead) / (1.0 + squared))
    return np.asarray(along * by_theta + 0.5 * down * (r * cosine - axis_separation) * cosine)
