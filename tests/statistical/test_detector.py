"""The line sensor against its own description: every term of the noise, alone and together.

Levels: a right program fails a test of this file for fewer than one in 10⁴ seeds; seeds are fixed.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from prototype import PositionSensor
from scipy import stats

from scanner_sim.analytic import noise, spot
from scanner_sim.detector.line.exposure import electrons_per_watt, expose, pairwise, pixel_response, poisson
from scanner_sim.detector.line.noise import NoiseSwitches
from scanner_sim.render.device import Device

WAVELENGTH, DWELL = 1.5e-6, 50e-6
SILENT = dict.fromkeys(NoiseSwitches.model_fields, False)

pytestmark = pytest.mark.usefixtures("device")


def sensor(*switched_on: str, **changes: Any) -> PositionSensor:
    """Return a sensor of 256 pixels, 1 electron per number and 24 bits, with the named terms only."""
    switches = NoiseSwitches(**{**SILENT, **dict.fromkeys(switched_on, True)})
    return PositionSensor(**{"gain": 1.0, "adc_bits": 24, "full_well": 1e7, "noise": switches, **changes})


def numbers(charge: np.ndarray, line: PositionSensor, shots: int, seed: int = 1) -> np.ndarray:
    """Expose every shot to the same mean charge [electron], shape (pixels,) or (), and return its numbers."""
    each = np.broadcast_to(charge, line.pixels) / electrons_per_watt(line, WAVELENGTH, DWELL)
    table = auto.Float(each.astype(np.float32))
    signal = expose(
        pairwise(lambda pixel, _: dr.gather(auto.Float, table, pixel)),
        dr.arange(auto.UInt32, shots),
        line,
        WAVELENGTH,
        DWELL,
        seed,
    )
    return signal.lines().astype(np.float64)


def test_without_noise_the_number_is_the_judges_charge() -> None:
    """Claim: with every switch off a pixel reads bias + P t η λ/(h c)/gain.

    Set-up: 1 nW on every pixel, gain 7 electron per number. Expected: the judge's electrons. Tolerance: 1e-6,
    single precision.
    """
    line = sensor(gain=7.0, bias=64)
    power = auto.Float(1e-9)
    signal = expose(
        pairwise(lambda pixel, _: dr.gather(auto.Float, power, pixel * 0)),
        dr.arange(auto.UInt32, 3),
        line,
        WAVELENGTH,
        DWELL,
        0,
    )
    expected = 64.0 + spot.electrons(1e-9, DWELL, WAVELENGTH, line.quantum_efficiency) / 7.0
    np.testing.assert_allclose(signal.lines(), float(expected), rtol=1e-6)


@pytest.mark.parametrize(
    ("mean", "shots"), [(0.3, 400), (3.0, 400), (9.9, 400), (10.1, 60), (40.0, 400), (1000.0, 400)]
)
def test_shot_noise_is_poisson(mean: float, shots: int) -> None:
    """Claim: with shot noise alone the charge follows the Poisson law, below and above the change of method.

    Set-up: 102 400 pixels of one mean charge; χ² over all counts, tails joined until each class expects 20.
    Just above the change of method, where the series is good to 0.1 % and 5 million numbers would show it,
    15 360 pixels: there the series adds 2 to a χ² of 20 degrees of freedom.
    Expected: p above 1e-5, so that a right program fails one of the six means once in 16 000 seeds. Power: a
    rounded normal law of the same mean and variance must be rejected at the same level (checked here up to a
    mean of 40, where its missing skewness still shows).
    """
    drawn = numbers(np.array(mean), sensor("shot", bias=0), shots).ravel()
    assert _poisson_p(drawn, mean) > 1e-5
    if mean <= 40.0:
        normal = np.random.default_rng(1).normal(mean, np.sqrt(mean), drawn.size)
        assert _poisson_p(np.maximum(np.rint(normal), 0.0), mean) < 1e-5


@pytest.mark.parametrize("mean", [0.01, 0.5, 2.0, 7.0, 20.0, 39.0])
def test_rare_draws_are_poissons_too(mean: float) -> None:
    """Claim: a draw is the Poisson law's quantile at its normal number's, out to five standard deviations.

    Set-up: normal numbers from −5 to 5. Expected: the quantile at a probability within 2.4e-6 of the number's own:
    float32 sums some forty terms with an error of 2⁻²⁴ each at most. A draw far beyond
    (41 of a mean of 2, which the sum's rounding once gave) is refused.
    """
    import mitsuba as mi

    normal = np.linspace(-5.0, 5.0, 20_001)
    drawn = poisson(mi.Float(np.full(normal.size, mean)), mi.Float(normal)).numpy()
    law, share = stats.poisson(mean), stats.norm.cdf(normal.astype(np.float32).astype(np.float64))
    low, high = law.ppf(np.maximum(share - 2.4e-6, 0.0)), law.ppf(np.minimum(share + 2.4e-6, 1.0 - 1e-9))
    assert ((drawn >= np.maximum(low, 0.0)) & (drawn <= high)).all()


def _poisson_p(drawn: np.ndarray, mean: float) -> float:
    """Return the p value of counts under a Poisson law."""
    law = stats.poisson(mean)
    low, high = (int(law.ppf(q)) for q in (20.0 / drawn.size, 1.0 - 20.0 / drawn.size))
    edges = np.array([-np.inf, *np.arange(low, high) + 0.5, np.inf])
    expected = np.diff(np.array([0.0, *law.cdf(np.arange(low, high)), 1.0])) * drawn.size
    observed = np.histogram(drawn, edges)[0]
    return float(stats.chisquare(observed, expected).pvalue)


def test_read_noise_is_normal() -> None:
    """Claim: with read noise alone the charge is normal with the stated standard deviation and mean zero.

    Set-up: 102 400 pixels, 1000 electrons. Expected: Kolmogorov–Smirnov p above 5e-5. Power: a standard
    deviation wrong by 5 % gives a distance of 0.012 or 3.9/√n, p = 2e-13.
    """
    drawn = numbers(np.array(5e4), sensor("read", bias=0), 400).ravel()
    assert stats.kstest((drawn - 5e4) / 1000.0, "norm").pvalue > 5e-5


@pytest.mark.parametrize(
    ("switched_on", "expected"),
    [
        (("shot",), 2e4),
        (("read",), 300.0**2),
        (("shot", "dark"), 2e4 + 1250.0),
        (("dark",), 0.0),
        (("quantisation",), 0.0),
        (("shot", "read", "dark", "quantisation"), 2e4 + 1250.0 + 300.0**2 + 1000.0**2 / 12.0),
        (("read", "quantisation"), 300.0**2 + 1000.0**2 / 12.0),
    ],
)
def test_variance_of_each_switch(switched_on: tuple[str, ...], expected: float) -> None:
    """Claim: each switch adds its own variance and nothing else.

    Set-up: light of 20 000 electrons, dark charge 1250 (2.5e7/s × 50 µs), read noise 300, gain 1000 where the
    converter rounds and 1 where it does not; 131 072 pixels; the light varies over the pixels by a number,
    so that rounding errors are spread evenly. Expected: Poisson variance of light and dark charge, read
    variance, gain²/12. Tolerance: 4.3 standard errors of a variance, 4.3 √(2/n) = 1.7 %: seven cases, once in
    8000 seeds; where nothing is random, exactly zero between shots. A missing or doubled smallest term
    (dark, 5.9 % of its case) is found with a probability above 0.9999.
    """
    rounded = "quantisation" in switched_on
    line = sensor(*switched_on, read_noise=300.0, gain=1000.0 if rounded else 1.0)
    charge = 2e4 + 1000.0 * np.arange(line.pixels) / line.pixels
    got = numbers(charge, line, 512) * line.electrons_per_number
    if expected == 0.0:
        assert (np.ptp(got, axis=0) == 0.0).all()
        return
    mean = charge + line.bias * line.electrons_per_number + (1250.0 if "dark" in switched_on else 0.0)
    light_above = float(np.mean(charge)) - 2e4 if "shot" in switched_on else 0.0
    assert np.mean((got - mean) ** 2) == pytest.approx(
        expected + light_above, rel=4.3 * np.sqrt(2.0 / got.size)
    )


def test_dark_charge_adds_its_mean() -> None:
    """Claim: the dark switch adds dark current times dwell. Set-up: 2.5e7 electron/s, 50 µs, no light.

    Expected: 1250 electrons on every pixel. Tolerance: single precision.
    """
    np.testing.assert_allclose(numbers(np.array(0.0), sensor("dark", bias=0), 2), 1250.0, rtol=1e-6)


def test_response_is_fixed_to_the_pixel() -> None:
    """Claim: PRNU is a property of the pixel: the same in every shot, another one for another seed.

    Set-up: 4096 pixels with 0.5 %, 1e6 electrons, 3 shots, seeds 1 and 2. Expected: shots equal; relative
    spread 0.005 and mean 1 by the χ² and z tests at 4.1 standard errors each (5e-3 × 4.1/√n for the mean,
    4.1/√(2n) = 4.5 % for the spread; together once in 12 000 seeds); no correlation between seeds, 4.1/√n.
    """
    line = sensor("prnu", bias=0, pixels=4096)
    got = numbers(np.array(1e6), line, 3)
    assert (got == got[0]).all()
    response = got[0] / 1e6
    assert response.std() == pytest.approx(0.005, rel=4.1 / np.sqrt(2 * 4096))
    assert response.mean() == pytest.approx(1.0, abs=0.005 * 4.1 / np.sqrt(4096))
    np.testing.assert_allclose(response, pixel_response(line, 1).numpy(), rtol=1e-6)
    other = numbers(np.array(1e6), line, 1, seed=2)[0]
    assert abs(np.corrcoef(got[0], other)[0, 1]) < 4.1 / np.sqrt(4096)


def test_response_acts_on_light_and_not_on_dark_charge() -> None:
    """Claim: without light PRNU changes nothing.

    Set-up: dark charge and PRNU only. Expected: all pixels equal. Tolerance: none.
    """
    assert np.ptp(numbers(np.array(0.0), sensor("prnu", "dark"), 2)) == 0.0


def test_noise_is_independent_between_pixels_and_shots() -> None:
    """Claim: neighbouring pixels, consecutive shots and light and read noise are uncorrelated.

    Set-up: 131 072 pixels with 1e6 electrons of light (shot noise 1000) and read noise 1000; correlation at
    lags of 1 and 2 pixels, 1 shot, and the read noise of one exposure (no shot noise) against the shot noise
    of another with the same addresses. Expected: 0 within 4.2/√n = 0.0116 (four values, once in 9000 seeds).
    Power: a correlation of 0.025 is found with a probability above 0.9999.
    """
    shots = 512
    both = numbers(np.array(1e6), sensor("shot", "read", bias=0), shots) - 1e6
    light = numbers(np.array(1e6), sensor("shot", bias=0), shots) - 1e6
    read = numbers(np.array(1e6), sensor("read", bias=0), shots) - 1e6
    np.testing.assert_allclose(both, light + read, atol=0.5)
    level = 4.2 / np.sqrt(both.size)
    for first, second in (
        (both[:, :-1], both[:, 1:]),
        (both[:, :-2], both[:, 2:]),
        (both[:-1], both[1:]),
        (light, read),
    ):
        assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < level


def test_full_well_clips_and_spares_the_neighbours() -> None:
    """Claim: charge above the full well is drained: the pixel stays full, its neighbours gain nothing.

    Set-up: one pixel at ten times the full well of 1e6, the others at 1000 electrons; shot noise on.
    Expected: exactly 1e6 in every shot; the mean of the two neighbours over 400 shots is 1000 within
    4 √(1000/800) electrons (once in 16 000 seeds). With the switch off the pixel reads ten full wells.
    """
    charge = np.full(256, 1000.0)
    charge[100] = 1e7
    got = numbers(charge, sensor("shot", "saturation", full_well=1e6, bias=0), 400)
    assert (got[:, 100] == 1e6).all()
    assert got[:, [99, 101]].mean() == pytest.approx(1000.0, abs=4.0 * np.sqrt(1000.0 / 800))
    assert numbers(charge, sensor(full_well=1e6, bias=0), 1)[0, 100] == pytest.approx(1e7, rel=1e-6)


def test_converter_ends() -> None:
    """Claim: numbers stay within 0 and 2^bits − 1, in whole steps.

    Set-up: 8 bits, gain 10, bias 2, read noise of 50 electrons; a dark and a bright half. Expected: whole
    numbers; 0 and 255 are reached and not passed.
    """
    line = sensor("read", "quantisation", "saturation", adc_bits=8, gain=10.0, bias=2, read_noise=50.0)
    got = numbers(np.where(np.arange(256) < 128, 0.0, 2530.0), line, 50)
    assert (got == np.rint(got)).all()
    assert got.min() == 0.0
    assert got.max() == 255.0


def test_quantisation_step() -> None:
    """Claim: one number is ``electrons_per_number`` electrons, rounded to the nearest, and the default gain
    puts the full well at the end of the converter.

    Set-up: a ramp of 256 charges over 2.56 steps, gain 1000, no noise; then the default gain. Expected:
    bias + round(charge/1000); 65535 at the full well and 64 + 65471/4 = 16431.75, rounded, at a quarter of it.
    Tolerance: none.
    """
    charge = 10.0 * np.arange(256) + 0.3
    got = numbers(charge, sensor("quantisation", gain=1000.0, bias=5), 1)[0]
    np.testing.assert_array_equal(got, 5.0 + np.rint(charge / 1000.0))
    assert noise.quantisation_sd(1000.0) == pytest.approx(288.675, abs=1e-3)
    whole = sensor("quantisation", "saturation", gain=None, adc_bits=16, full_well=5e7, bias=64)
    assert numbers(np.array(5e7), whole, 1).min() == 65535.0
    assert numbers(np.array(1.25e7), whole, 1).max() == 16432.0


def test_a_number_depends_on_its_address_alone(device: Device) -> None:
    """Claim: shots give the same numbers in any order and any company.

    Set-up: all terms on; shots 0–199 together, then 70, 3 and 199 alone. Expected: equal, bit for bit.
    """
    line = PositionSensor()
    power = auto.Float(np.linspace(0.0, 1e-9, 256, dtype=np.float32))

    def lines(shots: np.ndarray) -> np.ndarray:
        return expose(
            pairwise(lambda pixel, _: dr.gather(auto.Float, power, pixel)),
            auto.UInt32(shots.astype(np.uint32)),
            line,
            WAVELENGTH,
            DWELL,
            9,
        ).lines()

    some = np.array([70, 3, 199])
    np.testing.assert_array_equal(lines(np.arange(200))[some], lines(some))
