"""When which target is visited, and how the mirrors get there (Table 2)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from scanner_sim.optics.galvanometer import Galvanometers, MirrorState, at_rest, follow, latched
from scanner_sim.optics.jump import (
    attainable_amplitude,
    attainable_frequency,
    jump_duration,
    jump_path,
    jump_time,
)
from scanner_sim.parts import Count, Part
from scanner_sim.scan.lissajous import (
    LissajousPattern,
    figure_angles,
    figure_slopes,
    figures,
    frequencies,
    sample_shares,
)
from scanner_sim.units import Angle, Time

Array = NDArray[np.float64]

_CATCHING_UP = 10.0
"""Lags of the servo after which it has caught up with the beginning of a pattern that it can follow."""


class Visiting(Part):
    """How the mirrors go from pattern to pattern."""

    turnaround: Time = Field(default=0.2e-3, ge=0.0, le=1.0)
    """Time in which the mirrors turn from the end of a pattern into the next. 0.2 ms make 128 points the printed
    6.6 ms."""
    stated_jump: Angle = Field(default=0.5, ge=0.0, lt=3.0)
    """Longest jump for which the even period of several targets leaves time: half the default field, an assumption."""
    updates: Count = Field(default=4, ge=2, le=64, multiple_of=2)
    """Updates of the drive's command in one dwell."""

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
    """A pattern as the mirrors ran it; angles in the middle of each dwell [rad], shape (points,).

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
        Whether the mirrors were at a limit during the pattern, once they had caught up with its beginning.
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
    limited: bool


def mirrors_at(theta: float, phi: float) -> MirrorPair:
    """Return mirrors that rest at (Θ, φ) [rad] at time 0."""
    return MirrorPair(at_rest(np.array([theta, phi])), np.zeros(2))


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
    """Return the motion of one visit, the way to the pattern and the pattern, and the mirrors afterwards.

    Parameters
    ----------
    galvanometers, mirrors
        The servos, and where they are.
    pattern, number
        The figure and its number at this target.
    centre
        (Θ, φ) [rad] to which the figure goes.
    start
        When the first dwell begins [s]; later where turning round, or jumping and settling, needs longer.
    dwell
        Time of a voxel [s].
    visiting
        Times, and updates of the drive.

    Returns
    -------
    PatternMotion, MirrorPair
        The pattern, and the mirrors at the end of its last dwell.
    """
    step = dwell / visiting.updates
    figure = figures(pattern, number, np.asarray(centre, dtype=np.float64))
    shares = sample_shares(pattern.points, visiting.updates)
    curve = np.concatenate(figure_angles(figure, pattern.cycles, shares))
    ends = np.concatenate(figure_angles(figure, pattern.cycles, np.zeros(1)))[:, 0]
    slopes = figure_slopes(figure, pattern.cycles, np.array([0.0, 1.0])) / (pattern.points * dwell)
    way = _way(galvanometers, mirrors, visiting, ends, slopes[:, 0], step, start, 2.0 * pattern.amplitude)
    motion, state = follow(galvanometers, mirrors.state, np.concatenate([way, curve], axis=1), step)
    seen = latched(motion, mirrors.state, step, galvanometers.readout_delay)
    gap = way.shape[1]
    middle = gap + np.arange(pattern.points) * visiting.updates + visiting.updates // 2 - 1
    commanded, true, read = (angles[:, middle] for angles in (motion.commanded, motion.true, seen))
    travel = motion.rate[:, middle] * dwell
    made = PatternMotion(
        time=mirrors.time + step * (middle + 1),
        commanded_theta=commanded[0],
        commanded_phi=commanded[1],
        true_theta=true[0],
        true_phi=true[1],
        latched_theta=read[0],
        latched_phi=read[1],
        travel_theta=travel[0],
        travel_phi=travel[1],
        limited=bool(motion.limited[:, gap + math.ceil(_CATCHING_UP * galvanometers.lag / step) :].any()),
    )
    return made, MirrorPair(state, slopes[:, 1], mirrors.time + step * motion.true.shape[1])


def _way(
    galvanometers: Galvanometers,
    mirrors: MirrorPair,
    visiting: Visiting,
    goal: Array,
    slope: Array,
    step: float,
    start: float,
    near: float,
) -> Array:
    """Return the commands from the last pattern to the next, shape (2, updates), which ends at the pattern's start.

    Where the goal is near and time is short, one parabola or cubic turns the mirrors round in ``turnaround``. Else they
    brake for half of it, jump from rest to rest and settle, and speed up for the other half.
    """
    origin = np.asarray(mirrors.state.command)
    half = 0.5 * visiting.turnaround
    rest, launch = origin + 0.5 * half * mirrors.slope, goal - 0.5 * half * slope
    distance = np.abs(launch - rest)
    given = start - mirrors.time
    close = np.abs(goal - origin).max() <= near
    # How long a jump would take is costly, and of no interest where there is no time for one.
    hurried = close and given < visiting.turnaround + 0.5 * step
    jump = 0.0 if hurried else float(jump_time(galvanometers, distance.max()))
    if hurried or (close and given < visiting.turnaround + jump):
        count = round(max(given, visiting.turnaround) / step)
        s = np.arange(1, count + 1) / max(count, 1)
        duration = count * step
        return np.asarray(
            origin[:, None] * (1.0 + 2.0 * s) * (1.0 - s) ** 2
            + (duration * mirrors.slope)[:, None] * s * (1.0 - s) ** 2
            + goal[:, None] * s**2 * (3.0 - 2.0 * s)
            - (duration * slope)[:, None] * s**2 * (1.0 - s)
        )
    # A step more, never less: the jump has settled when the mirrors speed up.
    count = math.ceil(max(given, visiting.turnaround + jump) / step - 1e-6)
    time: Array = step * np.arange(1, count + 1, dtype=np.float64)
    duration = float(jump_duration(galvanometers, distance).max())
    path = jump_path(galvanometers, rest, launch, time - half, np.full(2, duration))
    if half > 0.0:
        braking = np.maximum(half - time, 0.0)
        speeding = np.maximum(time - (count * step - half), 0.0)
        path -= 0.5 * mirrors.slope[:, None] * braking**2 / half
        path += 0.5 * slope[:, None] * speeding**2 / half
    return path


def pattern_doubts(
    pattern: LissajousPattern, galvanometers: Galvanometers, dwell: float, place: str = "scan.pattern"
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
            f"{place}: the mirror of {axis} cannot follow {1e3 * amplitude:.3g} mrad at {frequency:.0f} Hz; at most "
            f"{1e3 * largest:.3g} mrad, or {slower:.0f} Hz, which is {points} points"
        )


def raster_time(voxels: int, dwell: float) -> float:
    """Return the time [s] of a raster of so many voxels: Table 2's are voxels over rate."""
    return voxels * dwell
