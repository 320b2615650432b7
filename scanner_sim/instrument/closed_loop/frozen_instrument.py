"""Patterns measured again and again: the steps of an instrument for a fixed number of shots, in frozen kernels.

What Dr.Jit traces for a pattern is the same for every pattern, so it is traced once and launched from then on
(``drjit.freeze``). All that changes goes in as two arrays; all that is measured comes out together. The physics is
:class:`~scanner_sim.instrument.triangulation.Triangulation`'s, and so are the random numbers, whose addresses are the
shots' numbers. What differs is how the beam is split (:mod:`scanner_sim.render.beam.pattern`).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from scanner_sim.detector.encoders import reading_normals
from scanner_sim.foundation.device_types import Float, UInt32
from scanner_sim.instrument.closed_loop.windows import WindowArrays, Windows
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.samples import Samples
from scanner_sim.instrument.triangulation import LineReadings
from scanner_sim.render.beam.light import Truth
from scanner_sim.render.beam.pattern import chief_beamlet, pattern_light
from scanner_sim.render.beam.pattern_shots import fired_shots, packed_shots
from scanner_sim.render.beam.swept_beamlets import SweptTables
from scanner_sim.render.frozen import Frozen
from scanner_sim.render.shots import Pointing
from scanner_sim.render.transport import BeamletTables
from scanner_sim.scan.protocol import Aim


class FrozenInstrument:
    """An instrument that measures patterns of a few hundred shots fast.

    Parameters
    ----------
    instrument
        Instrument, scene and processing.

    Attributes
    ----------
    windows
        The background that each rangefinder sees; none in the dark.

    Notes
    -----
    Time of flight, and light of several bounces, are measured by the instrument itself, with the same windows of the
    background.
    """

    def __init__(self, instrument: Instrument) -> None:
        self.instrument = instrument
        self._steps: dict[int, Frozen] = {}
        lit = not instrument.scenario.lighting.sky().dark
        self.windows = [
            Windows(instrument, *rangefinder.sight) for rangefinder in instrument.rangefinders if lit
        ]

    @property
    def fast(self) -> bool:
        """Whether the scenario is one that frozen kernels measure."""
        instrument = self.instrument
        alone = instrument.rangefinders == (instrument.triangulation,)
        return alone and instrument.scenario.transport.bounces == 1

    @property
    def recordings(self) -> int:
        """How often kernels were recorded so far: once for each length of patterns."""
        return sum(step.recordings for step in self._steps.values())

    def measure(self, aim: Aim) -> Samples:
        """Return what is measured of a pattern: see :meth:`~scanner_sim.instrument.instrument.Instrument.measure`."""
        instrument, seen = self.instrument, [windows.seen_by(aim) for windows in self.windows]
        if not self.fast:
            lit = [own.panorama(window) for own, window in zip(self.windows, seen, strict=True)]
            return instrument.measure(aim, backgrounds=lit or None)
        scanner, count = instrument.scenario.scanner, len(aim.shot)
        mirrors, duty_cycle = scanner.mirrors, scanner.exposure / scanner.dwell
        still = [mirrors.drift(angle, aim.time) for angle in (aim.theta, aim.phi)]
        packed = packed_shots(aim, still, mirrors, duty_cycle, instrument.loaded.bodies)
        truth, told, angles = self._step(count)(self._reads, *packed, *(seen or [[]]))
        numbers = [part.numpy() for part in angles]
        error, shaft = ([part.astype(np.float64) for part in both] for both in (numbers[:2], numbers[2:4]))
        pointing = Pointing(error[0] + still[0], error[1] + still[1], shaft[0], shaft[1])
        deflections = instrument.deflections(aim, pointing, numbers[4:])
        line = LineReadings.gathered(count, [(slice(None), told)])
        reading = instrument.triangulation.reading(truth, line, deflections)
        return instrument.samples(aim, pointing, deflections, [reading])

    @cached_property
    def _beamlets(self) -> tuple[BeamletTables, SweptTables]:
        """The chief ray and the beamlets of every shot, on the device."""
        count = self.instrument.scenario.transport.pattern_beamlets
        return BeamletTables.of(chief_beamlet()), SweptTables.of(count)

    @cached_property
    def _reads(self) -> list[object]:
        """What the kernels read besides their arguments: frozen functions must be handed all of it."""
        loaded, line = self.instrument.loaded, self.instrument.triangulation
        return [
            loaded.mitsuba,
            *(body.mitsuba for body in loaded.bodies),
            loaded.object_of,
            loaded.material_of,
            loaded.coherence,
            loaded.frames,
            self._beamlets,
            line.throughput.laser,
            line.throughput.angle,
            line.throughput.in_band,
            line.throughput.out_of_band,
            *([] if line.bias is None else [line.bias.values]),
        ]

    def _step(self, points: int) -> Frozen:
        """Return the frozen kernels of patterns of a length."""
        if points not in self._steps:
            self._steps[points] = Frozen(
                lambda reads, numbers, integers, window: self._measure(numbers, integers, window, points)
            )
        return self._steps[points]

    def _measure(
        self, numbers: Float, integers: UInt32, window: WindowArrays, points: int
    ) -> tuple[Truth, LineReadings, list[Float]]:
        """Return truth, what the line tells, and angles of a pattern, Dr.Jit arrays of shape (points,).

        The angles are the mirrors' errors, what of them the encoders see, and the normal numbers of their noise.
        """
        instrument, seed = self.instrument, self.instrument.scenario.seed
        mirrors, bodies = instrument.scenario.scanner.mirrors, len(instrument.loaded.bodies)
        fired = fired_shots(numbers, integers, points, mirrors, bodies, seed)
        normals = reading_normals(fired.shots.number, seed)
        truth, light = pattern_light(instrument.loaded, instrument.optics, *self._beamlets, fired.shots)
        panorama = self.windows[0].panorama(window) if self.windows else None
        incident, _, peaks = instrument.triangulation.sense(
            light, fired.shots, truth, fired.aimed, panorama, fixed_size=True
        )
        return truth, LineReadings.of(peaks, incident.link_budget()), [*fired.error, *fired.seen, *normals]
