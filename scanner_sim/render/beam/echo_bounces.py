"""Late echoes: pulses that meet several surfaces before they are seen.

Random paths start on the beamlets (:mod:`scanner_sim.render.beam.random_walks`), and each carries the length of its
whole way.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from scanner_sim.foundation.device_types import Float
from scanner_sim.render.beam.beamlets import Beamlets, edge_beamlets
from scanner_sim.render.beam.echo_clusters import Echoes, PhotodiodeView, gather_echoes
from scanner_sim.render.beam.random_walks import walk
from scanner_sim.render.rays import pose_scene
from scanner_sim.render.settings import Transport
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout, connect, device_frame, lanes, launch, meet
from scanner_sim.scene.files.loader import LoadedScene

_CLUSTERS = 64
"""Echoes kept of the light that met several surfaces; they may cover the whole record."""
_BATCH = 1 << 22
"""Surface points of random paths that are traced together: bounds the memory."""


@dataclass
class LateReturns:
    """Light that met several surfaces, Dr.Jit arrays.

    ``share`` of the pulse's power; ``path`` from the shot's reference [m]; ``spread`` is 0.
    """

    share: Float
    path: Float
    spread: Float


def with_bounces(
    loaded: LoadedScene,
    layout: OpticalLayout,
    view: PhotodiodeView,
    settings: Transport,
    shots: Shots,
    seed: int,
    direct: Echoes,
) -> Iterator[Echoes]:
    """Yield the echoes of a group, in parts that fit the memory, with the late ones added."""
    if settings.bounces == 1:
        yield direct
        return
    beamlets = edge_beamlets(settings.bounce_paths)
    points = settings.bounce_paths * (settings.bounces - 1)
    together = max(1, _BATCH // points)
    for start in range(0, dr.width(direct.index), together):
        some = dr.arange(mi.UInt32, start, min(start + together, dr.width(direct.index)))
        part = direct.part(some)
        own = shots.take(part.index)
        late = trace_late(loaded, layout, view, beamlets, settings.bounces, own, part.reference, seed)
        every = dr.arange(mi.UInt32, dr.width(part.index))
        echoes = gather_echoes(late.share, late.path, late.spread, every, points, _CLUSTERS)
        yield part.join(Echoes(part.index, part.shot, *echoes, part.reference))


def trace_late(
    loaded: LoadedScene,
    layout: OpticalLayout,
    view: PhotodiodeView,
    beamlets: Beamlets,
    bounces: int,
    shots: Shots,
    reference: Float,
    seed: int,
) -> LateReturns:
    """Follow random paths of n shots over up to ``bounces`` surfaces.

    Parameters
    ----------
    loaded, layout, view
        Scene, optics and the photodiode's look.
    beamlets
        Starts of the k paths of each shot.
    bounces
        Largest number of surfaces, 2 or more.
    shots, reference
        The n shots and the lengths [m] that their paths are counted from.
    seed
        Seed of the paths.

    Returns
    -------
    LateReturns
        n · k · (bounces − 1) entries; entry (i · k + j) · (bounces − 1) + v is surface v + 2 of path j of shot i.
    """
    lane = lanes(beamlets, shots)
    frame = view.frame(device_frame(layout, lane.own.theta, lane.own.phi))
    beam = launch(layout, frame, lane.node)
    loaded = pose_scene(loaded, lane.own.poses)
    si = meet(loaded, beam.origin, beam.direction)
    way = dr.select(si.is_valid(), si.t, 0.0) - dr.gather(mi.Float, reference, lane.shot)
    vertices, paths = bounces - 1, dr.width(lane.shot)
    share, lengths = (dr.empty(mi.Float, paths * vertices) for _ in range(2))
    found = LateReturns(share, lengths, dr.zeros(mi.Float, paths * vertices))
    for number, vertex in enumerate(walk(loaded, lane, si, lane.weight, bounces, seed)):
        si = vertex.si
        way = way + dr.select(vertex.alive, si.t, 0.0)
        strength, seen = connect(loaded, layout, frame, si, lane.stop, vertex.alive, coherent=False)
        seen &= view.sees(frame, si.p)
        arrives = dr.select(seen, vertex.power * strength, 0.0)
        path = dr.select(seen, way + dr.norm(mi.Vector3f(si.p - frame.lens)), 0.0)
        dr.eval(vertex, way, arrives, path)
        at = dr.arange(mi.UInt32, paths) * vertices + number
        dr.scatter(found.share, arrives, at)
        dr.scatter(found.path, path, at)
    return found
