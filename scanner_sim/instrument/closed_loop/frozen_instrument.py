"""Patterns measured again and again: the steps of an instrument for a fixed number of shots, in frozen kernels.

What Dr.Jit traces for a pattern is the same for every pattern, so it is traced once and launched from then on
(``drjit.freeze``). All that changes goes in as three arrays; all that is measured comes out together. Patterns of
several runs before one scene go through the kernels side by side, each with the seed of its run. The physics is
:class:`~scanner_sim.instrument.triangulation.Triangulation`'s, and so are the random numbers, whose addresses are the
shots' numbers. What differs is how the beam is split (:mod:`scanner_sim.render.beam.pattern`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.encoders import reading_normals
from scanner_sim.foundation.device_streams import RunSeeds, device_seeds
from scanner_sim.foundation.device_types import Float, UInt32, UInt64
from scanner_sim.instrument.closed_loop.pattern_columns import PatternColumns
from scanner_sim.instrument.closed_loop.situation import Situation, Situations
from scanner_sim.instrument.closed_loop.windows import WindowArrays, Windows, seen_by
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.line_readings import LineReadings
from scanner_sim.instrument.samples import Samples
from scanner_sim.instrument.triangulation import Triangulation
from scanner_sim.optics.built_instrument import still_errors
from scanner_sim.ranging.ranges import Columns, ranged_peaks
from scanner_sim.render.beam.pattern import (
    Again,
    PatternProbes,
    PatternTables,
    lanes_again,
    light_of,
    pattern_light,
    probe_pattern,
)
from scanner_sim.render.beam.pattern_shots import fired_shots, packed_shots
from scanner_sim.render.frozen import Frozen, side_by_side, taken_apart
from scanner_sim.render.shots import Pointing, Shots
from scanner_sim.scan.protocol import Aim
from scanner_sim.scene.files.loader import device_poses

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

_MOST_SHOTS = 8192
"""Shots that are launched together: with 512 beamlets each, a tenth of a gigabyte. More are no quicker."""


@dataclass
class Met:
    """Shots of patterns as they are fired, their commanded Θ [rad], and what their beams meet."""

    shots: Shots
    aimed: Float
    probes: PatternProbes


class FrozenInstrument:
    """An instrument that measures patterns of a few hundred shots fast.

    Parameters
    ----------
    runs
        Instrument, scene and processing of each run. They differ in their seeds and in how their objects move.

    Attributes
    ----------
    windows
        The background that each rangefinder sees in the first run; none in the dark.

    Notes
    -----
    Time of flight, and light of several bounces, are measured by the instrument itself, pattern after pattern, with the
    same windows of the background. With an estimator of the user's own the kernels are traced anew for each launch.
    """

    def __init__(self, *runs: Instrument) -> None:
        self._runs, self.instrument = runs, runs[0]
        self._seeds = np.array([own.scenario.seed for own in runs], dtype=np.uint64)
        self._steps: dict[tuple[object, ...], Frozen] = {}
        self._met: Callable[[list[Any]], Met]
        lit = not self.instrument.scenario.lighting.sky().dark
        finders = self.instrument.rangefinders if lit else ()
        self.windows = [Windows(self.instrument, *finder.sight) for finder in finders]
        self._windows = [
            self.windows,
            *(
                [
                    Windows(own, *finder.sight, like=first)
                    for finder, first in zip(finders, self.windows, strict=True)
                ]
                for own in runs[1:]
            ),
        ]
        self._still = [
            Situation(items, items, own.scenario.lighting.sky())
            for own, items in ((own, tuple(body.item for body in own.loaded.bodies)) for own in runs)
        ]

    @property
    def fast(self) -> bool:
        """Whether the scenario is one that frozen kernels measure."""
        instrument = self.instrument
        alone = [type(one) for one in instrument.rangefinders] == [Triangulation]
        return alone and instrument.scenario.transport.bounces == 1

    @property
    def recordings(self) -> int:
        """How often kernels were recorded so far: for each length and number of patterns, and shots traced again."""
        return sum(step.recordings for step in self._steps.values())

    def situations(self) -> list[Situations]:
        """Return what tells the situations of each run's patterns."""
        step = min((window.step for window in self.windows), default=math.inf)
        first = Situations(self.instrument.scenario, self.instrument.loaded, step)
        return [first, *(Situations(own.scenario, own.loaded, step, first) for own in self._runs[1:])]

    def measure(
        self, aim: Aim, run: Numbers | None = None, situations: Sequence[Situation] | None = None
    ) -> PatternColumns:
        """Return what is measured of patterns: see :meth:`~scanner_sim.instrument.instrument.Instrument.measure`.

        Kernels are launched, and who asks for a column waits for them: with several threads there is time meanwhile.

        Parameters
        ----------
        aim
            Patterns of as many shots each, one after the other.
        run
            Which of the runs each pattern belongs to; by default there is one pattern, of the first.
        situations
            Where things are about each pattern; by default as the runs' scenarios say when they begin.
        """
        own = np.zeros(1, dtype=np.int64) if run is None else run
        about = [self._still[number] for number in own] if situations is None else situations
        count, points = len(own), len(aim.shot) // len(own)
        if count == 1:
            return self._measured(aim, own, about)
        most = max(1, _MOST_SHOTS // points) if self.fast else 1
        parts = []
        for first in range(0, count, most):
            rows = np.arange(first, min(first + most, count))
            # Few numbers of patterns make few recordings: what is missing is the last one once more.
            missing = (1 << (len(rows) - 1).bit_length()) - len(rows)
            filled = np.append(rows, np.full(missing, rows[-1]))
            part = self._measured(_patterns(aim, count, filled), own[filled], [about[row] for row in filled])
            parts.append((part, len(rows) * points))
        return PatternColumns.joined(parts)

    def _measured(self, aim: Aim, run: Numbers, about: Sequence[Situation]) -> PatternColumns:
        """Return what is measured of patterns in one launch."""
        instrument, scanner, count = self.instrument, self.instrument.scenario.scanner, len(aim.shot)
        aims = [_patterns(aim, len(run), np.array([row])) for row in range(len(run))] if self.windows else []
        seen = [
            seen_by([self._windows[own][sensor] for own in run], aims, about)
            for sensor in range(len(self.windows))
        ]
        if not self.fast:
            lit = [own.panorama(parts, count) for own, parts in zip(self.windows, seen, strict=True)]
            poses = device_poses([item.pose_at(aim.time) for item in about[0].items])
            return PatternColumns.of(self._runs[int(run[0])].read(aim, lit or None, poses=poses))
        mirrors, duty_cycle, built = scanner.mirrors, scanner.exposure / scanner.dwell, instrument.built
        still = still_errors(mirrors, built, aim.theta, aim.phi, aim.time)
        packed = packed_shots(aim, still, mirrors, duty_cycle, _poses(aim, about), built)
        seeds = device_seeds(self._seeds[run])
        met, told = self._step(self._probe, count, len(run))(self._traced, *packed, seeds)
        footprint, *angles = told.numpy().reshape(-1, count)
        again = lanes_again(footprint)
        light = self._step(self._light, count, *map(_width, again))(self._traced, met, *again)
        sense = self._step(self._sense, count, len(run))
        read = sense(self._tables, met, light, seeds, *(seen or [[]]))
        error, shaft = ([part.astype(np.float64) for part in both] for both in (angles[:2], angles[2:4]))
        pointing = Pointing(error[0] + still[0], error[1] + still[1], shaft[0], shaft[1])
        deflections, way = instrument.deflections(aim, pointing, angles[4:]), instrument.triangulation

        @cache
        def line() -> LineReadings:
            return LineReadings.unpacked(read.numpy(), count)

        def at_hand() -> Columns:
            peaks, gate = line(), instrument.scenario.processing.range_gate
            ranged = ranged_peaks(peaks.position, peaks.sigma, peaks.status, deflections, way.geometry, gate)
            return {
                "Y": peaks.signal,
                "sigma_Y": peaks.sigma_signal,
                "range_m": ranged.range,
                "sigma_range_m": ranged.sigma,
                "status": ranged.status,
            }

        def whole() -> Samples:
            reading = way.reading(self._met(met).probes.truth, line(), deflections)
            return instrument.samples(aim, pointing, deflections, [reading])

        return PatternColumns(at_hand, whole)

    @cached_property
    def _beamlets(self) -> PatternTables:
        """The beamlets of every shot, on the device."""
        return PatternTables.of(self.instrument.scenario.transport.pattern_beamlets)

    @cached_property
    def _traced(self) -> list[object]:
        """What the kernels that trace rays read besides their arguments: frozen functions must be handed all of it."""
        loaded = self.instrument.loaded
        scenes = (loaded.mitsuba, *(body.mitsuba for body in loaded.bodies))
        return [*scenes, *taken_apart(self._beamlets)[0], *self._tables]

    @cached_property
    def _tables(self) -> list[object]:
        """What all kernels read."""
        loaded, line = self.instrument.loaded, self.instrument.triangulation
        return [
            loaded.object_of,
            loaded.material_of,
            loaded.coherence,
            loaded.narrow,
            loaded.frames,
            line.throughput.laser,
            line.throughput.angle,
            line.throughput.in_band,
            line.throughput.out_of_band,
            *([] if line.bias is None else [line.bias.values]),
        ]

    def _step(self, step: Callable[..., Any], shots: int, *lanes: int) -> Frozen:
        """Return the frozen kernels of a step for so many shots of so many patterns, or with so many traced again."""
        key = step.__name__, shots, *lanes
        if key not in self._steps:
            # What the kernels read comes along as an argument, which they need not name.
            own = self.instrument.triangulation.own_peak
            self._steps[key] = Frozen(lambda reads, *given: step((shots, *lanes), *given), enabled=not own)
        return self._steps[key]

    def _probe(
        self, size: tuple[int, int], numbers: Float, integers: UInt32, seeds: UInt64
    ) -> tuple[list[Any], Float]:
        """Return the arrays of :class:`Met` of patterns, and what the host needs to know.

        That is, column after column: the footprints; the mirrors' errors, what of them the encoders see, and the normal
        numbers of their noise.
        """
        instrument = self.instrument
        mirrors, bodies = instrument.scenario.scanner.mirrors, len(instrument.loaded.bodies)
        shots, _ = size
        own = RunSeeds.of(seeds, shots).lanes
        fired = fired_shots(numbers, integers, shots, mirrors, bodies, own, instrument.built)
        normals = reading_normals(fired.shots.number, own)
        probes = probe_pattern(instrument.loaded, instrument.optics, self._beamlets, fired.shots)
        arrays, self._met = taken_apart(Met(fired.shots, fired.aimed, probes))
        return arrays, side_by_side([probes.footprint, *fired.error, *fired.seen, *normals])

    def _light(self, _: tuple[int, ...], arrays: list[Any], parted: Again, other: Again) -> tuple[Float, ...]:
        """Return the clusters of the light of patterns on the line."""
        instrument, met = self.instrument, self._met(arrays)
        return pattern_light(
            instrument.loaded, instrument.optics, self._beamlets, met.shots, met.probes, parted, other
        )

    def _sense(
        self,
        size: tuple[int, int],
        arrays: list[Any],
        clusters: tuple[Float, ...],
        seeds: UInt64,
        window: WindowArrays,
    ) -> Float:
        """Return what the line tells of patterns: the columns of :class:`LineReadings`."""
        shots, patterns = size
        panorama = self.windows[0].panorama(window, shots // patterns) if self.windows else None
        met, own = self._met(arrays), RunSeeds.of(seeds, shots)
        incident, signal, peaks = self.instrument.triangulation.sense(
            light_of(met.shots, clusters),
            met.shots,
            met.probes.truth,
            met.aimed,
            panorama,
            fixed_size=True,
            seeds=own,
        )
        told = LineReadings.of(peaks, incident.link_budget(), signal.background_peak)
        return side_by_side(told.columns)


def _width(lanes: Again) -> int:
    """Return how many lanes there are."""
    return 0 if lanes is None else len(lanes[0])


def _poses(aim: Aim, about: Sequence[Situation]) -> list[Array]:
    """Return the poses of the moving objects at the shots of patterns, each of shape (shots, 4, 4)."""
    times = aim.time.reshape(len(about), -1)
    return [
        each[0].pose_at(aim.time)
        if all(item is each[0] for item in each)
        else np.concatenate([item.pose_at(time) for item, time in zip(each, times, strict=True)])
        for each in zip(*(one.items for one in about), strict=True)
    ]


def _patterns(aim: Aim, count: int, rows: Numbers) -> Aim:
    """Return some of ``count`` patterns that make up an aim."""
    return Aim(*(getattr(aim, field.name).reshape(count, -1)[rows].ravel() for field in fields(Aim)))
