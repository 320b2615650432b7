"""What the search for the spot knows beforehand: how bright and how broad it is at most, and the range gate."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_numbers import beside
from scanner_sim.foundation.device_types import Float
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.processing import Processing

SIDE_PIXELS = 3
"""Pixels of each side whose mean is compared with a peak."""
_SIDE_SIGMAS = 2.6
"""Standard deviations of the widest spot that the sides keep away: there it has fallen to 3 %."""
_FARTHEST = 16
"""Largest distance of a side: wider spots lose contrast instead of making the window longer."""
_LEAST_CONTRAST = 0.15
"""Contrast that the widest spot has at least, relative to its charge."""
SIDE_THRESHOLD = 0.8
"""Share of the threshold by which a peak must also rise above the brighter of its sides: the noise on top of an
edge rises above the straight line beneath it, but not above the edge. Less than 1, because noise lifts the
brighter side."""
_NO_LIMIT = 1e30


@dataclass
class Gate:
    """The pixels of a range gate, Dr.Jit floats: peaks between them that reach ``level`` go before all others."""

    first: Float
    last: Float
    level: Float


@dataclass
class Limits:
    """What no spot exceeds: values ``a + b · (pixel + origin)²`` along the line, Dr.Jit floats.

    ``charge`` (a, b) of the contrast [electron]: the light of a surface falls with the square of its range, which
    is inverse to the position on the line; ``dimmest`` is b of the least contrast. ``flank`` (a, b) of what stands
    above the sides one pixel nearer than they, as a share of the contrast: the beam's image widens with the
    position.
    """

    charge: tuple[Float, Float]
    dimmest: Float
    flank: tuple[Float, Float]
    origin: Float


def flank_limit(variances: NDArray[np.float64], away: int, origin: float) -> tuple[float, float]:
    """Return (a, b) for :class:`Limits` from the variance of the widest spot on each pixel [pixel²].

    For a Gaussian exp(−x²/2s²) centred on a pixel; a quarter more and a twentieth of the contrast are allowed for
    a position between two pixels.
    """

    def height(distance: int) -> NDArray[np.float64]:
        return np.asarray(np.exp(-0.5 * distance**2 / variances))

    sides = sum(height(away + number) for number in range(SIDE_PIXELS)) / SIDE_PIXELS
    contrast = 0.5 * (1.0 + height(1)) - sides
    shares = 1.25 * (height(away - 1) - sides) / contrast + 0.05
    position = np.arange(len(variances)) + origin
    least = float(shares.min())
    return least, float(((shares - least) / position**2).max())


def distance_of_sides(sigma: float) -> int:
    """Return the distance of the sides [pixel] from a peak; even, so that the loop meets pixels pair by pair."""
    return min(2 * int(-(-_SIDE_SIGMAS * sigma // 2)), _FARTHEST)


def farthest_side(away: int) -> int:
    """Return how far from a peak the pixels of its sides reach [pixel]."""
    return away + SIDE_PIXELS - 1


def limits_of(
    spot: ExpectedSpot, processing: Processing, floor_sigma: Float, cosine: Float
) -> tuple[Limits, int]:
    """Return what the spot does not exceed at deflections Θ given as cosine, and how far off the search has its sides.

    ``floor_sigma`` is the standard deviation of a pixel without light [electron].
    """
    validation = processing.validation
    # At R = f d cosΘ/p: d sinΘ is small, and the limits are generous.
    per_square = beside(cosine, spot.white_by_pixel)[0] / dr.square(cosine)
    least: Float = dr.opaque(auto.Float, _NO_LIMIT)
    steepness = auto.Float(0.0)
    if validation.max_reflectance is not None:
        steepness = dr.opaque(auto.Float, validation.max_reflectance * spot.largest_share) * per_square
        least = dr.opaque(auto.Float, processing.threshold) * floor_sigma
    dimmest = dr.opaque(auto.Float, validation.min_reflectance * _LEAST_CONTRAST) * per_square
    start = spot.offset / spot.pitch + 1.0
    away = distance_of_sides(spot.largest_sigma)
    flank: tuple[Float, Float] = (dr.opaque(auto.Float, _NO_LIMIT), auto.Float(0.0))
    if validation.shape:
        low, rise = flank_limit(spot.widest(validation.beam_width[1]), away, start)
        flank = dr.opaque(auto.Float, low), dr.opaque(auto.Float, rise)
    return Limits((least, steepness), dimmest, flank, dr.opaque(auto.Float, start)), away


def gate_of(spot: ExpectedSpot, processing: Processing, sine: Float, cosine: Float) -> Gate | None:
    """Return the pixels of the range gate; None without one."""
    if processing.range_gate is None:
        return None
    nearest, farthest = processing.range_gate
    level = dr.opaque(auto.Float, SIDE_THRESHOLD * processing.threshold)
    infinity = dr.opaque(auto.Float, -spot.offset / spot.pitch - 0.5)

    def seen(range_m: float) -> Float:
        """Return the pixel of a range; a range that is nearer than any position sees lies beyond all of them."""
        pixel = spot.pixel(range_m, sine, cosine)
        return dr.select(pixel > infinity, pixel, dr.inf)

    return Gate(seen(farthest) - 1.0, seen(nearest) + 1.0, level)
