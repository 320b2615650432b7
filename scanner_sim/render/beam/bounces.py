"""Laser light that meets several surfaces before it is seen: false spots and a faint veil.

Random paths start on the beamlets of the spot (:mod:`scanner_sim.render.beam.random_walks`). Each later surface that
the lens sees is imaged with the lens's point spread.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from scanner_sim.foundation.device_types import Float
from scanner_sim.optics.deflection import Frame
from scanner_sim.render.beam.beamlets import Beamlets
from scanner_sim.render.beam.random_walks import Vertex, walk
from scanner_sim.render.rays import pose_scene
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import (
    OpticalLayout,
    connect,
    cut_by_height,
    frame_at,
    image,
    lanes,
    launch,
    meet,
    synchronisation_shift,
    to_pixels,
)
from scanner_sim.scene.files.loader import LoadedScene


@dataclass
class BounceSpots:
    """Where light is seen that met several surfaces, Dr.Jit arrays: power [W], position and sigma [pixel].

    ``coherence`` squared contrast of its speckle, which is 0: this light comes from so large a part of the scene that
    little of its speckle is left.
    """

    power: Float
    position: Float
    sigma: Float
    coherence: Float


def trace_bounces(
    loaded: LoadedScene,
    layout: OpticalLayout,
    beamlets: Beamlets,
    bounces: int,
    shots: Shots,
    seed: int,
) -> BounceSpots:
    """Follow random paths from the spots of n shots over up to ``bounces`` surfaces.

    Parameters
    ----------
    loaded, layout
        Scene and optics.
    beamlets
        Starts of the k paths of each shot.
    bounces
        Largest number of surfaces, 2 or more.
    shots
        The n shots.
    seed
        Seed of the paths.

    Returns
    -------
    BounceSpots
        n · k · (bounces − 1) entries; entry (i · k + j) · (bounces − 1) + v is surface v + 2 of path j of shot i.
    """
    lane = lanes(beamlets, shots)
    frame = frame_at(layout, lane.own, lane.time)
    beam = launch(layout, frame, lane.node)
    loaded = pose_scene(loaded, lane.own.poses)
    si = meet(loaded, beam.origin, beam.direction)
    power = lane.weight * dr.opaque(mi.Float, layout.laser.power)
    vertices, paths = bounces - 1, dr.width(lane.shot)
    power_seen, position, sigma = (dr.empty(mi.Float, paths * vertices) for _ in range(3))
    found = BounceSpots(power_seen, position, sigma, dr.zeros(mi.Float, paths * vertices))
    for number, vertex in enumerate(walk(loaded, lane, si, power, bounces, seed)):
        spots = _image_vertex(loaded, layout, lane.own, frame, lane.stop, vertex)
        dr.eval(vertex, spots)
        at = dr.arange(mi.UInt32, paths) * vertices + number
        dr.scatter(found.power, spots.power, at)
        dr.scatter(found.position, spots.position, at)
        dr.scatter(found.sigma, spots.sigma, at)
    return found


def _image_vertex(
    loaded: LoadedScene, layout: OpticalLayout, shots: Shots, frame: Frame, stop: list[Float], vertex: Vertex
) -> BounceSpots:
    """Return the image of the light at surface points."""
    strength, seen = connect(loaded, layout, frame, vertex.si, stop, vertex.alive, coherent=False)
    p, q, depth = image(layout, frame, vertex.si.p)
    p = synchronisation_shift(layout, p, shots.synchronisation)
    blur = dr.opaque(mi.Float, layout.point_spread**2)
    height = dr.opaque(mi.Float, layout.height)
    inside, p, variance = cut_by_height(p, q, blur, blur, mi.Float(0.0), height)
    position, pitch = to_pixels(layout, p), dr.opaque(mi.Float, layout.pitch)
    good = seen & (depth > 0.0) & dr.isfinite(position)
    return BounceSpots(
        dr.select(good, vertex.power * strength * inside, 0.0),
        dr.select(good, position, 0.0),
        dr.sqrt(variance) / pitch + dr.zeros(mi.Float, dr.width(position)),
        mi.Float(0.0),
    )
