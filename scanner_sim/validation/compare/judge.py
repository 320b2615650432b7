"""The judge: intervals, probabilities, a family of checks with one level, and what could have been found.

A closed form is exact to an accuracy δ, by the orders that it leaves out. The hypothesis is hence that the truth lies
within δ of the prediction, and p is the largest probability of what was found under it. With δ = 0 these are the plain
two-sided tests: Student's t for means, χ² for standard deviations. A number without noise has p = 1 or 0.

All checks of a comparison are one family. Holm's procedure (*Scand. J. Statist.* 6, 1979, 65) keeps the probability of
any false alarm at the stated level, however the checks depend on one another. Power is stated for the level of its
first step, level/m of m checks (Bonferroni), and hence rather too low.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import chdtr, chdtrc, chdtri, fdtr, fdtrc, gammaincinv, ndtr, ndtri, stdtr, stdtrit

from scanner_sim.products.comparison import CONFIDENCE, Check
from scanner_sim.validation.compare.law import Measured, Predicted

POWERS = (0.90, 0.99)
"""Probabilities of detection for which the smallest deviation is stated."""


def interval(measured: Measured, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the confidence interval of a measured number: Student's t, or χ² for a standard deviation."""
    value, tail = measured.value, 0.5 * (1.0 - confidence)
    if measured.form == "exact":
        return value, value
    if measured.form == "mean":
        reach = measured.error * _t(1.0 - tail, measured.freedom)
        return value - reach, value + reach
    low, high = (math.sqrt(measured.freedom / _chi2(q, measured.freedom)) for q in (1.0 - tail, tail))
    return value * low, value * high


def p_value(measured: Measured, predicted: Predicted) -> float:
    """Return the probability of a deviation at least as large, if the truth lies within the prediction's accuracy.

    Means: P(|T| ≥ |x − x₀|/s) with the truth δ away on the same side. Standard deviations: twice the smaller tail of χ²
    for the truth at the far end of ±δ.
    """
    away, slack = measured.value - predicted.value, predicted.accuracy
    if not math.isfinite(away):
        return 0.0
    if measured.form == "exact":
        return 1.0 if abs(away) <= slack else 0.0
    if measured.form == "mean":
        if measured.error == 0.0:
            return 1.0 if abs(away) <= slack else 0.0
        far, near = (abs(away) + slack) / measured.error, (abs(away) - slack) / measured.error
        return min(1.0, _t_above(near, measured.freedom) + _t_above(far, measured.freedom))
    squares = measured.freedom * measured.value**2
    above = float(chdtrc(measured.freedom, squares / (predicted.value + slack) ** 2))
    below = float(chdtr(measured.freedom, squares / max(predicted.value - slack, 1e-300) ** 2))
    return min(1.0, 2.0 * min(above, below))


def detectable(measured: Measured, predicted: Predicted, level: float, power: float) -> float:
    """Return the smallest relative deviation that a test at a level finds with a probability.

    δ + (t_{1−level/2} + t_{power}) s for means, to either side, and for standard deviations
    (1 + δ/σ) √(χ²_{1−level/2}/χ²_{1−power}) − 1 upwards: with a power of a half or more less is enough downwards.
    """
    slack = predicted.accuracy
    if measured.form == "exact":
        return slack / predicted.divisor
    if measured.form == "mean":
        reach = _t(1.0 - 0.5 * level, measured.freedom) + _t(power, measured.freedom)
        return (slack + reach * measured.error) / predicted.divisor
    nu, relative = measured.freedom, slack / predicted.value
    upwards = (1.0 + relative) * math.sqrt(float(chdtri(nu, 0.5 * level)) / _chi2(1.0 - power, nu)) - 1.0
    return upwards * predicted.value / predicted.divisor


def holm(p: Sequence[float]) -> list[float]:
    """Return adjusted probabilities: the k-th smallest of m times m − k + 1, ascending, 1 at most."""
    order = np.argsort(p, kind="stable")
    adjusted, largest = [0.0] * len(p), 0.0
    for rank, index in enumerate(order):
        largest = max(largest, min(1.0, (len(p) - rank) * p[index]))
        adjusted[index] = largest
    return adjusted


def judge_checks(cases: Sequence[tuple[str, Measured, Predicted]], level: float) -> list[Check]:
    """Return the checks of a whole family at a level.

    Parameters
    ----------
    cases
        For each its name, what was measured and what is predicted.
    level
        Probability with which a right program breaks any of them.
    """
    probabilities = [p_value(measured, predicted) for _, measured, predicted in cases]
    # A number without noise raises no false alarm, and takes nothing from the level of the others.
    noisy = [number for number, (_, measured, _) in enumerate(cases) if measured.form != "exact"]
    family = list(probabilities)
    for number, adjusted in zip(noisy, holm([probabilities[number] for number in noisy]), strict=True):
        family[number] = adjusted
    checks = []
    for (case, measured, predicted), p, adjusted in zip(cases, probabilities, family, strict=True):
        low, high = interval(measured)
        least, most = (detectable(measured, predicted, level / max(len(noisy), 1), power) for power in POWERS)
        checks.append(
            Check(
                case=case,
                quantity=predicted.quantity,
                unit=predicted.unit,
                form=measured.form,
                predicted=predicted.value,
                accuracy=predicted.accuracy,
                simulated=measured.value,
                error=measured.error,
                freedom=measured.freedom,
                low=low,
                high=high,
                effect=(measured.value - predicted.value) / predicted.divisor,
                scale=predicted.divisor,
                relative_to=predicted.relative_to,
                p=p,
                adjusted_p=adjusted,
                detects_90=least,
                detects_99=most,
                broken=adjusted < level,
            )
        )
    return checks


def same(one: Measured, other: Measured, accuracy: float) -> float:
    """Return the probability that two runs differ at least as much as they do: Welch's t, or Fisher's F.

    Numbers without noise are the same within the accuracy of their closed form.
    """
    if one.form == "spread":
        ratio = (one.value / other.value) ** 2
        tails = (float(tail(one.freedom, other.freedom, ratio)) for tail in (fdtrc, fdtr))
        return float(min(1.0, 2.0 * min(tails)))
    error = math.hypot(one.error, other.error)
    if error == 0.0:
        return 1.0 if abs(one.value - other.value) <= accuracy else 0.0
    shares = sum(part.error**4 / part.freedom for part in (one, other))
    freedom = error**4 / shares if shares else math.inf
    return min(1.0, 2.0 * _t_above(abs(one.value - other.value) / error, freedom))


def _t(share: float, freedom: float) -> float:
    return float(ndtri(share) if math.isinf(freedom) else stdtrit(freedom, share))


def _t_above(value: float, freedom: float) -> float:
    return float(ndtr(-value) if math.isinf(freedom) else stdtr(freedom, -value))


def _chi2(share: float, freedom: float) -> float:
    return 2.0 * float(gammaincinv(0.5 * freedom, share))
