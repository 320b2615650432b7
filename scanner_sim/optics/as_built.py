"""The instrument as it was built: how it departs from its design, and what of it changes from shot to shot.

What a scenario's ``scanner`` says is the design, by which the instrument reckons. Light and detectors follow what
stands here, and no estimator reads it. A departure is given, or drawn from a tolerance by a seed.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Tag

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parameters import NAMES, PARAMETERS, PERIODIC
from scanner_sim.foundation.parts import Count, Part
from scanner_sim.foundation.streams import Stream, host_generator
from scanner_sim.foundation.units import Angle, Dimension, Length, Ratio, RatioPerKelvin
from scanner_sim.optics.vibration import Vibration

Array = NDArray[np.float64]

PerSquareAngle = Annotated[float, Dimension("rad^-2", ("1e-4 rad^-2",))]


class LengthTolerance(Part):
    """A length that is drawn."""

    tolerance: Length = Field(ge=0.0, le=1.0)
    """Standard deviation; the value is a normal number of the seed, with the mean 0."""


class AngleTolerance(Part):
    """An angle that is drawn."""

    tolerance: Angle = Field(ge=0.0, le=0.5)
    """Standard deviation; the value is a normal number of the seed, with the mean 0."""


class RatioTolerance(Part):
    """A ratio that is drawn."""

    tolerance: Ratio = Field(ge=0.0, le=10.0)
    """Standard deviation; the value is a normal number of the seed, with the mean 0."""


class CubicTolerance(Part):
    """A third order that is drawn."""

    tolerance: PerSquareAngle = Field(ge=0.0, le=10.0)
    """Standard deviation; the value is a normal number of the seed, with the mean 0."""


def _spelling(value: object) -> str:
    return "(tolerance)" if isinstance(value, dict | Part) else "(value)"


_CHOICE = Discriminator(_spelling)
LengthDeparture = Annotated[
    Annotated[Length, Tag("(value)")] | Annotated[LengthTolerance, Tag("(tolerance)")],
    _CHOICE,
    Field(examples=["0.1 mm"]),
]
AngleDeparture = Annotated[
    Annotated[Angle, Tag("(value)")] | Annotated[AngleTolerance, Tag("(tolerance)")],
    _CHOICE,
    Field(examples=["50 urad"]),
]
RatioDeparture = Annotated[
    Annotated[Ratio, Tag("(value)")] | Annotated[RatioTolerance, Tag("(tolerance)")],
    _CHOICE,
    Field(examples=[1e-4]),
]
CubicDeparture = Annotated[
    Annotated[PerSquareAngle, Tag("(value)")] | Annotated[CubicTolerance, Tag("(tolerance)")],
    _CHOICE,
    Field(examples=["1e-4 rad^-2"]),
]
Tolerance = LengthTolerance | AngleTolerance | RatioTolerance | CubicTolerance

_FARTHEST = {"m": 0.1, "rad": 0.1, "1": 2.0}
"""Departures beyond which it is another instrument, by unit."""


class AsBuilt(Part):
    """How the instrument departs from its design: each key is a value, or ``{tolerance: …}`` from which it is drawn.

    Signs are drawn on the page *The error model*.
    """

    seed: Count | None = Field(default=None, ge=0, lt=2**63)
    """Serial number of the instrument: seed of what is drawn. By default the scenario's, or
    ``transport.light_seed``."""
    base: LengthDeparture | None = None
    """The lens's node is farther from the laser's axis."""
    focal_length: LengthDeparture | None = None
    """The image distance is longer."""
    axis_separation: LengthDeparture | None = None
    """The second axis is farther from the first one."""
    axis_offset: LengthDeparture | None = None
    """The second axis passes below the beam, towards +y."""
    axis_skew: AngleDeparture | None = None
    """The second axis is turned about z, from +x towards +y: it is not square to the first."""
    theta_zero: AngleDeparture | None = None
    """The beam points further along Θ than the encoder reads."""
    phi_zero: AngleDeparture | None = None
    """The beam points further along φ than the encoder reads."""
    theta_scale: RatioDeparture | None = None
    """The same, growing with Θ."""
    phi_scale: RatioDeparture | None = None
    """The same, growing with φ."""
    theta_cubic: CubicDeparture | None = None
    """The same, growing with Θ³."""
    phi_cubic: CubicDeparture | None = None
    """The same, growing with φ³."""
    encoder_period: Angle | None = Field(default=None, gt=1e-6, le=7.0, examples=["30 mrad"])
    """Period of the encoders' periodic errors, which need it."""
    theta_sine: AngleDeparture | None = None
    """The same, as sin(2π Θ/encoder_period)."""
    theta_cosine: AngleDeparture | None = None
    """The same, as cos(2π Θ/encoder_period)."""
    phi_sine: AngleDeparture | None = None
    """The same, as sin(2π φ/encoder_period)."""
    phi_cosine: AngleDeparture | None = None
    """The same, as cos(2π φ/encoder_period)."""
    array_offset: LengthDeparture | None = None
    """The array is shifted towards nearer ranges, +p."""
    array_scale: RatioDeparture | None = None
    """The pixels are wider apart, relative to their pitch."""
    array_tilt: AngleDeparture | None = None
    """The array's near end (+p) leans away from the lens."""
    radial_1: RatioDeparture | None = None
    """Radial distortion k₁ of the lens, of the third power of p/f."""
    radial_2: RatioDeparture | None = None
    """Radial distortion k₂ of the lens, of the fifth power of p/f."""
    tangential: RatioDeparture | None = None
    """Tangential distortion p₂ of the lens, along the line."""
    tangential_across: Ratio | None = Field(default=None, ge=-1.0, le=1.0)
    """Tangential distortion p₁ of the lens: it moves the spot across the line, and no range."""
    tof_zero: LengthDeparture | None = None
    """Time of flight reads this much too far."""
    tof_scale: RatioDeparture | None = None
    """Delays of time of flight read too long, relative to themselves."""
    field_blur: Length | None = Field(default=None, ge=0.0, le=1e-2)
    """Standard deviation by which the lens spreads the light at the array's near end, beside ``receiver.aberration``;
    it grows from the image of infinity with p²."""
    base_expansion: RatioPerKelvin | None = Field(default=None, ge=-1e-2, le=1e-2)
    """By how much the base grows with ``mirrors.temperature``."""
    focal_expansion: RatioPerKelvin | None = Field(default=None, ge=-1e-2, le=1e-2)
    """By how much the image distance grows with it. The zeros' coefficient is ``mirrors.drift_zero``."""
    power_noise: Ratio | None = Field(default=None, ge=0.0, le=0.3)
    """Standard deviation of the laser's power from shot to shot, relative."""
    pulse_noise: Ratio | None = Field(default=None, ge=0.0, le=0.3)
    """The same of the pulses' energy."""
    stray_light: Ratio | None = Field(default=None, ge=0.0, le=0.5)
    """Share of the light in the line's field that is scattered evenly over all pixels (veiling glare, ISO 9358)."""
    vibration: Vibration | None = None
    """The platform shakes the whole scanner, for each seed of the scenario, or ``transport.light_seed``, otherwise."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield periodic errors without a period, and departures of another instrument."""
        if self.encoder_period is None and any(getattr(self, name) for name in PERIODIC):
            yield Fault(
                "encoder_period",
                "the encoders have periodic errors, and their period is not given.",
                "Write for example 30 mrad.",
            )
        for parameter in PARAMETERS:
            value, limit = getattr(self, parameter.name), _FARTHEST.get(parameter.dimension.unit, 10.0)
            if isinstance(value, float) and abs(value) > limit:
                problem = f"{parameter.dimension.format(value)} is more than a departure from the design."
                yield Fault(parameter.name, problem, "Change the design, or check the unit.")

    @property
    def is_drawn(self) -> bool:
        """Whether anything is drawn, so that another seed means another instrument."""
        return any(isinstance(getattr(self, name), Part) for name in NAMES)

    def parameters(self, seed: int) -> Array:
        """Return the true parameters in SI, in the order of ``PARAMETERS``, shape (parameters,).

        ``seed`` is for what is drawn; the instrument's own goes before. Each parameter has numbers of its own.
        """
        own = seed if self.seed is None else self.seed
        return np.array([_value(getattr(self, name), own, number) for number, name in enumerate(NAMES)])


def _value(given: float | Tolerance | None, seed: int, number: int) -> float:
    if given is None or isinstance(given, float):
        return given or 0.0
    return given.tolerance * float(host_generator(seed, Stream.BUILT, number).standard_normal())
