"""What the position sensor's line tells of shots: groups that went through it together, and their peaks gathered."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.line.exposure import Signal
from scanner_sim.foundation.device_types import Float, UInt32
from scanner_sim.render.incident import Incident, LinkBudget
from scanner_sim.signals.line.peaks import Peaks


@dataclass(frozen=True)
class ShotGroup:
    """Shots of a batch that went through the sensor together, with everything on the way."""

    light: Incident
    signal: Signal
    peaks: Peaks

    @property
    def index(self) -> NDArray[np.uint32]:
        """Index of each shot in the batch."""
        return np.asarray(self.light.light.index.numpy())

    def readings(self) -> LineReadings:
        """Return what the line told of them."""
        return LineReadings.of(self.peaks, self.light.link_budget(), self.signal.background_peak)


@dataclass
class LineReadings:
    """What the line told of m shots: their peaks, and their light as the paper counts it.

    Fields of :class:`~scanner_sim.signals.line.peaks.Peaks` and of :class:`~scanner_sim.render.incident.LinkBudget`;
    ``background_peak`` on the brightest pixel [W]. On the device; in double precision of n shots, once gathered.
    """

    position: Float
    sigma: Float
    signal: Float
    sigma_signal: Float
    snr: Float
    laser: Float
    background: Float
    background_error: Float
    background_peak: Float
    status: UInt32

    @classmethod
    def of(cls, peaks: Peaks, light: LinkBudget, background_peak: Float) -> LineReadings:
        """Return those of shots that went through the sensor together."""
        return cls(
            peaks.position,
            peaks.sigma,
            peaks.signal,
            peaks.sigma_signal,
            peaks.snr,
            light.laser,
            light.background,
            light.background_error,
            background_peak,
            peaks.status,
        )

    @property
    def columns(self) -> list[Float | UInt32]:
        """All fields, in their order."""
        return [getattr(self, field.name) for field in fields(self)]

    @classmethod
    def unpacked(cls, numbers: NDArray[np.float32], count: int) -> LineReadings:
        """Return those of so many shots from their :attr:`columns`, side by side."""
        *parts, status = numbers.reshape(-1, count).astype(np.float64)
        named: dict[str, Any] = dict(zip((field.name for field in fields(cls)), parts, strict=False))
        return cls(**named | {"status": status.astype(np.uint32)})

    @classmethod
    def gathered(cls, count: int, parts: Iterable[tuple[Any, LineReadings]]) -> LineReadings:
        """Return those of so many shots from parts of them, each with the indices of its shots."""
        found = cls(*(np.full(count, np.nan) for _ in fields(cls)))
        found.status = np.zeros(count, dtype=np.uint32)
        for index, part in parts:
            for field in fields(cls):
                getattr(found, field.name)[index] = getattr(part, field.name).numpy()
        return found
