"""When which target is visited, and how the mirrors get there (Table 2)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from scanner_sim.foundation.arithmetic import columns
from scanner_sim.foundation.errors import at_most
from scanner_sim.foundation.parts import Count, Part
from scanner_sim.foundation.units import Angle, Time
from scanner_sim.optics.galvanometer import Galvanometers, MirrorState, at_rest, follow, latch
from scanner_sim.optics.jump import attainable_amplitude, attainable_frequency, jump_duration, jump_time
from scanner_sim.scan.lissajous import (
    LissajousPattern,
    figure_angles,
    figure_slopes,
    figures,
    frequencies,
    sample_shares,
)
from scanner_sim.scan.ways import MirrorPair, resume_state, way_between

Array = NDArray[np.float64]

_ENDS = np.array([0.0, 1.0])
_CATCH_UP_LAGS = 10.0
"""Lags of the servo after which it has caught up with the beginning of a pattern that it can follow."""
_LONGEST_APPROACH = 10.0
"""Time [s] before a pattern from which on its way is looked at: mirrors that have waited for longer are at rest."""
MOST_VISITS = 2**25
"""Visits of a run: their shots have 32-bit numbers."""


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
    cycles = pattern.cycles
    curves = columns(*figure_angles(figure, cycles, _updates_of(pattern.points, visiting.updates)))
    ends, curves = curves[..., 0], curves[..., 1:]
    slopes = figure_slopes(figure, cycles, _ENDS) / (pattern.points * dwell)
    begun = [resume_state(galvanometers, own) for own in mirrors]
    ways = [
        way_between(
            galvanometers, state.command, slope, visiting.turnaround, end, arriving, step, given, near
        )
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
        states = MirrorState(*(np.array(part) for part in zip(*(begun[row][0] for row in rows), strict=True)))
        command = np.concatenate([np.array([ways[row] for row in rows]), curves[rows]], axis=2)
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


@lru_cache(maxsize=16)
def _updates_of(points: int, per_point: int) -> Array:
    """Return the start of a pattern and its :func:`~scanner_sim.scan.lissajous.sample_shares`."""
    shares = np.append(0.0, sample_shares(points, per_point))
    shares.flags.writeable = False
    return shares


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
        values[..., middle[0] :: visiting.updates].copy()
        for values in (motion.commanded, motion.true, seen, motion.rate)
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
            f"{at_most(1e3 * largest)} mrad, or {math.floor(slower)} Hz, which is {points} points"
        )


def raster_time(voxels: int, dwell: float) -> float:
    """Return the time [s] of a raster of so many voxels: Table 2's are voxels over rate."""
    return voxels * dwell
