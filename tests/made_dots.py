"""Dots of a frame as an estimator gives them, for tests of what is made of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scanner_sim.signals.dots.fit import Dots
from scanner_sim.signals.dots.settings import DotStatus

Array = NDArray[np.float64]

SIGMA = 0.02
"""Standard deviation of a centre along each axis [pixel]."""


def made_dots(centres: Array, half: Array) -> Dots:
    """Return round dots at centres (n, 2) with half axes (n,), in pixels."""
    count = len(centres)
    return Dots(
        centre=centres,
        covariance=np.tile(SIGMA**2 * np.eye(2), (count, 1, 1)),
        shape=np.stack([half, 0.0 * half, half], axis=1),
        light=np.full(count, 180.0),
        contrast=np.full(count, 0.9),
        blur=np.full(count, 0.6),
        chi2=np.full(count, 400.0),
        pixels=np.full(count, 400),
        status=np.full(count, DotStatus.VALID, dtype=np.int8),
    )
