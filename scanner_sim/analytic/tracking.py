"""The response of a disc under a Gaussian spot by integration, and the bound on its centre.

Nothing is approximated: the spot's irradiance is integrated over the disc in polar coordinates, which gives a Bessel
function, and along the travel of a dwell by a dense sum. The bound on the centre is that of Cramér and Rao for
unbiased estimates and independent normal errors; the disc's radius and the signals on it and off it are unknown too.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ive

Array = NDArray[np.float64]


def spot_on_disc(distance: Array, radius: float, spot: float) -> Array:
    """Return the share of a Gaussian spot (standard deviation ``spot``) on a disc at distances of their centres.

    ∫₀^r (t/s²) exp(−(t² + ρ²)/2s²) I₀(tρ/s²) dt, by 400 Gauss–Legendre points over the part of [0, r] within nine s of
    the spot's middle; equals 1 − Q₁(ρ/s, r/s), Marcum's function.
    """
    node, weight = np.polynomial.legendre.leggauss(400)
    rho = np.asarray(distance, dtype=np.float64)[..., None]
    low = np.clip(rho - 9.0 * spot, 0.0, radius)
    high = np.clip(rho + 9.0 * spot, 0.0, radius)
    t = 0.5 * (high + low) + 0.5 * (high - low) * node
    kernel = t / spot**2 * np.exp(-0.5 * ((t - rho) / spot) ** 2) * ive(0, t * rho / spot**2)
    return np.asarray((0.5 * (high - low) * weight * kernel).sum(axis=-1))


def disc_signal(
    place: Array, travel: Array, centre: Array, radius: float, spot: float, levels: tuple[float, float]
) -> Array:
    """Return the mean signal of dwells, shape (...).

    Parameters
    ----------
    place, travel
        Angles in the middle of the dwell, and by how much they change during it, shape (..., 2) [rad].
    centre
        The disc's, shape (2,) [rad].
    radius, spot
        Of disc and spot [rad].
    levels
        Signal on the disc and off it.

    Notes
    -----
    The travel is a straight line of 24 even pieces.
    """
    on, off = levels
    share = (np.arange(24) + 0.5) / 24 - 0.5
    path = place[..., None, :] + share[:, None] * travel[..., None, :] - centre
    grid, table = _table(radius, spot)
    hit = np.interp(np.hypot(path[..., 0], path[..., 1]), grid, table, left=1.0, right=0.0)
    return np.asarray(off + (on - off) * hit.mean(axis=-1))


@lru_cache(maxsize=16)
def _table(radius: float, spot: float) -> tuple[Array, Array]:
    """Return the response at fine distances, s/50 apart, between which it is linear enough."""
    grid = np.linspace(radius - 9.0 * spot, radius + 9.0 * spot, 901)
    return grid, spot_on_disc(np.maximum(grid, 0.0), radius, spot)


def centre_bound(
    place: Array,
    travel: Array,
    radius: float,
    spot: float,
    levels: tuple[float, float],
    sigma: float,
) -> Array:
    """Return the least covariance of (c_Θ, c_φ) of a disc at the origin, shape (2, 2) [rad²].

    Inverse of Fisher's information Σ ∂m ∂mᵀ/σ² over (c_Θ, c_φ, r, on, off), by central differences. ``sigma`` is the
    standard deviation of each signal; the other arguments are those of :func:`disc_signal`, shape (points, 2).
    """

    def signal(x: Array) -> Array:
        return disc_signal(place, travel, x[:2], float(x[2]), spot, (float(x[3]), float(x[4])))

    at = np.array([0.0, 0.0, radius, *levels])
    steps = np.array([0.02 * spot, 0.02 * spot, 0.02 * spot, 1e-3 * levels[1], 1e-3 * levels[1]])
    slopes = np.stack([(signal(at + d) - signal(at - d)) / (2.0 * d.sum()) for d in np.diag(steps)], axis=-1)
    return np.asarray(np.linalg.inv(slopes.T @ slopes / sigma**2)[:2, :2])
