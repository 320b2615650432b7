"""Covariance of the measured point: the full Jacobian of eqs 1 and 3, carried out in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PointCovariance:
    """Covariances of (x, y, z) [m²], arrays of shape (n,): ``xx`` is x's variance, ``xy`` the covariance with y."""

    xx: Array
    yy: Array
    zz: Array
    xy: Array
    xz: Array
    yz: Array


def point_covariance(
    r: ArrayLike,
    theta: ArrayLike,
    phi: ArrayLike,
    axis_separation: float,
    sigma_range: ArrayLike,
    range_by_theta: ArrayLike,
    sigma_theta: ArrayLike,
    sigma_phi: ArrayLike,
) -> PointCovariance:
    """Return the covariance of points from independent errors of range, Θ and φ.

    Parameters
    ----------
    r, theta, phi
        Range R [m] and deflections [rad], shape (n,).
    axis_separation
        D_g [m].
    sigma_range
        Standard deviation of R at fixed Θ [m]: what peak and synchronisation contribute.
    range_by_theta
        ∂R/∂Θ of the ranging [m/rad]: −(R − d sinΘ) tanΘ + d cosΘ in triangulation, where the position on the sensor
        is what was measured; 0 where R is measured apart from Θ, as in time of flight (eq 5 as printed).
    sigma_theta, sigma_phi
        Standard deviations of the deflections [rad].

    Returns
    -------
    PointCovariance
        J diag(σ²) Jᵀ to first order. In the plane of triangulation the point is (x, ρ) = (R sinΘ, R cosΘ − D_g), so
        Θ moves it by (R' sinΘ + R cosΘ, R' cosΘ − R sinΘ) with R' = ∂R/∂Θ, the range by (sinΘ, cosΘ). φ moves it
        across by t = ρ δφ. Then y = ρ sinφ + t cosφ and z − D_g = ρ cosφ − t sinφ (Blais, Beraldin, El-Hakim 2000,
        eq 3).
    """
    r, theta, phi, range_by_theta, sigma_phi = (
        np.asarray(value, dtype=np.float64) for value in (r, theta, phi, range_by_theta, sigma_phi)
    )
    sine, cosine = np.sin(theta), np.cos(theta)
    by_range, by_theta = np.square(sigma_range), np.square(sigma_theta)
    move_x, move_reach = range_by_theta * sine + r * cosine, range_by_theta * cosine - r * sine
    xx = sine * sine * by_range + move_x * move_x * by_theta
    reach = cosine * cosine * by_range + move_reach * move_reach * by_theta
    joint = sine * cosine * by_range + move_x * move_reach * by_theta
    across = ((r * cosine - axis_separation) * sigma_phi) ** 2
    sine, cosine = np.sin(phi), np.cos(phi)
    return PointCovariance(
        xx=xx,
        yy=sine * sine * reach + cosine * cosine * across,
        zz=cosine * cosine * reach + sine * sine * across,
        xy=sine * joint,
        xz=cosine * joint,
        yz=sine * cosine * (reach - across),
    )


def shaken_covariance(x: ArrayLike, y: ArrayLike, z: ArrayLike, turn: float, shift: float) -> PointCovariance:
    """Return the covariance of points that a scanner measures which has turned and shifted as a whole.

    Parameters
    ----------
    x, y, z
        Points in the scanner frame [m], shape (n,).
    turn, shift
        Standard deviations of its turn about and its shift along each axis [rad, m], independent.

    Returns
    -------
    PointCovariance
        A scanner that has turned by ω and shifted by s sees P as P − ω × P − s: σ_ω² (|P|² 1 − P Pᵀ) + σ_s² 1. The
        range along the beam is what it is.
    """
    x, y, z = (np.asarray(value, dtype=np.float64) for value in (x, y, z))
    a, b = turn * turn, shift * shift
    return PointCovariance(
        xx=a * (y * y + z * z) + b,
        yy=a * (x * x + z * z) + b,
        zz=a * (x * x + y * y) + b,
        xy=-a * x * y,
        xz=-a * x * z,
        yz=-a * y * z,
    )
