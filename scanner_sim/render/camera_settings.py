"""The ordinary video camera beside the scanner."""

from __future__ import annotations

import math

from pydantic import Field

from scanner_sim.foundation.parts import Count, Number, Part
from scanner_sim.foundation.units import Ratio

LEAST_FIELD = math.radians(1.0)
"""Field of view of a scan that is a single line or point."""


class Camera(Part):
    """What an ordinary video camera at the scanner would show: the trouble that the scanner is meant to avoid.

    Numbers of a typical charge-coupled video camera; none is printed in the paper.
    """

    width: Count = Field(default=400, ge=8, le=8192)
    """Columns of the picture; the rows follow from the field of view of the scan."""
    samples: Count = Field(default=32, ge=1, le=65536)
    """Random paths per pixel, at least; a few more where the number does not divide into an even grid."""
    bounces: Count = Field(default=4, ge=1, le=16)
    """Surfaces that the light may meet."""
    exposure: Number = Field(default=2.5, gt=0.0, le=1e9)
    """White saturates at 1: a perfectly white wall that faces the Sun has this brightness."""
    stops: Number = Field(default=6.0, ge=1.0, le=24.0)
    """Dynamic range in factors of two: what is darker than saturation by more is black."""
    bits: Count = Field(default=8, ge=1, le=8)
    """Grey levels, as a power of two."""
    gamma: Number = Field(default=2.2, ge=1.0, le=3.0)
    """Exponent by which a screen undoes the picture's curve."""
    glare: Ratio = Field(default=0.01, ge=0.0, le=0.5)
    """Share of the light that lens and sensor scatter around bright areas."""
    albedo: Ratio = Field(default=0.3, ge=0.0, le=1.0)
    """Albedo of the Earth in visible light."""
