"""Poses of objects from the visits of a tracker as they come: the reference filter as an object that a program feeds.

It carries the state of :mod:`scanner_sim.pose.filter` on, begins by itself as soon as three targets of each object are
tracked, and tells the poses of any later time. It is causal: nothing that comes later changes what it said.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.foundation.arithmetic import applied, product
from scanner_sim.foundation.errors import InputError
from scanner_sim.pose.collinearity import project
from scanner_sim.pose.filter import FilterModel, FilterState, counts, pushed
from scanner_sim.pose.first_motions import Push
from scanner_sim.pose.transforms import quaternion_from_rotation
from scanner_sim.scene.motion import FASTEST, LATEST
from scanner_sim.tracking.record import PatternRecord, TrackTarget

Array = NDArray[np.float64]

_STARTING = 4
"""Of how many visits to each target a filter remembers the last ones until it begins."""


class FilterStatus(StrEnum):
    """What a filtered pose rests on."""

    STARTING = "starting"
    """Nothing yet: an object has not three tracked targets."""
    FOLLOWING = "following"
    """Visits that are not older than the filter's patience."""
    COASTING = "coasting"
    """Older ones: the pose is carried on, and its covariance grows."""


@dataclass(frozen=True)
class FilteredPose:
    """What a filter says of an object at a time; all is NaN while it is starting.

    Attributes
    ----------
    object
        Its name.
    time
        For which it is said [s].
    status
        :class:`FilterStatus`.
    position, rotation
        Of its origin [m], shape (3,), and ``scanner_from_object``, shape (3, 3).
    velocity, turn_rate
        Along the scanner's axes [m/s] and [rad/s], shape (3,).
    covariance
        Of (δt, δω, δv, δ rate) [m, rad, m/s, rad/s], shape (12, 12), with position + δt and exp([δω]×) rotation.
    surprise
        Squared Mahalanobis distance of the last visit from what was predicted, χ² of three degrees of freedom.
    """

    object: str
    time: float
    status: FilterStatus
    position: Array
    rotation: Array
    velocity: Array
    turn_rate: Array
    covariance: Array
    surprise: float

    @property
    def sigma(self) -> Array:
        """Standard deviations of the twelve numbers, shape (12,)."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)))

    @property
    def quaternion(self) -> Array:
        """Unit quaternion (w, x, y, z) of the rotation, shape (4,)."""
        return quaternion_from_rotation(self.rotation)

    @property
    def scanner_from_object(self) -> Array:
        """The pose as a 4 × 4 matrix."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.position
        return matrix


class Sighting(NamedTuple):
    """Where a target is to be seen: what :meth:`Tracker.point` takes.

    ``position`` (Θ, φ, R) [rad, rad, m] and its ``rates`` per second, shape (3,) each, with the ``covariance`` of both,
    shape (6, 6).
    """

    position: Array
    rates: Array
    covariance: Array


class PoseFilter:
    """A filter that is fed with records and asked for poses.

    Parameters
    ----------
    targets
        A tracker's, or the targets of each object by name with their places on it [m], shape (3,). Of a tracker's the
        objects with three targets or more count.
    axis_separation
        D_g [m].
    acceleration, turn_acceleration
        Spectral densities of accelerations that nobody told the filter of [m²/s³, rad²/s³].
    fastest, fastest_turn
        Standard deviations of velocity [m/s] and rate of turn [rad/s] before anything is seen.
    patience
        Time without a visit that counts after which the filter is coasting [s].

    Raises
    ------
    InputError
        If no object has three targets, or two have one of the same name.
    """

    def __init__(
        self,
        targets: Sequence[TrackTarget] | Mapping[str, Mapping[str, ArrayLike]],
        *,
        axis_separation: float,
        acceleration: float = 1e-6,
        turn_acceleration: float = 1e-6,
        fastest: float = 0.1,
        fastest_turn: float = 0.1,
        patience: float = 0.2,
    ) -> None:
        known = targets if isinstance(targets, Mapping) else FilterModel.of(targets, axis_separation).objects
        if not known or min(map(len, known.values())) < 3:
            raise InputError(
                "a pose needs three targets on an object.", remedy="Name or follow more of them."
            )
        names = [target for own in known.values() for target in own]
        if len(set(names)) < len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise InputError(f"two objects have a target '{twice}'.", remedy="Name targets as records do.")
        self.model = FilterModel(
            known, axis_separation, acceleration, turn_acceleration, fastest, fastest_turn
        )
        self.state: FilterState | None = None
        self._patience = patience
        self._first: list[PatternRecord] = []
        self._last: PatternRecord | None = None
        self._pushes: list[Push] = []

    @property
    def objects(self) -> tuple[str, ...]:
        """Names of the objects, the first one first."""
        return tuple(self.model.objects)

    def update(self, record: PatternRecord) -> FilteredPose:
        """Take a visit in, and return what is known at its time of the object that it was made to.

        A visit that measured nothing, that the tracker does not follow yet, or that is older than the last one changes
        nothing: the pose is then predicted.
        """
        known = self.model.targets.get(record.target)
        name = self.objects[0 if known is None else known[0]]
        counted = known is not None and counts(record)
        if self.state is None:
            if counted:
                self._begin(record)
            return self._said(name, record.time, self.state)
        if counted and record.time > self.state.time:
            self._carry(record.time)
            self.state = self.model.updated(self.state, record)
            self._last = record
            return self._said(name, record.time, self.state)
        return self.predict(max(record.time, self.state.time), name)

    def predict(self, time: float, name: str | None = None) -> FilteredPose:
        """Return the pose of an object, by default the first one, at a time [s] from the last visit on.

        Raises
        ------
        InputError
            If the time is before what is known already or beyond all times of a run, or there is no such object.
        """
        name = self._known(name)
        _check_time(time)
        if self.state is None or self._last is None:
            return self._said(name, time, None)
        if not time >= self.state.time:
            raise InputError(
                f"{time:.9g} s is before the last visit, at {self.state.time:.9g} s.",
                remedy="Ask for it before that visit is taken in.",
            )
        state = self.state
        for push in self._pushes:
            if push.time <= time:
                state = pushed(self._ahead(state, push.time), push)
        return self._said(name, time, self._ahead(state, time))

    def sight(self, target: str, time: float) -> Sighting:
        """Return where a target of the filter's is to be seen at a time [s].

        Raises
        ------
        InputError
            As :meth:`predict`, and if there is no such target, or nothing is known yet.
        """
        if target not in self.model.targets:
            raise InputError(f"the filter knows no target '{target}'.", remedy="Name it among its targets.")
        number, point = self.model.targets[target]
        pose = self.predict(time, self.objects[number])
        if pose.status is FilterStatus.STARTING:
            raise InputError(
                "the filter knows no pose yet.", remedy="Track three targets of each object first."
            )
        arm = applied(pose.rotation, point)
        separation = self.model.axis_separation
        seen, gradients = project((pose.position + arm)[:, None], separation, with_range=True)
        by_shift = gradients[..., 0].T
        slope = np.concatenate([by_shift, np.cross(arm, by_shift)], axis=1)
        onto = np.zeros((6, 12))
        onto[:3, :6] = onto[3:, 6:] = slope
        rates = applied(by_shift, pose.velocity + np.cross(pose.turn_rate, arm))
        covariance = product(onto, pose.covariance, onto.T)
        return Sighting(seen[:, 0], rates, 0.5 * (covariance + covariance.T))

    def push(self, velocity: ArrayLike, *, time: float, name: str | None = None, sigma: float = 0.0) -> None:
        """Tell of a change of an object's velocity [m/s], shape (3,), that somebody causes at a time [s].

        Thrust and known gravity are told so: what is told is no unrest. ``sigma`` [m/s] is how well it is known along
        each axis. A change counts from its time on; one that lies before the last visit, once the filter has begun,
        from that visit on.

        Raises
        ------
        InputError
            If there is no such object, or the numbers are none, beyond all speeds of objects, or the time beyond all
            times of a run.
        """
        try:
            change = np.asarray(velocity, dtype=np.float64)
        except (TypeError, ValueError):
            change = np.full(3, np.nan)
        if change.shape != (3,) or not np.isfinite([*change, time, sigma]).all() or sigma < 0.0:
            raise InputError("this is no change of a velocity.", remedy="Give three numbers, a time and a σ.")
        if max(*np.abs(change), sigma) > FASTEST:
            raise InputError(
                "this is no change of an object's velocity.",
                remedy=f"Changes and σ up to {FASTEST:g} m/s are possible.",
            )
        _check_time(time)
        number = self.objects.index(self._known(name))
        if self.state is None and not self._first:
            return
        counted = time if self.state is None else max(time, self.state.time)
        self._pushes = sorted([*self._pushes, Push(counted, number, change, sigma)], key=lambda one: one.time)

    def restart(self) -> None:
        """Forget what is known, and begin again with the next visits."""
        self.state, self._last, self._first, self._pushes = None, None, [], []

    def _begin(self, record: PatternRecord) -> None:
        """Begin with the visits so far, as soon as they tell enough."""
        self._first = [*self._first, record][-_STARTING * len(self.model.targets) :]
        self._pushes = [push for push in self._pushes if push.time >= self._first[0].time]
        try:
            self.state = self.model.begin(self._first, self._pushes)
        except InputError:
            # No pose from these: later ones may do.
            return
        self._last, self._first = record, []
        self._pushes = [push for push in self._pushes if push.time > record.time]

    def _carry(self, time: float) -> None:
        """Take in all pushes up to a time."""
        assert self.state is not None
        while self._pushes and self._pushes[0].time <= time:
            push = self._pushes.pop(0)
            self.state = pushed(self._ahead(self.state, push.time), push)

    def _ahead(self, state: FilterState, time: float) -> FilterState:
        """Return a state at a later time."""
        assert self._last is not None
        return self.model.predicted(state, replace(self._last, time=time)) if time > state.time else state

    def _known(self, name: str | None) -> str:
        if name is not None and name not in self.model.objects:
            raise InputError(
                f"the filter knows no '{name}'.", remedy=f"The objects: {', '.join(self.objects)}."
            )
        return self.objects[0] if name is None else name

    def _said(self, name: str, time: float, state: FilterState | None) -> FilteredPose:
        """Return what a state at a time says of an object."""
        if state is None:
            unknown = np.full(3, np.nan)
            spread = np.full((12, 12), np.nan)
            rotation = np.full((3, 3), np.nan)
            none = FilterStatus.STARTING
            return FilteredPose(name, time, none, unknown, rotation, unknown, unknown, spread, np.nan)
        number = self.objects.index(name)
        assert self._last is not None
        late = time - self._last.time > self._patience
        return FilteredPose(
            object=name,
            time=time,
            status=FilterStatus.COASTING if late else FilterStatus.FOLLOWING,
            position=state.position[number],
            rotation=state.rotation[number],
            velocity=state.velocity[number],
            turn_rate=state.turn_rate[number],
            covariance=state.covariance_of(number),
            surprise=state.surprise,
        )


def _check_time(time: float) -> None:
    """Refuse a time [s] beyond all times of a run."""
    if time > LATEST:
        raise InputError(f"{time:.9g} s is too late.", remedy=f"A run may last for {LATEST:g} s.")
