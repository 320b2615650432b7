"""Which source of error makes most of the stated σ of the range, voxel by voxel of a scan."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.products.budget import Dominance
from scanner_sim.ranging.triangulation import position_sigma, range_jacobian
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scan.protocol import Aim
from scanner_sim.scan.raster import raster_aim, tiled_order

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


@guest()
def dominating(
    scenario: Scenario, *, device: DeviceChoice = "auto", progress: Progress | None = None
) -> Dominance:
    """Tell for each voxel of a scenario's scan which source makes most of the stated σ of its range.

    Each part of the variance is what goes when the σ model no longer knows of its source: σ² with all less σ²
    without it, on the same signal. For the maximum-likelihood fit, whose weights follow, that is a little less than the
    source's share. Mirrors' parts are those of the Jacobian.

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
    instrument = Instrument(scenario, device=device)
    scan, geometry = scenario.raster, instrument.geometry
    h, d, g, mirrors = geometry.scale, geometry.baseline, geometry.slope, scenario.scanner.mirrors
    names = (*(part.name for part in _PARTS), "synchronisation", "deflection")
    variances = np.full((len(names), scan.shots), np.nan)
    order = tiled_order(scan)
    for start in range(0, scan.shots, _BATCH):
        shots = order[start : start + _BATCH]
        aim = raster_aim(scan, shots, scenario.scanner.dwell)
        peak, parts = _peak_parts(instrument, aim)
        position = geometry.position(peak)
        by_position, by_theta = range_jacobian(position, aim.theta, h, d, g)
        apart = position_sigma(position, 0.0, h, geometry.pitch, geometry.synchronisation, g)
        variances[: len(_PARTS), shots] = parts * (by_position * geometry.pitch) ** 2
        variances[-2, shots] = (by_position * apart) ** 2
        variances[-1, shots] = (by_theta * mirrors.reading_sigma(aim.theta, aim.time)) ** 2
        if progress is not None:
            progress(start + len(shots), scan.shots)
    theta, phi = scan.angles()
    return Dominance(names, variances.reshape(len(names), scan.rows, scan.columns), theta, phi)


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
            # What the changed model refuses it says nothing about.
            left = np.where(np.isfinite(left), left, whole)
            parts[number, group.index] = np.where(valid, np.maximum(whole**2 - left**2, 0.0), np.nan)
    return peak, parts
