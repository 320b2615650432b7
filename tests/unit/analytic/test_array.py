"""The judge's array behind the lens against elementary optics: it shares nothing with the simulator's formulas."""

from __future__ import annotations

import math

import pytest

from scanner_sim.analytic.array import SensorArray

F, D, A = 0.05, 0.08, 0.008


def test_an_upright_array_focused_at_infinity_is_a_pinhole() -> None:
    """Claim: p = f d/R (eq 1 at Θ = 0), to the focal plane."""
    array = SensorArray(F, D, A, 0.0)
    assert float(array.position(0.5)) == pytest.approx(F * D / 0.5, rel=1e-12)
    assert array.origin == pytest.approx([0.0, F], abs=1e-15)
    assert SensorArray(F, D, A).position(0.5) == pytest.approx(array.position(0.5), rel=1e-12)


def test_the_whole_beam_is_sharp_in_scheimpflugs_condition() -> None:
    """Claim: s = f d/(z − f) √(1 + (f/d)²), the image of the beam by the lens equation, and no ray misses it."""
    array = SensorArray(F, D, A, "scheimpflug")
    for distance in (0.2, 0.5, 2.0):
        expected = F * D / (distance - F) * math.hypot(1.0, F / D)
        assert float(array.position(distance)) == pytest.approx(expected, rel=1e-12)
        assert max(abs(part) for part in array.blur(distance)) < 1e-15
    assert array.blur(0.5, 0.3).along > 1e-6


@pytest.mark.parametrize("tilt", [0.0, 0.4, -0.3])
def test_the_point_in_focus_is_sharp_and_others_are_blurred_by_the_pupil(tilt: float) -> None:
    """Claim: across the line a point at z is a disc of the diameter A |1 − v_a/v|, of which a quarter is σ."""
    array = SensorArray(F, D, A, tilt, 0.6)
    assert max(abs(part) for part in array.blur(0.6)) < 1e-15
    spot = array.origin + float(array.position(0.4)) * array.direction
    disc = A * abs(1.0 - spot[1] * (1.0 / F - 1.0 / 0.4))
    assert array.blur(0.4).across == pytest.approx(0.25 * disc, rel=2e-3)
    assert array.direction[1] / array.direction[0] == pytest.approx(math.tan(tilt), abs=1e-12)


def test_ranges_come_back() -> None:
    array = SensorArray(F, D, A, 0.3, 0.5)
    for theta in (-0.3, 0.0, 0.2):
        assert float(array.range(array.position(0.45, theta), theta)) == pytest.approx(0.45, rel=1e-12)
    assert float(array.tangent(array.position(0.45))) == pytest.approx(D / 0.45, rel=1e-12)
