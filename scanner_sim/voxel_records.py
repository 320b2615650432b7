"""Voxels among their neighbours; and one voxel in full: line, what the estimator made of it, and the truth."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.products.image import MEASURED, MEASURED_BY
from scanner_sim.products.voxel import VoxelRecord
from scanner_sim.ranging.neighbours import isolated
from scanner_sim.ranging.triangulation import position_from_range
from scanner_sim.scan.raster import raster_aim
from scanner_sim.scenario import Scenario
from scanner_sim.status import Status
from scanner_sim.workbench import Workbench


def refuse_isolated(
    scenario: Scenario,
    layers: dict[str, NDArray[Any]],
    theta: NDArray[np.float64],
    phi: NDArray[np.float64],
) -> None:
    """Refuse the voxels of an image that agree with none of their neighbours; ``layers`` change in place.

    This is for the triangulation: time of flight knows no background that moves a peak. What was fused with a
    refused range is then the time of flight's alone.

    Parameters
    ----------
    scenario
        What was measured, and how it is processed.
    layers
        Layers of shape (rows, columns).
    theta, phi
        Deflections of the columns and of the rows [rad].
    """
    settings = scenario.processing.validation
    if settings.isolated is None or scenario.ranging == "tof":
        return
    alone = isolated(
        layers["range_m"],
        layers["sigma_range_m"],
        layers["status"].astype(np.uint32),
        theta,
        phi,
        settings.isolated,
        settings.steepest,
    )
    layers["status"][alone] = Status.ISOLATED
    for name in MEASURED:
        layers[name][alone] = np.nan
    if scenario.ranging == "both":
        for name in MEASURED_BY["fused.status"]:
            layers[name][alone] = layers[name.replace("fused.", "tof.")][alone]
        timed = layers["tof.status"][alone] == Status.VALID
        layers["fused.status"][alone] = np.where(timed, Status.VALID, Status.ISOLATED)


def voxel_record(bench: Workbench, row: int, column: int) -> VoxelRecord:
    """Return the record of one voxel of a workbench's raster: its line, peak and range, and the truth."""
    from scanner_sim.detector.line import electrons_per_watt
    from scanner_sim.signals.calibration import Calibration, measured_lines

    scanner, processing = bench.scenario.scanner, bench.scenario.processing
    sensor = scanner.position_sensor
    values = _among_neighbours(bench, row, column)
    shot = np.array([row * bench.scenario.raster.columns + column], dtype=np.uint32)
    aim = raster_aim(bench.scenario.raster, shot, scanner.dwell)
    _, groups = bench.expose(aim)
    (group,) = groups
    status = Status(int(values["status"]))
    calibration = Calibration.of(sensor, scanner.dwell, scanner.laser_off)
    (measured,), (noise,) = measured_lines(group.signal, calibration)
    expected = group.light.line(0, background=scanner.laser_off == 0.0)
    expected *= electrons_per_watt(sensor, scanner.laser.wavelength, scanner.exposure)
    true_position = position_from_range(
        values["truth.range_m"], aim.theta[0], bench.geometry.focal_length, bench.geometry.baseline
    )
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
        truth_peak_px=float(bench.geometry.pixel(true_position)),
        truth_range_m=values["truth.range_m"],
        method=processing.peak,
        window=_window(measured, values["peak_px"], processing.peak),
    )


def _among_neighbours(bench: Workbench, row: int, column: int) -> dict[str, float]:
    """Measure a voxel with those around it, which have a say in its status."""
    scan = bench.scenario.raster
    rows = np.arange(max(row - 1, 0), min(row + 2, scan.rows))
    columns = np.arange(max(column - 1, 0), min(column + 2, scan.columns))
    shots = (rows[:, None] * scan.columns + columns[None, :]).astype(np.uint32)
    measured = bench.measure(raster_aim(scan, shots.ravel(), bench.scenario.scanner.dwell))
    layers = {name: values.astype(np.float64).reshape(shots.shape) for name, values in measured.items()}
    theta, phi = scan.angles()
    refuse_isolated(bench.scenario, layers, theta[columns], phi[rows])
    here = int(np.flatnonzero(rows == row)[0]), int(np.flatnonzero(columns == column)[0])
    return {name: float(values[here]) for name, values in layers.items()}


def _window(line: NDArray[np.float64], peak: float, method: Any) -> tuple[int, int] | None:
    """Return the pixels about a peak that the estimator read; None where there is no peak."""
    from scanner_sim.signals.peaks import MARGIN

    if not np.isfinite(peak):
        return None
    near = range(max(round(peak) - 1, 0), min(round(peak) + 2, len(line)))
    brightest, margin = max(near, key=lambda pixel: line[pixel]), MARGIN[method]
    return max(brightest - margin, 0), min(brightest + margin, len(line) - 1)
