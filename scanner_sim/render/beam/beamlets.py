"""Beamlets: a Gaussian beam as a few narrower Gaussian ones.

On smooth surfaces the beam is carried over as a whole, and a few beamlets of no width probe what it meets. At edges
a Gaussian of unit variance per axis is split into beamlets of variance τ² about nodes of variance 1 − τ², which must
resolve the spot themselves: many of equal weight, evenly spread. Random samples would leave micrometres of noise in
the centroid.

While the mirrors sweep, each beamlet has its own moment in the dwell. The moments are spread evenly over it and have
the mean 0 and the variance 1/12 of a dwell, uncorrelated with position: the smeared spot of a smooth surface is then
exact in mean and variance without another ray.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_PLASTIC = 1.324717957244746
_TIME_STEP = 0.5544
"""Step of the times along the spiral: of 370 tried, the one that leaves swept spots of 64 and 256 beamlets most
even."""
_USUAL_SWEEP = 6.0
"""Sweep along Θ [standard deviations of the beam] for which beamlets are ordered: 1 mrad from 10 m on."""
_PROBE_REACH = 2.4
"""How far out beamlets probe what the beam meets [standard deviations of it]."""
_PROBE_STOP = 0.7
"""How far out in the aperture their light is looked for [radii of it]: half of the aperture lies within."""


@dataclass(frozen=True)
class Beamlets:
    """How a beam is split, and which point of the receiving aperture each beamlet is seen from.

    Attributes
    ----------
    nodes
        Shape (k, 2): positions across the beam, in standard deviations of the irradiance (w/2).
    weights
        Shape (k,): shares of the power; their sum is 1.
    variances
        Shape (k,): variance of each beamlet, in those of the beam.
    aperture
        Shape (k, 2): points in the unit disc of the aperture.
    times
        Shape (k,): moments in the dwell, in units of it, about its middle.
    """

    nodes: Array
    weights: Array
    variances: Array
    aperture: Array
    times: Array

    def __post_init__(self) -> None:
        """Protect the arrays: beamlets are computed once for all who ask for them."""
        for values in (self.nodes, self.weights, self.variances, self.aperture, self.times):
            values.setflags(write=False)


@lru_cache(maxsize=2)
def probe_beamlets(*, both_ends: bool = False) -> Beamlets:
    """Return the whole beam, on its axis, and six beamlets of no width about it that probe what else it meets.

    The means over all seven of places, times, their squares and products are those of the beam, and as opposite ones
    have opposite times, all third moments are 0: on a smooth surface the mean of any cubic of place and time is
    exact (Stroud, *Approximate calculation of multiple integrals*, 1971, ch. 3, on such rules). While the mirrors
    sweep, the six reach its ends and lie along both sides of it. With ``both_ends`` there are twelve, the same places
    at the opposite times too: however the beam moves, no side of its way lies outside of their hull.

    They are seen from three points of the aperture whose mean is its centre, opposite places from the same one and
    the same places at opposite times from opposite ones: places and moments share nothing with where they are seen
    from, so that light that is returned unequally over the aperture moves no spot. Near the waist points along the base
    share nothing with squares of places along it either: a lobe that bends over the lens then tells its mean slope.
    """
    places = np.tile([0.0, 60.0, 120.0], 2 if both_ends else 1)
    ends = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])[: len(places)]
    angle, end = np.deg2rad(np.concatenate([places, places + 180.0])), np.concatenate([ends, -ends])
    ring = _PROBE_REACH * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    # k of a weight ω: ½ k ω r² = 1 across the beam, and k ω t² = 1/12 along the dwell.
    weight = 2.0 / (len(ring) * _PROBE_REACH**2)
    times = end / math.sqrt(12.0 * len(ring) * weight)
    turns = np.deg2rad([90.0, 210.0, 330.0])
    stops = _PROBE_STOP * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    seen_from = [stops, -stops, stops, -stops] if both_ends else [stops, stops]
    return Beamlets(
        nodes=np.concatenate([np.zeros((1, 2)), ring]),
        weights=np.array([1.0 - len(ring) * weight, *[weight] * len(ring)]),
        variances=np.array([1.0, *[0.0] * len(ring)]),
        aperture=np.concatenate([np.zeros((1, 2)), *seen_from]),
        times=np.array([0.0, *times]),
    )


@lru_cache(maxsize=16)
def edge_beamlets(count: int) -> Beamlets:
    """Return beamlets for edges: equal weights on a sunflower spiral, with exact second moments.

    The spiral is Vogel's (*Mathematical Biosciences* 44, 1979) with the radii of a Gaussian; its points are
    sheared to the exact covariance.
    """
    index = np.arange(count)
    radius = np.sqrt(-2.0 * np.log1p(-(index + 0.5) / count))
    angle = 2.0 * np.pi * _GOLDEN * index
    nodes = whiten(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1))
    width = edge_width(count)
    order = _neighbours_first(nodes)
    scaled, weights = math.sqrt(1.0 - width**2) * nodes[order], np.full(count, 1.0 / count)
    even = np.asarray(((index + 0.5) * _TIME_STEP) % 1.0 - 0.5)[order]
    # The aperture's points are shared out over the beam at rest; rays are traced side by side as the sweep lays them.
    along = _neighbours_first(scaled + _USUAL_SWEEP * np.stack([even, np.zeros(count)], axis=1))
    times = _decorrelate(even, scaled, weights)
    variances = np.full(count, width**2)
    return Beamlets(scaled[along], weights, variances, aperture_spiral(count)[along], times[along])


def edge_width(count: int) -> float:
    """Return the standard deviation of each of ``count`` beamlets spread over the beam, in those of the beam."""
    return min(0.5, 2.0 / math.sqrt(count))


def _decorrelate(times: Array, nodes: Array, weights: Array) -> Array:
    """Return times, shape (k,), made free of what they share with nodes, of mean 0 and variance 1/12."""
    design = np.column_stack([np.ones(len(times)), nodes])
    root = np.sqrt(weights)
    share, *_ = np.linalg.lstsq(design * root[:, None], times * root, rcond=None)
    free = times - design @ share
    variance = float(weights @ free**2)
    # Too few beamlets leave no time that is independent of position: they all shine at the middle.
    return free / math.sqrt(12.0 * variance) if variance > 1e-6 else np.zeros(len(times))


def _neighbours_first(points: Array) -> NDArray[np.intp]:
    """Return an order of points, shape (k, 2), in which neighbours stand together: their rays trace faster."""
    if len(points) <= 2:
        return np.arange(len(points))
    axis = int(np.argmax(np.ptp(points, axis=0)))
    order = np.argsort(points[:, axis], kind="stable")
    halves = order[: len(order) // 2], order[len(order) // 2 :]
    return np.concatenate([half[_neighbours_first(points[half])] for half in halves])


def aperture_spiral(count: int) -> Array:
    """Return the points of Vogel's spiral over the unit disc, shape (count, 2), in an order unlike the beam's.

    Its mean and covariance are those of the disc. Neighbours in the beam get points all over the aperture: the order
    steps through the spiral by a number near the golden share of ``count`` that has no divisor in common with it.
    """
    stride = next(
        step for step in range(max(1, round(_GOLDEN * count)), 2 * count) if math.gcd(step, count) == 1
    )
    index = (np.arange(count) * stride) % count
    return _even_disc((index + 0.5) / count, _GOLDEN * index)


def aperture_lattice(count: int) -> Array:
    """Return points of the unit disc, shape (count, 2), that share nothing with multiples of the golden section.

    Their squared radii and directions are the R2 sequence (generalised golden ratio); mean and covariance are those of
    the disc.
    """
    index = np.arange(count) + 0.5
    return _even_disc(index / _PLASTIC % 1.0, index / _PLASTIC**2)


def _even_disc(squared: NDArray[np.floating], turns: NDArray[np.floating]) -> Array:
    """Return points of squared radii and directions, moved a little to the mean and covariance of the disc."""
    radius, angle = np.sqrt(squared), 2.0 * np.pi * turns
    return 0.5 * whiten(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1))


def whiten(points: Array) -> Array:
    """Return points, shape (k, 2), shifted and sheared to mean 0 and unit covariance."""
    centred = points - points.mean(axis=0)
    return np.asarray(centred @ np.linalg.inv(np.linalg.cholesky(centred.T @ centred / len(points))).T)
