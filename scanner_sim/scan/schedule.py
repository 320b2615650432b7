"""When which target is visited, and how the mirrors get there (Table 2)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.parts import Count, Part
from scanner_sim.foundation.units import Angle, Time
from scanner_sim.optics.galvanometer import Galvanometers, MirrorState, at_rest, follow, latch
from scanner_sim.optics.jump import (
    attainable_amplitude,
    attainable_frequency,
    jump_duration,
    jump_path,
    jump_time,
    latest_settling,
)
from scanner_sim.scan.lissajous import (
    LissajousPattern,
    figure_angles,
    figure_slopes,
    figures,
    frequencies,
    sample_shares,
)

Array = NDArray[np.float64]

_CATCH_UP_LAGS = 10.0
"""Lags of the servo after which it has caught up with the beginning of a pattern that it can follow."""
_RECOVERY_SPEED = 2.0
"""Speed over lag · acceleration limit up to which a servo that has fallen behind comes back without passing by.

At its limit a it turns at the distance 2ζv/ω from the command, and needs v²/2a to stop: less as long as v < 4ζa/ω, two
lags' worth of a. Beyond that it swings from limit to limit, further than the command ever went.
"""
_LONGEST_APPROACH = 10.0
"""Time [s] before a pattern from which on its way is looked at: mirrors that have waited for longer are at rest."""
MOST_VISITS = 2**25
"""Visits of a run: their shots have 32-bit numbers."""
MOST_UPDATES = 5_000_000
"""Updates of the drive's command in one visit, way and pattern: a gigabyte."""
_TURN_SHARES = (np.arange(16) + 0.5) / 16
"""Instants of a turn, over its duration, at which its acceleration is looked at."""


class Visiting(Part):
    """How the mirrors go from pattern to pattern."""

    turnaround: Time = Field(default=0.2e-3, ge=0.0, le=1.0)
    """Time in which the mirrors turn from the end of a pattern into the next. 0.2 ms make 128 points the printed
    6.6 ms."""
    stated_jump: Angle = Field(default=0.5, ge=0.0, lt=3.0)
    """Longest jump for which the even period of several targets leaves time: half the default field, an assumption."""
    updates: Count = Field(default=4, ge=2, le=64, multiple_of=2)
    """Updates of the drive's command in one dwell."""

    def updates_of(self, points: int, dwell: float, farthest: float, galvanometers: Galvanometers) -> float:
        """Return about how many updates of the drive's command the longest visit takes.

        ``farthest`` is the longest jump [rad]; the other arguments are those of :meth:`period`.
        """
        way = max(self.period(points, dwell, 2, galvanometers) - points * dwell, self.turnaround)
        way = max(way, float(jump_duration(galvanometers, farthest)) + self.turnaround)
        return (way / dwell + points) * self.updates

    def period(self, points: int, dwell: float, targets: int, galvanometers: Galvanometers) -> float:
        """Return the time [s] from one visit to the next.

        Turning round, N dwells and, where there are several targets, the time in which the mirrors jump by
        ``stated_jump`` and settle.
        """
        jump = 0.0 if targets == 1 else float(jump_time(galvanometers, self.stated_jump))
        return self.turnaround + points * dwell + jump


class Visits(NamedTuple):
    """Visits in turn, each (visits,): ``target`` index, pattern ``number`` at it, ``start`` of the pattern [s]."""

    target: NDArray[np.int64]
    number: NDArray[np.int64]
    start: Array


def visits(targets: int, count: int, period: float, pattern_time: float) -> Visits:
    """Return the first ``count`` visits to targets in turn.

    The mirrors leave at time 0; each visit takes a ``period`` [s], whose last ``pattern_time`` [s] is the pattern.
    """
    index = np.arange(count, dtype=np.int64)
    start = np.arange(1.0, count + 1.0, dtype=np.float64) * period - pattern_time
    return Visits(index % targets, index // targets, start)


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


@dataclass(frozen=True)
class PatternMotion:
    """A pattern as the mirrors ran it; angles in the middle of each dwell [rad], shape (..., points).

    Attributes
    ----------
    time
        Middle of the dwells [s].
    commanded_theta, commanded_phi
        What the drive asked for.
    true_theta, true_phi
        Where the shafts were (without jitter, wobble and drift).
    latched_theta, latched_phi
        Where they were when the encoders latched: what is read, before noise and steps.
    travel_theta, travel_phi
        By how much the shafts move during a dwell, rate · dwell.
    limited
        Whether the mirrors were at a limit during the pattern, once they had caught up with its beginning, shape (...).
    """

    time: Array
    commanded_theta: Array
    commanded_phi: Array
    true_theta: Array
    true_phi: Array
    latched_theta: Array
    latched_phi: Array
    travel_theta: Array
    travel_phi: Array
    limited: NDArray[np.bool_]

    def of(self, row: int) -> PatternMotion:
        """Return one of several patterns."""
        return PatternMotion(*(getattr(self, field.name)[row] for field in fields(self)))

    @classmethod
    def stack(cls, motions: Sequence[PatternMotion]) -> PatternMotion:
        """Return several patterns of as many points as one, along a new first axis."""
        return cls(*(np.stack([getattr(one, field.name) for one in motions]) for field in fields(cls)))


def mirrors_at(theta: float, phi: float) -> MirrorPair:
    """Return mirrors that rest at (Θ, φ) [rad] at time 0."""
    return MirrorPair(at_rest(np.array([theta, phi])), np.zeros(2))


@dataclass(frozen=True)
class Course:
    """What patterns of mirrors side by side begin with: where they go, and when; each (patterns, ...).

    ``number`` of each figure at its target; ``centre`` (Θ, φ) to which it goes and its ``amplitude`` along Θ [rad];
    ``start`` of the first dwell [s], later where turning round, or jumping and settling, needs longer.
    """

    number: NDArray[np.int64]
    centre: Array
    amplitude: Array
    start: Array


def run_visit(
    galvanometers: Galvanometers,
    mirrors: MirrorPair,
    pattern: LissajousPattern,
    number: int,
    centre: ArrayLike,
    *,
    start: float,
    dwell: float,
    visiting: Visiting,
) -> tuple[PatternMotion, MirrorPair]:
    """Return the motion of one visit and the mirrors afterwards: :func:`run_visits` of one, with these of a course."""
    place = np.reshape(np.asarray(centre, dtype=np.float64), (1, 2))
    course = Course(np.array([number]), place, np.array([pattern.amplitude]), np.array([start]))
    motion, (after,) = run_visits(galvanometers, [mirrors], pattern, course, dwell=dwell, visiting=visiting)
    return motion.of(0), after


def run_visits(
    galvanometers: Galvanometers,
    mirrors: Sequence[MirrorPair],
    pattern: LissajousPattern,
    course: Course,
    *,
    dwell: float,
    visiting: Visiting,
) -> tuple[PatternMotion, list[MirrorPair]]:
    """Return the motions of visits, the way to each pattern and the pattern, and the mirrors afterwards.

    Parameters
    ----------
    galvanometers, mirrors
        The servos, and where those of each visit are.
    pattern, course
        The figure, and what of it differs from visit to visit: its own amplitude does not count.
    dwell
        Time of a voxel [s].
    visiting
        Times, and updates of the drive.

    Returns
    -------
    PatternMotion, list of MirrorPair
        The patterns, leading axis (visits,), and the mirrors at the end of each last dwell.
    """
    step = dwell / visiting.updates
    mirrors = [_rested(own, start) for own, start in zip(mirrors, course.start.tolist(), strict=True)]
    figure = figures(pattern, course.number, course.centre, course.amplitude)
    shares = sample_shares(pattern.points, visiting.updates)
    curves = np.stack(figure_angles(figure, pattern.cycles, shares), axis=1)
    ends = np.stack(figure_angles(figure, pattern.cycles, np.zeros(1)), axis=1)[..., 0]
    slopes = figure_slopes(figure, pattern.cycles, np.array([0.0, 1.0])) / (pattern.points * dwell)
    begun = [_resume_state(galvanometers, own) for own in mirrors]
    ways = [
        _approach(galvanometers, state.command, slope, visiting, end, arriving, step, given, near)
        for (state, slope), end, arriving, given, near in zip(
            begun,
            ends,
            slopes[..., 0],
            [start - own.time for own, start in zip(mirrors, course.start.tolist(), strict=True)],
            (2.0 * course.amplitude).tolist(),
            strict=True,
        )
    ]
    # Ways of one length go together: those of runs in lock-step, but for jumps that need longer.
    alike: dict[int, list[int]] = {}
    for row, way in enumerate(ways):
        alike.setdefault(way.shape[1], []).append(row)
    made: dict[int, tuple[PatternMotion, int, MirrorPair]] = {}
    for rows in alike.values():
        states = MirrorState(*(np.stack(part) for part in zip(*(begun[row][0] for row in rows), strict=True)))
        command = np.concatenate([np.stack([ways[row] for row in rows]), curves[rows]], axis=2)
        left = np.array([mirrors[row].time for row in rows])
        motion, after = _follow(galvanometers, states, command, left, pattern.points, dwell, visiting)
        for place, row in enumerate(rows):
            now = MirrorState(*(part[place] for part in after))
            time = float(left[place]) + step * command.shape[2]
            made[row] = motion, place, MirrorPair(now, slopes[row, :, 1], time)
    if len(alike) == 1:
        return made[0][0], [made[row][2] for row in range(len(ways))]
    motions = [motion.of(place) for motion, place, _ in (made[row] for row in range(len(ways)))]
    return PatternMotion.stack(motions), [made[row][2] for row in range(len(ways))]


def _rested(mirrors: MirrorPair, start: float) -> MirrorPair:
    """Return mirrors that have come to rest, where they have waited long for a start [s]."""
    if start - mirrors.time <= _LONGEST_APPROACH:
        return mirrors
    return MirrorPair(at_rest(mirrors.state.angle), np.zeros(2), start - _LONGEST_APPROACH)


def _follow(
    galvanometers: Galvanometers,
    state: MirrorState,
    command: Array,
    left: Array,
    points: int,
    dwell: float,
    visiting: Visiting,
) -> tuple[PatternMotion, MirrorState]:
    """Return how mirrors that ``left`` at times [s] run patterns after their ways, and their states afterwards.

    ``command`` are the angles of ways and patterns, shape (visits, 2, updates).
    """
    step = dwell / visiting.updates
    motion, after = follow(galvanometers, state, command, step)
    seen = latch(motion, state, step, galvanometers.readout_delay)
    gap = command.shape[2] - points * visiting.updates
    middle = gap + np.arange(points) * visiting.updates + visiting.updates // 2 - 1
    # Points lie side by side in memory, as those of one pattern do: sums over them go by how they lie.
    commanded, true, read, rate = (
        np.take(values, middle, axis=2) for values in (motion.commanded, motion.true, seen, motion.rate)
    )
    travel = rate * dwell
    caught_up = gap + math.ceil(_CATCH_UP_LAGS * galvanometers.lag / step)
    made = PatternMotion(
        time=left[:, None] + step * (middle + 1),
        commanded_theta=commanded[:, 0],
        commanded_phi=commanded[:, 1],
        true_theta=true[:, 0],
        true_phi=true[:, 1],
        latched_theta=read[:, 0],
        latched_phi=read[:, 1],
        travel_theta=travel[:, 0],
        travel_phi=travel[:, 1],
        limited=np.asarray(motion.limited[..., caught_up:].any(axis=(1, 2))),
    )
    return made, after


def _resume_state(galvanometers: Galvanometers, mirrors: MirrorPair) -> tuple[MirrorState, Array]:
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


def _approach(
    galvanometers: Galvanometers,
    origin: Array,
    leaving: Array,
    visiting: Visiting,
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
    turnaround, most = visiting.turnaround, galvanometers.jump_share * galvanometers.acceleration
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


def pattern_warnings(
    pattern: LissajousPattern, galvanometers: Galvanometers, dwell: float, key: str = "scan.pattern"
) -> Iterator[str]:
    """Yield a sentence for each mirror that cannot follow a pattern, with what it can."""
    for axis, frequency, amplitude in zip(
        ("Θ", "φ"),
        frequencies(pattern, dwell),
        (pattern.amplitude, pattern.amplitude * pattern.aspect),
        strict=True,
    ):
        largest = float(attainable_amplitude(galvanometers, frequency))
        if amplitude <= largest:
            continue
        slower = attainable_frequency(galvanometers, amplitude)
        points = math.ceil(pattern.points * frequency / slower)
        yield (
            f"{key}: the mirror of {axis} cannot follow {1e3 * amplitude:.3g} mrad at {frequency:.0f} Hz; at most "
            f"{1e3 * largest:.3g} mrad, or {slower:.0f} Hz, which is {points} points"
        )


def raster_time(voxels: int, dwell: float) -> float:
    """Return the time [s] of a raster of so many voxels: Table 2's are voxels over rate."""
    return voxels * dwell
