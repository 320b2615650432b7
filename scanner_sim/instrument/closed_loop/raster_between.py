"""A raster between two visits of a track: the same instrument and the same objects, at the time that has come."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.channels import CHANNEL
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.instrument.simulate import image_of
from scanner_sim.optics.jump import jump_time
from scanner_sim.products.image import RangeImage
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scan.raster import RasterScan, raster_aim
from scanner_sim.scan.schedule import raster_time
from scanner_sim.scan.ways import MirrorPair, mirrors_at

Array = NDArray[np.float64]

MOST_VOXELS = 65536
"""Largest raster between two visits: a batch of the instrument."""


def between_visits(
    scenario: Scenario,
    rows: int,
    columns: int,
    horizontal: tuple[float, float],
    vertical: tuple[float, float],
) -> RasterScan:
    """Return a raster that can be measured between visits.

    Raises
    ------
    InputError
        If there is none such, it has more voxels than a batch, or the mirrors do not reach it.
    """
    try:
        raster = RasterScan(rows=rows, columns=columns, horizontal=horizontal, vertical=vertical)
    except ValidationError as error:
        details = error.errors(include_url=False)[0]
        place = ".".join(map(str, details["loc"])) or "it"
        raise InputError(f"there is no such raster: {place}: {details['msg']}.") from None
    if raster.shots > MOST_VOXELS:
        raise InputError(
            f"{rows} × {columns} voxels are more than the {MOST_VOXELS} of a raster between visits.",
            remedy="Take fewer, or several rasters.",
        )
    for fault in raster.faults(scenario.scan_setup):
        raise InputError(
            f"there is no such raster: {fault.problem}", remedy=fault.remedy or "Make it smaller."
        )
    return raster


def first_time(scenario: Scenario, raster: RasterScan, mirrors: MirrorPair, clock: float) -> float:
    """Return when a raster begins [s]: when the mirrors have jumped to its first voxel and settled."""
    theta, phi = raster.angles()
    far = float(np.abs(mirrors.state.angle - [theta[0], phi[0]]).max())
    return clock + float(jump_time(scenario.scanner.galvanometers, far)[()].max())


def mirrors_after(raster: RasterScan, end: float) -> MirrorPair:
    """Return the mirrors at rest at the last voxel, at a time [s]."""
    theta, phi = raster.angles()
    return replace(mirrors_at(float(theta[-1]), float(phi[-1])), time=end)


def measure_raster(
    scenario: Scenario,
    raster: RasterScan,
    start: float,
    first: int,
    *,
    device: DeviceChoice,
    threads: int | None,
) -> RangeImage:
    """Return the image of a raster that begins at a time [s], its shots numbered from ``first`` on.

    Objects move during it; the background has them, and the sky, as they are in its middle.
    """
    end = start + raster_time(raster.shots, scenario.scanner.dwell)
    asked = scenario.model_copy(
        update={"scan": raster, "lighting": scenario.lighting.at(0.5 * (start + end))}
    )
    instrument = Instrument(asked, device=device, threads=threads)
    order = np.arange(raster.shots, dtype=np.uint32)
    own = raster_aim(raster, order, scenario.scanner.dwell)
    aim = replace(own, shot=order + np.uint32(first), time=own.time + start)
    samples = instrument.measure(aim, backgrounds=instrument.backgrounds(aim), noise_alone=True)
    layers = {name: np.asarray(samples[name], dtype=np.float32) for name in samples if name in CHANNEL}
    loaded = instrument.loaded
    return image_of(asked, layers, loaded.object_labels.names, loaded.material_labels.names)
