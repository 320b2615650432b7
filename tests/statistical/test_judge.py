"""The judge of ``compare``: its probabilities, its family of checks and its power, by simulation of plain numbers.

Levels: a right program fails a test of this file for fewer than one in 10⁴ seeds; seeds are fixed.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest, norm

from scanner_sim.validation.compare.judge import (
    POWERS,
    detectable,
    holm,
    interval,
    judge_checks,
    p_value,
    same,
)
from scanner_sim.validation.compare.law import Measured, Predicted, exact, mean_of, slope_of, spread_of

RUNS, SHOTS, LEVEL = 4000, 60, 0.01


def means(shift: float, seed: int) -> list[Measured]:
    """Return means of normal numbers of deviation 2 about 3 + shift."""
    values = np.random.default_rng(seed).normal(3.0 + shift, 2.0, (RUNS, SHOTS))
    return [mean_of(row) for row in values]


def spreads(factor: float, seed: int) -> list[Measured]:
    """Return standard deviations of normal numbers of deviation 2 · factor."""
    values = np.random.default_rng(seed).normal(0.0, 2.0 * factor, (RUNS, SHOTS))
    # The kurtosis of so few numbers is no estimate: the degrees of freedom are those of normal ones.
    return [Measured("spread", float(row.std(ddof=1)), 0.0, SHOTS - 1) for row in values]


@pytest.mark.parametrize("kind", ["mean", "spread"])
def test_p_is_uniform_where_the_law_holds(kind: str) -> None:
    """Claim: p of a true and exact closed form is evenly distributed between 0 and 1.

    Set-up: 4000 samples of 60 numbers. Expected: uniform. Tolerance: Kolmogorov and Smirnov's test at 10⁻⁴.
    """
    found = means(0.0, 1) if kind == "mean" else spreads(1.0, 2)
    law = Predicted("x", "", 3.0 if kind == "mean" else 2.0)
    assert kstest([p_value(one, law) for one in found], "uniform").pvalue > 1e-4


@pytest.mark.parametrize("kind", ["mean", "spread"])
def test_accuracy_is_never_anti_conservative(kind: str) -> None:
    """Claim: with the truth at the far end of the accuracy, p below a level has at most that probability.

    Set-up: as above, the truth 0.3 (means) and 8 % (standard deviations) away, accuracy the same; level 0.05. Expected:
    4000 × 0.05 = 200 of each or fewer. Tolerance: 200 + 55, four standard errors; and more than 60: it is not blind.
    """
    found = means(0.3, 3) if kind == "mean" else spreads(1.08, 4)
    law = Predicted("x", "", *((3.0, 0.3) if kind == "mean" else (2.0, 0.16)))
    accused = sum(p_value(one, law) < 0.05 for one in found)
    assert 60 < accused < 255


@pytest.mark.parametrize("kind", ["mean", "spread"])
@pytest.mark.parametrize("power", POWERS)
def test_power_is_what_it_says(kind: str, power: float) -> None:
    """Claim: the smallest deviation that is told is found with its probability.

    Set-up: a deviation as large as what ``detectable`` says of an average sample, level 0.01, with an accuracy of 0.1.
    Expected: 90 % and 99 % of 4000 runs, or more. Tolerance: four standard errors, 1.9 % and 0.6 %, and 3.6 % for the
    sample's own error in the place of the true one.
    """
    law = Predicted("x", "", 3.0 if kind == "mean" else 2.0, 0.1)
    average = (
        Measured("mean", 3.0, 2.0 / SHOTS**0.5, SHOTS - 1)
        if kind == "mean"
        else Measured("spread", 2.0, 0.0, SHOTS - 1)
    )
    away = detectable(average, law, LEVEL, power) * law.value
    found = means(away, 5) if kind == "mean" else spreads(1.0 + 0.5 * away, 6)
    share = np.mean([p_value(one, law) < LEVEL for one in found])
    assert power - 0.055 < share
    assert share < power + 0.055


def test_intervals_cover() -> None:
    """Claim: 95 % intervals hold the truth in 95 % of runs. Tolerance: four standard errors of 4000 runs, 1.4 %."""
    for found, truth in ((means(0.0, 7), 3.0), (spreads(1.0, 8), 2.0)):
        ends = np.array([interval(one) for one in found])
        assert np.mean((ends[:, 0] < truth) & (truth < ends[:, 1])) == pytest.approx(0.95, abs=0.014)


def test_holm_by_hand() -> None:
    """Claim: 0.01, 0.04, 0.03 of three become 0.03, 0.06, 0.06 (Holm 1979): 3 × 0.01, 2 × 0.03, and no less."""
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    assert holm([]) == []


@pytest.mark.slow
def test_the_family_keeps_its_level() -> None:
    """Claim: a family of 20 true checks has a broken one in at most the stated share of runs.

    Set-up: 400 families of 20 means at the level 0.05. Expected: at most 20 with a broken check. Tolerance: 20 + 17,
    four standard errors.
    """
    rows = [
        [mean_of(row) for row in block] for block in np.random.default_rng(9).normal(size=(400, 20, SHOTS))
    ]
    law = Predicted("x", "", 0.0, 0.0, 1.0)
    broken = sum(
        any(check.broken for check in judge_checks([("x", one, law) for one in row], 0.05)) for row in rows
    )
    assert broken < 38


def test_numbers_without_noise_take_no_part_in_a_family() -> None:
    """Claim: beside a number without noise, which has a verdict of its own, one with noise keeps its level: that of a
    mean one standard error away is 0.32."""
    shots = np.where(np.arange(SHOTS) % 2, 1.0, -1.0) + 1.0 / np.sqrt(SHOTS)
    away = ("b", mean_of(shots), Predicted("x", "", 0.0, 0.0, 1.0))
    outcome = judge_checks([("a", exact(1.0), Predicted("x", "", 1.1, 0.05)), away], 0.05)
    assert [check.broken for check in outcome] == [True, False]
    assert outcome[1].adjusted_p == outcome[1].p == pytest.approx(2.0 * norm.sf(1.0), abs=0.01)


@pytest.mark.slow
def test_long_tails_cost_degrees_of_freedom() -> None:
    """Claim: the standard error of a standard deviation is true for normal errors and for long tails.

    Set-up: 1500 groups of 2000 normal, and of 2000 Student-t numbers with 10 degrees of freedom (kurtosis 4). Expected:
    the scatter of the deviations. Tolerance: 8 %: four standard errors of 1/√(2·1500) are 7.3 %.
    """
    random = np.random.default_rng(10)
    for draw in (random.standard_normal((1500, 2000)), random.standard_t(10.0, (1500, 2000))):
        found = [spread_of(row[None]) for row in draw]
        scatter = np.std([one.value for one in found])
        assert np.median([one.error for one in found]) == pytest.approx(scatter, rel=0.08)


def test_error_of_a_slope() -> None:
    """Claim: the exponent of five standard deviations scatters by its stated error, about the truth.

    Set-up: 2000 runs, σ ∝ R³ at five ranges, 200 normal errors each. Expected: 3, and the error. Tolerance: four
    standard errors: of the mean, and 6.3 % of the scatter; the mean of ln s is off by −1/(2ν) at all ranges alike.
    """
    x, random = np.geomspace(2.0, 20.0, 5), np.random.default_rng(11)
    values = random.standard_normal((2000, 5, 200)).std(axis=2, ddof=1) * x**3
    found = [slope_of(x, [Measured("spread", float(s), 0.0, 199) for s in row]) for row in values]
    slopes = np.array([one.value for one in found])
    assert abs(slopes.mean() - 3.0) < 4.0 * found[0].error / np.sqrt(2000)
    assert slopes.std() == pytest.approx(found[0].error, rel=0.063)


@pytest.mark.slow
def test_two_runs_of_one_instrument_agree() -> None:
    """Claim: the probability that two runs differ so much is uniform for means and standard deviations."""
    for one, other in ((means(0.0, 12), means(0.0, 13)), (spreads(1.0, 14), spreads(1.0, 15))):
        p = [same(a, b, 0.0) for a, b in zip(one, other, strict=True)]
        assert kstest(p, "uniform").pvalue > 1e-4
    assert same(exact(1.0), exact(1.001), 0.01) == 1.0
    assert same(exact(1.0), exact(1.1), 0.01) == 0.0
