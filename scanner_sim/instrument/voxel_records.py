"""One voxel in full: line, what the estimator made of it, and the truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.line.exposure import electrons_per_watt
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.common_errors import ReadingsOfTheta, add_common_errors
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.neighbourhood import judge_neighbours, reach
from scanner_sim.products.voxel import VoxelRecord
from scanner_sim.render.beam.line_projection import chief_image
from scanner_sim.scan.raster import raster_aim
from scanner_sim.signals.line.calibration import SensorCalibration, measured_lines
from scanner_sim.signals.line.peaks import MARGIN
from scanner_sim.signals.processing import PeakMethod


def voxel_record(instrument: Instrument, row: int, column: int) -> VoxelRecord:
    """Return the record of one voxel of an instrument's raster: its line, peak and range, and the truth."""
    scanner, processing = instrument.scenario.scanner, instrument.scenario.processing
    sensor = scanner.position_sensor
    values = _among_neighbours(instrument, row, column)
    shot = np.array([row * instrument.scenario.raster.columns + column], dtype=np.uint32)
    aim = raster_aim(instrument.scenario.raster, shot, scanner.dwell)
    truth, groups = instrument.expose(aim)
    (group,) = groups
    (true_peak,) = chief_image(instrument.optics, group.light.shots, truth)
    status = Status(int(values["status"]))
    calibration = SensorCalibration.of(sensor, scanner.dwell, scanner.laser_off)
    (measured,), (noise,) = measured_lines(group.signal, calibration)
    expected = group.light.line(0, background=scanner.laser_off == 0.0)
    expected *= electrons_per_watt(sensor, scanner.laser.wavelength, scanner.exposure)
    return VoxelRecord(
        row=row,
        column=column,
        theta=float(aim.theta[0]),
        phi=float(aim.phi[0]),
        pixel_signal=measured,
        expected_signal=expected,
        noise_sigma=noise,
        threshold=processing.threshold * calibration.floor_sigma,
        saturation_level=calibration.full - calibration.dark,
        status=status,
        peak_px=values["peak_px"],
        sigma_peak_px=values["sigma_peak_px"],
        range_m=values["range_m"],
        sigma_range_m=values["sigma_range_m"],
        sigma_texture_m=values["sigma_texture_m"],
        truth_peak_px=float(true_peak),
        truth_range_m=values["truth.range_m"],
        method=processing.peak,
        window=_window(measured, values["peak_px"], processing.peak),
    )


def _among_neighbours(instrument: Instrument, row: int, column: int) -> dict[str, float]:
    """Measure a voxel with those around it, which have a say in its status and its σ."""
    scan, away = instrument.scenario.raster, reach(instrument.scenario)
    rows = np.arange(max(row - away, 0), min(row + away + 1, scan.rows))
    columns = np.arange(max(column - away, 0), min(column + away + 1, scan.columns))
    shots = (rows[:, None] * scan.columns + columns[None, :]).astype(np.uint32)
    aim = raster_aim(scan, shots.ravel(), instrument.scenario.scanner.dwell)
    measured = instrument.measure(aim, noise_alone=True)
    # Single precision as in an image, so that neighbours are judged by the same numbers.
    layers = {name: values.astype(np.float32).reshape(shots.shape) for name, values in measured.items()}
    judge_neighbours(instrument.scenario, layers, rows, columns)
    readings = ReadingsOfTheta(instrument.scenario.scanner.mirrors, aim.theta, aim.time)
    add_common_errors(layers, instrument.scenario.rangefinders, instrument.geometry, readings)
    here = int(np.flatnonzero(rows == row)[0]), int(np.flatnonzero(columns == column)[0])
    return {name: float(values[here]) for name, values in layers.items()}


def _window(line: NDArray[np.float64], peak: float, method: PeakMethod) -> tuple[int, int] | None:
    """Return the pixels about a peak that the estimator read; None without a peak, and for a function of the user's."""
    if not np.isfinite(peak) or method not in MARGIN:
        return None
    near = range(max(round(peak) - 1, 0), min(round(peak) + 2, len(line)))
    brightest, margin = max(near, key=lambda pixel: line[pixel]), MARGIN[method]
    return max(brightest - margin, 0), min(brightest + margin, len(line) - 1)
