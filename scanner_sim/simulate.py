"""The instrument at work: each step of the flow in its order, batch by batch.

Scenario → aim → light → signal → peaks → ranges → image. Truth goes past the estimators, straight into layers
of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config import resolved_yaml
from scanner_sim.errors import InputError
from scanner_sim.optics.filter import band_irradiance, incidence, laser_gain, peak_transmission
from scanner_sim.products.image import RangeImage
from scanner_sim.products.voxel import VoxelRecord
from scanner_sim.ranging.ranges import Geometry, Ranges, ranges_from_peaks
from scanner_sim.ranging.triangulation import position_from_range
from scanner_sim.render.device import DeviceChoice, activate
from scanner_sim.scan.raster import Aim, raster_aim, tiled_order
from scanner_sim.scenario import Scenario
from scanner_sim.status import Status

BATCH = 65536
"""Shots that go through the kernels together: about 0.3 GB."""

Progress = Callable[[int, int], None]
"""Called with the shots done and the shots in all."""


def simulate(
    scenario: Scenario,
    *,
    device: DeviceChoice = "auto",
    progress: Progress | None = None,
    batch: int = BATCH,
    threads: int | None = None,
) -> RangeImage:
    """Simulate a raster scan.

    Parameters
    ----------
    scenario
        Instrument, scene, scan and processing.
    device
        Where to compute.
    progress
        Called after each batch.
    batch
        Shots per batch; the result does not depend on it.
    threads
        Threads of the processor; the result does not depend on it.

    Returns
    -------
    RangeImage

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the device cannot be used, or ``batch`` is not positive.
    """
    if batch < 1:
        raise InputError("a batch needs at least one shot.")
    bench = Workbench(scenario, device=device, threads=threads)
    scan = scenario.scan
    order = tiled_order(scan)
    layers: dict[str, NDArray[np.float32]] = {}
    for start in range(0, scan.shots, batch):
        shots = order[start : start + batch]
        for name, values in bench.measure(raster_aim(scan, shots)).items():
            if name not in layers:
                layers[name] = np.empty(scan.shots, dtype=np.float32)
            layers[name][shots] = values
        if progress is not None:
            progress(start + len(shots), scan.shots)
    theta, phi = scan.angles()
    return RangeImage(
        channels={name: values.reshape(scan.rows, scan.columns) for name, values in layers.items()},
        theta=theta,
        phi=phi,
        objects=bench.loaded.objects,
        materials=bench.loaded.materials,
        seed=scenario.seed,
        scenario_yaml=resolved_yaml(scenario),
        warnings=_warnings(layers),
    )


def simulate_voxel(
    scenario: Scenario, row: int, column: int, *, device: DeviceChoice = "auto"
) -> VoxelRecord:
    """Simulate one voxel of a raster scan and keep its line: the same numbers as in the whole image.

    Raises
    ------
    InputError
        If the raster has no such voxel.
    """
    scan = scenario.scan
    if not (0 <= row < scan.rows and 0 <= column < scan.columns):
        raise InputError(
            f"voxel ({row}, {column}) lies outside of the {scan.rows} × {scan.columns} raster.",
            remedy="Rows and columns count from 0.",
        )
    bench = Workbench(scenario, device=device)
    return bench.record(row, column)


@dataclass(frozen=True)
class Group:
    """Shots of a batch that went through the sensor together, with everything on the way."""

    index: NDArray[np.uint32]
    light: Any
    signal: Any
    peaks: Any


class Workbench:
    """An instrument before a loaded scene, ready to measure any aim.

    Parameters
    ----------
    scenario
        Instrument, scene and processing.
    device, threads
        Where to compute.
    """

    def __init__(
        self, scenario: Scenario, *, device: DeviceChoice = "auto", threads: int | None = None
    ) -> None:
        activate(device, threads)
        from scanner_sim.render.transport import Bench
        from scanner_sim.scene.loader import load_scene

        scanner = scenario.scanner
        sensor, receiver = scanner.position_sensor, scanner.receiver
        self.scenario = scenario
        self.loaded = load_scene(scenario.scene)
        self.optics = Bench(
            laser=scanner.laser,
            receiver=receiver,
            axis_separation=scanner.mirrors.axis_separation,
            filter_transmission=peak_transmission(scanner.filter),
            pitch=sensor.pitch,
            height=sensor.height,
            offset=sensor.offset,
        )
        self.geometry = Geometry(
            focal_length=receiver.focal_length,
            baseline=receiver.baseline,
            axis_separation=scanner.mirrors.axis_separation,
            pitch=sensor.pitch,
            offset=sensor.offset,
            sigma_angle=scanner.mirrors.jitter,
        )
        self.throughput = self._throughput()
        self.panorama = self._panorama()

    def _throughput(self) -> Any:
        """Return what each pixel makes of the laser's and the Sun's light behind the filter."""
        from scanner_sim.render.incident import Throughput

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

    def _panorama(self) -> Any:
        """Render the background of the scenario's raster; None in the dark."""
        from scanner_sim.render.background import panorama_view, render_panorama
        from scanner_sim.render.paths import Albedo
        from scanner_sim.render.sky import sky_light

        sky, settings, scan = self.scenario.lighting.sky(), self.scenario.transport, self.scenario.scan
        if sky.dark:
            return None
        light = sky_light(
            sky.sun_direction,
            sky.sun_angular_radius,
            sky.earth_direction,
            sky.earth_altitude,
            sky.earth_radius,
        )
        pixels = self.scenario.scanner.position_sensor.pixels
        return render_panorama(
            self.loaded,
            self.optics,
            light,
            Albedo(sky.albedo, sky.albedo_out_of_band),
            panorama_view(scan.horizontal, scan.angles()[1], self.optics, pixels),
            bounces=settings.background_bounces,
            samples=settings.background_samples,
            seed=self.scenario.seed,
        )

    def measure(self, aim: Aim) -> dict[str, NDArray[Any]]:
        """Return the layers of the shots of an aim: each of shape (n,)."""
        from scanner_sim.detector.line import electrons_per_watt

        truth, groups = self.expose(aim)
        n = len(aim.shot)
        peak, sigma_peak, signal, snr, laser, window, brightest = (np.full(n, np.nan) for _ in range(7))
        status = np.zeros(n, dtype=np.uint32)
        for group in groups:
            peaks = group.peaks
            peak[group.index] = peaks.position.numpy()
            sigma_peak[group.index] = peaks.sigma.numpy()
            signal[group.index] = peaks.signal.numpy()
            snr[group.index] = peaks.snr.numpy()
            for values, layer in zip(group.light.link_budget(), (laser, window, brightest), strict=True):
                layer[group.index] = values.numpy()
            status[group.index] = peaks.status.numpy()
        ranges = self._ranges(peak, sigma_peak, status, aim)
        invalid = ranges.status != Status.VALID
        peak[invalid] = sigma_peak[invalid] = np.nan
        scanner = self.scenario.scanner
        electrons = electrons_per_watt(scanner.position_sensor, scanner.laser.wavelength, scanner.dwell)
        with np.errstate(divide="ignore", invalid="ignore"):
            contrast = laser / window
        return {
            "range_m": ranges.range,
            "sigma_range_m": ranges.sigma,
            "P.X": ranges.x,
            "P.Y": ranges.y,
            "P.Z": ranges.z,
            "Y": signal,
            "snr": contrast,
            "snr_detection": snr,
            "background": window * electrons,
            "background_peak": brightest * electrons,
            "peak_px": peak,
            "sigma_peak_px": sigma_peak,
            "status": ranges.status,
            "truth.range_m": truth.distance.numpy(),
            "truth.object": truth.object.numpy(),
            "truth.material": truth.material.numpy(),
        }

    def record(self, row: int, column: int) -> VoxelRecord:
        """Return the record of one voxel of the scenario's raster."""
        from scanner_sim.detector.line import electrons_per_watt
        from scanner_sim.signals.peaks import Calibration

        scanner, processing = self.scenario.scanner, self.scenario.processing
        sensor = scanner.position_sensor
        shot = np.array([row * self.scenario.scan.columns + column], dtype=np.uint32)
        aim = raster_aim(self.scenario.scan, shot)
        truth, groups = self.expose(aim)
        (group,) = groups
        peaks = group.peaks
        ranges = self._ranges(
            peaks.position.numpy().astype(np.float64),
            peaks.sigma.numpy().astype(np.float64),
            peaks.status.numpy(),
            aim,
        )
        status = Status(int(ranges.status[0]))
        calibration = Calibration.of(sensor, scanner.dwell)
        measured = calibration.charge(group.signal.lines()[0].astype(np.float64))
        expected = group.light.line(0) * electrons_per_watt(sensor, scanner.laser.wavelength, scanner.dwell)
        true_range = truth.distance.numpy().astype(np.float64)
        true_position = position_from_range(
            true_range, aim.theta, self.geometry.focal_length, self.geometry.baseline
        )
        return VoxelRecord(
            row=row,
            column=column,
            theta=float(aim.theta[0]),
            phi=float(aim.phi[0]),
            pixel_signal=measured,
            expected_signal=expected,
            noise_sigma=np.sqrt(calibration.variance(measured)),
            threshold=processing.threshold * calibration.floor_sigma,
            saturation_level=calibration.full - calibration.dark,
            status=status,
            peak_px=float(peaks.position.numpy()[0]) if status is Status.VALID else float("nan"),
            sigma_peak_px=float(peaks.sigma.numpy()[0]) if status is Status.VALID else float("nan"),
            range_m=float(ranges.range[0]),
            sigma_range_m=float(ranges.sigma[0]),
            truth_peak_px=float(self.geometry.pixel(true_position)[0]),
            truth_range_m=float(true_range[0]),
            method=processing.peak,
            window=_window(measured, processing.peak, status),
        )

    def expose(self, aim: Aim) -> tuple[Any, Iterator[Group]]:
        """Render, expose and read the shots of an aim: their truth, and the shots in groups."""
        from scanner_sim.detector.line import expose
        from scanner_sim.render.incident import Incident
        from scanner_sim.render.light import render_light
        from scanner_sim.render.shots import true_shots
        from scanner_sim.signals.peaks import find_peaks

        scenario, scanner = self.scenario, self.scenario.scanner
        sensor, seed = scanner.position_sensor, scenario.seed
        shots = true_shots(aim, scanner.mirrors.jitter, seed)
        truth, lights = render_light(self.loaded, self.optics, scenario.transport, shots, seed)

        def groups() -> Iterator[Group]:
            for light in lights:
                incident = Incident(
                    light, shots.some(light.index), scenario.scan.columns, self.throughput, self.panorama
                )
                signal = expose(
                    incident.power, light.shot, sensor, scanner.laser.wavelength, scanner.dwell, seed
                )
                peaks = find_peaks(signal, sensor, scenario.processing, scanner.dwell)
                yield Group(light.index.numpy(), incident, signal, peaks)

        return truth, groups()

    def _ranges(self, peak: NDArray[Any], sigma_peak: NDArray[Any], status: NDArray[Any], aim: Aim) -> Ranges:
        gate = self.scenario.processing.range_gate
        return ranges_from_peaks(peak, sigma_peak, status, aim.theta, aim.phi, self.geometry, gate)


def _window(line: NDArray[np.float64], method: Any, status: Status) -> tuple[int, int] | None:
    """Return the pixels that the estimator read."""
    from scanner_sim.signals.peaks import MARGIN

    if status not in (Status.VALID, Status.OUT_OF_GATE):
        return None
    brightest, margin = int(np.argmax(line)), MARGIN[method]
    return brightest - margin, brightest + margin


def _warnings(layers: dict[str, NDArray[np.float32]]) -> tuple[str, ...]:
    """Return sentences on results that look unintended."""
    if not layers["truth.object"].any():
        return ("nothing was hit: no object stands where the scanner points",)
    if not (layers["status"] == Status.VALID).any():
        return ("no voxel has a valid range: see the counts of status",)
    return ()
