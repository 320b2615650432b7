"""Patterns measured again and again: the steps of an instrument for a fixed number of shots, in frozen kernels.

What Dr.Jit traces for a pattern is the same for every pattern, so it is traced once and launched from then on
(``drjit.freeze``). All that changes goes in as two arrays; all that is measured comes out together. The physics is
:class:`~scanner_sim.instrument.instrument.Instrument`'s, function by function, and so are the random numbers, whose
addresses are the shots' numbers. What differs is how the beam is split (:mod:`scanner_sim.render.beam.pattern`).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from scanner_sim.detector.encoders import reading_normals, readings
from scanner_sim.foundation.device_types import Float, UInt32
from scanner_sim.instrument.closed_loop.windows import WindowArrays, Windows
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.ranging.ranges import Deflections, Layers, layers_of, with_truth
from scanner_sim.render.beam.light import Truth
from scanner_sim.render.beam.pattern import chief_beamlet, pattern_light
from scanner_sim.render.beam.pattern_shots import fired_shots, packed_shots
from scanner_sim.render.beam.swept_beamlets import SweptTables
from scanner_sim.render.frozen import Frozen
from scanner_sim.render.shots import Pointing
from scanner_sim.render.transport import BeamletTables
from scanner_sim.scan.protocol import Aim

_LINE = ("signal", "snr", "laser", "window", "window_error", "background_peak")
"""What the line sensor's layers are made of, in the order of their arguments."""


class FrozenInstrument:
    """An instrument that measures patterns of a few hundred shots fast.

    Parameters
    ----------
    instrument
        Instrument, scene and processing.

    Notes
    -----
    Time of flight, and light of several bounces, are measured by the instrument itself, with the same windows of the
    background.
    """

    def __init__(self, instrument: Instrument) -> None:
        self.instrument = instrument
        self._steps: dict[int, Frozen] = {}
        lit, ranging = not instrument.scenario.lighting.sky().dark, instrument.scenario.ranging
        self.windows = Windows.of_line(instrument) if lit and ranging != "tof" else None
        self.field_windows = Windows.of_field(instrument) if lit and ranging != "triangulation" else None

    @property
    def fast(self) -> bool:
        """Whether the scenario is one that frozen kernels measure."""
        scenario = self.instrument.scenario
        return scenario.ranging == "triangulation" and scenario.transport.bounces == 1

    @property
    def recordings(self) -> int:
        """How often kernels were recorded so far: once for each length of patterns."""
        return sum(step.recordings for step in self._steps.values())

    def measure(self, aim: Aim) -> Layers:
        """Return the layers of a pattern's shots: see :meth:`~scanner_sim.instrument.instrument.Instrument.measure`."""
        if not self.fast:
            line, field = (
                None if windows is None else windows.panorama(windows.seen_by(aim))
                for windows in (self.windows, self.field_windows)
            )
            return self.instrument.measure(aim, line=line, field=field, details=True)
        instrument, scanner = self.instrument, self.instrument.scenario.scanner
        mirrors, duty_cycle = scanner.mirrors, scanner.exposure / scanner.dwell
        still = [mirrors.drift(angle, aim.time) for angle in (aim.theta, aim.phi)]
        packed = packed_shots(aim, still, mirrors, duty_cycle, instrument.loaded.bodies)
        window = [] if self.windows is None else self.windows.seen_by(aim)
        truth, found = self._step(len(aim.shot))(self._reads, *packed, window)
        status = found.pop("status").numpy()
        values = {name: array.numpy().astype(np.float64) for name, array in found.items()}
        theta, phi = readings(
            aim.theta + values["seen_theta"],
            aim.phi + values["seen_phi"],
            values["read_theta"],
            values["read_phi"],
            mirrors,
        )
        deflections = Deflections(
            theta, phi, *(mirrors.reading_sigma(angle, aim.time) for angle in (theta, phi))
        )
        peak, sigma = values["peak"], values["sigma_peak"]
        ranges = instrument.ranges(peak, sigma, status, deflections)
        layers = instrument.line_layers(peak, sigma, *(values[name] for name in _LINE)) | layers_of(ranges)
        pointing = Pointing(
            values["error_theta"] + still[0],
            values["error_phi"] + still[1],
            values["seen_theta"],
            values["seen_phi"],
        )
        layers["sigma_Y"] = values["sigma_signal"]
        return with_truth(layers, ranges, aim, pointing, truth)

    @cached_property
    def _beamlets(self) -> tuple[BeamletTables, SweptTables]:
        """The chief ray and the beamlets of every shot, on the device."""
        count = self.instrument.scenario.transport.pattern_beamlets
        return BeamletTables.of(chief_beamlet()), SweptTables.of(count)

    @cached_property
    def _reads(self) -> list[object]:
        """What the kernels read besides their arguments: frozen functions must be handed all of it."""
        instrument = self.instrument
        loaded, throughput = instrument.loaded, instrument.throughput
        return [
            loaded.mitsuba,
            *(body.mitsuba for body in loaded.bodies),
            loaded.object_of,
            loaded.material_of,
            loaded.coherence,
            loaded.frames,
            self._beamlets,
            throughput.laser,
            throughput.angle,
            throughput.in_band,
            throughput.out_of_band,
            *([] if instrument.bias is None else [instrument.bias.values]),
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
    ) -> tuple[Truth, dict[str, Float]]:
        """Return truth and measured values of a pattern, Dr.Jit arrays of shape (points,)."""
        instrument, seed = self.instrument, self.instrument.scenario.seed
        mirrors, bodies = instrument.scenario.scanner.mirrors, len(instrument.loaded.bodies)
        fired = fired_shots(numbers, integers, points, mirrors, bodies, seed)
        read = reading_normals(fired.shots.number, seed)
        truth, light = pattern_light(instrument.loaded, instrument.optics, *self._beamlets, fired.shots)
        panorama = None if self.windows is None else self.windows.panorama(window)
        incident, _, peaks = instrument.sense(
            light, fired.shots, truth, fired.aimed, panorama, fixed_size=True
        )
        budget = incident.link_budget()
        return truth, {
            "status": peaks.status,
            "peak": peaks.position,
            "sigma_peak": peaks.sigma,
            "signal": peaks.signal,
            "sigma_signal": peaks.sigma_signal,
            "snr": peaks.snr,
            "laser": budget.laser,
            "window": budget.background,
            "window_error": budget.background_error,
            "background_peak": budget.background_peak,
            "error_theta": fired.error[0],
            "error_phi": fired.error[1],
            "seen_theta": fired.seen[0],
            "seen_phi": fired.seen[1],
            "read_theta": read[0],
            "read_phi": read[1],
        }
