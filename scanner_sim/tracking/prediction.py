"""Where a target will be: a Kalman filter for steady motion in angle and range.

Three lines of algebra on arrays of targets need no library: those for Python take one target at a time, in a loop.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.arithmetic import applied, product, solve_linear

Array = NDArray[np.float64]

AXES = 3
"""Θ, φ and R."""
_POSITION = np.arange(AXES)
_RATE = _POSITION + AXES
_IDENTITY = np.eye(2 * AXES)


class Motion(NamedTuple):
    """What is known of targets at a time, shapes (..., 6), (..., 6, 6), (...).

    ``mean`` holds Θ, φ [rad], R [m] and their rates per second, ``covariance`` theirs, ``time`` is in seconds.
    """

    mean: Array
    covariance: Array
    time: Array


def initiate(position: ArrayLike, covariance: ArrayLike, sigma_rate: ArrayLike, time: ArrayLike) -> Motion:
    """Return motions that begin with a measured position and an unknown rate.

    Parameters
    ----------
    position, covariance
        (Θ, φ, R), shape (..., 3), and its covariance (..., 3, 3).
    sigma_rate
        Standard deviations of the three rates about zero, shape (3,).
    time
        Of the measurement [s], shape (...,).
    """
    here = np.asarray(position, dtype=np.float64)
    whole = np.zeros((*here.shape[:-1], 2 * AXES, 2 * AXES))
    whole[..., :AXES, :AXES] = covariance
    whole[..., AXES:, AXES:] = np.diag(np.asarray(sigma_rate, dtype=np.float64) ** 2)
    return Motion(
        np.concatenate([here, np.zeros_like(here)], axis=-1), whole, np.asarray(time, dtype=np.float64)
    )


def predict(motion: Motion, time: ArrayLike, acceleration_psd: ArrayLike) -> Motion:
    """Return motions at a time.

    Parameters
    ----------
    motion
        What is known before.
    time
        Time [s], shape (...,).
    acceleration_psd
        Spectral densities q of the accelerations of Θ, φ and R, [rad²/s³] and [m²/s³], shape (3,).

    Returns
    -------
    Motion
        x ← F x, P ← F P Fᵀ + Q, rates being steady, Q = q [[Δ³/3, Δ²/2], [Δ²/2, Δ]] of white accelerations (Bar-Shalom,
        Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 6.2.2).
    """
    when = np.asarray(time, dtype=np.float64)
    step = when - motion.time
    onward = np.zeros((*step.shape, 2 * AXES, 2 * AXES)) + _IDENTITY
    noise = np.zeros_like(onward)
    onward[..., _POSITION, _RATE] = step[..., None]
    size = np.abs(step)[..., None]
    density = np.asarray(acceleration_psd, dtype=np.float64)
    noise[..., _POSITION, _POSITION] = density * size**2 * size / 3.0
    noise[..., _RATE, _RATE] = density * size
    noise[..., _POSITION, _RATE] = noise[..., _RATE, _POSITION] = density * size**2 / 2.0
    mean = applied(onward, motion.mean)
    return Motion(mean, product(onward, motion.covariance, np.swapaxes(onward, -1, -2)) + noise, when)


def update(motion: Motion, position: ArrayLike, covariance: ArrayLike) -> tuple[Motion, Array]:
    """Return motions with a measurement taken in: K = P Hᵀ (P_HH + R)⁻¹, x ← x + K (m − H x), in Joseph's form.

    ``motion`` is predicted to the time of the measurement; ``position`` (..., 3) and ``covariance`` (..., 3, 3). Beside
    them the squared Mahalanobis distances of measured from predicted positions, (m − H x)ᵀ (P_HH + R)⁻¹ (m − H x),
    (...).
    """
    noise = np.asarray(covariance, dtype=np.float64)
    away = np.asarray(position, dtype=np.float64) - motion.mean[..., :AXES]
    seen = np.swapaxes(motion.covariance[..., :AXES], -1, -2)
    spread = motion.covariance[..., :AXES, :AXES] + noise
    solved = solve_linear(spread, np.concatenate([seen, away[..., None]], axis=-1))
    gain, surprise = np.swapaxes(solved[..., :-1], -1, -2), (away * solved[..., -1]).sum(axis=-1)
    keep = np.zeros_like(motion.covariance) + _IDENTITY
    keep[..., :AXES] -= gain
    whole = product(keep, motion.covariance, np.swapaxes(keep, -1, -2))
    whole = whole + product(gain, noise, np.swapaxes(gain, -1, -2))
    return Motion(motion.mean + applied(gain, away), whole, motion.time), np.asarray(surprise)
