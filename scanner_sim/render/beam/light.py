"""Light of shots, gathered into a few Gaussian clusters each with exact power, mean and variance; and what it hits."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_loops import for_each
from scanner_sim.foundation.device_types import Float, UInt32
from scanner_sim.render.beam.projection import Resolution, Spots
from scanner_sim.scene.files.loader import LoadedScene

_CLUSTER_SIGMAS = 4.0
"""Standard deviations (times √2) to which a cluster's light is followed: beyond 3.92 the error function of single
precision is 1."""
_LEAST_WIDTH = 1e-6
"""Least width of a cluster, in the unit of its projection."""


@dataclass
class Light:
    """The laser's light of m shots in c Gaussian clusters each, Dr.Jit arrays.

    Attributes
    ----------
    index, shot
        Index of each shot in its batch, and its number, shape (m,).
    amount, position, sigma
        Of the clusters, shape (c · m,): k · m + j is cluster k of shot j. On the line power [W], position and standard
        deviation [pixel]; of a pulse the share of its power that reaches the photodiode, the path there and back
        and its standard deviation [m].
    coherence
        Squared contrast of the clusters' speckle; None where the surface that the chief ray meets tells it.
    reference
        What the positions of each shot are counted from, shape (m,); None for 0.
    """

    index: UInt32
    shot: UInt32
    amount: Float
    position: Float
    sigma: Float
    coherence: Float | None = None
    reference: Float | None = None
    _found_extent: tuple[Float, Float, Float] | None = field(
        default=None, init=False, repr=False, compare=False
    )

    @property
    def shots(self) -> int:
        """Number m of shots."""
        return int(dr.width(self.index))

    @property
    def count(self) -> int:
        """Number c of clusters of each shot."""
        return int(dr.width(self.amount)) // self.shots

    def part(self, indices: UInt32) -> Light:
        """Return the light of some shots only, by their indices."""
        some = dr.width(indices)
        # As an array and not as numbers: the kernel is that of any number of shots.
        lane, step = dr.arange(mi.UInt32, self.count * some), dr.opaque(mi.UInt32, some)
        at = (lane // step) * dr.opaque(mi.UInt32, self.shots) + dr.gather(mi.UInt32, indices, lane % step)
        amount, position, sigma, coherence = (
            None if values is None else dr.gather(mi.Float, values, at) for values in self.clusters
        )
        reference = None if self.reference is None else dr.gather(mi.Float, self.reference, indices)
        index, shot = (dr.gather(mi.UInt32, values, indices) for values in (self.index, self.shot))
        part = Light(index, shot, amount, position, sigma, coherence, reference)
        dr.eval(part)
        return part

    @classmethod
    def of_all(cls, parts: Sequence[Light]) -> Light:
        """Return the light of the shots of all parts, which have as many clusters each."""
        if len(parts) == 1:
            return parts[0]
        shots, count = sum(part.shots for part in parts), parts[0].count

        def joined(name: str, rows: int) -> Any:
            columns = [getattr(part, name) for part in parts]
            return None if columns[0] is None else dr.empty(type(columns[0]), rows * shots)

        one, each = ("index", "shot", "reference"), ("amount", "position", "sigma", "coherence")
        whole = cls(**{name: joined(name, 1) for name in one}, **{name: joined(name, count) for name in each})
        start, step = 0, dr.opaque(mi.UInt32, shots)
        for part in parts:
            own, first = dr.opaque(mi.UInt32, part.shots), dr.opaque(mi.UInt32, start)
            lane = dr.arange(mi.UInt32, count * part.shots)
            places = {
                1: first + dr.arange(mi.UInt32, part.shots),
                count: (lane // own) * step + first + lane % own,
            }
            for names, rows in ((one, 1), (each, count)):
                for name in names:
                    if getattr(part, name) is not None:
                        values, at = getattr(part, name), places[rows]
                        dr.scatter(getattr(whole, name), values, at, mode=dr.ReduceMode.Permute)
            start += part.shots
        dr.eval(whole)
        return whole

    def join(self, other: Light) -> Light:
        """Return the light of both, which must be of the same shots and references."""
        amount, position, sigma, coherence = (
            None if one is None else _joined(one, two)
            for one, two in zip(self.clusters, other.clusters, strict=True)
        )
        return Light(self.index, self.shot, amount, position, sigma, coherence, self.reference)

    @property
    def clusters(self) -> tuple[Float, Float, Float, Float | None]:
        """Amount, position, standard deviation and coherence of the clusters."""
        return self.amount, self.position, self.sigma, self.coherence

    def pair(self, pixel: UInt32, index: UInt32) -> tuple[Float, Float]:
        """Return the power [W] on pixels and on the next ones of shots: each cluster in closed form.

        Parameters
        ----------
        pixel, index
            Pixels, and indices of the shots, 0 to m − 1; Dr.Jit unsigned arrays of one shape.
        """
        middle, count, shots = mi.Float(pixel) + 0.5, self.count, dr.opaque(mi.UInt32, self.shots)

        def add(number: UInt32, *total: Float) -> tuple[Any, ...]:
            at = index + number * shots
            amount, position = dr.gather(mi.Float, self.amount, at), dr.gather(mi.Float, self.position, at)
            scale = math.sqrt(0.5) / dr.gather(mi.Float, self.sigma, at)
            below, between, above = (dr.erf((middle + step - position) * scale) for step in (-1.0, 0.0, 1.0))
            half = dr.select(amount > 0.0, 0.5 * amount, 0.0)
            return number + 1, total[0] + half * (between - below), total[1] + half * (above - between)

        low, high = (dr.gather(mi.Float, end, index) for end in self.extent()[:2])
        near = (middle > low - 0.5) & (middle < high + 0.5)
        nothing = dr.zeros(mi.Float, dr.width(index))
        start: Any = (mi.UInt32(0), nothing, nothing)
        found: Any = dr.while_loop(start, lambda number, *total: near & (number < count), add)
        return found[1], found[2]

    def power(self, pixel: UInt32, index: UInt32) -> Float:
        """Return the power [W] on pixels of shots (arguments of :meth:`pair`)."""
        return self.pair(pixel, index)[0]

    def line(self, index: int, pixels: int) -> NDArray[np.float64]:
        """Return the power [W] on every pixel of the shot with an index, shape (pixels,)."""
        pixel = dr.arange(mi.UInt32, pixels)
        power = self.power(pixel, dr.opaque(mi.UInt32, index, pixels)).numpy()
        return np.asarray(power, dtype=np.float64)

    def extent(self) -> tuple[Float, Float, Float]:
        """Return the pixels between which each shot's light lies, ∞ and −∞ where none is, and its power, shape (m,)."""
        if self._found_extent is None:
            shot, shots = dr.arange(mi.UInt32, self.shots), dr.opaque(mi.UInt32, self.shots)
            low, high = dr.full(mi.Float, dr.inf, self.shots), dr.full(mi.Float, -dr.inf, self.shots)
            power = dr.zeros(mi.Float, self.shots)
            for number in range(self.count):
                at = shot + number * shots
                amount = dr.gather(mi.Float, self.amount, at)
                lit = amount > 0.0
                middle = dr.gather(mi.Float, self.position, at)
                reach = _CLUSTER_SIGMAS * math.sqrt(2.0) * dr.gather(mi.Float, self.sigma, at) + 0.5
                low = dr.select(lit, dr.minimum(low, middle - reach), low)
                high = dr.select(lit, dr.maximum(high, middle + reach), high)
                power += amount
            dr.eval(low, high, power)
            self._found_extent = low, high, power
        return self._found_extent


@dataclass
class Truth:
    """What the chief ray of each shot meets; estimators do not see it. Dr.Jit arrays, shape (n,).

    ``distance`` along the beam [m] (NaN for nothing), ``object`` and ``material`` numbers (0 for nothing).
    """

    distance: Float
    object: UInt32
    material: UInt32

    @classmethod
    def of(cls, loaded: LoadedScene, distance: Float, shape: UInt32, chief: UInt32) -> Truth:
        """Return what the chief rays meet, whose distance [m] and shape's index stand at the indices ``chief``."""
        met = dr.gather(mi.UInt32, shape, chief)
        return cls(
            dr.gather(mi.Float, distance, chief),
            dr.gather(mi.UInt32, loaded.object_of, met),
            dr.gather(mi.UInt32, loaded.material_of, met),
        )

    def take(self, index: UInt32) -> Truth:
        """Return what the chief rays of some shots meet, by their indices."""
        return Truth(
            dr.gather(mi.Float, self.distance, index),
            dr.gather(mi.UInt32, self.object, index),
            dr.gather(mi.UInt32, self.material, index),
        )


def cluster(
    spots: Spots, shot: UInt32, count: int, clusters: int, resolution: Resolution
) -> tuple[Float, Float, Float, Float | None]:
    """Gather each shot's spots into clusters along their coordinate.

    Parameters
    ----------
    spots
        Entry i · count + j is spot j of shot i.
    shot
        Indices of the m shots that are wanted, shape (m,).
    count
        Spots of each shot.
    clusters
        Number of clusters c; each covers an equal part of the extent of the shot's lit spots.
    resolution
        How clusters are kept.

    Returns
    -------
    tuple
        Amount, position, standard deviation and coherence of the clusters, as in :class:`Light`. Power, mean and
        variance of the spots in each are kept exactly, and the mean coherence if there is one.
    """
    m, first_spot, about = dr.width(shot), shot * count, resolution.moments_about

    def spot(number: UInt32) -> tuple[Float, Float, Float]:
        at = first_spot + number
        power, position, sigma = (
            dr.gather(mi.Float, values, at) for values in (spots.power, spots.position, spots.sigma)
        )
        return power, position, sigma

    origin, extent = _lit_extent(spot, m, count)
    width = dr.maximum(extent / clusters, _LEAST_WIDTH)
    coherent = spots.coherence is not None
    sums = [dr.alloc_local(mi.Float, clusters, mi.Float(0.0)) for _ in range(4 if coherent else 3)]

    def add(number: UInt32, *sums: Any) -> tuple[Any, ...]:
        power, position, sigma = spot(number)
        slot = mi.UInt32(dr.clip((position - origin) / width, 0.0, clusters - 1.0))
        # Moments about a point in the cluster: about 0 the variance would drown in rounding.
        apart = position - (origin + (mi.Float(slot) + about) * width)
        values = [power, power * apart, power * (dr.square(apart) + dr.square(sigma))]
        if coherent:
            values.append(power * dr.gather(mi.Float, spots.coherence, first_spot + number))
        for total, value in zip(sums, values, strict=True):
            total.write(total.read(slot) + dr.select(power > 0.0, value, 0.0), slot)
        return sums

    sums = list(for_each(count, add, *sums))
    columns = [dr.empty(mi.Float, clusters * m) for _ in range(4 if coherent else 3)]
    index, shots = dr.arange(mi.UInt32, m), dr.opaque(mi.UInt32, m)
    for slot in range(clusters):
        total, *moments = (values.read(mi.UInt32(slot)) for values in sums)
        mean, square, *contrast = (dr.select(total > 0.0, moment / total, 0.0) for moment in moments)
        variance = dr.maximum(square - dr.square(mean), resolution.least_variance)
        kept = (total, origin + (slot + about) * width + mean, dr.sqrt(variance), *contrast)
        for column, values in zip(columns, kept, strict=True):
            dr.scatter(column, values, index + slot * shots, mode=dr.ReduceMode.Permute)
    dr.eval(columns)
    amount, position, sigma, *contrast = columns
    return amount, position, sigma, contrast[0] if coherent else None


def _joined(one: Float, two: Float) -> Float:
    """Return one array and behind it another; ``dr.concat`` would compile a kernel for each size."""
    first, second = dr.width(one), dr.width(two)
    both = dr.empty(mi.Float, first + second)
    dr.scatter(both, one, dr.arange(mi.UInt32, first), mode=dr.ReduceMode.Permute)
    at = dr.arange(mi.UInt32, second) + dr.opaque(mi.UInt32, first)
    dr.scatter(both, two, at, mode=dr.ReduceMode.Permute)
    return both


def _lit_extent(
    spot: Callable[[UInt32], tuple[Float, Float, Float]], shots: int, count: int
) -> tuple[Float, Float]:
    """Return the lowest position of each shot's lit spots and the length that they cover; 0 where nothing is lit.

    ``spot`` gives power, position and spread of the spot of a number, one of ``count``, for every shot.
    """

    def widen(number: UInt32, low: Float, high: Float) -> tuple[Float, Float]:
        amount, position, _ = spot(number)
        lit = amount > 0.0
        low = dr.select(lit, dr.minimum(low, position), low)
        high = dr.select(lit, dr.maximum(high, position), high)
        return low, high

    low, high = for_each(count, widen, dr.full(mi.Float, dr.inf, shots), dr.full(mi.Float, -dr.inf, shots))
    dark = low > high
    return dr.select(dark, 0.0, low), dr.select(dark, 0.0, high - low)
