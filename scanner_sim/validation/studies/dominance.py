"""Which source of error makes most of the stated σ of the range, voxel by voxel of a scan."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.time_of_flight import EchoDelays
from scanner_sim.products.budget import Dominance, Mode
from scanner_sim.ranging.time_of_flight import echo_range_by_theta, echo_range_sigma
from scanner_sim.ranging.triangulation import position_sigma, range_jacobian
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scan.protocol import Aim
from scanner_sim.scan.raster import raster_aim, tiled_order
from scanner_sim.signals.waveform.detection import PulseDetector

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]

_BATCH = 65536


class _Part(NamedTuple):
    """A source in the peak's σ: its name, and what the σ model assumes without it."""

    name: str
    noise: dict[str, bool]
    speckle: bool = True
    misfit: bool = True


_PARTS = (
    _Part("shot", {"shot": False}),
    _Part("read", {"read": False}),
    _Part("quantisation", {"quantisation": False}),
    _Part("response", {"prnu": False}),
    _Part("speckle", {}, speckle=False),
    _Part("misfit", {}, misfit=False),
)


_LINE = (*(part.name for part in _PARTS), "synchronisation", "deflection")
"""Sources in the stated σ of triangulation."""
_ECHO_PARTS = ("shot", "amplifier", "quantisation")
"""Switches of the photodiode, which are sources in the delay's σ."""
_ECHO = (*_ECHO_PARTS, "clock", "deflection")
"""Sources in the stated σ of time of flight."""


@guest()
def dominating(
    scenario: Scenario, *, device: DeviceChoice = "auto", progress: Progress | None = None
) -> Dominance:
    """Tell for each voxel of a scenario's scan which source makes most of the stated σ of its range.

    It is the range of the scenario's first rangefinder: by triangulation, with ``ranging: tof`` by time of flight. Each
    part of the variance is what goes when the σ model no longer knows of its source: σ² with all less σ² without it,
    on the same signal. For the maximum-likelihood fit, whose weights follow, that is a little less than the source's
    share; the timings of echoes keep theirs. Mirrors' parts are those of the Jacobian.

    Parameters
    ----------
    scenario
        The whole scenario, scene and lighting included.
    device, progress
        Where to compute; and what is called with the voxels done and the voxels in all.

    Returns
    -------
    Dominance
    """
    instrument, scan = Instrument(scenario, device=device), scenario.raster
    mode: Mode = scenario.rangefinders[0]
    names = _ECHO if mode == "tof" else _LINE
    detectors = _echo_detectors(instrument) if mode == "tof" else ()
    variances = np.full((len(names), scan.shots), np.nan)
    order = tiled_order(scan)
    for start in range(0, scan.shots, _BATCH):
        shots = order[start : start + _BATCH]
        aim = raster_aim(scan, shots, scenario.scanner.dwell)
        found = _echo_variances(instrument, aim, detectors) if detectors else _line_variances(instrument, aim)
        variances[:, shots] = found
        if progress is not None:
            progress(start + len(shots), scan.shots)
    theta, phi = scan.angles()
    return Dominance(names, variances.reshape(len(names), scan.rows, scan.columns), theta, phi, mode)


def _line_variances(instrument: Instrument, aim: Aim) -> Array:
    """Return the parts of the variance of ranges by triangulation [m²], shape (sources, n)."""
    geometry = instrument.geometry
    h, d, g, mirrors = geometry.scale, geometry.baseline, geometry.slope, instrument.scenario.scanner.mirrors
    peak, parts = _peak_parts(instrument, aim)
    position = geometry.position(peak)
    by_position, by_theta = range_jacobian(position, aim.theta, h, d, g)
    apart = position_sigma(position, 0.0, h, geometry.pitch, geometry.synchronisation, g)
    return np.stack(
        [
            *(parts * (by_position * geometry.pitch) ** 2),
            (by_position * apart) ** 2,
            (by_theta * mirrors.reading_sigma(aim.theta, aim.time)) ** 2,
        ]
    )


def _echo_detectors(instrument: Instrument) -> tuple[PulseDetector, ...]:
    """Return the instrument's detection with the σ that it states without each of the photodiode's sources."""
    unit = instrument.time_of_flight
    noises = [unit.unit.photodiode.changed(noise={name: False}) for name in _ECHO_PARTS]
    return tuple(unit.detector.stating(noise) for noise in noises)


def _echo_variances(instrument: Instrument, aim: Aim, detectors: Sequence[PulseDetector]) -> Array:
    """Return the parts of the variance of ranges by time of flight [m²], shape (sources, n)."""
    unit, scanner = instrument.time_of_flight, instrument.scenario.scanner
    lidar = unit.unit
    shots, pointing = instrument.fire(aim)
    delays, left = EchoDelays.empty(aim.theta.size), np.full((len(detectors), aim.theta.size), np.nan)
    for group in unit.listen(shots)[2]:
        delays.fill(group.index, group.delays, lidar.digitiser)
        for number, detector in enumerate(detectors):
            left[number, group.index] = detector.detect(group.waveforms).sigma.numpy() / lidar.digitiser.rate
    parts = _gone(delays.sigma, left)
    ranges = unit.ranges(delays, instrument.deflections(aim, pointing))
    jitter = lidar.digitiser.jitter if lidar.photodiode.noise.clock else 0.0
    by_theta = echo_range_by_theta(ranges.range, delays.delay, aim.theta, unit.baseline)
    variances = np.stack(
        [
            *echo_range_sigma(delays.delay, aim.theta, np.sqrt(parts), 0.0, unit.baseline) ** 2,
            echo_range_sigma(delays.delay, aim.theta, 0.0, jitter, unit.baseline) ** 2,
            (by_theta * scanner.mirrors.reading_sigma(aim.theta, aim.time)) ** 2,
        ]
    )
    return np.where(ranges.status == Status.VALID, variances, np.nan)


def _gone(whole: Array, left: Array) -> Array:
    """Return the variance that goes with a source, of σ with it and without; none where the changed model refuses."""
    return np.asarray(np.maximum(whole**2 - np.where(np.isfinite(left), left, whole) ** 2, 0.0))


def _peak_parts(instrument: Instrument, aim: Aim) -> tuple[Array, Array]:
    """Return peaks [pixel], shape (n,), and the parts of their variance [pixel²], shape (parts, n)."""
    scenario = instrument.scenario
    sensor, processing = scenario.scanner.position_sensor, scenario.processing
    peak, parts = np.full(aim.theta.size, np.nan), np.full((len(_PARTS), aim.theta.size), np.nan)
    _, groups = instrument.expose(aim)
    for group in groups:
        theta = aim.theta[group.index].astype(np.float32)
        valid = group.peaks.status.numpy() == Status.VALID
        position, whole = (
            np.asarray(a.numpy(), np.float64) for a in (group.peaks.position, group.peaks.sigma)
        )
        peak[group.index] = np.where(valid, position, np.nan)
        for number, part in enumerate(_PARTS):
            misfit = processing.validation.misfit if part.misfit else 0.0
            without = instrument.triangulation.find(
                group.signal,
                theta,
                sensor=sensor.changed(noise=part.noise),
                processing=processing.changed(validation={"misfit": misfit, "shape": False}),
                speckle=part.speckle,
            )
            left = np.asarray(without.sigma.numpy(), dtype=np.float64)
            parts[number, group.index] = np.where(valid, _gone(whole, left), np.nan)
    return peak, parts
