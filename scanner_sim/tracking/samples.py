"""The voxels of patterns, as they come from ranging."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.arithmetic import columns
from scanner_sim.foundation.status import VALID

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
        Laser light received, and its standard deviation [electrons, or any unit]; without a peak 0, and the standard
        deviation of what may be there all the same.
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
        return np.asarray((self.status == VALID) & np.isfinite(self.range))

    @cached_property
    def angles(self) -> Array:
        """Θ and φ, shape (patterns, 2, points) [rad]."""
        return columns(self.theta, self.phi)

    @cached_property
    def beams(self) -> tuple[Array, Array, Array]:
        """Unit vectors along the beams, shape (patterns, 3, points), and sin φ and cos φ, (patterns, points)."""
        sine, cosine, forward = np.sin(self.phi), np.cos(self.phi), np.cos(self.theta)
        return columns(np.sin(self.theta), forward * sine, forward * cosine), sine, cosine

    def of(self, row: int) -> PatternSamples:
        """Return one of the patterns."""
        if len(self.time) == 1:
            return self
        rows = slice(row, row + 1)
        return PatternSamples(*(getattr(self, field.name)[rows] for field in fields(self)))

    def at(self, angles: Array) -> PatternSamples:
        """Return the same voxels at other places, shape (any, 2, points)."""
        theta, phi = angles[:, 0], angles[:, 1]
        found = PatternSamples(
            self.time, theta, phi, self.signal, self.sigma_signal, self.range, self.sigma_range, self.status
        )
        vars(found)["angles"] = angles  # known already
        return found

    def at_rest(self, time: Array, position: Array, rates: Array) -> PatternSamples:
        """Return the samples as of targets that stand still where they are at some times.

        A target that comes nearer by 0.6 m/s at 4 m grows by 0.1 % in a pattern, and one that stands aside moves
        outward: a figure that crosses its rim at different times would be drawn aside by microradians. The light that
        comes back from where the beam meets it goes with 1/R².

        Parameters
        ----------
        time, position, rates
            When [s], where targets are then (Θ, φ, R) and how that changes per second, shape (patterns,) and
            (patterns, 3), as they are expected: first order in what changes during a pattern.
        """
        moved = rates[:, :, None] * (self.time - time[:, None])[:, None]
        larger = 1.0 + moved[:, 2] / position[:, 2:]
        about = position[:, :2, None]
        angles = about + (self.angles - about - moved[:, :2]) * larger[:, None]
        light = larger * larger
        found = PatternSamples(
            self.time,
            angles[:, 0],
            angles[:, 1],
            self.signal * light,
            self.sigma_signal * light,
            self.range - moved[:, 2],
            self.sigma_range,
            self.status,
        )
        vars(found)["angles"] = angles  # known already
        return found


def angles_later(time: Array, angles: Array, delay: float) -> Array:
    """Return angles (patterns, 2, points) corrected for a known delay [s] of their reading at times (patterns, points).

    angle(t + delay) = angle + delay · rate + delay²/2 · acceleration, from differences of the measured angles; for
    delays up to two dwells (the error is of the third order). Ranges, signals and times of such voxels are right.
    """
    # All dwells of a pattern are alike, so that a common step does.
    dwells = (delay / (time[:, 1:2] - time[:, :1]))[:, None]
    rise = rise_per_point(angles)
    return np.asarray(angles + dwells * rise + (0.5 * dwells**2) * rise_per_point(rise))


def rise_per_point(values: Array) -> Array:
    """Return the rise from point to point, shape (..., points), to the second order at the ends too."""
    rise = np.empty_like(values)
    rise[..., 1:-1] = 0.5 * (values[..., 2:] - values[..., :-2])
    rise[..., 0] = 2.0 * values[..., 1] - 1.5 * values[..., 0] - 0.5 * values[..., 2]
    rise[..., -1] = 1.5 * values[..., -1] + 0.5 * values[..., -3] - 2.0 * values[..., -2]
    return rise
