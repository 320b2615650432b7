"""Triangulation before a scene: the laser's spot on the line sensor, its peak, and the range by eq 1."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.built import scanner_as_built
from scanner_sim.config.scanner import Scanner, geometry_of, speckle_optics
from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.line.exposure import (
    Signal,
    Window,
    electrons_per_watt,
    expose,
    pairwise,
)
from scanner_sim.detector.line.position_sensor import PositionSensor
from scanner_sim.detector.line.speckle import LineSpeckle, line_speckle
from scanner_sim.foundation.device_numbers import beside
from scanner_sim.foundation.device_streams import RunSeeds
from scanner_sim.foundation.device_types import Float
from scanner_sim.foundation.streams import Seed
from scanner_sim.instrument.background_rows import scan_rows
from scanner_sim.instrument.expected_light import expected_spot, white_light
from scanner_sim.instrument.line_readings import LineReadings, ShotGroup
from scanner_sim.instrument.optics_as_built import line_throughput
from scanner_sim.instrument.rangefinder import SIGMA_Y, Reading
from scanner_sim.optics.speckle import Optics
from scanner_sim.ranging.ranges import Deflections, Geometry, Layers, Ranges, ranges_from_peaks
from scanner_sim.render.background.panorama import Panorama, known_panorama
from scanner_sim.render.background.view import Rows, panorama_view
from scanner_sim.render.beam.kept_light import KeptLight, on_device
from scanner_sim.render.beam.light import Light, Truth
from scanner_sim.render.beam.line_projection import LineProjection
from scanner_sim.render.beam.splitter import render_light
from scanner_sim.render.beam.surface_positions import SurfacePositions, surface_positions
from scanner_sim.render.incident import Incident, KnownBackground, LinkBudget, Throughput
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout
from scanner_sim.scan.protocol import Aim
from scanner_sim.scene.files.loader import LoadedScene
from scanner_sim.signals.line.bias import Bias, computed_bias, widths_of
from scanner_sim.signals.line.bias_table import read_bias
from scanner_sim.signals.line.dark_line import DarkLine, dark_line
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.own_peak import find_own_peaks
from scanner_sim.signals.line.peaks import Peaks, find_peaks
from scanner_sim.signals.line.speckle import ExpectedSpeckle
from scanner_sim.signals.processing import PEAKS, Processing

Array = NDArray[np.float64]


class Triangulation:
    """The laser that always shines, the lens beside it and the line sensor, before a loaded scene.

    Parameters
    ----------
    scenario
        Instrument, scene and processing.
    loaded
        The scene.
    optics
        Laser, lens and line.
    reuse
        One before the same scene, with the same optics, under the same light and with the same raster, whose background
        is used again.
    true_scanner, geometry
        The scanner with its true lengths, and as it believes itself to be; by default both are as designed.
    """

    prefix = ""
    channels = (SIGMA_Y,)

    def __init__(
        self,
        scenario: Scenario,
        loaded: LoadedScene,
        optics: OpticalLayout,
        reuse: Triangulation | None = None,
        true_scanner: Scanner | None = None,
        geometry: Geometry | None = None,
    ) -> None:
        self.scenario, self.loaded, self.optics, self.reuse = scenario, loaded, optics, reuse
        self.true_scanner = scenario.scanner if true_scanner is None else true_scanner
        self.geometry = geometry_of(scenario.scanner) if geometry is None else geometry
        self.believed = scanner_as_built(scenario.scanner, self.geometry.calibration)
        self.reader: Triangulation | None = None
        """The instrument for which this one takes itself, which finds the peaks on its whole lines; else None."""

    @cached_property
    def throughput(self) -> Throughput:
        """What each pixel makes of the laser's and the Sun's light behind the filter."""
        return line_throughput(self.scenario, self.true_scanner, self.optics)

    @cached_property
    def panorama(self) -> Panorama | None:
        """The background of the scenario's scan, rendered when it is first asked for; None in the dark."""
        if self.scenario.lighting.sky().dark:
            return None
        if self.reuse is not None:
            return self.reuse.panorama
        return self.panorama_of(scan_rows(self.scenario, self.optics))

    def panorama_of(self, rows: Rows) -> Panorama:
        """Return what the line sees of Sun and Earth in some rows."""
        sky, settings = self.scenario.lighting.sky(), self.scenario.transport
        return known_panorama(
            self.loaded,
            self.optics,
            sky,
            panorama_view(rows, self.optics, self.scenario.scanner.position_sensor.pixels),
            settings,
            settings.seed_of_background(self.scenario.seed),
        )

    @property
    def sight(self) -> tuple[OpticalLayout, tuple[float, float]]:
        """The line itself, a pixel of which sees a tangent t along Θ − atan(t), and the angles of its ends [rad]."""
        optics, pixels = self.optics, self.scenario.scanner.position_sensor.pixels
        ends = optics.offset + pixels * optics.pitch, optics.offset
        left, right = (-math.atan(optics.receiver.line_image.tangent(end)) for end in ends)
        return optics, (left, right)

    @cached_property
    def spot(self) -> ExpectedSpot:
        """What is known of the laser's spot before it is seen."""
        return expected_spot(self.believed, self.optics.filter_transmission, self.geometry.calibration)

    @cached_property
    def dark_line(self) -> DarkLine | None:
        """What exposes and reads lines that nothing but the laser lights; None where all pixels count."""
        scenario, scanner = self.scenario, self.scenario.scanner
        lit = not scenario.lighting.sky().dark or self.throughput.stray > 0.0
        if lit or scanner.laser_off > 0.0 or self.own_peak:
            return None
        return dark_line(scanner.position_sensor, scenario.processing, scanner.dwell, self.spot, self.bias)

    def white(self, theta: Float, shots: Shots | None) -> tuple[Float, Float, Float]:
        """Return the light of a white surface, and the sweep; a line by itself is taken to be of a beam at rest."""
        seeds = None if shots is None else shots.seeds
        resting = shots is None and self.scenario.scan.even_travel is None
        sweep = 0.0 if resting else self.travel(shots)[0]
        light = white_light(self.spot, self.believed, self.optics.filter_transmission, theta, seeds)
        return *light, *beside(theta, sweep)

    @property
    def own_peak(self) -> bool:
        """Whether a function of the user's finds the peaks: it reads whole lines, and no kernel holds it."""
        return PEAKS.is_own(self.scenario.processing.peak)

    @cached_property
    def bias(self) -> Bias | None:
        """The estimator's systematic error that is taken off; None where none is."""
        processing = self.scenario.processing
        match processing.bias_correction:
            case "none":
                return None
            case "computed":
                return Bias(computed_bias(processing.peak, *widths_of(self.spot)))
            case path:
                return Bias(read_bias(path))

    @cached_property
    def speckle(self) -> Optics | None:
        """What the laser's speckle depends on, on the line; None for light without speckle."""
        scanner = self.scenario.scanner
        return speckle_optics(scanner) if scanner.laser.speckle else None

    @property
    def columns(self) -> int:
        """Voxels of a row, by which a shot's number tells its row; 1 where there are no rows."""
        return self.scenario.scan.shots_per_row

    def travel(self, shots: Shots | None) -> tuple[float | Float, float | Float]:
        """Return the angles by which the beams of shots move while the laser shines, along the line and across [rad].

        In a raster they are all alike, and no shots are needed. Else of shape (m,), Dr.Jit.
        """
        even, scanner = (self.scenario.scan if shots is None else shots).even_travel, self.scenario.scanner
        if even is not None:
            return even * scanner.exposure / scanner.dwell, 0.0
        if shots is None:
            raise ValueError("only the shots of a raster all move alike")
        along, across = shots.ways
        return along, across

    def expected_speckle(self, shots: Shots | None = None) -> ExpectedSpeckle | None:
        """Return what the instrument knows of the speckle of shots; None where there is none.

        It knows how fast its mirrors turn. In a raster no shots are needed.
        """
        if self.speckle is None:
            return None
        return ExpectedSpeckle(self.speckle, self.scenario.processing.speckle_contrast, self.travel(shots))

    def _speckle(
        self,
        light: Light,
        shots: Shots,
        surfaces: SurfacePositions | None,
        seed: Seed,
        fixed_size: bool = False,
    ) -> LineSpeckle | None:
        """Return the speckle of shots whose beams are at positions on surfaces; None for light without."""
        if self.speckle is None or surfaces is None:
            return None
        return line_speckle(
            light,
            surfaces,
            speckle_optics(self.true_scanner),
            self.optics.receiver.focal_length / self.optics.pitch,
            self.optics.seen_at(shots.theta),
            self.travel(shots),
            self.scenario.scanner.position_sensor.pixels,
            seed,
            fixed_size=fixed_size,
        )

    def measure(
        self, aim: Aim, shots: Shots, deflections: Deflections, background: Panorama | None = None
    ) -> Reading:
        """Return what the line reads of n shots: see :class:`~scanner_sim.instrument.rangefinder.Rangefinder`."""
        truth, groups = self.expose(shots, background, whole=False)
        return self.reading(truth, self.gathered(len(aim.shot), groups), deflections)

    def gathered(self, count: int, groups: Iterable[ShotGroup]) -> LineReadings:
        """Return what the line told of so many shots from their groups."""
        # All groups are launched before the first is read: the device does not wait for the host between them.
        parts = [(group.light.light.index, group.readings()) for group in groups]
        return LineReadings.gathered(count, ((index.numpy(), told) for index, told in parts))

    def reading(self, truth: Truth, line: LineReadings, deflections: Deflections) -> Reading:
        """Return ranges and layers of n shots from what the line told of all of them."""
        ranges = self.ranges(line.position, line.sigma, line.status, deflections)
        return Reading(truth, ranges, self._layers(line))

    def _layers(self, line: LineReadings) -> Layers:
        scanner = self.scenario.scanner
        electrons = electrons_per_watt(scanner.position_sensor, scanner.laser.wavelength, scanner.exposure)
        with np.errstate(divide="ignore", invalid="ignore"):
            contrast = line.laser / line.background
        return {
            "Y": line.signal,
            "sigma_Y": line.sigma_signal,
            "snr": contrast,
            "snr_detection": line.snr,
            "background": line.background * electrons,
            "background_error": line.background_error * electrons,
            "background_peak": line.background_peak * electrons,
            "peak_px": line.position,
            "sigma_peak_px": line.sigma,
        }

    def expose(
        self, shots: Shots, background: Panorama | None = None, *, whole: bool = True
    ) -> tuple[Truth, Iterator[ShotGroup]]:
        """Render, expose and read shots as they are fired: their truth, and the shots in groups.

        ``whole`` as of :meth:`sense`.
        """
        scenario = self.scenario
        seen = self.panorama if background is None else background
        line = LineProjection(self.optics)
        seed = scenario.transport.seed_of_light(scenario.seed)
        truth, lights = render_light(self.loaded, line, scenario.transport, shots, seed)

        def groups() -> Iterator[ShotGroup]:
            for light in lights:
                own, met = shots.take(light.index), truth.take(light.index)
                yield ShotGroup(
                    *self.sense(light, own, met, own.commanded, seen, whole=whole, seeds=own.seeds)
                )

        return truth, groups()

    def sense(
        self,
        light: Light,
        shots: Shots,
        truth: Truth,
        theta: Float,
        panorama: Panorama | None,
        *,
        fixed_size: bool = False,
        whole: bool = False,
        seeds: RunSeeds | None = None,
    ) -> tuple[Incident, Signal, Peaks]:
        """Expose the line to the light of m shots, read it and find the peaks.

        Parameters
        ----------
        light
            The laser's light of the shots.
        shots, truth
            The shots, and what their chief rays meet.
        theta
            Commanded deflections Θ [rad], single precision, shape (m,).
        panorama
            The background, or None in the dark.
        fixed_size
            Whether no array's size may depend on the light.
        whole
            Whether all pixels are wanted: else only those are exposed that can change the peaks.
        seeds
            Of the runs that the shots belong to; by default the scenario's.

        Returns
        -------
        tuple
            All the light on the line, the signal and the peaks.
        """
        own = self.scenario.seed if seeds is None else seeds.lanes
        grainy = self.speckle is not None
        surfaces = surface_positions(self.loaded, self.optics, shots, truth) if grainy else None
        speckle = self._speckle(light, shots, surfaces, own, fixed_size)
        incident = Incident(light, shots, self.columns, self.throughput, panorama, speckle)
        return incident, *self._read(incident, theta, whole=whole, seeds=seeds)

    def keep(self, shots: Shots, background: Panorama | None = None) -> tuple[KeptLight, Iterator[Incident]]:
        """Return the light of n shots before speckle, in NumPy's memory, and with its background, in groups.

        Together the groups hold every shot once.
        """
        transport, seed = self.scenario.transport, self.scenario.seed
        line, seen = LineProjection(self.optics), self.panorama if background is None else background
        truth, lights = render_light(self.loaded, line, transport, shots, transport.seed_of_light(seed))
        every = list(lights)
        kept = KeptLight.of(self.loaded, self.optics, shots, truth, every)
        return kept, (
            Incident(light, shots.take(light.index), self.columns, self.throughput, seen) for light in every
        )

    def read_kept(
        self,
        kept: KeptLight,
        shots: Shots,
        budget: LinkBudget,
        background: NDArray[np.float32] | None,
        *,
        whole: bool = True,
    ) -> Iterator[ShotGroup]:
        """Expose and read lines whose light was kept, as :meth:`expose` does, without the scene.

        Parameters
        ----------
        kept, shots
            The light of n shots, and the shots.
        budget, background
            As the paper counts it, arrays of shape (n,), and that of Sun and Earth on the pixels [W], (n, pixels).
        whole
            As of :meth:`sense`.
        """
        for group in kept.groups(shots.number.numpy()):
            index, light = group.index, group.light
            own = shots.take(light.index)
            counted = LinkBudget(*(on_device(getattr(budget, field.name)[index]) for field in fields(budget)))
            power = None if background is None else on_device(background[index])
            speckle = self._speckle(light, own, group.surfaces, self.scenario.seed)
            known = KnownBackground(power, counted)
            incident = Incident(light, own, self.columns, self.throughput, None, speckle, known)
            yield ShotGroup(incident, *self._read(incident, own.commanded, whole=whole))

    def _read(
        self, incident: Incident, theta: Float, *, whole: bool, seeds: RunSeeds | None = None
    ) -> tuple[Signal, Peaks]:
        """Expose the line to light and find its peaks; arguments as of :meth:`sense`."""
        scanner, light, shots = self.scenario.scanner, incident.light, incident.shots
        sensor = scanner.position_sensor
        if whole or self.reader is not None or incident.is_lit or self.dark_line is None:
            signal = self._expose(incident, light, seeds=seeds)
            return signal, (self.reader or self).find(signal, theta, shots)
        low, high, power = light.extent()
        (electrons,) = beside(power, electrons_per_watt(sensor, scanner.laser.wavelength, scanner.exposure))
        charge = power * electrons
        return self.dark_line.read(
            lambda window, onto: self._expose(incident, light, window, onto, seeds),
            (low, high, charge),
            theta,
            self.expected_speckle(shots),
            self.white(theta, shots),
        )

    def _expose(
        self,
        incident: Incident,
        light: Light,
        window: Window | None = None,
        onto: Signal | None = None,
        seeds: RunSeeds | None = None,
    ) -> Signal:
        scanner = self.scenario.scanner
        return expose(
            incident.pair,
            light.shot,
            scanner.position_sensor,
            scanner.laser.wavelength,
            scanner.dwell,
            self.scenario.seed if seeds is None else seeds,
            background=pairwise(incident.unlit),
            laser_off=scanner.laser_off,
            window=window,
            onto=onto,
        )

    def find(
        self,
        signal: Signal,
        theta: Float,
        shots: Shots | None = None,
        *,
        sensor: PositionSensor | None = None,
        processing: Processing | None = None,
        speckle: bool = True,
    ) -> Peaks:
        """Find the peaks on the lines of m shots by what this instrument knows of itself.

        Parameters
        ----------
        signal
            The lines.
        theta
            Commanded deflections Θ [rad], single precision, shape (m,).
        shots
            The shots; in a raster they are not needed.
        sensor, processing
            The sensor as it is known and the settings, where they are not the scenario's.
        speckle
            Whether the instrument reckons with speckle, where it has any.
        """
        scanner = self.scenario.scanner
        sensor, processing = sensor or scanner.position_sensor, processing or self.scenario.processing
        known = self.expected_speckle(shots) if speckle else None
        if own := PEAKS.function(processing.peak):
            return find_own_peaks(own, signal, sensor, processing, scanner.dwell, self.spot, theta, known)
        spot = self.spot.lit(*self.white(theta, shots))
        return find_peaks(signal, sensor, processing, scanner.dwell, spot, theta, self.bias, known)

    def ranges(
        self, peak: Array, sigma_peak: Array, status: NDArray[np.uint32], deflections: Deflections
    ) -> Ranges:
        """Return the ranges of peaks (arguments as those of :func:`~scanner_sim.ranging.ranges.ranges_from_peaks`)."""
        gate = self.scenario.processing.range_gate
        return ranges_from_peaks(peak, sigma_peak, status, deflections, self.geometry, gate)
