"""The axes about which the mirrors turn: what deflections and a range mean as a point, wherever the axes are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.ranging.coordinates import angles_and_range, coordinates
from scanner_sim.ranging.departures import axes_shift

Array = NDArray[np.float64]

_SETTLED = 4
"""Steps by which the axes' shift is taken off a point: each leaves a thousandth of the last."""


@dataclass(frozen=True)
class Axes:
    """Where the second axis is, seen from the first one.

    Attributes
    ----------
    separation
        D_g of eq 3 [m].
    offset
        By how much the second axis passes below the beam, towards +y [m].
    skew
        By how much it is turned about z, from +x towards +y [rad].
    """

    separation: float
    offset: float = 0.0
    skew: float = 0.0

    @property
    def meet(self) -> bool:
        """Whether the axes are square and cross the beam, as eq 3 has them."""
        return self.offset == 0.0 and self.skew == 0.0

    def point(self, r: ArrayLike, theta: ArrayLike, phi: ArrayLike) -> tuple[Array, Array, Array]:
        """Return points (x, y, z) [m] at ranges [m] and deflections [rad]: eq 3 with these axes."""
        ideal = coordinates(r, theta, phi, self.separation)
        if self.meet:
            return ideal
        r, theta, phi = (np.asarray(value, dtype=np.float64) for value in (r, theta, phi))
        reach = r * np.cos(theta) - self.separation
        x, y, z = axes_shift(r * np.sin(theta), reach, phi, self.offset, self.skew)
        return ideal[0] + x, ideal[1] + y, ideal[2] + z

    def sight_of(self, x: Array, y: Array, z: Array) -> tuple[Array, Array, Array]:
        """Return (R, Θ, φ) of points: the inverse of :meth:`point`."""
        at = x, y, z
        for _ in range(0 if self.meet else _SETTLED):
            found = self.point(*angles_and_range(*at, self.separation))
            at = at[0] + x - found[0], at[1] + y - found[1], at[2] + z - found[2]
        return angles_and_range(*at, self.separation)
