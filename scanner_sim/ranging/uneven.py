"""Uneven spots: what light that is not spread evenly over the spot may do to a range, and which spots are mixed.

A Gaussian spot of standard deviation s = w/2 measures where its *light* is, not where its axis is. Light L that
changes across the spot moves its centroid sideways by ā = s² ∂ln L/∂x (Stein's lemma), which the triangulation takes
for a range: δR = (R/d) ā along the base. Surfaces that bend or step within the spot move the mean depth of the light.
Both are systematic, and the instrument cannot tell them from range in one line: but its neighbours in the raster show
the changes, and how large they are is stated as a standard deviation. It comes from signals, ranges and angles alone.

(Baribeau, Rioux, *Appl. Opt.* 30, 1991, and Curless, Levoy, *ICCV* 1995, on such errors at edges of reflectance and of
shape.)
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from scanner_sim.arithmetic import exp, log
from scanner_sim.ranging.neighbours import beside
from scanner_sim.status import Status

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST_STEPS = 8
"""Farthest neighbour that is looked at, in voxels: rasters finer than a seventh of the spot see no farther."""
_REACH = 2.5
"""Standard deviations of the spot from its axis within which an edge sends a noticeable share of light, 0.6 %."""
_STENCIL = 2.0
"""Least distance, in standard deviations of the spot, over which bends are looked for: on finer rasters noise hides
them from direct neighbours."""
_LARGEST = 0.8
"""Largest shift of the light, in standard deviations of the spot: that of half a spot, √(2/π)."""
_UNRESOLVED = 1.25
"""Pitch, in standard deviations of the spot, from which voxels at rest do not resolve an edge."""
_INSIDE = 0.6
"""Share of the contrast to its neighbours that an unresolved line within one spot is taken to have unevenly."""
_BEND = 0.3
"""Shift of the mean depth, root mean square over where a crease may lie, for a second difference of ranges Δ² at a
pitch of δ: 0.3 s Δ²/δ. From 1.5 to 6 s it is 0.45 to 0.17 for mirrors at rest, 0.49 to 0.28 for a sweep."""
_STEP = 0.3
"""The same for a step, over the difference of second differences: 0.43 to 0.11, and 0.50 to 0.20."""
_EVIDENCE = 3.0
"""Squared second difference of ranges, over its variance, that counts as noise and is taken off."""
_STEP_EVIDENCE = 6.0
"""The same of a difference of second differences, which has more noise."""
_LINE_EVIDENCE = 8.0
"""Squared difference of a signal to its neighbours' logarithms, over the variance of one, that counts as noise."""
_CHANCE = 4.5
"""Standard deviations of noise by which two ranges may differ beyond the slope: in 200 comparisons once in 700."""
_DOUBT = 2.0
"""The same of what unevenness may move them by."""
_ALONE = 1e3
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

    def steps(self, reach: float) -> int:
        """Return how many voxels away edges within some standard deviations of a spot show, at most."""
        return farthest_step(reach, _greatest(self.spot / np.fmin(self.across, self.down)))


def pitch_of(angles: Array) -> float:
    """Return the angle between neighbours [rad]; one that no spot reaches over where there are none."""
    return float(angles[-1] - angles[0]) / (len(angles) - 1) if len(angles) > 1 else _ALONE


def window(slimness: float, pitch: tuple[float, float]) -> int:
    """Return how many voxels to each side have a say in a voxel, for the largest s over range and a pitch [rad]."""
    ratio = slimness / min(pitch)
    return max(farthest_step(_REACH, ratio) + 1, 2 * farthest_step(_STENCIL, ratio) + 1)


def farthest_step(reach: float, ratio: float) -> int:
    """Return the farthest neighbour that counts within a reach [s], with s over the pitch."""
    return min(MOST_STEPS, max(1, math.ceil(reach * min(ratio, 1e3))))


def texture(signal: Array, relative_variance: Array, raster: Raster) -> Array:
    """Return the standard deviation of the light's centroid along the row [m], shape (rows, columns).

    Parameters
    ----------
    signal
        Returned signal; NaN where there is none.
    relative_variance
        Variance of a signal over its square, by noise and speckle.
    raster
        Geometry.

    Returns
    -------
    numpy.ndarray
        min(s² g, 0.8 s). The gradient g is the central difference of ln Y, which a pitch δ wider than the spot makes
        too small: by √(1 + δ²/(δ² + 5 s²)), root mean square over the places of an edge under a sweep of δ. Mirrors at
        rest on such a pitch see an edge only as a share t = Φ(x/s) of the difference D of both neighbours: then
        g = D φ(Φ⁻¹(t))/(s Y), but at least half the central difference. A voxel brighter or darker than both neighbours
        holds a line; 0.6 of its contrast counts. What noise explains is taken off. 0 without neighbours.
    """
    logarithm = log(np.where(signal > 0.0, signal, np.nan))
    left, right = beside(logarithm, 0, -1), beside(logarithm, 0, 1)
    either = np.fmax(np.abs(right - logarithm), np.abs(logarithm - left))
    middle = 0.5 * np.abs(right - left)
    change = np.where(np.isfinite(middle), middle, either)
    coarse = np.square(raster.across / raster.spot)
    square = _beyond(change**2, relative_variance) * (1.0 + coarse / (coarse + 5.0))
    outside = ~((logarithm >= np.fmin(left, right)) & (logarithm <= np.fmax(left, right)))
    line = _INSIDE**2 * _beyond(either**2, _LINE_EVIDENCE * relative_variance)
    gradient = np.sqrt(np.where(outside, np.fmax(square, line), square)) / raster.across
    unresolved = (raster.travel == 0.0) & (raster.across > _UNRESOLVED * raster.spot)
    if unresolved.any():
        edge = _beyond(_sharp_edge(signal) ** 2, 2.0 * relative_variance)
        sharp = np.sqrt(np.where(outside, line, edge)) / raster.spot
        gradient = np.where(unresolved, np.fmax(sharp, 0.5 * gradient), gradient)
    return np.asarray(np.minimum(raster.spot**2 * np.nan_to_num(gradient), _LARGEST * raster.spot))


def relief(range_m: Array, sigma: Array, sigma_texture: Array, raster: Raster) -> Array:
    """Return the standard deviation of the light's mean depth by bends and steps within the spot [m].

    Parameters
    ----------
    range_m, sigma
        Ranges and the standard deviations of their noise [m], NaN where there is none, shape (rows, columns).
    sigma_texture
        Standard deviations that textures give the ranges [m]; they make differences that look like steps.
    raster
        Geometry.

    Returns
    -------
    numpy.ndarray
        From second differences Δ² (a crease) and differences of these (a step) along rows and columns, at distances
        from that of neighbours to two standard deviations of the spot; the largest of each axis. What noise explains
        is taken off. 0 without neighbours.
    """
    noise, moved = sigma**2, sigma_texture**2
    wide = np.hypot(raster.spot, raster.travel / math.sqrt(12.0))
    total = np.zeros(range_m.shape)
    for pitch, spot, (down, right) in ((raster.across, wide, (0, 1)), (raster.down, raster.spot, (1, 0))):
        largest = np.zeros(range_m.shape)
        for step in range(1, raster.steps(_STENCIL) + 1):
            near = (step == 1) | ((step - 1) * pitch < _STENCIL * raster.spot)

            def at(
                values: Array, number: int, step: int = step, down: int = down, right: int = right
            ) -> Array:
                return beside(values, number * step * down, number * step * right)

            bend = at(range_m, 1) - 2.0 * range_m + at(range_m, -1)
            chance = at(noise, 1) + 4.0 * noise + at(noise, -1)
            bent = _BEND * spot / (step * pitch) * np.sqrt(_beyond(bend**2, _EVIDENCE * chance))
            rise = at(range_m, 2) - 2.0 * at(range_m, 1) + 2.0 * at(range_m, -1) - at(range_m, -2)
            both = noise + moved
            chance = at(both, 2) + 4.0 * at(both, 1) + 4.0 * at(both, -1) + at(both, -2)
            stepped = _STEP * np.sqrt(_beyond(rise**2, _STEP_EVIDENCE * chance))
            found = np.fmax(np.nan_to_num(bent), np.nan_to_num(stepped))
            largest = np.where(near, np.fmax(largest, found), largest)
        total += largest**2
    return np.asarray(np.sqrt(total))


def mixed(
    range_m: Array,
    noise: Array,
    uneven: Array,
    status: NDArray[np.unsignedinteger],
    faint: Mask,
    raster: Raster,
    steepest: float,
) -> Mask:
    """Tell which voxels of a raster image hold light of more than one surface.

    A voxel is mixed if, within 2.5 standard deviations of the spot or among its eight neighbours, there is a voxel
    whose range differs by more than a surface inclined by ``steepest`` rises and noise and unevenness explain, or one
    that has no range, for the surface then ends between them.

    Parameters
    ----------
    range_m
        Ranges [m], shape (rows, columns).
    noise, uneven
        Their standard deviations by noise and by what light that is uneven over the spot may do [m].
    status
        Status codes.
    faint
        Voxels so faint that noise alone may hide their neighbours: of those, neighbours below the threshold say
        nothing.
    raster
        Geometry.
    steepest
        Inclination [rad], below π/2.
    """
    valid = np.asarray(status) == Status.VALID
    r = np.where(valid, range_m, np.nan)
    variance = np.where(valid, (_CHANCE * noise) ** 2 + (_DOUBT * uneven) ** 2, np.nan)
    missing = (~valid).astype(np.float64)
    hidden = (np.asarray(status) == Status.BELOW_THRESHOLD).astype(np.float64)
    rise = math.tan(steepest)
    found = np.zeros(r.shape, dtype=np.bool_)
    for down, right in _around(raster.steps(_REACH)):
        before = np.hypot(max(abs(right) - 1, 0) * raster.across, max(abs(down) - 1, 0) * raster.down)
        near = (before < _REACH * raster.spot) | (max(abs(down), abs(right)) == 1)
        there, apart = beside(r, down, right), np.hypot(right * raster.across, down * raster.down)
        limit = rise * apart * np.fmin(1.0, there / r)
        limit += np.sqrt(variance + beside(variance, down, right))
        nothing = (beside(missing, down, right) == 1.0) & ~(faint & (beside(hidden, down, right) == 1.0))
        found |= near & ((np.abs(there - r) > limit) | nothing)
    return np.asarray(valid & found)


def _sharp_edge(signal: Array) -> Array:
    """Return the slope of ln Y times s where a sharp edge passes between a voxel's neighbours."""
    left, right = beside(signal, 0, -1), beside(signal, 0, 1)
    low, whole = np.fmin(left, right), np.abs(right - left)
    share = np.clip((signal - low) / np.where(whole > 0.0, whole, 1.0), 1e-4, 1.0 - 1e-4)
    slope = whole / signal * exp(-0.5 * ndtri(share) ** 2) / math.sqrt(2.0 * math.pi)
    return np.asarray(slope)


def _around(steps: int) -> Iterator[tuple[int, int]]:
    """Yield the places of all neighbours up to some steps away, down and right."""
    for down in range(-steps, steps + 1):
        for right in range(-steps, steps + 1):
            if (down, right) != (0, 0):
                yield down, right


def _beyond(square: Array, variance: Array) -> Array:
    """Return squares less what chance explains, at least 0."""
    return np.asarray(np.maximum(square - variance, 0.0))


def _greatest(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else 0.0
