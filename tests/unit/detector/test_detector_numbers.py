"""The detectors without chance: what a charge, a current or an angle of given size and given noise is read as."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.polynomial.hermite_e import HermiteE
from prototype import SHARP, Digitiser, Mirrors, Photodiode, PositionSensor
from scipy.integrate import quad
from scipy.stats import norm
from scipy.stats import poisson as exact

from scanner_sim.detector import encoders
from scanner_sim.detector.encoders import reading_normals, readings
from scanner_sim.detector.line import exposure
from scanner_sim.detector.line.exposure import (
    electrons_per_watt,
    expose,
    pairwise,
    pixel_response,
    poisson,
    unlit_numbers,
)
from scanner_sim.detector.line.speckle import LineSpeckle, _pixels_lit, _Spot
from scanner_sim.detector.packets import dwell_average, gamma_like, mode_edges, mode_ratios
from scanner_sim.detector.photodiode import noise_colour, photodiode, waveform
from scanner_sim.optics.speckle import Optics, packets_of
from scanner_sim.render.device import Device

PLANCK_C = 6.62607015e-34 * 299792458.0
QUIET = {
    "shot": False,
    "read": False,
    "dark": False,
    "prnu": False,
    "saturation": False,
    "quantisation": False,
}


def sensor(*on: str, **more: Any) -> PositionSensor:
    """Return a line sensor with the named terms of noise on."""
    return PositionSensor(**{"noise": QUIET | dict.fromkeys(on, True), "gain": 500.0, **more})


def read(line: PositionSensor, charge: float, shot: float = 0.0, own: float = 0.0) -> float:
    """Return the number of a pixel for a charge of light, and standard normal numbers of light and read noise."""
    parts = (auto.Float(value) for value in (charge, shot, own))
    return float(exposure._read_out(*parts, line, 50e-6).numpy()[0])


def test_charges_become_numbers(device: Device) -> None:
    """Claim: bias + (charge + 25e6/s · 50 µs + read noise)/gain, each term where it is switched on, rounded and kept
    within the converter where these are."""
    assert read(sensor(), 1e5) == pytest.approx(64.0 + 200.0)
    assert read(sensor("dark"), 1e5) == pytest.approx(64.0 + 200.0 + 2.5)
    assert read(sensor("read"), 1e5, own=-2.0) == pytest.approx(64.0 + 200.0 - 4.0)
    assert read(sensor("shot"), 1e8, shot=1.0) == pytest.approx(64.0 + 2e5 + 20.0, abs=0.02)
    assert read(sensor("quantisation"), 1e5 + 240.0) == 264.0
    assert read(sensor("quantisation"), 1e5 + 260.0) == 265.0
    assert read(sensor("saturation", full_well=2e6), 3e6) == pytest.approx(64.0 + 4000.0)
    assert read(sensor("saturation", gain=10.0), 3e6) == 65535.0
    assert read(sensor("read", "saturation"), 0.0, own=-100.0) == 0.0


@pytest.mark.parametrize("bias", [3, 700, 7000])
def test_no_noise_makes_a_dark_pixel_read_beyond_its_limits(device: Device, bias: int) -> None:
    """Claim: a dark pixel's number, with normal numbers as far from 0 as they come, 5.6466, lies within the limits that
    are stated, in single precision too; without noise these leave 3e-6 of it, with read noise 5.65 of its σ."""
    still, noisy = (sensor("dark", *on, bias=bias, gain=37.3, read_noise=81.0) for on in ((), ("read",)))
    least, most = exposure.unlit_numbers(still, 50e-6)
    assert least <= read(still, 0.0) <= most < least + 3e-6 * (1.0 + read(still, 0.0))
    ends = exposure.unlit_numbers(noisy, 50e-6)
    assert ends[0] <= read(noisy, 0.0, own=-5.6466)
    assert read(noisy, 0.0, own=5.6466) <= ends[1]
    assert ends[1] - ends[0] == pytest.approx(2.0 * 5.65 * 81.0 / 37.3, rel=2e-3)


def test_a_watt_frees_its_photons() -> None:
    assert electrons_per_watt(sensor(quantum_efficiency=0.6), 1.2e-6, 2.0) == pytest.approx(
        0.6 * 2.0 / (PLANCK_C / 1.2e-6)
    )


def test_both_exposures_take_their_share_of_the_dwell(device: Device) -> None:
    """Claim: for 3/4 of the dwell both lights count, for 1/4 the background; each pixel of each shot has its own."""
    line = sensor(pixels=9)
    shots = 70

    def light(pixel: Any, place: Any) -> Any:
        return (auto.Float(place) * 10.0 + auto.Float(pixel) + 1.0) * 1e-9

    signal = expose(
        pairwise(light), dr.arange(auto.UInt32, shots), line, 1.5e-6, 1e-4, 1,
        background=pairwise(lambda pixel, place: 0.5 * light(pixel, place)), laser_off=0.25,
    )  # fmt: skip
    number = np.arange(shots)[:, None] * 10.0 + np.arange(9) + 1.0
    one = 0.8e-9 * 1e-4 * 1.5e-6 / PLANCK_C / 500.0
    np.testing.assert_allclose(signal.lines(0) - 64.0, 0.75 * one * number, rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(signal.lines(1) - 64.0, 0.125 * one * number, rtol=1e-5, atol=1e-4)
    for pixel, place in ((0, 0), (5, 3), (8, 69), (1, 64)):
        at = signal.address(auto.UInt32(pixel), auto.UInt32(place))
        stored = dr.gather(auto.Float, signal.number, at).numpy()[0]
        assert stored == signal.lines(0)[place, pixel]


def test_pixels_respond_unlike_by_their_spread(device: Device) -> None:
    """Claim: the standard deviation of 4096 is known to 1.1 %: 5 % is 4.5 of its own. All noise off, all are alike."""
    line = type(sensor()).model_construct(**(dict(sensor("prnu")) | {"pixels": 4096, "prnu": 0.02}))
    assert pixel_response(line, 5).numpy().std() == pytest.approx(0.02, rel=0.05)
    assert np.ptp(pixel_response(sensor(), 5).numpy()) == 0.0


def test_light_and_read_noise_are_drawn_apart(device: Device) -> None:
    """Claim: variances of 1e6 and 1e6 add up; of 256 pixels and 20 shots the sum is known to 2 %: 9 % is 4.5 of it.

    Of two pixels side by side no part is common: their covariance over the variance is 0 ± 4.5/√2560.
    """
    line = sensor("shot", "read", pixels=256, gain=1.0)
    watts = 1e6 / electrons_per_watt(line, 1.5e-6, 1e-4)
    signal = expose(
        pairwise(lambda pixel, place: auto.Float(watts) + 0.0 * auto.Float(pixel)),
        dr.arange(auto.UInt32, 20), line, 1.5e-6, 1e-4, 1,
    )  # fmt: skip
    lines = signal.lines() - 64.0 - 1e6
    assert np.mean(lines**2) == pytest.approx(2e6, rel=0.09)
    together = np.mean(lines[:, ::2] * lines[:, 1::2]) / np.mean(lines**2)
    assert abs(together) < 4.5 / math.sqrt(2560)


@pytest.mark.parametrize("mean", [0.7, 17.3, 40.2, 47.9, 313.4, 1250.7])
def test_no_number_of_dark_charges_leaves_its_ends(device: Device, mean: float) -> None:
    """Claim: normal numbers of ±5.65, the largest there are, give charges within the stated ends and 3 from them."""
    line = sensor("shot", "dark", gain=1.0, dark_current=mean / 50e-6)
    least, largest = unlit_numbers(line, 50e-6)
    low, high = (read(line, 0.0, shot=end) for end in (-5.65, 5.65))
    assert least <= low <= least + 3.0
    assert largest - 3.0 <= high <= largest


@pytest.mark.parametrize("mean", [0.05, 0.7, 3.0, 12.0, 35.0])
def test_few_photons_are_the_exact_quantile(device: Device, mean: float) -> None:
    """Claim: SciPy's quantile, but where the probability lies within single precision of a step."""
    z = np.linspace(-3.5, 3.5, 401)
    found = poisson(
        auto.Float(np.full(401, mean, dtype=np.float32)), auto.Float(z.astype(np.float32))
    ).numpy()
    assert np.mean(found == exact.ppf(norm.cdf(z), mean)) > 0.99


@pytest.mark.parametrize("mean", [60.0, 300.0, 4000.0])
def test_many_photons_are_the_quantile_to_the_fourth_cumulant(device: Device, mean: float) -> None:
    """Claim: SciPy's quantile nearly always, within 3 standard deviations; never one more than it on the mean.

    The series leaves out terms of z³/mean: 3 % of all cases at a mean of 60, where they move the number by 0.03.
    """
    z = np.linspace(-3.0, 3.0, 2001)
    found = poisson(
        auto.Float(np.full(2001, mean, dtype=np.float32)), auto.Float(z.astype(np.float32))
    ).numpy()
    apart = found - exact.ppf(norm.cdf(z), mean)
    assert np.mean(apart != 0.0) < 0.05
    assert abs(apart.mean()) < 0.03


def test_a_bias_leaves_half_of_the_converter() -> None:
    """Claim: of 16 bits 65 535 is the largest number, and 32 767 the largest bias."""
    assert sensor().largest_number == 65535
    assert sensor(bias=32767).bias == 32767
    with pytest.raises(Exception, match="less than half"):
        sensor(bias=32768)
    assert sensor(gain=None, bias=535, full_well=6.5e6).electrons_per_number == pytest.approx(100.0)


def test_the_receivers_numbers() -> None:
    """Claim: M = 10 and k = 0.45 have F = 4.5 + 0.55 · 1.9; a Gaussian low-pass passes half of the power at its −3 dB
    frequency, and its band is ∫|H|² df; noise is 2qM²F R₀B per light, 2q(M²F I_b + I_s)B and i²B without it."""
    diode = Photodiode()
    assert diode.excess_noise == pytest.approx(5.545)
    assert diode.amperes_per_watt == pytest.approx(9.5)
    passes = lambda f: math.exp(-((2.0 * math.pi * f * diode.response_sigma) ** 2))  # noqa: E731
    assert passes(200e6) == pytest.approx(0.5, rel=1e-9)
    band = quad(passes, 0.0, 3e9, points=[2e8])[0]
    assert diode.noise_bandwidth == pytest.approx(band, rel=1e-6)
    charge = 2.0 * 1.602176634e-19 * band
    assert diode.light_variance == pytest.approx(charge * 100.0 * 5.545 * 0.95, rel=1e-6, abs=0.0)
    steady = charge * (100.0 * 5.545 * 0.5e-9 + 5e-9) + 4e-24 * band
    assert diode.dark_variance == pytest.approx(steady, rel=1e-6, abs=0.0)
    lit = waveform.noise_sigma(diode, Digitiser(), 1e-6)
    step = 0.5e-3 * (17.0 / 16.0) / 16383.0
    assert lit**2 == pytest.approx(
        steady + 1e-6 * charge * 100.0 * 5.545 * 0.95 + step**2 / 12.0, rel=1e-6, abs=0.0
    )
    assert waveform.quantisation_variance(diode, Digitiser()) == pytest.approx(
        step**2 / 12.0, rel=1e-9, abs=0.0
    )


@pytest.mark.parametrize(("saturation", "fits"), [(3.49e-6, False), (3.51e-6, True)])
def test_no_amplifier_is_filled_by_the_dark(saturation: float, fits: bool) -> None:
    """Claim: the current of the bulk is multiplied, that of the surface is not: 50 · 60 nA + 500 nA = 3.5 µA."""
    numbers = {"gain": 50.0, "bulk_dark_current": 60e-9, "surface_dark_current": 500e-9}
    if fits:
        assert Photodiode(**numbers, saturation=saturation).gain == 50.0
        return
    with pytest.raises(ValueError, match=r"the dark current of 3\.5e-06 A is larger than the 3\.49e-06 A"):
        Photodiode(**numbers, saturation=saturation)


def test_a_record_begins_before_its_gate_and_ends_behind_it() -> None:
    """Claim: light from 3 m and 30 m arrives after 20 and 200 ns; as much is kept before as behind, to four samples."""
    record = Digitiser(gate=(3.0, 30.0))
    before = 6.0 / 299792458.0 - record.start
    behind = record.start + record.samples / record.rate - 60.0 / 299792458.0
    assert before == pytest.approx(photodiode._MARGIN, rel=1e-9)
    assert before > 0.0
    assert 0.0 <= behind - before < 4.0 / record.rate


def test_noise_has_the_colour_of_the_electronics() -> None:
    """Claim: of a Gaussian response of 1.3 samples the autocorrelation is that of h ⋆ h; the taps' is the same, and
    their squares add up to 1."""
    time = np.linspace(-30.0, 30.0, 60001)
    h = np.exp(-0.5 * (time / 1.3) ** 2)
    for lag in (1, 2, 4):
        wanted = np.sum(h * np.exp(-0.5 * ((time - lag) / 1.3) ** 2)) / np.sum(h * h)
        assert float(noise_colour.correlation(np.array(lag), 1.3)) == pytest.approx(wanted, rel=1e-6)
    taps = noise_colour.colouring_taps(1.3)
    assert np.sum(taps**2) == pytest.approx(1.0)
    for lag in (1, 2, 4):
        found = np.sum(taps[lag:] * taps[:-lag])
        assert found == pytest.approx(float(noise_colour.correlation(np.array(lag), 1.3)), abs=1e-4)


@pytest.mark.parametrize("sigma", [0.3, 0.66, 3.0])
def test_light_noise_is_smoothed_by_the_square_of_the_response(sigma: float) -> None:
    """Claim: taps² spreads light by their own variance; what is added makes it that of h², σ²/2, or nothing."""
    taps = noise_colour.colouring_taps(sigma)
    away = np.arange(taps.size) - taps.size // 2
    own = float(np.sum(away**2 * taps**2))
    added = noise_colour.light_noise_variance(sigma)
    assert added + own == pytest.approx(max(0.5 * sigma**2, own), rel=1e-6)


@pytest.mark.parametrize(("along", "across"), [(0.05, 0.02), (0.8, 0.0), (0.0, 1.7), (1.5, 2.5)])
def test_a_dwell_averages_what_the_path_correlates(along: float, across: float) -> None:
    """Claim: 2∫(1 − x) ρ(x) dx of exp(−δ²/w²), and of (1 − 2 (δ along the line)²/w²) exp(−δ²/w²), w = 1."""
    whole = along**2 + across**2
    energy = quad(lambda x: 2.0 * (1.0 - x) * math.exp(-whole * x * x), 0.0, 1.0)[0]
    place = quad(
        lambda x: 2.0 * (1.0 - x) * (1.0 - 2.0 * (along * x) ** 2) * math.exp(-whole * x * x), 0.0, 1.0
    )[0]
    found = dwell_average(np.array(along), np.array(across), np.array(1.0))
    assert (float(found[0]), float(found[1])) == pytest.approx((energy, place), rel=2e-4)


def test_modes_are_integrals_of_hermite_functions(device: Device) -> None:
    """Claim: ∫ rⁿ He_n(x) φ(x)/√n! dx between two places, by quadrature; 0 beyond the modes there are."""
    ratio, low, high = 0.7, -0.6, 1.1
    optics = Optics(cell=1.0, aberration=0.2, diffusion=0.5, modes=5)
    ratios = mode_ratios(optics, auto.Float(ratio))
    ends = [mode_edges(ratios, auto.Float(place)) for place in (low, high)]
    assert not any(mode.numpy().any() for mode in ends[0][5:])
    for modes in range(4, 17):
        kernels = len(mode_ratios(replace(optics, modes=modes), auto.Float(ratio))) + 1
        assert kernels % 4 == 3
        assert modes <= kernels < modes + 4
    for order in range(5):
        basis = HermiteE.basis(order)
        wanted = (
            ratio**order
            / math.sqrt(math.factorial(order))
            * quad(lambda x, basis=basis: basis(x) * norm.pdf(x), low, high)[0]
        )
        found = float(ends[1][order].numpy()[0]) - float(ends[0][order].numpy()[0])
        assert found == pytest.approx(wanted, abs=2e-6)


@pytest.mark.parametrize("deviation", [0.1, 0.3, 0.5])
def test_energies_of_speckle_have_mean_one_and_their_variance(device: Device, deviation: float) -> None:
    """Claim: by quadrature over the normal number, the mean to 1e-3 and the standard deviation to 1 %.

    Wilson and Hilferty's cube has them to v²/27 or better; where it is cut off at 0 lies less than 1e-5.
    """
    z, weights = np.polynomial.hermite_e.hermegauss(40)
    weights = weights / weights.sum()
    found = gamma_like(
        auto.Float(np.full(40, deviation, dtype=np.float32)), auto.Float(z.astype(np.float32))
    ).numpy()
    mean = float(found @ weights)
    assert mean == pytest.approx(1.0, abs=1e-3)
    assert math.sqrt(float((found - mean) ** 2 @ weights)) == pytest.approx(deviation, rel=0.01)


def test_encoders_round_to_the_nearest_step(device: Device) -> None:
    """Claim: 2.6 and −2.6 steps are read as 3 and −3; noise adds a standard deviation for each normal number."""
    mirrors = Mirrors(readout_step=1e-6, readout_noise=2e-6)
    none = np.zeros(2)
    read_angles = readings(np.array([2.6e-6, -2.6e-6]), np.array([0.4e-6, 7.0e-6]), none, none, mirrors)
    np.testing.assert_allclose(read_angles, [[3e-6, -3e-6], [0.0, 7e-6]], atol=1e-15)
    noisy = readings(none, none, np.array([1.0, -2.0]), np.array([3.0, 0.0]), mirrors)
    np.testing.assert_allclose(noisy, [[2e-6, -4e-6], [6e-6, 0.0]], atol=1e-15)


def test_both_encoders_have_their_own_noise(device: Device) -> None:
    one, other = (normal.numpy() for normal in reading_normals(dr.arange(auto.UInt32, 2000), 3))
    assert abs(np.corrcoef(one, other)[0, 1]) < 4.5 / math.sqrt(2000)
    assert encoders.Stream.READOUT is not encoders.Stream.CLOCK


def test_packets_fill_the_pupil_and_those_at_its_edge_count_in_part() -> None:
    """Claim: at x = 2 and 4 the judge's sum over the pupil, to 2 %; of a slope the same; the places' variance is half
    of the image's and σ_a² of the slope; all blurs add up."""
    from scanner_sim.analytic.speckle import pupil_averages

    for ratio in (2.0, 4.0):
        energy, slope = pupil_averages(ratio)
        optics = Optics(cell=0.5, aberration=0.8, diffusion=0.6, modes=4)
        along = (ratio * 0.5) ** 2
        found = packets_of(optics, along, along, SHARP)
        assert found.energy == pytest.approx(energy, rel=0.02)
        surface, aberrant = 0.5 * along, 0.8**2 * slope / energy
        assert found.on_surface == pytest.approx(surface / (surface + aberrant), rel=0.03)
        own = (0.5 / math.pi) ** 2 * (1.0 + 0.8**2 / (along + 0.25))
        whole = surface + aberrant + 0.6**2 + own
        assert found.sigma**2 == pytest.approx(whole, rel=0.03)
        assert (found.ratio * found.sigma) ** 2 == pytest.approx(surface + aberrant, rel=0.03)
        assert found.moving(0.5, 0.1)[1] == pytest.approx(
            found.on_surface * 0.1 + (1.0 - found.on_surface) * 0.5
        )
    wide, tall = packets_of(optics, 4.0, 1.0, SHARP), packets_of(optics, 1.0, 4.0, SHARP)
    assert wide.energy == pytest.approx(tall.energy)
    assert wide.sigma > tall.sigma


def test_an_array_is_as_long_as_all_its_pixels() -> None:
    assert sensor(pixels=96, pitch=10e-6).length == pytest.approx(0.96e-3, rel=1e-12)


@pytest.mark.parametrize("laser_off", [0.0, 0.3])
def test_an_exposure_tells_the_brightest_background_of_its_pixels(device: Device, laser_off: float) -> None:
    """Claim: of each shot the largest that its pixels' light brings along, of the pixels that are exposed."""
    line, shots = sensor(pixels=10), 3
    beneath = 1e-12 * np.random.default_rng(7).permutation(30).reshape(shots, 10).astype(np.float32)
    table = auto.Float(beneath.ravel())

    def light(pixel: Any, index: Any) -> Any:
        one, other = (dr.gather(auto.Float, table, index * 10 + pixel + side) for side in (0, 1))
        return 2.0 * one, 3.0 * other, dr.maximum(one, other)

    number = dr.arange(auto.UInt32, shots)
    window = exposure.Window(auto.UInt32([0, 2, 4]), auto.UInt32([9, 5, 5]))
    for some, ends in ((None, [(0, 9)] * 3), (window, [(0, 9), (2, 5), (4, 5)])):
        found = expose(
            light, number, line, 1.5e-6, 50e-6, 4, background=light, laser_off=laser_off, window=some
        )
        wanted = [beneath[shot, first : last + 1].max() for shot, (first, last) in enumerate(ends)]
        np.testing.assert_array_equal(found.background_peak.numpy(), wanted)
    dark = expose(pairwise(lambda pixel, index: auto.Float(1e-12)), number, line, 1.5e-6, 50e-6, 4)
    assert not dark.background_peak.numpy().any()


def test_speckle_is_followed_as_far_as_spots_reach(device: Device) -> None:
    """Claim: from the pixel that holds four standard deviations before the first spot with light to the one that holds
    as many behind the last, on the line; so many pixels there are, one at least where nothing is lit."""
    coherence = auto.Float(1.0)
    spots = [
        _Spot(auto.Float(amount), auto.Float(position), auto.Float(variance), coherence)
        for amount, position, variance in (
            ([5.0, 0.0, 0.0, 2.0], [30.2, 9.0, 9.0, 2.0], [4.0, 1.0, 1.0, 9.0]),
            ([1.0, 3.0, 0.0, 0.0], [44.7, 20.0, 9.0, 9.0], [0.25, 1.0, 1.0, 1.0]),
        )
    ]
    first, count = _pixels_lit(spots, 64)
    # 30.2 − 8.5 and 44.7 + 2.5; 20 ∓ 4.5; 2 ∓ 12.5.
    assert first.numpy().tolist()[:2] == [21, 15]
    assert first.numpy().tolist()[3] == 0
    assert count.numpy().tolist()[:2] == [48 - 21 + 1, 25 - 15 + 1]
    assert count.numpy().tolist()[2:] == [1, 15 + 1]


def test_a_table_of_speckle_is_that_of_all_of_its_pixels(device: Device) -> None:
    """Claim: factors stand pixel after pixel from each shot's first one on, and all pixels before and behind keep their
    light; one begins at the line's end, where the first is no faint one."""
    first, factor = np.array([0, 3]), np.array([[0.5, 1.5], [0.7, 1.7], [0.9, 1.9]])
    table = LineSpeckle(auto.Float(factor.ravel()), auto.Int32(first), pixels=3, shots=2)
    for shot, begun in enumerate(first.tolist()):
        wanted = np.ones(8)
        wanted[begun : begun + 3] = factor[:, shot]
        found = table(dr.arange(auto.UInt32, 8), dr.full(auto.UInt32, shot, 8))
        np.testing.assert_allclose(found.numpy(), wanted, rtol=1e-6)
