"""What is known of the speckle on a line before it is seen: the covariance that it gives the charges of the spot.

The pixels i, j of a spot of charges q have the covariance

    q_i q_j √(κ_i κ_j) ρ C²/M r_|i−j|

with the pixel's variance ρ under an even light and the correlation r of :class:`~scanner_sim.optics.speckle.Grain`, the
concentration κ of the spot within a pixel and the number M of
patterns that the dwell averages. The contrast C is a value of the calibration: the instrument does not know its
target. σ is too small by as much as C is, on surfaces that keep the laser's polarisation by √2.

The spot is taken to be that of a surface which faces the scanner; a narrower or wider one has the same error of its
centroid, C √(S_c/8π), whatever its size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.detector.speckle import pixel_variance, quick_concentration
from scanner_sim.optics.speckle import Grain, patterns
from scanner_sim.signals.expected import ExpectedSpot


@dataclass(frozen=True)
class ExpectedSpeckle:
    """What the instrument knows of the speckle that its laser makes.

    Attributes
    ----------
    grain
        The grain on the line.
    contrast
        Contrast C that surfaces are assumed to give.
    sweep
        Angle by which the beam moves in a dwell [rad], a number or a Dr.Jit array of shape (m,).
    height
        Height of the pixels, in pixels of the line's pitch.
    """

    grain: Grain
    contrast: float
    sweep: Any
    height: float

    def about(self, spot: ExpectedSpot, centre: Any, sine: Any, cosine: Any) -> SpotSpeckle:
        """Return the speckle of spots about pixels (Dr.Jit, shape (m,)) at deflections Θ given as sine and cosine."""
        pixel = dr.maximum(auto.Float(centre), 0.0)
        beam, spread = spot.variances(pixel, sine, cosine)
        distance = spot.range(pixel, sine, cosine)
        away = (distance - dr.opaque(auto.Float, spot.waist_distance)) / dr.opaque(
            auto.Float, spot.rayleigh_length
        )
        radius = dr.opaque(auto.Float, spot.waist_radius) * dr.sqrt(1.0 + dr.square(away))
        sweep = dr.opaque(auto.Float, self.sweep) if isinstance(self.sweep, float) else self.sweep
        averaged = patterns(sweep, distance / radius)
        across = within_height(beam + spread, dr.opaque(auto.Float, self.height))
        even = dr.opaque(auto.Float, self.contrast**2) * pixel_variance(self.grain, beam + spread, across)
        return SpotSpeckle(self.grain, even / averaged, dr.sqrt(beam + spread))


@dataclass
class SpotSpeckle:
    """The speckle of the spots of m shots, Dr.Jit arrays of shape (m,).

    ``variance`` relative variance of a pixel under an even light, ``sigma`` standard deviation of the spot [pixel].
    """

    grain: Grain
    variance: Any
    sigma: Any

    def relative(self, apart: Any) -> Any:
        """Return the relative variance of pixels whose centres are ``apart`` from the spot's middle [pixel]."""
        return self.variance * quick_concentration(apart, self.sigma, self.grain)

    def carried(self, slopes: dict[int, Any], charges: dict[int, Any], shift: Any) -> Any:
        """Return the variance that the speckle gives a quantity.

        Parameters
        ----------
        slopes
            Derivative of the quantity by the charge of the pixel at each step from the brightest one.
        charges
            The spot's charges there [electron].
        shift
            Place of the spot from the brightest pixel's centre [pixel].
        """
        moved = {
            step: slope * charges[step] * dr.sqrt(quick_concentration(step - shift, self.sigma, self.grain))
            for step, slope in slopes.items()
        }
        total = auto.Float(0.0)
        for lag, correlation in enumerate(self.grain.correlations):
            weight: Any = dr.opaque(auto.Float, correlation if lag == 0 else 2.0 * correlation)
            pairs = [moved[step] * moved[step + lag] for step in moved if step + lag in moved]
            total += weight * sum(pairs, auto.Float(0.0))
        return self.variance * total


def within_height(variance: Any, height: Any) -> Any:
    """Return the variance of what a height, centred on it, lets through of a Gaussian.

    Johnson, Kotz, Balakrishnan, *Continuous univariate distributions* 1, 1994, ch. 13.
    """
    half = 0.5 * height * dr.rsqrt(variance)
    share = dr.erf(half * math.sqrt(0.5))
    density = dr.exp(-0.5 * dr.square(half)) / math.sqrt(2.0 * math.pi)
    # Far narrower than the Gaussian the height is evenly lit.
    narrow = half < 0.1
    kept = dr.select(narrow, dr.square(half) / 3.0, 1.0 - 2.0 * half * density / dr.maximum(share, 1e-3))
    return variance * kept
