"""A spiral from the inside outwards, run at an even speed: shots at even distances on arms at even distances."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Count, Number, Part
from scanner_sim.foundation.units import Angle
from scanner_sim.optics.galvanometer import at_rest, follow
from scanner_sim.scan.protocol import MOST_LISTED, Aim, Ends, ScanSetup, Sweep, beyond_mirrors

Array = NDArray[np.float64]

_UPDATES = 4
"""Updates of the drive's command in a dwell."""
_CATCH_UP_LAGS = 10.0
"""Lags of the servo after which it has caught up with the spiral's beginning, which it meets at rest."""
_POINTS_TOGETHER = 1 << 16
"""Shots whose mirrors are followed together: bounds the memory."""
_ITERATIONS = 60
"""Of Newton's method, which needs four or five."""


class SpiralScan(Part):
    """An Archimedean spiral: Θ = Θ₀ + c ψ cos ψ, φ = φ₀ + c ψ sin ψ, with the length of its arc even in time."""

    layout: ClassVar[Literal["shots"]] = "shots"
    shots_per_row: ClassVar[int] = 1
    even_travel: ClassVar[None] = None

    type: Literal["spiral"]
    """Kind of scan."""
    radius: Angle = Field(gt=0.0, lt=1.5, examples=["5 deg"])
    """Angle from the middle to the outer end."""
    turns: Number = Field(default=20.0, gt=0.0, le=1e5)
    """Turns from the middle to the outer end; neighbouring arms are radius/turns apart."""
    points: Count = Field(default=8192, ge=8, le=MOST_LISTED)
    """Number of shots."""
    centre: tuple[Angle, Angle] = Field(default=(0.0, 0.0), examples=[["2 deg", "-1 deg"]])
    """Θ and φ of its middle."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield spirals with too few points for their turns."""
        if self.points < 8.0 * self.turns:
            yield Fault(
                "points",
                f"{self.points} points sample {self.turns:g} turns with fewer than eight points each.",
                f"Write at least {math.ceil(8.0 * self.turns)}, or fewer turns.",
            )

    @property
    def shots(self) -> int:
        """Number of shots."""
        return self.points

    @property
    def horizontal(self) -> Ends:
        """First and last Θ [rad]."""
        return self.centre[0] - self.radius, self.centre[0] + self.radius

    @property
    def vertical(self) -> Ends:
        """First and last φ [rad]."""
        return self.centre[1] - self.radius, self.centre[1] + self.radius

    @property
    def summary(self) -> str:
        """Its shots in a phrase."""
        return f"{self.points:,} on a spiral of {self.turns:g} turns"

    def scan_time(self, setup: ScanSetup) -> float:
        """Return how long it takes on the instrument [s]."""
        return self.points * setup.dwell

    def aims(self, setup: ScanSetup, batch: int) -> Iterator[Aim]:
        """Yield the shots from the middle outwards, as the servos follow: from rest in the middle on."""
        (theta, phi), rate, _ = self._motion(setup)
        travel_theta, travel_phi = rate * setup.dwell
        shot = np.arange(self.points, dtype=np.uint32)
        time = (shot.astype(np.float64) + 0.5) * setup.dwell
        return Aim(shot, theta, phi, time, travel_theta, travel_phi).batches(batch)

    def sweep(self, setup: ScanSetup) -> Sweep:  # noqa: ARG002 (other scans need it)
        """Return by how much the beam moves while a shot is measured, without lag."""
        return Sweep(
            self._length / self.points, "scan.points", "use more points, fewer turns or a smaller radius"
        )

    def faults(self, setup: ScanSetup) -> Iterator[Fault]:
        """Yield spirals beyond the mirrors."""
        for ends in (self.horizontal, self.vertical):
            yield from beyond_mirrors("scan.radius", ends, setup.mirrors, "Lower it, move scan.centre")

    def warnings(self, setup: ScanSetup) -> Iterator[str]:
        """Yield spirals that the mirrors cannot follow after their start."""
        servos = setup.galvanometers
        late = math.ceil(_CATCH_UP_LAGS * servos.lag * _UPDATES / setup.dwell)
        limited = self._motion(setup)[2][late:]
        share = float(limited.mean()) if limited.size else 0.0
        if share > 0.0:
            yield (
                f"scan.points: the mirrors are at their limits for {100.0 * share:.2g} % of the spiral and leave it; "
                "use more points, fewer turns or a smaller radius"
            )

    def curve(self, share: Array) -> Array:
        """Return Θ and φ at shares of the whole arc's length, shape (2, n) [rad].

        The arc from the middle to ψ is c/2 (ψ √(1 + ψ²) + asinh ψ) long; it is inverted by Newton's method.
        """
        wanted = share * _arc(2.0 * math.pi * self.turns)
        # s is right for short arcs and √(2 s) for long ones. Neither is below the root, and from above it converges:
        # the arc is a convex function of the angle.
        angle = np.minimum(wanted, np.sqrt(2.0 * wanted))
        for _ in range(_ITERATIONS):
            step = (wanted - _arc(angle)) / np.hypot(1.0, angle)
            angle = angle + step
            if np.abs(step).max(initial=0.0) < 1e-12 * (1.0 + np.abs(angle).max(initial=0.0)):
                break
        radius = self.radius * angle / (2.0 * math.pi * self.turns)
        middle = np.array(self.centre)[:, None]
        return np.asarray(middle + radius * np.stack([np.cos(angle), np.sin(angle)]))

    @property
    def _length(self) -> float:
        """Length of the arc [rad]."""
        whole = 2.0 * math.pi * self.turns
        return self.radius / whole * float(_arc(np.asarray(whole)))

    def _motion(self, setup: ScanSetup) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return angles [rad] and rates [rad/s] of the shafts in the middle of each dwell, shape (2, points).

        Last, shape (points,), in which dwells a mirror is at a limit.
        """
        state, parts = at_rest(np.array(self.centre)), []
        for first in range(0, self.points, _POINTS_TOGETHER):
            count = min(_POINTS_TOGETHER, self.points - first) * _UPDATES
            share = (first * _UPDATES + np.arange(1.0, count + 1.0)) / (self.points * _UPDATES)
            motion, state = follow(setup.galvanometers, state, self.curve(share), setup.dwell / _UPDATES)
            middle = slice(_UPDATES // 2 - 1, None, _UPDATES)
            limited = motion.limited.any(axis=0).reshape(-1, _UPDATES).any(axis=1)
            parts.append((motion.true[:, middle], motion.rate[:, middle], limited))
        true, rate, limits = zip(*parts, strict=True)
        return np.concatenate(true, axis=1), np.concatenate(rate, axis=1), np.concatenate(limits)


def _arc(angle: Array | float) -> Array:
    """Return the length of the arc of r = ψ from 0 to angles ψ [rad], any shape."""
    return np.asarray(0.5 * (angle * np.hypot(1.0, angle) + np.arcsinh(angle)))
