"""The judge's budgets against its own bounds, source by source."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import constants
from scipy.optimize import brentq

from scanner_sim.analytic.array import SensorArray
from scanner_sim.analytic.beam import beam_radius
from scanner_sim.analytic.budget import InstrumentNumbers, range_budget
from scanner_sim.analytic.echo_budget import EchoInstrument, echo_budget, fused_sigma
from scanner_sim.analytic.edge import sampled_crossing
from scanner_sim.analytic.estimators import ESTIMATORS
from scanner_sim.analytic.geometry import range_error
from scanner_sim.analytic.noise import cramer_rao
from scanner_sim.analytic.speckle import SpeckledSpot, pixel_covariance, pixel_shares, position_sigma
from scanner_sim.analytic.time_of_flight import coloured_noise_bound
from scanner_sim.foundation.constants import PLANCK, SPEED_OF_LIGHT

R = 9.0
BENCH = InstrumentNumbers(
    estimator="maximum_likelihood", corrected=False, array=SensorArray(0.1, 0.2, 0.025), baseline=0.2,
    aperture=0.025, transmission=0.5,
    aberration=12e-6, diffusion=38e-6, wavelength=1.5e-6, power=15e-3, waist_radius=2e-3, waist_distance=0.0,
    m_squared=1.0, pitch=50e-6, efficiency=0.8, dwell=50e-6, reflectance=0.5, shot=1.0, read=0.0, dark=0.0, step=0.0,
    response=0.0, contrast=0.0, sweep=0.0, jitter=8e-6, wobble=3e-6, synchronisation=1e-6, readout=2e-6, half=0.05,
)  # fmt: skip
ECHO = EchoInstrument(
    energy=0.2e-6, pulse=0.85e-9, response=0.66e-9, aperture=0.025, transmission=0.5, reflectance=0.5, gain=10.0,
    excess=5.5, responsivity=0.95, bulk=0.0, surface=0.0, shot=0.0, amplifier=2e-12, saturation=math.inf,
    interval=1e-9, step=0.0, jitter=60e-12, drift=1e-6, sunlight=0.0, field=5e-3,
)  # fmt: skip


def charge() -> float:
    """Return the electrons of a facing target: P T ρ A/(π R²) · QE t λ/(h c)."""
    watts = 15e-3 * 0.5 * 0.5 * 0.25 * math.pi * 0.025**2 / (math.pi * R**2)
    return watts * 50e-6 * 0.8 * 1.5e-6 / (PLANCK * SPEED_OF_LIGHT)


def bound(read: float, background: float = 0.0) -> float:
    """Return the bound on the range of a fit, root mean square over a pixel [m]."""
    image = 0.5 * float(beam_radius(R, 2e-3, 0.0, 1.5e-6)) * 0.1 / R
    width = math.sqrt(image**2 + 12e-6**2 + 38e-6**2) / 50e-6
    phases = (np.arange(40) + 0.5) / 40 - 0.5
    squares = [cramer_rao(float(phase), width, charge(), background, read) ** 2 for phase in phases]
    return float(range_error(R, 0.0, 0.1, 0.2, 50e-6)) * math.sqrt(float(np.mean(squares)))


@pytest.mark.parametrize(("read", "subtracted"), [(0.0, 0.0), (800.0, 0.0), (800.0, 3.0)])
def test_photons_and_amplifier_make_the_bound(read: float, subtracted: float) -> None:
    """Claim: shot and read noise together are the Cramér–Rao bound; what is subtracted k times adds k² of the read."""
    told = range_budget(replace(BENCH, read=read, subtracted=subtracted), R)
    wanted = bound(read * math.sqrt(1.0 + subtracted**2))
    assert math.hypot(told["shot"], told["read"]) == pytest.approx(wanted, rel=2e-3)
    assert (told["read"] > 0.0) is (read > 0.0)


def test_dark_and_steps_are_noise_of_every_pixel() -> None:
    """Claim: dark charge counts 1 + k times, steps as g²/12 and 1 + k² times: as so much read noise would."""
    dark = range_budget(replace(BENCH, dark=3e5, subtracted=2.0), R)["shot"]
    assert dark == pytest.approx(bound(math.sqrt(3e5 * 3.0)), rel=2e-3)
    steps = range_budget(replace(BENCH, step=2000.0, subtracted=2.0), R)
    both = math.hypot(steps["shot"], steps["quantisation"])
    assert both == pytest.approx(bound(math.sqrt(2000.0**2 / 12.0 * 5.0)), rel=2e-3)


def test_stray_light_is_noise_of_every_pixel_and_lacks_in_the_spot() -> None:
    """Claim: of a share s of N electrons each of n pixels has s N/n, as so much background, and the spot (1 − s) N, as
    of a weaker laser; unlike pixels see it, and it is what the laser does, whatever is subtracted."""
    veiled = replace(BENCH, stray=0.4, pixels=100)
    weak, veil = replace(BENCH, power=0.6 * 15e-3), 0.4 * charge() / 100.0
    told = range_budget(veiled, R)
    wanted = range_budget(replace(weak, dark=veil), R)
    assert math.hypot(told["shot"], told["stray"]) == pytest.approx(wanted["shot"], rel=1e-9)
    assert told["stray"] > 0.01 * told["shot"]
    assert told["all"] == pytest.approx(wanted["all"], rel=1e-9)
    assert range_budget(BENCH, R)["stray"] == 0.0
    alone = replace(veiled, shot=0.0, response=0.1)
    lit, dark = (range_budget(replace(alone, subtracted=k), R)["response"] for k in (0.0, 2.0))
    assert lit == pytest.approx(dark, rel=1e-12)
    assert lit > 1.001 * range_budget(replace(weak, shot=0.0, response=0.1), R)["response"]
    for name in ("vibration", "power"):
        assert told[name] == echo_budget(ECHO, R)[name] == 0.0


def test_sunlight_is_noise_of_every_pixel() -> None:
    """Claim: E ρ/π · A S T/f² in electrons, 1 + k times: as so much background would."""
    lit = replace(BENCH, sunlight=9.0, height=250e-6, subtracted=1.0)
    watts = 9.0 * 0.5 / math.pi * 50e-6 * 250e-6 / 0.1**2 * 0.5 * 0.25 * math.pi * 0.025**2
    ambient = watts * 50e-6 * 0.8 * 1.5e-6 / (PLANCK * SPEED_OF_LIGHT)
    told = range_budget(lit, R)
    assert math.hypot(told["shot"], told["sun"]) == pytest.approx(bound(0.0, 2.0 * ambient), rel=2e-3)


def test_angles_move_the_range_by_eq_1() -> None:
    """Claim: ∂R/∂Θ = d − R tanΘ over ±half, and f (1 + p²/f²) of the angle between projection and reception."""
    told = range_budget(BENCH, R)
    theta = np.linspace(-0.05, 0.05, 20_001)
    slope = math.sqrt(float(np.mean((0.2 - R * theta) ** 2)))
    for name, sigma in (("jitter", 8e-6), ("wobble", 3e-6), ("readout", 2e-6)):
        assert told[name] == pytest.approx(slope * sigma, rel=1e-3)
    near = range_budget(BENCH, 1.0)
    apart = 0.1 * (1.0 + 0.2**2) * 1e-6
    assert near["synchronisation"] == pytest.approx(apart / (0.1 * 0.2), rel=1e-9)
    warm = range_budget(replace(BENCH, kelvins=2.0, drift_zero=15e-6, drift_scale=50e-6), R)
    turned = 2.0 * (15e-6 + 50e-6 * theta)
    assert warm["drift"] == pytest.approx(
        math.sqrt(float(np.mean(((0.2 - R * theta) * turned) ** 2))), rel=6e-3
    )
    squares = [value**2 for name, value in warm.items() if name != "all"]
    assert warm["all"] == pytest.approx(math.sqrt(sum(squares)))


def test_speckle_counts_by_its_contrast() -> None:
    weak, strong = (range_budget(replace(BENCH, contrast=c), R)["speckle"] for c in (0.01, 0.02))
    assert strong == pytest.approx(2.0 * weak, rel=0.02)


def test_speckle_is_that_of_the_pixels_root_mean_square_over_a_pixel() -> None:
    """Claim: an estimator that sees proportions only has the speckle of its pixels' shares, brute force at 48 phases.

    16 phases are in the budget; the gaussian estimator's speckle varies by a tenth over a pixel, smoothly.
    """
    told = range_budget(replace(BENCH, contrast=0.05, estimator="gaussian"), R)["speckle"]
    image = 0.5 * float(beam_radius(R, 2e-3, 0.0, 1.5e-6)) * 0.1 / R
    spot = SpeckledSpot(image, 1.5e-6 * 4.0, 12e-6, 38e-6, 50e-6)
    squares = []
    for phase in (np.arange(48) + 0.5) / 48 - 0.5:
        centre = 15.0 + float(phase)
        shares = pixel_shares(1.0, centre, spot.sigma / 50e-6, 31)
        covariance = pixel_covariance(spot, centre, 31)
        squares.append(position_sigma(ESTIMATORS["gaussian"], shares, covariance) ** 2)
    wanted = 0.05 * math.sqrt(float(np.mean(squares)))
    assert told == pytest.approx(wanted * float(range_error(R, 0.0, 0.1, 0.2, 50e-6)), rel=5e-3)


def test_a_fit_weighs_pixels_with_their_speckle_by_its_squared_contrast() -> None:
    """Claim: a pixel's own speckle adds C² s N m to its variance, as if the shot noise were so much stronger.

    The fit's share of read noise is then that of such a shot noise; with the weights of photons alone it is 17 % less.
    """
    contrast, read = 0.3, 2000.0
    image = 0.5 * float(beam_radius(R, 2e-3, 0.0, 1.5e-6)) * 0.1 / R
    spot = SpeckledSpot(image, 1.5e-6 * 4.0, 12e-6, 38e-6, 50e-6)
    stronger = 1.0 + contrast**2 * spot.single_variance((1.0, 1.0)) * charge()
    told = range_budget(replace(BENCH, contrast=contrast, read=read), R)["read"]
    wanted = range_budget(replace(BENCH, shot=stronger, read=read), R)["read"]
    assert told == pytest.approx(wanted, rel=1e-6)


def test_a_clock_that_only_drifts_errs_in_proportion_to_the_range() -> None:
    """Claim: 1 µm of each metre."""
    assert echo_budget(replace(ECHO, jitter=0.0), R)["clock"] == pytest.approx(9e-6, rel=1e-12)


def test_an_echo_reaches_its_bound() -> None:
    """Claim: with the amplifier's noise alone σ_R is c/2 times the judge's bound on the delay."""
    share = 0.25 * math.pi * 0.025**2 * 0.5 * 0.5 / (math.pi * R**2)
    width = math.hypot(0.85e-9, 0.66e-9)
    peak = 10.0 * 0.95 * 0.2e-6 * share / (math.sqrt(2.0 * math.pi) * width)
    noise = 2e-12 / math.sqrt(4.0 * math.sqrt(math.pi) * 0.66e-9)
    bound_s = coloured_noise_bound(0.85e-9, 0.66e-9, 1e-9, peak / noise, 1e-6)
    told = echo_budget(ECHO, R)
    assert told["amplifier"] == pytest.approx(0.5 * SPEED_OF_LIGHT * bound_s, rel=2e-3)
    assert told["clock"] == pytest.approx(math.hypot(0.5 * SPEED_OF_LIGHT * 60e-12, R * 1e-6))
    assert told["all"] == pytest.approx(math.hypot(told["amplifier"], told["clock"]))
    # Bulk dark current has the density 2 q M² F I, like an amplifier of its root; a faint echo has no other noise.
    like = math.sqrt(2.0 * 1.602176634e-19 * 100.0 * 5.5 * 5e-10)
    dark = echo_budget(replace(ECHO, amplifier=0.0, bulk=5e-10, shot=1.0, energy=2e-14), R)
    same = echo_budget(replace(ECHO, amplifier=like, energy=2e-14), R)
    assert dark["shot"] == pytest.approx(same["amplifier"], rel=0.02)


def test_a_clipped_echo_is_timed_by_two_edges() -> None:
    """Claim: half of the noise over the slope at half of the saturation, squared: V √(2 ln(A/V))/σ."""
    clipped = replace(ECHO, saturation=1e-7, jitter=0.0, drift=0.0)
    share = 0.25 * math.pi * 0.025**2 * 0.5 * 0.5 / (math.pi * R**2)
    width = math.hypot(0.85e-9, 0.66e-9)
    peak = 10.0 * 0.95 * 0.2e-6 * share / (math.sqrt(2.0 * math.pi) * width)
    assert peak > 1e-7
    level = 0.5e-7
    slope = level * math.sqrt(2.0 * math.log(peak / level)) / width
    noise = 2e-12 / math.sqrt(4.0 * math.sqrt(math.pi) * 0.66e-9)
    wanted = 0.5 * SPEED_OF_LIGHT * noise / slope / math.sqrt(2.0)
    assert echo_budget(clipped, R)["amplifier"] == pytest.approx(wanted, rel=1e-9)


def test_shot_noise_follows_its_echo() -> None:
    """Claim: of the light's own noise σ falls as 1/√E: q M² F R₀ E G, by brute force for a slow pulse.

    A pulse of eight samples in nearly white noise of a fast response: variance of the delay τ²/N_eff with the number
    of primary electrons over the excess noise, N = R₀ E/(q F).
    """
    slow = replace(
        ECHO,
        pulse=8e-9,
        response=0.3e-9,
        interval=0.5e-9,
        amplifier=1e-15,
        shot=1.0,
        jitter=0.0,
        drift=0.0,
        step=0.0,
    )
    share = 0.25 * math.pi * 0.025**2 * 0.5 * 0.5 / (math.pi * R**2)
    electrons = 0.95 * 0.2e-6 * share / (1.602176634e-19 * 5.5)
    found = echo_budget(slow, R)["shot"]
    # Weights of white noise, ∝ t G(t), under noise ∝ G(t): ∫t²G³/(∫t²G²)² of a Gaussian is (8/3√3) τ².
    wanted = 0.5 * SPEED_OF_LIGHT * 8e-9 * math.sqrt(8.0 / (3.0 * math.sqrt(3.0)) / electrons)
    assert found == pytest.approx(wanted, rel=0.02)


def test_two_ranges_fuse_and_chords_cross_early() -> None:
    """Claim: 1/√(1/9 + 1/16) = 2.4; fine chords cross at σ √(2 ln ratio), coarse ones before."""
    assert fused_sigma(3.0, 4.0) == pytest.approx(2.4)
    for ratio in (2.0, 8.0):
        fine = sampled_crossing(1.0, 0.01, ratio)
        assert fine == pytest.approx(math.sqrt(2.0 * math.log(ratio)), abs=1e-4)
        step, places = 0.8, []
        for phase in (np.arange(64) + 0.5) / 64:
            time = (np.arange(-40, 41) + phase) * step
            pulse = ratio * np.exp(-0.5 * time**2)
            places.append(np.interp(1.0, pulse[: pulse.argmax() + 1], time[: pulse.argmax() + 1]))
        assert sampled_crossing(1.0, step, ratio) == pytest.approx(-np.mean(places), rel=1e-9)


def test_currents_make_shot_noise_as_their_densities_have_it() -> None:
    """Claim: a current I has the density 2 e I beside an amplifier's i², and M² F times that behind the avalanche; the
    Sun's current is responsivity times E ρ/π · Ω A T. Equal densities make equal noise, whatever they come from."""
    noisy = replace(ECHO, shot=1.0, amplifier=6e-11, surface=0.0)
    quiet = replace(noisy, amplifier=0.0, surface=(6e-11) ** 2 / (2.0 * constants.e))
    multiplied = replace(quiet, surface=0.0, bulk=quiet.surface / (noisy.gain**2 * noisy.excess))
    one, other, third = (echo_budget(unit, R) for unit in (noisy, quiet, multiplied))
    assert one["amplifier"] > 0.3 * one["shot"]
    assert other["shot"] == pytest.approx(math.hypot(one["shot"], one["amplifier"]))
    assert third["shot"] == pytest.approx(other["shot"])
    assert other["amplifier"] == 0.0
    lit = echo_budget(replace(noisy, sunlight=300.0), R)
    solid = 0.25 * math.pi * noisy.field**2
    watts = 300.0 * 0.5 / math.pi * solid * 0.25 * math.pi * 0.025**2 * 0.5
    density = 2.0 * constants.e * noisy.gain**2 * noisy.excess * noisy.responsivity * watts
    assert lit["sun"] / lit["amplifier"] == pytest.approx(math.sqrt(density) / 6e-11)
    assert lit["shot"] == one["shot"]


def test_light_of_the_pulse_is_noise_in_proportion_to_itself() -> None:
    """Claim: with all other noise far below, four times the light halves σ."""
    alone = replace(ECHO, shot=1.0, amplifier=1e-16)
    near, far = (echo_budget(alone, distance)["shot"] for distance in (R, 2.0 * R))
    assert far == pytest.approx(2.0 * near, rel=1e-3)


def test_a_clock_jitters_and_drifts() -> None:
    """Claim: c/2 of the jitter, and R of the drift, in squares, whatever the light; all is the root of all squares."""
    for distance in (3.0, 30.0):
        told = echo_budget(ECHO, distance)
        assert told["clock"] == pytest.approx(math.hypot(0.5 * SPEED_OF_LIGHT * 60e-12, distance * 1e-6))
        rest = [value for name, value in told.items() if name != "all"]
        assert told["all"] == pytest.approx(math.sqrt(sum(value**2 for value in rest)))


def test_shot_noise_of_a_clipped_echo_is_that_of_the_light_at_its_edges() -> None:
    """Claim: where the echo passes half of the saturation on its way up and down, its own shot noise is that of the
    light behind a filter of the response's square, q M F times the current's, and both edges halve its variance.

    Expected: crossing and slope of the Gaussian echo by a search and a difference; the light smoothed by h² by a sum
    over the pulse; the dark current's part has its own density, 2 q M² F I behind the same filter.
    """
    noisy = replace(ECHO, shot=1.0, amplifier=0.0, energy=2e-6, bulk=3e-9)
    share = 0.25 * math.pi * 0.025**2 * 0.5 * 0.5 / (math.pi * R**2)
    current = 10.0 * 0.95 * 2e-6 * share
    width = math.hypot(noisy.pulse, noisy.response)

    def echo(time: float) -> float:
        return current * math.exp(-0.5 * (time / width) ** 2) / (math.sqrt(2.0 * math.pi) * width)

    clipped = replace(noisy, saturation=0.3 * echo(0.0))
    edge = brentq(lambda time: echo(time) - 0.15 * echo(0.0), 0.0, 9.0 * width)
    step = 1e-4 * width
    slope = (echo(edge - step) - echo(edge + step)) / (2.0 * step)
    # h² of the unit-area response, at the edge, over the light: both sampled finely.
    time = np.linspace(-12.0, 12.0, 48_001) * width
    light = np.exp(-0.5 * (time / noisy.pulse) ** 2)
    light *= current / 10.0 / np.sum(light)
    response = np.exp(-0.5 * ((edge - time) / noisy.response) ** 2) / (
        math.sqrt(2.0 * math.pi) * noisy.response
    )
    every = constants.e * 10.0**2 * 5.5
    variance = every * float(np.sum(light * response**2))
    fine = np.linspace(-12.0, 12.0, 48_001) * noisy.response
    square = np.exp(-((fine / noisy.response) ** 2)) / (2.0 * math.pi * noisy.response**2)
    variance += every * 3e-9 * float(np.trapezoid(square, fine))
    wanted = 0.5 * SPEED_OF_LIGHT * math.sqrt(0.5 * variance) / slope
    assert echo_budget(clipped, R)["shot"] == pytest.approx(wanted, rel=1e-4)
