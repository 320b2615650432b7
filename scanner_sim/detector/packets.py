"""Packets of speckle on pixels and in time: the modes of a line of pixels, and what a dwell averages.

The laws are those of :mod:`scanner_sim.optics.speckle`; they need functions that Dr.Jit and NumPy each have their own
of.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np
from scipy.special import erf

from scanner_sim.foundation.arithmetic import exp
from scanner_sim.foundation.device_numbers import beside
from scanner_sim.foundation.device_types import Float, FloatLike
from scanner_sim.optics.speckle import Optics

_SHORT_TRAVEL = 0.1
"""Travel in radii of the beam below which averages follow their series: their differences drown in rounding."""


def dwell_average(along: FloatLike, across: FloatLike, radius: FloatLike) -> tuple[FloatLike, FloatLike]:
    """Return what a dwell leaves of the variance of energy and of centroid: 1 for a beam at rest.

    Parameters
    ----------
    along, across
        Travel of the beam over the surface in the dwell, along the line's direction and across it.
    radius
        1/e² radius w of the beam there. Numbers, NumPy or Dr.Jit arrays.

    Notes
    -----
    (2/L²) ∫₀^L (L − δ) ρ(δ) dδ of ρ = exp(−δ²/w²) and (1 − 2 (δ cosα)²/w²) exp(−δ²/w²), with t = L/w and
    c = cosα = along/L: A = √π erf(t)/t − (1 − exp(−t²))/t² and A (1 − c²) + c² (1 − exp(−t²))/t².
    """
    squared: FloatLike = (along * along + across * across) / (radius * radius)
    short = squared < _SHORT_TRAVEL**2
    device = dr.is_jit_v(squared)
    library: Any = dr if device else np
    select: Any = dr.select if device else np.where
    decay: Any = dr.exp if device else exp
    safe = select(short, _SHORT_TRAVEL**2, squared)
    t = library.sqrt(safe)
    by_slope = (1.0 - decay(-safe)) / safe
    energy = math.sqrt(math.pi) * (library.erf(t) if device else erf(t)) / t - by_slope
    energy = select(short, 1.0 - squared / 6.0, energy)
    by_slope = select(short, 1.0 - 0.5 * squared, by_slope)
    share = along * along / (radius * radius) / select(squared > 0.0, squared, 1.0)
    return energy, energy + share * (by_slope - energy)


def mode_ratios(optics: Optics, ratio: Float) -> list[Float]:
    """Return r for each mode after the first; for modes beyond those there are 0, which makes their edges 0.

    Their number is 3 more than a multiple of four, since each number has kernels of its own, and numbers are drawn by
    fours.
    """
    (modes,) = beside(ratio, float(optics.modes))
    rounded = 4 * math.ceil((optics.modes - 3) / 4.0) + 3
    return [dr.select(modes > order, ratio, 0.0) for order in range(1, rounded)]


def mode_edges(ratios: Sequence[FloatLike], distance: FloatLike) -> list[FloatLike]:
    """Return the integrals of the modes up to an edge: the share of a pixel is the difference of two.

    Parameters
    ----------
    ratios
        r of each mode after the first (:func:`mode_ratios`).
    distance
        Distance of an edge from the spot's middle over σ, NumPy or Dr.Jit.

    Notes
    -----
    Φ(x) for n = 0; then −rⁿ He_{n−1}(x) φ(x)/√n!, by the recurrence of normalised Hermite polynomials.
    """
    device = dr.is_jit_v(distance)
    decay: Any = dr.exp if device else exp
    step: Any = dr.erf if device else erf
    found = [0.5 * step(distance * math.sqrt(0.5))]
    density = decay(-0.5 * (distance * distance)) * (1.0 / math.sqrt(2.0 * math.pi))
    power, before, now = -density, 0.0 * distance, 0.0 * distance + 1.0
    for order, ratio in enumerate(ratios, 1):
        power = power * ratio
        # now is He_{n−1}/√(n−1)!
        found.append(power * now * (1.0 / math.sqrt(order)))
        after = (distance * now - math.sqrt(order - 1.0) * before) * (1.0 / math.sqrt(order))
        before, now = now, after
    return found


def gamma_like(deviation: Float, normal: Float) -> Float:
    """Return numbers of mean 1 and a standard deviation, nearly gamma distributed, from standard normal ones.

    (1 − v/9 + √v z/3)³ with the variance v (Wilson and Hilferty, *PNAS* 17, 1931), not below 0.
    """
    root = dr.maximum(1.0 + deviation * (normal * (1.0 / 3.0) - deviation * (1.0 / 9.0)), 0.0)
    return root * dr.square(root)
