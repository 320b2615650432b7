"""How the sensor's line is processed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from pydantic import Field

from scanner_sim.errors import Fault
from scanner_sim.parts import Number, Part
from scanner_sim.units import Length

PeakMethod = Literal[
    "centre_of_mass", "parabola", "gaussian", "blais_rioux_2", "blais_rioux_4", "blais_rioux_8"
]


class Processing(Part):
    """Peak detection and validation."""

    peak: PeakMethod = "gaussian"
    """Estimator of the sub-pixel position."""
    threshold: Number = Field(default=6.0, ge=0.0, le=1e6)
    """Least height of a peak, in standard deviations of the dark line (read, dark and quantisation noise)."""
    ambiguity: Number = Field(default=0.5, gt=0.0, le=1.0)
    """A second, separate peak higher than this share of the first makes the shot ambiguous."""
    range_gate: tuple[Length, Length] | None = Field(default=None, examples=[["2 m", "30 m"]])
    """Nearest and farthest range that is accepted; by default all that the array sees."""

    def contradictions(self) -> Iterator[Fault]:
        """Yield a range gate that does not ascend."""
        if self.range_gate is not None and not 0.0 <= self.range_gate[0] < self.range_gate[1]:
            yield Fault("range_gate", "the gate must ascend from 0 m or more.", "Write [nearest, farthest].")
