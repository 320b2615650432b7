"""States of an object and of the chaser that carries the scanner, in one frame, to what a served scanner is told.

A state is a tuple: position [m] (3,), quaternion (w, x, y, z) frame_from_body (4,), velocity [m/s] (3,) and rate of
turn [rad/s] (3,) along the axes of the frame. The scanner sits at the chaser's origin along its axes: x to the right,
y down, z forward.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
State = tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike]


def conjugate(quaternion: ArrayLike) -> Array:
    """Return the inverse of a unit quaternion."""
    return np.asarray(quaternion, dtype=np.float64) * (1.0, -1.0, -1.0, -1.0)


def multiply(one: ArrayLike, other: ArrayLike) -> Array:
    """Return the quaternion of the turn ``other`` and then ``one``."""
    (a, *u), (b, *v) = np.asarray(one, dtype=np.float64), np.asarray(other, dtype=np.float64)
    return np.array([a * b - np.dot(u, v), *(a * np.array(v) + b * np.array(u) + np.cross(u, v))])


def turned(quaternion: ArrayLike, vector: ArrayLike) -> Array:
    """Return a vector that is turned by a quaternion."""
    return multiply(multiply(quaternion, [0.0, *np.asarray(vector)]), conjugate(quaternion))[1:]


def relative(item: State, chaser: State) -> dict[str, list[float]]:
    """Return position, quaternion, velocity and turn_rate of an object as the turning scanner sees it, for ``move``.

    x = Cᵀ (r − r_c), v = Cᵀ (ṙ − ṙ_c − ω_c × (r − r_c)), ω = Cᵀ (ω_o − ω_c), with C = frame_from_chaser.
    """
    position, attitude, velocity, rate = (np.asarray(part, dtype=np.float64) for part in item)
    origin, pointing, speed, turn = (np.asarray(part, dtype=np.float64) for part in chaser)
    back, away = conjugate(pointing), position - origin
    seen = multiply(back, attitude)
    return {
        "position": turned(back, away).tolist(),
        "quaternion": (seen / np.linalg.norm(seen)).tolist(),
        "velocity": turned(back, velocity - speed - np.cross(turn, away)).tolist(),
        "turn_rate": turned(back, rate - turn).tolist(),
    }


def ahead(told: dict[str, list[float]], step: float) -> dict[str, list[float]]:
    """Return the same a short time [s] later, at steady rates."""
    rate = np.array(told["turn_rate"])
    angle = np.linalg.norm(rate) * step
    axis = rate / max(float(np.linalg.norm(rate)), 1e-300)
    turn = np.array([np.cos(0.5 * angle), *(np.sin(0.5 * angle) * axis)])
    position = np.array(told["position"]) + step * np.array(told["velocity"])
    return told | {"position": position.tolist(), "quaternion": multiply(turn, told["quaternion"]).tolist()}
