"""Laser light that meets several surfaces before it is seen: false spots, a faint veil, late echoes.

Random paths start on the beamlets. Each surface scatters a path by a sample of its BSDF, and every later surface is
connected to the receiving aperture (next-event estimation; Veach, *Robust Monte Carlo methods for light transport
simulation*, 1997, ch. 10). What is left out: light whose last surface before the lens is a perfect mirror (the spot
seen in a mirror).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from scanner_sim.foundation.device_streams import generator
from scanner_sim.foundation.device_types import Float, Mask, SurfaceInteraction3f
from scanner_sim.foundation.streams import Stream
from scanner_sim.render.beam.beamlets import Beamlets
from scanner_sim.render.beam.projection import Projection, Spots
from scanner_sim.render.rays import leaving_rays, pose_scene
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import Lanes, connect, frame_at, lanes, launch, meet
from scanner_sim.scene.files.loader import LoadedScene


@dataclass
class Vertex:
    """Where paths meet a surface, one lane each.

    ``si`` there, ``power`` that arrives, ``way`` of the path so far [m], whether they are ``alive``.
    """

    si: SurfaceInteraction3f
    power: Float
    way: Float
    alive: Mask


def trace_bounces(
    loaded: LoadedScene,
    projection: Projection,
    beamlets: Beamlets,
    bounces: int,
    shots: Shots,
    seed: int,
    reference: Float | None = None,
) -> Spots:
    """Follow random paths of n shots over up to ``bounces`` surfaces.

    Parameters
    ----------
    loaded, projection
        The scene, and where light is laid.
    beamlets
        Starts of the k paths of each shot.
    bounces
        Largest number of surfaces, 2 or more.
    shots
        The n shots.
    seed
        Seed of the paths.
    reference
        What the paths of each shot are counted from [m], shape (n,); None for 0.

    Returns
    -------
    Spots
        n · k · (bounces − 1) entries; entry (i · k + j) · (bounces − 1) + v is surface v + 2 of path j of shot i. Their
        coherence, where it is kept, is 0: the light comes from so large a part of the scene that little of its speckle
        is left.
    """
    layout, lane = projection.layout, lanes(beamlets, shots)
    frame = projection.seen_from(frame_at(layout, lane.own, lane.time))
    beam = launch(layout, frame, lane.node)
    loaded = pose_scene(loaded, lane.own.poses)
    si = meet(loaded, beam.origin, beam.direction)
    way = dr.select(si.is_valid(), si.t, 0.0)
    if reference is not None:
        way = way - dr.gather(mi.Float, reference, lane.shot)
    first = Vertex(si, lane.weight * projection.power(lane.own), way, si.is_valid())
    vertices, paths = bounces - 1, dr.width(lane.shot)
    found = Spots(*(dr.empty(mi.Float, paths * vertices) for _ in range(3)))
    if projection.resolution.keeps_coherence:
        found.coherence = dr.zeros(mi.Float, paths * vertices)
    for number, vertex in enumerate(_walk(loaded, lane, first, bounces, seed)):
        strength, seen = connect(
            loaded,
            layout,
            frame,
            vertex.si,
            lane.stop,
            vertex.alive & projection.sees(frame, vertex.si.p),
            coherent=False,
        )
        position, sigma, kept = projection.lay_point(frame, lane.own, vertex.si.p, vertex.way)
        good = seen & dr.isfinite(position)
        power = dr.select(good, vertex.power * strength * kept, 0.0)
        position = dr.select(good, position, 0.0)
        sigma = sigma + dr.zeros(mi.Float, paths)
        dr.eval(vertex, power, position, sigma)
        at = dr.arange(mi.UInt32, paths) * vertices + number
        dr.scatter(found.power, power, at)
        dr.scatter(found.position, position, at)
        dr.scatter(found.sigma, sigma, at)
    return found


def _walk(loaded: LoadedScene, lane: Lanes, vertex: Vertex, surfaces: int, seed: int) -> Iterator[Vertex]:
    """Yield the second to the last surface of random paths from their first.

    Each is to be evaluated, with all that is made of it, before the next is asked for. ``lane`` are the starts of the
    paths, which address their random numbers; ``loaded`` has poses for them.
    """
    si, power, way, alive = vertex.si, vertex.power, vertex.way, vertex.alive
    own = seed if lane.own.seeds is None else lane.own.seeds.lanes
    for surface in range(2, surfaces + 1):
        random = generator(own, Stream.BOUNCES, lane.own.number, lane.beamlet * 32 + surface).next_float32x4()
        sample, weight = si.bsdf().sample(
            mi.BSDFContext(), si, random[0], mi.Point2f(random[1], random[2]), alive
        )
        power = power * dr.select(alive, weight[0], 0.0)
        alive = alive & (power > 0.0)
        ray = leaving_rays(si, si.to_world(sample.wo))
        si = meet(loaded, ray.o, ray.d, alive, coherent=False)
        alive = alive & si.is_valid()
        way = way + dr.select(alive, si.t, 0.0)
        yield Vertex(si, power, way, alive)
