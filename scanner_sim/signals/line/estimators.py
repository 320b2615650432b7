"""Estimators of the sub-pixel position, as (shift, its derivative by each charge) about the brightest pixel.

With i the brightest pixel and f the line in electrons:

* ``centre_of_mass``: Σ j f_j / Σ f_j over i − 3 … i + 3;
* ``parabola``: vertex of the parabola through three pixels;
* ``gaussian``: the same on the logarithms, exact for a sampled Gaussian;
* ``blais_rioux_2``, ``_4``, ``_8``: zero crossing of g_h(i) = Σ_{k=1..h} f(i − k) − f(i + k), h = 1, 2, 4
  (Blais, Rioux, *Signal Processing* 11, 1986);
* ``maximum_likelihood``: the fit of the integrated spot (:mod:`~scanner_sim.signals.line.likelihood`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.foundation.device_loops import for_each
from scanner_sim.foundation.device_types import Float, Local, Mask, UInt32
from scanner_sim.signals.line.likelihood import Pixels, Slopes, Width, fit_spot
from scanner_sim.signals.line.pixel_row import row_of
from scanner_sim.signals.line.speckle import SpotSpeckle
from scanner_sim.signals.processing import MARGIN, PeakMethod

_LARGEST_CURVATURE_VARIANCE = 0.5
"""Largest relative variance of a vertex's curvature that σ still follows."""

Estimator = Callable[[Pixels], tuple[Float, Slopes]]
Correction = Callable[[Float, Float], tuple[Float, Float]]
"""Systematic error [pixel], and its derivative by the estimate, of (estimate, standard deviation of the spot)."""


@dataclass
class PeakEstimate:
    """Positions, Dr.Jit arrays of shape (m,).

    ``shift`` from the centre of the brightest pixel [pixel]; ``variance`` [pixel²]; ``within`` whether the position
    lies in the estimator's window; ``converged`` whether a fit converged.
    """

    shift: Float
    variance: Float
    within: Mask
    converged: Mask


def estimate(
    method: PeakMethod,
    around: Pixels,
    width: Width | None = None,
    correction: Correction | None = None,
    speckle: SpotSpeckle | None = None,
) -> PeakEstimate:
    """Estimate the position of the spot about its brightest pixel.

    Parameters
    ----------
    method
        The estimator.
    around
        Charges about the brightest pixel.
    width
        What is known of the spot's width; without it ``maximum_likelihood`` fits it freely.
    correction
        The estimator's systematic error, to be taken off; needs ``width``.
    speckle
        What is known of the speckle on the spot; without it there is none.

    Returns
    -------
    PeakEstimate
        The variance is the first-order propagation of every pixel's variance through the estimator's derivatives, of
        the two terms of the baseline, whose errors all pixels share, and of the covariance that speckle gives the
        charges. Where the light differs from side to side, that of an edge somewhere beneath the spot is added
        (:func:`_edge_variance`), and of ``centre_of_mass`` that of the window's position (:func:`_window_variance`).
    """
    known = width if width is not None else Width.unknown()
    apart, converged = auto.Float(0.0), auto.Bool(True)
    limit: Float = MARGIN[method]
    if method == "maximum_likelihood":
        speckle_variance = None if speckle is None else speckle.single
        fit = fit_spot(around, known, dr.clip(_gaussian(around)[0], -0.6, 0.6), speckle_variance)
        shift, slopes, apart, converged = fit.shift, fit.slopes, fit.prior_variance, fit.converged
        limit = auto.Float(known.guard)
    else:
        shift, slopes = CLOSED_FORMS[method](around)
    within = dr.abs(shift) <= limit

    def corrected(position: Float) -> tuple[Float, Float]:
        if correction is None or width is None:
            return position, auto.Float(1.0)
        error, rise = correction(position, dr.sqrt(width.variance))
        return position - error, 1.0 - rise

    variance, level, tilt = apart, auto.Float(0.0), auto.Float(0.0)
    if speckle is not None:
        variance += speckle.propagated_variance(slopes, {step: around(step)[0] for step in slopes}, shift)
    shift, stretch = corrected(shift)
    steps = sorted(slopes)
    row = row_of([slopes[step] for step in steps])

    def add(number: UInt32, row: Local, variance: Float, level: Float, tilt: Float) -> tuple[Any, ...]:
        step, slope = auto.Int32(number) + steps[0], row.read(number)
        noise = dr.square(slope) * around(step)[1]
        return row, variance + noise, level + slope, tilt + auto.Float(step) * slope

    row, variance, level, tilt = for_each(len(steps), add, row, variance, level, tilt)
    baseline = around.baseline
    variance += dr.square(level) * baseline.level_variance + dr.square(tilt) * baseline.slope_variance
    variance += baseline.step_squared * _edge_variance(row, len(steps), level, tilt, baseline.distance)
    variance *= dr.square(stretch) * _curvature_inflation(method, around, shift, speckle)
    if method == "centre_of_mass":
        variance += _window_variance(around, shift, lambda position: corrected(position)[0], speckle)
    return PeakEstimate(shift, variance, within, converged)


def _edge_variance(slopes: Local, count: int, level: Float, tilt: Float, distance: Float) -> Float:
    """Return the mean square of what an edge of 1 electron beneath the spot moves the position by [pixel²/electron²].

    The two sides of the spot tell that there is a step, and not where: it is as likely at any place between their
    middles, which lie W on either side. A step behind pixel k adds H(j > k) − 1/2 − j/(2W) to what the straight
    baseline takes off pixel j, and with the derivatives h_j moves the position by Σ_{j>k} h_j − Σ h_j/2 − Σ j h_j/(2W).

    Parameters
    ----------
    slopes
        Derivatives h_j of the position by the charges [pixel/electron], a row.
    count
        How many there are.
    level, tilt
        Σ h_j and Σ j h_j.
    distance
        W [pixel].
    """
    middle = 0.5 * level
    lean = 0.5 * tilt / distance

    def add(number: UInt32, slopes: Local, beyond: Float, squared: Float) -> tuple[Any, ...]:
        beyond = beyond - slopes.read(number)
        return slopes, beyond, squared + dr.square(beyond)

    inner, beyond = count - 1, level - middle - lean
    squared = for_each(inner, add, slopes, beyond, auto.Float(0.0))[2]
    outside = dr.maximum(2.0 * distance - inner, 0.0)
    squared += outside * (dr.square(middle) + dr.square(lean))
    return squared / (outside + inner)


def _curvature_inflation(
    method: PeakMethod, around: Pixels, shift: Float, speckle: SpotSpeckle | None
) -> Float:
    """Return by how much speckle in the curvature raises the variance of a vertex; 1 for the other estimators.

    With the half difference A of the outer points and the curvature B the vertex is s = A/B, of the variance (var A +
    s² var B)/B² at its true position s. What is known is the measured one; that of the true position is, on the
    average, larger by the variance itself, hence var s = (var A + ŝ² var B)/(B² − var B). It matters where a pixel's
    relative noise is large: there the positions that noise moves towards a pixel's centre would claim too small a σ.
    """
    if speckle is None or method not in ("gaussian", "parabola"):
        return auto.Float(1.0)
    charges = {step: around(step)[0] for step in (-1, 0, 1)}
    points, slopes = dict(charges), {-1: auto.Float(-1.0), 0: auto.Float(2.0), 1: auto.Float(-1.0)}
    if method == "gaussian":
        floored = {step: positive(charge, around.floor_sigma) for step, charge in charges.items()}
        points = {step: dr.log(charge) for step, charge in floored.items()}
        slopes = {step: slope / floored[step] for step, slope in slopes.items()}
    curvature = 2.0 * points[0] - points[-1] - points[1]
    noise = sum((dr.square(slope) * around(step)[1] for step, slope in slopes.items()), auto.Float(0.0))
    noise += speckle.propagated_variance(slopes, charges, shift)
    return dr.rcp(
        1.0 - dr.minimum(noise / dr.maximum(dr.square(curvature), 1e-30), _LARGEST_CURVATURE_VARIANCE)
    )


def _mass(around: Pixels, middle: int) -> tuple[Float, Float]:
    """Return the centre of mass of the seven pixels about a step, counted from that step, and their charge."""
    reach = MARGIN["centre_of_mass"]
    total, moment = auto.Float(0.0), auto.Float(0.0)
    for step in range(-reach, reach + 1):
        charge, _ = around(middle + step)
        total += charge
        moment += step * charge
    return moment / total, total


def _window_variance(
    around: Pixels, shift: Float, corrected: Callable[[Float], Float], speckle: SpotSpeckle | None
) -> Float:
    """Return the variance that the window's position adds to the centre of mass [pixel²].

    Noise makes a neighbour the brightest pixel with the probability q = Φ(−Δ/√(var_0 + var_1)), Δ the difference of
    the two charges; the window moves with it, and the estimate by D. A position that is one of two has the variance
    q (1 − q) D². Taken at the measured Δ it is right on the average over the positions in a pixel.
    """
    added = auto.Float(0.0)
    charge, noise = around(0)
    for side in (-1, 1):
        beside, noise_beside = around(side)
        both = noise + noise_beside
        if speckle is not None:
            apart = {0: auto.Float(1.0), side: auto.Float(-1.0)}
            both += speckle.propagated_variance(apart, {0: charge, side: beside}, shift)
        deviate = (charge - beside) * dr.rsqrt(dr.maximum(both, 1e-12))
        other = 0.5 * (1.0 - dr.erf(dr.maximum(deviate, 0.0) * math.sqrt(0.5)))
        moved = side + corrected(_mass(around, side)[0]) - shift
        possible = around.inside(side * (MARGIN["centre_of_mass"] + 1))
        added += dr.select(possible, other * (1.0 - other) * dr.square(moved), 0.0)
    return added


def _centre_of_mass(around: Pixels) -> tuple[Float, Slopes]:
    reach = MARGIN["centre_of_mass"]
    shift, total = _mass(around, 0)
    return shift, {step: (step - shift) / total for step in range(-reach, reach + 1)}


def _vertex(left: Float, middle: Float, right: Float) -> tuple[Float, Slopes]:
    """Return the vertex of a parabola through three points and its derivatives by them."""
    curvature = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / curvature
    return shift, {
        -1: (1.0 - 2.0 * shift) / (2.0 * curvature),
        0: 2.0 * shift / curvature,
        1: -(1.0 + 2.0 * shift) / (2.0 * curvature),
    }


def _parabola(around: Pixels) -> tuple[Float, Slopes]:
    return _vertex(*(around(step)[0] for step in (-1, 0, 1)))


def positive(charge: Float, floor_sigma: Float) -> Float:
    """Return a charge that has a logarithm: at or below the noise floor it counts as half the floor."""
    return dr.maximum(charge, dr.maximum(0.5 * floor_sigma, 1e-3))


def _gaussian(around: Pixels) -> tuple[Float, Slopes]:
    charges = {step: positive(around(step)[0], around.floor_sigma) for step in (-1, 0, 1)}
    shift, slopes = _vertex(*(dr.log(charge) for charge in charges.values()))
    return shift, {step: slopes[step] / charge for step, charge in charges.items()}


def _blais_rioux(half: int) -> Estimator:
    """Return the estimator of Blais and Rioux with ``2 half`` filter taps."""

    def estimator(around: Pixels) -> tuple[Float, Slopes]:
        reach = half + 1
        charges = {step: around(step)[0] for step in range(-reach, reach + 1)}

        def response(at: int) -> Float:
            total = auto.Float(0.0)
            for step in range(1, half + 1):
                total += charges[at - step] - charges[at + step]
            return total

        before, here, after = response(-1), response(0), response(1)
        # g rises through zero at the peak: to the right of the centre where it is still negative there.
        right = here < 0.0
        low, high = dr.select(right, here, before), dr.select(right, after, here)
        rise = high - low
        shift = dr.select(right, 0.0, -1.0) - low / rise
        by_low, by_high = -high / dr.square(rise), low / dr.square(rise)
        slopes = {}
        for step in charges:
            taps = [_tap(step - at, half) for at in (-1, 0, 1)]
            slopes[step] = dr.select(
                right, by_low * taps[1] + by_high * taps[2], by_low * taps[0] + by_high * taps[1]
            )
        return shift, slopes

    return estimator


def _tap(distance: int, half: int) -> float:
    """Return the weight of a pixel in g_h at a distance from its centre."""
    if distance == 0 or abs(distance) > half:
        return 0.0
    return 1.0 if distance < 0 else -1.0


CLOSED_FORMS: dict[PeakMethod, Estimator] = {
    "centre_of_mass": _centre_of_mass,
    "parabola": _parabola,
    "gaussian": _gaussian,
    "blais_rioux_2": _blais_rioux(1),
    "blais_rioux_4": _blais_rioux(2),
    "blais_rioux_8": _blais_rioux(4),
}
"""Those whose position follows from the charges alone, in closed form: noise has no part in their weights."""
