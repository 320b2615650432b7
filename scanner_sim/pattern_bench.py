"""Patterns measured again and again: the steps of a workbench for a fixed number of shots, in frozen kernels.

What Dr.Jit traces for a pattern is the same for every pattern, so it is traced once and launched from then on
(``drjit.freeze``). All that changes goes in as two arrays; all that is measured comes out together. The physics is
:class:`~scanner_sim.workbench.Workbench`'s, function by function, and so are the random numbers, whose addresses are
the shots' numbers. What differs is how the beam is split (:mod:`scanner_sim.render.pattern`).
"""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.encoders import reading_normals, readings
from scanner_sim.pattern_windows import Windows
from scanner_sim.ranging.ranges import Deflections, finished_layers, layers_of
from scanner_sim.scan.raster import Aim
from scanner_sim.workbench import Workbench

Array = NDArray[np.float64]

_ALIGNMENT = 64
"""Alignment of what is handed to the device [bytes]: Dr.Jit makes a kernel for each alignment that it meets."""
_LINE = ("signal", "snr", "laser", "window", "window_error", "brightest")
"""What the line sensor's layers are made of, in the order of their arguments."""


class PatternBench:
    """A workbench that measures patterns of a few hundred shots fast.

    Parameters
    ----------
    workbench
        Instrument, scene and processing.

    Notes
    -----
    Time of flight, and light of several bounces, are measured by the workbench itself, with the same windows of the
    background.
    """

    def __init__(self, workbench: Workbench) -> None:
        self.bench = workbench
        self._steps: dict[int, Any] = {}
        lit, ranging = not workbench.scenario.lighting.sky().dark, workbench.scenario.ranging
        self.windows = Windows.of_line(workbench) if lit and ranging != "tof" else None
        self.field_windows = Windows.of_field(workbench) if lit and ranging != "triangulation" else None

    @property
    def fast(self) -> bool:
        """Whether the scenario is one that frozen kernels measure."""
        scenario = self.bench.scenario
        return scenario.ranging == "triangulation" and scenario.transport.bounces == 1

    @property
    def recordings(self) -> int:
        """How often kernels were recorded so far: once for each length of patterns."""
        return sum(step.recordings for step in self._steps.values())

    def measure(self, aim: Aim) -> dict[str, NDArray[Any]]:
        """Return the layers of a pattern's shots: see :meth:`~scanner_sim.workbench.Workbench.measure`."""
        if not self.fast:
            line, field = (
                None if windows is None else windows.panorama(windows.seen_by(aim))
                for windows in (self.windows, self.field_windows)
            )
            return self.bench.measure(aim, line=line, field=field)
        import drjit.auto.ad as auto

        from scanner_sim.render.shots import Pointing

        bench, mirrors = self.bench, self.bench.scenario.scanner.mirrors
        still = [mirrors.drift(angle, aim.time) for angle in (aim.theta, aim.phi)]
        numbers, integers = self._packed(aim, still)
        window = [] if self.windows is None else self.windows.seen_by(aim)
        step = self._step(len(aim.shot))
        with _nothing_collected():
            truth, found = step(self._reads, auto.Float(numbers), auto.UInt32(integers), window)
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
        ranges = bench.ranges(peak, sigma, status, deflections)
        layers = bench.line_layers(peak, sigma, *(values[name] for name in _LINE)) | layers_of(ranges)
        pointing = Pointing(
            values["error_theta"] + still[0],
            values["error_phi"] + still[1],
            values["seen_theta"],
            values["seen_phi"],
        )
        return finished_layers(layers, ranges, aim, pointing, truth)

    def _packed(self, aim: Aim, still: list[Array]) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
        """Return all that changes from pattern to pattern: column after column, each of the pattern's length."""
        from scanner_sim.render.shots import lattice_place
        from scanner_sim.scene.loader import packed_poses

        scanner, bodies = self.bench.scenario.scanner, self.bench.loaded.bodies
        mirrors, shining = scanner.mirrors, scanner.exposure / scanner.dwell
        numbers: list[NDArray[Any]] = [
            aim.theta,
            aim.theta + still[0],
            aim.phi + still[1],
            shining * aim.travel_theta,
            shining * aim.travel_phi,
        ]
        integers: list[NDArray[Any]] = [aim.shot]
        if mirrors.wobble > 0.0:
            moment = lattice_place(aim.time, mirrors.wobble_time)
            for angle in (aim.theta, aim.phi):
                for cell, part in (lattice_place(angle, mirrors.wobble_angle), moment):
                    integers.append(cell)
                    numbers.append(part)
        if bodies:
            numbers.append(packed_poses([body.item.pose_at(aim.time) for body in bodies]))
        return _joined(numbers, np.float32), _joined(integers, np.uint32)

    @cached_property
    def _beamlets(self) -> tuple[Any, Any]:
        """The chief ray and the beamlets of every shot, on the device."""
        from scanner_sim.render.pattern import chief_beamlet
        from scanner_sim.render.swept_beamlets import SweptTables
        from scanner_sim.render.transport import BeamletTables

        count = self.bench.scenario.transport.pattern_beamlets
        return BeamletTables.of(chief_beamlet()), SweptTables.of(count)

    @cached_property
    def _reads(self) -> list[Any]:
        """What the kernels read besides their arguments: frozen functions must be handed all of it."""
        bench = self.bench
        loaded, throughput = bench.loaded, bench.throughput
        return [
            loaded.mitsuba,
            *(body.mitsuba for body in loaded.bodies),
            loaded.object_of,
            loaded.material_of,
            loaded.coherence,
            self._beamlets,
            throughput.laser,
            throughput.angle,
            throughput.in_band,
            throughput.out_of_band,
            *([] if bench.bias is None else [bench.bias.values]),
        ]

    def _step(self, points: int) -> Any:
        """Return the frozen kernels of patterns of a length."""
        if points not in self._steps:
            from scanner_sim.render.frozen import Frozen

            self._steps[points] = Frozen(
                lambda reads, numbers, integers, window: self._measured(numbers, integers, window, points)
            )
        return self._steps[points]

    def _measured(
        self, numbers: Any, integers: Any, window: list[Any], points: int
    ) -> tuple[Any, dict[str, Any]]:
        """Return truth and measured values of a pattern, Dr.Jit arrays of shape (points,)."""
        import drjit as dr
        import drjit.auto.ad as auto

        from scanner_sim.render.pattern import pattern_light
        from scanner_sim.render.shots import Lattice, Shots, drawn_errors
        from scanner_sim.scene.loader import unpacked_poses

        bench, seed = self.bench, self.bench.scenario.seed
        mirrors, bodies = bench.scenario.scanner.mirrors, bench.loaded.bodies
        lane = dr.arange(auto.UInt32, points)

        def columns(kind: Any, packed: Any, first: int, count: int) -> list[Any]:
            places = (lane + dr.opaque(auto.UInt32, points * (first + number)) for number in range(count))
            return [dr.gather(kind, packed, place) for place in places]

        aimed, theta, phi, travel_theta, travel_phi = columns(auto.Float, numbers, 0, 5)
        (number,) = columns(auto.UInt32, integers, 0, 1)
        mirrors_wobbling = 2 if mirrors.wobble > 0.0 else 0
        lattices = []
        for mirror in range(mirrors_wobbling):
            parts = columns(auto.Float, numbers, 5 + 2 * mirror, 2)
            cells = columns(auto.UInt32, integers, 1 + 2 * mirror, 2)
            lattices.append(Lattice(cells[0], parts[0], cells[1], parts[1]))
        error, seen, synchronisation = drawn_errors(number, lattices, mirrors, seed)
        read = reading_normals(number, seed)
        first = points * (5 + 2 * mirrors_wobbling)
        poses = unpacked_poses(numbers, len(bodies), points, first) if bodies else None
        shots = Shots(
            number, theta + error[0], phi + error[1], travel_theta, travel_phi, synchronisation, poses
        )
        dr.eval(shots, aimed, error, seen, read)
        truth, light = pattern_light(bench.loaded, bench.optics, *self._beamlets, shots)
        panorama = None if self.windows is None else self.windows.panorama(window)
        incident, _, peaks = bench.sense(light, shots, truth.distance, aimed, panorama, whole=True)
        budget = incident.link_budget()
        return truth, {
            "status": peaks.status,
            "peak": peaks.position,
            "sigma_peak": peaks.sigma,
            "signal": peaks.signal,
            "snr": peaks.snr,
            "laser": budget.laser,
            "window": budget.background,
            "window_error": budget.background_error,
            "brightest": budget.brightest,
            "error_theta": error[0],
            "error_phi": error[1],
            "seen_theta": seen[0],
            "seen_phi": seen[1],
            "read_theta": read[0],
            "read_phi": read[1],
        }


@contextlib.contextmanager
def _nothing_collected() -> Iterator[None]:
    """Keep the collector of garbage away: memory of NumPy that it frees while kernels are recorded ends the process."""
    running = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if running:
            gc.enable()


def _joined(columns: list[NDArray[Any]], kind: Any) -> NDArray[Any]:
    """Return columns one after the other, in memory that is aligned and nobody else's."""
    size = sum(len(column) for column in columns)
    memory = np.empty(size + _ALIGNMENT // 4, dtype=kind)
    start = -memory.ctypes.data % _ALIGNMENT // 4
    joined = memory[start : start + size]
    np.concatenate(columns, out=joined, casting="same_kind")
    return joined
