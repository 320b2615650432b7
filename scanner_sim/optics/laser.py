"""The laser and its Gaussian beam."""

from __future__ import annotations

import math

from pydantic import Field

from scanner_sim.foundation.parts import Number, Part, Switch
from scanner_sim.foundation.units import Length, Power


class Laser(Part):
    """A continuous laser with a collimated Gaussian beam.

    The radius at 1/e² of the irradiance along the beam is w(z) = w₀ √(1 + (z − z₀)²/z_R²) with the Rayleigh
    length z_R = π w₀² / (M² λ) (Siegman, *Lasers*, 1986, ch. 17; M²: ISO 11146-1:2021).
    """

    power: Power = Field(ge=1e-12, le=1e6)
    """Power of the beam as it leaves the scanner."""
    wavelength: Length = Field(ge=0.3e-6, le=20e-6)
    """Nominal wavelength in vacuum."""
    drift: Length = Field(ge=-100e-9, le=100e-9)
    """How far the line has drifted from the nominal wavelength (temperature, current, age)."""
    waist_radius: Length = Field(ge=1e-6, le=0.1)
    """Radius of the waist at 1/e² of the irradiance."""
    waist_distance: Length = Field(ge=-1e5, le=1e5)
    """Distance of the waist along the beam, from the first deflection axis."""
    m_squared: Number = Field(ge=1.0, le=1000.0)
    """Beam quality M²: 1 is an ideal Gaussian beam; the divergence grows with it."""
    speckle: Switch = True
    """Whether the light is coherent, so that rough surfaces make speckle of it. Off: the mean image alone."""

    @property
    def line(self) -> float:
        """Wavelength that the laser emits [m]; it matters to the filter only."""
        return self.wavelength + self.drift

    @property
    def rayleigh_length(self) -> float:
        """Rayleigh length z_R [m]."""
        return math.pi * self.waist_radius**2 / (self.m_squared * self.wavelength)

    @property
    def divergence(self) -> float:
        """Half angle of the far field at 1/e² [rad]."""
        return self.waist_radius / self.rayleigh_length

    def radius(self, distance: float) -> float:
        """Return the 1/e² radius of the beam [m] at a distance [m] along it."""
        return self.waist_radius * math.hypot(1.0, (distance - self.waist_distance) / self.rayleigh_length)

    def widening(self, distance: float) -> float:
        """Return dw/dz, by how much the 1/e² radius w grows along the beam at a distance z [m] along it."""
        away = (distance - self.waist_distance) / self.rayleigh_length
        return self.divergence * away / math.hypot(1.0, away)
