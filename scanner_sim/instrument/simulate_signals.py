"""Lines and waveforms of a raster's voxels, without its image."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.memory import check_signals
from scanner_sim.instrument.signal_records import RECORDERS, Progress, recorded
from scanner_sim.products.lines import LineSet
from scanner_sim.products.signal_set import SignalSet
from scanner_sim.products.waveforms import WaveformSet
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice

Voxels = Sequence[tuple[int, int]] | NDArray[np.integer[Any]]
"""Rows and columns of voxels, n pairs or an array of shape (n, 2)."""


@guest()
def simulate_lines(
    scenario: Scenario,
    voxels: Voxels | None = None,
    *,
    device: DeviceChoice = "auto",
    threads: int | None = None,
) -> LineSet:
    """Simulate lines of the position sensor of a raster scan: the same numbers as in the whole image.

    Parameters
    ----------
    scenario
        Instrument, scene, scan and processing.
    voxels
        Row and column of each, n pairs; None takes all, row by row.
    device, threads
        Where to compute.

    Returns
    -------
    LineSet
        Digital numbers, shape (n, pixels), what the estimator made of them, the light before speckle and noise, and the
        truth, in the order of ``voxels``.

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the scenario has no line sensor, the raster no such voxel or it is named twice, or the memory that is free
        does not hold them.
    """
    if "triangulation" not in scenario.rangefinders:
        raise InputError("time of flight reads no line.", remedy="Write ranging: triangulation, or both.")
    found: LineSet = _joined(scenario, voxels, "triangulation", device, threads)
    return found


@guest()
def simulate_waveforms(
    scenario: Scenario,
    voxels: Voxels | None = None,
    *,
    device: DeviceChoice = "auto",
    threads: int | None = None,
) -> WaveformSet:
    """Simulate waveforms of time of flight of a raster scan: the same numbers as in the whole image.

    Parameters
    ----------
    scenario, voxels, device, threads
        As of :func:`simulate_lines`.

    Returns
    -------
    WaveformSet
        Digital numbers, shape (n, samples), what was found in them, the light before speckle and noise, and the truth.

    Raises
    ------
    ScenarioError, InputError
        As :func:`simulate_lines`; the scenario needs time of flight.
    """
    if "tof" not in scenario.rangefinders:
        raise InputError("triangulation has no waveforms.", remedy="Write ranging: tof, or both.")
    found: WaveformSet = _joined(scenario, voxels, "tof", device, threads)
    return found


def _joined(
    scenario: Scenario, voxels: Voxels | None, rangefinder: str, device: DeviceChoice, threads: int | None
) -> Any:
    shots = voxel_shots(scenario, voxels)
    check_signals(scenario, rangefinder, len(shots))
    instrument = Instrument(scenario, device=device, threads=threads)
    recorder = RECORDERS[rangefinder](instrument)
    return recorder.kind.joined(list(recorded(instrument, recorder, shots)))


def signal_parts(
    scenario: Scenario, rangefinder: str, *, device: DeviceChoice, progress: Progress | None = None
) -> Iterator[SignalSet] | None:
    """Return the parts of the file of lines or waveforms that a scenario's ``output`` asks for; None for none.

    Each part is made when it is asked for.
    """
    chosen = {"triangulation": scenario.output.lines, "tof": scenario.output.waveforms}[rangefinder]
    if chosen == "none":
        return None

    def parts() -> Iterator[SignalSet]:
        with guest():
            instrument = Instrument(scenario, device=device)
            shots = voxel_shots(scenario, None if chosen == "all" else chosen)
            yield from recorded(instrument, RECORDERS[rangefinder](instrument), shots, progress)

    return parts()


def voxel_shots(scenario: Scenario, voxels: Voxels | None) -> NDArray[np.uint32]:
    """Return the numbers of the shots of voxels; None stands for all.

    Raises
    ------
    InputError
        If these are no pairs of whole numbers, the raster has not all of them, or one is named twice.
    """
    scan = scenario.raster
    if voxels is None:
        return np.arange(scan.shots, dtype=np.uint32)
    pairs = np.asarray(voxels).reshape(-1, 2) if len(voxels) == 0 else np.asarray(voxels)
    if pairs.ndim != 2 or pairs.shape[1] != 2 or (pairs.size and pairs.dtype.kind not in "iuO"):
        raise InputError(
            f"voxels of type {pairs.dtype} and shape {pairs.shape} are no rows and columns.",
            remedy="Give pairs of whole numbers, [(0, 0), (10, 20)], or an array of shape (n, 2).",
        )
    if pairs.dtype.kind in "iu":
        pairs = pairs.astype(np.int64)  # in one byte a row times the columns would run over
    if problem := scan.not_voxels(pairs):
        raise InputError(problem[0], remedy=problem[1])
    return np.asarray(pairs[:, 0] * scan.columns + pairs[:, 1]).astype(np.uint32)
