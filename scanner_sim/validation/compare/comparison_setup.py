"""The setting of a comparison: whose instrument, before which targets, with how much effort."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from pydantic import TypeAdapter, ValidationError

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.units import Length, Ratio
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.signals.processing import PEAKS
from scanner_sim.signals.waveform.settings import PULSES
from scanner_sim.validation.compare.closed_forms import NO_FORMS, ClosedForms, EstimatorForms
from scanner_sim.validation.studies.budget import NEAREST

REFLECTANCE = 0.5
"""Of the flat targets, where none is asked for."""
RANGES = 5
"""Number of their ranges."""
FARTHEST = 25.0
"""Farthest of them for an array [m], which may see infinity."""
FEWEST_FOR_SLOPE = 3
_MARGIN = 1.15
"""Nearest range of a target over that which the array sees."""
_EXAMPLE = "Write for example --target '50 % at 3 m, 10 m, 20 m'."

_NEAREST, _FARTHEST, _MOST_RANGES = 0.01, 1e4, 100
"""Ranges of targets that the user may ask for [m], and how many."""


@dataclass(frozen=True)
class FlatTarget:
    """Flat Lambertian targets: their reflectance, and the ranges [m] at which they stand, ascending."""

    reflectance: float
    ranges: tuple[float, ...]

    def __str__(self) -> str:
        """Return the targets in words."""
        return f"{100.0 * self.reflectance:.4g} % at " + ", ".join(f"{R:.4g} m" for R in self.ranges)

    @classmethod
    def parse(cls, text: str) -> FlatTarget:
        """Return the targets that a text names, as ``50 % at 3 m, 10 m`` or ``10 m``.

        Raises
        ------
        InputError
            If it names none.
        """
        reflectance, at, ranges = text.rpartition(" at ")
        try:
            grey = TypeAdapter(Ratio).validate_python(reflectance.strip()) if at else REFLECTANCE
            found = sorted(TypeAdapter(Length).validate_python(part.strip()) for part in ranges.split(","))
        except ValidationError as error:
            raise InputError(f"--target: {error.errors()[0]['msg']}.", remedy=_EXAMPLE) from None
        if not 0.0 < grey <= 1.0:
            raise InputError(f"--target: a reflectance of {grey:g} is not between 0 and 1.", remedy=_EXAMPLE)
        if not _NEAREST <= found[0] <= found[-1] <= _FARTHEST or len(found) > _MOST_RANGES:
            raise InputError(
                f"--target: ranges are {_NEAREST:g} m to {_FARTHEST:g} m, and at most {_MOST_RANGES} of them.",
                remedy=_EXAMPLE,
            )
        if len({f"{R:.4g}" for R in found}) < len(found):
            raise InputError(
                "--target: two of the ranges are the same to four digits, by which the cases of a law are told apart.",
                remedy=_EXAMPLE,
            )
        return cls(grey, tuple(found))


@dataclass(frozen=True)
class ComparisonSetup:
    """What laws are judged on.

    Attributes
    ----------
    scenario
        Instrument, processing and own scene.
    target
        Flat targets that the user asked for instead of the scene; None for the scene.
    seeds
        Number of consecutive seeds whose samples are pooled.
    quick
        Whether to take a quarter of the shots.
    device
        Where to compute.
    closed_forms
        Of an estimator of the peak that is the user's own.
    """

    scenario: Scenario
    target: FlatTarget | None = None
    seeds: int = 1
    quick: bool = False
    device: DeviceChoice = "auto"
    closed_forms: EstimatorForms = NO_FORMS

    @property
    def closed(self) -> ClosedForms:
        """The judge's view of the instrument and of its estimator."""
        return ClosedForms(self.scenario, self.closed_forms)

    @property
    def own_peak(self) -> str:
        """Name of the scenario's estimator of the peak where it is the user's own; empty for the program's."""
        name = self.scenario.processing.peak
        return name if PEAKS.is_own(name) else ""

    @property
    def own_pulse(self) -> str:
        """Name of its timing of echoes likewise."""
        name = self.scenario.processing.pulse.timing
        return name if PULSES.is_own(name) else ""

    @property
    def flat(self) -> FlatTarget:
        """The flat targets: those asked for, or five from the nearest range of the array to 25 m, or over the gate."""
        return self.target or FlatTarget(REFLECTANCE, self._ranges())

    @property
    def own_scene(self) -> bool:
        """Whether laws of a scene are judged on the scenario's own."""
        return self.target is None

    @property
    def middle(self) -> float:
        """The target's range [m] next to the middle of all."""
        ranges = self.flat.ranges
        return ranges[len(ranges) // 2]

    def shots(self, number: int) -> int:
        """Return how many shots to take for a number in a thorough comparison with one seed."""
        return number // 4 if self.quick else number

    def seed(self, *positions: int) -> tuple[int, ...]:
        """Return seeds of a measurement, one for each of the setting's, apart from those of other positions."""
        apart = sum(
            position * factor for position, factor in zip(positions, (1009, 100_003, 7), strict=False)
        )
        return tuple(
            (self.scenario.seed + number + 1_000_003 * (apart + 1)) % 2**63 for number in range(self.seeds)
        )

    def slopeless(self) -> str:
        """Return why there is no slope against range; empty where there is one."""
        if len(self.flat.ranges) >= FEWEST_FOR_SLOPE:
            return ""
        return f"a slope needs {FEWEST_FOR_SLOPE} ranges of the target, and there are {len(self.flat.ranges)}"

    def _ranges(self) -> tuple[float, ...]:
        first, *_ = self.scenario.scanner.rangefinders
        nearest, farthest = self.scenario.scanner.seen_by(first)
        low, high = _MARGIN * (nearest or NEAREST), farthest / _MARGIN
        if first == "triangulation":
            high = min(FARTHEST, high)
        if low >= high:
            raise InputError(
                f"the array sees ranges from {nearest:.4g} m to {farthest:.4g} m only, none of them below 25 m.",
                remedy="Name a target's range with --target, as --target '50 % at 40 m'.",
            )
        return tuple(float(f"{R:.3g}") for R in np.geomspace(low, high, RANGES))


def law_name(text: str) -> str:
    """Return a word of an option as a law's name: small letters, underscores."""
    return re.sub(r"[\s-]+", "_", text.strip().lower())
