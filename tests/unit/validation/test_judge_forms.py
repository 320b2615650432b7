"""The judge's probabilities and power by hand, against the forms that its sources print."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2, f, kurtosis, norm, t

from scanner_sim.validation.compare.judge import detectable, holm, interval, judge_checks, p_value, same
from scanner_sim.validation.compare.law import (
    Measured,
    Predicted,
    mean_of,
    slope_of,
    slope_predicted,
    spread_of,
)

LAW = Predicted("x", "m", 4.0, 0.1)


def test_intervals_are_students_and_those_of_chi_squared() -> None:
    low, high = interval(Measured("mean", 4.0, 0.2, 9), 0.95)
    assert (low, high) == pytest.approx((4.0 - 0.2 * t.ppf(0.975, 9), 4.0 + 0.2 * t.ppf(0.975, 9)))
    assert interval(Measured("mean", 4.0, 0.2), 0.95)[1] == pytest.approx(4.0 + 0.2 * norm.ppf(0.975))
    low, high = interval(Measured("spread", 4.0, 0.0, 9), 0.95)
    wanted = 4.0 * math.sqrt(9.0 / chi2.ppf(0.975, 9)), 4.0 * math.sqrt(9.0 / chi2.ppf(0.025, 9))
    assert (low, high) == pytest.approx(wanted)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_truth_lies_where_it_suits_the_law_best(side: float) -> None:
    """Claim: of means P(|T| beyond) with the truth at the near end of the accuracy; of scatters twice a tail of χ²."""
    found = Measured("mean", 4.0 + side * 0.6, 0.2, 12)
    assert p_value(found, LAW) == pytest.approx(t.sf(2.5, 12) + t.sf(3.5, 12))
    within = Measured("mean", 4.0 + side * 0.05, 0.2, 12)
    assert p_value(within, LAW) == pytest.approx(min(1.0, t.sf(-0.25, 12) + t.sf(0.75, 12)))
    spread = Measured("spread", 4.0 * (1.0 + side * 0.3), 0.0, 30)
    squares = 30.0 * spread.value**2
    tail = chi2.sf(squares / 4.1**2, 30) if side > 0.0 else chi2.cdf(squares / 3.9**2, 30)
    assert p_value(spread, LAW) == pytest.approx(2.0 * tail)
    for away, p in ((0.099, 1.0), (0.101, 0.0)):
        assert p_value(Measured("exact", 4.0 + side * away), LAW) == p
        assert p_value(Measured("mean", 4.0 + side * away, 0.0, 5), LAW) == p
    assert p_value(Measured("mean", math.nan, 0.1, 5), LAW) == 0.0


@pytest.mark.parametrize("power", [0.9, 0.99])
def test_what_would_be_found_is_two_sided(power: float) -> None:
    """Claim: (δ + (t_{1−level/2} + t_power) s)/x₀ for means; for scatters that of the side that needs more, upwards."""
    level = 0.01
    reach = t.ppf(1.0 - 0.5 * level, 20) + t.ppf(power, 20)
    found = Measured("mean", 3.9, 0.3, 20)
    assert detectable(found, LAW, level, power) == pytest.approx((0.1 + reach * 0.3) / 4.0)
    scaled = Predicted("x", "m", 4.0, 0.1, 2.0, "two")
    assert detectable(found, scaled, level, power) == pytest.approx((0.1 + reach * 0.3) / 2.0)
    spread = Measured("spread", 4.0, 0.0, 20)
    up = (1.0 + 0.025) * math.sqrt(chi2.isf(0.5 * level, 20) / chi2.ppf(1.0 - power, 20)) - 1.0
    down = 1.0 - (1.0 - 0.025) * math.sqrt(chi2.ppf(0.5 * level, 20) / chi2.ppf(power, 20))
    assert detectable(spread, LAW, level, power) == pytest.approx(up)
    # Downwards less is enough, of few and of many, and the more so the larger δ is.
    many, tail = np.meshgrid([1.0, 3.0, 20.0, 300.0, 1e4], [0.1, 1e-3, 1e-6])
    above = np.sqrt(chi2.isf(0.5 * tail, many) / chi2.ppf(1.0 - power, many)) - 1.0
    below = 1.0 - np.sqrt(chi2.ppf(0.5 * tail, many) / chi2.ppf(power, many))
    assert (below < above).all()
    assert down < up
    # A deviation so large is found with the power.
    true = 4.1 * (1.0 + up) / 1.025
    assert chi2.sf(chi2.isf(0.5 * level, 20) * 4.1**2 / true**2, 20) == pytest.approx(power)
    assert detectable(Measured("exact", 4.0), LAW, level, power) == pytest.approx(0.025)


def test_two_runs_differ_by_welch_and_fisher() -> None:
    one, other = Measured("mean", 4.0, 0.2, 10), Measured("mean", 4.5, 0.1, 30)
    error = math.hypot(0.2, 0.1)
    freedom = error**4 / (0.2**4 / 10 + 0.1**4 / 30)
    assert same(one, other, 0.0) == pytest.approx(2.0 * t.sf(0.5 / error, freedom))
    wide, narrow = Measured("spread", 4.0, 0.0, 10), Measured("spread", 3.0, 0.0, 30)
    assert same(wide, narrow, 0.0) == pytest.approx(2.0 * f.sf(16.0 / 9.0, 10, 30))
    assert same(narrow, wide, 0.0) == pytest.approx(2.0 * f.cdf(9.0 / 16.0, 30, 10))
    for away, p in ((0.09, 1.0), (0.11, 0.0), (-0.11, 0.0)):
        assert same(Measured("exact", 4.0), Measured("exact", 4.0 + away), 0.1) == p


def test_a_family_spends_its_level_once() -> None:
    """Claim: Holm's factors m, m − 1, … by order and never falling; numbers without noise take nothing from it."""
    assert holm([0.01, 0.5, 0.012, 0.9]) == pytest.approx([0.04, 1.0, 0.04, 1.0])
    assert holm([0.2, 0.01]) == pytest.approx([0.2, 0.02])
    law = Predicted("x", "", 0.0, 0.0, 1.0, "one")
    cases = [
        ("exact", Measured("exact", 0.0), law),
        ("near", Measured("mean", 0.5, 1.0), law),
        ("spread", Measured("spread", 1.15, 0.0, 50), Predicted("x", "", 1.0)),
        ("far", Measured("mean", 2.5, 1.0), law),
    ]
    level = 0.02
    checks = judge_checks(cases, level)
    alone = [p_value(measured, predicted) for _, measured, predicted in cases]
    assert [check.p for check in checks] == pytest.approx(alone)
    wanted = holm([alone[1], alone[2], alone[3]])
    assert [check.adjusted_p for check in checks] == pytest.approx([1.0, *wanted])
    # By itself it would break its law; among three it does not.
    assert alone[3] < level < checks[3].adjusted_p
    assert not any(check.broken for check in checks)
    for check, (_, measured, predicted) in zip(checks, cases, strict=True):
        assert check.detects_90 == pytest.approx(detectable(measured, predicted, level / 3.0, 0.9))
        assert (check.low, check.high) == interval(measured)
    assert checks[3].effect == pytest.approx(2.5)
    (broken,) = judge_checks([cases[3]], level)
    assert broken.broken


def test_means_scatters_and_slopes_state_their_errors() -> None:
    """Claim: s/√n with n − 1; degrees of freedom 2n/(k − 1) by the kurtosis; ln s errs by 1/√(2ν)."""
    rng = np.random.default_rng(4)
    values = rng.normal(3.0, 2.0, 41)
    found = mean_of(np.append(values, np.nan))
    assert found.value == pytest.approx(values.mean())
    assert found.error == pytest.approx(values.std(ddof=1) / math.sqrt(41))
    assert found.freedom == 40
    groups = rng.standard_t(6, (3, 200)) * np.array([[1.0], [2.0], [4.0]]) + np.array([[5.0], [0.0], [-7.0]])
    spread = spread_of(groups)
    variances = groups.var(axis=1, ddof=1)
    assert spread.value == pytest.approx(math.sqrt(variances.mean()))
    scaled = (groups - groups.mean(axis=1, keepdims=True)) / np.sqrt(variances)[:, None]
    each = 199 * 2.0 / (kurtosis(scaled.ravel(), fisher=False) - 1.0)
    freedom = variances.sum() ** 2 / np.sum(variances**2 / each)
    assert spread.freedom == pytest.approx(freedom)
    assert spread.error == pytest.approx(spread.value / math.sqrt(2.0 * freedom))
    about_zero = spread_of(groups, about_mean=False)
    assert about_zero.value == pytest.approx(math.sqrt(np.mean(groups**2)))
    x = np.array([2.0, 5.0, 20.0])
    scatters = [
        Measured("spread", 3.0 * place**1.5, 0.0, nu) for place, nu in zip(x, (10.0, 40.0, 90.0), strict=True)
    ]
    slope = slope_of(x, scatters)
    away = np.log(x) - np.log(x).mean()
    weights = away / (away @ away)
    assert slope.value == pytest.approx(1.5)
    assert slope.error == pytest.approx(math.sqrt(np.sum(weights**2 / (2.0 * np.array([10.0, 40.0, 90.0])))))
    told = slope_predicted(x, [Predicted("s", "m", 3.0 * place**1.5, 0.01 * place**1.5) for place in x], "k")
    assert told.value == pytest.approx(1.5)
    assert told.accuracy == pytest.approx(np.sum(np.abs(weights)) / 300.0)
    assert told.divisor == 1.0
