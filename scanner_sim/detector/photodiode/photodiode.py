"""The avalanche photodiode with its amplifier, and the converter and clock behind it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, Literal

from pydantic import Field

from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Count, Number, Part, Switch
from scanner_sim.foundation.units import (
    Angle,
    Current,
    CurrentNoise,
    Frequency,
    Length,
    Ratio,
    Responsivity,
    Time,
)

ELEMENTARY_CHARGE: Final = 1.602_176_634e-19
"""Elementary charge [C] (SI, exact by definition)."""

_MARGIN = 12e-9
"""Time [s] recorded before and after the gate, for the pulse's own length."""
_LONGEST = 1 << 16
"""Samples of the longest record."""


class PhotodiodeNoise(Part):
    """A switch for every imperfection of the time-of-flight receiver; all on by default."""

    shot: Switch = True
    """Shot noise of signal, background and dark current, with the avalanche's excess noise."""
    amplifier: Switch = True
    """Noise of the transimpedance amplifier."""
    saturation: Switch = True
    """Largest current of the amplifier."""
    quantisation: Switch = True
    """Whole numbers of the converter."""
    clock: Switch = True
    """Jitter and drift of the clock."""


class Photodiode(Part):
    """An InGaAs avalanche photodiode with transimpedance amplifier, AC-coupled: direct current is taken off.

    The electronics' response is a Gaussian in time, h(t) of standard deviation √(ln 2)/(2π B) for a −3 dB bandwidth B.
    The mean background current is known from the monitor of the bias supply.
    """

    responsivity: Responsivity = Field(gt=0.0, le=10.0)
    """Current per light at gain 1."""
    response: tuple[Length, Length] = Field(examples=[["0.9 um", "1.7 um"]])
    """Shortest and longest wavelength that makes a current, the same at each."""
    gain: Number = Field(ge=1.0, le=1000.0)
    """Mean multiplication M of the avalanche; 1 is a photodiode without."""
    ionisation_ratio: Ratio = Field(ge=0.0, le=1.0)
    """Ratio k of the carriers' ionisation coefficients."""
    bulk_dark_current: Current = Field(ge=0.0, le=1e-3)
    """Dark current of the bulk before it is multiplied."""
    surface_dark_current: Current = Field(ge=0.0, le=1e-3)
    """Dark current of the surface, which is not multiplied."""
    bandwidth: Frequency = Field(ge=1e5, le=1e11)
    """Bandwidth of diode and amplifier at −3 dB."""
    amplifier_noise: CurrentNoise = Field(ge=0.0, le=1e-6)
    """White noise of the amplifier, referred to its input."""
    saturation: Current = Field(ge=1e-9, le=10.0)
    """Largest current that the amplifier passes on; it recovers at once."""
    field_of_view: Angle = Field(ge=1e-6, le=0.5)
    """Full angle of the round field that the diode sees through the lens."""
    place: Literal["coaxial", "offset"]
    """Behind the laser's own axis, or behind the lens at the triangulation base, with a field from infinity inwards."""
    noise: PhotodiodeNoise = PhotodiodeNoise()
    """A switch for every term."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a response that does not ascend, and dark current that saturates the amplifier."""
        if not 0.0 < self.response[0] < self.response[1]:
            yield Fault(
                "response", "the wavelengths must ascend from above 0 m.", "Write [shortest, longest]."
            )
        dark = self.surface_dark_current + self.gain * self.bulk_dark_current
        if dark > self.saturation:
            yield Fault(
                "saturation",
                f"the dark current of {dark:.3g} A is larger than the {self.saturation:.3g} A of the amplifier.",
                "Raise the saturation, or reduce gain and dark currents.",
            )

    @property
    def excess_noise(self) -> float:
        """Excess noise factor F = k M + (1 − k)(2 − 1/M) (McIntyre, *IEEE Trans. Electron Devices* 13, 1966)."""
        k = self.ionisation_ratio
        return k * self.gain + (1.0 - k) * (2.0 - 1.0 / self.gain)

    @property
    def amperes_per_watt(self) -> float:
        """Current behind the avalanche per light, M R₀ [A/W]."""
        return self.gain * self.responsivity

    @property
    def response_sigma(self) -> float:
        """Standard deviation of the electronics' impulse response [s]."""
        return math.sqrt(math.log(2.0)) / (2.0 * math.pi * self.bandwidth)

    @property
    def noise_bandwidth(self) -> float:
        """Equivalent noise bandwidth ∫|H|² df = 1/(4√π σ_h) [Hz]; 1.064 times the −3 dB bandwidth."""
        return 1.0 / (4.0 * math.sqrt(math.pi) * self.response_sigma)

    @property
    def light_variance(self) -> float:
        """Variance of the current per light, 2 q M² F R₀ B_n [A²/W]."""
        shot = 2.0 * ELEMENTARY_CHARGE * self.gain**2 * self.excess_noise * self.responsivity
        return shot * self.noise_bandwidth if self.noise.shot else 0.0

    @property
    def dark_variance(self) -> float:
        """Variance of the current without light [A²], before the converter: 2q (M² F I_db + I_ds) B_n + i² B_n."""
        shot = self.gain**2 * self.excess_noise * self.bulk_dark_current + self.surface_dark_current
        variance = 2.0 * ELEMENTARY_CHARGE * shot * self.noise_bandwidth if self.noise.shot else 0.0
        return variance + (self.amplifier_noise**2 * self.noise_bandwidth if self.noise.amplifier else 0.0)


class Digitiser(Part):
    """The converter that records a waveform from each shot, and its clock."""

    rate: Frequency = Field(ge=1e6, le=1e12)
    """Samples per second."""
    bits: Count = Field(ge=4, le=24)
    """Bits of the converter; its range reaches from −1/16 of the amplifier's saturation to all of it."""
    gate: tuple[Length, Length] = Field(examples=[["0.5 m", "35 m"]])
    """Nearest and farthest range that is recorded."""
    jitter: Time = Field(ge=0.0, le=1e-6)
    """Standard deviation, per shot, of the time between pulse and clock."""
    drift: Ratio = Field(ge=-0.01, le=0.01)
    """Relative error of the clock's frequency, which the instrument does not know of."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a gate that does not ascend and a record too long to keep."""
        if not 0.0 <= self.gate[0] < self.gate[1]:
            yield Fault("gate", "the ranges must ascend from 0 m or more.", "Write [nearest, farthest].")
        elif self.samples > _LONGEST:
            yield Fault(
                "gate",
                f"at this rate it asks for {self.samples} samples per shot; {_LONGEST} are possible.",
                "Narrow the gate, or lower the rate.",
            )

    @property
    def start(self) -> float:
        """Time of the first sample after the pulse [s]; it may lie before the pulse."""
        return 2.0 * self.gate[0] / SPEED_OF_LIGHT - _MARGIN

    @property
    def samples(self) -> int:
        """Number of samples of a record, a multiple of 4."""
        time = 2.0 * (self.gate[1] - self.gate[0]) / SPEED_OF_LIGHT + 2.0 * _MARGIN
        return 4 * math.ceil(time * self.rate / 4.0)

    @property
    def middle(self) -> float:
        """Time of the middle of a record after the pulse [s]."""
        return self.start + 0.5 * self.samples / self.rate

    def step(self, saturation: float) -> float:
        """Return the current [A] of one digital number for an amplifier that saturates at a current [A]."""
        return saturation * 17.0 / 16.0 / (2.0**self.bits - 1.0)


def background_power(
    radiance: float, aperture_area: float, transmission: float, field_of_view: float
) -> float:
    """Return the light [W] that an evenly bright background sends into the field of view: L A Ω T.

    Parameters
    ----------
    radiance
        In-band radiance [W/m²/sr]; of a Lambertian surface in the Sun E ρ cosζ/π.
    aperture_area
        Area of the lens [m²].
    transmission
        Of lens and filter.
    field_of_view
        Full angle of the round field [rad]; its solid angle is 2π(1 − cos(angle/2)).
    """
    solid_angle = 4.0 * math.pi * math.sin(0.25 * field_of_view) ** 2
    return radiance * aperture_area * solid_angle * transmission
