"""The lobe of a retro-reflector: sheets of glass beads and arrays of corner cubes, as numbers.

What the numbers mean for light stands with the BSDF, :mod:`scanner_sim.render.plugins.retroreflector`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

from pydantic import Field

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Number, Part
from scanner_sim.foundation.units import Angle, Ratio

RetroKind = Literal["bead_sheet", "corner_cube"]

NARROWEST = 1.4e-4
"""Least half width [rad]: 29 arcseconds, where single precision still resolves the lobe to 0.1 %."""
WIDEST = 0.2
"""Largest half width [rad]: beyond it the lobe is no longer one about the way the light came."""
BEAD_HALF_ANGLE = math.radians(38.0)
"""Entrance angle [rad] at which a bead sheet returns half: 0.69 at 30° and 0.45 at 40°, where sheets of class RA2
must keep 0.60 and 0.44 (EN 12899-1) and the fit of Ward to a 3M sheet has 0.67 and 0.49 (Radiance, ``retrorefl.cal``).
"""
CUBE_INDEX = 1.5
"""Index of refraction of glass and acrylic near 1.5 µm, to 0.03."""
_HALF = math.sqrt(math.sqrt(2.0) - 1.0)
"""tan θ/α where the GGX distribution has fallen to half."""


def roughness(half_width: float) -> float:
    """Return the GGX roughness of a lobe, α = tan(δ_½/2)/√(√2 − 1).

    Parameters
    ----------
    half_width
        Observation angle δ_½ [rad] at which the gain is half of that at 0.

    Returns
    -------
    float
        α, dimensionless. A facet tilted by δ/2 returns light at δ, and D(θ)/D(0) = (1 + tan²θ/α²)⁻² near the normal.
    """
    return math.tan(0.5 * half_width) / _HALF


class RetroLobe(Part):
    """How a surface sends light back the way it came."""

    kind: RetroKind = Field(default="bead_sheet", examples=["corner_cube"])
    """Glass beads or corner cubes: they differ in how the return falls with the entrance angle."""
    retro_share: Ratio = Field(default=0.2, gt=0.0, le=1.0)
    """Share of the reflected light that is in the lobe at normal incidence; the rest is diffuse."""
    half_width: Angle = Field(default=math.radians(0.35), ge=NARROWEST, le=WIDEST, examples=["0.35 deg"])
    """Observation angle, between the ways in and out, at which the lobe's gain has fallen to half."""
    entrance_half_angle: Angle | None = Field(default=None, ge=0.05, le=1.5)
    """Of a bead sheet: entrance angle, between the light and the normal, at which the lobe holds half of its light; by
    default 38 deg."""
    refractive_index: Number | None = Field(default=None, ge=1.0, le=4.0)
    """Of a corner cube: index of refraction, 1 for a hollow one; by default 1.5."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield the entrance law of the other kind."""
        if self.kind == "bead_sheet" and self.refractive_index is not None:
            yield Fault(
                "refractive_index",
                "a bead sheet is described by entrance_half_angle instead.",
                "Leave it out, or write 'kind: corner_cube'.",
            )
        if self.kind == "corner_cube" and self.entrance_half_angle is not None:
            yield Fault(
                "entrance_half_angle",
                "a corner cube's entrance angles follow from its refractive_index.",
                "Leave it out, or write 'kind: bead_sheet'.",
            )

    @property
    def alpha(self) -> float:
        """GGX roughness of the lobe."""
        return roughness(self.half_width)

    @property
    def entrance(self) -> tuple[str, float]:
        """Name and value of the parameter of the entrance law."""
        if self.kind == "bead_sheet":
            angle = self.entrance_half_angle
            return "entrance_half_angle", BEAD_HALF_ANGLE if angle is None else angle
        index = self.refractive_index
        return "refractive_index", CUBE_INDEX if index is None else index
