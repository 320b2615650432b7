"""Search, acquire, track, lost: the tracker of one target as functions of an immutable state."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field
from scipy.special import gammainccinv

from scanner_sim.foundation.parts import Count, Number, Part
from scanner_sim.foundation.units import Angle, Ratio
from scanner_sim.tracking.identify import identify
from scanner_sim.tracking.measurement import Measurement
from scanner_sim.tracking.prediction import Motion, initiate, predict, update

Array = NDArray[np.float64]


_LOOSEST = 0.25
"""Largest standard deviation of a centre, over the radius, that is a sighting. The response of a disc is straight over
a small part of its radius only: beyond that a fit of noise has a size and a place as well, and σ says little."""


_SURE = 3.0
"""Standard deviations of a prediction that the largest pattern of a search about it reaches."""


class TrackMode(StrEnum):
    """What the tracker does with a target."""

    SEARCH = "search"
    """It runs larger and larger patterns where it was seen last and where it was expected, in turns."""
    ACQUIRE = "acquire"
    """It has seen the target and looks whether it stays."""
    TRACK = "track"
    """It follows the target with the smaller pattern."""
    LOST = "lost"
    """It has just lost the target and looks around the predicted position."""


class Refusal(StrEnum):
    """Why a measurement was not taken for the target."""

    NONE = "none"
    """It was taken."""
    NOT_SEEN = "not_seen"
    """No two levels, or no centre."""
    SIZE = "size"
    """It has not the target's size: a shadow's edge, another target."""
    OTHER = "other"
    """It is another target, which is followed already."""
    SHAPE = "shape"
    """It is not round, or cut by the pattern's end."""
    PLACE = "place"
    """It is farther from the prediction than chance allows."""


class TrackerSettings(Part):
    """How a target is searched for and followed."""

    start: Literal["expected", "camera"] = "expected"
    """Where targets are looked for first: where they are ``expected``, or where a first frame of the ``camera`` shows
    the array that they belong to, as soon as it can be read."""
    track_amplitude: Number = Field(default=1.22, gt=1.0, le=10.0)
    """Amplitude of the tracking pattern over the target's radius. Near 1.155 a 3:2 figure touches the rim in twelve
    positions, far above it crosses it in four: at 1.6 the centre errs by three to six times as much. At 1.15 a tilted
    disc's centre follows the pattern's, and the loop swings: under 20° by 70 µrad."""
    search_amplitude: Number = Field(default=1.6, gt=1.0, le=100.0)
    """Amplitude of the first search pattern over the target's radius."""
    search_growth: Number = Field(default=1.4, ge=1.0, le=10.0)
    """Factor from one search pattern to the next."""
    search_most: Angle = Field(default=20e-3, gt=0.0, lt=1.5)
    """Largest amplitude of a search pattern; after it the search begins anew with the first."""
    acquire_patterns: Count = Field(default=2, ge=1, le=1000)
    """Patterns in a row in which a target is seen before it is tracked."""
    patience: Count = Field(default=3, ge=1, le=1000)
    """Patterns in a row without the target after which it is lost."""
    give_up: Count = Field(default=10, ge=1, le=100_000)
    """Patterns after its loss in which it is looked for where it was going; then there and where it was expected first,
    in turns, and no farther than to where its prediction is as uncertain as the largest search pattern is wide."""
    size_tolerance: Ratio = Field(default=0.15, gt=0.0, le=1.0)
    """Largest difference of radius beyond three σ of it, over the radius expected at the measured range; with them half
    of that radius at most."""
    misfit: Number = Field(default=30.0, gt=1.0, le=1e6)
    """Largest χ² over degrees of freedom of a disc; speckle and tilt are well below it, other shapes above."""
    chance: Ratio = Field(default=1e-4, gt=0.0, lt=0.5)
    """Share of right measurements that the gate of the prediction may refuse."""
    acceleration_psd: Number = Field(default=1e-4, ge=0.0, le=1e6)
    """Spectral density of the target's angular acceleration [rad²/s³]."""
    range_acceleration_psd: Number = Field(default=1e-2, ge=0.0, le=1e6)
    """The same of its range [m²/s³]."""
    fastest: Number = Field(default=0.05, gt=0.0, le=100.0)
    """Standard deviation of the angular rate [rad/s] that is expected of a target seen for the first time."""
    fastest_range: Number = Field(default=0.2, gt=0.0, le=1e3)
    """The same of its range [m/s]."""


@dataclass(frozen=True)
class TrackState:
    """All that the tracker remembers of a target.

    Attributes
    ----------
    mode
        What it does.
    motion
        Where the target is and how it moves, as far as known.
    expected
        Where it is looked for when nothing else is known, (Θ, φ, R), shape (3,).
    patterns
        Patterns run so far.
    seen, missed
        Patterns in a row in which it was seen, or not.
    searched
        Search patterns run since the search or the loss began.
    refusal
        Why the last measurement was not taken.
    told
        Whether somebody told its rates, and it has not been tracked since.
    """

    mode: TrackMode
    motion: Motion
    expected: Array
    patterns: int = 0
    seen: int = 0
    missed: int = 0
    searched: int = 0
    refusal: Refusal = Refusal.NONE
    told: bool = False


@dataclass(frozen=True)
class TrackCommand:
    """The next pattern at a target.

    ``mode``; ``position`` (Θ, φ, R), shape (3,), where the target is expected at the asked time; ``amplitude`` [rad];
    ``number`` of the pattern, which decides on dither and inversion; ``rates`` of the position per second, 0 where
    nothing is known of them.
    """

    mode: TrackMode
    position: Array
    amplitude: float
    number: int
    rates: Array = field(default_factory=lambda: np.zeros(3))


def init(expected: ArrayLike, settings: TrackerSettings, time: float = 0.0) -> TrackState:
    """Return the state of a target that is expected at (Θ, φ, R), shape (3,) [rad, m], and not yet seen."""
    position = np.asarray(expected, dtype=np.float64)
    return TrackState(TrackMode.SEARCH, _unknown(position, settings, time), position)


def pointed(
    position: ArrayLike,
    settings: TrackerSettings,
    time: float,
    rates: ArrayLike | None = None,
    covariance: ArrayLike | None = None,
) -> TrackState:
    """Return the state of a target of which somebody else knows where it is and how it moves.

    Parameters
    ----------
    position, rates
        (Θ, φ, R) [rad, m] and their rates per second, each of shape (3,); rates are unknown by default.
    settings, time
        Of the tracker, and when that is so [s].
    covariance
        Of (Θ, φ, R), shape (3, 3), or of these and their rates, shape (6, 6); by default as of a first search.

    Returns
    -------
    TrackState
        As of a target that was just lost: it is looked for where it goes, in patterns that reach three standard
        deviations of the prediction, and once it is found where that allows, the rates and their covariance go on. With
        neither rates nor covariance as of :func:`init`.
    """
    where = np.asarray(position, dtype=np.float64)
    if rates is None and covariance is None:
        return init(where, settings, time)
    unknown = _unknown(where, settings, time)
    whole = unknown.covariance.copy()
    if covariance is not None:
        given = np.asarray(covariance, dtype=np.float64)
        whole[: len(given), : len(given)] = given
    mean = np.concatenate([where, np.zeros(3) if rates is None else np.asarray(rates, dtype=np.float64)])
    motion = Motion(mean, whole, np.asarray(time, dtype=np.float64))
    return TrackState(TrackMode.LOST, motion, where, told=rates is not None)


def command(state: TrackState, settings: TrackerSettings, diameter: float, time: float) -> TrackCommand:
    """Return the pattern to be run around a time [s], for a target of a diameter [m]."""
    ahead = predict(state.motion, time, _acceleration_psd(settings))
    position, doubt = ahead.mean[:3], _SURE * math.sqrt(float(np.diagonal(ahead.covariance)[:2].max()))
    if state.mode is TrackMode.SEARCH and doubt > settings.search_most:
        # The prediction no longer says more than where it was looked for when it was given up.
        position = state.motion.mean[:3]
    position = _in_front(position, diameter)
    radius = _radius(diameter, float(position[2]))
    if state.mode in (TrackMode.ACQUIRE, TrackMode.TRACK):
        amplitude = settings.track_amplitude * radius
    else:
        first = settings.search_amplitude * radius
        # What is predicted is no farther off than its uncertainty: larger patterns find nothing more there.
        most = settings.search_most
        if state.mode is TrackMode.LOST:
            most = min(most, max(first, radius + doubt))
        # So many patterns grow until the largest is reached, and then it begins anew.
        steps = 1
        if settings.search_growth > 1.0 and most > first:
            growths = math.log(most / first) / math.log(settings.search_growth)
            steps += math.ceil(growths - 1e-9)
        if state.mode is TrackMode.SEARCH and state.searched // steps % 2:
            position = state.expected
        grown = first * settings.search_growth ** (state.searched % steps)
        amplitude = max(min(grown, most), settings.track_amplitude * radius)
    return TrackCommand(state.mode, position, amplitude, state.patterns, ahead.mean[3:])


def advance(
    state: TrackState,
    measurement: Measurement,
    settings: TrackerSettings,
    diameter: float,
    next_time: float,
    row: int = 0,
    others: Sequence[Motion] = (),
) -> TrackState:
    """Return the state after a pattern; :func:`command` gives the next pattern when that begins.

    Parameters
    ----------
    state, settings
        Before the pattern.
    measurement
        What it saw; its pattern ``row`` is taken.
    diameter
        The target's [m].
    next_time
        Middle of the next pattern at this target [s].
    row
        Which pattern of the measurement.
    others
        Targets that are followed already: what is found in a search and is one of them is not taken.

    Returns
    -------
    TrackState
        A measurement counts as the target where it is seen, has its size and shape and, once the target moves steadily,
        lies where the prediction allows: all else, shadows' edges and glints above all, moves nothing.
    """
    one = measurement.of(row)
    (after,) = advance_all([state], one, [settings], [diameter], [next_time], [others])
    return after


def advance_all(
    states: Sequence[TrackState],
    measurement: Measurement,
    settings: Sequence[TrackerSettings],
    diameter: Sequence[float],
    next_time: Sequence[float],
    others: Sequence[Sequence[Motion]],
) -> list[TrackState]:
    """Return the states of targets, each of a run of its own, after a pattern of each: :func:`advance` of all at once.

    The measurement has a pattern for each of the states; the other arguments are those of each.
    """
    followed = [state.mode in (TrackMode.TRACK, TrackMode.ACQUIRE) for state in states]
    known = followed | np.array([state.told for state in states])
    filtered = _filtered(states, measurement, settings, np.flatnonzero(measurement.found & known).tolist())
    found = []
    for row, state in enumerate(states):
        own, seen, sought = settings[row], filtered.get(row), not followed[row]
        surprise = None if seen is None or sought else seen[1]
        refusal = _refusal(state, measurement, own, diameter[row], surprise, row)
        if refusal is Refusal.NONE and sought and _is_other(others[row], measurement, own, row):
            refusal = Refusal.OTHER
        if refusal is not Refusal.NONE:
            counted = replace(state, patterns=state.patterns + 1, refusal=refusal)
            found.append(_miss(counted, own, measurement_time=next_time[row]))
        elif seen is not None and (not sought or seen[1] <= _gate(own.chance)):
            found.append(_taken(state, own, seen[0], state.seen + 1))
        else:
            # Found where nobody knows how it moves, or not where its told motion allows.
            position, covariance = measurement.position[row], measurement.covariance[row]
            motion = initiate(position, covariance, _rates(own), float(measurement.time[row]))
            found.append(_taken(state, own, motion, 1))
    return found


def _filtered(
    states: Sequence[TrackState],
    measurement: Measurement,
    settings: Sequence[TrackerSettings],
    rows: list[int],
) -> dict[int, tuple[Motion, float]]:
    """Return the motions of some targets with their measurements taken in, and these's squared surprises, by row."""
    if not rows:
        return {}
    known = Motion(*(np.array(part) for part in zip(*(states[row].motion for row in rows), strict=True)))
    unrest = np.array([_acceleration_psd(settings[row]) for row in rows])
    ahead = predict(known, measurement.time[rows], unrest)
    after, surprise = update(ahead, measurement.position[rows], measurement.covariance[rows])
    return {
        row: (Motion(after.mean[place], after.covariance[place], after.time[place]), float(surprise[place]))
        for place, row in enumerate(rows)
    }


def _refusal(
    state: TrackState,
    measurement: Measurement,
    settings: TrackerSettings,
    diameter: float,
    surprise: float | None,
    row: int,
) -> Refusal:
    """Return why a measurement is not the target's; ``surprise`` is its squared distance from a prediction."""
    if not measurement.found[row]:
        return Refusal.NOT_SEEN
    position, covariance = measurement.position[row], measurement.covariance[row]
    radius, expected = float(measurement.radius[row]), _radius(diameter, float(position[2]))
    allowed = settings.size_tolerance * expected + 3.0 * float(measurement.sigma_radius[row])
    if abs(radius - expected) > min(allowed, 0.5 * expected):
        return Refusal.SIZE
    # A radius without a misfit is that of scattered hits: enough for finding a target, not for following it.
    misfit = float(measurement.misfit[row])
    loose = float(np.sqrt(np.trace(covariance[:2, :2]))) > _LOOSEST * expected
    if loose or misfit > settings.misfit or (np.isnan(misfit) and state.mode is TrackMode.TRACK):
        return Refusal.SHAPE
    if surprise is not None and surprise > _gate(settings.chance):
        return Refusal.PLACE
    return Refusal.NONE


def _is_other(
    others: Sequence[Motion], measurement: Measurement, settings: TrackerSettings, row: int
) -> bool:
    """Return whether a measurement is one of the targets that are followed already."""
    if not others:
        return False
    ahead = [predict(other, float(measurement.time[row]), _acceleration_psd(settings)) for other in others]
    # Within a third of its radius nothing else can be.
    near = (measurement.radius[row] / 3.0) ** 2 * np.diag([1.0, 1.0, 0.0])
    found = identify(
        measurement.position[row],
        measurement.covariance[row : row + 1],
        np.stack([motion.mean[:3] for motion in ahead]),
        np.stack([motion.covariance[:3, :3] for motion in ahead]) + near,
        chance=settings.chance,
    )
    return bool(found.target[0] >= 0)


def _taken(state: TrackState, settings: TrackerSettings, motion: Motion, seen: int) -> TrackState:
    """Return the state after the target was seen, so many times in a row, with its motion."""
    tracked = state.mode is TrackMode.TRACK or seen >= settings.acquire_patterns
    mode = TrackMode.TRACK if tracked else TrackMode.ACQUIRE
    told = state.told and not tracked
    return TrackState(mode, motion, state.expected, patterns=state.patterns + 1, seen=seen, told=told)


def _miss(state: TrackState, settings: TrackerSettings, measurement_time: float) -> TrackState:
    """Return the state after the target was not seen."""
    missed = state.missed + 1
    kept = replace(state, seen=0, missed=missed)
    if state.mode is TrackMode.TRACK:
        return replace(kept, mode=TrackMode.LOST, searched=0) if missed >= settings.patience else kept
    if state.mode is TrackMode.ACQUIRE:
        return replace(kept, mode=TrackMode.LOST, searched=0)
    if state.mode is TrackMode.LOST and state.searched + 1 >= settings.give_up:
        known = predict(state.motion, measurement_time, _acceleration_psd(settings))
        return replace(kept, mode=TrackMode.SEARCH, motion=known, searched=0)
    return replace(kept, searched=state.searched + 1)


def _unknown(position: Array, settings: TrackerSettings, time: float) -> Motion:
    spread = np.diag([settings.search_most**2, settings.search_most**2, 1.0])
    return initiate(position, spread, _rates(settings), time)


def _in_front(position: Array, diameter: float) -> Array:
    """Return a place (Θ, φ, R) that a beam can reach: what is predicted nearer than its radius [m] is taken there."""
    nearest = 0.5 * diameter
    return position if position[2] >= nearest else np.append(position[:2], nearest)


def _radius(diameter: float, distance: float) -> float:
    """Return the radius [rad] of a disc that faces the scanner at a range [m]."""
    return 0.5 * diameter / distance


@lru_cache(maxsize=64)
def _gate(chance: float) -> float:
    """Return the squared distance that three normal variables exceed by chance (χ² of three degrees of freedom)."""
    return 2.0 * float(gammainccinv(1.5, chance))


def _acceleration_psd(settings: TrackerSettings) -> Array:
    return np.array([settings.acceleration_psd, settings.acceleration_psd, settings.range_acceleration_psd])


def _rates(settings: TrackerSettings) -> Array:
    return np.array([settings.fastest, settings.fastest, settings.fastest_range])
