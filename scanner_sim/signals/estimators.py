"""Estimators of the sub-pixel position, as (shift, its derivative by each charge) about the brightest pixel.

With i the brightest pixel and f the line in electrons:

* ``centre_of_mass``: Σ j f_j / Σ f_j over i − 3 … i + 3;
* ``parabola``: vertex of the parabola through three pixels;
* ``gaussian``: the same on the logarithms, exact for a sampled Gaussian;
* ``blais_rioux_2``, ``_4``, ``_8``: zero crossing of g_h(i) = Σ_{k=1..h} f(i − k) − f(i + k), h = 1, 2, 4
  (Blais, Rioux, *Signal Processing* 11, 1986);
* ``maximum_likelihood``: the fit of the integrated spot (:mod:`~scanner_sim.signals.likelihood`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.signals.likelihood import Pixels, Slopes, Width, fit_spot
from scanner_sim.signals.processing import MARGIN, PeakMethod
from scanner_sim.signals.speckle import SpotSpeckle

Estimator = Callable[[Pixels], tuple[Any, Slopes]]
Correction = Callable[[Any, Any], tuple[Any, Any]]
"""Systematic error [pixel], and its derivative by the estimate, of (estimate, standard deviation of the spot)."""


@dataclass
class Estimate:
    """Positions, Dr.Jit arrays of shape (m,).

    ``shift`` from the centre of the brightest pixel [pixel]; ``variance`` [pixel²]; ``within`` whether the position
    lies in the estimator's window; ``settled`` whether a fit came to rest.
    """

    shift: Any
    variance: Any
    within: Any
    settled: Any


def estimate(
    method: PeakMethod,
    around: Pixels,
    width: Width | None = None,
    correction: Correction | None = None,
    speckle: SpotSpeckle | None = None,
) -> Estimate:
    """Estimate the place of the spot about its brightest pixel.

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
    Estimate
        The variance is the first-order propagation of every pixel's variance through the estimator's derivatives, of
        the two terms of the baseline, whose errors all pixels share, and of the covariance that speckle gives the
        charges. Of ``centre_of_mass`` that of the window's place is added (:func:`_jumps`).
    """
    known = width if width is not None else Width.unknown()
    apart, settled = auto.Float(0.0), auto.Bool(True)
    limit: Any = MARGIN[method]
    if method == "maximum_likelihood":
        fit = fit_spot(around, known, dr.clip(_gaussian(around)[0], -0.6, 0.6))
        shift, slopes, apart, settled = fit.shift, fit.slopes, fit.prior_variance, fit.settled
        limit = auto.Float(known.guard)
    else:
        shift, slopes = _ESTIMATORS[method](around)
    within = dr.abs(shift) <= limit

    def corrected(position: Any) -> tuple[Any, Any]:
        if correction is None or width is None:
            return position, auto.Float(1.0)
        error, rise = correction(position, dr.sqrt(width.variance))
        return position - error, 1.0 - rise

    variance, level, tilt = apart, auto.Float(0.0), auto.Float(0.0)
    if speckle is not None:
        variance += speckle.carried(slopes, {step: around(step)[0] for step in slopes}, shift)
    shift, stretch = corrected(shift)
    for step, slope in slopes.items():
        variance += dr.square(slope) * around(step)[1]
        level += slope
        tilt += step * slope
    baseline = around.baseline
    variance += dr.square(level) * baseline.level_variance + dr.square(tilt) * baseline.slope_variance
    variance *= dr.square(stretch)
    if method == "centre_of_mass":
        variance += _jumps(around, shift, lambda position: corrected(position)[0])
    return Estimate(shift, variance, within, settled)


def _mass(around: Pixels, middle: int) -> tuple[Any, Any]:
    """Return the centre of mass of the seven pixels about a step, counted from that step, and their charge."""
    reach = MARGIN["centre_of_mass"]
    total, moment = auto.Float(0.0), auto.Float(0.0)
    for step in range(-reach, reach + 1):
        charge, _ = around(middle + step)
        total += charge
        moment += step * charge
    return moment / total, total


def _jumps(around: Pixels, shift: Any, corrected: Callable[[Any], Any]) -> Any:
    """Return the variance that the window's place adds to the centre of mass [pixel²].

    Noise makes a neighbour the brightest pixel with the probability q = Φ(−Δ/√(var_0 + var_1)), Δ the difference of
    the two charges; the window moves with it, and the estimate by D. A position that is one of two has the variance
    q (1 − q) D². Taken at the measured Δ it is right on the average over the places in a pixel.
    """
    added = auto.Float(0.0)
    charge, noise = around(0)
    for side in (-1, 1):
        beside, noise_beside = around(side)
        deviate = (charge - beside) * dr.rsqrt(dr.maximum(noise + noise_beside, 1e-12))
        other = 0.5 * (1.0 - dr.erf(dr.maximum(deviate, 0.0) * math.sqrt(0.5)))
        moved = side + corrected(_mass(around, side)[0]) - shift
        possible = around.inside(side * (MARGIN["centre_of_mass"] + 1))
        added += dr.select(possible, other * (1.0 - other) * dr.square(moved), 0.0)
    return added


def _centre_of_mass(around: Pixels) -> tuple[Any, Slopes]:
    reach = MARGIN["centre_of_mass"]
    shift, total = _mass(around, 0)
    return shift, {step: (step - shift) / total for step in range(-reach, reach + 1)}


def _vertex(left: Any, middle: Any, right: Any) -> tuple[Any, Slopes]:
    """Return the vertex of a parabola through three points and its derivatives by them."""
    bend = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / bend
    return shift, {
        -1: (1.0 - 2.0 * shift) / (2.0 * bend),
        0: 2.0 * shift / bend,
        1: -(1.0 + 2.0 * shift) / (2.0 * bend),
    }


def _parabola(around: Pixels) -> tuple[Any, Slopes]:
    return _vertex(*(around(step)[0] for step in (-1, 0, 1)))


def positive(charge: Any, floor_sigma: Any) -> Any:
    """Return a charge that has a logarithm: at or below the noise floor it counts as half the floor."""
    return dr.maximum(charge, dr.maximum(0.5 * floor_sigma, 1e-3))


def _gaussian(around: Pixels) -> tuple[Any, Slopes]:
    charges = {step: positive(around(step)[0], around.floor_sigma) for step in (-1, 0, 1)}
    shift, slopes = _vertex(*(dr.log(charge) for charge in charges.values()))
    return shift, {step: slopes[step] / charge for step, charge in charges.items()}


def _blais_rioux(half: int) -> Estimator:
    """Return the estimator of Blais and Rioux with ``2 half`` filter taps."""

    def estimator(around: Pixels) -> tuple[Any, Slopes]:
        reach = half + 1
        charges = {step: around(step)[0] for step in range(-reach, reach + 1)}

        def response(at: int) -> Any:
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


_ESTIMATORS: dict[PeakMethod, Estimator] = {
    "centre_of_mass": _centre_of_mass,
    "parabola": _parabola,
    "gaussian": _gaussian,
    "blais_rioux_2": _blais_rioux(1),
    "blais_rioux_4": _blais_rioux(2),
    "blais_rioux_8": _blais_rioux(4),
}
