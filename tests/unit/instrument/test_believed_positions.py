"""What the closed loop believes of positions: what a calibration's errors make of those that two ways measure."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.foundation.parameters import NAMES
from scanner_sim.instrument.closed_loop.believed_positions import BelievedPositions, RangeNoise
from scanner_sim.ranging.believed import Design
from scanner_sim.ranging.calibration import Calibration, position_in_common

Array = NDArray[np.float64]

PLACE = np.array([[0.3, -0.25, 2.1], [-0.2, 0.1, 5.3], [0.05, 0.35, 9.2]])


def believed(sigma: float, prefix: str) -> tuple[BelievedPositions, Calibration]:
    """Return an instrument of both rangefinders whose parameters have one σ each, and its calibration."""
    none, count = np.zeros(len(NAMES)), len(NAMES)
    calibration = Calibration(none, sigma**2 * np.eye(count), Design(0.1, 0.2, 0.05), 0.4)
    made = object.__new__(BelievedPositions)
    made._calibration = calibration
    made._ways = {"": ("triangulation",)}
    if prefix:
        made._ways[prefix] = ("triangulation", "coaxial")
    return made, calibration


def test_each_way_has_the_share_in_common_errors_that_it_has_in_the_range() -> None:
    """Claim: shares are those of the least variance of the range, of noise and of the calibration together, with what
    both share of either; a way that measures nothing has none, and one way alone has all.

    Expected: the least of 100 001 shares. Tolerance: that of their steps.
    """
    made, calibration = believed(1e-4, "fused.")
    ways = [position_in_common(calibration, way, PLACE) for way in ("triangulation", "coaxial")]
    noise = np.array([[2e-3, 7e-3, np.inf], [3e-3, 1e-3, 4e-3]])
    shares = np.linspace(0.0, 1.0, 100_001)
    far = 1e-5 * np.abs(ways[0] - ways[1]).max()
    for shared in (np.zeros(3), np.array([3.6e-6, 4.2e-6, 0.0]), np.array([-3.6e-6, -4.2e-6, 0.0])):
        found = made.in_common(PLACE, lambda c=shared: RangeNoise(*noise, c))
        for number in range(2):
            one, other = (
                own[number] ** 2 + (part[number, 2] ** 2).sum() for own, part in zip(noise, ways, strict=True)
            )
            c = shared[number] + ways[0][number, 2] @ ways[1][number, 2]
            least = np.argmin(
                (1.0 - shares) ** 2 * one + shares**2 * other + 2.0 * shares * (1.0 - shares) * c
            )
            wanted = (1.0 - shares[least]) * ways[0][number] + shares[least] * ways[1][number]
            np.testing.assert_allclose(found[number], wanted, rtol=0.0, atol=far)
        np.testing.assert_allclose(found[2], ways[1][2], rtol=1e-12, atol=1e-15)
    alone, calibration = believed(1e-4, "")
    np.testing.assert_array_equal(
        alone.in_common(PLACE, lambda: pytest.fail("one way needs no noise")), ways[0]
    )


def test_an_exact_instrument_has_no_common_errors() -> None:
    made, _ = believed(0.0, "fused.")
    assert made.in_common(PLACE, lambda: pytest.fail("there is nothing to weigh")).shape == (3, 3, 0)
