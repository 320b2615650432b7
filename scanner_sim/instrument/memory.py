"""What memory a run takes, the refusal of one that does not fit, and its background's paths, before its work."""

from __future__ import annotations

import math
from pathlib import Path

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.channels import layer_bytes
from scanner_sim.foundation.errors import InputError
from scanner_sim.render.settings import times_finer
from scanner_sim.scan.raster import RasterScan

BATCH = 65536
"""Shots that go through the kernels together."""
START_BYTES = 0.55e9
"""Memory of the program, its kernels and one batch."""
SHOT_BYTES = 4600.0
"""Memory of a shot while its batch goes through the kernels."""
JUDGED_BYTES = 290.0
"""Memory of a voxel beside its layers while its neighbours judge it, for each way of ranging; writing takes less."""
WAVEFORM_BYTES = 14.0
"""Memory of a sample of a waveform that is kept, joined and written."""
BIN_BYTES = 220.0
"""Memory of a direction of the background: its light, what guides its filter, and their errors."""
RECORD_BYTES = 64.0
"""Memory of a voxel of a pattern: its samples."""


def period(scenario: Scenario) -> float:
    """Return the time [s] from one visit to a target to the next."""
    scan, scanner = scenario.following, scenario.scanner
    return scan.visiting.period(
        scan.pattern.points, scanner.dwell, len(scenario.targets), scanner.galvanometers
    )


def patterns(scenario: Scenario) -> int:
    """Return about how many patterns a run makes."""
    return math.ceil(scenario.following.duration / period(scenario))


def background_bins(scenario: Scenario) -> int:
    """Return about how many directions the background of a raster has for the sensor's line, 0 where it is dark."""
    scan, sensor = scenario.scan, scenario.scanner.position_sensor
    if not isinstance(scan, RasterScan) or scenario.ranging == "tof" or scenario.lighting.sky().dark:
        return 0
    width = (
        abs(scan.horizontal[1] - scan.horizontal[0]) + sensor.length / scenario.scanner.receiver.focal_length
    )
    return scan.rows * math.ceil(width / _background_step(scenario))


def background_paths(scenario: Scenario) -> float:
    """Return about how many random paths the background of a raster is followed with."""
    if not (bins := background_bins(scenario)):
        return 0.0
    angles = scenario.raster.angles()[1]
    row_step = abs(angles[1] - angles[0]) if len(angles) > 1 else math.inf
    finer = times_finer(row_step, _background_step(scenario))
    return float(bins) * scenario.transport.background_samples * finer


def memory(scenario: Scenario) -> float:
    """Return roughly how much memory a run takes [byte], the program's own included."""
    if not isinstance(scenario.scan, RasterScan):
        return START_BYTES + _records(scenario)
    kept = scenario.raster.shots if scenario.output.waveforms == "all" else 0
    shots = START_BYTES + _layers(scenario) + _background(scenario)
    return shots + WAVEFORM_BYTES * scenario.scanner.lidar.digitiser.samples * kept


def check_memory(scenario: Scenario) -> None:
    """Check before anything is loaded that a run fits in the memory that is free.

    Raises
    ------
    InputError
        If it does not.
    """
    _check(memory(scenario), *_words(scenario))


def check_raster(scenario: Scenario, batch: int = BATCH) -> None:
    """Check that the layers and the batches of a raster fit in the memory that is free.

    The program itself is not counted: in the user's own process it may be there already.

    Raises
    ------
    InputError
        If they do not, or the scenario has no raster.
    """
    shots = min(batch, scenario.raster.shots)
    _check(SHOT_BYTES * shots, f"batches of {shots:,} shots", "Reduce batch.")
    _check(_layers(scenario) + _background(scenario), *_words(scenario))


def check_patterns(scenario: Scenario) -> None:
    """Check that the patterns of a tracking run fit in the memory that is free; as :func:`check_raster`."""
    _check(_records(scenario), *_words(scenario))


def check_waveforms(scenario: Scenario, count: int) -> None:
    """Check that so many waveforms fit in the memory that is free; as :func:`check_raster`."""
    samples = scenario.scanner.lidar.digitiser.samples
    remedy = "Name fewer voxels, or shorten scanner.lidar.digitiser."
    _check(WAVEFORM_BYTES * samples * count, f"{count:,} waveforms of {samples} samples", remedy)


def _background_step(scenario: Scenario) -> float:
    return scenario.scanner.position_sensor.pitch / scenario.scanner.receiver.focal_length


def _layers(scenario: Scenario) -> float:
    judged = (2.0 if scenario.ranging == "both" else 1.0) * JUDGED_BYTES
    return (layer_bytes(scenario.ranging) + judged) * scenario.raster.shots


def _background(scenario: Scenario) -> float:
    return BIN_BYTES * background_bins(scenario)


def _records(scenario: Scenario) -> float:
    return RECORD_BYTES * patterns(scenario) * scenario.following.pattern.points


def _words(scenario: Scenario) -> tuple[str, str]:
    """Return what takes the memory of a run, and what to do about it."""
    if isinstance(scenario.scan, RasterScan):
        scan = scenario.raster
        if _background(scenario) > _layers(scenario):
            return (
                f"the {background_bins(scenario):,} directions of the background",
                "Take larger pixels (scanner.position_sensor.pitch) or fewer scan.rows, or scan in several runs.",
            )
        return (
            f"{scan.rows} × {scan.columns} voxels",
            "Reduce scan.rows or scan.columns, or scan in several runs.",
        )
    return f"{patterns(scenario):,} patterns", "Reduce scan.duration, or scan in several runs."


def _check(needed: float, what: str, remedy: str) -> None:
    free = _free_memory()
    if free is not None and needed > free:
        raise InputError(
            f"{what} take about {needed / 1e9:.1f} GB of memory, and {free / 1e9:.1f} GB are free.",
            remedy=remedy,
        )


def _free_memory() -> float | None:
    """Return the memory that is free or can be freed [byte]; None where the system does not tell."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    kilobytes = [line.split()[1] for line in lines if line.startswith("MemAvailable:")]
    return 1024.0 * float(kilobytes[0]) if kilobytes else None
