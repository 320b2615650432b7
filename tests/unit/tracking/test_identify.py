"""Which target is which, by made-up places a number of standard deviations apart."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from scanner_sim.tracking.identify import identify

MEASURED, KNOWN = np.diag([9.0, 9.0, 9.0]), np.diag([16.0, 16.0, 16.0])
"""Together 25: five is one standard deviation of a difference."""


@pytest.mark.parametrize("chance", [1e-4, 0.01])
def test_the_gate_is_that_of_three_dimensions_over_both_errors(chance: float) -> None:
    """Claim: d² is over the sum of both covariances, and refused beyond χ²₃."""
    gate = float(np.sqrt(chi2.isf(chance, 3)))
    for share, found in ((0.99, True), (1.01, False)):
        away = np.array([[5.0 * gate * share, 0.0, 0.0]])
        told = identify(away, MEASURED[None], np.zeros((1, 3)), KNOWN, chance=chance)
        assert (told.target.tolist() == [0]) is found
        if found:
            np.testing.assert_allclose(told.surprise, (gate * share) ** 2)


def test_targets_keep_their_order_and_are_sure_where_no_other_is_near() -> None:
    expected = np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0], [110.0, 0.0, 0.0]])
    measured = expected[[1, 0]] + 1.0
    told = identify(measured, np.array([MEASURED, MEASURED]), expected, KNOWN)
    assert told.target.tolist() == [1, 0]
    # The first may be its neighbour as well, two standard deviations off.
    assert told.unique.tolist() == [False, True]


@pytest.mark.parametrize("chance", [1e-4, 0.01])
def test_a_target_is_sure_where_no_other_lies_within_its_gate(chance: float) -> None:
    """Claim: another one just inside of the gate may be it, too; just outside it may not."""
    gate = 5.0 * float(np.sqrt(chi2.isf(chance, 3)))
    for share, sure in ((0.99, False), (1.01, True)):
        expected = np.array([[0.0, 0.0, 0.0], [0.0, share * gate, 0.0]])
        told = identify(np.zeros((1, 3)), MEASURED[None], expected, KNOWN, chance=chance)
        assert told.target.tolist() == [0]
        assert told.unique.tolist() == [sure]
