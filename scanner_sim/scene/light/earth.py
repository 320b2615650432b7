"""The Earth in the sky: how large it is, and what it hides.

The Earth is a sphere of the mean radius without an atmosphere: light is neither bent nor dimmed at its limb.
Refraction would widen the penumbra of a low orbit by some seconds of time.
"""

from __future__ import annotations

import math
from typing import Annotated, Final

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.units import Dimension

EARTH_RADIUS: Final = 6_371_008.8
"""Mean radius of the Earth [m] (IUGG: Moritz, *Geodetic Reference System 1980*, J. Geodesy 74, 2000)."""
DEFAULT_ALTITUDE: Final = 400e3
"""Altitude [m] where nothing else says it: the Space Station's."""

Distance = Annotated[float, Dimension("m", ("400 km",), ("km",))]
"""A length of the sky, in kilometres where it is written back."""


def earth_angular_radius(altitude: float) -> float:
    """Return the angular radius of the Earth's disc [rad]: asin(R/(R + h)), h the altitude [m] above 0."""
    return math.asin(EARTH_RADIUS / (EARTH_RADIUS + altitude))


def angle_between(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Return the angle of two unit vectors (3,) [rad]: 2 atan2(|a − b|, |a + b|), exact at 0 and π."""
    return 2.0 * math.atan2(float(np.linalg.norm(first - second)), float(np.linalg.norm(first + second)))


def visible_share(separation: float, sun_radius: float, earth_radius: float) -> float:
    """Return the share of the Sun's disc that the Earth's disc leaves visible, 0 to 1.

    Parameters
    ----------
    separation
        Angle between the centres of Sun and Earth [rad].
    sun_radius, earth_radius
        Angular radii [rad]; the Sun's is small, the Earth's below π/2.

    Returns
    -------
    float
        1 minus the common area of two circles over the Sun's: a² acos(x/a) + b² acos((c − x)/b) − c y with
        x = (c² + a² − b²)/(2c), y = √(a² − x²) (Montenbruck and Gill, *Satellite Orbits*, 2000, eqs 3.92–3.94).
        On the sphere the Earth's limb is as curved as a plane circle of the radius tan(β), so the Earth is
        drawn with b = tan(β) about a centre that leaves its limb where it is. Neglected: the second order of
        the Sun's radius, 1e-6 of the share.
    """
    if separation >= sun_radius + earth_radius:
        return 1.0
    if separation <= earth_radius - sun_radius:
        return 0.0
    a, b = sun_radius, math.tan(earth_radius)
    c = separation - earth_radius + b
    if c <= a - b:
        return 1.0 - (b / a) ** 2
    x = (c * c + a * a - b * b) / (2.0 * c)
    y = math.sqrt(max(a * a - x * x, 0.0))
    sun = a * a * math.acos(min(max(x / a, -1.0), 1.0))
    # The Earth's sector less its triangle, in one piece: b may be a thousand times a.
    half = math.atan2(y, c - x)
    earth = b * b * (half - math.sin(half) * math.cos(half))
    return min(max(1.0 - (sun - x * y + earth) / (math.pi * a * a), 0.0), 1.0)
