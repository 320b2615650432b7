"""Which parameters a field determines, and which combinations of them it cannot tell apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.calibration.adjustment import Adjusted
from scanner_sim.calibration.network import Field

Array = NDArray[np.float64]

_PART = 0.3
"""Share of the largest part of a combination below which a parameter is not named."""


@dataclass(frozen=True)
class Combination:
    """A direction in the space of parameters, each in units of its tolerance.

    Attributes
    ----------
    parts
        Its parameters with their parts, the largest first.
    sigma
        How well the sightings alone determine it, over the tolerance; infinite where they say nothing.
    """

    parts: tuple[tuple[str, float], ...]
    sigma: float

    @property
    def words(self) -> str:
        """The combination as a sum, as ``+0.71 base −0.70 array_scale``."""
        return " ".join(f"{'+' if part > 0 else '−'}{abs(part):.2f} {name}" for name, part in self.parts)


def unobserved(field: Field, adjusted: Adjusted) -> tuple[Combination, ...]:
    """Return the combinations of which the sightings know less than the tolerances do, the least known first.

    The information of the sightings, in units of the tolerances, is parted into its independent directions (principal
    axes). One with an eigenvalue λ < 1 is determined to 1/√λ > 1 tolerance: what an adjustment says of it is the
    tolerance again.
    """
    scaled = adjusted.information * np.outer(field.tolerances, field.tolerances)
    values, axes = np.linalg.eigh(scaled)
    found = []
    for value, axis in zip(values, axes.T, strict=True):
        if value < 1.0:
            found.append(_combination(field.sought, axis, float(value)))
    return tuple(found)


def _combination(names: tuple[str, ...], axis: Array, value: float) -> Combination:
    order = np.argsort(-np.abs(axis))
    axis = axis * np.sign(axis[order[0]])
    parts = [(names[i], float(axis[i])) for i in order if abs(axis[i]) >= _PART * abs(axis[order[0]])]
    return Combination(tuple(parts), float("inf") if value <= 1e-12 else value**-0.5)


def correlations(adjusted: Adjusted) -> Array:
    """Return the correlations of the parameters that were looked for."""
    sigma = np.sqrt(np.diagonal(adjusted.covariance))
    return np.asarray(adjusted.covariance / np.outer(sigma, sigma))
