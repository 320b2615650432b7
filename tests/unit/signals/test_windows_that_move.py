"""What the window's position and speckle in a vertex's curvature add to σ: each by its own formula, in numpy."""

from __future__ import annotations

import math
from typing import Any

import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr

from scanner_sim.signals.line.estimators import _curvature_inflation, _window_variance

pytestmark = pytest.mark.usefixtures("device")

Array = NDArray[np.float64]
FLOOR = 4.0


class Around:
    """A row of charges with variances, of which the brightest pixel is step 0."""

    floor_sigma = auto.Float(FLOOR)

    def __init__(self, charges: Array, variances: Array, first: int, reach: tuple[int, int]) -> None:
        self.charges, self.variances, self.first, self.reach = charges, variances, first, reach

    def __call__(self, step: int) -> tuple[Any, Any]:
        at = step - self.first
        if not 0 <= at < len(self.charges):
            return auto.Float(0.0), auto.Float(1.0)
        return auto.Float(float(self.charges[at])), auto.Float(float(self.variances[at]))

    def inside(self, step: int) -> Any:
        return auto.Bool(self.reach[0] <= step <= self.reach[1])


class Grains:
    """Speckle by which charges vary each by itself, by a share of their squares."""

    share = 0.02

    def propagated_variance(self, slopes: dict[int, Any], charges: dict[int, Any], shift: Any) -> Any:
        return sum(self.share * slopes[step] ** 2 * charges[step] ** 2 for step in slopes) + 0.0 * shift


def number(value: Any) -> float:
    return float(np.asarray(value.numpy()).ravel()[0])


def mass(charges: dict[int, float], middle: int) -> float:
    seen = {step: charges.get(middle + step, 0.0) for step in range(-3, 4)}
    return sum(step * charge for step, charge in seen.items()) / sum(seen.values())


@pytest.mark.parametrize("grains", [False, True])
@pytest.mark.parametrize("reach", [(-9, 9), (-4, 4), (-4, 3), (-3, 9), (-3, 3)])
def test_a_window_that_may_lie_beside_adds_its_chance(grains: bool, reach: tuple[int, int]) -> None:
    """Claim: Σ q (1 − q) D² over the two neighbours whose window lies on the array, q = Φ(−Δ/√var) of the difference Δ
    of both charges, D the way from one window's estimate to the other's. Tolerance: single precision."""
    own = {-4: 10.0, -3: 30.0, -2: 120.0, -1: 480.0, 0: 520.0, 1: 470.0, 2: 90.0, 3: 20.0, 4: 5.0}
    noise = {step: 300.0 + charge for step, charge in own.items()}
    around: Any = Around(np.array([*own.values()]), np.array([*noise.values()]), -4, reach)
    shift, rise = mass(own, 0), 0.8
    speckle: Any = Grains() if grains else None
    found = _window_variance(around, auto.Float(rise * shift), lambda position: rise * position, speckle)
    wanted = 0.0
    for side in (-1, 1):
        if reach[0] <= 4 * side <= reach[1]:
            both = noise[0] + noise[side] + grains * Grains.share * (own[0] ** 2 + own[side] ** 2)
            other = ndtr(-(own[0] - own[side]) / math.sqrt(both))
            wanted += other * (1.0 - other) * (side + rise * mass(own, side) - rise * shift) ** 2
    assert number(found) == pytest.approx(wanted, rel=1e-4, abs=1e-9)


@pytest.mark.parametrize("method", ["parabola", "gaussian"])
@pytest.mark.parametrize("variance", [1.0, 3e3, 1e5])
def test_noise_in_a_curvature_widens_a_vertex(method: Any, variance: float) -> None:
    """Claim: 1/(1 − var B/B²), of a share of a half at most, with B's variance by noise and speckle; logarithms are of
    charges at or above half of the floor. Without speckle, and for other estimators, it is 1."""
    charges = np.array([1.0, 500.0, 300.0])
    around: Any = Around(charges, variance * np.array([1.0, 2.0, 1.5]), -1, (-9, 9))
    held = np.maximum(charges, 0.5 * FLOOR)
    points, slopes = charges, np.array([-1.0, 2.0, -1.0])
    if method == "gaussian":
        points, slopes = np.log(held), slopes / held
    curvature = float(2.0 * points[1] - points[0] - points[2])
    scatter = (slopes**2 * variance * [1.0, 2.0, 1.5]).sum() + Grains.share * (slopes**2 * charges**2).sum()
    wanted = 1.0 / (1.0 - min(scatter / curvature**2, 0.5))
    speckle: Any = Grains()
    shift = auto.Float(0.1)
    assert number(_curvature_inflation(method, around, shift, speckle)) == pytest.approx(wanted, rel=1e-4)
    assert number(_curvature_inflation(method, around, shift, None)) == 1.0
    assert number(_curvature_inflation("centre_of_mass", around, shift, speckle)) == 1.0
