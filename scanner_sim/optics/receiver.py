"""The receiver: a lens that is kept parallel to the beam by the shared mirror."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pydantic import Field

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Part
from scanner_sim.foundation.units import Length, Ratio


class Receiver(Part):
    """The receiving lens beside the laser.

    The lens is ideal but for its aberration, a Gaussian spread of its rays: the position sensor is tilted to
    Scheimpflug's condition, as in Blais 1986, and there is neither distortion nor vignetting. The wavefront's error is
    a phase in the pupil: it widens the image of the beam, and moves each grain of its speckle by as much.
    """

    baseline: Length = Field(gt=0.0, le=100.0)
    """Triangulation base d: from the laser's axis to the lens node."""
    focal_length: Length = Field(ge=1e-4, le=10.0)
    """Focal length f."""
    aperture: Length = Field(ge=1e-6)
    """Diameter of the aperture stop."""
    transmission: Ratio = Field(gt=0.0, le=1.0)
    """Transmission of lens and mirrors at the laser's wavelength, filter apart."""
    aberration: Length = Field(ge=0.0, le=1e-2)
    """Standard deviation of the lens's rays on the sensor, per axis: defocus and errors of the wavefront."""

    def cross_checks(self) -> Iterator[Fault]:
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
