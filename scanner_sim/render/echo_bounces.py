"""Late echoes: pulses that meet several surfaces before they are seen.

As in :mod:`scanner_sim.render.bounces`, random paths start on the beamlets, are scattered by sampling each surface's
BSDF, and are connected to the receiving aperture at the second and every later surface (Veach, *Robust Monte Carlo
methods for light transport simulation*, 1997, ch. 10); each carries the length of its whole way. What is left out:
light whose last surface before the lens is a perfect mirror.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from scanner_sim.render.beamlets import Beamlets, edge_beamlets
from scanner_sim.render.echo_clusters import gather_echoes
from scanner_sim.render.echoes import Echoes, View
from scanner_sim.render.rays import posed
from scanner_sim.render.settings import Transport
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import Bench, connect, device_frame, launch, meet
from scanner_sim.scene.loader import LoadedScene
from scanner_sim.streams import Stream, generator

_CLUSTERS = 64
"""Echoes kept of the light that met several surfaces; they may cover the whole record."""
_BATCH = 1 << 22
"""Surface points of random paths that are traced together: bounds the memory."""


@dataclass
class LateReturns:
    """Light that met several surfaces, Dr.Jit arrays.

    ``share`` of the pulse's power; ``path`` from the shot's reference [m]; ``spread`` is 0.
    """

    share: Any
    path: Any
    spread: Any


def with_bounces(
    loaded: LoadedScene,
    bench: Bench,
    view: View,
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
        own = shots.some(part.index)
        late = trace_late(loaded, bench, view, beamlets, settings.bounces, own, part.reference, seed)
        every = dr.arange(mi.UInt32, dr.width(part.index))
        echoes = gather_echoes(late.share, late.path, late.spread, every, points, _CLUSTERS)
        yield part.joined(Echoes(part.index, part.shot, *echoes, part.reference))


def trace_late(
    loaded: LoadedScene,
    bench: Bench,
    view: View,
    beamlets: Beamlets,
    bounces: int,
    shots: Shots,
    reference: Any,
    seed: int,
) -> LateReturns:
    """Follow random paths of n shots over up to ``bounces`` surfaces.

    Parameters
    ----------
    loaded, bench, view
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
    count, vertices = len(beamlets.weights), bounces - 1
    lane = dr.arange(mi.UInt32, dr.width(shots.number) * count)
    shot = lane // count
    number, own = lane - shot * count, shots.some(shot)
    frame = view.frame(device_frame(bench, own.theta, own.phi))
    node = [dr.gather(mi.Float, mi.Float(beamlets.nodes[:, axis]), number) for axis in (0, 1)]
    stop = [dr.gather(mi.Float, mi.Float(beamlets.aperture[:, axis]), number) for axis in (0, 1)]
    beam = launch(bench, frame, node)
    loaded = posed(loaded, own.poses)
    si = meet(loaded, beam.origin, beam.direction)
    power = dr.gather(mi.Float, mi.Float(beamlets.weights), number)
    alive = si.is_valid()
    way = dr.select(alive, si.t, 0.0) - dr.gather(mi.Float, reference, shot)
    size = dr.width(lane) * vertices
    found = LateReturns(dr.empty(mi.Float, size), dr.empty(mi.Float, size), dr.zeros(mi.Float, size))
    for surface in range(2, bounces + 1):
        random = generator(seed, Stream.BOUNCES, own.number, number * 32 + surface).next_float32x4()
        sample, weight = si.bsdf().sample(
            mi.BSDFContext(), si, random[0], mi.Point2f(random[1], random[2]), alive
        )
        power = power * dr.select(alive, weight[0], 0.0)
        alive &= power > 0.0
        ray = si.spawn_ray(si.to_world(sample.wo))
        si = meet(loaded, ray.o, ray.d, alive, coherent=False)
        alive &= si.is_valid()
        way = way + dr.select(alive, si.t, 0.0)
        strength, seen = connect(loaded, bench, frame, si, stop, alive, coherent=False)
        seen &= view.sees(frame, si.p)
        arrives = dr.select(seen, power * strength, 0.0)
        path = dr.select(seen, way + dr.norm(mi.Vector3f(si.p - frame.lens)), 0.0)
        dr.eval(si, power, alive, way, arrives, path)
        at = lane * vertices + (surface - 2)
        dr.scatter(found.share, arrives, at)
        dr.scatter(found.path, path, at)
    return found
