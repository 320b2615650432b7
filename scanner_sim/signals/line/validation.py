"""Validation: whether a peak has the width, the shape and the strength of the laser's spot.

*Width.* On logarithms a Gaussian of variance v has the curvature 1/v; its noise follows from the three pixels'
variances. It must lie between those of the narrowest and the widest image of the beam, point spread and pixel
included, or that of a beam which sweeps over a steep plane; where the light beside the peak differs from side to side,
a doubt about the level beneath it is granted.

*Shape.* The spot, integrated over the pixels, is fitted to height, position and width, linear about those of the three
pixels; χ² is the sum of the squared residuals over the pixels' variances, to which a tolerance is added that grows with
the height. Were the width not fitted, the noise of the three pixels would stay in the residuals of wide spots.
Its limit is the quantile of the χ² distribution (Wilson, Hilferty, *PNAS* 17, 1931).

*Misfit.* What departs from the shape without failing the test may have moved the peak. The root mean square of the
residuals beyond the noise, over the height, is therefore added to σ; not those of an edge that the two sides show,
whose variance the estimator knows.

*Strength.* No surface returns more than a white one that faces the scanner, but for a factor that allows for
gloss.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.foundation.device_loops import for_each
from scanner_sim.foundation.device_numbers import beside
from scanner_sim.foundation.device_types import Float, Int32, Local, Mask, UInt32
from scanner_sim.signals.line.digital_line import Around
from scanner_sim.signals.line.estimators import positive
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.likelihood import inverse_of
from scanner_sim.signals.line.pixel_row import read_rows
from scanner_sim.signals.line.speckle import SpotSpeckle
from scanner_sim.signals.processing import Validation

_MARGIN = 4.0
"""Standard deviations of a spot to each side that its shape is judged over."""
MOST_PIXELS = 24
"""Largest number of pixels to each side; wider spots are judged by their core."""
_CURVATURE = 0.03
"""Relative error of the curvature 1/(s² + 1/12) of a spot integrated over pixels, from s = 0.46 pixel."""
_NOISE_ALLOWANCE = 3.0
"""Mean square of the residuals, over their variance, that noise alone hardly exceeds."""
_SAWTOOTH = 1.0 / 12.0
"""Mean square that an edge of unit height beneath the spot leaves above the straight baseline."""
_PIXEL = 1.0 / 12.0
"""Variance of a pixel's own width [pixel²]."""


@dataclass
class SpotFit:
    """How well peaks fit the spot, Dr.Jit arrays of shape (m,).

    ``fits`` whether width and shape pass; ``charge`` of the fitted spot [electron]; ``misfit`` root mean square of
    the residuals beyond the noise, relative to the height of the spot; ``saturated`` where a pixel of the
    window is full.
    """

    fits: Mask
    charge: Float
    misfit: Float
    saturated: Mask


def guard_pixels(spot: ExpectedSpot, centre: Int32, sine: Float, cosine: Float) -> Int32:
    """Return how many pixels to each side of its brightest one a spot covers, Dr.Jit signed."""
    beam, spread = spot.variances(auto.Float(centre), sine, cosine)
    return auto.Int32(dr.clip(dr.ceil(_MARGIN * dr.sqrt(beam + spread)), 3.0, MOST_PIXELS))


def farthest_pixel(spot: ExpectedSpot) -> int:
    """Return how many pixels to each side are looked at: at least as many as a spot covers anywhere on the line.

    A multiple of four, since each number has kernels of its own.
    """
    return min(4 * math.ceil((_MARGIN * spot.largest_sigma + 1.0) / 4.0), MOST_PIXELS)


def judge_shape(
    around: Around,
    spot: ExpectedSpot,
    guard: Int32,
    sine: Float,
    cosine: Float,
    settings: Validation,
    speckle: SpotSpeckle | None = None,
) -> SpotFit:
    """Compare peaks with the spot.

    Parameters
    ----------
    around
        Charges about the peaks.
    spot
        The spot.
    guard
        Pixels to each side that are compared, shape (m,).
    sine, cosine
        Of the deflections Θ, shape (m,).
    settings
        Limits.
    speckle
        What is known of the speckle on the spots: it bends their shape.

    Returns
    -------
    SpotFit
    """
    beam, spread = spot.variances(auto.Float(around.centre), sine, cosine)
    low, high = (dr.opaque(auto.Float, limit**2) * beam + spread for limit in settings.beam_width)
    high = dr.maximum(high, beam + spread + spot.swept_variance(auto.Float(around.centre), sine, cosine))
    deviate = NormalDist().inv_cdf(1.0 - settings.false_alarm)

    # Width and position from the logarithms of three pixels.
    three = [around(step) for step in (-1, 0, 1)]
    charges = [positive(charge, around.floor_sigma) for charge, _ in three]
    logarithms = [dr.log(charge) for charge in charges]
    curvature = 2.0 * logarithms[1] - logarithms[0] - logarithms[2]
    noise = auto.Float(0.0)
    for weight, charge, (_, variance) in zip((1.0, 2.0, 1.0), charges, three, strict=True):
        noise += dr.square(weight / charge) * variance
    if speckle is not None:
        slopes = {
            step: weight / charge
            for step, weight, charge in zip((-1, 0, 1), (-1.0, 2.0, -1.0), charges, strict=True)
        }
        noise += speckle.propagated_variance(
            slopes, dict(zip((-1, 0, 1), charges, strict=True)), auto.Float(0.0)
        )
    slack = dr.opaque(auto.Float, deviate) * dr.sqrt(noise)
    slack += dr.abs(2.0 / charges[1] - 1.0 / charges[0] - 1.0 / charges[2]) * around.baseline.doubt
    fits = curvature - slack <= (1.0 + _CURVATURE) / (low + _PIXEL)
    fits &= curvature + slack >= (1.0 - _CURVATURE) / (high + _PIXEL)
    position = dr.clip(0.5 * (logarithms[2] - logarithms[0]) / dr.maximum(curvature, 1e-3), -1.0, 1.0)
    variance = dr.clip(dr.rcp(dr.maximum(curvature, 1e-3)) - _PIXEL, low, high)

    charge, residual, expected, chi_squared, freedom, saturated = _fit(
        around, spot, guard, position, dr.sqrt(variance), dr.opaque(auto.Float, settings.tolerance), speckle
    )
    fits &= (charge > 0.0) & (chi_squared <= _quantile(freedom, dr.opaque(auto.Float, deviate)))
    height = dr.maximum(three[1][0], 1.0)
    expected = _NOISE_ALLOWANCE * expected + _SAWTOOTH * around.baseline.step_squared
    excess = dr.maximum(residual - expected, 0.0)
    return SpotFit(fits, charge, dr.sqrt(excess) / height, saturated)


def _fit(
    around: Around,
    spot: ExpectedSpot,
    guard: Int32,
    position: Float,
    sigma: Float,
    tolerance: Float,
    speckle: SpotSpeckle | None,
) -> tuple[Float, Float, Float, Float, Float, Mask]:
    """Fit height, position and width by weighted least squares, linear about a first guess.

    Returns the spot's charge, the mean square of the residuals and of their variance, χ², its degrees of freedom,
    and whether a pixel is saturated.
    """
    reach = farthest_pixel(spot)
    allowed = dr.square(tolerance * around(0)[0])
    scale = math.sqrt(0.5) / sigma
    middle = 0.5 * (dr.erf((0.5 - position) * scale) + dr.erf((0.5 + position) * scale))
    whole = around(0)[0] / dr.maximum(middle, 0.05)
    count, rows = 2 * reach + 1, read_rows(around, reach, guard)

    def add(
        number: UInt32, rows: list[Local], laid: list[Local], before: list[Float], sums: list[Float]
    ) -> Any:
        """Add a pixel to the sums, and note its weight and the derivatives of the spot's charge on it."""
        charge, variance, counts = (row.read(number) for row in rows)
        edge, below, density = before
        step = auto.Float(number) - reach
        edge_next = (step + 0.5 - position) * scale
        below_next, density_next = dr.erf(edge_next), dr.exp(-dr.square(edge_next))
        share = 0.5 * (below_next - below)
        moved = (density - density_next) * (scale / math.sqrt(math.pi))
        widened = edge * density - edge_next * density_next
        variance += around.baseline.level_variance
        if speckle is not None:
            variance += speckle.shape_variance(step - position) * dr.square(whole)
        weight = dr.select(counts > 0.0, dr.rcp(variance + allowed), 0.0)
        slopes = (share, moved, widened)
        for row, value in zip(laid, (weight, *slopes), strict=True):
            row.write(value, number)
        pairs = [weight * slopes[i] * slopes[j] for i in range(3) for j in range(i, 3)]
        added = [
            *pairs,
            *(weight * charge * slope for slope in slopes),
            dr.select(counts > 0.0, variance, 0.0),
            counts,
        ]
        sums = [total + value for total, value in zip(sums, added, strict=True)]
        return rows, laid, [edge_next, below_next, density_next], sums

    edge = (-reach - 0.5 - position) * scale
    before = [edge, dr.erf(edge), dr.exp(-dr.square(edge))]
    laid = [dr.alloc_local(auto.Float, count) for _ in range(4)]
    sums = [auto.Float(0.0) for _ in range(11)]
    rows, laid, _, sums = for_each(count, add, rows, laid, before, sums)
    *matrix, fa, fb, fc, noise, number = sums
    inverse = inverse_of(matrix)
    amount, shifted, wider = (row[0] * fa + row[1] * fb + row[2] * fc for row in inverse)

    def depart(
        number: UInt32, rows: list[Local], laid: list[Local], sums: list[Float], saturated: Mask
    ) -> tuple[Any, ...]:
        charge, _, counts = (row.read(number) for row in rows)
        weight, share, moved, widened = (row.read(number) for row in laid)
        residual = dr.square(charge - amount * share - shifted * moved - wider * widened)
        sums = [sums[0] + weight * residual, sums[1] + dr.select(counts > 0.0, residual, 0.0)]
        saturated = saturated | ((counts > 0.0) & around.full(auto.Int32(number) - reach))
        return rows, laid, sums, saturated

    start = [auto.Float(0.0) for _ in range(2)], auto.Bool(False)
    _, _, (chi_squared, squared), saturated = for_each(count, depart, rows, laid, *start)
    number = dr.maximum(number, 4.0)
    return amount, squared / number, noise / number, chi_squared, number - 3.0, saturated


def _quantile(freedom: Float, deviate: Float) -> Float:
    """Return the quantile of χ² at a standard normal deviate (Wilson and Hilferty's approximation)."""
    spread = 2.0 / (9.0 * freedom)
    cube = 1.0 - spread + deviate * dr.sqrt(spread)
    return freedom * dr.square(cube) * cube


def white_charge(spot: ExpectedSpot, pixel: Float, sine: Float, cosine: Float) -> Float:
    """Return the charge of a spot [electron] on a white Lambertian surface that faces the scanner (eq 19)."""
    return beside(sine, spot.white)[0] / dr.square(spot.range(pixel, sine, cosine))
