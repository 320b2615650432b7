"""Lissajous figures in the open loop: a pattern about one direction, again and again, whatever is seen."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Count, Part
from scanner_sim.foundation.units import Angle, Time
from scanner_sim.scan.lissajous import LissajousPattern
from scanner_sim.scan.protocol import MOST_LISTED, Aim, Ends, ScanSetup, Sweep, beyond_mirrors, too_many
from scanner_sim.scan.schedule import Visiting, pattern_warnings, run_visit
from scanner_sim.scan.ways import mirrors_at

_RETRACED = 1e-3
"""Difference from a figure that runs to and fro, in half turns, below which it looks like one."""


class LissajousScan(Part):
    """One Lissajous figure (eqs 6 and 7) or several, run by the mirrors' servos without looking at the result."""

    layout: ClassVar[Literal["shots"]] = "shots"
    shots_per_row: ClassVar[int] = 1
    even_travel: ClassVar[None] = None

    type: Literal["lissajous"]
    """Kind of scan."""
    pattern: LissajousPattern = LissajousPattern(amplitude=0.1, points=2048)
    """The figure and its points. Dither and inversion make the figures that follow one another differ."""
    centre: tuple[Angle, Angle] = Field(default=(0.0, 0.0), examples=[["2 deg", "-1 deg"]])
    """Θ and φ of its middle."""
    patterns: Count = Field(default=1, ge=1, le=MOST_LISTED)
    """How often it is run."""
    turnaround: Time = Field(default=0.2e-3, ge=0.0, le=1.0)
    """Time in which the mirrors turn from the end of a figure into the next; longer where they need longer."""

    @property
    def shots(self) -> int:
        """Number of shots."""
        return self.patterns * self.pattern.points

    @property
    def horizontal(self) -> Ends:
        """First and last Θ [rad]."""
        return self._ends(0)

    @property
    def vertical(self) -> Ends:
        """First and last φ [rad]."""
        return self._ends(1)

    @property
    def summary(self) -> str:
        """Its shots in a phrase."""
        return (
            f"{self.patterns:,} × {self.pattern.points:,} = {self.shots:,} on a figure {self.pattern.ratio}"
        )

    def scan_time(self, setup: ScanSetup) -> float:
        """Return how long it takes [s] where the mirrors turn round in time."""
        return self.patterns * (self.turnaround + self.pattern.points * setup.dwell)

    def aims(self, setup: ScanSetup, batch: int) -> Iterator[Aim]:
        """Yield the shots figure by figure, as the servos follow: from rest in the middle on."""
        mirrors, dwell, points = mirrors_at(*self.centre), setup.dwell, self.pattern.points
        visiting = Visiting(turnaround=self.turnaround)
        columns: list[list[NDArray[np.float64]]] = [[] for _ in range(5)]
        for number in range(self.patterns):
            motion, mirrors = run_visit(
                setup.galvanometers,
                mirrors,
                self.pattern,
                number,
                self.centre,
                start=mirrors.time,  # or as soon as they have turned round
                dwell=dwell,
                visiting=visiting,
            )
            parts = motion.true_theta, motion.true_phi, motion.time, motion.travel_theta, motion.travel_phi
            for column, part in zip(columns, parts, strict=True):
                column.append(part)
        shot = np.arange(self.patterns * points, dtype=np.uint32)
        return Aim(shot, *(np.concatenate(column) for column in columns)).batches(batch)

    def sweep(self, setup: ScanSetup) -> Sweep:  # noqa: ARG002 (other scans need it)
        """Return by how much the beam moves where it is fastest while a shot is measured, without lag."""
        m, n = self.pattern.cycles
        turn = 2.0 * np.pi * self.pattern.amplitude / self.pattern.points
        return Sweep(
            float(turn * np.hypot(m, n * self.pattern.aspect)),
            "scan.pattern.points",
            "use more points or a smaller amplitude",
        )

    def faults(self, setup: ScanSetup) -> Iterator[Fault]:
        """Yield figures beyond the mirrors, and more shots than a table holds."""
        yield from too_many("scan.patterns", self.shots)
        for ends in (self.horizontal, self.vertical):
            yield from beyond_mirrors(
                "scan.pattern.amplitude", ends, setup.mirrors, "Lower it, move scan.centre"
            )

    def warnings(self, setup: ScanSetup) -> Iterator[str]:
        """Yield amplitudes that the mirrors cannot follow, and figures that run to and fro on one curve."""
        (m, n), (first, second) = self.pattern.cycles, self.pattern.phases
        # Reversed about a time c the figure is itself where m c + 2 φ_x and n c + 2 φ_y are both whole turns.
        apart = (second * m - first * n) / np.pi
        if self.pattern.dither_phase == 0.0 and abs(apart - round(apart)) < _RETRACED:
            yield (
                f"scan.pattern.phases: with these a figure {self.pattern.ratio} runs to and fro on one curve, and half "
                "of its shots see nothing new; write for example phases: [0 deg, -90 deg], or cycles of which one is "
                "even"
            )
        yield from pattern_warnings(self.pattern, setup.galvanometers, setup.dwell)

    def _ends(self, axis: int) -> Ends:
        size = (
            self.pattern.amplitude * (1.0, self.pattern.aspect)[axis] * (1.0 + self.pattern.dither_position)
        )
        return self.centre[axis] - size, self.centre[axis] + size
