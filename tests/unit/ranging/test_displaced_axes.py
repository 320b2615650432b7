"""Points of an instrument whose second axis is displaced and askew, against rotations."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scanner_sim.ranging.departures import axes_shift, point_derivatives

Array = NDArray[np.float64]


def turned(x: float, reach: float, phi: float, offset: float, skew: float) -> Array:
    """The point from the line's foot on z = D_g: (x, −e, ζ) turned by φ, down for φ > 0, about (cos s, sin s, 0)."""
    axis = np.array([np.cos(skew), np.sin(skew), 0.0])
    moved: Array = Rotation.from_rotvec(-phi * axis).apply([x, -offset, reach])
    return moved + np.array([0.0, offset, 0.0])


CASES: list[tuple[float, ...]] = [
    (0.7, 3.1, 0.4, 0.3, 0.5),
    (-1.3, 2.2, -0.6, 0.2, -0.4),
    (0.9, 1.7, 0.5, -0.6, 0.8),
]
"""x, ζ [m], φ [rad], e [m] and s [rad], far beyond those of any instrument: no term is small."""


def test_points_move_as_the_turned_plane_does() -> None:
    """Claim: the shift is what the plane turned about the displaced axis has beyond eq 3, (x, ζ sin φ, ζ cos φ)."""
    for x, reach, phi, offset, skew in CASES:
        plain = np.array([x, reach * np.sin(phi), reach * np.cos(phi)])
        shift = np.array(axes_shift(x, reach, phi, offset, skew))
        np.testing.assert_allclose(shift, turned(x, reach, phi, offset, skew) - plain, atol=1e-14)


def test_derivatives_of_points_are_their_differences() -> None:
    """Claim: the derivatives by x, ζ, φ, e and s are the differences of the turned points; central ones by 10⁻⁵ are
    exact to 10⁻⁹."""
    step = 1e-5
    for case in CASES:
        found = point_derivatives(*case)
        for number, derivative in enumerate(found):
            change: Any = np.zeros(5)
            change[number] = step
            wanted = (turned(*(case + change)) - turned(*(case - change))) / (2.0 * step)
            np.testing.assert_allclose(derivative, wanted, atol=1e-8)
