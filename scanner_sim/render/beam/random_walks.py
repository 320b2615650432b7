"""Random paths from surface to surface, for light that meets several before it is seen.

Each surface scatters a path by a sample of its BSDF; whoever follows the paths connects every later surface to the
receiving aperture (next-event estimation; Veach, *Robust Monte Carlo methods for light transport simulation*, 1997,
ch. 10). What is left out: light whose last surface before the lens is a perfect mirror (the spot seen in a mirror).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from scanner_sim.foundation.device_types import Float, Mask, SurfaceInteraction3f
from scanner_sim.foundation.streams import Stream, generator
from scanner_sim.render.rays import leaving_rays
from scanner_sim.render.transport import Lanes, meet
from scanner_sim.scene.files.loader import LoadedScene


@dataclass
class Vertex:
    """Where paths meet a surface, one lane each: ``si`` there, ``power`` that arrives, whether they are ``alive``."""

    si: SurfaceInteraction3f
    power: Float
    alive: Mask


def walk(
    loaded: LoadedScene, lane: Lanes, si: SurfaceInteraction3f, power: Float, surfaces: int, seed: int
) -> Iterator[Vertex]:
    """Yield the second to the last surface of random paths.

    Parameters
    ----------
    loaded
        The scene, with poses for the lanes.
    lane
        Starts of the paths, which address their random numbers.
    si, power
        The first surfaces, and the power that arrives there.
    surfaces
        Number of surfaces of a path, the first one included.
    seed
        Seed of the paths.

    Yields
    ------
    Vertex
        To be evaluated, with all that is made of it, before the next is asked for.
    """
    alive = si.is_valid()
    for surface in range(2, surfaces + 1):
        random = generator(
            seed, Stream.BOUNCES, lane.own.number, lane.beamlet * 32 + surface
        ).next_float32x4()
        sample, weight = si.bsdf().sample(
            mi.BSDFContext(), si, random[0], mi.Point2f(random[1], random[2]), alive
        )
        power = power * dr.select(alive, weight[0], 0.0)
        alive = alive & (power > 0.0)
        ray = leaving_rays(si, si.to_world(sample.wo))
        si = meet(loaded, ray.o, ray.d, alive, coherent=False)
        alive = alive & si.is_valid()
        yield Vertex(si, power, alive)
