"""What memory a run takes, the refusal of one that does not fit, and its background's paths, before its work."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scanner_sim.config.calibration import believed_instrument
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.channels import JACOBIAN, layer_bytes
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.neighbourhood import most_together
from scanner_sim.products.files.signal_files import voxels_together
from scanner_sim.render.settings import LONGEST_SLOT, ROW_SPACING, slot_halvings, times_finer

BATCH = 131072
"""Shots that go through the kernels together."""
START_BYTES = 0.5e9
"""Memory of the program and its kernels."""
SHOT_BYTES = 4600.0
"""Memory of a shot while its batch goes through the kernels."""
WHOLE_BYTES = 30.0
"""Memory of a voxel beside its layers while a whole layer is made of others."""
JUDGED_BYTES = 800.0
"""Memory of a voxel beside its layers while its neighbours judge it, for each way of ranging."""
SIGNAL_BYTES = 24.0
"""Memory of a pixel or sample of lines or waveforms that are kept and joined, with its light."""
KEPT_BYTES = {"triangulation": 1.0, "tof": 1.2}
"""Bytes of a pixel of a line, of a sample of a waveform, in a file in the dark."""
LIT_BYTES = 3.5
"""Bytes of the background on a pixel in a file."""
KEPT_VOXEL_BYTES = 120.0
"""Bytes of a voxel's other columns there."""
BIN_BYTES = 220.0
"""Memory of a direction of the background: its light, what guides its filter, and their errors."""
_MOTION_INSTANTS = 257
"""Instants of a scan at which motions are looked at."""
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
    """Return about how many directions the background of a scan has for the sensor's line, 0 where it is dark."""
    rows, _ = background_rows(scenario)
    if not rows:
        return 0
    scan, sensor = scenario.open_scan, scenario.scanner.position_sensor
    width = (
        abs(scan.horizontal[1] - scan.horizontal[0]) + sensor.length / scenario.scanner.receiver.focal_length
    )
    return rows * math.ceil(width / _background_step(scenario))


def background_rows(scenario: Scenario) -> tuple[int, float]:
    """Return in how many rows the line's background is rendered, 0 in the dark, and the angle between two [rad]."""
    scan, scanner = scenario.scan, scenario.scanner
    by_line = "triangulation" in scenario.rangefinders
    if scan.layout == "visits" or not by_line or scenario.lighting.sky().dark:
        return 0, math.inf
    height = abs(scan.vertical[1] - scan.vertical[0])
    if scan.layout == "image":
        return scan.rows, height / (scan.rows - 1) if scan.rows > 1 else math.inf
    step = ROW_SPACING * scanner.position_sensor.height / scanner.receiver.focal_length
    return math.ceil(height / step) + 4, step


def background_paths(scenario: Scenario) -> float:
    """Return about how many random paths the background of a scan is followed with."""
    if not (bins := background_bins(scenario)):
        return 0.0
    finer = times_finer(background_rows(scenario)[1], _background_step(scenario))
    return float(bins) * scenario.transport.background_samples * finer * background_times(scenario)


def background_times(scenario: Scenario) -> int:
    """Return about how often the background of a scan without rows is rendered: once for each time slot."""
    scan = scenario.scan
    moving = [item for item in scenario.scene.objects if item.moves]
    if scan.layout != "shots" or not moving:
        return 1
    duration, fastest = scan.scan_time(scenario.scan_setup), 0.0
    time = np.linspace(0.0, duration, _MOTION_INSTANTS)
    for item in moving:
        origin = item.pose_at(time)[:, :3, 3]
        way, far = np.linalg.norm(np.diff(origin, axis=0), axis=1), np.linalg.norm(origin[1:], axis=1)
        fastest = max(fastest, float((way / np.maximum(far, 0.1)).max()) / (time[1] - time[0]))
    slots = 2 ** slot_halvings(fastest, _background_step(scenario)) / LONGEST_SLOT
    return max(math.ceil(float(duration * slots)), 1)


def memory(scenario: Scenario) -> float:
    """Return roughly how much memory a run takes [byte], the program's own included."""
    if scenario.scan.layout == "visits":
        return START_BYTES + _records(scenario)
    batch = SHOT_BYTES * min(BATCH, scenario.open_scan.shots)
    return START_BYTES + batch + _layers(scenario) + _background(scenario) + _signals_together(scenario)


def check_memory(scenario: Scenario) -> None:
    """Check before anything is loaded that a run fits in the memory that is free.

    Raises
    ------
    InputError
        If it does not.
    """
    _check(memory(scenario), *_words(scenario))


def check_shots(scenario: Scenario, batch: int = BATCH) -> None:
    """Check that the layers and the batches of a scan fit in the memory that is free.

    The program itself is not counted: in the user's own process it may be there already.

    Raises
    ------
    InputError
        If they do not, or the scenario follows targets.
    """
    shots = min(batch, scenario.open_scan.shots)
    _check(SHOT_BYTES * shots, f"batches of {shots:,} shots", "Reduce batch.")
    _check(_layers(scenario) + _background(scenario), *_words(scenario))


def check_patterns(scenarios: Sequence[Scenario]) -> None:
    """Check that the patterns of tracking runs fit in the memory that is free; as :func:`check_shots`."""
    words, remedy = _words(scenarios[0])
    runs = f"{len(scenarios)} runs of {words}" if len(scenarios) > 1 else words
    _check(sum(_records(scenario) for scenario in scenarios), runs, remedy)


def check_signals(scenario: Scenario, rangefinder: str, count: int) -> None:
    """Check that so many lines or waveforms fit in the memory that is free; as :func:`check_shots`."""
    samples = _samples(scenario, rangefinder)
    what, remedy = {
        "triangulation": ("lines of {} pixels", "Name fewer voxels."),
        "tof": ("waveforms of {} samples", "Name fewer voxels, or shorten scanner.lidar.digitiser."),
    }[rangefinder]
    _check(SIGNAL_BYTES * samples * count, f"{count:,} {what.format(samples)}", remedy)


def disk(scenario: Scenario) -> float:
    """Return about how large the files of lines and waveforms of a run are [byte]."""
    total, lit = 0.0, not scenario.lighting.sky().dark
    kept = {"triangulation": scenario.output.lines, "tof": scenario.output.waveforms}
    for rangefinder, chosen in kept.items():
        if chosen != "none":
            count = scenario.raster.shots if isinstance(chosen, str) else len(chosen)
            each = KEPT_BYTES[rangefinder] + (LIT_BYTES if lit and rangefinder == "triangulation" else 0.0)
            total += count * (each * _samples(scenario, rangefinder) + KEPT_VOXEL_BYTES)
    return total


def _signals_together(scenario: Scenario) -> float:
    """Return the memory of lines or waveforms while a part of them is made and written [byte]."""
    kept = {"triangulation": scenario.output.lines, "tof": scenario.output.waveforms}
    samples = [_samples(scenario, name) for name, chosen in kept.items() if chosen != "none"]
    return max((SIGNAL_BYTES * voxels_together(some) * some for some in samples), default=0.0)


def _samples(scenario: Scenario, rangefinder: str) -> int:
    """Return how many pixels a line has, or samples a waveform."""
    scanner = scenario.scanner
    return scanner.lidar.digitiser.samples if rangefinder == "tof" else scanner.position_sensor.pixels


def _background_step(scenario: Scenario) -> float:
    return scenario.scanner.position_sensor.pitch / scenario.scanner.receiver.focal_length


def _layers(scenario: Scenario) -> float:
    judged = len(scenario.rangefinders) * JUDGED_BYTES * most_together(scenario)
    asked: list[str] = list(scenario.output.truth)
    if (known := believed_instrument(scenario)) is not None:
        asked += ["calibration", *(JACOBIAN + name for name in known.uncertain if scenario.output.jacobian)]
    return (layer_bytes(scenario.rangefinders, asked) + WHOLE_BYTES) * scenario.open_scan.shots + judged


def _background(scenario: Scenario) -> float:
    return BIN_BYTES * background_bins(scenario)


def _records(scenario: Scenario) -> float:
    return RECORD_BYTES * patterns(scenario) * scenario.following.pattern.points


def _words(scenario: Scenario) -> tuple[str, str]:
    """Return what takes the memory of a run, and what to do about it."""
    scan = scenario.scan
    if scan.layout == "visits":
        return f"{patterns(scenario):,} patterns", "Reduce scan.duration, or scan in several runs."
    if _background(scenario) > _layers(scenario):
        return (
            f"the {background_bins(scenario):,} directions of the background",
            "Take larger pixels (scanner.position_sensor.pitch) or fewer scan.rows, or scan in several runs.",
        )
    if scan.layout == "image":
        remedy = "Reduce scan.rows or scan.columns, or scan in several runs."
        return f"{scan.rows} × {scan.columns} voxels", remedy
    return f"{scan.shots:,} shots", "Take fewer shots, or scan in several runs."


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
