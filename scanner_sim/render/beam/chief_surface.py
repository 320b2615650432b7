"""The surfaces that chief rays meet, as the simulator knows them: how they are turned."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.render.garbage import garbage_waits
from scanner_sim.render.rays import pose_scene
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout, frame_at, launch, meet
from scanner_sim.scene.files.loader import LoadedScene

Array = NDArray[np.float64]


@garbage_waits()
def chief_surface(loaded: LoadedScene, layout: OpticalLayout, shots: Shots) -> tuple[Array, Array, Array]:
    """Return where the chief rays of n shots meet surfaces in the middle of the dwell, and how these are turned.

    Returns
    -------
    tuple
        Points [m] and unit normals in the scanner's frame, the latter on the side from which the beam comes, shape
        (3, n), and angles between the normal and the way back [rad], shape (n,); NaN where nothing is met. The normal
        is that of the surface itself: a mesh has those of its triangles, whatever its file says of vertices.
    """
    frame = frame_at(layout, shots, mi.Float(0.0))
    beam = launch(layout, frame, [mi.Float(0.0), mi.Float(0.0)])
    si = meet(pose_scene(loaded, shots.poses), beam.origin, beam.direction)
    met = si.is_valid()
    facing = dr.select(met, mi.Vector3f(si.n), dr.nan)
    facing = dr.select(dr.dot(facing, beam.direction) > 0.0, -facing, facing)
    point = dr.select(met, mi.Vector3f(si.p), dr.nan)
    dr.eval(facing, beam.direction, point)
    normal, back, place = (
        np.asarray(way.numpy(), dtype=np.float64) for way in (facing, -beam.direction, point)
    )
    # Of the sine and the cosine: the latter alone is blind to small angles.
    across = np.linalg.norm(np.cross(normal, back, axis=0), axis=0)
    return place, normal, np.arctan2(across, (normal * back).sum(axis=0))
