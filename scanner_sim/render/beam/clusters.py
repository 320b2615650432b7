"""Clusters: many spots of light on the line gathered into a few Gaussians, and those integrated over pixels."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import drjit as dr
import mitsuba as mi

from scanner_sim.foundation.device_types import Float, Local, UInt32

_CLUSTER_SIGMAS = 6.0
"""Standard deviations (times √2) to which a cluster's light is followed: the rest is below float32."""
_LEAST_VARIANCE = 1e-4
"""Floor of a cluster's variance [pixel²]: rounding cannot make it negative."""


class SpotsOfLight(Protocol):
    """Spots on the line: power [W], position and standard deviation [pixel], Dr.Jit arrays."""

    power: Float
    position: Float
    sigma: Float


@runtime_checkable
class CoherentSpots(SpotsOfLight, Protocol):
    """Spots of coherent light; ``coherence`` is the squared contrast of their speckle."""

    coherence: Float


@dataclass
class Clusters:
    """Gaussian clusters of light of m shots, Dr.Jit arrays of shape (c · m,): k · m + j is cluster k of shot j.

    ``amount`` [W], ``position`` and ``sigma`` [pixel] along the line, ``coherence`` squared contrast of the speckle.
    """

    amount: Float
    position: Float
    sigma: Float
    coherence: Float
    shots: int
    _found_ends: tuple[Float, Float] | None = field(default=None, init=False, repr=False, compare=False)

    @property
    def count(self) -> int:
        """Number c of clusters of each shot."""
        return int(dr.width(self.position)) // self.shots

    def part(self, indices: UInt32) -> Clusters:
        """Return the clusters of some shots only, by their indices."""
        some = dr.width(indices)
        lane = dr.arange(mi.UInt32, self.count * some)
        at = (lane // some) * self.shots + dr.gather(mi.UInt32, indices, lane % some)
        amount, position, sigma, coherence = (dr.gather(mi.Float, values, at) for values in self._arrays())
        dr.eval(amount, position, sigma, coherence)
        return Clusters(amount, position, sigma, coherence, some)

    def join(self, other: Clusters) -> Clusters:
        """Return the clusters of both, which must be of the same shots."""
        amount, position, sigma, coherence = (
            dr.concat(pair) for pair in zip(self._arrays(), other._arrays(), strict=True)
        )
        return Clusters(amount, position, sigma, coherence, self.shots)

    def _arrays(self) -> tuple[Float, Float, Float, Float]:
        return self.amount, self.position, self.sigma, self.coherence

    def power(self, pixel: UInt32, index: UInt32) -> Float:
        """Return the power [W] on pixels of shots by their indices: each cluster integrated in closed form.

        Parameters
        ----------
        pixel, index
            Dr.Jit unsigned arrays of one shape.
        """
        centre = mi.Float(pixel)

        def share(number: UInt32) -> Float:
            at = index + number * dr.opaque(mi.UInt32, self.shots)
            middle, width = dr.gather(mi.Float, self.position, at), dr.gather(mi.Float, self.sigma, at)
            scale = math.sqrt(0.5) / width
            left, right = (centre - 0.5 - middle) * scale, (centre + 0.5 - middle) * scale
            amount = dr.gather(mi.Float, self.amount, at)
            near = (amount > 0.0) & (dr.minimum(dr.abs(left), dr.abs(right)) < _CLUSTER_SIGMAS)
            return dr.select(near, 0.5 * amount * (dr.erf(right) - dr.erf(left)), 0.0)

        count = self.count
        low, high = (dr.gather(mi.Float, end, index) for end in self._ends())
        near = (centre > low) & (centre < high)
        return dr.while_loop(
            (mi.UInt32(0), dr.zeros(mi.Float, dr.width(index))),
            lambda number, total: near & (number < count),
            lambda number, total: (number + 1, total + share(number)),
        )[1]

    def _ends(self) -> tuple[Float, Float]:
        """Return the pixels between which each shot's light lies, shape (m,)."""
        if self._found_ends is None:
            shot = dr.arange(mi.UInt32, self.shots)
            low, high = dr.full(mi.Float, dr.inf, self.shots), dr.full(mi.Float, -dr.inf, self.shots)
            for number in range(self.count):
                at = shot + number * self.shots
                lit = dr.gather(mi.Float, self.amount, at) > 0.0
                middle = dr.gather(mi.Float, self.position, at)
                reach = _CLUSTER_SIGMAS * math.sqrt(2.0) * dr.gather(mi.Float, self.sigma, at) + 0.5
                low = dr.select(lit, dr.minimum(low, middle - reach), low)
                high = dr.select(lit, dr.maximum(high, middle + reach), high)
            dr.eval(low, high)
            self._found_ends = low, high
        return self._found_ends


def cluster(spots: SpotsOfLight, shot: UInt32, count: int, clusters: int) -> Clusters:
    """Gather each shot's spots into clusters along the line.

    Parameters
    ----------
    spots
        Entry i · count + j is spot j of shot i.
    shot
        The m shots that are wanted, shape (m,).
    count
        Spots of each shot.
    clusters
        Number of clusters c; each covers an equal part of the shot's extent.

    Returns
    -------
    Clusters
        Power, mean and variance of the spots in each cluster are kept exactly, and the mean coherence, which is 0 for
        light that is not coherent.
    """
    m, first_spot = dr.width(shot), shot * count

    def spot(number: UInt32) -> tuple[Float, Float, Float]:
        index = first_spot + number
        return (
            dr.gather(mi.Float, spots.power, index),
            dr.gather(mi.Float, spots.position, index),
            dr.gather(mi.Float, spots.sigma, index),
        )

    def contrast(number: UInt32) -> Float:
        if not isinstance(spots, CoherentSpots):
            return mi.Float(0.0)
        return dr.gather(mi.Float, spots.coherence, first_spot + number)

    origin, extent = lit_extent(spot, m, count) if clusters > 1 else (spot(0)[1], mi.Float(0.0))
    width = dr.maximum(extent / clusters, 1e-6)
    totals = [dr.alloc_local(mi.Float, clusters, mi.Float(0.0)) for _ in range(4)]

    def add(number: UInt32, power: Local, first: Local, second: Local, coherence: Local) -> tuple[Any, ...]:
        amount, position, sigma = spot(number)
        slot = mi.UInt32(dr.clip((position - origin) / width, 0.0, clusters - 1.0))
        lit = amount > 0.0
        # Moments about a point in the cluster: about pixel 0 the variance would drown in rounding.
        apart = position - (origin + mi.Float(slot) * width)
        for total, value in (
            (power, amount),
            (first, amount * apart),
            (second, amount * (dr.square(apart) + dr.square(sigma))),
            (coherence, amount * contrast(number)),
        ):
            total.write(total.read(slot) + dr.select(lit, value, 0.0), slot)
        return number + 1, power, first, second, coherence

    sums: Any = dr.while_loop((mi.UInt32(0), *totals), lambda number, *sums: number < count, add)
    _, power, first, second, contrasts = sums
    amounts, positions, sigmas = [], [], []
    coherence: list[Float] = []
    for slot in range(clusters):
        total = power.read(mi.UInt32(slot))
        lit = total > 0.0
        mean = dr.select(lit, first.read(mi.UInt32(slot)) / total, 0.0)
        variance = dr.select(lit, second.read(mi.UInt32(slot)) / total - dr.square(mean), 1.0)
        amounts.append(total)
        positions.append(origin + slot * width + mean)
        sigmas.append(dr.sqrt(dr.maximum(variance, _LEAST_VARIANCE)))
        coherence.append(dr.select(lit, contrasts.read(mi.UInt32(slot)) / total, 0.0))
    dr.eval(amounts, positions, sigmas, coherence)
    return Clusters(dr.concat(amounts), dr.concat(positions), dr.concat(sigmas), dr.concat(coherence), m)


def lit_extent(
    spot: Callable[[UInt32], tuple[Float, Float, Float]], shots: int, count: int
) -> tuple[Float, Float]:
    """Return the lowest position of each shot's lit spots and the length that they cover; 0 where nothing is lit.

    ``spot`` gives power, position and spread of the spot of a number, one of ``count``, for every shot.
    """

    def widen(number: UInt32, low: Float, high: Float) -> tuple[UInt32, Float, Float]:
        amount, position, _ = spot(number)
        lit = amount > 0.0
        low = dr.select(lit, dr.minimum(low, position), low)
        high = dr.select(lit, dr.maximum(high, position), high)
        return number + 1, low, high

    start = (mi.UInt32(0), dr.full(mi.Float, dr.inf, shots), dr.full(mi.Float, -dr.inf, shots))
    _, low, high = dr.while_loop(start, lambda number, low, high: number < count, widen)
    dark = low > high
    return dr.select(dark, 0.0, low), dr.select(dark, 0.0, high - low)
