"""The true instrument in numbers: what light and detectors follow, shot by shot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.parameters import INDEX, PHI_ERRORS, THETA_ERRORS
from scanner_sim.optics.as_built import AsBuilt
from scanner_sim.optics.deflection import Mirrors
from scanner_sim.optics.encoder_errors import pointing_error

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Unsteadiness:
    """What of the instrument differs from shot to shot, arrays of shape (n,).

    ``base`` by which it is longer [m], ``focus`` by which the image distance is, relative; ``turn`` and ``shift`` of
    the scanner, shape (3, n) [rad, m].
    """

    base: Array
    focus: Array
    turn: Array
    shift: Array

    @property
    def columns(self) -> list[Array]:
        """All of them, one column each, in the order of the fields."""
        return [self.base, self.focus, *self.turn, *self.shift]


@dataclass(frozen=True)
class BuiltInstrument:
    """An instrument as it was built.

    Attributes
    ----------
    own
        How it departs from its design, as the scenario has it.
    parameters
        The true parameters, in the order of :data:`~scanner_sim.foundation.parameters.PARAMETERS`.
    mirrors
        The mirrors, whose temperature is that of base and focus, too.
    baseline
        True base at the temperature of the calibration [m].
    seed
        Of the vibration.
    """

    own: AsBuilt
    parameters: Array
    mirrors: Mirrors
    baseline: float
    seed: int

    def value(self, name: str) -> float:
        """Return a true parameter."""
        return float(self.parameters[INDEX[name]])

    def pointing(self, theta: Array, phi: Array) -> tuple[Array, Array]:
        """Return by how much the mirrors point further than their encoders read [rad], for readings of any shape."""
        period = self.own.encoder_period or math.tau
        return (
            pointing_error(theta, self.parameters[THETA_ERRORS], period),
            pointing_error(phi, self.parameters[PHI_ERRORS], period),
        )

    @cached_property
    def is_steady(self) -> bool:
        """Whether base, focus and pose are those of every shot."""
        own = self.own
        return own.vibration is None and not own.base_expansion and not own.focal_expansion

    def unsteadiness(self, time: Array) -> Unsteadiness:
        """Return what differs from shot to shot at times since the first one [s], shape (n,)."""
        own, warmer = self.own, self.mirrors.temperature.difference(time)
        moved = np.zeros((*time.shape, 6)) if own.vibration is None else own.vibration.motion(time, self.seed)
        return Unsteadiness(
            self.baseline * (own.base_expansion or 0.0) * warmer,
            (own.focal_expansion or 0.0) * warmer,
            moved[..., :3].T,
            moved[..., 3:].T,
        )


def still_errors(
    mirrors: Mirrors, built: BuiltInstrument | None, theta: Array, phi: Array, time: Array
) -> list[Array]:
    """Return the errors of both mirrors that no random number makes [rad]: drift, and what an encoder reads wrong.

    Parameters
    ----------
    mirrors, built
        The mirrors, and the instrument as built; None is built as designed.
    theta, phi, time
        What the encoders read [rad], and when [s], arrays of one shape.
    """
    drift = list(mirrors.drift(np.array([theta, phi]), time))
    if built is None:
        return drift
    return [one + other for one, other in zip(drift, built.pointing(theta, phi), strict=True)]
