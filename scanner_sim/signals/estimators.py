"""Estimators of the sub-pixel position, as (shift, its derivative by each charge) about the brightest pixel.

With i the brightest pixel and f the line in electrons:

* ``centre_of_mass``: Σ j f_j / Σ f_j over i − 3 … i + 3;
* ``parabola``: vertex of the parabola through three pixels;
* ``gaussian``: the same on the logarithms, exact for a sampled Gaussian;
* ``blais_rioux_2``, ``_4``, ``_8``: zero crossing of g_h(i) = Σ_{k=1..h} f(i − k) − f(i + k), h = 1, 2, 4
  (Blais, Rioux, *Signal Processing* 11, 1986).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.signals.line import Around
from scanner_sim.signals.processing import PeakMethod

MARGIN: dict[PeakMethod, int] = {
    "centre_of_mass": 3,
    "parabola": 1,
    "gaussian": 1,
    "blais_rioux_2": 2,
    "blais_rioux_4": 3,
    "blais_rioux_8": 5,
}
"""Pixels to each side of the brightest one that an estimator reads."""

Slopes = dict[int, Any]
"""Derivative of the position by the charge of the pixel at each step [pixel/electron]."""
Estimator = Callable[[Around], tuple[Any, Slopes]]


def estimate(method: PeakMethod, around: Around) -> tuple[Any, Any]:
    """Return the shift from the brightest pixel [pixel] and its variance [pixel²].

    The variance is the first-order propagation of every pixel's variance through the estimator's derivatives,
    and of the two terms of the baseline, whose errors all pixels share.
    """
    shift, slopes = _ESTIMATORS[method](around)
    variance, level, tilt = auto.Float(0.0), auto.Float(0.0), auto.Float(0.0)
    for step, slope in slopes.items():
        variance += dr.square(slope) * around(step)[1]
        level += slope
        tilt += step * slope
    baseline = around.baseline
    shared = dr.square(level) * baseline.level_variance + dr.square(tilt) * baseline.slope_variance
    return shift, variance + shared


def _centre_of_mass(around: Around) -> tuple[Any, Slopes]:
    reach = MARGIN["centre_of_mass"]
    total, moment = auto.Float(0.0), auto.Float(0.0)
    for step in range(-reach, reach + 1):
        charge, _ = around(step)
        total += charge
        moment += step * charge
    shift = moment / total
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


def _parabola(around: Around) -> tuple[Any, Slopes]:
    return _vertex(*(around(step)[0] for step in (-1, 0, 1)))


def positive(charge: Any, floor_sigma: Any) -> Any:
    """Return a charge that has a logarithm: at or below the noise floor it counts as half the floor."""
    return dr.maximum(charge, dr.maximum(0.5 * floor_sigma, 1e-3))


def _gaussian(around: Around) -> tuple[Any, Slopes]:
    charges = {step: positive(around(step)[0], around.floor_sigma) for step in (-1, 0, 1)}
    shift, slopes = _vertex(*(dr.log(charge) for charge in charges.values()))
    return shift, {step: slopes[step] / charge for step, charge in charges.items()}


def _blais_rioux(half: int) -> Estimator:
    """Return the estimator of Blais and Rioux with ``2 half`` filter taps."""

    def estimator(around: Around) -> tuple[Any, Slopes]:
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
