"""From where on the sensor a pixel collects light: its own square, and what the lens blurs into it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

_NODES = 4096
_FEET = 4.0
"""Standard deviations of the point spread at which the footprint ends."""


def footprint_quantiles(spread: float) -> NDArray[np.float64]:
    """Return places [pixel] beside a pixel's centre by their share of its light along an axis, at even shares.

    Parameters
    ----------
    spread
        Standard deviation σ of a point's image [pixel], per axis.

    Returns
    -------
    ndarray
        Shape (4097,), from −1/2 − 4σ to 1/2 + 4σ. A square pixel with all of its area sensitive weighs the place x by
        the density of a uniform and a normal number together, whose integral is
        σ (h((x + 1/2)/σ) − h((x − 1/2)/σ)) with h(z) = z Φ(z) + φ(z). Its transform is the MTF of the pixel times that
        of the lens, sinc(ν) exp(−2π²σ²ν²) (Boreman, *Modulation transfer function*, SPIE Press 2001, ch. 2).
    """
    shares = np.linspace(0.0, 1.0, _NODES + 1)
    if spread < 1e-6:
        return shares - 0.5
    end = 0.5 + _FEET * spread
    x = np.linspace(-end, end, 8 * _NODES + 1)

    def part(z: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(z * ndtr(z) + np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi))

    integral = spread * (part((x + 0.5) / spread) - part((x - 0.5) / spread))
    integral = (integral - integral[0]) / (integral[-1] - integral[0])
    found = np.interp(shares, integral, x)
    return np.asarray(0.5 * (found - found[::-1]))
