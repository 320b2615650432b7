"""The visits of runs in lock-step: each step, from the mirrors to the records, of one pattern of every run at once.

A run is a function of its own scenario: the other runs beside it change no byte of it. One run is a batch of one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.closed_loop.ahead import PatternsAhead, Turn
from scanner_sim.instrument.closed_loop.believed_positions import BelievedPositions
from scanner_sim.instrument.closed_loop.frozen_instrument import FrozenInstrument
from scanner_sim.instrument.closed_loop.raster_between import first_time, measure_raster, mirrors_after
from scanner_sim.instrument.closed_loop.records import NOTHING, Recorder
from scanner_sim.instrument.closed_loop.saved_state import TrackerState
from scanner_sim.instrument.closed_loop.target_sensor import ExpectedPatterns, TargetSensor
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.mesh_sizes import mesh_warnings
from scanner_sim.products.image import RangeImage
from scanner_sim.render.guest import Stay, guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scan.raster import RasterScan
from scanner_sim.scan.schedule import MOST_VISITS, Course, PatternMotion, raster_time, run_visits
from scanner_sim.scan.ways import MirrorPair
from scanner_sim.tracking.prediction import Motion
from scanner_sim.tracking.record import PatternRecord
from scanner_sim.tracking.state import TrackCommand, TrackMode, TrackState, advance, advance_all, command

Numbers = NDArray[np.int64]
Visit = tuple[PatternRecord, TrackerState]
"""What is kept of a visit, and the state of the run after it."""


class Visits:
    """Makes the visits of runs side by side.

    Parameters
    ----------
    scenarios
        One for each run, alike in all that :func:`~scanner_sim.instrument.closed_loop.track.track_many` asks for.
    device, threads
        Where to compute.

    Attributes
    ----------
    said
        Of each run, what is to be said of the meshes of its scene.
    """

    def __init__(
        self, scenarios: Sequence[Scenario], *, device: DeviceChoice = "auto", threads: int | None = None
    ) -> None:
        self._device, self._threads = device, threads
        self._scenarios, self._scans = scenarios, [scenario.following for scenario in scenarios]
        self._targets = [scenario.targets for scenario in scenarios]
        self._scanner, self._pattern = scenarios[0].scanner, self._scans[0].pattern
        self._pattern_time = self._pattern.points * self._scanner.dwell
        with guest():
            runs = [Instrument(scenario, device=device, threads=threads) for scenario in scenarios]
            frozen = FrozenInstrument(*runs)
            self._sensor = TargetSensor(scenarios, frozen)
            self._situations = frozen.situations()
            self._stay = Stay()
        self.said = [mesh_warnings(*run) for run in zip(scenarios, (one.loaded for one in runs), strict=True)]
        self._believed = BelievedPositions(scenarios[0])
        self.axes = self._believed.axes
        self._recorders = [Recorder(scenario) for scenario in scenarios]
        self._periods: dict[int, float] = {}
        self._ahead: PatternsAhead | None = None

    def follow(self, scenario: Scenario, run: int = 0) -> None:
        """Go on in a run with a scenario that differs in its moves and in the changes of its light."""
        self._recorders[run].follow(scenario)
        self._situations[run].follow(scenario)

    def scan(
        self, raster: RasterScan, scenario: Scenario, state: TrackerState
    ) -> tuple[RangeImage, TrackerState]:
        """Return the image of a raster after a state of a run, and the state after it.

        Its shots have the numbers of as many visits as hold them.
        """
        start = first_time(scenario, raster, state.mirrors, state.clock)
        visits, points = -(-raster.shots // self._pattern.points), self._pattern.points
        with self._stay.resume():
            image = measure_raster(
                scenario, raster, start, state.visits * points, device=self._device, threads=self._threads
            )
        end = start + raster_time(raster.shots, self._scanner.dwell)
        after = replace(
            state, visits=state.visits + visits, clock=end, mirrors=mirrors_after(raster, end), skipped=0
        )
        return image, after

    def finished(self, state: TrackerState, run: int = 0) -> bool:
        """Return whether the next pattern would begin after the scan's duration, or nothing is followed any more."""
        most = min(MOST_VISITS, 2**32 // self._pattern.points)
        over = self.start(state) >= self._scans[run].duration or state.visits >= most
        return over or not any(state.followed)

    def after(self, states: Sequence[TrackerState], runs: Sequence[int]) -> list[Visit]:
        """Return the next visits after states of some of the runs: each a function of that state alone.

        Raises
        ------
        InputError
            If a run follows no target.
        """
        ahead, self._ahead = self._ahead, None
        if ahead is not None and len(runs) == 1 and _is_of(ahead, states[0], runs[0]):
            return self._visit(ahead)
        turns = [self._turn(state, run) for state, run in zip(states, runs, strict=True)]
        made: dict[int, Visit] = {}
        together: dict[int, list[Turn]] = {}
        for turn in turns:
            if self.in_view(turn.order):
                together.setdefault(turn.index, []).append(turn)
            else:
                made[turn.run] = self._out_of_view(turn)
        for own in together.values():
            made |= zip((turn.run for turn in own), self._visit(self._patterns(own)), strict=True)
        return [made[run] for run in runs]

    def look_ahead(self, state: TrackerState, run: int = 0) -> bool:
        """Do a part of a run's next visit that no move of the world changes; return whether one was left to do.

        The visit after this very state takes it up.
        """
        if self._ahead is None or not _is_of(self._ahead, state, run):
            if self.finished(state, run):
                return False
            turn = self._turn(state, run)
            if not self.in_view(turn.order):
                return False
            self._ahead = self._patterns([turn])
        return self._ahead.go_on()

    def _patterns(self, turns: Sequence[Turn]) -> PatternsAhead:
        """Return the patterns of runs at the same of their targets."""
        return PatternsAhead(turns, self._run_mirrors, self._expect)

    def _expect(
        self, orders: Sequence[TrackCommand], motion: PatternMotion, visit: Numbers, run: Numbers
    ) -> ExpectedPatterns:
        """Return what is known of patterns before they are measured."""
        with self._stay.resume():
            return self._sensor.expect(orders, motion, visit, run)

    def _visit(self, patterns: PatternsAhead) -> list[Visit]:
        """Return the visits of runs to the same of their targets."""
        turns, index = patterns.turns, patterns.turns[0].index
        motion, mirrors_after = patterns.mirrors
        about = [
            self._situations[turn.run].at(0.5 * float(time[0] + time[-1]), turn.state.used)
            for turn, time in zip(turns, motion.time, strict=True)
        ]
        with self._stay.resume():
            measured = self._sensor.measure(motion, *patterns.numbers, [situation for situation, _ in about])
            # Where nobody has looked ahead, this is done while kernels run.
            expected = patterns.expected
            samples, seen, parts = self._sensor.see(self._targets[0][index], measured, expected)
        tracks = advance_all(
            [turn.state.tracks[index] for turn in turns],
            seen,
            [self._scans[turn.run].tracker for turn in turns],
            [self._targets[turn.run][index].appearance.diameter for turn in turns],
            [mirrors.time for mirrors in mirrors_after],
            [_others(turn) for turn in turns],
        )
        visits = []
        for row, (turn, mirrors, after) in enumerate(zip(turns, mirrors_after, tracks, strict=True)):
            state, target = turn.state, self._targets[turn.run][index]
            record = self._recorders[turn.run].record(
                state.visits, target, turn.order, after, samples, seen, parts, bool(motion.limited[row]), row
            )
            # A pattern that began late because the mirrors needed longer moves all that follow.
            clock = max(turn.start + self._pattern_time, mirrors.time)
            now = replace(
                state,
                tracks=(*state.tracks[:index], after, *state.tracks[index + 1 :]),
                visits=state.visits + 1,
                clock=clock,
                mirrors=mirrors,
                turn=(index + 1) % len(state.tracks),
                skipped=0,
                used=about[row][1],
            )
            visits.append((record, now))
        return visits

    def _run_mirrors(self, turns: Sequence[Turn]) -> tuple[PatternMotion, list[MirrorPair]]:
        """Return how the mirrors run patterns, and where they are afterwards."""
        orders = [turn.order for turn in turns]
        course = Course(
            np.array([order.number for order in orders]),
            self._believed.commands(np.array([order.position for order in orders])),
            np.array([order.amplitude for order in orders]),
            np.array([turn.start for turn in turns]),
        )
        return run_visits(
            self._scanner.galvanometers,
            [turn.state.mirrors for turn in turns],
            self._pattern,
            course,
            dwell=self._scanner.dwell,
            visiting=self._scans[0].visiting,
        )

    def start(self, state: TrackerState) -> float:
        """Return when the next pattern begins [s], if the mirrors are quick enough."""
        return state.clock + self._period(sum(state.followed)) - self._pattern_time

    def _period(self, targets: int) -> float:
        """Return the time of a visit where so many targets are followed [s]."""
        if targets not in self._periods:
            scanner, visiting = self._scanner, self._scans[0].visiting
            self._periods[targets] = visiting.period(
                self._pattern.points, scanner.dwell, max(targets, 1), scanner.galvanometers
            )
        return self._periods[targets]

    def _turn(self, state: TrackerState, run: int) -> Turn:
        """Return the next pattern of a run."""
        index, start = _next(state), self.start(state)
        return Turn(run, state, index, self._order(state, index, self._middle(start), run), start)

    def _middle(self, start: float) -> float:
        """Return the time of a pattern's middle [s]."""
        return start + 0.5 * self._pattern_time

    def _order(self, state: TrackerState, index: int, middle: float, run: int) -> TrackCommand:
        """Return the next pattern at a target; searches are no larger than the field of view leaves room for."""
        diameter, settings = self._targets[run][index].appearance.diameter, self._scans[run].tracker
        order = command(state.tracks[index], settings, diameter, middle)
        fixed = state.amplitudes[index]
        if fixed is not None:
            return replace(order, amplitude=fixed)
        if order.mode in (TrackMode.SEARCH, TrackMode.LOST):
            limit = self._scanner.mirrors.max_deflection
            aspect = np.array([1.0, self._pattern.aspect])
            room = float(((limit - np.abs(order.position[:2])) / aspect).min())
            least = settings.track_amplitude * 0.5 * diameter / float(order.position[2])
            return replace(order, amplitude=min(order.amplitude, max(room, least)))
        return order

    def in_view(self, order: TrackCommand) -> bool:
        """Return whether all of a pattern is within the mirrors' largest deflection."""
        limit = self._scanner.mirrors.max_deflection
        theta, phi = (abs(float(angle)) for angle in order.position[:2])
        return theta + order.amplitude <= limit and phi + order.amplitude * self._pattern.aspect <= limit

    def _out_of_view(self, turn: Turn) -> Visit:
        """Return the record of a target whose pattern would leave the field of view, and the state after it.

        It takes no time, so that the others lose none; only where none is in view a period goes by.
        """
        state, index, middle = turn.state, turn.index, self._middle(turn.start)
        target = self._targets[turn.run][index]
        settings, diameter = self._scans[turn.run].tracker, target.appearance.diameter
        after = advance(state.tracks[index], NOTHING, settings, diameter, middle)
        followed = sum(state.followed)
        waiting = state.skipped + 1 >= followed
        record = self._recorders[turn.run].out_of_view(state.visits, target, turn.order, after, middle)
        return record, replace(
            with_track(state, index, after),
            visits=state.visits + 1,
            clock=state.clock + (self._period(followed) if waiting else 0.0),
            turn=(index + 1) % len(state.tracks),
            skipped=0 if waiting else state.skipped + 1,
        )


def _next(state: TrackerState) -> int:
    """Return the index of the next target."""
    count = len(state.tracks)
    for further in range(count):
        index = (state.turn + further) % count
        if state.followed[index]:
            return index
    raise InputError("no target is followed.", remedy="Take one up again by search.")


def _is_of(ahead: PatternsAhead, state: TrackerState, run: int) -> bool:
    """Return whether a pattern is the one after this very state of a run."""
    (turn,) = ahead.turns
    return turn.state is state and turn.run == run


def _others(turn: Turn) -> list[Motion]:
    """Return the motions of all other targets that a run follows."""
    state = turn.state
    return [
        other.motion
        for number, other in enumerate(state.tracks)
        if number != turn.index and state.followed[number] and other.mode is TrackMode.TRACK
    ]


def with_track(state: TrackerState, index: int, changed: TrackState) -> TrackerState:
    """Return a state in which one target's is changed."""
    tracks = list(state.tracks)
    tracks[index] = changed
    return replace(state, tracks=tuple(tracks))
