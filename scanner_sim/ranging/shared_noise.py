"""Noise that neighbouring voxels of a raster have in common: on rasters finer than the spot they see the same speckle.

Beams that are δ apart on a surface have exp(−δ²/w²) of the energy's fluctuation in common, and along the line
(1 − 2δ²/w²) exp(−δ²/w²) of the centroid's, of which the part that the lens's aberration makes follows the energy
(:mod:`~scanner_sim.detector.surface_noise`). The variance of a difference of neighbours is hence not that of
independent ones: for the second difference of rows w/2 apart it is half of σ², not 6 σ².
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import exp
from scanner_sim.ranging.neighbours import Chosen, Stencil, weighted_sum

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Overlap:
    """What beams of neighbours see alike.

    ``across`` and ``down`` are distances of neighbours in 1/e² radii of the beam, shape (rows, columns).
    """

    across: Array
    down: Array
    _decays: dict[tuple[str, int], Array] = field(default_factory=dict, init=False, repr=False)

    def along_rows(self, right: int) -> Array:
        """Return the square of the distance of voxels so many columns apart, in squares of the radius."""
        return np.square(right * self.across)

    def decay(self, down: int, right: int) -> Array:
        """Return exp(−δ²/w²) of voxels so many rows and columns apart."""
        return self._decay("across", abs(right)) * self._decay("down", abs(down))

    def _decay(self, way: str, steps: int) -> Array:
        """Return exp(−δ²/w²) of so many steps one way, a power of that of one; it is asked for again and again."""
        if (way, steps) not in self._decays:
            one = self._decay(way, 1) if steps != 1 else exp(-np.square(getattr(self, way)))
            self._decays[way, steps] = _power(one, steps**2)
        return self._decays[way, steps]


@dataclass(frozen=True)
class SharedNoise:
    """Variances of what is measured at every voxel, arrays of shape (rows, columns).

    ``own`` of each voxel alone; ``energy`` and ``position`` of speckle that neighbours share as the energy, and as the
    centroid, do, by how their beams ``overlap``.
    """

    own: Array
    energy: Array
    position: Array
    overlap: Overlap
    _shares: dict[int, Array] = field(default_factory=dict, init=False, repr=False)

    def at(self, chosen: Chosen) -> SharedNoise:
        """Return that of some voxels, arrays of shape (n,)."""
        own, energy, position = (chosen.here(values) for values in (self.own, self.energy, self.position))
        overlap = Overlap(chosen.here(self.overlap.across), chosen.here(self.overlap.down))
        return SharedNoise(own, energy, position, overlap)

    def of(self, stencil: Stencil) -> Array:
        """Return the variance of a weighted sum of voxels about each; NaN where one is missing."""
        apart: defaultdict[tuple[int, int], float] = defaultdict(float)
        for one, weight in stencil.items():
            for other, more in stencil.items():
                apart[abs(one[0] - other[0]), abs(one[1] - other[1])] += weight * more
        total = weighted_sum(self.own, {one: weight**2 for one, weight in stencil.items()})
        for (down, right), weight in apart.items():
            total += weight * self.overlap.decay(down, right) * self._shared(right)
        return np.asarray(np.maximum(total, 0.0))

    def apart(self, down: int, right: int) -> Array:
        """Return what speckle adds to the variance of the difference of two voxels so far apart."""
        return 2.0 * (self._shared(0) - self.overlap.decay(down, right) * self._shared(right))

    def least_apart(self, steps: int) -> Array:
        """Return what speckle adds to the variance of the difference to any voxel so many steps away, at least."""
        nearest = np.fmax(self.overlap.decay(steps, 0), self.overlap.decay(0, steps))
        return 2.0 * (1.0 - nearest) * self._shared(0)

    def _shared(self, right: int) -> Array:
        """Return what exp(−δ²/w²) is a factor of, of voxels so many columns apart."""
        if right not in self._shares:
            along = self.overlap.along_rows(right)
            self._shares[right] = self.energy + (1.0 - 2.0 * along) * self.position
        return self._shares[right]


def _power(values: Array, exponent: int) -> Array:
    """Return whole powers as products, which are the same bytes everywhere; NaN of NaN."""
    if exponent == 0:
        return np.asarray(np.where(np.isnan(values), np.nan, 1.0))
    if exponent == 1:
        return values
    half = _power(values, exponent // 2)
    return half * half * values if exponent % 2 else half * half
