"""The voxels of patterns, as they come from ranging."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.status import Status

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PatternSamples:
    """Measured voxels, each array of shape (patterns, points), float64 but for the status.

    Attributes
    ----------
    time
        Middle of the dwell [s].
    theta, phi
        Measured deflections [rad].
    signal, sigma_signal
        Laser light received, and its standard deviation [electrons, or any unit].
    range, sigma_range
        Range and its standard deviation [m]; NaN where there is none.
    status
        :class:`~scanner_sim.foundation.status.Status`, uint8.
    """

    time: Array
    theta: Array
    phi: Array
    signal: Array
    sigma_signal: Array
    range: Array
    sigma_range: Array
    status: NDArray[np.uint8]

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """Where a range was measured."""
        return np.asarray((self.status == Status.VALID) & np.isfinite(self.range))

    @cached_property
    def angles(self) -> Array:
        """Θ and φ, shape (patterns, 2, points) [rad]."""
        return np.stack([self.theta, self.phi], axis=1)

    def of(self, row: int) -> PatternSamples:
        """Return one of the patterns."""
        if len(self.time) == 1:
            return self
        rows = slice(row, row + 1)
        return PatternSamples(*(getattr(self, field.name)[rows] for field in fields(self)))

    def later(self, delay: float) -> PatternSamples:
        """Return the samples with angles corrected for a known delay [s] of their reading.

        angle(t + delay) = angle + delay · rate + delay²/2 · acceleration, from differences of the measured angles; for
        delays up to two dwells (the error is of the third order). Range, signal and time stay: they were right.
        """
        # All dwells of a pattern are alike, so that a common step does.
        dwells = (delay / (self.time[:, 1:2] - self.time[:, :1]))[:, None]
        rise = rise_per_point(self.angles)
        later = self.angles + dwells * rise + (0.5 * dwells**2) * rise_per_point(rise)
        return replace(self, theta=later[:, 0], phi=later[:, 1])


def rise_per_point(values: Array) -> Array:
    """Return the rise from point to point, shape (..., points), to the second order at the ends too."""
    rise = np.empty_like(values)
    rise[..., 1:-1] = 0.5 * (values[..., 2:] - values[..., :-2])
    rise[..., 0] = 2.0 * values[..., 1] - 1.5 * values[..., 0] - 0.5 * values[..., 2]
    rise[..., -1] = 1.5 * values[..., -1] + 0.5 * values[..., -3] - 2.0 * values[..., -2]
    return rise
