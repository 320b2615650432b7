"""The position sensor: a line of InGaAs pixels (the paper's "linear CCD"; silicon is blind at 1.5 µm)."""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import Field

from scanner_sim.detector.line.noise import NoiseSwitches
from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Count, Part
from scanner_sim.foundation.units import ElectronRate, Electrons, ElectronsPerNumber, Length, Ratio


class PositionSensor(Part):
    """A linear array; pixel i has its centre at p = offset + (i + 1/2) pitch.

    p is counted from the image of infinity (p = 0, eq 1) towards nearer ranges. Anti-blooming drains the
    charge above the full well: it does not reach the neighbours.
    """

    pixels: Count = Field(ge=8, le=4096)
    """Number of pixels."""
    pitch: Length = Field(ge=1e-7, le=1e-2)
    """Distance of the pixels, and their width (fill factor 1)."""
    height: Length = Field(ge=1e-7, le=0.1)
    """Height of the pixels; light above or below is lost."""
    diffusion: Length = Field(ge=0.0, le=1e-2)
    """Standard deviation, per axis, by which charge spreads before a pixel collects it: diffusion in the layer that
    absorbs, cross-talk, an optical low-pass before the array."""
    offset: Length = Field(ge=0.0, le=1.0)
    """Position p of the array's far end: 0 shows everything out to infinity."""
    quantum_efficiency: Ratio = Field(gt=0.0, le=1.0)
    """Electrons per photon, at every wavelength of the response."""
    response: tuple[Length, Length] = Field(examples=[["0.9 um", "1.7 um"]])
    """Shortest and longest wavelength that frees electrons."""
    full_well: Electrons = Field(ge=1.0, le=1e15)
    """Charge at which a pixel saturates."""
    read_noise: Electrons = Field(ge=0.0, le=1e12)
    """Standard deviation of the read noise."""
    dark_current: ElectronRate = Field(ge=0.0, le=1e18)
    """Mean dark current of a pixel."""
    prnu: Ratio = Field(ge=0.0, le=0.2)
    """Standard deviation of the pixels' response, left after the flat field."""
    adc_bits: Count = Field(ge=4, le=24)
    """Bits of the analogue-digital converter."""
    gain: ElectronsPerNumber | None = Field(default=None, ge=1e-3, le=1e12)
    """Electrons per digital number; by default the converter's range equals the full well."""
    bias: Count = Field(ge=0)
    """Digital number of a pixel without charge: keeps negative noise from being cut off."""
    noise: NoiseSwitches = NoiseSwitches()
    """A switch for every term."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a response that does not ascend and a bias that eats up the converter."""
        if not 0.0 < self.response[0] < self.response[1]:
            yield Fault(
                "response", "the wavelengths must ascend from above 0 m.", "Write [shortest, longest]."
            )
        if self.bias > self.largest_number // 2:
            yield Fault(
                "bias",
                f"{self.bias} leaves less than half of the converter's {self.adc_bits} bits.",
                f"Write {self.largest_number // 2} or less, or raise adc_bits.",
            )

    @property
    def largest_number(self) -> int:
        """Largest digital number of the converter."""
        return int(2**self.adc_bits) - 1

    @property
    def electrons_per_number(self) -> float:
        """Electrons per digital number."""
        return self.full_well / (self.largest_number - self.bias) if self.gain is None else self.gain

    @property
    def length(self) -> float:
        """Length of the array [m]."""
        return self.pixels * self.pitch
