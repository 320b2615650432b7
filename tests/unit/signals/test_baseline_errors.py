"""Errors that all pixels of a line have in common: what the baseline's do to each estimator."""

from __future__ import annotations

from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest

from scanner_sim.analytic.estimators import ESTIMATORS
from scanner_sim.analytic.spot import pixel_shares
from scanner_sim.render.device import Device
from scanner_sim.signals.line.digital_line import no_baseline
from scanner_sim.signals.line.estimators import estimate
from scanner_sim.signals.line.peaks import sum_signal

HALF = 12
DISTANCE = 9
"""Pixels from the peak to the middle of each side."""


class Pixels:
    """Charges about the brightest pixel, hardly any noise of their own, and a baseline that errs."""

    floor_sigma = 1e-3

    def __init__(self, charges: Any, level: float, slope: float, doubt: float = 0.0) -> None:
        self.charges, self.baseline = auto.Float(charges.astype(np.float32)), no_baseline()
        self.baseline.level_variance, self.baseline.slope_variance = auto.Float(level), auto.Float(slope)
        self.baseline.doubt, self.baseline.distance = auto.Float(doubt), auto.Float(float(DISTANCE))

    def __call__(self, step: Any) -> tuple[Any, Any]:
        return dr.gather(auto.Float, self.charges, auto.UInt32(auto.Int32(HALF + step))), auto.Float(1.0)

    def inside(self, _: Any) -> Any:
        return auto.Bool(True)


@pytest.mark.parametrize("method", list(ESTIMATORS))
def test_level_and_slope_move_an_estimate_by_its_derivatives(device: Device, method: Any) -> None:
    """Claim: their variances count by the squares of the judge's derivatives, by differences."""
    charges = 1e4 * pixel_shares(HALF + 0.2, 1.1, 2 * HALF + 1)
    step = np.arange(-HALF, HALF + 1.0)
    judge = ESTIMATORS[method]
    for level, slope, change in ((400.0, 0.0, np.ones(step.size)), (0.0, 400.0, step)):
        found = estimate(method, Pixels(charges, level, slope)).variance  # type: ignore[arg-type]
        alone = estimate(method, Pixels(charges, 0.0, 0.0)).variance  # type: ignore[arg-type]
        moved = (judge((charges + 1e-3 * change).tolist()) - judge((charges - 1e-3 * change).tolist())) / 2e-3
        more = float((found - alone).numpy()[0])
        assert more == pytest.approx(400.0 * moved**2, rel=5e-3, abs=2e-4 * float(alone.numpy()[0]))


@pytest.mark.parametrize("method", list(ESTIMATORS))
def test_an_edge_beneath_the_spot_is_as_likely_anywhere(device: Device, method: Any) -> None:
    """Claim: where the sides differ by D = 20 electrons, σ² grows by the mean square of what such an edge does.

    Set-up: the judge's estimator moved, by differences, by edges behind each pixel between the middles of the sides,
    less the straight line that the baseline takes off. Expected: the mean of the squares over these 18 places.
    """
    charges = 1e4 * pixel_shares(HALF + 0.2, 1.1, 2 * HALF + 1)
    step, judge = np.arange(-HALF, HALF + 1.0), ESTIMATORS[method]
    squares = []
    for last in np.arange(-DISTANCE, DISTANCE) + 0.5:
        change = (step > last) - 0.5 - step / (2 * DISTANCE)
        moved = (judge((charges + 1e-3 * change).tolist()) - judge((charges - 1e-3 * change).tolist())) / 2e-3
        squares.append(moved**2)
    found = estimate(method, Pixels(charges, 0.0, 0.0, 10.0)).variance  # type: ignore[arg-type]
    alone = estimate(method, Pixels(charges, 0.0, 0.0)).variance  # type: ignore[arg-type]
    more = float((found - alone).numpy()[0])
    assert more == pytest.approx(20.0**2 * np.mean(squares), rel=1e-3)


@pytest.mark.parametrize(
    ("left", "right", "level", "slope"),
    [
        (40.0, 40.0, 100.0, 0.0),
        (40.0, 40.0, 30.0, 0.0),
        (30.0, -30.0, 5.0, 0.0),
        (30.0, -30.0, 5.0, 3.0),
        (14.0, 6.0, 50.0, 0.0),
    ],
)
def test_light_beneath_a_peak_makes_its_charge_uncertain(
    device: Device, left: float, right: float, level: float, slope: float
) -> None:
    """Claim: nine pixels' charge; its variance is theirs, and 9² times what lies beneath: the level's own variance, the
    mean m of the outermost, no more than the level, and the edge h between them, h²/3, each less nine times what noise
    makes of it, a quarter of both pixels' and the level's."""
    charges = np.full(2 * HALF + 1, 200.0)
    charges[HALF - 4], charges[HALF + 4] = left, right
    around = Pixels(charges, 4.0, 0.0)
    around.baseline.level, around.baseline.slope = auto.Float(level), auto.Float(slope)
    total, variance = sum_signal(around)  # type: ignore[arg-type]
    assert float(total.numpy()[0]) == pytest.approx(7 * 200.0 + left + right)
    chance = 9.0 * (0.25 * (1.0 + 1.0) + 4.0)
    mean, half = min(0.5 * abs(left + right), abs(level)), 0.5 * (right - left) + 4.0 * slope
    beneath = 4.0 + max(mean**2 - chance, 0.0) + max(half**2 - chance, 0.0) / 3.0
    assert float(variance.numpy()[0]) == pytest.approx(9.0 + 81.0 * beneath, rel=1e-5)
