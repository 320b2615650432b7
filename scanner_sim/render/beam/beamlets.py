"""Beamlets: a Gaussian beam as a few narrower Gaussian ones.

A Gaussian of unit variance per axis is split into beamlets of variance τ² about nodes of variance 1 − τ². On
smooth surfaces few nodes do, if their moments are those of the Gaussian: the beam's image is then exact up to
the surface's curvature within a beamlet. At edges the nodes themselves must resolve the spot: many of equal
weight, evenly spread. Random samples would leave micrometres of noise in the centroid.

While the mirrors sweep, each beamlet has its own moment in the dwell. The moments are spread evenly over it and have
the mean 0 and the variance 1/12 of a dwell, uncorrelated with position: the smeared spot of a smooth surface is then
exact in mean and variance without another ray.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_TIME_STEP = 0.5544
"""Step of the times along the spiral: of 370 tried, the one that leaves swept spots of 64 and 256 beamlets most
even."""
_USUAL_SWEEP = 6.0
"""Sweep along Θ [standard deviations of the beam] for which beamlets are ordered: 1 mrad from 10 m on."""
_HEXAGONAL_RINGS: dict[int, tuple[float, tuple[tuple[float, float], ...]]] = {
    7: (2.0, ((0.0, 0.0), (1.0, 0.0))),
    19: (1.5, ((0.0, 0.0), (1.0, 0.0), (3.0, 30.0), (4.0, 0.0))),
    37: (1.3, ((0.0, 0.0), (1.0, 0.0), (3.0, 30.0), (4.0, 0.0), (7.0, 19.1066), (7.0, 40.8934), (9.0, 0.0))),
}
"""Spacing in standard deviations of the nodes, and (squared radius in spacings, direction [deg]) of each ring."""
_HALF_RING_TIMES: dict[int, tuple[tuple[float, float, float], ...]] = {
    7: ((-0.4082, 0.4082, -0.4082),),
    19: ((-0.3415, 0.3330, -0.3373), (0.0236, 0.5000, 0.4780), (0.5000, -0.4581, 0.1342)),
    37: (
        (-0.3617, 0.3508, -0.3548),
        (0.0275, 0.0082, -0.0433),
        (0.2389, -0.2508, 0.2788),
        (0.1815, 0.4587, 0.0973),
        (-0.1247, -0.3015, 0.5000),
        (0.5000, -0.4791, 0.1623),
    ),
}
"""Moments in the dwell of the first three beamlets of each ring; the other three have the opposite ones.

Found by minimising, at exact second moments and within ±1/2, the fourth moments' errors, the unevenness of the
times, and the light beyond the outermost beamlet in the direction of the sweep, where an edge would go unnoticed:
below 0.3 % along Θ for sweeps of any length, 3 % in the worst direction. Seven beamlets leave no choice but the
signs of cos 3θ.
"""


@dataclass(frozen=True)
class Beamlets:
    """How a beam is split, and which point of the receiving aperture each beamlet is seen from.

    Attributes
    ----------
    nodes
        Shape (k, 2): positions across the beam, in standard deviations of the irradiance (w/2).
    weights
        Shape (k,): shares of the power; their sum is 1.
    width
        Standard deviation τ of each beamlet, in the same unit: node and beamlet variances add up to 1.
    aperture
        Shape (k, 2): points in the unit disc of the aperture.
    times
        Shape (k,): moments in the dwell, in units of it, about its middle.
    """

    nodes: Array
    weights: Array
    width: float
    aperture: Array
    times: Array

    def __post_init__(self) -> None:
        """Protect the arrays: beamlets are computed once for all who ask for them."""
        for values in (self.nodes, self.weights, self.aperture, self.times):
            values.setflags(write=False)


@lru_cache(maxsize=16)
def smooth_beamlets(count: Literal[7, 19, 37]) -> Beamlets:
    """Return beamlets for smooth surfaces: hexagonal rings with the moments of a Gaussian.

    The ring weights solve for the moments E[r²ʲ] = 2ʲ j! s²ʲ, as many as there are rings; the sixfold
    symmetry makes all others exact up to the fifth order. (Stroud, *Approximate calculation of multiple
    integrals*, 1971, ch. 3, on such rules.)

    Opposite beamlets have opposite times, so that all moments of odd order of times and positions together are 0, as
    they are in the beam; what the remaining times have in common with the positions is taken off them.
    """
    spacing, rings = _HEXAGONAL_RINGS[count]
    squared = np.array([ring[0] for ring in rings])
    radii = sorted(set(squared))
    members = np.array([6.0 * (squared == radius).sum() if radius else 1.0 for radius in radii])
    powers = np.arange(len(radii))
    moments = np.array([2.0**j * math.factorial(j) for j in powers])
    powered = (np.array(radii) * spacing**2)[None, :] ** powers[:, None]
    shares = np.linalg.solve(members * powered, moments)
    nodes, weights = [np.zeros((1, 2))], [shares[:1]]
    for radius, direction in rings[1:]:
        angles = np.deg2rad(direction + 60.0 * np.arange(6))
        nodes.append(spacing * math.sqrt(radius) * np.stack([np.cos(angles), np.sin(angles)], axis=1))
        weights.append(np.full(6, shares[radii.index(radius)]))
    width = 0.5 * spacing / math.hypot(1.0, 0.5 * spacing)
    scaled = math.sqrt(1.0 - width**2) * np.concatenate(nodes)
    shares = np.concatenate(weights)
    return Beamlets(scaled, shares, width, _disc_points(count), _opposite_times(scaled, shares))


@lru_cache(maxsize=16)
def edge_beamlets(count: int) -> Beamlets:
    """Return beamlets for edges: equal weights on a sunflower spiral, with exact second moments.

    The spiral is Vogel's (*Mathematical Biosciences* 44, 1979) with the radii of a Gaussian; its points are
    sheared to the exact covariance.
    """
    index = np.arange(count)
    radius = np.sqrt(-2.0 * np.log1p(-(index + 0.5) / count))
    angle = 2.0 * np.pi * _GOLDEN * index
    nodes = _whiten(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1))
    width = edge_width(count)
    order = _neighbours_first(nodes)
    scaled, weights = math.sqrt(1.0 - width**2) * nodes[order], np.full(count, 1.0 / count)
    even = np.asarray(((index + 0.5) * _TIME_STEP) % 1.0 - 0.5)[order]
    # The aperture's points are shared out over the beam at rest; rays are traced side by side as the sweep lays them.
    along = _neighbours_first(scaled + _USUAL_SWEEP * np.stack([even, np.zeros(count)], axis=1))
    times = _decorrelate(even, scaled, weights)
    return Beamlets(scaled[along], weights, width, aperture_spiral(count)[along], times[along])


def edge_width(count: int) -> float:
    """Return the standard deviation of each of ``count`` beamlets spread over the beam, in those of the beam."""
    return min(0.5, 2.0 / math.sqrt(count))


def _opposite_times(nodes: Array, weights: Array) -> Array:
    """Return times of nodes on rings of six: the second half of each ring is opposite to the first in both."""
    times = np.zeros(len(nodes))
    half = np.array(_HALF_RING_TIMES[len(nodes)])
    times[1:] = np.concatenate([half, -half], axis=1).ravel()
    return _decorrelate(times, nodes, weights)


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
    radius, angle = np.sqrt((index + 0.5) / count), 2.0 * np.pi * _GOLDEN * index
    return 0.5 * _whiten(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1))


def _whiten(points: Array) -> Array:
    """Return points, shape (k, 2), shifted and sheared to mean 0 and unit covariance."""
    centred = points - points.mean(axis=0)
    return np.asarray(centred @ np.linalg.inv(np.linalg.cholesky(centred.T @ centred / len(points))).T)


def _disc_points(count: int) -> Array:
    """Return evenly spread points of the unit disc, shape (count, 2), in an order unlike the beam's.

    The first is the centre; the others follow the R2 sequence (generalised golden ratio), mirrored in pairs so
    that their mean is the centre.
    """
    plastic = 1.324717957244746
    index = np.repeat(np.arange(1, count // 2 + 1), 2)
    sign = np.tile([1.0, -1.0], count // 2)
    radius = np.sqrt((0.5 + index / plastic) % 1.0) * sign
    angle = 2.0 * np.pi * ((0.5 + index / plastic**2) % 1.0)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return np.concatenate([np.zeros((1, 2)), points])[:count]
