"""The page of a result: what it needs of the scenario, the lines and waveforms behind it, and how much of it fits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from scanner_sim.config import scenario_from_text
from scanner_sim.config.built import instrument_as_built, scanner_as_built
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.closed_loop.every_pose import every_pose
from scanner_sim.instrument.closed_loop.poses import outlines_of
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.optics_as_built import optics_as_built
from scanner_sim.instrument.signal_records import RECORDERS, Progress, recorded
from scanner_sim.instrument.simulate_signals import voxel_shots
from scanner_sim.pose.series import PoseSeries
from scanner_sim.products.files.contents import LINES, WAVEFORMS
from scanner_sim.products.files.exchange import write_file
from scanner_sim.products.files.folder import write_text
from scanner_sim.products.files.signal_files import read_columns, read_signals_about, voxels_together
from scanner_sim.products.image import RangeImage
from scanner_sim.products.lines import LineSet
from scanner_sim.products.shots import ShotTable
from scanner_sim.products.view.page import page_of
from scanner_sim.products.view.scan import CODES, LAYERS, scan_data
from scanner_sim.products.view.signals import (
    LINE_COLUMNS,
    WAVEFORM_COLUMNS,
    WINDOW,
    Columns,
    SignalWindows,
    line_windows,
    waveform_windows,
)
from scanner_sim.products.view.surroundings import Surroundings
from scanner_sim.products.view.track import track_data
from scanner_sim.products.waveforms import WaveformSet
from scanner_sim.ranging.axes import Axes
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.signals.line.calibration import SensorCalibration
from scanner_sim.tracking.record import Track

LARGEST_MB = 60.0
"""Size of a page beyond which lines, then voxels are thinned out [MB]."""
_PAGE_BYTES = 0.7e6
"""Of a page without data: most of it is three.js."""
_BYTES_OF_VOXEL, _BYTES_OF_SAMPLE = 1.8, 1.6
"""Of a layer in a page, for each voxel, and of a pixel or sample with what is expected there: compressed, in base64.
The shipped scenarios take 1.3 to 1.7 and 1.1 to 1.3."""
_WITH_OFF = 2.2
"""Times as much where an exposure without the laser is subtracted; seen: 3.3 bytes."""


@dataclass(frozen=True)
class _Source:
    """Where lines or waveforms of a rangefinder come from."""

    rangefinder: str
    file: str
    kind: type[LineSet] | type[WaveformSet]
    names: tuple[str, ...]
    windows: Callable[[Iterable[Columns], Any, int], SignalWindows]
    word: str


_SOURCES = (
    _Source("triangulation", LINES, LineSet, LINE_COLUMNS, line_windows, "line"),
    _Source("tof", WAVEFORMS, WaveformSet, WAVEFORM_COLUMNS, waveform_windows, "waveform"),
)


def view(
    result: RangeImage | ShotTable | Track,
    path: str | Path,
    *,
    title: str = "",
    lines: bool = True,
    folder: str | Path | None = None,
    poses: Sequence[PoseSeries] | None = None,
    largest_mb: float = LARGEST_MB,
    device: DeviceChoice = "auto",
    progress: Progress | None = None,
    overwrite: bool = False,
) -> Path:
    """Write a result as one page for a browser, to turn and to click at.

    Parameters
    ----------
    result
        An image, a table of shots, or a tracking run.
    path
        The page. It needs no server, no network and nothing beside it.
    title
        What stands above it; by default the name of the page.
    lines
        Whether the page holds the line and the waveform of each voxel of an image. They are read from ``folder``, where
        the run has kept all, and are otherwise simulated again: the same numbers.
    folder
        Of the run, if it is on the disk.
    poses
        Of a tracking run; by default they are estimated.
    largest_mb
        Size of the page [MB] beyond which only every second, third … row and column of lines, then of voxels is kept,
        with a note in the page.
    device
        Where lines are simulated.
    progress
        Called with the voxels whose lines are done, and all.
    overwrite
        Replace a page that is there.

    Returns
    -------
    pathlib.Path
        The page.

    Raises
    ------
    InputError
        If there is such a file already or it cannot be written, layers that the page needs were taken out of the
        result, or its scene can no longer be loaded.
    """
    path = Path(path)
    title = title or path.stem
    scenario = scenario_from_text(result.scenario_yaml, name=title, stored=True)
    around = surroundings_of(scenario)
    if isinstance(result, Track):
        poses = every_pose(result, device=device) if poses is None else poses
        data = _track_page(result, poses, around, title, largest_mb)
    else:
        if missing := [name for name in ("range_m", "P.X", "P.Y", "P.Z") if name not in result]:
            raise InputError(
                f"the result has no layer {missing[0]}.",
                remedy="Run its scenario again: layers were taken out.",
            )
        step, line_step, notes = _fitting(result, scenario, lines, largest_mb)
        signals: list[SignalWindows] = []
        if isinstance(result, RangeImage) and lines:
            with guest():
                signals = _signals(scenario, folder, line_step, device, progress)
        elif lines:
            notes.append("Lines and waveforms are those of rasters: shots have none here.")
        data = scan_data(result, around, title=title, step=step, signals=signals, notes=notes)
    page = page_of(data)
    return write_file(path, lambda to: write_text(to, page), overwrite=overwrite)


def surroundings_of(scenario: Scenario) -> Surroundings:
    """Return what is drawn about the points of a scenario's result, by its instrument as built."""
    built = instrument_as_built(scenario)
    scanner = scanner_as_built(scenario.scanner, built)
    optics, half = optics_as_built(scanner, built), scanner.mirrors.max_deflection
    horizontal, vertical = (-half, half), (-half, half)
    if scenario.scan.layout != "visits":
        horizontal, vertical = scenario.open_scan.horizontal, scenario.open_scan.vertical
    sky = scenario.lighting.sky()
    sensor = scanner.position_sensor if "triangulation" in scenario.rangefinders else None
    gate = scenario.processing.range_gate or (0.0, math.inf)
    if sensor is None:
        near, far = scanner.seen_by("tof")
        gate = max(gate[0], near), min(gate[1], far)
    return Surroundings(
        horizontal=horizontal,
        vertical=vertical,
        array=None if sensor is None else (sensor.offset, sensor.offset + sensor.length),
        gate=gate,
        scale=optics.receiver.line_image.scale,
        baseline=optics.receiver.baseline,
        axes=Axes(optics.axis_separation, *(optics.axes or ())),
        sun=sky.sun_direction,
        sun_visible=sky.sun_visible,
        slope=optics.receiver.line_image.slope,
    )


def _fitting(
    result: RangeImage | ShotTable, scenario: Scenario, lines: bool, largest_mb: float
) -> tuple[int, int, list[str]]:
    """Return every which row and column of voxels and of lines makes the page no larger than it may be, and notes."""
    room, count = 1e6 * largest_mb - _PAGE_BYTES, int(np.prod(result.shape))
    axes = len(result.shape)
    layers = sum(name in result for name in (*LAYERS, *CODES)) + (3 if axes == 2 else 6)
    voxel = count * layers * _BYTES_OF_VOXEL
    line = 0.0
    if lines and axes == 2:
        samples = {"line": _WITH_OFF if scenario.scanner.laser_off > 0.0 else 1.0, "waveform": 1.0}
        kinds = [one.word for one in _SOURCES if one.rangefinder in scenario.rangefinders]
        line = count * _BYTES_OF_SAMPLE * sum(WINDOW[kind] * samples[kind] for kind in kinds)
    step = _step(voxel, room, axes)
    line_step = step * _step(line / step**2, room - voxel / step**axes, 2)
    notes = []
    if step > 1:
        what = "row and column" if axes == 2 else "shot"
        notes.append(
            f"Every {_th(step)} {what} of voxels is shown, to keep the page below {largest_mb:g} MB."
        )
    if line and line_step > step:
        notes.append(
            f"Every {_th(line_step)} row and column has its lines, to keep the page below {largest_mb:g} MB."
        )
    return step, line_step, notes


def _step(size: float, room: float, axes: int) -> int:
    """Return every which row and column of something of a size leaves it within a room; at least a hundredth of it."""
    crowd = size / max(room, 0.01 * size, 1.0)
    return max(math.ceil(crowd if axes == 1 else math.sqrt(crowd)), 1)


def _th(step: int) -> str:
    return {2: "second", 3: "third"}.get(step, f"{step}th")


def _signals(
    scenario: Scenario, folder: str | Path | None, step: int, device: DeviceChoice, progress: Progress | None
) -> list[SignalWindows]:
    """Return the windows of lines and of waveforms, as far as the scenario has them."""
    instrument, found = None, []
    for source in _SOURCES:
        if source.rangefinder not in scenario.rangefinders:
            continue
        chosen = {"triangulation": scenario.output.lines, "tof": scenario.output.waveforms}[
            source.rangefinder
        ]
        kept = None if folder is None else Path(folder) / source.file
        parts: Iterator[Columns]
        if chosen == "all" and kept is not None and kept.exists():
            numbers = dict(read_signals_about(kept, source.kind).numbers)
            parts = read_columns(kept, source.kind, source.names, voxels_together(256))
        else:
            instrument = instrument or Instrument(scenario, device=device)
            recorder = RECORDERS[source.rangefinder](instrument)
            numbers = recorder.numbers()
            parts = iter(recorded(instrument, recorder, _shots(scenario, step), progress))
        if source.rangefinder == "triangulation":
            numbers["threshold_electron"] = _threshold(scenario)
        found.append(source.windows(parts, numbers, step))
    return found


def _shots(scenario: Scenario, step: int) -> Any:
    """Return the numbers of the shots of every ``step``-th row and column."""
    raster = scenario.raster
    rows, columns = np.arange(0, raster.rows, step), np.arange(0, raster.columns, step)
    pairs = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)
    return voxel_shots(scenario, pairs)


def _threshold(scenario: Scenario) -> float:
    """Return the charge above the dark level from which a peak is one, in the dark [electron]."""
    scanner = scenario.scanner
    calibration = SensorCalibration.of(scanner.position_sensor, scanner.dwell, scanner.laser_off)
    return scenario.processing.threshold * calibration.floor_sigma


def _track_page(
    track: Track, poses: Sequence[PoseSeries], around: Surroundings, title: str, largest_mb: float
) -> dict[str, Any]:
    """Return the data of a tracking run, without the voxels of its patterns where the page would be too large."""
    voxels = sum(one.samples.time.shape[1] for one in track.records)
    fits = _PAGE_BYTES + voxels * 4 * _BYTES_OF_VOXEL < 1e6 * largest_mb
    notes = [] if fits else [f"Patterns were left out, to keep the page below {largest_mb:g} MB."]
    outlines = outlines_of(track)(track.records)
    return track_data(track, poses, around, outlines=outlines, title=title, patterns=fits, notes=notes)
