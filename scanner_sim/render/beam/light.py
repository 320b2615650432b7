"""Light on the line sensor: from spots to watts on every pixel.

Shots are sorted by what their beam meets. On smooth surfaces a few beamlets suffice and their sum is one Gaussian
with their mean and variance; where beamlets disagree on material, visibility or position, the shot is traced again
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

from scanner_sim.foundation.device_types import Float, UInt32
from scanner_sim.render.beam.beamlets import Beamlets, edge_beamlets, smooth_beamlets
from scanner_sim.render.beam.bounces import trace_bounces
from scanner_sim.render.beam.clusters import Clusters, cluster
from scanner_sim.render.settings import Transport
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout, Spots, trace_spots
from scanner_sim.scene.files.loader import LoadedScene

_CLUSTERS = 16
"""Clusters that a shot on an edge keeps."""
_BOUNCE_CLUSTERS = 64
"""Clusters of the light that met several surfaces; it may cover the whole line."""
_BOUNCE_BATCH = 1 << 22
"""Surface points of random paths that are traced together: bounds the memory."""
_FINE_BATCH = 1 << 22
"""Beamlets that are traced together where there are many: bounds the memory."""
_UNEVEN_DEPARTURE = 0.05
"""Departure of a beamlet's image from the tangent plane [pixel] that calls for more beamlets."""
_UNEVEN_RISE = 0.02
"""Relative rise of the returned strength per standard deviation of the beam that calls for more: it shifts the
light within each beamlet. A rise along the sweep does not."""
_UNEVEN_KINK = 0.03
"""Departure of two opposite beamlets' mean strength from the chief one's, relative to the strongest, that calls for
more."""
_EDGE_DEPARTURE = 0.5
"""The same departure [pixel] that can only be an edge of depth."""
_GRAZING_WEIGHT = 0.01
"""Weight of the beamlets beyond an edge below which the edge only grazes the light of a long sweep, whose outermost
beamlets are far out."""
_LONG_SWEEP = 4.0
"""Standard deviations of the beam that make a sweep long."""
_GAUSSIAN_TRAVEL = 2.0
"""Way of the spot along the line within a dwell [pixel] beyond which its light is no longer nearly Gaussian."""
_SMOOTH, _UNEVEN, _EDGE, _GRAZED = 0, 1, 2, 3


@dataclass
class Light:
    """Light on the line for a group of m shots.

    Attributes
    ----------
    index, shot
        Index of each shot in the batch, and its number, shape (m,), Dr.Jit unsigned.
    clusters
        Their light.
    """

    index: UInt32
    shot: UInt32
    clusters: Clusters

    def power(self, pixel: UInt32, index: UInt32) -> Float:
        """Return the power [W] on pixels of shots by their indices, 0 to m − 1; Dr.Jit arrays of one shape."""
        return self.clusters.power(pixel, index)

    def line(self, index: int, pixels: int) -> NDArray[np.float64]:
        """Return the power [W] on every pixel of the shot with an index, shape (pixels,)."""
        pixel = dr.arange(mi.UInt32, pixels)
        power = self.power(pixel, dr.full(mi.UInt32, index, pixels)).numpy()
        return np.asarray(power, dtype=np.float64)


@dataclass
class Truth:
    """What the chief ray of each shot meets; estimators do not see it. Dr.Jit arrays, shape (n,).

    ``distance`` along the beam [m] (NaN for nothing), ``object`` and ``material`` numbers (0 for nothing).
    """

    distance: Float
    object: UInt32
    material: UInt32

    def take(self, index: UInt32) -> Truth:
        """Return what the chief rays of some shots meet, by their indices."""
        return Truth(
            dr.gather(mi.Float, self.distance, index),
            dr.gather(mi.UInt32, self.object, index),
            dr.gather(mi.UInt32, self.material, index),
        )


def chief_truth(loaded: LoadedScene, distance: Float, shape: UInt32, chief: UInt32) -> Truth:
    """Return what the chief rays meet, whose distance [m] and shape's registry index stand at the indices ``chief``."""
    met = dr.gather(mi.UInt32, shape, chief)
    return Truth(
        dr.gather(mi.Float, distance, chief),
        dr.gather(mi.UInt32, loaded.object_of, met),
        dr.gather(mi.UInt32, loaded.material_of, met),
    )


def batches_of_shots(indices: UInt32, beamlets: int) -> Iterator[UInt32]:
    """Yield indices of shots in batches whose beamlets, so many each, fit the memory."""
    together = max(1, _FINE_BATCH // beamlets)
    for start in range(0, dr.width(indices), together):
        some = dr.arange(mi.UInt32, start, min(start + together, dr.width(indices)))
        yield dr.gather(mi.UInt32, indices, some)


def render_light(
    loaded: LoadedScene, layout: OpticalLayout, settings: Transport, shots: Shots, seed: int
) -> tuple[Truth, Iterator[Light]]:
    """Follow the laser's light of a batch of shots onto the line.

    Parameters
    ----------
    loaded, layout, settings
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
    spots = trace_spots(loaded, layout, beamlets, shots)
    dr.eval(spots)
    chief = dr.arange(mi.UInt32, count) * len(beamlets.weights)
    truth = chief_truth(loaded, spots.distance, spots.shape, chief)
    footprint = _classify_footprints(loaded, layout, beamlets, shots, spots, chief)
    dr.eval(truth, footprint)

    def groups() -> Iterator[Light]:
        smooth = dr.compress(footprint == _SMOOTH)
        if dr.width(smooth):
            clusters = cluster(spots, smooth, len(beamlets.weights), 1)
            direct = Light(smooth, shots.take(smooth).number, clusters)
            yield from _with_bounces(loaded, layout, settings, shots, seed, direct)
        finer = {
            _UNEVEN: settings.uneven_beamlets,
            _GRAZED: max(settings.uneven_beamlets, settings.edge_beamlets // 2),
            _EDGE: settings.edge_beamlets,
        }
        for kind, count in finer.items():
            for index in batches_of_shots(dr.compress(footprint == kind), count):
                own = shots.take(index)
                direct = Light(index, own.number, _trace_finely(loaded, layout, edge_beamlets(count), own))
                yield from _with_bounces(loaded, layout, settings, shots, seed, direct)

    return truth, groups()


def _trace_finely(loaded: LoadedScene, layout: OpticalLayout, beamlets: Beamlets, shots: Shots) -> Clusters:
    """Trace shots again with many beamlets, and keep the shape of their light."""
    spots = trace_spots(loaded, layout, beamlets, shots)
    dr.eval(spots.power, spots.position, spots.sigma, spots.coherence)
    return cluster(spots, dr.arange(mi.UInt32, dr.width(shots.number)), len(beamlets.weights), _CLUSTERS)


def _with_bounces(
    loaded: LoadedScene,
    layout: OpticalLayout,
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
        own = shots.take(index)
        spots = trace_bounces(loaded, layout, beamlets, settings.bounces, own, seed)
        dr.eval(index, own, spots)
        points = settings.bounce_paths * vertices
        late = cluster(spots, dr.arange(mi.UInt32, dr.width(index)), points, _BOUNCE_CLUSTERS)
        yield Light(index, own.number, direct.clusters.part(some).join(late))


def _classify_footprints(
    loaded: LoadedScene, layout: OpticalLayout, beamlets: Beamlets, shots: Shots, spots: Spots, chief: UInt32
) -> UInt32:
    """Return what each shot's beam meets: a smooth surface, an uneven one, an edge, or an edge that only grazes it.

    Where beamlets disagree with the chief one on material or visibility, or lie far off its tangent plane, there is an
    edge, which only grazes the light where the outermost do; where they leave the plane a little or return
    unequally, the surface is uneven.
    """

    def beamlet(values: Any, number: int) -> Any:
        return dr.gather(type(values), values, chief + number)

    material = dr.gather(mi.UInt32, loaded.material_of, beamlet(spots.shape, 0))
    seen, position = beamlet(spots.seen, 0), beamlet(spots.position, 0)
    slope_a, slope_b = beamlet(spots.slope_a, 0), beamlet(spots.slope_b, 0)
    slope_time = beamlet(spots.slope_time, 0)
    # The beam's ruled lines turn about its axis by atan((z − z₀)/z_R).
    to_waist = beamlet(spots.distance, 0) - dr.opaque(mi.Float, layout.laser.waist_distance)
    twist = to_waist / dr.opaque(mi.Float, layout.laser.rayleigh_length)
    cosine = dr.rsqrt(1.0 + dr.square(twist))
    sine = twist * cosine
    laser = layout.laser
    width = dr.opaque(mi.Float, 0.5 * laser.waist_radius) * dr.sqrt(1.0 + dr.square(twist))
    swept = dr.sqrt(dr.square(shots.travel_theta) + dr.square(shots.travel_phi))
    swept *= beamlet(spots.distance, 0) / width
    beyond, farthest, kink = mi.Float(0.0), mi.Float(0.0), mi.Float(0.0)
    rise_a, rise_b = mi.Float(0.0), mi.Float(0.0)
    strength = [beamlet(spots.strength, number) for number in range(len(beamlets.weights))]
    strongest = strength[0]
    for number, (a, b) in enumerate(beamlets.nodes.tolist()[1:], 1):
        flat = position + slope_a * (a * cosine - b * sine) + slope_b * (a * sine + b * cosine)
        flat += slope_time * float(beamlets.times[number])
        departure = dr.select(seen == 1, dr.abs(beamlet(spots.position, number) - flat), 0.0)
        differs = dr.gather(mi.UInt32, loaded.material_of, beamlet(spots.shape, number)) != material
        differs |= (beamlet(spots.seen, number) != seen) | (departure > _EDGE_DEPARTURE)
        weight = float(beamlets.weights[number])
        beyond += dr.select(differs, weight, 0.0)
        rise_a += weight * a * strength[number]
        rise_b += weight * b * strength[number]
        farthest = dr.maximum(farthest, departure)
        strongest = dr.maximum(strongest, strength[number])
        if (number - 1) % 6 < 3:
            mean = 0.5 * (strength[number] + strength[number + 3])
            kink = dr.maximum(kink, dr.abs(mean - strength[0]))
    grazed = beyond > 0.0
    edge = beyond > _GRAZING_WEIGHT * dr.minimum(swept * (1.0 / _LONG_SWEEP), 1.0)
    uneven = (farthest > _UNEVEN_DEPARTURE) | ((seen == 1) & (dr.abs(slope_time) > _GAUSSIAN_TRAVEL))
    # Times are independent of positions: this is the rise across the beam alone, the sweep's left out.
    rise = dr.sqrt(dr.square(rise_a) + dr.square(rise_b)) / (1.0 - beamlets.width**2)
    uneven |= (kink > _UNEVEN_KINK * strongest) | (rise > _UNEVEN_RISE * strongest)
    footprint = dr.select(uneven, mi.UInt32(_UNEVEN), _SMOOTH)
    return dr.select(edge, _EDGE, dr.select(grazed, _GRAZED, footprint))
