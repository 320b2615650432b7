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
from scanner_sim.pose.transforms import quaternion_from_rotation, rates_between
from scanner_sim.products.image import RangeImage
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scan.raster import RasterScan, raster_aim
from scanner_sim.scan.schedule import raster_time
from scanner_sim.scan.ways import MirrorPair, mirrors_at
from scanner_sim.scene.moves import Move, Moves, RigidMotion
from scanner_sim.scene.objects import Scene
from scanner_sim.scene.poses import FARTHEST, placement_matrix

Array = NDArray[np.float64]

MOST_VOXELS = 65536
"""Largest raster between two visits: a batch of the instrument."""
_PIECES = 64
"""Even pieces of time in which a kept scenario has the motion of an object."""
_AHEAD = 0.05
"""Longest time over which rates of a motion are told by where it is at both ends [s]: no turn of up to 60 rad/s makes
half a turn in it."""
_SAME = 1e-9
"""Difference of positions [m] and entries of rotations within which a motion goes on evenly."""


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

    Objects move during it; the background has them, and the sky, as they are in its middle. The scenario that is kept
    with the image has its objects where they are from ``start`` on (:func:`scene_from`); it is that of another run of
    the same raster, whose noise and mirrors err otherwise.
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
    kept = asked.model_copy(update={"scene": scene_from(scenario.scene, start, end)})
    return image_of(kept, layers, loaded.object_labels.names, loaded.material_labels.names)


def scene_from(scene: Scene, start: float, end: float) -> Scene:
    """Return a scene whose motions count from a time ``start`` on [s], up to ``end`` [s].

    Each motion becomes ``moves``: states at the ends of 64 even pieces of the time, and where it was told anew. Where
    it goes on evenly, one state stands for all. Of an acceleration a in a piece T up to a T²/2 is left out. What is
    farther away than an object of a scenario may be is kept at that distance.
    """
    return scene.moved(
        {
            item.name: _moves_from(item.motion, placement_matrix(item.position, item.rotation), start, end)
            for item in scene.objects
            if item.motion is not None
        }
    )


def _moves_from(motion: RigidMotion, origin: Array, start: float, end: float) -> Moves:
    """Return a motion that begins with the pose ``origin``, (4, 4), as moves from a time on."""
    told = [one.time for one in motion.moves if start < one.time < end] if isinstance(motion, Moves) else []
    begin = np.unique([*np.linspace(start, end, _PIECES, endpoint=False), *told])
    ahead = np.minimum(0.5 * np.diff(begin, append=end), _AHEAD)
    first, then = (motion.scanner_from_object(time, origin) for time in (begin, begin + ahead))
    velocity, turn_rate = rates_between(first, then, ahead)
    quaternion = quaternion_from_rotation(first[:, :3, :3])
    moves: list[Move] = []
    for index, time in enumerate((begin - start).tolist()):
        both = np.array([time, time + ahead[index]])
        if moves and np.abs(moves[-1].pose_at(both) - [first[index], then[index]]).max() < _SAME:
            continue
        there = np.clip(first[index, :3, 3], -FARTHEST, FARTHEST)
        columns = there, quaternion[index], velocity[index], turn_rate[index]
        position, attitude, along, about = (tuple(column.tolist()) for column in columns)
        moves.append(Move(time=time, position=position, quaternion=attitude, velocity=along, turn_rate=about))
    return Moves(type="moves", moves=tuple(moves))
