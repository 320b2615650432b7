"""The laws of the line's signals, each by itself: charges, expected spots, baselines, estimators, variances."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Laser, PositionSensor, Receiver
from scipy.integrate import quad
from scipy.stats import chi2, norm

from scanner_sim.analytic.beam import beam_radius
from scanner_sim.analytic.estimators import ESTIMATORS
from scanner_sim.analytic.geometry import image_position, triangulated_range
from scanner_sim.analytic.noise import first_order
from scanner_sim.analytic.spot import pixel_shares
from scanner_sim.render.device import Device
from scanner_sim.signals.line import digital_line
from scanner_sim.signals.line.bias import Bias, SpotTemplate
from scanner_sim.signals.line.bias_table import BiasTable
from scanner_sim.signals.line.calibration import SensorCalibration
from scanner_sim.signals.line.digital_line import Baseline, baseline_beside, no_baseline
from scanner_sim.signals.line.estimators import _curvature_inflation, estimate
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.likelihood import Width, inverse_of
from scanner_sim.signals.line.validation import _fit, _quantile, farthest_pixel, judge_shape, white_charge
from scanner_sim.signals.processing import Validation

Array = NDArray[np.float64]
HALF = 12
"""Pixels to each side of the brightest one of a line that is written by hand."""


class Pixels:
    """Charges and variances about the brightest pixel, as the estimators are given them."""

    def __init__(self, charges: Array, variances: Array, baseline: Baseline | None = None) -> None:
        # On the device: a loop of a kernel asks for the step of its turn.
        self.charges, self.variances = (auto.Float(of.astype(np.float32)) for of in (charges, variances))
        self.baseline = no_baseline() if baseline is None else baseline
        self.floor_sigma = 1e-3
        self.centre = auto.Int32(100)
        self.line = self

    def __call__(self, step: Any) -> tuple[Any, Any]:
        at = auto.UInt32(auto.Int32(HALF + step))
        return dr.gather(auto.Float, self.charges, at), dr.gather(auto.Float, self.variances, at)

    def pixel(self, step: Any) -> Any:
        return auto.Int32(100 + step)

    def inside(self, step: Any) -> Any:
        return dr.abs(auto.Int32(step)) <= HALF

    def full(self, _: Any) -> Any:
        return auto.Bool(False)

    def variance(self, *_: Any) -> Any:
        return auto.Float(1.0)


def spot(place: float, sigma: float, charge: float = 1e4) -> Array:
    """Return a Gaussian spot integrated over 25 pixels, about the middle one."""
    return np.asarray(charge * pixel_shares(HALF + place, sigma, 2 * HALF + 1))


UNEVEN = np.linspace(20.0, 90.0, 2 * HALF + 1)
"""Variances no two of which are alike."""


def number(value: Any) -> float:
    return float(np.asarray(value.numpy()).ravel()[0])


@pytest.mark.parametrize("place", [-0.35, -0.1, 0.2, 0.4])
@pytest.mark.parametrize("method", list(ESTIMATORS))
def test_an_estimate_and_its_variance_are_the_judges(device: Device, method: Any, place: float) -> None:
    """Claim: the place to 1e-5 pixel, and the variance of the judge's estimator by differences to 0.2 %."""
    charges = spot(place, 1.1)
    found = estimate(method, Pixels(charges, UNEVEN))
    judge = ESTIMATORS[method]
    assert number(found.shift) == pytest.approx(judge(charges.tolist()) - HALF, abs=1e-5)
    wanted = first_order(judge, charges.tolist(), UNEVEN.tolist())
    assert math.sqrt(number(found.variance)) == pytest.approx(wanted, rel=2e-3)


def test_a_baselines_errors_are_common_to_all_pixels(device: Device) -> None:
    """Claim: an unknown level and slope beneath the line move the estimate by their derivatives, by differences."""
    charges = spot(0.2, 1.1)
    known = no_baseline()
    known.level_variance, known.slope_variance = auto.Float(50.0), auto.Float(30.0)
    found = estimate("centre_of_mass", Pixels(charges, UNEVEN, known))
    alone = estimate("centre_of_mass", Pixels(charges, UNEVEN))
    step = np.arange(-HALF, HALF + 1)
    judge = ESTIMATORS["centre_of_mass"]
    by_level, by_slope = (
        (judge((charges + change).tolist()) - judge((charges - change).tolist())) / 2e-3
        for change in (1e-3 * np.ones(step.size), 1e-3 * step)
    )
    wanted = by_level**2 * 50.0 + by_slope**2 * 30.0
    assert number(found.variance) - number(alone.variance) == pytest.approx(wanted, rel=1e-3)


def test_a_correction_is_taken_off_and_stretches_the_error(device: Device) -> None:
    """Claim: of an error of 0.1 of the estimate a place s becomes 0.9 s, and its variance 0.81 times as large."""
    around = Pixels(spot(0.3, 1.1), UNEVEN)
    plain = estimate("gaussian", around)
    width = Width.certain(auto.Float(1.1), 1.5)
    found = estimate("gaussian", around, width, lambda position, _: (0.1 * position, auto.Float(0.1)))
    assert number(found.shift) == pytest.approx(0.9 * number(plain.shift), rel=1e-5)
    assert number(found.variance) == pytest.approx(0.81 * number(plain.variance), rel=1e-5)


@pytest.mark.parametrize("method", ["parabola", "gaussian"])
def test_noise_of_the_curvature_widens_a_vertex(device: Device, method: Any) -> None:
    """Claim: 1/(1 − var B/B²), B = 2 f₀ − f₋₁ − f₁ of charges or their logarithms, with the noise of pixels and of
    speckle, each at its own step: here speckle's share grows to one side."""
    charge, variance = np.array([1e4, 3e4, 2.5e4]), np.array([1e5, 2e5, 4e5])
    share = np.array([1e-3, 2e-3, 3e-3])

    def speckle(slopes: Any, charges: Any, shift: Any) -> Any:
        return sum(share[step + 1] * dr.square(slopes[step] * charges[step]) for step in (-1, 0, 1))

    def around(step: int) -> Any:
        return auto.Float(charge[step + 1]), auto.Float(variance[step + 1])

    pixels: Any = around
    pixels.floor_sigma = auto.Float(1.0)
    known: Any = SimpleNamespace(propagated_variance=speckle)
    found = _curvature_inflation(method, pixels, auto.Float(0.2), known)
    point, slope = (charge, 1.0) if method == "parabola" else (np.log(charge), 1.0 / charge)
    slopes = np.array([-1.0, 2.0, -1.0]) * slope
    noise = np.sum(slopes**2 * variance) + np.sum(share * (slopes * charge) ** 2)
    curvature = 2.0 * point[1] - point[0] - point[2]
    assert float(found[0]) == pytest.approx(1.0 / (1.0 - noise / curvature**2), rel=1e-5)
    assert noise / curvature**2 > 1e-4


@pytest.mark.parametrize("brighter", [0.01, 0.7, 1.6])
def test_a_window_that_may_stand_at_two_places_adds_their_scatter(device: Device, brighter: float) -> None:
    """Claim: a pixel that is brighter than the next by so many standard deviations of both is not the brightest in
    q = Φ(−Δ) of all lines, half of them where both are alike: q (1 − q) D² is added, D the distance of both places."""
    charges = spot(0.5, 1.1) + np.where(np.arange(2 * HALF + 1) == HALF + 4, 400.0, 0.0)
    charges[HALF] = charges[HALF + 1] + brighter * math.sqrt(UNEVEN[HALF] + UNEVEN[HALF + 1])
    found = estimate("centre_of_mass", Pixels(charges, UNEVEN))
    step = np.arange(-HALF, HALF + 1)

    def mass(middle: int) -> tuple[float, float]:
        near = np.abs(step - middle) <= 3
        place = float(np.sum(step[near] * charges[near]) / np.sum(charges[near]))
        own = np.sum((step[near] - place) ** 2 * UNEVEN[near]) / np.sum(charges[near]) ** 2
        return place, float(own)

    (place, own), (other, _) = mass(0), mass(1)
    assert abs(other - place) > 0.1
    q = float(norm.sf(brighter))
    assert number(found.variance) - own == pytest.approx(q * (1.0 - q) * (other - place) ** 2, rel=1e-3)


def test_the_inverse_of_a_symmetric_matrix(device: Device) -> None:
    mixed = np.array([[1.0, 0.2, -0.4], [0.3, 1.5, 0.6], [-0.2, 0.1, 0.7]])
    matrix = mixed @ mixed.T * np.outer([1.0, 100.0, 0.1], [1.0, 100.0, 0.1])
    entries = [auto.Float(matrix[i, j]) for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))]
    found = np.array([[number(entry) for entry in row] for row in inverse_of(entries)])
    wanted = np.linalg.inv(matrix)
    np.testing.assert_allclose(found, wanted, rtol=2e-4, atol=1e-5 * np.abs(wanted).min())


def test_a_number_becomes_a_charge_with_its_variance() -> None:
    """Claim: of a laser that is off for a fifth of 50 µs: 1000 electrons of dark charge, four times the exposure
    without it is subtracted; read noise and steps then count 1 + 16 times, its dark charge and light 1 + 4 times."""
    sensor = PositionSensor(gain=500.0, read_noise=1000.0, dark_current=2.5e7, prnu=0.005, full_well=5e7)
    known = SensorCalibration.of(sensor, 50e-6, 0.2)
    steps = 500.0**2 / 12.0
    assert (known.dark, known.off_scale) == (pytest.approx(1000.0), pytest.approx(4.0))
    assert known.floor == pytest.approx(17.0 * (1e6 + steps) + 5.0 * 1000.0)
    assert known.full == pytest.approx((65535 - 64) * 500.0 - 5000.0)
    assert known.charge(164.0) == pytest.approx(100.0 * 500.0 - 1000.0)
    assert known.ambient(164.0) == pytest.approx(4.0 * 100.0 * 500.0 - 1000.0)
    assert known.variance(2e6) == pytest.approx(known.floor + 2e6 + 1e8)
    assert known.variance(-2e6) == pytest.approx(known.floor)
    assert known.variance_above(3e5, 2e6) == pytest.approx(known.variance(2e6) + 5.0 * 3e5)
    alone = SensorCalibration.of(sensor, 50e-6)
    assert alone.floor == pytest.approx(1e6 + steps + 1250.0)
    assert alone.floor_sigma == pytest.approx(math.sqrt(alone.floor))
    assert SensorCalibration.of(PositionSensor(), 50e-6).full == pytest.approx(5e7 - 5000.0)


@pytest.mark.parametrize("theta", [-0.4, 0.0, 0.3])
def test_a_spot_is_expected_where_eq_1_says(theta: float) -> None:
    """Claim: pixel i lies at offset + (i + 1/2) pitch; range, width of the beam's image and charge are the judge's."""
    sensor = PositionSensor(offset=1e-3)
    laser = Laser(waist_radius=1.5e-3, waist_distance=2.0)
    known = ExpectedSpot.of(laser, Receiver(), 0.8, sensor, 50e-6)
    sine, cosine = math.sin(theta), math.cos(theta)
    range_m = float(triangulated_range(1e-3 + 60.5 * 50e-6, theta, 0.1, 0.2))
    assert known.range(60.0, sine, cosine) == pytest.approx(range_m, rel=1e-12)
    assert known.pixel(range_m, sine, cosine) == pytest.approx(60.0, rel=1e-12)
    image, spread = known.variances(60.0, sine, cosine)
    magnification = float(image_position(range_m, theta, 0.1, 0.2)) / (0.2 * cosine)
    radius = float(beam_radius(range_m, 1.5e-3, 2.0, 1.5e-6))
    assert image == pytest.approx((0.5 * radius * magnification / 50e-6) ** 2, rel=1e-9)
    assert spread == pytest.approx((12e-6**2 + 38.2e-6**2) / 50e-6**2)
    collected = 15e-3 * 0.5 * 0.8 * 0.25 * math.pi * 0.025**2 / math.pi
    electrons = collected * 0.8 * 50e-6 * 1.5e-6 / (6.62607015e-34 * 299792458.0)
    assert known.white == pytest.approx(electrons, rel=1e-9)


def test_a_white_surface_is_fainter_by_its_range_squared(device: Device) -> None:
    known = ExpectedSpot.of(Laser(), Receiver(), 1.0, PositionSensor(), 50e-6)
    range_m = float(triangulated_range(20.5 * 50e-6, 0.2, 0.1, 0.2))
    found = white_charge(known, auto.Float(20.0), auto.Float(math.sin(0.2)), auto.Float(math.cos(0.2)))
    assert number(found) == pytest.approx(known.white / range_m**2, rel=1e-5)


class Slanted:
    """A line of 60 pixels of light that rises by 3 electrons a pixel, with a peak of 15 pixels about number 25."""

    pixels, subtracted = 60, False
    known = SensorCalibration(0.0, 1.0, 0.0, 0.0, floor=400.0, shot_noise=1.0, prnu=0.0, full=math.inf)

    def charge(self, pixel: Any) -> Any:
        place = auto.Float(auto.Int32(pixel))
        return 100.0 + 3.0 * place + dr.select(dr.abs(place - 25.0) <= 7.0, 5000.0, 0.0)


def test_the_variance_of_a_median_of_seven() -> None:
    """Claim: ∫x² of the fourth of seven ordered normal numbers, 7!/(3!)² Φ³ (1 − Φ)³ φ: to the four digits given."""
    found = quad(lambda x: 140.0 * x * x * (norm.cdf(x) * norm.sf(x)) ** 3 * norm.pdf(x), -8.0, 8.0)[0]
    assert pytest.approx(found, abs=6e-5) == digital_line.MEDIAN_VARIANCE
    assert digital_line.SIDE == 7


def test_a_baseline_is_the_line_through_both_sides(device: Device) -> None:
    """Claim: 100 + 3 · 25 and 3 for each pixel, with the peak left out; of medians 11 pixels to each side (seven from
    the eighth on) of variances 400 + light the level has a quarter of the sum, the slope that over 11²."""
    found = baseline_beside(Slanted(), auto.Int32(25), auto.Int32(7))  # type: ignore[arg-type]
    left, right = 175.0 - 33.0, 175.0 + 33.0
    noise = 0.2104 * (400.0 + left + 400.0 + right)
    assert number(found.level) == pytest.approx(175.0)
    assert number(found.slope) == pytest.approx(3.0)
    assert number(found.level_variance) == pytest.approx(0.25 * noise, rel=1e-3)
    assert number(found.slope_variance) == pytest.approx(0.25 * noise / 121.0, rel=1e-3)
    assert number(found.doubt) == pytest.approx(33.0)


def test_a_baseline_at_the_end_of_the_array_is_the_other_sides(device: Device) -> None:
    """Claim: of pixel 25 with 20 left out to each side the seven pixels at the left would be beyond the array."""
    found = baseline_beside(Slanted(), auto.Int32(25), auto.Int32(20))  # type: ignore[arg-type]
    right = 100.0 + 3.0 * (25.0 + 24.0)
    assert number(found.level) == pytest.approx(right)
    assert (number(found.slope), number(found.slope_variance), number(found.doubt)) == (0.0, 0.0, 0.0)
    assert number(found.level_variance) == pytest.approx(0.2104 * (400.0 + right), rel=1e-3)


@pytest.mark.parametrize("freedom", [4.0, 9.0, 30.0])
def test_quantiles_of_chi_squared(device: Device, freedom: float) -> None:
    """Claim: SciPy's, within what Wilson and Hilferty leave: 1 % at 1 % of false alarms, 3 % at 0.01 %."""
    for chance, slack in ((1e-2, 0.01), (1e-4, 0.03)):
        found = _quantile(auto.Float(freedom), auto.Float(norm.isf(chance)))
        assert number(found) == pytest.approx(chi2.isf(chance, freedom), rel=slack)


def fitted(charges: Array, variances: Array, place: float, sigma: float, guard: int = 4) -> list[float]:
    """Return charge, residuals, their noise, χ², degrees of freedom and saturation of the linear fit of a spot."""
    known = ExpectedSpot.of(Laser(), Receiver(), 1.0, PositionSensor(), 50e-6)
    around = Pixels(charges, variances)
    values = (auto.Int32(guard), auto.Float(place), auto.Float(sigma), auto.Float(0.0))
    return [number(part) for part in _fit(around, known, *values, None)]  # type: ignore[arg-type]


def test_a_fit_counts_the_outermost_pixel_as_all_others(device: Device) -> None:
    """Claim: of a spot so wide that the farthest pixels hold some of it the charge is found and nothing is left, with
    all that are looked at; one electron more on either of the two is seen in the residuals."""
    reach = farthest_pixel(ExpectedSpot.of(Laser(), Receiver(), 1.0, PositionSensor(), 50e-6))
    assert reach <= HALF
    charges, even = spot(0.2, 0.4 * reach, 1e4), np.full(2 * HALF + 1, 100.0)
    charge, residual, *_ = fitted(charges, even, 0.2, 0.4 * reach, guard=reach)
    assert charge == pytest.approx(1e4, rel=1e-4)
    assert residual < 1e-3
    for side in (-reach, reach):
        more = charges.copy()
        more[HALF + side] += 30.0
        assert fitted(more, even, 0.2, 0.4 * reach, guard=reach)[1] > 1.0


def test_a_fit_finds_the_charge_of_a_spot_beside_its_first_place(device: Device) -> None:
    """Claim: of a spot that is linear about its first place and width, height, shift and width are found whatever the
    weights, and what is left is nothing; nine pixels less three quantities are six degrees of freedom."""
    uneven = np.linspace(1.0, 400.0, 2 * HALF + 1)
    shares = spot(0.3, 1.2, 1.0)
    slope = (spot(0.3 + 1e-4, 1.2, 1.0) - spot(0.3 - 1e-4, 1.2, 1.0)) / 2e-4
    wider = (spot(0.3, 1.2 + 1e-4, 1.0) - spot(0.3, 1.2 - 1e-4, 1.0)) / 2e-4
    charge, residual, noise, chi_squared, freedom, _ = fitted(
        5000.0 * shares + 400.0 * slope + 600.0 * wider, uneven, 0.3, 1.2
    )
    assert charge == pytest.approx(5000.0, rel=1e-4)
    assert residual < 0.1
    assert chi_squared < 0.01
    assert freedom == 6.0
    assert noise == pytest.approx(uneven[HALF - 4 : HALF + 5].mean(), rel=1e-5)


def test_a_misfit_is_what_noise_and_an_edge_do_not_explain(device: Device) -> None:
    """Claim: of the mean square that a spot leaves, over its height squared, three times the pixels' variance are taken
    off, and ∫ x² over a step from −½ to ½, a twelfth, of the square of an edge between both sides beneath it.

    Set-up: a spot with a ripple that no width or shift explains; the fit is the same for any variance that all pixels
    share. Tolerance: single precision of the difference of two mean squares.
    """
    known = ExpectedSpot.of(Laser(), Receiver(), 1.0, PositionSensor(), 50e-6)
    charges = spot(0.1, 1.1, 1e4) + 200.0 * np.cos(2.1 * np.arange(2 * HALF + 1))
    settings = Validation(tolerance=0.0)

    def unexplained(variance: float, edge: float) -> float:
        line = no_baseline()
        # Half the difference of the two sides.
        line.doubt = auto.Float(0.5 * edge)
        around: Any = Pixels(charges, np.full(2 * HALF + 1, variance), line)
        found = judge_shape(around, known, auto.Int32(6), auto.Float(0.0), auto.Float(1.0), settings)
        return float((number(found.misfit) * charges[HALF]) ** 2)

    bare = unexplained(1.0, 0.0)
    assert bare > 5e3
    assert bare - unexplained(1001.0, 0.0) == pytest.approx(3.0 * 1000.0, rel=2e-3)
    assert bare - unexplained(1.0, 200.0) == pytest.approx(200.0**2 / 12.0, rel=2e-3)
    assert unexplained(bare, 0.0) == 0.0


def curved(charges: Array) -> tuple[float, float]:
    """Return the curvature of the logarithms of the middle three pixels, and its σ over that of each of them.

    That is the length of (1/c₋₁, 2/c₀, 1/c₁).
    """
    three = charges[HALF - 1 : HALF + 2]
    curvature = float(2.0 * np.log(three[1]) - np.log(three[0]) - np.log(three[2]))
    return curvature, float(np.linalg.norm([1.0, 2.0, 1.0] / three))


@pytest.mark.parametrize(("share", "fits"), [(0.97, False), (1.03, True)])
def test_a_narrow_peak_passes_where_noise_may_have_made_it(device: Device, share: float, fits: bool) -> None:
    """Claim: the curvature of the logarithms of three pixels, 2 ln c₀ − ln c₋₁ − ln c₁, of the narrowest spot that is
    allowed is 1.03/(s² + 1/12); a larger one passes while it is within the deviate of 1 % of its standard deviation."""
    known = ExpectedSpot.of(Laser(), Receiver(), 1.0, PositionSensor(), 50e-6)
    beam, spread = known.variances(100.0, 0.0, 1.0)
    low = 0.7**2 * beam + spread
    charges = np.maximum(spot(0.1, math.sqrt(0.6 * low), 1e5), 1.0)
    curvature, per_sigma = curved(charges)
    excess = curvature - 1.03 / (low + 1.0 / 12.0)
    assert excess > 0.0
    variance = (share * excess / norm.isf(0.01) / per_sigma) ** 2
    settings = Validation(false_alarm=0.01, beam_width=(0.7, 1.5), tolerance=0.0)
    found = judge_shape(
        Pixels(charges, np.full(2 * HALF + 1, variance)),  # type: ignore[arg-type]
        known, auto.Int32(3), auto.Float(0.0), auto.Float(1.0), settings,
    )  # fmt: skip
    assert bool(np.asarray(found.fits.numpy()).ravel()[0]) is fits


@pytest.mark.parametrize(("share", "fits"), [(0.995, False), (1.005, True)])
def test_a_narrow_peak_passes_where_an_edge_beneath_may_have_made_it(
    device: Device, share: float, fits: bool
) -> None:
    """Claim: beside noise the curvature may be wrong by what half the difference of both sides, which the level may be
    off, does to three logarithms: |2/c₀ − 1/c₋₁ − 1/c₁| of it."""
    known = ExpectedSpot.of(Laser(), Receiver(), 1.0, PositionSensor(), 50e-6)
    beam, spread = known.variances(100.0, 0.0, 1.0)
    low = 0.7**2 * beam + spread
    charges = np.maximum(spot(0.1, math.sqrt(0.8 * low), 1e5), 1.0)
    before, middle, after = charges[HALF - 1 : HALF + 2]
    line = no_baseline()
    line.doubt = auto.Float(
        share
        * (curved(charges)[0] - 1.03 / (low + 1.0 / 12.0))
        / abs(2.0 / middle - 1.0 / before - 1.0 / after)
    )
    settings = Validation(false_alarm=0.01, beam_width=(0.7, 1.5), tolerance=1.0)
    found = judge_shape(
        Pixels(charges, np.full(2 * HALF + 1, 1e-6), line),  # type: ignore[arg-type]
        known, auto.Int32(3), auto.Float(0.0), auto.Float(1.0), settings,
    )  # fmt: skip
    assert bool(np.asarray(found.fits.numpy()).ravel()[0]) is fits


def judged(charges: Array, variances: Array, settings: Validation, baseline: Baseline) -> Any:
    """Return what the program finds of a peak's shape, as numbers, and the same by NumPy: fit, χ² and misfit."""
    known = ExpectedSpot.of(Laser(), Receiver(), 1.0, PositionSensor(), 50e-6)
    guard, at = 5, slice(HALF - 5, HALF + 6)
    found = judge_shape(
        Pixels(charges, variances, baseline), known, auto.Int32(guard), auto.Float(0.0), auto.Float(1.0), settings,  # type: ignore[arg-type]
    )  # fmt: skip
    beam, spread = known.variances(100.0, 0.0, 1.0)
    low, high = (limit**2 * beam + spread for limit in settings.beam_width)
    before, middle, after = np.log(charges[HALF - 1 : HALF + 2])
    curvature = 2.0 * middle - before - after
    place, width = (
        0.5 * (after - before) / curvature,
        np.sqrt(np.clip(1.0 / curvature - 1.0 / 12.0, low, high)),
    )
    slopes = [spot(place, width, 1.0)]
    for step in ((1e-4, 0.0), (0.0, 1e-4)):
        ends = [spot(place + sign * step[0], width + sign * step[1], 1.0) for sign in (1.0, -1.0)]
        slopes.append((ends[0] - ends[1]) / 2e-4)
    design = np.stack(slopes, axis=1)[at]
    spreads = variances[at] + number(baseline.level_variance)
    root = 1.0 / np.sqrt(spreads + (settings.tolerance * charges[HALF]) ** 2)
    fit = np.linalg.lstsq(design * root[:, None], charges[at] * root, rcond=None)[0]
    rest = charges[at] - design @ fit
    excess = np.mean(rest**2) - 3.0 * np.mean(spreads) - number(baseline.step_squared) / 12.0
    bent = 2.0 / charges[HALF] - 1.0 / charges[HALF - 1] - 1.0 / charges[HALF + 1]
    three = slice(HALF - 1, HALF + 2)
    noise = np.sum((np.array([1.0, 2.0, 1.0]) / charges[three]) ** 2 * variances[three])
    wide = norm.isf(settings.false_alarm) * np.sqrt(noise) + abs(bent) * number(baseline.doubt)
    fits = curvature - wide <= 1.03 / (low + 1.0 / 12.0) and curvature + wide >= 0.97 / (high + 1.0 / 12.0)
    chi_squared = float(np.sum((rest * root) ** 2))
    fits = fits and chi_squared <= chi2.isf(settings.false_alarm, 8.0)
    misfit = np.sqrt(max(excess, 0.0)) / charges[HALF]
    return (
        (number(found.charge), number(found.misfit), bool(np.asarray(found.fits.numpy()).ravel()[0])),
        (fit[0], misfit, fits, chi_squared),
    )


@pytest.mark.parametrize("place", [-0.45, 0.2, 0.4])
@pytest.mark.parametrize("lit", [False, True])
def test_a_shape_is_judged_by_a_fit_of_its_own(device: Device, place: float, lit: bool) -> None:
    """Claim: charge, misfit and verdict are NumPy's: least squares linear about place and width of three pixels, the
    root mean square beyond three times the variance and a twelfth of the squared step of the two sides.

    Set-up: a spot with a bump of growing height beside it, on even ground and on an edge. Tolerance: 10⁻³, and for
    the quantile of χ² 2 % about it.
    """
    baseline = no_baseline()
    if lit:
        baseline.level_variance, baseline.doubt = auto.Float(40.0), auto.Float(25.0)
    settings = Validation(false_alarm=1e-3, beam_width=(0.7, 1.5), tolerance=0.002)
    variances = np.linspace(60.0, 150.0, 2 * HALF + 1)
    known = ExpectedSpot.of(Laser(), Receiver(), 1.0, PositionSensor(), 50e-6)
    width, verdicts = math.sqrt(sum(known.variances(100.0, 0.0, 1.0))), []
    for height in (0.0, 40.0, 60.0, 120.0, 400.0):
        charges = spot(place, width, 2e4) + height * np.exp(-0.5 * ((np.arange(25) - HALF - 2.5) / 0.7) ** 2)
        charges = np.maximum(charges, 1e-3).astype(np.float32).astype(np.float64)
        (charge, misfit, fits), (wanted, expected, passes, chi_squared) = judged(
            charges, variances, settings, baseline
        )
        assert charge == pytest.approx(wanted, rel=1e-4)
        assert misfit == pytest.approx(expected, rel=1e-3, abs=1e-6)
        if abs(chi_squared / chi2.isf(1e-3, 8.0) - 1.0) > 0.02:
            assert fits == passes
        verdicts.append((fits, misfit > 0.0))
    assert verdicts[0] == (True, False)
    assert verdicts[-1] == (False, True)


def test_a_spot_between_two_pixels_leaves_what_the_second_order_makes(device: Device) -> None:
    """Claim: of a spot without noise what is left is that of NumPy's linear fit about the place of three logarithms."""
    settings = Validation(false_alarm=1e-3, beam_width=(0.7, 1.5), tolerance=0.0)
    for place in (-0.45, -0.3, 0.25, 0.4):
        charges = np.maximum(spot(place, 1.25, 1e7), 1e-3).astype(np.float32).astype(np.float64)
        (_, misfit, _), (_, expected, *_) = judged(
            charges, np.full(2 * HALF + 1, 1e-2), settings, no_baseline()
        )
        assert expected > 0.0
        assert misfit == pytest.approx(expected, rel=0.05, abs=1e-6)


@pytest.mark.parametrize(("share", "fits"), [(0.97, False), (1.03, True)])
def test_a_wide_peak_passes_where_noise_may_have_made_it(device: Device, share: float, fits: bool) -> None:
    """Claim: the curvature of the widest spot that is allowed is 0.97/(s² + 1/12); a smaller one passes while it is
    within the deviate of 1 % of its standard deviation."""
    known = ExpectedSpot.of(Laser(), Receiver(), 1.0, PositionSensor(), 50e-6)
    beam, spread = known.variances(100.0, 0.0, 1.0)
    high = 1.2**2 * beam + spread
    charges = spot(0.1, 1.5 * math.sqrt(high), 1e5)
    curvature, per_sigma = curved(charges)
    lack = 0.97 / (high + 1.0 / 12.0) - curvature
    assert lack > 0.0
    variance = (share * lack / norm.isf(0.01) / per_sigma) ** 2
    settings = Validation(false_alarm=0.01, beam_width=(0.7, 1.2), tolerance=0.0)
    found = judge_shape(
        Pixels(charges, np.full(2 * HALF + 1, variance)),  # type: ignore[arg-type]
        known, auto.Int32(3), auto.Float(0.0), auto.Float(1.0), settings,
    )  # fmt: skip
    assert bool(np.asarray(found.fits.numpy()).ravel()[0]) is fits


def test_a_table_of_errors_is_read_with_its_slope(device: Device) -> None:
    """Claim: of errors 0.1 s + 0.02 w the value at s = 0.3, w = 1.2, and the slope: 0.1 in the table, 0 beyond."""
    widths, shifts = np.linspace(0.5, 2.0, 7), np.linspace(-1.0, 1.0, 11)
    table = BiasTable("gaussian", widths, shifts, 0.1 * shifts + 0.02 * widths[:, None])
    error, rise = Bias(table)(auto.Float(0.3), auto.Float(1.2))
    assert number(error) == pytest.approx(0.054, rel=1e-4)
    assert number(rise) == pytest.approx(0.1, rel=1e-3)
    assert number(Bias(table)(auto.Float(1.5), auto.Float(1.2))[1]) == 0.0


def test_a_template_is_a_spot_integrated_over_pixels(device: Device) -> None:
    template = SpotTemplate(auto.Float(0.3), auto.Float(0.9), no_baseline())
    found = np.array([number(template(step)[0]) for step in range(-HALF, HALF + 1)])
    np.testing.assert_allclose(found / found.sum(), spot(0.3, 0.9, 1.0), atol=1e-6)
