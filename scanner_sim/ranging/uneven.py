"""Uneven spots: what light that is not spread evenly over the spot may do to a range, and which spots are mixed.

A Gaussian spot of standard deviation s = w/2 measures where its *light* is, not where its axis is. Light L that
changes across the spot moves its centroid sideways by ā = s² ∂ln L/∂x (Stein's lemma), which the triangulation takes
for a range: δR = (R/d) ā along the base. Surfaces that bend or step within the spot move the mean depth of the light,
by time of flight too. Both are systematic, and the instrument cannot tell them from range in one line: but its
neighbours in the raster show the changes, and how large they are is stated as a standard deviation. It comes from
signals, ranges and angles alone.

(Baribeau, Rioux, *Appl. Opt.* 30, 1991, and Curless, Levoy, *ICCV* 1995, on such errors at edges of reflectance and of
shape.)
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from scanner_sim.foundation.arithmetic import exp, log
from scanner_sim.ranging.neighbours import Chosen, Stencil, grown, neighbour_values, weighted_sum
from scanner_sim.ranging.shared_noise import SharedNoise

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST_STEPS = 8
"""Farthest neighbour that is looked at, in voxels: rasters finer than a seventh of the spot see no farther."""
REACH = 2.5
"""Standard deviations of the spot from its axis within which an edge sends a noticeable share of light, 0.6 %."""
_LEAST_STENCIL = 2.0
"""Least distance, in standard deviations of the spot, over which bends are looked for: on finer rasters noise hides
them from direct neighbours."""
_LARGEST_SHIFT = 0.8
"""Largest shift of the light, in standard deviations of the spot: that of half a spot, √(2/π)."""
_UNRESOLVED = 1.25
"""Pitch, in standard deviations of the spot, from which voxels at rest do not resolve an edge."""
_UNRESOLVED_CONTRAST = 0.6
"""Share of the contrast to its neighbours that an unresolved line within one spot is taken to have unevenly."""
_BEND_SHIFT = 0.3
"""Shift of the mean depth, root mean square over where a crease may lie, for a second difference of ranges Δ² at a
pitch of δ: 0.3 s Δ²/δ. From 1.5 to 6 s it is 0.45 to 0.17 for mirrors at rest, 0.49 to 0.28 for a sweep."""
_STEP_SHIFT = 0.4
"""The same for a step, over the difference of second differences: 0.43 to 0.11, and 0.50 to 0.20."""
_AXES = ((0, 1), (1, 0))
"""Steps down and right along a row and along a column."""
_RIM_VOXELS = 2
"""Voxels over which the rim takes the differences of others."""
_BENDING = ((-1, 1.0), (0, -2.0), (1, 1.0))
_RISING = ((-2, -1.0), (-1, 2.0), (1, -2.0), (2, 1.0))
"""Weights of neighbours in a second difference, and in the difference of two."""
_WIDENED_REACH = 1.0
"""Standard deviations of the spot within which what is found counts too: just on an edge differences pass zero."""
_TEXTURE_NOISE = (6.0, 1.0)
"""Square of a texture's difference, over its variance, that counts as noise: anywhere, and where surfaces are known
to bend or to end (:func:`is_rugged`). There noise is taken off once, which is right on the average."""
_LINE_NOISE = 4.0
"""The same of a signal that is above or below both of its neighbours', anywhere."""
_BEND_NOISE = (4.0, 1.0)
"""The same of a second difference of ranges; anywhere the largest of many has to exceed more (:func:`_of_many`)."""
_STEP_NOISE = (8.0, 2.0)
"""The same of a difference of second differences, which has more noise."""
_CERTAIN = 25.0
"""The same that noise does not make: five standard deviations."""
_RUGGED_REACH = 3.0
"""Standard deviations of the spot about such a position within which surfaces are taken to be uneven."""
_LONE_PITCH = 1e3
"""Pitch of a raster of one column or row [rad]."""


@dataclass(frozen=True)
class Raster:
    """The raster's geometry at every voxel, arrays of shape (rows, columns), m.

    ``across`` and ``down`` distances of neighbours; ``spot`` standard deviation s of the beam's irradiance; ``travel``
    way of the beam along the row while it is measured.
    """

    across: Array
    down: Array
    spot: Array
    travel: Array

    @classmethod
    def of(cls, range_m: Array, pitch: tuple[float, float], spot: Array, travel: float) -> Raster:
        """Return the geometry of voxels at some ranges.

        Parameters
        ----------
        range_m, spot
            Ranges and the beam's s there [m], shape (rows, columns).
        pitch
            Angles between columns and between rows [rad].
        travel
            Angle by which the beam moves along the row while it is measured [rad].
        """
        return cls(range_m * pitch[0], range_m * pitch[1], spot, range_m * travel)

    def at(self, chosen: Chosen) -> Raster:
        """Return that of some voxels, arrays of shape (n,)."""
        return Raster(*(chosen.here(values) for values in (self.across, self.down, self.spot, self.travel)))

    def steps(self, reach: float) -> int:
        """Return how many voxels away edges within some standard deviations of a spot show, at most."""
        return farthest_step(reach, _greatest(self.spot / np.fmin(self.across, self.down)))


def pitch_of(angles: Array) -> float:
    """Return the angle between neighbours [rad]; one that no spot reaches over where there are none."""
    return float(angles[-1] - angles[0]) / (len(angles) - 1) if len(angles) > 1 else _LONE_PITCH


def window(slimness: float, pitch: tuple[float, float]) -> int:
    """Return how many voxels to each side have a say in a voxel, for the largest s over range and a pitch [rad]."""
    ratio = slimness / min(pitch)
    steps = [
        farthest_step(reach, ratio)
        for reach in (REACH, _WIDENED_REACH, _RUGGED_REACH, _LEAST_STENCIL, _LEAST_STENCIL)
    ]
    return sum(steps) + _RIM_VOXELS + 1


def farthest_step(reach: float, ratio: float) -> int:
    """Return the farthest neighbour that counts within a reach [s], with s over the pitch."""
    return min(MOST_STEPS, max(1, math.ceil(reach * min(ratio, 1e3))))


def ring_of(steps: int) -> list[tuple[int, int]]:
    """Return where all neighbours lie that are so many steps away, rows down and columns to the right."""
    side = range(-steps, steps + 1)
    return [(down, right) for down in side for right in side if max(abs(down), abs(right)) == steps]


def is_rugged(range_m: Array, noise: SharedNoise, raster: Raster) -> Mask:
    """Tell which voxels lie near a position where surfaces certainly bend, step or end.

    Parameters
    ----------
    range_m
        Ranges [m], NaN where there is none, shape (rows, columns).
    noise
        Variances of their noise [m²].
    raster
        Geometry.
    """
    missing = (~np.isfinite(range_m)).astype(np.float64)
    found = np.zeros(range_m.shape)
    for way, step, _, near in _axes(raster):
        for weights in (_BENDING, _RISING):
            stencil = _along(weights, way, step)
            certain = weighted_sum(range_m, stencil) ** 2 > _CERTAIN * noise.of(stencil)
            found = np.where(near & certain, 1.0, found)
        if step == 1:
            found = np.fmax(found, np.nan_to_num(_beside_largest(missing, way)))
    return _near_any(found > 0.0, raster)


def _near_any(found: Mask, raster: Raster) -> Mask:
    """Tell which voxels lie so near to one that was found that surfaces are taken to be uneven."""
    steps, about, within = raster.steps(_RUGGED_REACH), found.copy(), found
    bordered = np.pad(found, steps)
    for ring in range(1, steps + 1):
        within = grown(within, np.logical_or)
        chosen = Chosen(within & ~about, steps)
        place, is_near = raster.at(chosen), chosen.here(about)
        for down, right in ring_of(ring):
            apart = np.hypot(right * place.across, down * place.down)
            is_near |= chosen.there(bordered, down, right) & (apart <= _RUGGED_REACH * place.spot)
        chosen.put(about, is_near)
    return about


def texture(signal: Array, noise: SharedNoise, raster: Raster, is_rugged: Mask) -> Array:
    """Return the standard deviation of the light's centroid along the row [m], shape (rows, columns).

    Parameters
    ----------
    signal
        Returned signal; NaN where there is none.
    noise
        Variance of a signal over its square, by noise and speckle.
    raster
        Geometry.
    rugged
        Where surfaces are known to be uneven.

    Returns
    -------
    numpy.ndarray
        min(s² g, 0.8 s). The gradient g is the central difference of ln Y, which a pitch δ wider than the spot makes
        too small: by √(1 + δ²/(δ² + 5 s²)), root mean square over the positions of an edge under a sweep of δ. Mirrors
        at rest on such a pitch see an edge only as a share t = Φ(x/s) of the difference D of both neighbours: then g =
        D φ(Φ⁻¹(t))/(s Y), but at least half the central difference. A voxel brighter or darker than both neighbours
        holds a line; 0.6 of its contrast counts. What noise explains is taken off. At the rim, which has one neighbour,
        the gradient next to it counts too. 0 without neighbours.
    """
    logarithm, lit = np.full(signal.shape, np.nan), signal > 0.0
    logarithm[lit] = log(signal[lit])
    left, right = neighbour_values(logarithm, 0, -1), neighbour_values(logarithm, 0, 1)
    trust = np.where(is_rugged, _TEXTURE_NOISE[1], _TEXTURE_NOISE[0])

    to_neighbours = [
        (np.square(other - logarithm), noise.of({(0, 0): -1.0, (0, side): 1.0}))
        for side, other in ((-1, left), (1, right))
    ]

    def contrast(trust: Array | float) -> Array:
        """Return the squared difference to the neighbours beyond noise."""
        return np.asarray(np.fmax(*(_beyond(square, trust * chance) for square, chance in to_neighbours)))

    middle = _beyond(np.square(0.5 * (right - left)), trust * noise.of({(0, -1): -0.5, (0, 1): 0.5}))
    inner = np.isfinite(middle)
    coarse = np.square(raster.across / raster.spot)
    square = np.where(inner, middle, contrast(trust)) * (1.0 + coarse / (coarse + 5.0))
    outside = ~((logarithm >= np.fmin(left, right)) & (logarithm <= np.fmax(left, right)))
    line = _UNRESOLVED_CONTRAST**2 * contrast(_LINE_NOISE)
    gradient = np.sqrt(np.where(outside, np.fmax(square, line), square)) / raster.across
    gradient = np.where(inner, gradient, np.fmax(gradient, _beside_largest(gradient, (0, 1))))
    unresolved = (raster.travel == 0.0) & (raster.across > _UNRESOLVED * raster.spot)
    if unresolved.any():
        edge = _beyond(_sharp_edge(signal) ** 2, noise.of({(0, -1): -1.0, (0, 1): 1.0}))
        sharp = np.sqrt(np.where(outside, line, edge)) / raster.spot
        gradient = np.where(unresolved, np.fmax(sharp, 0.5 * gradient), gradient)
    moved = np.minimum(raster.spot**2 * np.nan_to_num(gradient), _LARGEST_SHIFT * raster.spot)
    return _widened(moved, raster)


def relief(
    range_m: Array, noise: SharedNoise, sigma_texture: Array, raster: Raster, is_rugged: Mask
) -> Array:
    """Return the standard deviation of the light's mean depth by bends and steps within the spot [m].

    Parameters
    ----------
    range_m
        Ranges [m], NaN where there is none, shape (rows, columns).
    noise
        Variances of their noise [m²].
    sigma_texture
        Standard deviations that textures give the ranges [m]; they make differences that look like steps.
    raster
        Geometry.
    rugged
        Where surfaces are known to be uneven.

    Returns
    -------
    numpy.ndarray
        From second differences Δ² (a crease) and differences of these (a step) along rows and columns, at distances
        from that of neighbours to two standard deviations of the spot; the largest of each axis. What noise explains
        is taken off. Where one is missing, at the rim, that of the nearest voxel counts. 0 without neighbours.
    """
    moved = replace(noise, own=noise.own + sigma_texture**2)
    last = _chances(raster) - 1
    bending, rising = (
        np.where(is_rugged, near_edges, _of_many(anywhere)[last])
        for anywhere, near_edges in (_BEND_NOISE, _STEP_NOISE)
    )
    wide = np.hypot(raster.spot, raster.travel / math.sqrt(12.0))
    largest = {way: np.full(range_m.shape, np.nan) for way in _AXES}
    for way, step, pitch, near in _axes(raster):
        bend, rise = (_along(weights, way, step) for weights in (_BENDING, _RISING))
        bent = np.sqrt(_beyond(weighted_sum(range_m, bend) ** 2, bending * noise.of(bend)))
        stepped = np.sqrt(_beyond(weighted_sum(range_m, rise) ** 2, rising * moved.of(rise)))
        spot = wide if way == (0, 1) else raster.spot
        found = np.fmax(_BEND_SHIFT * spot / (step * pitch) * bent, _STEP_SHIFT * stepped)
        largest[way] = np.where(near, np.fmax(largest[way], found), largest[way])
    total = np.zeros(range_m.shape)
    for way, own in largest.items():
        for _ in range(_RIM_VOXELS):
            own = np.where(np.isfinite(own), own, _beside_largest(own, way))
        total += np.nan_to_num(own) ** 2
    return _widened(np.sqrt(total), raster)


def _chances(raster: Raster) -> NDArray[np.intp]:
    """Return of how many differences a voxel takes the largest: those of all steps, of all voxels that widen it."""
    ratio = np.nan_to_num(raster.spot / np.fmin(raster.across, raster.down))
    steps = np.clip(np.ceil(_LEAST_STENCIL * ratio), 1, MOST_STEPS)
    about = 1 + 4 * np.fmin(np.floor(_WIDENED_REACH * ratio), MOST_STEPS)
    return np.asarray(steps * about, dtype=np.intp)


def _of_many(square: float) -> Array:
    """Return what the largest of 1, 2, … differences exceeds by chance as rarely as one of them does ``square``.

    Noise that neighbours share makes fewer chances than are counted.
    """
    chance = math.erfc(math.sqrt(0.5 * square))
    return np.asarray(ndtri(0.5 * chance / np.arange(1, MOST_STEPS * (1 + 4 * MOST_STEPS) + 1)) ** 2)


def _axes(raster: Raster) -> Iterator[tuple[tuple[int, int], int, Array, Mask]]:
    """Yield directions, steps of differences, pitches, and where on the raster a step is wanted."""
    for way, pitch in zip(_AXES, (raster.across, raster.down), strict=True):
        for step in range(1, raster.steps(_LEAST_STENCIL) + 1):
            yield way, step, pitch, (step == 1) | ((step - 1) * pitch < _LEAST_STENCIL * raster.spot)


def _along(weights: tuple[tuple[int, float], ...], way: tuple[int, int], step: int) -> Stencil:
    """Return the stencil of a difference over some steps in a direction."""
    return {(position * step * way[0], position * step * way[1]): weight for position, weight in weights}


def _beside_largest(values: Array, way: tuple[int, int]) -> Array:
    """Return the larger value of the two neighbours in a direction and against it; NaN where there is none."""
    return np.asarray(
        np.fmax(neighbour_values(values, way[0], way[1]), neighbour_values(values, -way[0], -way[1]))
    )


def _widened(values: Array, raster: Raster) -> Array:
    """Return the largest value at each voxel and within a standard deviation of the spot in its row and column."""
    widened = values.copy()
    for step in range(1, raster.steps(_WIDENED_REACH) + 1):
        for way, pitch in zip(_AXES, (raster.across, raster.down), strict=True):
            there = _beside_largest(values, (step * way[0], step * way[1]))
            widened = np.where(step * pitch <= _WIDENED_REACH * raster.spot, np.fmax(widened, there), widened)
    return np.asarray(widened)


def _sharp_edge(signal: Array) -> Array:
    """Return the slope of ln Y times s where a sharp edge passes between a voxel's neighbours."""
    left, right = neighbour_values(signal, 0, -1), neighbour_values(signal, 0, 1)
    low, whole = np.fmin(left, right), np.abs(right - left)
    share = np.clip((signal - low) / np.where(whole > 0.0, whole, 1.0), 1e-4, 1.0 - 1e-4)
    light = np.where(signal > 0.0, signal, np.nan)
    slope = whole / light * exp(-0.5 * ndtri(share) ** 2) / math.sqrt(2.0 * math.pi)
    return np.asarray(slope)


def _beyond(square: Array, variance: Array) -> Array:
    """Return squares less what chance explains, at least 0."""
    return np.asarray(np.maximum(square - variance, 0.0))


def _greatest(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else 0.0
