"""The mirrors' way from the end of one pattern to the start of the next."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.errors import InputError
from scanner_sim.optics.galvanometer import Galvanometers, MirrorState, at_rest
from scanner_sim.optics.jump import jump_duration, jump_path, jump_time, latest_settling

Array = NDArray[np.float64]

_RECOVERY_SPEED = 2.0
"""Speed over lag · acceleration limit up to which a servo that has fallen behind comes back without passing by.

At its limit a it turns at the distance 2ζv/ω from the command, and needs v²/2a to stop: less as long as v < 4ζa/ω, two
lags' worth of a. Beyond that it swings from limit to limit, further than the command ever went.
"""
MOST_UPDATES = 5_000_000
"""Updates of the drive's command in one visit, way and pattern: a gigabyte."""
_TURN_SHARES = (np.arange(16) + 0.5) / 16
"""Instants of a turn, over its duration, at which its acceleration is looked at."""


@dataclass(frozen=True)
class MirrorPair:
    """Both mirrors between two visits, Θ first.

    Attributes
    ----------
    state
        State of the servos, each array of shape (2,).
    slope
        Rate of the last command [rad/s], shape (2,).
    time
        When that was [s].
    """

    state: MirrorState
    slope: Array
    time: float = 0.0


def mirrors_at(theta: float, phi: float) -> MirrorPair:
    """Return mirrors that rest at (Θ, φ) [rad] at time 0."""
    return MirrorPair(at_rest(np.array([theta, phi])), np.zeros(2))


def resume_state(galvanometers: Galvanometers, mirrors: MirrorPair) -> tuple[MirrorState, Array]:
    """Return the state from which the next command goes on, and the command's rate [rad/s], shape (2,).

    A mirror that its limits kept from the last pattern is not where the command was: towards a command that went on
    there it would swing at its limits. Its command begins anew on the ramp u = x + (2ζ/ω) x′, which the mirror follows
    from where it is without any acceleration.
    """
    angle, rate, command = mirrors.state
    ramp = angle + galvanometers.lag * rate
    most = galvanometers.acceleration
    kept = np.abs(command - ramp) > most / galvanometers.omega**2
    kept |= np.abs(rate - mirrors.slope) > _RECOVERY_SPEED * galvanometers.lag * most
    if not kept.any():
        return mirrors.state, mirrors.slope
    return MirrorState(angle, rate, np.where(kept, ramp, command)), np.where(kept, rate, mirrors.slope)


def way_between(
    galvanometers: Galvanometers,
    origin: Array,
    leaving: Array,
    turnaround: float,
    goal: Array,
    arriving: Array,
    step: float,
    given: float,
    near: float,
) -> Array:
    """Return the commands from the last pattern to the next, shape (2, updates), which ends at the pattern's start.

    They go from ``origin`` with the rate ``leaving`` to ``goal`` with the rate ``arriving``, in the ``given`` time or
    longer. Where the goal is near and time is short, one parabola or cubic turns the mirrors round in ``turnaround``.
    Else they brake for half of it, jump from rest to rest and settle, and speed up for the other half. A large pattern
    is too fast for that: braking, speeding up and turning take as long as the limits want.
    """
    most = galvanometers.jump_share * galvanometers.acceleration
    close = np.abs(goal - origin).max() <= near
    short = max(given, turnaround)
    slips = close and _falls_behind(galvanometers, goal - origin, leaving, arriving, short)
    if close and not slips and given < turnaround + 0.5 * step:
        return _turn(origin, leaving, goal, arriving, step, round(short / step))
    fastest = galvanometers.jump_share * galvanometers.slew
    # What is faster than the mirrors cannot be followed anyway; the way does not try.
    launched = np.clip(arriving, -fastest, fastest)
    braking, speeding = (max(0.5 * turnaround, np.abs(rate).max() / most) for rate in (leaving, launched))
    rest, launch = origin + 0.5 * braking * leaving, goal - 0.5 * speeding * launched
    distance = np.abs(launch - rest)
    duration = float(jump_duration(galvanometers, distance).max())
    needed = braking + latest_settling(galvanometers, duration) + speeding
    if given < needed:  # When it has settled indeed is costly, and of no interest while there is time.
        needed = braking + float(jump_time(galvanometers, distance.max())) + speeding
    if close and given < needed:
        if slips:
            # 6 |D|/T² + |4v + 2w|/T bounds a cubic's acceleration: it is within the limit from this T on.
            linear = np.maximum(
                np.abs(4.0 * leaving + 2.0 * arriving), np.abs(2.0 * leaving + 4.0 * arriving)
            )
            root = np.sqrt(linear**2 + 24.0 * most * np.abs(goal - origin))
            short = max(short, float((linear + root).max()) / (2.0 * most))
        if not slips or short < needed:
            return _turn(origin, leaving, goal, arriving, step, round(short / step))
    # A step more, never less: the jump has settled when the mirrors speed up.
    count = math.ceil(max(given, needed) / step - 1e-6)
    if count > MOST_UPDATES:
        raise InputError(
            f"The mirrors' way to a pattern takes {count * step:.3g} s, {count:,} updates of the drive's command; "
            f"{MOST_UPDATES:,} are possible.",
            remedy="Lower scanner.rate or scan.visiting.updates, or raise the limits of scanner.galvanometers.",
        )
    time: Array = step * np.arange(1, count + 1, dtype=np.float64)
    path = jump_path(galvanometers, rest, launch, time - braking, np.full(2, duration))
    if braking > 0.0:
        path -= 0.5 * leaving[:, None] * np.maximum(braking - time, 0.0) ** 2 / braking
    if speeding > 0.0:
        path += 0.5 * launched[:, None] * np.maximum(time - (count * step - speeding), 0.0) ** 2 / speeding
    return path


def _turn(origin: Array, leaving: Array, goal: Array, arriving: Array, step: float, count: int) -> Array:
    """Return the cubic through angles and rates at both ends of so many updates, shape (2, count)."""
    s = np.arange(1, count + 1) / max(count, 1)
    duration = count * step
    return np.asarray(
        origin[:, None] * (1.0 + 2.0 * s) * (1.0 - s) ** 2
        + (duration * leaving)[:, None] * s * (1.0 - s) ** 2
        + goal[:, None] * s**2 * (3.0 - 2.0 * s)
        - (duration * arriving)[:, None] * s**2 * (1.0 - s)
    )


def _falls_behind(
    galvanometers: Galvanometers, distance: Array, leaving: Array, arriving: Array, duration: float
) -> bool:
    """Return whether a cubic over distances, shape (2,), demands so much that the mirrors never catch up.

    Its acceleration runs straight from (6D/T − 4v − 2w)/T to (2v + 4w − 6D/T)/T. What of its integral lies beyond the
    limit, one way or the other, is speed that the mirrors lack.
    """
    most = galvanometers.acceleration
    enough = _RECOVERY_SPEED * galvanometers.lag * most
    if duration <= 0.0:
        # A step of angle D ends in the speed √(2aD).
        return bool(
            (np.abs(arriving - leaving) > enough).any() or (2.0 * most * np.abs(distance) > enough**2).any()
        )
    even = 6.0 / duration * distance
    first, last = even - 4.0 * leaving - 2.0 * arriving, 2.0 * leaving + 4.0 * arriving - even
    if max(np.abs(first).max(), np.abs(last).max()) <= most * duration:
        return False
    asked = first[:, None] * (1.0 - _TURN_SHARES) + last[:, None] * _TURN_SHARES
    beyond = np.maximum(np.abs(asked) - most * duration, 0.0) * np.sign(asked)
    lacking = np.maximum(np.maximum(beyond, 0.0).mean(axis=1), np.maximum(-beyond, 0.0).mean(axis=1))
    return bool(lacking.max() > enough)
