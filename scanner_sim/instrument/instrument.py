"""An instrument before a scene: each step of the flow in its order, for any aim.

Aim → light → signal → peaks → ranges. Truth goes past the estimators, straight into layers of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.scanner import speckle_optics
from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.encoders import read_encoders
from scanner_sim.detector.line.exposure import Signal, electrons_per_watt, expose
from scanner_sim.detector.line.position_sensor import PositionSensor
from scanner_sim.detector.line.speckle import LineSpeckle, line_speckle
from scanner_sim.foundation.device_types import Float
from scanner_sim.instrument.time_of_flight import TimeOfFlight
from scanner_sim.optics.band_irradiance import band_irradiance
from scanner_sim.optics.filter import incidence, laser_gain, peak_transmission
from scanner_sim.optics.speckle import Optics
from scanner_sim.ranging.fusion import fuse_points
from scanner_sim.ranging.ranges import (
    Deflections,
    Geometry,
    Layers,
    Ranges,
    layers_of,
    ranges_from_peaks,
    with_truth,
)
from scanner_sim.render.background.panorama import Panorama, render_panorama
from scanner_sim.render.background.sky import light_of
from scanner_sim.render.background.view import panorama_view
from scanner_sim.render.beam.light import Light, Truth
from scanner_sim.render.beam.line_projection import LineProjection
from scanner_sim.render.beam.splitter import render_light
from scanner_sim.render.beam.surface_positions import surface_positions
from scanner_sim.render.device import activate
from scanner_sim.render.incident import Incident, Throughput
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.render.shots import Pointing, Shots, true_shots
from scanner_sim.render.transport import OpticalLayout
from scanner_sim.scan.raster import Aim, RasterScan
from scanner_sim.scene.files.loader import LoadedScene, load_scene
from scanner_sim.signals.line.bias import Bias, computed_bias, widths_of
from scanner_sim.signals.line.bias_table import read_bias
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.peaks import Peaks, find_peaks
from scanner_sim.signals.line.speckle import ExpectedSpeckle
from scanner_sim.signals.processing import Processing

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ShotGroup:
    """Shots of a batch that went through the sensor together, with everything on the way."""

    index: NDArray[np.uint32]
    light: Incident
    signal: Signal
    peaks: Peaks


class Instrument:
    """An instrument before a loaded scene, ready to measure any aim.

    Parameters
    ----------
    scenario
        Instrument, scene and processing.
    device, threads
        Where to compute.
    reuse
        An instrument before the same scene, with the same optics, raster and light: what it has loaded and rendered of
        these is used again.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        device: DeviceChoice = "auto",
        threads: int | None = None,
        reuse: Instrument | None = None,
    ) -> None:
        activate(device, threads)
        scanner = scenario.scanner
        sensor, receiver = scanner.position_sensor, scanner.receiver
        self.scenario = scenario
        self.reuse = reuse
        self.loaded: LoadedScene = load_scene(scenario.scene) if reuse is None else reuse.loaded
        self.optics = OpticalLayout(
            laser=scanner.laser,
            receiver=receiver,
            axis_separation=scanner.mirrors.axis_separation,
            filter_transmission=peak_transmission(scanner.filter),
            pitch=sensor.pitch,
            height=sensor.height,
            offset=sensor.offset,
            diffusion=sensor.diffusion,
        )
        self.geometry = Geometry(
            focal_length=receiver.focal_length,
            baseline=receiver.baseline,
            axis_separation=scanner.mirrors.axis_separation,
            pitch=sensor.pitch,
            offset=sensor.offset,
            synchronisation=scanner.mirrors.synchronisation,
        )

    @cached_property
    def throughput(self) -> Throughput:
        """What each pixel makes of the laser's and the Sun's light behind the filter."""
        scanner, lighting = self.scenario.scanner, self.scenario.lighting
        sensor = scanner.position_sensor
        position = self.geometry.position(np.arange(sensor.pixels, dtype=np.float64))
        angle = incidence(position, scanner.receiver.focal_length)
        bands = np.zeros((2, sensor.pixels))
        if lighting.sun != "none":
            bands[:] = band_irradiance(
                lighting.sun, scanner.filter, sensor.response, scanner.laser.wavelength, angle
            )
        laser = laser_gain(scanner.filter, scanner.laser, sensor.response, angle)
        return Throughput(self.optics, sensor.pixels, laser, *bands)

    @cached_property
    def panorama(self) -> Panorama | None:
        """The background of the scenario's raster, rendered when it is first asked for; None in the dark."""
        sky, settings = self.scenario.lighting.sky(), self.scenario.transport
        if sky.dark:
            return None
        if self.reuse is not None:
            return self.reuse.panorama
        scan, dwell = self.scenario.raster, self.scenario.scanner.dwell
        pixels = self.scenario.scanner.position_sensor.pixels
        return render_panorama(
            self.loaded,
            self.optics,
            light_of(sky),
            panorama_view(scan.horizontal, scan.angles()[1], self.optics, pixels, scan.row_times(dwell)),
            bounces=settings.background_bounces,
            samples=settings.background_samples,
            seed=self.scenario.seed,
        )

    @cached_property
    def spot(self) -> ExpectedSpot:
        """What is known of the laser's spot before it is seen."""
        scanner = self.scenario.scanner
        passed = laser_gain(scanner.filter, scanner.laser, scanner.position_sensor.response)
        return ExpectedSpot.of(
            scanner.laser,
            scanner.receiver,
            self.optics.filter_transmission * float(passed),
            scanner.position_sensor,
            scanner.exposure,
        )

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
        scan = self.scenario.scan
        return scan.columns if isinstance(scan, RasterScan) else 1

    def travel(self, shots: Shots | None) -> tuple[float | Float, float | Float]:
        """Return the angles by which the beams of shots move while the laser shines, along the line and across [rad].

        In a raster they are all alike, and no shots are needed; else of shape (m,), Dr.Jit.
        """
        scan, scanner = self.scenario.scan, self.scenario.scanner
        if isinstance(scan, RasterScan):
            return scan.travel * scanner.exposure / scanner.dwell, 0.0
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

    def _speckle(self, light: Light, shots: Shots, truth: Truth, fixed_size: bool) -> LineSpeckle | None:
        """Return the speckle of shots whose chief rays meet something; None for light without."""
        if self.speckle is None:
            return None
        return line_speckle(
            light,
            surface_positions(self.loaded, self.optics, shots, truth),
            self.speckle,
            self.optics.receiver.focal_length / self.optics.pitch,
            self.travel(shots),
            self.scenario.scanner.position_sensor.pixels,
            self.scenario.seed,
            fixed_size=fixed_size,
        )

    @cached_property
    def echoes(self) -> TimeOfFlight:
        """The time-of-flight unit before the same scene."""
        reuse = None if self.reuse is None else self.reuse.echoes
        return TimeOfFlight(self.scenario, self.loaded, self.optics, reuse)

    def measure(
        self, aim: Aim, *, line: Panorama | None = None, field: Panorama | None = None, details: bool = False
    ) -> Layers:
        """Return the layers of the shots of an aim: each of shape (n,).

        Layers without a prefix hold the triangulation where there is one, and otherwise time of flight. ``line`` and
        ``field`` are the panoramas that line sensor and photodiode see, where they are not the raster's. ``details``
        adds what images do not keep: ``sigma_Y``, the standard deviation of the line's ``Y`` by all but speckle.
        """
        shots, pointing = self.fire(aim)
        deflections = self.deflections(aim, pointing)
        layers: Layers = {}
        ranging = self.scenario.ranging
        if ranging != "tof":
            truth, ranges, layers = self._triangulated(aim, shots, deflections, line)
            if not details:
                del layers["sigma_Y"]
        if ranging != "triangulation":
            truth, echo, more = self.echoes.measure(shots, deflections, field)
            layers |= more
            if ranging == "tof":
                ranges, layers["Y"] = echo, more["tof.Y"]
            else:
                fused, ranges, echo = fuse_points(ranges, echo, deflections, self.geometry)
                layers |= layers_of(fused, "fused.")
            layers |= layers_of(echo, "tof.")
        layers |= layers_of(ranges)
        return with_truth(layers, ranges, aim, pointing, truth)

    def _triangulated(
        self, aim: Aim, shots: Shots, deflections: Deflections, panorama: Panorama | None
    ) -> tuple[Truth, Ranges, Layers]:
        """Return truth, ranges and the line sensor's own layers."""
        truth, groups = self._exposed(aim, shots, panorama)
        n = len(aim.shot)
        peak, sigma_peak, signal, sigma_signal, snr, laser, window, error, background_peak = (
            np.full(n, np.nan) for _ in range(9)
        )
        status = np.zeros(n, dtype=np.uint32)
        for group in groups:
            peaks = group.peaks
            peak[group.index] = peaks.position.numpy()
            sigma_peak[group.index] = peaks.sigma.numpy()
            signal[group.index] = peaks.signal.numpy()
            sigma_signal[group.index] = peaks.sigma_signal.numpy()
            snr[group.index] = peaks.snr.numpy()
            budget = group.light.link_budget()
            laser[group.index] = budget.laser.numpy()
            window[group.index] = budget.background.numpy()
            error[group.index] = budget.background_error.numpy()
            background_peak[group.index] = budget.background_peak.numpy()
            status[group.index] = peaks.status.numpy()
        ranges = self.ranges(peak, sigma_peak, status, deflections)
        layers = self.line_layers(peak, sigma_peak, signal, snr, laser, window, error, background_peak)
        return truth, ranges, layers | {"sigma_Y": sigma_signal}

    def line_layers(
        self,
        peak: Array,
        sigma_peak: Array,
        signal: Array,
        snr: Array,
        laser: Array,
        window: Array,
        error: Array,
        background_peak: Array,
    ) -> Layers:
        """Return the line sensor's own layers, from its peaks and the light of each shot as the paper counts it.

        All of shape (n,): what :class:`~scanner_sim.signals.line.peaks.Peaks` and
        :class:`~scanner_sim.render.incident.LinkBudget` hold.
        """
        scanner = self.scenario.scanner
        electrons = electrons_per_watt(scanner.position_sensor, scanner.laser.wavelength, scanner.exposure)
        with np.errstate(divide="ignore", invalid="ignore"):
            contrast = laser / window
        return {
            "Y": signal,
            "snr": contrast,
            "snr_detection": snr,
            "background": window * electrons,
            "background_error": error * electrons,
            "background_peak": background_peak * electrons,
            "peak_px": peak,
            "sigma_peak_px": sigma_peak,
        }

    def expose(self, aim: Aim) -> tuple[Truth, Iterator[ShotGroup]]:
        """Render, expose and read the shots of an aim: their truth, and the shots in groups."""
        return self._exposed(aim, self.fire(aim)[0])

    def fire(self, aim: Aim) -> tuple[Shots, Pointing]:
        """Return the shots of an aim as the mirrors' errors let them go, and these errors."""
        scanner = self.scenario.scanner
        poses = self.loaded.poses_at(aim.time)
        return true_shots(aim, scanner.mirrors, self.scenario.seed, scanner.exposure / scanner.dwell, poses)

    def _exposed(
        self, aim: Aim, shots: Shots, panorama: Panorama | None = None
    ) -> tuple[Truth, Iterator[ShotGroup]]:
        scenario = self.scenario
        seen = self.panorama if panorama is None else panorama
        line = LineProjection(self.optics)
        truth, lights = render_light(self.loaded, line, scenario.transport, shots, scenario.seed)

        def groups() -> Iterator[ShotGroup]:
            for light in lights:
                index = light.index.numpy()
                theta = aim.theta[index].astype(np.float32)
                own, met = shots.take(light.index), truth.take(light.index)
                yield ShotGroup(index, *self.sense(light, own, met, theta, seen))

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

        Returns
        -------
        tuple
            All the light on the line, the signal and the peaks.
        """
        scenario, scanner = self.scenario, self.scenario.scanner
        sensor = scanner.position_sensor
        speckle = self._speckle(light, shots, truth, fixed_size)
        incident = Incident(light, shots, self.columns, self.throughput, panorama, speckle)
        signal = expose(
            incident.power,
            light.shot,
            sensor,
            scanner.laser.wavelength,
            scanner.dwell,
            scenario.seed,
            background=incident.background,
            laser_off=scanner.laser_off,
        )
        return incident, signal, self.find(signal, theta, shots)

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
        return find_peaks(
            signal,
            scanner.position_sensor if sensor is None else sensor,
            self.scenario.processing if processing is None else processing,
            scanner.dwell,
            self.spot,
            theta,
            self.bias,
            self.expected_speckle(shots) if speckle else None,
        )

    def deflections(self, aim: Aim, pointing: Pointing) -> Deflections:
        """Return what the encoders read, with what the instrument knows of their errors."""
        mirrors = self.scenario.scanner.mirrors
        theta, phi = read_encoders(
            aim.shot,
            aim.theta + pointing.seen_theta,
            aim.phi + pointing.seen_phi,
            mirrors,
            self.scenario.seed,
        )
        return Deflections(
            theta, phi, mirrors.reading_sigma(theta, aim.time), mirrors.reading_sigma(phi, aim.time)
        )

    def ranges(
        self, peak: Array, sigma_peak: Array, status: NDArray[np.uint32], deflections: Deflections
    ) -> Ranges:
        """Return the ranges of peaks (arguments as those of :func:`~scanner_sim.ranging.ranges.ranges_from_peaks`)."""
        gate = self.scenario.processing.range_gate
        return ranges_from_peaks(peak, sigma_peak, status, deflections, self.geometry, gate)
