"""Geometry of the auto-synchronised scanner, and how errors of (p, Θ, φ) become errors of (x, y, z, R).

The derivation starts in the plane of triangulation (x, z'): the laser leaves the origin along
u = (sinΘ, cosΘ); the receiver's node is at (d, 0), its axis is parallel to u and its line sensor lies along
n = (cosΘ, −sinΘ). The second mirror turns this plane by φ about the line y = 0, z = D (D_g in the paper).
x points right, y down, z forward. Equation numbers are those of Blais, Beraldin, El-Hakim (2000).

All arguments may be numbers or arrays that broadcast; results are float64 arrays of the broadcast shape.
Lengths in metres, angles in radians (optical angles: twice the mirrors').
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def triangulated_range(p: ArrayLike, theta: ArrayLike, f: float, d: float) -> Floats:
    """Return R = f d cosΘ / p + d sinΘ: eq 1, exact for an ideal lens.

    Parameters
    ----------
    p
        Position of the image on the sensor [m]; 0 is the image of infinity.
    theta
        Deflection Θ.
    f, d
        Focal length and base [m].

    Notes
    -----
    A point R u of the beam lies at −d cosΘ along n and at R − d sinΘ along u from the node, and the image is
    p = f d cosΘ / (R − d sinΘ). Valid for R > d sinΘ, that is p > 0; p = 0 gives infinity.
    """
    p, theta = np.asarray(p, dtype=np.float64), np.asarray(theta, dtype=np.float64)
    with np.errstate(divide="ignore"):
        return np.asarray(f * d * np.cos(theta) / p + d * np.sin(theta))


def image_position(R: ArrayLike, theta: ArrayLike, f: float, d: float) -> Floats:
    """Return p = f d cosΘ / (R − d sinΘ) [m], the inverse of :func:`triangulated_range`; R > d sinΘ."""
    R, theta = np.asarray(R, dtype=np.float64), np.asarray(theta, dtype=np.float64)
    return np.asarray(f * d * np.cos(theta) / (R - d * np.sin(theta)))


def nearest_range(theta: ArrayLike, f: float, d: float, p_max: float) -> Floats:
    """Return the range [m] whose image falls on the near end of the sensor, p = ``p_max`` [m]: eq 1."""
    return triangulated_range(p_max, theta, f, d)


def mirror_matrix(phi: ArrayLike, D: float) -> Floats:
    """Return the motion of the second mirror, ``scanner_from_plane``, shape (..., 4, 4).

    A turn by φ that moves +z' towards +y (down), about the line y = 0, z = D: shift by −D, turn, shift back.
    """
    phi = np.asarray(phi, dtype=np.float64)
    shift, back = np.eye(4), np.eye(4)
    shift[2, 3], back[2, 3] = -D, D
    turn = np.broadcast_to(np.eye(4), (*phi.shape, 4, 4)).copy()
    turn[..., 1, 1] = turn[..., 2, 2] = np.cos(phi)
    turn[..., 1, 2], turn[..., 2, 1] = np.sin(phi), -np.sin(phi)
    return np.asarray(back @ turn @ shift)


def scanner_axes(theta: ArrayLike, phi: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Return the axes (u, n, m) of the deflected optics, each of shape (..., 3).

    u is the direction of the beam and of the lens axis, n lies along the sensor (towards +x), m = u × n
    along its height (towards +y).
    """
    theta, phi = np.broadcast_arrays(np.asarray(theta, dtype=np.float64), np.asarray(phi, dtype=np.float64))
    zero = np.zeros_like(theta)
    turn = mirror_matrix(phi, 0.0)[..., :3, :3]
    u = np.einsum("...ij,...j->...i", turn, np.stack([np.sin(theta), zero, np.cos(theta)], axis=-1))
    n = np.einsum("...ij,...j->...i", turn, np.stack([np.cos(theta), zero, -np.sin(theta)], axis=-1))
    return u, n, np.cross(u, n)


def laser_origin(phi: ArrayLike, D: float) -> Floats:
    """Return the virtual place from which the beam comes, shape (..., 3): the turned origin of the plane."""
    return np.asarray(mirror_matrix(phi, D)[..., :3, :] @ np.array([0.0, 0.0, 0.0, 1.0]))


def lens_node(phi: ArrayLike, D: float, d: float) -> Floats:
    """Return the virtual place of the receiver's node, shape (..., 3): the turned point (d, 0, 0)."""
    return np.asarray(mirror_matrix(phi, D)[..., :3, :] @ np.array([d, 0.0, 0.0, 1.0]))


def point_from_shot(R: ArrayLike, theta: ArrayLike, phi: ArrayLike, D: float) -> Floats:
    """Return the point (x, y, z) [m] at the range R, shape (..., 3): eq 3, by turning (R sinΘ, 0, R cosΘ)."""
    R, theta, phi = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in (R, theta, phi)))
    flat = np.stack([R * np.sin(theta), np.zeros_like(R), R * np.cos(theta), np.ones_like(R)], axis=-1)
    return np.asarray(np.einsum("...ij,...j->...i", mirror_matrix(phi, D)[..., :3, :], flat))


def shot_from_point(point: ArrayLike, D: float) -> tuple[Floats, Floats, Floats]:
    """Return (R, Θ, φ) of points of shape (..., 3): the exact inverse of eq 3.

    The distance from the second axis is q = R cosΘ − D, so with q = hypot(y, z − D):
    φ = atan2(y, z − D), Θ = atan2(x, q + D), R = hypot(x, q + D). Valid for R cosΘ > D, |φ| < π.
    """
    x, y, z = np.moveaxis(np.asarray(point, dtype=np.float64), -1, 0)
    q = np.hypot(y, z - D)
    return np.hypot(x, q + D), np.arctan2(x, q + D), np.arctan2(y, z - D)


def image_of_point(
    point: ArrayLike, theta: ArrayLike, phi: ArrayLike, f: float, d: float, D: float
) -> tuple[Floats, Floats]:
    """Return where any point (shape (..., 3)) images while the mirrors stand at (Θ, φ): (p, q) [m].

    Central projection through the node: with v = point − node, p = −f (v·n)/(v·u) along the sensor and
    q = f (v·m)/(v·u) along its height. Valid in front of the lens, v·u > 0.
    """
    u, n, m = scanner_axes(theta, phi)
    v = np.asarray(point, dtype=np.float64) - lens_node(phi, D, d)
    depth = np.sum(v * u, axis=-1)
    return -f * np.sum(v * n, axis=-1) / depth, f * np.sum(v * m, axis=-1) / depth


def range_to_plane(theta: ArrayLike, phi: ArrayLike, D: float, point: ArrayLike, normal: ArrayLike) -> Floats:
    """Return the range R at which the beam's axis meets a plane; NaN where it does not, or from behind.

    The plane goes through ``point`` (3,) [m] with the normal ``normal`` (3,), of any length:
    R = N·(point − origin) / N·u.
    """
    u = scanner_axes(theta, phi)[0]
    normal = np.asarray(normal, dtype=np.float64)
    towards = u @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        R = (np.asarray(point, dtype=np.float64) - laser_origin(phi, D)) @ normal / towards
    return np.asarray(np.where(np.isfinite(R) & (R > 0.0), R, np.nan))


def range_to_sphere(theta: ArrayLike, phi: ArrayLike, D: float, centre: ArrayLike, radius: float) -> Floats:
    """Return the range R at which the beam's axis first meets a sphere; NaN where it passes by.

    R is the smaller root of |origin + R u − centre|² = radius², for an origin outside the sphere.
    """
    u = scanner_axes(theta, phi)[0]
    to_centre = np.asarray(centre, dtype=np.float64) - laser_origin(phi, D)
    along = np.sum(u * to_centre, axis=-1)
    squared = along**2 - np.sum(to_centre**2, axis=-1) + radius**2
    with np.errstate(invalid="ignore"):
        R = along - np.sqrt(squared)
    return np.asarray(np.where(R > 0.0, R, np.nan))


def range_error(R: ArrayLike, theta: ArrayLike, f: float, d: float, dp: ArrayLike) -> Floats:
    """Return ΔR = (R − d sinΘ)² / (f d cosΘ) · Δp [m]: |∂R/∂p| of eq 1, the exact form of eq 4."""
    R, theta = np.asarray(R, dtype=np.float64), np.asarray(theta, dtype=np.float64)
    return np.asarray((R - d * np.sin(theta)) ** 2 / (f * d * np.cos(theta)) * np.asarray(dp))


def range_error_printed(R: ArrayLike, f: float, d: float, dp: ArrayLike) -> Floats:
    """Return ΔR = R² Δp / (f d) [m]: eq 4 as printed, good on the axis (Θ = 0) only."""
    return np.asarray(np.asarray(R, dtype=np.float64) ** 2 / (f * d) * np.asarray(dp))


def shot_jacobian(R: ArrayLike, theta: ArrayLike, phi: ArrayLike, f: float, d: float, D: float) -> Floats:
    """Return ∂(x, y, z, R)/∂(p, Θ, φ) in triangulation, shape (..., 4, 3).

    R depends on p and, at fixed p, on Θ: ∂R/∂p = −(R − d sinΘ)²/(f d cosΘ) and
    ∂R/∂Θ = −f d sinΘ/p + d cosΘ = −(R − d sinΘ) tanΘ + d cosΘ. With X = origin(φ) + R u(Θ, φ):
    ∂X/∂p = u ∂R/∂p, ∂X/∂Θ = u ∂R/∂Θ + R n, ∂X/∂φ = (R cosΘ − D) m. Derived from eqs 1 and 3.
    """
    R, theta, phi = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in (R, theta, phi)))
    u, n, m = scanner_axes(theta, phi)
    depth = R - d * np.sin(theta)
    by_p = -(depth**2) / (f * d * np.cos(theta))
    by_theta = -depth * np.tan(theta) + d * np.cos(theta)
    jacobian = np.zeros((*R.shape, 4, 3))
    jacobian[..., :3, 0] = u * by_p[..., None]
    jacobian[..., :3, 1] = u * by_theta[..., None] + n * R[..., None]
    jacobian[..., :3, 2] = m * (R * np.cos(theta) - D)[..., None]
    jacobian[..., 3, 0], jacobian[..., 3, 1] = by_p, by_theta
    return jacobian


def propagated_errors(
    R: ArrayLike,
    theta: ArrayLike,
    phi: ArrayLike,
    f: float,
    d: float,
    D: float,
    dp: float,
    dtheta: float,
    dphi: float,
) -> Floats:
    """Return the standard deviations of (x, y, z, R) [m], shape (..., 4), from independent errors.

    Square root of the sum over the columns of (:func:`shot_jacobian` · σ)²; first order in the errors
    ``dp`` [m], ``dtheta``, ``dphi`` [rad]. The complete form of eq 5.
    """
    scaled = shot_jacobian(R, theta, phi, f, d, D) * np.array([dp, dtheta, dphi])
    return np.asarray(np.sqrt(np.sum(scaled**2, axis=-1)))


def propagated_covariance(
    R: ArrayLike,
    theta: ArrayLike,
    phi: ArrayLike,
    f: float,
    d: float,
    D: float,
    dp: ArrayLike,
    dtheta: ArrayLike,
    dphi: ArrayLike,
) -> Floats:
    """Return the covariance matrix of (x, y, z, R) [m²], shape (..., 4, 4), from independent errors.

    J diag(dp², dtheta², dphi²) Jᵀ with :func:`shot_jacobian`; first order in the errors ``dp`` [m], ``dtheta``,
    ``dphi`` [rad], which may be numbers or arrays.
    """
    jacobian = shot_jacobian(R, theta, phi, f, d, D)
    variances = np.stack(np.broadcast_arrays(*(np.square(error) for error in (dp, dtheta, dphi))), axis=-1)
    return np.asarray(np.einsum("...ik,...k,...jk->...ij", jacobian, variances, jacobian))


def swept_image(
    theta: float,
    phi: float,
    travel: tuple[float, float],
    f: float,
    d: float,
    D: float,
    point: ArrayLike,
    normal: ArrayLike,
) -> tuple[float, float]:
    """Return mean and standard deviation of p [m] of the light while the mirrors sweep over a matt plane.

    p(Θ, φ) of the beam's axis by :func:`range_to_plane` and :func:`image_position`, averaged by Gauss–Legendre
    quadrature over Θ ± travel/2, φ ± travel/2 with the weight of the light that a Lambertian surface sends to the lens,
    cosθ_o cosθ_l/r²: no expansion. Laser and receiver turn together, so a plane square to the beam leaves p where it
    is, and a slope smears it.

    Parameters
    ----------
    theta, phi, travel
        Deflections in the middle and their changes from first to last [rad].
    f, d, D
        Focal length, base and axis separation [m].
    point, normal
        A point of the plane [m] and its normal of any length, shape (3,).
    """
    nodes, weights = np.polynomial.legendre.leggauss(16)
    theta_now, phi_now = theta + 0.5 * travel[0] * nodes, phi + 0.5 * travel[1] * nodes
    R = range_to_plane(theta_now, phi_now, D, point, normal)
    sight = point_from_shot(R, theta_now, phi_now, D) - lens_node(phi_now, D, d)
    along = scanner_axes(theta_now, phi_now)[0]
    facing = np.abs(sight @ np.asarray(normal, dtype=np.float64)) * np.sum(sight * along, axis=-1)
    weights = weights * facing / np.sum(sight**2, axis=-1) ** 2
    weights /= weights.sum()
    p = image_position(R, theta_now, f, d)
    mean = float(p @ weights)
    return mean, float(np.sqrt((p - mean) ** 2 @ weights))


def propagated_errors_printed(
    R: ArrayLike,
    theta: ArrayLike,
    phi: ArrayLike,
    f: float,
    d: float,
    dp: float,
    dtheta: float,
    dphi: float,
) -> Floats:
    """Return the standard deviations of (x, y, z) [m], shape (..., 3): eq 5 as printed.

    It takes R as measured independently of Θ (right for time of flight, an approximation in triangulation),
    uses eq 4 as printed and leaves D out against R.
    """
    R, theta, phi = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in (R, theta, phi)))
    s, c, sp, cp = np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi)
    by_range = np.stack([s, c * sp, c * cp], axis=-1) * range_error_printed(R, f, d, dp)[..., None]
    by_theta = np.stack([c, -s * sp, -s * cp], axis=-1) * (R * dtheta)[..., None]
    by_phi = np.stack([np.zeros_like(s), cp, -sp], axis=-1) * (R * c * dphi)[..., None]
    return np.asarray(np.sqrt(by_range**2 + by_theta**2 + by_phi**2))
