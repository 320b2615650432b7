"""Jumps of the mirrors between directions: the shortest command within their limits, and when they settle."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.optics.galvanometer import Galvanometers, at_rest, follow, response

Array = NDArray[np.float64]

_SETTLING_STEP = 5e-6
"""Update interval [s] at which a jump's settling is looked at."""
_MOST_SETTLING_STEPS = 1_000_000
"""Intervals of a jump: those of one that takes longer than five seconds are longer."""
_SETTLING_TIME_CONSTANTS = 25.0
"""Time constants 1/(ζω) for which it is looked at: e⁻²⁵ of any jump is nothing."""


def jump_duration(galvanometers: Galvanometers, distance: ArrayLike) -> Array:
    """Return the time [s] of the shortest command from rest to rest over distances [rad], any shape.

    With the shares v and a of slew and acceleration: 2√(D/a) as long as it is no more than 2 v/a, else D/v + v/a.
    """
    D = np.abs(np.asarray(distance, dtype=np.float64))
    v, a = _limits(galvanometers)
    return np.where(v**2 / a > D, 2.0 * np.sqrt(D / a), D / v + v / a)


def jump_path(
    galvanometers: Galvanometers, start: ArrayLike, goal: ArrayLike, time: Array, duration: ArrayLike = 0.0
) -> Array:
    """Return the commanded angles of jumps at times since they began, shape (..., times) [rad].

    Parameters
    ----------
    galvanometers
        The servos.
    start, goal
        Angles [rad], shape (...,).
    time
        Times [s], shape (times,); before 0 the mirror is at the start, after the end at the goal.
    duration
        Stretches jumps that could be shorter to this [s]: the one of two mirrors that has less to go waits for the
        other. Broadcasts with ``start``.

    Returns
    -------
    ndarray
        Even acceleration, even speed, even deceleration.
    """
    first = np.asarray(start, dtype=np.float64)[..., None]
    way = np.asarray(goal, dtype=np.float64)[..., None] - first
    distance = np.abs(way)
    shortest = jump_duration(galvanometers, distance)
    longest = np.maximum(shortest, np.asarray(duration, dtype=np.float64)[..., None])
    still = shortest == 0.0
    share = np.where(still, 0.0, shortest / np.where(still, 1.0, longest))
    t = np.minimum(np.maximum(time * share, 0.0), shortest)
    v, a = _limits(galvanometers)
    ramp = np.minimum(v / a, 0.5 * shortest)
    top = a * ramp
    rising = 0.5 * a * np.minimum(t, ramp) ** 2
    even = top * np.minimum(np.maximum(t - ramp, 0.0), shortest - 2.0 * ramp)
    left = np.minimum(np.maximum(t - (shortest - ramp), 0.0), ramp)
    gone = rising + even + left * (top - 0.5 * a * left)
    return np.asarray(first + np.sign(way) * gone)


def jump_time(galvanometers: Galvanometers, distance: ArrayLike) -> Array:
    """Return the times [s] after which jumps over distances [rad] have settled, any shape.

    The servo follows :func:`jump_path`; settled means that it stays within ``settled`` of the goal. Resolved to 5 µs,
    and to a millionth of jumps that take longer than 5 s.
    """
    far = np.atleast_1d(np.abs(np.asarray(distance, dtype=np.float64)))
    last, step = _looked_at(galvanometers, float(np.max(jump_duration(galvanometers, far), initial=0.0)))
    time: Array = step * np.arange(1, math.ceil(last / step) + 1, dtype=np.float64)
    flat = far.reshape(-1)
    command = jump_path(galvanometers, np.zeros_like(flat), flat, time)
    motion, _ = follow(galvanometers, at_rest(np.zeros_like(flat)), command, step)
    away = np.abs(motion.true - flat[:, None]) > galvanometers.settled
    updates = np.where(away.any(axis=1), away.shape[1] - np.argmax(away[:, ::-1], axis=1), 0)
    # One that was never away has not jumped at all.
    jumped = np.where(flat > galvanometers.settled, updates + 1, 0)
    return (step * jumped).reshape(np.shape(distance))


def latest_settling(galvanometers: Galvanometers, duration: float) -> float:
    """Return a time [s] that is no less than :func:`jump_time` of a jump whose command lasts a ``duration`` [s]."""
    last, step = _looked_at(galvanometers, duration)
    return last + 2.0 * step


def _looked_at(galvanometers: Galvanometers, duration: float) -> tuple[float, float]:
    """Return for how long a jump is looked at whose command lasts a ``duration``, and in what steps [s]."""
    last = duration + _SETTLING_TIME_CONSTANTS / (galvanometers.damping * galvanometers.omega)
    return last, max(_SETTLING_STEP, last / _MOST_SETTLING_STEPS)


def attainable_amplitude(galvanometers: Galvanometers, frequency: ArrayLike) -> Array:
    """Return the largest commanded amplitude [rad] of a sine of frequencies f [Hz] that the mirrors follow freely.

    min(v_max/Ω, a_max/Ω²)/|H|, Ω = 2π f: beyond it the motion is no longer a sine.
    """
    rate = 2.0 * math.pi * np.asarray(frequency, dtype=np.float64)
    gain = np.abs(response(galvanometers, frequency))
    return np.minimum(galvanometers.slew / rate, galvanometers.acceleration / rate**2) / gain


def attainable_frequency(galvanometers: Galvanometers, amplitude: float) -> float:
    """Return the highest frequency [Hz] of a sine of a commanded amplitude [rad] that the mirrors follow freely.

    The attainable amplitude falls with the frequency where |H| does not rise faster than f: that is so for every
    damping up to the natural frequency, where the search ends.
    """
    low, high = 1e-6 * galvanometers.natural_frequency, galvanometers.natural_frequency
    for _ in range(60):
        middle = math.sqrt(low * high)
        if float(attainable_amplitude(galvanometers, middle)) > amplitude:
            low = middle
        else:
            high = middle
    return low


def _limits(galvanometers: Galvanometers) -> tuple[float, float]:
    """Return the speed and acceleration that a jump's command asks for."""
    return (
        galvanometers.jump_share * galvanometers.slew,
        galvanometers.jump_share * galvanometers.acceleration,
    )
