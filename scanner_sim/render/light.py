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

from scanner_sim.render.beamlets import Beamlets, edge_beamlets, smooth_beamlets
from scanner_sim.render.settings import Transport
from scanner_sim.render.transport import Bench, Spots, trace_spots
from scanner_sim.scene.loader import LoadedScene

_CLUSTERS = 16
"""Clusters that a shot on an edge keeps."""
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


@dataclass
class Truth:
    """What the chief ray of each shot meets; estimators do not see it. Dr.Jit arrays, shape (n,).

    ``distance`` along the beam [m] (NaN for nothing), ``object`` and ``material`` numbers (0 for nothing).
    """

    distance: Any
    object: Any
    material: Any


def render_light(
    loaded: LoadedScene, bench: Bench, settings: Transport, theta: Any, phi: Any
) -> tuple[Truth, Iterator[Light]]:
    """Follow the laser's light of a batch of shots onto the line.

    Parameters
    ----------
    loaded, bench, settings
        Scene, optics and how finely the beam is split.
    theta, phi
        True deflections [rad], shape (n,), Dr.Jit.

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
            yield _cluster(spots, smooth, smooth, shots, len(beamlets.weights), 1)
        rough = dr.compress(edge)
        if dr.width(rough):
            fine = edge_beamlets(settings.edge_beamlets)
            many = trace_spots(
                loaded, bench, fine, dr.gather(mi.Float, theta, rough), dr.gather(mi.Float, phi, rough)
            )
            dr.eval(many)
            count = dr.width(rough)
            yield _cluster(many, rough, dr.arange(mi.UInt32, count), count, len(fine.weights), _CLUSTERS)

    return truth, groups()


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


def _cluster(spots: Spots, shot: Any, index: Any, stride: int, count: int, clusters: int) -> Light:
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
