"""Laser light that meets several surfaces before it is seen: false spots and a faint veil.

Random paths start on the beamlets of the spot, are scattered by sampling each surface's BSDF, and are connected to
the receiving aperture at the second and every later surface (next-event estimation; Veach, *Robust Monte Carlo
methods for light transport simulation*, 1997, ch. 10). Each such point is imaged with the lens's point spread. What
is left out: light whose last surface before the lens is a perfect mirror (the spot seen in a mirror).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from scanner_sim.render.beamlets import Beamlets
from scanner_sim.render.rays import posed
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import (
    Bench,
    connect,
    cut_by_height,
    frame_at,
    image,
    launch,
    meet,
    out_of_step,
    to_pixels,
)
from scanner_sim.scene.loader import LoadedScene
from scanner_sim.scene.polarisation import speckle_contrast
from scanner_sim.streams import Stream, generator

_COHERENCE = speckle_contrast(1.0) ** 2


@dataclass
class BounceSpots:
    """Where light is seen that met several surfaces, Dr.Jit arrays: power [W], position and sigma [pixel].

    ``across`` mean square distance from the line's middle [pixel²]; ``coherence`` squared contrast of its speckle:
    several surfaces depolarise.
    """

    power: Any
    position: Any
    sigma: Any
    across: Any
    coherence: Any


def trace_bounces(
    loaded: LoadedScene,
    bench: Bench,
    beamlets: Beamlets,
    bounces: int,
    shots: Shots,
    seed: int,
) -> BounceSpots:
    """Follow random paths from the spots of n shots over up to ``bounces`` surfaces.

    Parameters
    ----------
    loaded, bench
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
    n = dr.width(shots.number)
    lane = dr.arange(mi.UInt32, n * len(beamlets.weights))
    shot = lane // len(beamlets.weights)
    path, own = lane - shot * len(beamlets.weights), shots.some(shot)
    frame = frame_at(bench, own, dr.gather(mi.Float, mi.Float(beamlets.times), path))
    node = [dr.gather(mi.Float, mi.Float(beamlets.nodes[:, axis]), path) for axis in (0, 1)]
    stop = [dr.gather(mi.Float, mi.Float(beamlets.aperture[:, axis]), path) for axis in (0, 1)]
    beam = launch(bench, frame, node)
    loaded = posed(loaded, own.poses)
    si = meet(loaded, beam.origin, beam.direction)
    power = dr.gather(mi.Float, mi.Float(beamlets.weights), path) * dr.opaque(mi.Float, bench.laser.power)
    alive = si.is_valid()
    vertices = bounces - 1
    size = dr.width(lane) * vertices
    power_seen, position, sigma, across = (dr.empty(mi.Float, size) for _ in range(4))
    found = BounceSpots(power_seen, position, sigma, across, dr.full(mi.Float, _COHERENCE, size))
    for surface in range(2, bounces + 1):
        random = generator(seed, Stream.BOUNCES, own.number, path * 32 + surface).next_float32x4()
        sample, weight = si.bsdf().sample(
            mi.BSDFContext(), si, random[0], mi.Point2f(random[1], random[2]), alive
        )
        power = power * dr.select(alive, weight[0], 0.0)
        alive &= power > 0.0
        ray = si.spawn_ray(si.to_world(sample.wo))
        si = meet(loaded, ray.o, ray.d, alive, coherent=False)
        alive &= si.is_valid()
        spots = _seen(loaded, bench, own, frame, si, stop, power, alive)
        dr.eval(si, power, alive, spots)
        at = lane * vertices + (surface - 2)
        dr.scatter(found.power, spots.power, at)
        dr.scatter(found.position, spots.position, at)
        dr.scatter(found.sigma, spots.sigma, at)
        dr.scatter(found.across, spots.across, at)
    return found


def _seen(
    loaded: LoadedScene,
    bench: Bench,
    shots: Shots,
    frame: Any,
    si: Any,
    stop: Any,
    power: Any,
    active: Any,
) -> BounceSpots:
    """Return the image of light of some power at surface points."""
    strength, seen = connect(loaded, bench, frame, si, stop, active, coherent=False)
    p, q, depth = image(bench, frame, si.p)
    p = out_of_step(bench, p, shots.synchronisation)
    blur = dr.opaque(mi.Float, bench.receiver.point_spread**2)
    height = dr.opaque(mi.Float, bench.height)
    inside, p, variance, across = cut_by_height(p, q, blur, blur, mi.Float(0.0), height)
    position, pitch = to_pixels(bench, p), dr.opaque(mi.Float, bench.pitch)
    good = seen & (depth > 0.0) & dr.isfinite(position)
    return BounceSpots(
        dr.select(good, power * strength * inside, 0.0),
        dr.select(good, position, 0.0),
        dr.sqrt(variance) / pitch + dr.zeros(mi.Float, dr.width(position)),
        dr.select(good, across / dr.square(pitch), 0.0),
        mi.Float(_COHERENCE),
    )
