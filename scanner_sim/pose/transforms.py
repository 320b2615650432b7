"""Rotations and their spellings: matrices, rotation vectors, quaternions, yaw-pitch-roll.

Rotations are ``target_from_source`` and multiply columns. A *perturbed* pose is, everywhere in this package,

    position + δt,    exp([δω]×) rotation,

with δt and δω along the axes of the target frame (the scanner's): a covariance of a pose is that of
(δt_x, δt_y, δt_z, δω_x, δω_y, δω_z).

**Yaw, pitch, roll** turn an object whose axes are the scanner's (x right, y down, z forward), as aviation has it for an
object that looks along z: rotation = R_y(yaw) R_x(pitch) R_z(roll); yaw turns to the right, pitch upwards, roll lowers
the right-hand side. Pitch lies within ±90°, where yaw and roll become one angle.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from scanner_sim.foundation.arithmetic import arcsin, arctan2, product

Array = NDArray[np.float64]


def _through_scipy(rotation: ArrayLike, spell: Callable[[Rotation], Array], length: int) -> Array:
    """Spell matrices (..., 3, 3) as (..., length); NaN stays NaN, where SciPy would refuse the whole array."""
    matrices = np.asarray(rotation, dtype=np.float64)
    flat = matrices.reshape(-1, 3, 3)
    known = np.isfinite(flat).all(axis=(1, 2))
    spelt = np.full((len(flat), length), np.nan)
    if known.any():
        spelt[known] = spell(Rotation.from_matrix(flat[known]))
    return spelt.reshape(*matrices.shape[:-2], length)


def rotation_from_vector(vector: ArrayLike) -> Array:
    """Return exp([ω]×), shape (..., 3, 3), of rotation vectors ω [rad] (..., 3): turn by |ω| about ω (Rodrigues)."""
    omega = np.asarray(vector, dtype=np.float64)
    matrices: Array = np.moveaxis(exponential(np.moveaxis(omega, -1, 0)), (0, 1), (-2, -1))
    return matrices


def turn_jacobian(vector: ArrayLike) -> Array:
    """Return J with exp([ω + δ]×) = exp([J δ]×) exp([ω]×) to first order, shape (..., 3, 3), of ω [rad] (..., 3).

    J = s I + c [ω]× + (1 − s) ωωᵀ/|ω|² with s = sin|ω|/|ω|, c = (1 − cos|ω|)/|ω|² (Barfoot, *State Estimation for
    Robotics*, 2017, section 7.1.5).
    """
    omega = np.asarray(vector, dtype=np.float64)
    squared = np.sum(omega * omega, axis=-1)
    turns = np.sqrt(squared) / np.pi
    sine, half = np.sinc(turns), np.sinc(0.5 * turns)
    small = squared < 1e-4
    along = np.where(small, 1.0 / 6.0 - squared / 120.0, (1.0 - sine) / np.where(small, 1.0, squared))
    sine, versine, along = (part[..., None, None] for part in (sine, 0.5 * half * half, along))
    alike = along * omega[..., :, None] * omega[..., None, :]
    return np.asarray(sine * np.eye(3) + versine * cross_matrix(omega) + alike)


def vector_from_rotation(rotation: ArrayLike) -> Array:
    """Return the rotation vectors ω [rad], shape (..., 3), of matrices (..., 3, 3); |ω| ≤ π."""
    return _through_scipy(rotation, lambda turn: turn.as_rotvec(), 3)


def rates_between(first: Array, then: Array, time: ArrayLike) -> tuple[Array, Array]:
    """Return velocity v [m/s] and turn rate ω [rad/s] of even motions from pose to pose, each (n, 3).

    They are those of x₀ + v t, exp([ω t]×) R₀, with less than half a turn between both.

    Parameters
    ----------
    first, then
        Poses at the begin and at the end, shape (n, 4, 4).
    time
        From one to the other [s], one for all or of shape (n,).
    """
    passed = np.reshape(time, (-1, 1))
    turned = product(then[:, :3, :3], np.swapaxes(first[:, :3, :3], 1, 2))
    return (then[:, :3, 3] - first[:, :3, 3]) / passed, vector_from_rotation(turned) / passed


def quaternion_from_rotation(rotation: ArrayLike) -> Array:
    """Return unit quaternions (w, x, y, z), w ≥ 0, shape (..., 4), of matrices (..., 3, 3)."""
    return _through_scipy(rotation, lambda turn: turn.as_quat(canonical=True)[:, [3, 0, 1, 2]], 4)


def rotation_from_quaternion(quaternion: ArrayLike) -> Array:
    """Return matrices (..., 3, 3) of quaternions (w, x, y, z) of any length but zero, shape (..., 4)."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion, dtype=np.float64), -1, 0)
    two = 2.0 / (w * w + x * x + y * y + z * z)
    rows = [
        [1.0 - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
        [two * (x * y + w * z), 1.0 - two * (x * x + z * z), two * (y * z - w * x)],
        [two * (x * z - w * y), two * (y * z + w * x), 1.0 - two * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def yaw_pitch_roll_from_rotation(rotation: ArrayLike) -> Array:
    """Return (yaw, pitch, roll) [rad], shape (..., 3), of matrices (..., 3, 3).

    yaw = atan2(r₀₂, r₂₂), pitch = −asin r₁₂, roll = atan2(r₁₀, r₁₁).
    """
    r = np.asarray(rotation, dtype=np.float64)
    pitch = -arcsin(np.clip(r[..., 1, 2], -1.0, 1.0))
    yaw, roll = arctan2(r[..., 0, 2], r[..., 2, 2]), arctan2(r[..., 1, 0], r[..., 1, 1])
    return np.stack([yaw, pitch, roll], axis=-1)


def rotation_from_yaw_pitch_roll(angles: ArrayLike) -> Array:
    """Return R_y(yaw) R_x(pitch) R_z(roll), shape (..., 3, 3), of angles [rad], shape (..., 3)."""
    yaw, pitch, roll = np.moveaxis(np.asarray(angles, dtype=np.float64), -1, 0)
    zero = np.zeros_like(yaw)
    turned = [
        rotation_from_vector(np.stack(vector, axis=-1))
        for vector in ((zero, yaw, zero), (pitch, zero, zero), (zero, zero, roll))
    ]
    result: Array = product(*turned)
    return result


def cross_matrix(vector: Array) -> Array:
    """Return [v]× with [v]× w = v × w, shape (..., 3, 3), of vectors (..., 3)."""
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vector.shape[:-1], 3, 3)


def cayley(omega: Array) -> Array:
    """Return the rotations of the quaternions (1, ω/2), with the batch last: (3, 3, B) of (3, B).

    They are exp([ω]×) to second order, without its sines: steps of an adjustment need no more.
    """
    half = 0.5 * omega
    two = 2.0 / (1.0 + np.einsum("ib,ib->b", half, half))
    x2, y2, z2 = scaled = two * half
    matrix = np.empty((3, 3, *two.shape))
    xy, xz, yz = half[0] * y2, half[0] * z2, half[1] * z2
    xx, yy, zz = half * scaled
    matrix[0, 0], matrix[1, 1], matrix[2, 2] = 1.0 - yy - zz, 1.0 - xx - zz, 1.0 - xx - yy
    matrix[0, 1], matrix[1, 0] = xy - z2, xy + z2
    matrix[0, 2], matrix[2, 0] = xz + y2, xz - y2
    matrix[1, 2], matrix[2, 1] = yz - x2, yz + x2
    return matrix


def exponential(omega: Array) -> Array:
    """Return exp([ω]×) with the batch last: (3, 3, ...) of (3, ...).

    Rodrigues' formula I + s [ω]× + c (ωωᵀ − |ω|² I) with s = sin|ω|/|ω|, c = (1 − cos|ω|)/|ω|², both through sinc,
    which is smooth at zero.
    """
    squared = np.sum(omega * omega, axis=0)
    turns = np.sqrt(squared) / np.pi
    sine, half = np.sinc(turns), np.sinc(0.5 * turns)
    versine = 0.5 * half * half
    matrix: Array = (versine * omega)[:, None] * omega[None]
    x, y, z = sine * omega
    matrix[0, 1] -= z
    matrix[0, 2] += y
    matrix[1, 0] += z
    matrix[1, 2] -= x
    matrix[2, 0] -= y
    matrix[2, 1] += x
    diagonal = np.arange(3)
    matrix[diagonal, diagonal] += 1.0 - versine * squared
    return matrix
