"""How the echo in a waveform is found and timed."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from scanner_sim.foundation.parts import Part, Switch
from scanner_sim.foundation.units import Current, Ratio

Timing = Literal["matched_filter", "leading_edge", "constant_fraction", "gaussian_fit"]


class PulseDetection(Part):
    """Settings of the time-of-flight detection."""

    timing: Timing = "matched_filter"
    """How an echo is timed; ``matched_filter`` comes nearest to the Cramér–Rao bound."""
    echo: Literal["first", "last", "strongest"] = "strongest"
    """Which one counts where there are several."""
    false_alarms: Ratio = Field(default=1e-4, ge=1e-12, le=0.5)
    """Probability that the noise of a record without any echo is taken for one; it sets the threshold."""
    level: Current | None = Field(default=None, gt=0.0, le=10.0)
    """Current whose crossing ``leading_edge`` times; by default the threshold in the dark."""
    walk_correction: Switch = True
    """Correct ``leading_edge`` for the amplitude, by a table over the time above the level."""
    fraction: Ratio = Field(default=0.5, ge=0.05, le=0.95)
    """Fraction of the peak whose crossing ``constant_fraction`` times."""
    overlap: Switch = True
    """Refuse pulses that are wider than any one surface makes them: echoes of two overlap, and their delay is of
    neither."""
