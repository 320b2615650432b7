"""How long a frame is exposed: a fixed time, or a control that follows the brightness of earlier frames."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Tag

from scanner_sim.detector.frame.sensor import FrameSensor, Pattern, held_charge, mean_charge
from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Count, Part
from scanner_sim.foundation.units import Ratio, Time

_SETTLING = 200
"""Frames after which a control has settled, or never does."""
_DARKEST = 1e-3
"""Least level that the control believes, of the converter's range."""


class FixedExposure(Part):
    """All frames are exposed alike."""

    type: Literal["fixed"]
    """``fixed``."""
    time: Time = Field(gt=0.0, le=100.0, examples=["2 ms"])
    """How long."""


class AutomaticExposure(Part):
    """The time of each frame follows the level of an earlier one: t' = t (target/level)^rate, between its limits.

    The logarithm of what is missing shrinks by 1 − rate from frame to frame, if the lag is one frame.
    """

    type: Literal["automatic"]
    """``automatic``."""
    measure: Literal["mean", "percentile"] = "mean"
    """What is held at the target: the mean of the frame, or a percentile of its pixels."""
    percentile: Ratio = Field(default=0.95, gt=0.0, lt=1.0)
    """Share of the pixels that shall be darker than the target, where ``measure`` is ``percentile``."""
    target: Ratio = Field(default=0.35, gt=0.0, lt=1.0)
    """Level that is aimed at, over the converter's range above black."""
    shortest: Time = Field(default=1e-4, gt=0.0, le=100.0)
    """Shortest exposure."""
    longest: Time = Field(default=1.0 / 30.0, gt=0.0, le=100.0)
    """Longest exposure."""
    rate: Ratio = Field(default=0.5, gt=0.0, le=1.0)
    """Exponent of the correction in one frame: 1 corrects all of it at once."""
    lag: Count = Field(default=2, ge=1, le=16)
    """Frames from the one that is measured to the first that follows it."""
    start: Time | None = Field(default=None, gt=0.0, le=100.0)
    """Exposure of the first frames, before the control has seen any; by default what it settles at on the first."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield limits that do not ascend, and a first exposure beyond them."""
        if not self.shortest < self.longest:
            yield Fault(
                "longest",
                "it is not above shortest.",
                "Write a longest that is above shortest, or type: fixed.",
            )
        elif self.start is not None and not self.shortest <= self.start <= self.longest:
            yield Fault(
                "start",
                f"{self.start:.4g} s is not between shortest, {self.shortest:.4g} s, and longest, "
                f"{self.longest:.4g} s.",
                "Write an exposure between them, or leave it out.",
            )

    def level(self, sensor: FrameSensor, counts: NDArray[np.floating] | NDArray[np.uint16]) -> float:
        """Return the level of a frame, 0 to 1."""
        span = sensor.largest_number - sensor.black_level
        mean = self.measure == "mean"
        shown = float(counts.mean() if mean else np.quantile(counts, self.percentile))
        return (shown - sensor.black_level) / span

    def following(self, time: float, level: float) -> float:
        """Return the exposure [s] that follows a frame of an exposure and a level."""
        wanted: float = time * (self.target / max(level, _DARKEST)) ** self.rate
        return min(max(wanted, self.shortest), self.longest)

    def settled(self, sensor: FrameSensor, rate: NDArray[np.float64]) -> float:
        """Return the exposure [s] at which the control settles on light that stays, without noise.

        ``rate`` are mean electrons per second, shape (rows, columns). Frames are as the sensor makes them of it:
        full pixels count as full, and fill their columns where the sensor blooms.
        """
        even = np.ones(rate.shape)
        time = self.start or self.longest
        for _ in range(_SETTLING):
            held = held_charge(sensor, mean_charge(sensor, rate, time, Pattern(even, even)))
            number = sensor.black_level + held / sensor.electrons_per_number
            level = self.level(sensor, np.minimum(number, sensor.largest_number))
            before, time = time, self.following(time, level)
            if abs(time - before) < 1e-9 * before:
                break
        return time


ExposureChoice = Annotated[
    Annotated[FixedExposure, Tag("(fixed)")] | Annotated[AutomaticExposure, Tag("(automatic)")],
    Discriminator(
        lambda value: (
            f"({value.get('type', 'automatic') if isinstance(value, dict) else getattr(value, 'type', 'automatic')})"
        )
    ),
    Field(examples=[{"type": "fixed", "time": "2 ms"}]),
]
"""A fixed exposure, or an automatic one."""
