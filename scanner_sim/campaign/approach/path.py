"""Epochs of a path: when each is, and how the object moves about it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scanner_sim.campaign.approach.plan import MOST_EPOCHS, Approach, Epochs
from scanner_sim.foundation.errors import Fault
from scanner_sim.pose.transforms import rates_between
from scanner_sim.scene.ephemeris import EphemerisMotion
from scanner_sim.scene.motion import ConstantTwist, PoseFile, Waypoints
from scanner_sim.scene.moves import Moves, RigidMotion
from scanner_sim.scene.relative_orbit import RelativeOrbit

Array = NDArray[np.float64]

_STEP = 1e-2
"""Time over which velocity and rate of turn are taken [s]: after the epoch, so that its own burn is in them, but within
what a path tells."""
_SAME = 1e-9
"""By how much a time may lie off the end of a path and still be on it [s]."""
_FINE = 4001
"""Moments at which the range along a path is looked at for even steps of it."""


class Epoch(NamedTuple):
    """A moment of a path.

    Attributes
    ----------
    time
        Since its start [s].
    pose
        ``scanner_from_object``, shape (4, 4); of what is fixed to another object its pose before that one.
    velocity, turn_rate
        Of the object [m/s, rad/s] along the axes of the same frame, shapes (3,).
    """

    time: float
    pose: Array
    velocity: Array
    turn_rate: Array

    @property
    def distance(self) -> float:
        """Distance of the object's origin from the scanner's [m]."""
        return float(np.linalg.norm(self.pose[:3, 3]))


def span_of(motion: RigidMotion) -> tuple[float, float | None]:
    """Return when a motion begins and ends [s]; None where it goes on."""
    if isinstance(motion, Waypoints):
        return motion.points[0].time, motion.points[-1].time
    if isinstance(motion, PoseFile):
        times = motion.poses().time
        return float(times[0]), float(times[-1])
    if isinstance(motion, RelativeOrbit):
        return 0.0, motion.end
    if isinstance(motion, EphemerisMotion):
        return motion.span
    assert isinstance(motion, ConstantTwist | Moves)
    return 0.0, None


def epochs_of(approach: Approach, start: Array) -> tuple[tuple[Epoch, ...], tuple[Fault, ...]]:
    """Return the epochs of an approach, and what is wrong with them.

    Parameters
    ----------
    approach
        The approach.
    start
        Pose of the object in the scenario (4, 4), from which a twist starts.

    Returns
    -------
    epochs, faults
        In the order of time; none where there are faults.
    """
    asked, motion = approach.epochs, approach.trajectory
    first, last = span_of(motion)
    end = last if asked.end is None else asked.end
    if end is None:
        problem = "this path goes on, and nothing says where its last epoch is."
        return (), (Fault("epochs.end", problem, "Write for example end: 2400 s."),)
    for key, time in (("start", asked.start), ("end", end)):
        if time < first - _SAME or (last is not None and time > last + _SAME):
            problem = f"{time:g} s is not on the path, which goes from {first:g} s to {last:g} s."
            return (), (Fault(f"epochs.{key}", problem, "Write a time in it."),)
    if end <= asked.start:
        problem = f"{asked.start:g} s is no time before the path's end, {end:g} s."
        return (), (Fault("epochs.start", problem, "Write an earlier one."),)
    try:
        times = _times(asked, end, lambda time: motion.scanner_from_object(time, start)[:, :3, 3])
    except ValueError as error:
        problem, remedy = error.args
        return (), (Fault("epochs.spacing", problem, remedy),)
    return moments_of(motion, start, times), ()


def moments_of(motion: RigidMotion, start: Array, times: Array) -> tuple[Epoch, ...]:
    """Return how an object moves at times of its motion; at the end of a path as just before, and later at rest.

    Parameters
    ----------
    motion
        The motion.
    start
        Pose from which a twist starts (4, 4), in the frame of the motion.
    times
        The times [s], shape (n,).
    """
    first, last = span_of(motion)
    # A glideslope's last burn stops the object; other paths end in motion, and only what they hold ends there.
    told = math.inf if last is None or isinstance(motion, RelativeOrbit) else last
    step = min(_STEP, told - first)
    begin = np.where(times > told + _SAME, times, np.minimum(times, told - step))
    poses, before, after = (motion.scanner_from_object(time, start) for time in (times, begin, begin + step))
    return tuple(map(Epoch, times.tolist(), poses, *rates_between(before, after, step)))


def _times(asked: Epochs, end: float, place: Callable[[Array], Array]) -> Array:
    """Return when the epochs are [s], shape (n,).

    Raises
    ------
    ValueError
        With a sentence and a remedy, if the range changes by less than a step or there are too many.
    """
    if asked.count is not None:
        return np.linspace(asked.start, end, asked.count)
    assert asked.spacing is not None
    fine = np.linspace(asked.start, end, _FINE)
    ranges = np.linalg.norm(place(fine), axis=1)
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(ranges)))])
    steps = int(way[-1] / asked.spacing * (1.0 + 1e-12))
    if not 1 <= steps < MOST_EPOCHS:
        problem = f"the range changes by {way[-1]:.4g} m in all, {steps:,} steps of {asked.spacing:g} m."
        remedy = f"Write a larger one: {MOST_EPOCHS - 1} steps are possible."
        raise ValueError(problem, remedy if steps else "Write a smaller one, or count: 8.")
    return np.asarray(np.interp(asked.spacing * np.arange(steps + 1), way, fine))
