"""The weights of the fitted spot: noise at the fitted charge, light beneath, its edge, and speckle of pixels.

At a spot without noise the fit rests on the truth, and its slopes are one row of (F + P)⁻¹ ∂m/∂θ/var: closed forms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import erf

from scanner_sim.signals.line.digital_line import Baseline
from scanner_sim.signals.line.estimators import estimate
from scanner_sim.signals.line.likelihood import Width, fit_spot

CHARGE, PLACE, SIGMA, FLOOR = 4000.0, 0.3, 0.7, 30.0
LEVEL, SLOPE, LEVEL_VARIANCE = 50.0, 4.0, 2.0
REACH = 3
"""Pixels to each side that a fit of such a spot takes."""
pytestmark = pytest.mark.usefixtures("device")


class Plain:
    """A line whose pixels scatter by their light and a floor."""

    def variance(self, _: Any, charge: Any) -> Any:
        return FLOOR**2 + dr.maximum(charge, 0.0)


@dataclass
class Spot:
    """The pixels about a spot, without noise."""

    baseline: Baseline
    line: Any = field(default_factory=Plain)
    floor_sigma: Any = FLOOR

    def __post_init__(self) -> None:
        """Lay the charges on the device: a loop of a kernel asks for the step of its turn."""
        charges = shares(np.arange(-REACH, REACH + 1.0), CHARGE, PLACE, SIGMA**2)
        self.charges = auto.Float(charges.astype(np.float32))

    def pixel(self, step: Any) -> Any:
        return auto.Int32(20 + step)

    def inside(self, _: Any) -> Any:
        return auto.Bool(True)

    def __call__(self, step: Any) -> tuple[Any, Any]:
        held = dr.gather(auto.Float, self.charges, auto.UInt32(auto.Int32(REACH + step)))
        return held, self.line.variance(step, held)


def shares(steps: NDArray[np.float64], charge: float, place: float, variance: float) -> NDArray[np.float64]:
    scale = 1.0 / math.sqrt(2.0 * variance)
    found: NDArray[np.float64] = (
        0.5 * charge * (erf((steps + 0.5 - place) * scale) - erf((steps - 0.5 - place) * scale))
    )
    return found


def test_the_slopes_follow_from_the_weights() -> None:
    """Claim: var_i = σ² + m_i + light beneath + V N m_i + 4(doubt² − 9 var), the last where the sides differ."""
    cases = [(k, d, v) for k in (0.005, 0.3, 1e3) for d in (1.0, 60.0) for v in (0.0, 0.05)]
    spread, doubt, speckle = np.array(cases).T
    width = Width.certain(dr.opaque(auto.Float, SIGMA), SIGMA)
    assert (width.reach, width.guard.numpy().tolist()) == (REACH, [REACH])
    assert width.spread.numpy() == pytest.approx(0.005)
    width.spread = auto.Float(spread.astype(np.float32))
    known = (dr.opaque(auto.Float, v) for v in (LEVEL, SLOPE, LEVEL_VARIANCE, 0.1))
    beneath = Baseline(*known, doubt=auto.Float(doubt.astype(np.float32)), distance=auto.Float(7.0))
    fit = fit_spot(Spot(beneath), width, auto.Float(0.2), auto.Float(speckle.astype(np.float32)))
    np.testing.assert_allclose(fit.shift.numpy(), PLACE, rtol=0.0, atol=1e-4)
    np.testing.assert_allclose(fit.charge.numpy(), CHARGE, rtol=1e-3)

    steps = np.arange(-3.0, 4.0)
    truth = np.array([math.log(CHARGE), PLACE, math.log(SIGMA**2)])

    def model(theta: NDArray[np.float64]) -> NDArray[np.float64]:
        return shares(steps, math.exp(theta[0]), float(theta[1]), math.exp(theta[2]))

    mean = model(truth)
    slopes = [(model(truth + 1e-4 * one) - model(truth - 1e-4 * one)) / 2e-4 for one in np.eye(3)]
    derivatives = np.array(slopes)
    found = np.array([fit.slopes[int(step)].numpy() for step in steps]).T
    for number, (spread_one, doubt_one, speckle_one) in enumerate(cases):
        uneven = max(4.0 * (doubt_one**2 - 9.0 * LEVEL_VARIANCE), 0.0)
        variance = FLOOR**2 + mean + LEVEL + SLOPE * steps + speckle_one * CHARGE * mean + uneven
        weighted = derivatives / variance
        prior = spread_one**-2
        row = np.linalg.inv(weighted @ derivatives.T + np.diag([0.0, 0.0, prior]))[1]
        expected = row @ weighted
        tolerance = 2e-3 * np.abs(expected).max()
        np.testing.assert_allclose(found[number], expected, rtol=0.0, atol=tolerance)
        told = float(fit.prior_variance.numpy()[number])
        assert told == pytest.approx(row[2] ** 2 * prior, rel=0.02, abs=0.0)


@pytest.mark.parametrize("method", ["parabola", "maximum_likelihood"])
def test_a_correction_is_asked_for_the_width_of_the_spot(method: Any) -> None:
    """Claim: what is taken off the place, and how it changes, are those of the spot's standard deviation; the place is
    that of the plain estimator less this, its σ (1 − rise) times as large."""
    around: Any = Spot(Baseline(*(auto.Float(0.0) for _ in range(5)), distance=auto.Float(9.0)))
    asked: list[Any] = []

    def correction(position: Any, sigma: Any) -> tuple[Any, Any]:
        asked.append((position, sigma))
        return 0.2 * sigma, 0.3 * sigma

    width = Width.certain(auto.Float(SIGMA), SIGMA)
    plain, found = (estimate(method, around, width, law) for law in (None, correction))
    held = [np.ravel(part.numpy()) for part in (plain.shift, plain.variance, found.shift, found.variance)]
    np.testing.assert_allclose(np.ravel(asked[0][0].numpy()), held[0], rtol=1e-6)
    np.testing.assert_allclose(np.ravel(asked[0][1].numpy()), SIGMA, rtol=1e-5)
    np.testing.assert_allclose(held[2], held[0] - 0.2 * SIGMA, rtol=1e-5)
    np.testing.assert_allclose(held[3], (1.0 - 0.3 * SIGMA) ** 2 * held[1], rtol=1e-5)
