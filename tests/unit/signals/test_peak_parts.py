"""What peaks are judged by, piece by piece: pixels that count, widths that are allowed, speckle where a spot lies."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.polynomial.hermite_e import HermiteE
from numpy.typing import NDArray
from prototype import Laser, PositionSensor, Receiver
from scipy.stats import norm

from scanner_sim.analytic.beam import beam_radius
from scanner_sim.analytic.spot import pixel_shares
from scanner_sim.signals.line import speckle
from scanner_sim.signals.line.digital_line import no_baseline
from scanner_sim.signals.line.estimators import _curvature_inflation, positive
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.pixel_row import read_rows
from scanner_sim.signals.line.speckle import ExpectedSpeckle
from scanner_sim.signals.line.validation import farthest_pixel, guard_pixels, judge_shape
from scanner_sim.signals.processing import Validation

Array = NDArray[np.float64]

pytestmark = pytest.mark.usefixtures("device")

HALF, DWELL = 24, 50e-6
SENSOR = PositionSensor()
SPOT = ExpectedSpot.of(Laser(), Receiver(), 1.0, SENSOR, DWELL)


def numbers(value: Any) -> Array:
    return np.asarray(value.numpy(), dtype=np.float64)


class Pixels:
    """Charges about a pixel, of the variance 100, of which some are full and some beyond the array."""

    def __init__(self, charges: Array, full: tuple[int, ...] = (), last: int = HALF) -> None:
        self.table, self.marked, self.last = auto.Float(charges.astype(np.float32)), full, last
        self.baseline, self.floor_sigma, self.centre = no_baseline(), auto.Float(10.0), auto.Int32(120)
        self.line = self

    def __call__(self, step: Any) -> tuple[Any, Any]:
        return dr.gather(auto.Float, self.table, auto.UInt32(auto.Int32(HALF + step))), auto.Float(100.0)

    def inside(self, step: Any) -> Any:
        return auto.Int32(step) <= self.last

    def full(self, step: Any) -> Any:
        found = auto.Bool(False)
        for one in self.marked:
            found |= auto.Int32(step) == one
        return found


@pytest.mark.parametrize("guard", [3, 19])
def test_pixels_count_on_the_array_and_as_far_as_the_guard(guard: int) -> None:
    """Claim: rows hold charges, variances and ones where |step| is the guard or less and the pixel is on the array."""
    charges = np.linspace(5.0, 90.0, 2 * HALF + 1)
    around: Any = Pixels(charges, last=17)
    rows = read_rows(around, HALF, auto.Int32(guard))
    steps = np.array([-guard - 1, -guard, 0, min(guard, 17), 18, 20])
    read = [[row.read(auto.UInt32(int(HALF + step))) for step in steps] for row in rows]
    dr.eval(read)
    held, variances, counts = ([float(numbers(one)[0]) for one in row] for row in read)
    np.testing.assert_allclose(held, charges[HALF + steps], rtol=1e-6)
    assert variances == [100.0] * len(steps)
    assert counts == [0.0, 1.0, 1.0, 1.0, 0.0, 0.0]


def test_a_charge_at_the_floor_counts_as_half_of_it() -> None:
    """Claim: half the floor's σ is the least charge that has a logarithm, and a thousandth of an electron."""
    charge = auto.Float([-7.0, 0.0, 4.9, 5.1, 300.0])
    np.testing.assert_allclose(
        numbers(positive(charge, auto.Float(10.0))), [5.0, 5.0, 5.0, 5.1, 300.0], rtol=1e-6
    )
    np.testing.assert_allclose(numbers(positive(charge, auto.Float(0.0)))[:2], 1e-3)


@pytest.mark.parametrize(("noise", "factor"), [(0.1, 1.0 / 0.9), (0.45, 1.0 / 0.55), (0.6, 2.0), (40.0, 2.0)])
def test_noise_of_a_curvature_at_most_doubles_a_variance(noise: float, factor: float) -> None:
    """Claim: 1/(1 − var B/B²), of half the curvature's square at most; here var B is that of speckle."""
    around: Any = Pixels(1e4 * pixel_shares(HALF, 1.1, 2 * HALF + 1))
    points = numbers(around.table)[HALF - 1 : HALF + 2]
    square = (2.0 * points[1] - points[0] - points[2]) ** 2
    known: Any = SimpleNamespace(propagated_variance=lambda *_: auto.Float(noise * square - 600.0))
    found = _curvature_inflation("parabola", around, auto.Float(0.1), known)
    assert numbers(found)[0] == pytest.approx(factor, rel=1e-4)


@pytest.mark.parametrize("sigma", [0.4, 1.3, 2.6, 40.0])
def test_a_spot_covers_four_standard_deviations(sigma: float) -> None:
    """Claim: whole pixels to each side, three at least and 24 at most, of beam and blur together; all are looked at."""
    spot: Any = SimpleNamespace(
        variances=lambda *_: (auto.Float(0.7 * sigma**2), auto.Float(0.3 * sigma**2)), largest_sigma=sigma
    )
    one = auto.Float(1.0)
    found = int(numbers(guard_pixels(spot, auto.Int32(70), one, one))[0])
    assert found == min(max(math.ceil(4.0 * sigma), 3), 24)
    reach = farthest_pixel(spot)
    assert reach % 4 == 0
    assert found <= reach <= 24


@pytest.mark.parametrize("marked", [-5, -4, 0, 4, 5])
def test_a_full_pixel_counts_where_the_shape_is_judged(marked: int) -> None:
    """Claim: within the guard, here of 4 pixels, and not beyond it."""
    around: Any = Pixels(1e4 * pixel_shares(HALF, 1.0, 2 * HALF + 1), full=(marked,))
    zero, one = auto.Float(0.0), auto.Float(1.0)
    found = judge_shape(around, SPOT, auto.Int32(4), zero, one, Validation())
    assert bool(found.saturated.numpy()[0]) is (abs(marked) <= 4)


@pytest.mark.parametrize(("sweep", "fits"), [(0.0, False), (3.0, True)])
def test_a_spot_may_be_as_wide_as_its_sweep_makes_it(sweep: float, fits: bool) -> None:
    """Claim: a spot of 1, blur 0.5 and sweep s pixel² may have the variance 1.5 + s, also where that is beyond the
    limit of a tilt, here 1.1²."""
    settings = Validation(beam_width=(0.9, 1.1), tolerance=0.5)
    spot: Any = SimpleNamespace(
        variances=lambda *_: (auto.Float(1.0), auto.Float(0.5)),
        swept_variance=lambda *_: auto.Float(sweep),
        largest_sigma=2.2,
    )
    wide = 1.5 + 3.0
    around: Any = Pixels(1e6 * pixel_shares(HALF, math.sqrt(wide), 2 * HALF + 1))
    zero, one = auto.Float(0.0), auto.Float(1.0)
    found = judge_shape(around, spot, auto.Int32(8), zero, one, settings)
    assert bool(found.fits.numpy()[0]) is fits


def mode(order: int, step: int, sigma: float, ratio: float) -> float:
    """Return rⁿ ∫ He_n φ/√n! over a pixel at a step from the spot's middle."""
    at = np.linspace(step - 0.5, step + 0.5, 2001) / sigma
    values = HermiteE.basis(order)(at) * np.exp(-0.5 * at**2) / math.sqrt(2.0 * math.pi)
    return float(ratio**order / math.sqrt(math.factorial(order)) * np.trapezoid(values, at))


@pytest.mark.parametrize(("share", "fits"), [(0.0, False), (0.97, False), (1.03, True)])
def test_speckle_makes_a_spot_wide_by_what_its_pixels_have_not_in_common(share: float, fits: bool) -> None:
    """Claim: the curvature 2 ln c₀ − ln c₋₁ − ln c₁ has of each mode of speckle the variance V (Σ w m/c)² with the
    weights −1, 2, −1: of the energy, which all pixels share, nothing, however strong, and of the others what it has
    on three pixels. A spot that is too wide passes while that is within the deviate of 1 % of its standard deviation.

    Set-up: a spot of 1.6 pixels where 1.31 are allowed, of packets as wide as itself, whose energy has the contrast 1.
    """
    sigma, ratio, modes, charge = 1.6, 0.8, 7, 1e6
    settings = Validation(false_alarm=0.01, beam_width=(0.9, 1.1), tolerance=1.0)
    spot: Any = SimpleNamespace(
        variances=lambda *_: (auto.Float(1.0), auto.Float(0.5)),
        swept_variance=lambda *_: auto.Float(0.0),
        largest_sigma=2.2,
    )
    charges = charge * pixel_shares(HALF, sigma, 2 * HALF + 1)
    three = charges[HALF - 1 : HALF + 2]
    lack = 0.97 / (1.1**2 + 0.5 + 1.0 / 12.0) - np.array([-1.0, 2.0, -1.0]) @ np.log(three)
    assert lack > 0.1
    bends = [
        sum(
            w * charge * mode(order, step, sigma, ratio) / c
            for step, w, c in zip((-1, 0, 1), (-1, 2, -1), three, strict=True)
        )
        for order in range(modes + 1)
    ]
    assert abs(bends[0]) < 1e-6
    others = (share * lack / norm.isf(0.01)) ** 2 / float(np.square(bends[1:]).sum())
    packets: Any = SimpleNamespace(sigma=auto.Float(sigma), ratio=auto.Float(ratio))
    known = speckle.SpotSpeckle(
        packets, [auto.Float(ratio)] * modes, auto.Float(1.0), auto.Float(others), auto.Float(sigma)
    )
    around: Any = Pixels(charges)
    zero, one = auto.Float(0.0), auto.Float(1.0)
    found = judge_shape(around, spot, auto.Int32(8), zero, one, settings, known)
    assert bool(found.fits.numpy()[0]) is fits


def test_speckle_is_that_of_the_beam_where_the_spot_lies(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the beam's radius at the range of the pixel, and what a turn makes of that range, decide on what a dwell
    leaves; its image, without what the array stretches, on the packets; C² times the packets' energy on the size."""
    laser = Laser(waist_distance=3.0)
    asked: dict[str, Any] = {}
    spot = ExpectedSpot.of(laser, Receiver(array_tilt=0.6), 1.0, SENSOR, DWELL)
    pixel, theta = 150, 0.15
    sine, cosine = (auto.Float(value) for value in (math.sin(theta), math.cos(theta)))

    def average(*given: Any) -> tuple[Any, Any]:
        asked["dwell"] = [float(numbers(one)[0]) for one in given]
        return auto.Float(0.7), auto.Float(0.4)

    def packets(optics: Any, along: Any, across: Any, seen: Any) -> Any:
        asked["image"] = [float(numbers(one)[0]) for one in (along, across)]
        asked["stretch"] = float(numbers(seen.along)[0])
        return SimpleNamespace(
            energy=auto.Float(0.2), ratio=auto.Float(0.8), moving=lambda one, other: (0.5 * one, 0.25 * other)
        )

    monkeypatch.setattr(speckle, "dwell_average", average)
    monkeypatch.setattr(speckle, "packets_of", packets)
    monkeypatch.setattr(speckle, "mode_ratios", lambda optics, ratio: [ratio, 0.5 * ratio])
    known = ExpectedSpeckle(optics=None, contrast=0.6, travel=(auto.Float(3e-4), -2e-4))  # type: ignore[arg-type]
    found = known.about(spot, auto.Int32(pixel), sine, cosine)
    distance = float(np.asarray(spot.range(np.float64(pixel), math.sin(theta), math.cos(theta))))
    radius = beam_radius(distance, laser.waist_radius, 3.0, laser.wavelength, laser.m_squared)
    assert asked["dwell"] == pytest.approx([3e-4 * distance, -2e-4 * distance, float(radius)], rel=1e-4)
    beam, spread = (
        float(np.asarray(one)) for one in spot.variances(np.float64(pixel), math.sin(theta), math.cos(theta))
    )
    assert asked["image"] == pytest.approx([beam / asked["stretch"] ** 2] * 2, rel=1e-4)
    assert numbers(found.energy)[0] == pytest.approx(0.36 * 0.2 * 0.5 * 0.7, rel=1e-5)
    assert numbers(found.others)[0] == pytest.approx(0.36 * 0.2 * 0.25 * 0.4, rel=1e-5)
    assert numbers(found.sigma)[0] == pytest.approx(math.sqrt(beam + spread), rel=1e-4)
    assert [numbers(one)[0] for one in found.ratios] == pytest.approx([0.8, 0.4])
