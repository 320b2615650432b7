"""What a key does to a measure: found where it is there, and not found where it is not."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from scanner_sim.campaign.dependence import by_bin, by_level

TABLES = 2000


def test_the_interval_is_what_chance_stays_within_in_95_of_100_tables() -> None:
    """Claim: without any dependence 5 % of tables change by more than their interval, in blocks and in bins.

    Of 2000 tables 5 % are 100 ± 9.7; the bound is five standard deviations, a level of 6e-7. The blocks differ from one
    another by ten times the noise, and the other key of the bins does twenty times as much: neither may count.
    """
    rng = np.random.default_rng(5)
    alive = np.zeros(2)
    for _ in range(TABLES):
        blocks = rng.normal(size=(4, 12)) + 10.0 * rng.normal(size=12)
        alive[0] += not by_level("a", "m", np.arange(4.0), blocks).dead
        at, other = rng.random((2, 48))
        alive[1] += not by_bin(
            "b", "m", at, rng.normal(size=(48, 1)) + 20.0 * other[:, None], other[:, None]
        ).dead
    assert alive / TABLES == pytest.approx(0.05, abs=5.0 * math.sqrt(0.05 * 0.95 / TABLES))


def test_few_points_keep_the_level() -> None:
    """Claim: 14 points of four keys, of which three do a lot, name a dead key as such in 95 of 100 tables.

    The bound is five standard deviations of 2000 tables.
    """
    rng = np.random.default_rng(8)
    alive = 0
    for _ in range(TABLES):
        at, *others = rng.random((4, 14))
        others = np.stack(others, axis=1)
        values = rng.normal(size=(14, 1)) + 20.0 * others.sum(axis=1, keepdims=True)
        alive += not by_bin("a", "m", at, values, others).dead
    assert alive / TABLES == pytest.approx(0.05, abs=5.0 * math.sqrt(0.05 * 0.95 / TABLES))


def test_a_change_that_would_be_seen_is() -> None:
    """Claim: a table whose means differ by what it says would be ``seen`` passes its interval in 95 of 100 cases.

    Steps of whole rows leave what a table knows of its errors as it is. Two rows have one difference, and pass in just
    95 of 100: five standard deviations of 2000 tables allow 0.926 to 0.974, where the normal law in place of Student's
    with three degrees of freedom would find 0.90. Of four rows the others can only help.
    """
    rng = np.random.default_rng(11)
    found = np.zeros(2)
    for _ in range(TABLES):
        for number, shape in enumerate(([0.0, 1.0], [0.0, 0.5, 0.5, 1.0])):
            noise = rng.normal(size=(len(shape), 4)) + 10.0 * rng.normal(size=4)
            at = np.arange(float(len(shape)))
            plain = by_level("a", "m", at, noise)
            found[number] += not by_level("a", "m", at, noise + plain.seen * np.array(shape)[:, None]).dead
    allowed = 5.0 * math.sqrt(0.05 * 0.95 / TABLES)
    assert found[0] / TABLES == pytest.approx(0.95, abs=allowed)
    assert found[1] / TABLES >= 0.95 - allowed


def test_gaps_of_a_block_are_no_change() -> None:
    """Claim: where the far points have no measure at the low power, the distance is not charged with the power."""
    rng = np.random.default_rng(9)
    at = rng.random(60)
    values = 0.1 * rng.normal(size=(60, 3)) + np.array([50.0, 0.0, -50.0])
    values[at > 0.6, 0] = np.nan
    found = by_bin("a", "m", at, values, np.zeros((60, 0)))
    assert found.change < 0.5
    np.testing.assert_array_equal(found.points[0], at)
    assert np.abs(found.points[1]).max() < 0.5


def test_a_change_is_found_with_its_size() -> None:
    """Claim: the change is what was put in, within five standard errors in blocks and a twentieth in bins."""
    rng = np.random.default_rng(6)
    at = np.linspace(0.0, 3.0, 4)
    blocks = 2.0 * at[:, None] + rng.normal(size=(4, 50)) + 30.0 * rng.normal(size=50)
    found = by_level("a", "m", at, blocks)
    assert not found.dead
    assert found.change == pytest.approx(6.0, abs=5.0 * math.sqrt(2.0 / 50.0))
    drawn, other = rng.random((2, 300))
    binned = by_bin(
        "b", "m", drawn, (6.0 * drawn + 0.1 * rng.normal(size=300) + other**2)[:, None], other[:, None]
    )
    assert not binned.dead
    assert binned.change == pytest.approx(5.0, abs=0.3), (
        "from the middle of the first sixth to that of the last"
    )
    assert (np.diff(binned.mean) > 0.0).all()


def test_too_few_runs_say_nothing_and_gaps_are_left_out() -> None:
    assert math.isnan(by_level("a", "m", np.arange(3.0), np.ones((3, 1))).interval)
    assert math.isnan(by_bin("a", "m", np.arange(4.0), np.ones((4, 1)), np.zeros((4, 0))).interval)
    whole = np.random.default_rng(7).normal(size=(3, 9))
    gap = np.concatenate([whole, np.full((3, 1), 100.0)], axis=1)
    gap[1, 9] = np.nan
    assert by_level("a", "m", np.arange(3.0), gap).change == by_level("a", "m", np.arange(3.0), whole).change
    assert by_level("a", "m", np.arange(3.0), np.ones((3, 5))).dead, "no change at all is a dead key"


def test_intervals_are_those_of_student_and_of_tukeys_test() -> None:
    """Claim: of two values in n blocks the interval is half that of Student's test of pairs; of a key alone in bins of
    three, that of Tukey's test, both as SciPy has them; standard errors are those of means of so many."""
    rng = np.random.default_rng(3)
    pairs = rng.normal(size=(2, 9)) + 4.0 * rng.normal(size=9)
    ends = stats.ttest_rel(*pairs).confidence_interval(0.95)
    found = by_level("a", "m", np.arange(2.0), pairs)
    assert found.interval == pytest.approx(0.5 * (ends.high - ends.low))
    assert found.freedom == 8
    groups = rng.normal(size=(6, 3)) + np.arange(6.0)[:, None]
    tukey = stats.tukey_hsd(*groups).confidence_interval(0.95)
    mixed = rng.permutation(18)
    binned = by_bin("b", "m", np.arange(18.0)[mixed], groups.reshape(-1, 1)[mixed], np.zeros((18, 0)))
    np.testing.assert_allclose(binned.mean, groups.mean(axis=1))
    np.testing.assert_allclose(binned.at, 3.0 * np.arange(6.0) + 1.0)
    assert binned.freedom == 12
    assert binned.interval == pytest.approx(0.5 * (tukey.high - tukey.low)[0, 1], rel=1e-4)
    np.testing.assert_allclose(binned.error, math.sqrt(groups.var(axis=1, ddof=1).mean() / 3.0))


@pytest.mark.parametrize("shape", [(1, 5), (3, 0), (4, 2)])
def test_without_two_levels_and_a_whole_block_nothing_is_told(shape: tuple[int, int]) -> None:
    """Claim: a mean and an error of each level, all unknown, and neither alive nor dead; the keys beside are told."""
    values = np.full(shape, 3.5)
    values[-1] = np.nan
    found = by_level("a", "m", np.arange(float(shape[0])), values, beside=("b", "c"))
    assert (found.key, found.measure, found.beside, found.freedom) == ("a", "m", ("b", "c"), 0)
    for one in (found.mean, found.error):
        np.testing.assert_array_equal(one, np.full(shape[0], np.nan))
    assert math.isnan(found.change)
    assert math.isnan(found.interval)
