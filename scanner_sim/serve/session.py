"""A served run: a tracker, what it measured so far, and its pose filter; requests in, plain maps out. No socket."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import singledispatchmethod
from pathlib import Path

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError, ScannerSimError
from scanner_sim.instrument.closed_loop.saved_state import load_state
from scanner_sim.instrument.closed_loop.told import with_state
from scanner_sim.instrument.closed_loop.tracker import Tracker
from scanner_sim.pose.pose_filter import PoseFilter
from scanner_sim.products.provenance import versions
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.serve import messages as ask
from scanner_sim.serve.answers import Plain, pose_map, raster_map, record_map, sight_map, target_map
from scanner_sim.tracking.record import PatternRecord, Track


class Session:
    """A run that messages steer.

    Parameters
    ----------
    scenario
        Instrument, scene and a scan of type ``track``.
    device
        Where to compute.
    resume
        State of a run of this scenario, where to go on.
    save
        Called with the session by the command ``save``; returns the names of what it wrote.

    Raises
    ------
    InputError, ScenarioError
        As :class:`Tracker`, and if the state is of other targets than the scenario's.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        device: DeviceChoice = "auto",
        resume: Path | None = None,
        save: Callable[[Session], list[str]] | None = None,
    ) -> None:
        if resume is None:
            self.tracker = Tracker(scenario, device=device)
        else:
            load_state(resume)
            self.tracker = Tracker.resume(resume, device=device)
            _check_same_targets(self.tracker, scenario, resume)
        self.records: list[PatternRecord] = []
        self.overruns = 0
        self.realtime: float | None = None
        self._save = save
        self._handed = 0
        self._filter: PoseFilter | None = None
        self._filtered = 0
        self._begin_filter = ask.Filter(protocol=ask.PROTOCOL, command="filter")

    @property
    def track(self) -> Track:
        """The run so far, for files, pictures and poses."""
        return self.tracker.track(self.records)

    def visit(self) -> bool:
        """Make the next visit, if there is one; return whether there was."""
        if self.tracker.finished:
            return False
        record, state = self.tracker.visit(self.tracker.state)
        self.records.append(record)
        self.tracker.state = state
        return True

    def run_until(self, clock: float) -> bool:
        """Make the next visit if it is due at a clock's time [s]; return whether it was made."""
        return self.tracker.time <= clock and self.visit()

    def look_ahead(self) -> bool:
        """Do a part of the next visit while nobody asks for it; return whether one was left to do.

        What cannot be done is left to the visit, which says why.
        """
        try:
            return self.tracker.look_ahead()
        except ScannerSimError:
            return False

    def answer(self, request: ask.Request) -> Plain:
        """Return what a request is answered.

        Raises
        ------
        ScannerSimError
            If it cannot be done; nothing has changed then, but by a ``step`` whose visits were made.
        """
        content = self._do(request)
        return {"time": self.tracker.time, "finished": self.tracker.finished, **content}

    @singledispatchmethod
    def _do(self, request: ask.Request) -> Plain:
        raise NotImplementedError(type(request).__name__)

    @_do.register
    def _open(self, request: ask.Open) -> Plain:  # noqa: ARG002 (the server knows who holds the run)
        tracker = self.tracker
        return {
            "software": f"scanner-sim {versions()['scanner-sim']}",
            "seed": tracker.scenario.seed,
            "duration": tracker.scenario.following.duration,
            "axis_separation": tracker.scenario.scanner.mirrors.axis_separation,
            "realtime": self.realtime,
            "targets": [target_map(target) for target in tracker.targets],
            "visits": tracker.state.visits,
        }

    @_do.register
    def _step(self, request: ask.Step) -> Plain:
        self._tell(request.moves)
        if self.realtime is None:
            made = 0
            while made < request.visits and self.visit():
                made += 1
            records = self.records[len(self.records) - made :]
        else:
            records = self.records[self._handed : self._handed + request.visits]
            self._handed += len(records)
        return {"records": [record_map(one, truth=request.truth, voxels=request.voxels) for one in records]}

    @_do.register
    def _move(self, request: ask.Move) -> Plain:
        self._tell([request])
        return {}

    @_do.register
    def _light(self, request: ask.Light) -> Plain:
        self.tracker.light(sun=request.sun, earth=request.earth, visible=request.visible, time=request.time)
        return {}

    @_do.register
    def _point(self, request: ask.Point) -> Plain:
        self.tracker.point(
            request.target,
            request.theta,
            request.phi,
            request.range,
            rates=request.rates,
            covariance=request.covariance,
        )
        return {}

    @_do.register
    def _search(self, request: ask.Search) -> Plain:
        self.tracker.search(request.target)
        return {}

    @_do.register
    def _drop(self, request: ask.Drop) -> Plain:
        self.tracker.drop(request.target)
        return {}

    @_do.register
    def _amplitude(self, request: ask.Amplitude) -> Plain:
        self.tracker.amplitude(request.target, request.amplitude)
        return {}

    @_do.register
    def _raster(self, request: ask.Raster) -> Plain:
        image = self.tracker.scan(
            request.rows, request.columns, request.horizontal, request.vertical, layers=request.layers
        )
        return {"raster": raster_map(image, request.layers)}

    @_do.register
    def _wait(self, request: ask.Wait) -> Plain:
        self.tracker.wait(request.time)
        return {}

    @_do.register
    def _start_filter(self, request: ask.Filter) -> Plain:
        self._begin_filter, self._filter, self._filtered = request, None, len(self.records)
        return {}

    @_do.register
    def _push(self, request: ask.Push) -> Plain:
        self._fed().push(request.velocity, time=request.time, name=request.object, sigma=request.sigma)
        return {}

    @_do.register
    def _pose(self, request: ask.Pose) -> Plain:
        known = self._fed()
        return {"pose": pose_map(known.predict(self._when(request.time), request.object))}

    @_do.register
    def _sight(self, request: ask.Sight) -> Plain:
        return {"sight": sight_map(self._fed().sight(request.target, self._when(request.time)))}

    @_do.register
    def _state(self, request: ask.State) -> Plain:  # noqa: ARG002 (nothing to ask more)
        state = self.tracker.state
        targets = [
            {"name": target.name, "mode": track.mode.value, "followed": followed, "amplitude": amplitude}
            for target, track, followed, amplitude in zip(
                self.tracker.targets, state.tracks, state.followed, state.amplitudes, strict=True
            )
        ]
        waiting = 0 if self.realtime is None else len(self.records) - self._handed
        return {"visits": state.visits, "targets": targets, "overruns": self.overruns, "waiting": waiting}

    @_do.register
    def _write(self, request: ask.Save) -> Plain:  # noqa: ARG002 (nothing to ask more)
        if self._save is None:
            raise InputError("this server saves nothing.", remedy="Serve with --output or --state.")
        return {"files": self._save(self)}

    @_do.register
    def _close(self, request: ask.Close) -> Plain:  # noqa: ARG002 (the server lets go)
        return {}

    def _tell(self, states: Sequence[ask.ObjectState]) -> None:
        """Tell the run where objects are and how they move: all of it or, where one state is refused, nothing."""
        tracker, told = self.tracker, self.tracker.scenario
        for state in states:
            if not 0.999 < math.hypot(*state.quaternion) < 1.001:
                raise InputError(
                    f"{list(state.quaternion)} is no attitude.",
                    remedy="Give a quaternion (w, x, y, z) of length 1; not turned is [1, 0, 0, 0].",
                )
            told = with_state(
                told,
                state.object,
                time=state.time,
                clock=tracker.time,
                position=state.position,
                quaternion=state.quaternion,
                velocity=state.velocity,
                turn_rate=state.turn_rate,
            )
        if states:
            tracker.follow(told)

    def _when(self, time: float | None) -> float:
        return self.tracker.time if time is None else time

    def _fed(self) -> PoseFilter:
        """Return the pose filter with all visits so far taken in; it costs nothing until it is asked."""
        if self._filter is None:
            self._filter = PoseFilter(
                self.tracker.targets,
                axis_separation=self.tracker.scenario.scanner.mirrors.axis_separation,
                acceleration=self._begin_filter.acceleration,
                turn_acceleration=self._begin_filter.turn_acceleration,
                patience=self._begin_filter.patience,
            )
        for record in self.records[self._filtered :]:
            self._filter.update(record)
        self._filtered = len(self.records)
        return self._filter


def _check_same_targets(tracker: Tracker, scenario: Scenario, file: Path) -> None:
    """Refuse a state of other targets than those of the scenario that is served."""
    saved, served = (
        [(one.name, one.object, one.appearance, one.centre.tolist()) for one in targets]
        for targets in (tracker.targets, scenario.targets)
    )
    if saved != served:
        names = ", ".join(one.name for one in tracker.targets)
        raise InputError(
            f"{file} is a state of other targets: {names}.",
            remedy="Serve the scenario that it was saved with.",
        )
