"""The way of the mirrors' command from one pattern to the next: where it begins and ends, how fast, how hard."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Galvanometers

from scanner_sim.scan.schedule import Visiting, _approach, _turn

Array = NDArray[np.float64]

SERVO, STEP = Galvanometers(), 12.5e-6


def way(goal: Array, leaving: Array, arriving: Array, given: float, near: float) -> Array:
    """Return the command from (0.02, −0.01) on, with the point at its start."""
    origin = np.array([0.02, -0.01])
    path = _approach(SERVO, origin, leaving, Visiting(), goal, arriving, STEP, given, near)
    return np.concatenate([origin[:, None], path], axis=1)


@pytest.mark.parametrize("given", [0.0, 30e-3])
@pytest.mark.parametrize("goal", [[0.12, -0.2], [0.025, 0.2]])
def test_a_jump_brakes_and_speeds_up_within_the_limits(goal: list[float], given: float) -> None:
    """Claim: the command begins and ends with place and rate, and never asks for more than the share of the limits that
    jumps may: by second differences, to 1 % beside the steps in which its acceleration changes. A way takes no less
    time than was given."""
    leaving, arriving = np.array([3.0, -2.0]), np.array([-1.0, 4.0])
    path = way(np.array(goal), leaving, arriving, given, 0.0)
    np.testing.assert_allclose(path[:, -1], goal, atol=1e-9)
    rate = np.diff(path, axis=1) / STEP
    most = SERVO.jump_share * SERVO.acceleration
    np.testing.assert_allclose(rate[:, 0], leaving, atol=0.51 * most * STEP)
    np.testing.assert_allclose(rate[:, -1], arriving, atol=0.51 * most * STEP)
    bend = np.diff(rate, axis=1) / STEP
    assert np.abs(bend).max() < 1.01 * most
    # Braking takes at least half of the turnaround, or as long as the limits want.
    lasts = max(0.5 * Visiting().turnaround, 3.0 / most)
    inside = bend[:, : int(lasts / STEP) - 1]
    np.testing.assert_allclose(inside, np.tile((-leaving / lasts)[:, None], inside.shape[1]), rtol=1e-6)
    assert (path.shape[1] - 1) * STEP >= given - 1e-9


def test_a_turn_is_the_cubic_through_both_ends() -> None:
    """Claim: places and rates at both ends are those that were asked for, and the third derivative is one number."""
    origin, goal = np.array([0.02, -0.01]), np.array([0.021, -0.012])
    leaving, arriving = np.array([3.0, -2.0]), np.array([-1.0, 4.0])
    path = np.concatenate([origin[:, None], _turn(origin, leaving, goal, arriving, STEP, 40)], axis=1)
    cubic = [np.polynomial.Polynomial.fit(STEP * np.arange(41), one, 3) for one in path]
    for one, places, rates in zip(
        cubic, zip(origin, goal, strict=True), zip(leaving, arriving, strict=True), strict=True
    ):
        for at, place, rate in zip((0.0, 40 * STEP), places, rates, strict=True):
            assert one(at) == pytest.approx(place, abs=1e-12)
            assert one.deriv()(at) == pytest.approx(rate, abs=1e-7)
    np.testing.assert_allclose(np.diff(path, 4, axis=1), 0.0, atol=1e-14)
