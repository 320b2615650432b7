"""Between what the closed loop believes of positions and what its mirrors are told and its encoders read.

The tracker and the poses know positions (Θ, φ, R) by eq 3 with the designed axes. A calibrated instrument takes its
encoders' errors and its axes into account before and after.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.calibration import believed_instrument, geometry_believed
from scanner_sim.config.scenario import Scenario
from scanner_sim.instrument.common_errors import ranged_by
from scanner_sim.ranging.axes import Axes
from scanner_sim.ranging.calibration import position_in_common
from scanner_sim.ranging.coordinates import angles_and_range, coordinates
from scanner_sim.ranging.fusion import range_covariance, share_of_pulses, slopes_by_theta

Array = NDArray[np.float64]


class RangeNoise(NamedTuple):
    """Noise of the ranges of patterns: σ by each way of ranging [m], and their covariance [m²], each (patterns,)."""

    triangulation: Array
    pulses: Array
    covariance: Array


class BelievedPositions:
    """What a scenario's instrument believes; without a calibration everything stays as it is."""

    def __init__(self, scenario: Scenario) -> None:
        self._calibration = believed_instrument(scenario)
        self._geometry = geometry_believed(scenario.scanner, self._calibration)
        self._separation = scenario.scanner.mirrors.axis_separation
        self._ways = ranged_by(scenario.rangefinders, self._geometry)

    @property
    def axes(self) -> Axes:
        """The axes of the mirrors."""
        return self._geometry.axes

    def deflections(self, angles: Array) -> Array:
        """Return the deflections that readings mean, both of shape (..., 2, points) [rad]."""
        if self._calibration is None:
            return angles
        return np.stack(self._calibration.deflections(angles[..., 0, :], angles[..., 1, :]), axis=-2)

    def designed(self, position: Array) -> Array:
        """Return positions by the designed axes of those by the believed ones, shape (..., 3)."""
        if self._calibration is None:
            return position
        theta, phi, r = np.moveaxis(position, -1, 0)
        found = angles_and_range(*self._geometry.point(r, theta, phi), self._separation)
        return np.stack([found[1], found[2], found[0]], axis=-1)

    def commands(self, position: Array) -> Array:
        """Return the readings (Θ, φ) at which the mirrors point at positions, shape (..., 2) of (..., 3)."""
        if self._calibration is None:
            return position[..., :2]
        theta, phi, r = np.moveaxis(position, -1, 0)
        _, *own = self._geometry.sight_of(*coordinates(r, theta, phi, self._separation))
        return np.stack(self._calibration.readings(*own), axis=-1)

    def range_covariance(self, position: Array, sigma_theta: Array) -> Array:
        """Return the covariance of the noise of both rangefinders' ranges at positions, (patterns, 3), in m².

        ``sigma_theta`` is σ of the readings of Θ [rad], shape (patterns,).
        """
        theta, _, r = position.T
        return range_covariance(slopes_by_theta(r, r, theta, self._geometry), sigma_theta)

    def in_common(self, position: Array, noise: Callable[[], RangeNoise]) -> Array:
        """Return what the calibration's errors make of positions, shape (patterns, 3, k); k is 0 without errors.

        Where both rangefinders measure, each has its share in the range.
        """
        calibration = self._calibration
        if calibration is None or not calibration.is_uncertain:
            return np.zeros((*position.shape, 0))
        ways = self._ways.get("fused.", self._ways[""])
        parts = [position_in_common(calibration, way, position) for way in ways]
        if len(parts) == 1:
            return parts[0]
        own, (common1, common2) = noise(), (part[..., 2, :] for part in parts)
        one = np.hypot(own.triangulation, np.linalg.norm(common1, axis=-1))
        other = np.hypot(own.pulses, np.linalg.norm(common2, axis=-1))
        covariance = own.covariance + np.sum(common1 * common2, axis=-1)
        share = share_of_pulses(one, other, np.isfinite(one), np.isfinite(other), covariance)[:, None, None]
        return np.asarray((1.0 - share) * parts[0] + share * parts[1])
