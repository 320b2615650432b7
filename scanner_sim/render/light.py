"""Light on the line sensor: from spots to watts on every pixel.

Shots are sorted by what their beam meets. On smooth ground a few beamlets suffice and their sum is one Gaussian
with their mean and variance; where beamlets disagree on material, visibility or place, the shot is traced again
with many and keeps the shape of its light in clusters, each with exact power, mean and variance. Pixels are
integrated in closed form.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.render.bounces import BounceSpots, trace_bounces
from scanner_sim.render.beamlets import Beamlets, edge_beamlets, smooth_beamlets
from scanner_sim.render.settings import Transport
from scanner_sim.render.transport import Bench, Spots, trace_spots
from scanner_sim.scene.loader import LoadedScene

_CLUSTERS = 16
"""Clusters that a shot on an edge keeps."""
_BOUNCE_CLUSTERS = 64
"""Clusters of the light that met several surfaces; it may cover the whole line."""
_BOUNCE_BATCH = 1 << 22
"""Surface points of random paths that are traced together: bounds the memory."""
_EDGE_BATCH = 16384
"""Shots on edges that are traced together: bounds the memory."""
_REACH = 6.0
"""Standard deviations to which a spot's light is followed: the rest is 2e-9 of it."""
_BENT = 0.05
"""Departure of a beamlet's image from the tangent plane [pixel] that calls for more beamlets."""
_UNEVEN = 0.1
"""Relative spread of the returned strength that calls for more beamlets."""


@dataclass
class Light:
    """Light on the line for a group of shots, Dr.Jit arrays.

    Attributes
    ----------
    index
        Place of each shot in the batch, shape (m,).
    cluster_power, position, sigma
        Power [W], position and standard deviation [pixel] of Gaussian clusters of light, shape (c · m,):
        entry k · m + j is cluster k of shot j.
    """

    index: Any
    cluster_power: Any
    position: Any
    sigma: Any

    @property
    def shots(self) -> int:
        """Number m of shots."""
        return int(dr.width(self.index))

    def part(self, places: Any) -> Light:
        """Return the light of some of the shots only."""
        clusters, some = dr.width(self.position) // self.shots, dr.width(places)
        lane = dr.arange(mi.UInt32, clusters * some)
        at = (lane // some) * self.shots + dr.gather(mi.UInt32, places, lane % some)
        values = [dr.gather(mi.Float, part, at) for part in (self.cluster_power, self.position, self.sigma)]
        index = dr.gather(mi.UInt32, self.index, places)
        dr.eval(index, values)
        return Light(index, *values)

    def power(self, pixel: Any, place: Any) -> Any:
        """Return the power [W] on pixels of the shots at some places: the clusters integrated over each pixel.

        Parameters
        ----------
        pixel, place
            Dr.Jit unsigned arrays of one shape.
        """
        centre = mi.Float(pixel)

        def share(number: Any) -> Any:
            at = place + number * dr.opaque(mi.UInt32, self.shots)
            middle, width = dr.gather(mi.Float, self.position, at), dr.gather(mi.Float, self.sigma, at)
            scale = math.sqrt(0.5) / width
            left, right = (centre - 0.5 - middle) * scale, (centre + 0.5 - middle) * scale
            amount = dr.gather(mi.Float, self.cluster_power, at)
            near = (amount > 0.0) & (dr.minimum(dr.abs(left), dr.abs(right)) < _REACH)
            return dr.select(near, 0.5 * amount * (dr.erf(right) - dr.erf(left)), 0.0)

        clusters = dr.width(self.position) // self.shots
        if clusters == 1:
            return share(mi.UInt32(0))
        return dr.while_loop(
            (mi.UInt32(0), dr.zeros(mi.Float, dr.width(place))),
            lambda number, total: number < clusters,
            lambda number, total: (number + 1, total + share(number)),
        )[1]


    def line(self, place: int, pixels: int) -> NDArray[np.float64]:
        """Return the power [W] on every pixel of the shot at a place, shape (pixels,)."""
        pixel = dr.arange(mi.UInt32, pixels)
        return self.power(pixel, dr.full(mi.UInt32, place, pixels)).numpy().astype(np.float64)


@dataclass
class Truth:
    """What the chief ray of each shot meets; estimators do not see it. Dr.Jit arrays, shape (n,).

    ``distance`` along the beam [m] (NaN for nothing), ``object`` and ``material`` numbers (0 for nothing).
    """

    distance: Any
    object: Any
    material: Any


def render_light(
    loaded: LoadedScene, bench: Bench, settings: Transport, theta: Any, phi: Any, shot: Any, seed: int
) -> tuple[Truth, Iterator[Light]]:
    """Follow the laser's light of a batch of shots onto the line.

    Parameters
    ----------
    loaded, bench, settings
        Scene, optics and how finely the beam is split.
    theta, phi
        True deflections [rad], shape (n,), Dr.Jit.
    shot, seed
        Numbers of the shots, shape (n,), and seed: they address the random paths of several bounces.

    Returns
    -------
    Truth
        Of all shots.
    iterator of Light
        Groups of shots that together hold every shot once.
    """
    shots = dr.width(theta)
    beamlets = smooth_beamlets(settings.beamlets)
    spots = trace_spots(loaded, bench, beamlets, theta, phi)
    dr.eval(spots)
    chief = dr.arange(mi.UInt32, shots)
    shape = dr.gather(mi.UInt32, spots.shape, chief)
    truth = Truth(
        dr.gather(mi.Float, spots.distance, chief),
        dr.gather(mi.UInt32, loaded.object_of, shape),
        dr.gather(mi.UInt32, loaded.material_of, shape),
    )
    edge = _is_edge(loaded, bench, beamlets, spots, chief, shots)
    dr.eval(truth, edge)

    def groups() -> Iterator[Light]:
        smooth = dr.compress(~edge)
        if dr.width(smooth):
            direct = _cluster(spots, smooth, smooth, shots, len(beamlets.weights), 1)
            yield from _with_bounces(loaded, bench, settings, theta, phi, shot, seed, direct)
        rough = dr.compress(edge)
        fine = edge_beamlets(settings.edge_beamlets)
        for start in range(0, dr.width(rough), _EDGE_BATCH):
            some = dr.arange(mi.UInt32, start, min(start + _EDGE_BATCH, dr.width(rough)))
            index = dr.gather(mi.UInt32, rough, some)
            many = trace_spots(
                loaded, bench, fine, dr.gather(mi.Float, theta, index), dr.gather(mi.Float, phi, index)
            )
            dr.eval(index, many.power, many.position, many.sigma)
            count = dr.width(index)
            direct = _cluster(many, index, dr.arange(mi.UInt32, count), count, len(fine.weights), _CLUSTERS)
            yield from _with_bounces(loaded, bench, settings, theta, phi, shot, seed, direct)

    return truth, groups()


def _with_bounces(
    loaded: LoadedScene,
    bench: Bench,
    settings: Transport,
    theta: Any,
    phi: Any,
    shot: Any,
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
    for start in range(0, direct.shots, together):
        some = dr.arange(mi.UInt32, start, min(start + together, direct.shots))
        part = direct.part(some)
        spots = trace_bounces(
            loaded,
            bench,
            beamlets,
            settings.bounces,
            dr.gather(mi.Float, theta, part.index),
            dr.gather(mi.Float, phi, part.index),
            dr.gather(mi.UInt32, shot, part.index),
            seed,
        )
        count = part.shots
        paths = len(beamlets.weights) * vertices
        late = _cluster(spots, part.index, dr.arange(mi.UInt32, count), count, paths, _BOUNCE_CLUSTERS)
        yield Light(
            part.index,
            dr.concat((part.cluster_power, late.cluster_power)),
            dr.concat((part.position, late.position)),
            dr.concat((part.sigma, late.sigma)),
        )


def _is_edge(
    loaded: LoadedScene, bench: Bench, beamlets: Beamlets, spots: Spots, shot: Any, shots: int
) -> Any:
    """Tell which shots need more beamlets: their beamlets disagree, or leave the chief beamlet's tangent plane."""

    def beamlet(values: Any, number: int) -> Any:
        return dr.gather(type(values), values, shot + number * dr.opaque(mi.UInt32, shots))

    material = dr.gather(mi.UInt32, loaded.material_of, beamlet(spots.shape, 0))
    seen, position = beamlet(spots.seen, 0), beamlet(spots.position, 0)
    slope_a, slope_b = beamlet(spots.slope_a, 0), beamlet(spots.slope_b, 0)
    laser = bench.laser
    twist = (beamlet(spots.distance, 0) - dr.opaque(mi.Float, laser.waist_distance)) / dr.opaque(
        mi.Float, laser.rayleigh_length
    )
    cosine = dr.rsqrt(1.0 + dr.square(twist))
    sine = twist * cosine
    edge = mi.Bool(False)
    weakest = strongest = beamlet(spots.strength, 0)
    for number, (a, b) in enumerate(beamlets.nodes.tolist()):
        if number == 0:
            continue
        edge |= dr.gather(mi.UInt32, loaded.material_of, beamlet(spots.shape, number)) != material
        edge |= beamlet(spots.seen, number) != seen
        flat = position + slope_a * (a * cosine - b * sine) + slope_b * (a * sine + b * cosine)
        edge |= (seen == 1) & (dr.abs(beamlet(spots.position, number) - flat) > _BENT)
        strength = beamlet(spots.strength, number)
        weakest, strongest = dr.minimum(weakest, strength), dr.maximum(strongest, strength)
    return edge | (strongest - weakest > _UNEVEN * strongest)


def _cluster(spots: Spots | BounceSpots, shot: Any, index: Any, stride: int, count: int, clusters: int) -> Light:
    """Gather each shot's spots into clusters along the line.

    Parameters
    ----------
    spots
        Entry j · stride + index is spot j of a shot.
    shot, index
        Places of the m shots in the batch and in ``spots``, shape (m,).
    stride, count
        Layout of ``spots``.
    clusters
        Number of clusters c; each covers an equal part of the shot's extent.

    Returns
    -------
    Light
        Power, mean and variance of the spots in each cluster are kept exactly.
    """
    m = dr.width(index)
    step = dr.opaque(mi.UInt32, stride)
    low, high = dr.full(mi.Float, dr.inf, m), dr.full(mi.Float, -dr.inf, m)
    number = mi.UInt32(0)
    if clusters > 1:

        def extent(number: Any, low: Any, high: Any) -> tuple[Any, Any, Any]:
            place = index + number * step
            position = dr.gather(mi.Float, spots.position, place)
            lit = dr.gather(mi.Float, spots.power, place) > 0.0
            low = dr.select(lit, dr.minimum(low, position), low)
            high = dr.select(lit, dr.maximum(high, position), high)
            return number + 1, low, high

        number, low, high = dr.while_loop(
            (number, low, high), lambda number, low, high: number < count, extent
        )
    cluster_width = dr.maximum((high - low) / clusters, 1e-6)
    sums = [dr.alloc_local(mi.Float, clusters, mi.Float(0.0)) for _ in range(3)]

    def add(number: Any, *sums: Any) -> Any:
        place = index + number * step
        power = dr.gather(mi.Float, spots.power, place)
        position = dr.gather(mi.Float, spots.position, place)
        sigma = dr.gather(mi.Float, spots.sigma, place)
        slot = mi.UInt32(0)
        if clusters > 1:
            slot = mi.UInt32(dr.clip((position - low) / cluster_width, 0.0, clusters - 1.0))
        lit = power > 0.0
        for total, value in zip(
            sums, (power, power * position, power * (dr.square(position) + dr.square(sigma))), strict=True
        ):
            total.write(total.read(slot) + dr.select(lit, value, 0.0), slot)
        return (number + 1, *sums)

    _, *sums = dr.while_loop((mi.UInt32(0), *sums), lambda number, *sums: number < count, add)
    power, position, sigma = [dr.empty(mi.Float, clusters * m) for _ in range(3)]
    lane = dr.arange(mi.UInt32, m)
    for slot in range(clusters):
        total, first, second = (values.read(mi.UInt32(slot)) for values in sums)
        mean = first / total
        place = lane + slot * m
        dr.scatter(power, total, place)
        dr.scatter(position, dr.select(total > 0.0, mean, 0.0), place)
        dr.scatter(
            sigma, dr.select(total > 0.0, dr.sqrt(dr.maximum(second / total - dr.square(mean), 1e-4)), 1.0), place
        )
    dr.eval(power, position, sigma)
    return Light(shot, power, position, sigma)
