"""One direction: shots one after the other with mirrors at rest, as a gauge measures a point over time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Count, Part
from scanner_sim.foundation.units import Angle, Time
from scanner_sim.scan.protocol import MOST_LISTED, Aim, Ends, ScanSetup, Sweep, beyond_mirrors

_EARLY = 1e-6
"""Share of a dwell by which a rounded interval may be too short."""


class FixedScan(Part):
    """Shots in one direction at even times: the mirrors rest."""

    layout: ClassVar[Literal["shots"]] = "shots"
    shots_per_row: ClassVar[int] = 1
    even_travel: ClassVar[None] = None

    type: Literal["fixed"]
    """Kind of scan."""
    direction: tuple[Angle, Angle] = Field(default=(0.0, 0.0), examples=[["2 deg", "-1 deg"]])
    """Θ and φ of all shots."""
    points: Count = Field(default=1024, ge=1, le=MOST_LISTED)
    """Number of shots."""
    interval: Time | None = Field(default=None, gt=0.0, le=1e6, examples=["1 ms"])
    """Time from one shot to the next; by default a dwell, so that one follows the other."""

    @property
    def shots(self) -> int:
        """Number of shots."""
        return self.points

    @property
    def horizontal(self) -> Ends:
        """Θ, twice [rad]."""
        return self.direction[0], self.direction[0]

    @property
    def vertical(self) -> Ends:
        """φ, twice [rad]."""
        return self.direction[1], self.direction[1]

    @property
    def summary(self) -> str:
        """Its shots in a phrase."""
        return f"{self.points:,} in one direction"

    def scan_time(self, setup: ScanSetup) -> float:
        """Return how long it takes on the instrument [s]."""
        return (self.points - 1) * self._step(setup) + setup.dwell

    def aims(self, setup: ScanSetup, batch: int) -> Iterator[Aim]:
        """Yield the shots in the order of time."""
        shot = np.arange(self.points, dtype=np.uint32)
        time = shot.astype(np.float64) * self._step(setup) + 0.5 * setup.dwell
        (theta, phi), rest = (np.full(self.points, angle) for angle in self.direction), np.zeros(self.points)
        return Aim(shot, theta, phi, time, rest, rest).batches(batch)

    def sweep(self, setup: ScanSetup) -> Sweep:  # noqa: ARG002 (other scans need it)
        """Return that the beam does not move."""
        return Sweep(0.0, "scan.direction", "")

    def faults(self, setup: ScanSetup) -> Iterator[Fault]:
        """Yield a direction beyond the mirrors, and shots that begin before the one before has ended."""
        for ends in (self.horizontal, self.vertical):
            yield from beyond_mirrors("scan.direction", ends, setup.mirrors, "Choose another one")
        if self._step(setup) < (1.0 - _EARLY) * setup.dwell:
            yield Fault(
                "scan.interval",
                f"{self.interval:.4g} s is shorter than a dwell, {setup.dwell:.4g} s.",
                "Raise it, or raise scanner.rate.",
            )

    def warnings(self, setup: ScanSetup) -> Iterator[str]:  # noqa: ARG002 (as above)
        """Yield nothing: mirrors can always rest."""
        return iter(())

    def _step(self, setup: ScanSetup) -> float:
        return setup.dwell if self.interval is None else self.interval
