"""The closed loop: mirrors, voxels, centroid, tracker, pattern after pattern."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config import resolved_yaml, scenario_from_text
from scanner_sim.errors import InputError
from scanner_sim.products.provenance import versions
from scanner_sim.ranging.coordinates import angles_and_range, coordinates
from scanner_sim.render.device import DeviceChoice
from scanner_sim.scan.schedule import PatternMotion, run_visit
from scanner_sim.scenario import Scenario
from scanner_sim.track_state import TrackerState, first_state, load_state, save_state
from scanner_sim.track_voxels import Encoders, Instrument, SignalNoise, aim_of, samples_of
from scanner_sim.tracking.measurement import Measurement, measure_target
from scanner_sim.tracking.record import PatternRecord, Track, TrackStatus, TrackTarget
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.state import Refusal, TrackCommand, TrackMode, TrackState, command, init, step
from scanner_sim.workbench import Workbench

Array = NDArray[np.float64]

Progress = Callable[[float, float], None]
"""Called with the time that is done and the time in all [s]."""

MOST_VISITS = 2**25
"""Visits of a run: their shots have 32-bit numbers."""


class Tracker:
    """A tracking run that is made visit by visit: an iterator of :class:`~scanner_sim.tracking.record.PatternRecord`.

    Commands between two visits change what comes next. ``state`` is immutable: with it a run can be saved, continued
    and repeated, and what follows is the same to the last bit, whatever the number of threads.

    Parameters
    ----------
    scenario
        Instrument, scene and a scan of type ``track``.
    device, threads
        Where to compute.
    state
        Where to go on; None begins.

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the device cannot be used, or the scenario scans a raster.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        device: DeviceChoice = "auto",
        threads: int | None = None,
        state: TrackerState | None = None,
    ) -> None:
        self.scenario, self.scan, self.targets = scenario, scenario.following, scenario.targets
        self.state = first_state(self.targets, self.scan.tracker) if state is None else state
        self._bench: Instrument = Workbench(scenario, device=device, threads=threads)
        self._encoders, self._noise = Encoders(scenario), SignalNoise(scenario)
        self._items = {item.name: item for item in scenario.scene.objects}
        self._periods: dict[int, float] = {}

    @classmethod
    def resume(
        cls, file: str | Path, *, device: DeviceChoice = "auto", threads: int | None = None
    ) -> Tracker:
        """Return the run that a file of :meth:`save` holds, to be continued.

        Raises
        ------
        InputError, ScenarioError
            If the file cannot be read, or its scenario no longer can (meshes may have gone).
        """
        state, text = load_state(Path(file))
        scenario = scenario_from_text(text, name=str(file))
        return cls(scenario, device=device, threads=threads, state=state)

    def save(self, file: str | Path) -> None:
        """Write the scenario and the state between two visits, for :meth:`resume`.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        save_state(Path(file), self.state, self.scenario_yaml, made_by())

    @cached_property
    def scenario_yaml(self) -> str:
        """The resolved scenario."""
        return resolved_yaml(self.scenario)

    @property
    def finished(self) -> bool:
        """Whether the next pattern would begin after the scan's duration, or nothing is followed any more."""
        nothing = not any(self.state.followed)
        return nothing or self._start() >= self.scan.duration or self.state.visits >= MOST_VISITS

    def __iter__(self) -> Iterator[PatternRecord]:
        """Iterate over the visits that are left."""
        return self

    def __next__(self) -> PatternRecord:
        """Make the next visit."""
        if self.finished:
            raise StopIteration
        record, self.state = self.visit(self.state)
        return record

    def search(self, target: str) -> None:
        """Search for a target where it is expected, whatever was known of it, and follow it from then on."""
        index = self._index(target)
        track = init(self.state.tracks[index].expected, self.scan.tracker, self.state.clock)
        self._set(index, track=replace(track, patterns=self.state.tracks[index].patterns), followed=True)

    def point(self, target: str, theta: float, phi: float, distance: float) -> None:
        """Expect a target at Θ, φ [rad] and a range [m], and search for it there.

        Raises
        ------
        InputError
            If these are no finite angles and a positive range, or there is no such target.
        """
        index = self._index(target)
        place = np.array([theta, phi, distance], dtype=np.float64)
        if not np.isfinite(place).all() or distance <= 0.0:
            raise InputError(
                f"({theta}, {phi}, {distance}) is no place.", remedy="Name two angles and a range."
            )
        track = init(place, self.scan.tracker, self.state.clock)
        self._set(index, track=replace(track, patterns=self.state.tracks[index].patterns), followed=True)

    def drop(self, target: str) -> None:
        """Visit a target no more; :meth:`search` takes it up again."""
        self._set(self._index(target), followed=False)

    def amplitude(self, target: str, amplitude: float | None) -> None:
        """Run a target's patterns with an amplitude [rad]; None leaves it to the tracker again.

        Raises
        ------
        InputError
            If the amplitude is not between 0 and 1.5 rad, or there is no such target.
        """
        index = self._index(target)
        if amplitude is not None and not 0.0 < amplitude < 1.5:
            raise InputError(f"{amplitude} is no amplitude.", remedy="Name one between 0 and 1.5 rad.")
        amplitudes = list(self.state.amplitudes)
        amplitudes[index] = amplitude
        self.state = replace(self.state, amplitudes=tuple(amplitudes))

    def visit(self, state: TrackerState) -> tuple[PatternRecord, TrackerState]:
        """Return the next visit after a state, and the state after it: a function of the state alone.

        Raises
        ------
        InputError
            If no target is followed.
        """
        index, skipped = self._next(state)
        target, track = self.targets[index], state.tracks[index]
        start = self._start(state)
        points, dwell = self.scan.pattern.points, self.scenario.scanner.dwell
        middle = start + 0.5 * points * dwell
        order = self._order(state, index, middle)
        if not self._in_view(order):
            return self._out_of_view(state, index, order, skipped, middle)
        motion, mirrors = run_visit(
            self.scenario.scanner.galvanometers,
            state.mirrors,
            self.scan.pattern.model_copy(update={"amplitude": order.amplitude}),
            order.number,
            order.place[:2],
            start=start,
            dwell=dwell,
            visiting=self.scan.visiting,
        )
        samples, seen = self._measure(target, order, motion, state.visits)
        after, _ = step(track, seen, self.scan.tracker, target.looks.diameter, mirrors.time)
        record = self._record(state, target, order, after, samples, seen, motion.limited)
        # A pattern that began late because the mirrors needed longer moves all that follow.
        clock = max(start + points * dwell, mirrors.time)
        return record, replace(
            _with_track(state, index, after),
            visits=state.visits + 1,
            clock=clock,
            mirrors=mirrors,
            turn=(index + 1) % len(self.targets),
            skipped=0,
        )

    def _start(self, state: TrackerState | None = None) -> float:
        """Return when the next pattern begins [s], if the mirrors are quick enough."""
        now = self.state if state is None else state
        pattern = self.scan.pattern.points * self.scenario.scanner.dwell
        return now.clock + self._period(sum(now.followed)) - pattern

    def _period(self, targets: int) -> float:
        """Return the time of a visit where so many targets are followed [s]."""
        if targets not in self._periods:
            scanner, scan = self.scenario.scanner, self.scan
            self._periods[targets] = scan.visiting.period(
                scan.pattern.points, scanner.dwell, max(targets, 1), scanner.galvanometers
            )
        return self._periods[targets]

    def _next(self, state: TrackerState) -> tuple[int, int]:
        """Return the index of the next target, and how many before it in a row were outside of the field of view."""
        count = len(self.targets)
        for further in range(count):
            index = (state.turn + further) % count
            if state.followed[index]:
                return index, state.skipped
        raise InputError("no target is followed.", remedy="Take one up again by search.")

    def _order(self, state: TrackerState, index: int, middle: float) -> TrackCommand:
        """Return the next pattern at a target; searches are no larger than the field of view leaves room for."""
        target = self.targets[index]
        order = command(state.tracks[index], self.scan.tracker, target.looks.diameter, middle)
        fixed = state.amplitudes[index]
        if fixed is not None:
            return replace(order, amplitude=fixed)
        if order.mode in (TrackMode.SEARCH, TrackMode.LOST):
            limit = self.scenario.scanner.mirrors.max_deflection
            aspect = np.array([1.0, self.scan.pattern.aspect])
            room = float(((limit - np.abs(order.place[:2])) / aspect).min())
            least = self.scan.tracker.track_amplitude * 0.5 * target.looks.diameter / float(order.place[2])
            return replace(order, amplitude=min(order.amplitude, max(room, least)))
        return order

    def _in_view(self, order: TrackCommand) -> bool:
        limit = self.scenario.scanner.mirrors.max_deflection
        theta, phi = (abs(float(angle)) for angle in order.place[:2])
        return theta + order.amplitude <= limit and phi + order.amplitude * self.scan.pattern.aspect <= limit

    def _measure(
        self, target: TrackTarget, order: TrackCommand, motion: PatternMotion, visit: int
    ) -> tuple[PatternSamples, Measurement]:
        """Return the voxels of a pattern, and where they see the target."""
        scanner, expected = self.scenario.scanner, float(order.place[2])
        layers = self._bench.measure(aim_of(motion, visit))
        samples = samples_of(
            layers,
            motion,
            self._encoders.read(motion, visit),
            self._noise.sigma(layers, motion, expected),
            scanner.galvanometers.readout_delay if self.scan.correct_delay else 0.0,
        )
        spot = float(scanner.laser.radius(expected)) / (2.0 * expected)
        seen = measure_target(
            samples, target.looks, expected, spot=spot, shining=scanner.exposure / scanner.dwell
        )
        return samples, replace(seen, covariance=seen.covariance + self._common(motion))

    def _common(self, motion: PatternMotion) -> Array:
        """Return the covariance that all voxels of a pattern share, shape (1, 3, 3): wobble, and expected drift.

        The mirrors' jitter and the encoders' noise differ from voxel to voxel: they are well below the residuals of
        the fit, which scale its covariance.
        """
        mirrors = self.scenario.scanner.mirrors
        spread = mirrors.temperature.spread(motion.time[:1])[0]
        shared = np.zeros((1, 3, 3))
        for axis, angle in enumerate((motion.commanded_theta, motion.commanded_phi)):
            drift = spread * (mirrors.drift_zero + mirrors.drift_scale * float(angle.mean()))
            shared[0, axis, axis] = mirrors.wobble**2 + drift**2
        return shared

    def _record(
        self,
        state: TrackerState,
        target: TrackTarget,
        order: TrackCommand,
        after: TrackState,
        samples: PatternSamples,
        seen: Measurement,
        limited: bool,
    ) -> PatternRecord:
        """Return what is kept of a visit."""
        found = bool(seen.found[0])
        time = float(seen.time[0]) if found else float(samples.time.mean())
        if after.refusal is Refusal.NONE:
            status = TrackStatus.MEASURED
        elif after.refusal is not Refusal.NOT_SEEN:
            status = TrackStatus.REFUSED
        else:
            status = TrackStatus.LIMITED if limited else TrackStatus.NOT_FOUND
        place = seen.place[0] if found else np.full(3, np.nan)
        covariance = seen.covariance[0] if found else np.full((3, 3), np.nan)
        separation = self.scenario.scanner.mirrors.axis_separation
        point, by_place = point_of(place, separation)
        truth, truth_point = self.truth(target, time)
        return PatternRecord(
            number=state.visits,
            target=target.name,
            time=time,
            mode=order.mode,
            after=after.mode,
            refusal=after.refusal,
            status=status,
            amplitude=order.amplitude,
            centre=order.place[:2],
            place=place,
            covariance=covariance,
            point=point,
            point_covariance=by_place @ covariance @ by_place.T,
            truth=truth,
            truth_point=truth_point,
            samples=samples,
        )

    def truth(self, target: TrackTarget, time: float) -> tuple[Array, Array]:
        """Return the true (Θ, φ, R) of a target's centre at a time [s], and its x, y, z [m], each of shape (3,)."""
        pose = self._items[target.object].pose_at(time)[0]
        point = pose[:3, :3] @ target.centre + pose[:3, 3]
        distance, theta, phi = angles_and_range(
            point[0], point[1], point[2], self.scenario.scanner.mirrors.axis_separation
        )
        return np.array([theta, phi, distance]), point

    def _out_of_view(
        self, state: TrackerState, index: int, order: TrackCommand, skipped: int, middle: float
    ) -> tuple[PatternRecord, TrackerState]:
        """Return the record of a target whose pattern would leave the field of view, and the state after it.

        It takes no time, so that the others lose none; only where none is in view a period goes by.
        """
        target = self.targets[index]
        after, _ = step(state.tracks[index], _NOTHING, self.scan.tracker, target.looks.diameter, middle)
        shown = replace(_NO_SAMPLES, time=np.full((1, 1), middle))
        record = self._record(state, target, order, after, shown, _NOTHING, limited=False)
        waiting = skipped + 1 >= sum(state.followed)
        return replace(record, status=TrackStatus.OUT_OF_VIEW, samples=_NO_SAMPLES), replace(
            _with_track(state, index, after),
            visits=state.visits + 1,
            clock=state.clock + (self._period(sum(state.followed)) if waiting else 0.0),
            turn=(index + 1) % len(self.targets),
            skipped=0 if waiting else skipped + 1,
        )

    def _index(self, target: str) -> int:
        for index, known in enumerate(self.targets):
            if known.name == target:
                return index
        names = ", ".join(known.name for known in self.targets)
        raise InputError(f"there is no target '{target}'.", remedy=f"The targets: {names}.")

    def _set(self, index: int, *, followed: bool, track: TrackState | None = None) -> None:
        """Change what is remembered of a target, and whether it is visited."""
        state = self.state if track is None else _with_track(self.state, index, track)
        visited = list(state.followed)
        visited[index] = followed
        self.state = replace(state, followed=tuple(visited))


_UNKNOWN, _EMPTY = np.full(1, np.nan), np.zeros((1, 0))
_NOTHING = Measurement(
    time=_UNKNOWN,
    place=np.full((1, 3), np.nan),
    covariance=np.full((1, 3, 3), np.nan),
    radius=_UNKNOWN,
    sigma_radius=_UNKNOWN,
    misfit=_UNKNOWN,
    fraction=np.zeros(1),
    found=np.zeros(1, dtype=np.bool_),
)
"""What a pattern that was not run sees."""
_NO_SAMPLES = PatternSamples(
    time=_EMPTY,
    theta=_EMPTY,
    phi=_EMPTY,
    signal=_EMPTY,
    sigma_signal=_EMPTY,
    range=_EMPTY,
    sigma_range=_EMPTY,
    status=np.zeros((1, 0), dtype=np.uint8),
)
"""Its voxels."""


def track(
    scenario: Scenario,
    *,
    device: DeviceChoice = "auto",
    threads: int | None = None,
    progress: Progress | None = None,
) -> Track:
    """Follow the targets of a scenario for the time that it says.

    Parameters
    ----------
    scenario
        Instrument, scene and a scan of type ``track``.
    device, threads
        Where to compute; the result does not depend on the threads.
    progress
        Called after each visit.

    Returns
    -------
    Track

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the device cannot be used, or the scenario scans a raster.
    """
    tracker = Tracker(scenario, device=device, threads=threads)
    records = []
    for record in tracker:
        records.append(record)
        if progress is not None:
            progress(min(tracker.state.clock, tracker.scan.duration), tracker.scan.duration)
    return finished_track(tracker, tuple(records))


def finished_track(tracker: Tracker, records: tuple[PatternRecord, ...]) -> Track:
    """Return a run of a tracker with everything that is told of it beside its records."""
    return Track(
        records=records,
        targets=tracker.targets,
        seed=tracker.scenario.seed,
        scenario_yaml=tracker.scenario_yaml,
        made_by=made_by(),
        warnings=tuple(_warnings(tracker.targets, records)),
    )


def made_by() -> str:
    """Return name and version of the program."""
    return f"scanner-sim {versions()['scanner-sim']}"


def point_of(place: Array, axis_separation: float) -> tuple[Array, Array]:
    """Return the point x, y, z of a place (Θ, φ, R), shape (3,) [m], and its derivatives by the place, shape (3, 3).

    Eq 3 of Blais, Beraldin, El-Hakim (2000); rows are x, y, z, columns Θ, φ, R.
    """
    theta, phi, r = (float(value) for value in place)
    point = np.array([float(value) for value in coordinates(r, theta, phi, axis_separation)])
    sine, cosine, down, ahead = np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi)
    reach = r * cosine - axis_separation
    by_place = np.array(
        [
            [r * cosine, 0.0, sine],
            [-r * sine * down, reach * ahead, cosine * down],
            [-r * sine * ahead, -reach * down, cosine * ahead],
        ]
    )
    return point, by_place


def _with_track(state: TrackerState, index: int, changed: TrackState) -> TrackerState:
    tracks = list(state.tracks)
    tracks[index] = changed
    return replace(state, tracks=tuple(tracks))


def _warnings(targets: tuple[TrackTarget, ...], records: tuple[PatternRecord, ...]) -> Iterator[str]:
    """Yield sentences on results that look unintended."""
    for target in targets:
        own: list[Any] = [record for record in records if record.target == target.name]
        if not own:
            yield f"'{target.name}' was never visited: the run is too short"
        elif not any(record.status == TrackStatus.MEASURED for record in own):
            most = max(set(TrackStatus), key=lambda code: sum(record.status == code for record in own))
            yield f"'{target.name}' was never measured; mostly: {most.sentence}"
