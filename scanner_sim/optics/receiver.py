"""The receiver: a lens that is kept parallel to the beam by the shared mirror."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pydantic import Field

from scanner_sim.errors import Fault
from scanner_sim.parts import Part
from scanner_sim.units import Length, Ratio


class Receiver(Part):
    """The receiving lens beside the laser.

    The lens is ideal but for a Gaussian point spread: it images in focus at every range (the position sensor
    is tilted to Scheimpflug's condition, as in Blais 1986), without distortion or vignetting.
    """

    baseline: Length = Field(default=0.2, gt=0.0, le=100.0)
    """Triangulation base d: from the laser's axis to the lens node."""
    focal_length: Length = Field(default=0.1, ge=1e-4, le=10.0)
    """Focal length f."""
    aperture: Length = Field(default=25e-3, ge=1e-6)
    """Diameter of the aperture stop."""
    transmission: Ratio = Field(default=0.5, gt=0.0, le=1.0)
    """Transmission of lens and mirrors at the laser's wavelength, filter apart."""
    point_spread: Length = Field(default=40e-6, ge=1e-8, le=1e-2)
    """Standard deviation of the Gaussian point spread on the sensor (lens, alignment), per axis."""

    def contradictions(self) -> Iterator[Fault]:
        """Yield an aperture that is larger than the focal length."""
        if self.aperture > self.focal_length:
            yield Fault(
                "aperture",
                f"{self.aperture:g} m is larger than the focal length of {self.focal_length:g} m, and "
                "no lens here is faster than f/1.",
                "Reduce the aperture, or raise focal_length.",
            )

    @property
    def aperture_area(self) -> float:
        """Area of the aperture [m²]."""
        return math.pi / 4.0 * self.aperture**2
