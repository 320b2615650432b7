"""Where beams meet their surfaces, as the surfaces see it: in the frame of the object, which moves along with it."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from scanner_sim.foundation.device_types import Float, UInt32, Vector3f
from scanner_sim.render.beam.light import Truth
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout, device_frame
from scanner_sim.scene.files.loader import LoadedScene, Pose


@dataclass
class SurfacePositions:
    """Points where m beams meet their surfaces, in the frames of the objects, Dr.Jit.

    ``point`` where the axis meets the surface [m], ``along``, ``across`` and ``normal`` the beam's direction and axes
    (``mi.Vector3f``); ``object`` number of what is met, 0 for nothing; ``radius`` of the beam there (1/e²) [m], and
    ``distance`` along it, shape (m,).
    """

    point: Vector3f
    along: Vector3f
    across: Vector3f
    normal: Vector3f
    object: UInt32
    radius: Float
    distance: Float


def surface_positions(
    loaded: LoadedScene, layout: OpticalLayout, shots: Shots, truth: Truth
) -> SurfacePositions:
    """Return where the beams of m shots meet their surfaces.

    A beam whose axis meets nothing counts as one that does at its Rayleigh length: what is beside it may be lit.
    """
    laser = layout.laser
    rayleigh = dr.opaque(mi.Float, laser.rayleigh_length)
    frame = device_frame(layout, shots.theta, shots.phi, shots.departures)
    distance = dr.select(dr.isfinite(truth.distance), truth.distance, rayleigh)
    radius = dr.opaque(mi.Float, laser.waist_radius) * dr.sqrt(1.0 + dr.square(layout.twist(distance)))
    point = mi.Vector3f(frame.laser) + frame.along * distance
    vectors: list[Vector3f] = [
        point,
        *(mi.Vector3f(axis) for axis in (frame.along, frame.across, frame.normal)),
    ]
    frame_of = loaded.frames_of(truth.object)
    poses = loaded.poses if shots.poses is None else shots.poses
    for body, pose in zip(loaded.bodies, poses, strict=True):
        first, last = (dr.opaque(mi.UInt32, number) for number in loaded.numbers_of(body.item.name))
        own = (truth.object >= first) & (truth.object <= last)
        frame_of = Pose(
            dr.select(own, pose.rotation, frame_of.rotation), dr.select(own, pose.position, frame_of.position)
        )
    back = frame_of.rotation.T
    vectors = [back @ (vectors[0] - frame_of.position), *(back @ axis for axis in vectors[1:])]
    point, along, across, normal = vectors
    return SurfacePositions(point, along, across, normal, truth.object, radius, distance)


def coherence_of(loaded: LoadedScene, truth: Truth) -> Float:
    """Return the squared contrast of the speckle of what chief rays meet, shape (m,)."""
    return dr.gather(mi.Float, loaded.coherence, truth.material)
