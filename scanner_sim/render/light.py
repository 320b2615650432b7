"""Light on the line sensor: from spots to watts on every pixel.

Shots are sorted by what their beam meets. On smooth ground a few beamlets suffice and their sum is one Gaussian
with their mean and variance; where beamlets disagree on material, visibility or place, the shot is traced again
with many and keeps the shape of its light in clusters, each with exact power, mean and variance. Pixels are
integrated in closed form.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.render.beamlets import Beamlets, edge_beamlets, smooth_beamlets
from scanner_sim.render.bounces import trace_bounces
from scanner_sim.render.clusters import Clusters, cluster
from scanner_sim.render.settings import Transport
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import Bench, Spots, trace_spots
from scanner_sim.scene.loader import LoadedScene

_CLUSTERS = 16
"""Clusters that a shot on an edge keeps."""
_BOUNCE_CLUSTERS = 64
"""Clusters of the light that met several surfaces; it may cover the whole line."""
_BOUNCE_BATCH = 1 << 22
"""Surface points of random paths that are traced together: bounds the memory."""
_FINE_BATCH = 1 << 22
"""Beamlets that are traced together where there are many: bounds the memory."""
_BENT = 0.05
"""Departure of a beamlet's image from the tangent plane [pixel] that calls for more beamlets."""
_DIFFERENT = 0.1
"""Relative spread of the returned strength that calls for more beamlets."""
_STEP = 0.5
"""The same departure [pixel] that can only be an edge of depth."""
_LONG = 2.0
"""Way of the spot along the line within a dwell [pixel] beyond which its light is no longer nearly Gaussian."""
_SMOOTH, _UNEVEN, _EDGE = 0, 1, 2


@dataclass
class Light:
    """Light on the line for a group of m shots.

    Attributes
    ----------
    index, shot
        Place of each shot in the batch, and its number, shape (m,), Dr.Jit unsigned.
    clusters
        Their light.
    """

    index: Any
    shot: Any
    clusters: Clusters

    def power(self, pixel: Any, place: Any) -> Any:
        """Return the power [W] on pixels of the shots at some places, 0 to m − 1; Dr.Jit arrays of one shape."""
        return self.clusters.power(pixel, place)

    def line(self, place: int, pixels: int) -> NDArray[np.float64]:
        """Return the power [W] on every pixel of the shot at a place, shape (pixels,)."""
        pixel = dr.arange(mi.UInt32, pixels)
        power = self.power(pixel, dr.full(mi.UInt32, place, pixels)).numpy()
        return np.asarray(power, dtype=np.float64)


@dataclass
class Truth:
    """What the chief ray of each shot meets; estimators do not see it. Dr.Jit arrays, shape (n,).

    ``distance`` along the beam [m] (NaN for nothing), ``object`` and ``material`` numbers (0 for nothing).
    """

    distance: Any
    object: Any
    material: Any

    def distance_of(self, index: Any) -> Any:
        """Return the distances [m] of the shots at some places."""
        return dr.gather(mi.Float, self.distance, index)


def render_light(
    loaded: LoadedScene, bench: Bench, settings: Transport, shots: Shots, seed: int
) -> tuple[Truth, Iterator[Light]]:
    """Follow the laser's light of a batch of shots onto the line.

    Parameters
    ----------
    loaded, bench, settings
        Scene, optics and how finely the beam is split.
    shots
        The n shots with their true deflections.
    seed
        Seed of the random paths of several bounces.

    Returns
    -------
    Truth
        Of all shots.
    iterator of Light
        Groups of shots that together hold every shot once.
    """
    count = dr.width(shots.theta)
    beamlets = smooth_beamlets(settings.beamlets)
    spots = trace_spots(loaded, bench, beamlets, shots)
    dr.eval(spots)
    chief = dr.arange(mi.UInt32, count) * len(beamlets.weights)
    shape = dr.gather(mi.UInt32, spots.shape, chief)
    truth = Truth(
        dr.gather(mi.Float, spots.distance, chief),
        dr.gather(mi.UInt32, loaded.object_of, shape),
        dr.gather(mi.UInt32, loaded.material_of, shape),
    )
    ground = _ground(loaded, bench, beamlets, spots, chief)
    dr.eval(truth, ground)

    def groups() -> Iterator[Light]:
        smooth = dr.compress(ground == _SMOOTH)
        if dr.width(smooth):
            clusters = cluster(spots, smooth, len(beamlets.weights), 1)
            direct = Light(smooth, shots.some(smooth).number, clusters)
            yield from _with_bounces(loaded, bench, settings, shots, seed, direct)
        for kind, count in ((_UNEVEN, settings.uneven_beamlets), (_EDGE, settings.edge_beamlets)):
            members = dr.compress(ground == kind)
            together = max(1, _FINE_BATCH // count)
            for start in range(0, dr.width(members), together):
                some = dr.arange(mi.UInt32, start, min(start + together, dr.width(members)))
                index = dr.gather(mi.UInt32, members, some)
                clusters = _finely(loaded, bench, edge_beamlets(count), shots.some(index))
                direct = Light(index, shots.some(index).number, clusters)
                yield from _with_bounces(loaded, bench, settings, shots, seed, direct)

    return truth, groups()


def _finely(loaded: LoadedScene, bench: Bench, beamlets: Beamlets, shots: Shots) -> Clusters:
    """Trace shots again with many beamlets, and keep the shape of their light."""
    spots = trace_spots(loaded, bench, beamlets, shots)
    dr.eval(spots.power, spots.position, spots.sigma)
    return cluster(spots, dr.arange(mi.UInt32, dr.width(shots.number)), len(beamlets.weights), _CLUSTERS)


def _with_bounces(
    loaded: LoadedScene,
    bench: Bench,
    settings: Transport,
    shots: Shots,
    seed: int,
    direct: Light,
) -> Iterator[Light]:
    """Yield the light of a group, in parts that fit the memory, with the light of several bounces added."""
    if settings.bounces == 1:
        yield direct
        return
    beamlets = edge_beamlets(settings.bounce_paths)
    vertices = settings.bounces - 1
    together = max(1, _BOUNCE_BATCH // (settings.bounce_paths * vertices))
    for start in range(0, dr.width(direct.index), together):
        some = dr.arange(mi.UInt32, start, min(start + together, dr.width(direct.index)))
        index = dr.gather(mi.UInt32, direct.index, some)
        own = shots.some(index)
        spots = trace_bounces(loaded, bench, beamlets, settings.bounces, own, seed)
        dr.eval(index, own, spots)
        points = settings.bounce_paths * vertices
        late = cluster(spots, dr.arange(mi.UInt32, dr.width(index)), points, _BOUNCE_CLUSTERS)
        yield Light(index, own.number, direct.clusters.part(some).joined(late))


def _ground(loaded: LoadedScene, bench: Bench, beamlets: Beamlets, spots: Spots, chief: Any) -> Any:
    """Tell what each shot's beam meets: smooth ground, uneven ground or an edge.

    Where beamlets disagree on material or visibility there is an edge; where they leave the tangent plane of the
    chief beamlet, or return unequally, the ground is uneven.
    """

    def beamlet(values: Any, number: int) -> Any:
        return dr.gather(type(values), values, chief + number)

    material = dr.gather(mi.UInt32, loaded.material_of, beamlet(spots.shape, 0))
    seen, position = beamlet(spots.seen, 0), beamlet(spots.position, 0)
    slope_a, slope_b = beamlet(spots.slope_a, 0), beamlet(spots.slope_b, 0)
    slope_time = beamlet(spots.slope_time, 0)
    # The beam's ruled lines turn about its axis by atan((z − z₀)/z_R).
    to_waist = beamlet(spots.distance, 0) - dr.opaque(mi.Float, bench.laser.waist_distance)
    twist = to_waist / dr.opaque(mi.Float, bench.laser.rayleigh_length)
    cosine = dr.rsqrt(1.0 + dr.square(twist))
    sine = twist * cosine
    edge, farthest = mi.Bool(False), mi.Float(0.0)
    weakest = strongest = beamlet(spots.strength, 0)
    for number, (a, b) in enumerate(beamlets.nodes.tolist()[1:], 1):
        moment = float(beamlets.times[number])
        edge |= dr.gather(mi.UInt32, loaded.material_of, beamlet(spots.shape, number)) != material
        edge |= beamlet(spots.seen, number) != seen
        flat = position + slope_a * (a * cosine - b * sine) + slope_b * (a * sine + b * cosine)
        flat += slope_time * moment
        farthest = dr.maximum(farthest, dr.abs(beamlet(spots.position, number) - flat))
        strength = beamlet(spots.strength, number)
        weakest, strongest = dr.minimum(weakest, strength), dr.maximum(strongest, strength)
    edge |= (seen == 1) & (farthest > _STEP)
    uneven = (seen == 1) & ((farthest > _BENT) | (dr.abs(slope_time) > _LONG))
    uneven |= strongest - weakest > _DIFFERENT * strongest
    return dr.select(edge, mi.UInt32(_EDGE), dr.select(uneven, mi.UInt32(_UNEVEN), mi.UInt32(_SMOOTH)))
