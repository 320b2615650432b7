"""Where a rising edge crosses a level when only samples of it are known, and straight lines between them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

_PHASES = 64


def sampled_crossings(sigma: float, step: float, ratio: float) -> NDArray[np.float64]:
    """Return by how much before its peak a sampled Gaussian pulse first crosses a level [s], shape (64,).

    Each for another place of the peak between two samples; the places are even.

    Between two samples the pulse is replaced by a straight line. At the foot of the edge, where the pulse is convex,
    the line lies above it and crosses the level earlier. For fine samples the result is σ √(2 ln ratio), on which
    :func:`scanner_sim.analytic.time_of_flight.leading_edge_walk` rests.

    Parameters
    ----------
    sigma
        Standard deviation of the pulse [s].
    step
        Time between samples [s].
    ratio
        Peak over level, above 1.
    """
    reach = math.ceil(8.0 * sigma / step)
    found = []
    for phase in (np.arange(_PHASES) + 0.5) / _PHASES:
        time = (np.arange(-reach, reach + 1) + phase) * step
        pulse = ratio * np.exp(-0.5 * (time / sigma) ** 2)
        after = int(np.argmax(pulse > 1.0))
        low, high = pulse[after - 1], pulse[after]
        found.append(time[after - 1] + step * (1.0 - low) / (high - low))
    return -np.array(found)


def sampled_crossing(sigma: float, step: float, ratio: float) -> float:
    """Return the mean of :func:`sampled_crossings` over all places of the peak [s]."""
    return float(np.mean(sampled_crossings(sigma, step, ratio)))
