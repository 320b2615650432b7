"""The filters of a pulse in noise: Gauss and Markov's by matrices, moments by sums, and false alarms."""

from __future__ import annotations

import math
from dataclasses import replace

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Pulse
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from scanner_sim.detector.photodiode.pulse_response import PulseResponse
from scanner_sim.detector.photodiode.waveform import BLOCK, Waveforms
from scanner_sim.render.device import Device
from scanner_sim.signals.waveform.filter import (
    PHASES,
    MatchedFilter,
    Noise,
    false_alarm_probability,
    threshold_for,
)
from scanner_sim.signals.waveform.fit import TimingFilter, _solve
from scanner_sim.signals.waveform.search import filter_records
from scanner_sim.signals.waveform.settings import PulseDetection

Array = NDArray[np.float64]

WIDTH, SIGMA = 1.3, 0.66
"""Standard deviations of pulse and electronics [sample]."""
TAU = 4.0 / 3.394607797
"""τ of t² e^(−t/τ) that is four samples wide at half its height [sample]."""
COLOURS = {
    "coloured": Noise(2.0, 0.0, 0.3, SIGMA),
    "white": Noise(0.0, 5.0, 0.3, SIGMA),
    "both": Noise(2.0, 5.0, 0.3, SIGMA),
}
RIDGE = 1e-3
"""White noise on top that filters reckon with."""


def bell(time: Array, variance: float) -> Array:
    return np.asarray(np.exp(-0.5 * time**2 / variance))


def skewed_response() -> PulseResponse:
    return PulseResponse.of(Pulse(energy=1e-6, width=4e-9, shape="t2_exponential"), 1e9)


def skewed(time: Array) -> Array:
    """Return t² e^(−t/τ) behind the electronics by a plain convolution, from its centroid and with a peak of 1."""
    after = np.linspace(0.0, 30.0 * TAU, 2001)
    power = after**2 * np.exp(-after / TAU)

    def heard(time: Array) -> Array:
        return np.asarray(bell(time[:, None] + 3.0 * TAU - after, SIGMA**2) @ power)

    return np.asarray(heard(time) / heard(np.linspace(-2.0 * TAU, 0.0, 401)).max())


def covariance(noise: Noise, count: int, ridge: float) -> Array:
    """Return that of samples, e^(−k²/4s²) for what the electronics colour."""
    lag = np.subtract.outer(np.arange(count), np.arange(count))
    white = noise.white + ridge * (noise.coloured + noise.white)
    return np.asarray(noise.coloured * np.exp(-0.25 * (lag / SIGMA) ** 2) + white * (lag == 0))


@pytest.fixture(params=COLOURS)
def noise(request: pytest.FixtureRequest) -> Noise:
    return COLOURS[request.param]


def test_filters_are_gauss_and_markovs(noise: Noise) -> None:
    """Claim: delay and height by the taps are (JᵀC⁻¹J)⁻¹JᵀC⁻¹ x of a pulse and its slope, at all phases; the height is
    that of a pulse whose delay is known. Tolerance: of the slope's difference."""
    made = MatchedFilter.of(PulseResponse(WIDTH**2), noise)
    whole = WIDTH**2 + SIGMA**2
    away = np.arange(-made.half, made.half + 1.0)
    inverse = np.linalg.inv(covariance(noise, away.size, RIDGE))
    for row in (0, 5, PHASES, 2 * PHASES):
        off = away - (row / PHASES - 1.0)
        pulse = bell(off, whole)
        both = np.stack([pulse, off / whole * pulse], axis=1)
        taps = np.linalg.solve(both.T @ inverse @ both, both.T @ inverse)
        np.testing.assert_allclose(made.shift[row], taps[1], atol=1e-6 * np.abs(taps[1]).max())
        alone = inverse @ pulse / (pulse @ inverse @ pulse)
        np.testing.assert_allclose(made.amplitude[row], alone, atol=1e-9)


def test_moments_are_variances_of_sums(noise: Noise) -> None:
    """Claim: wᵀ C w of the colours; of shot noise that of the light in the middle of two samples times their
    correlation, at the pulse's phase; and the searched line's neighbours correlate as its filter makes them."""
    made = MatchedFilter.of(PulseResponse(WIDTH**2), noise)
    away = np.arange(-made.half, made.half + 1.0)
    lag, middle = np.subtract.outer(away, away), 0.5 * np.add.outer(away, away)
    alike = np.exp(-0.25 * (lag / SIGMA) ** 2)
    whole, lit = WIDTH**2 + SIGMA**2, WIDTH**2 + 0.5 * SIGMA**2
    for row in (PHASES, PHASES + 20):
        taps, phase = made.shift[row], row / PHASES - 1.0
        assert made.moments.coloured[row] == pytest.approx(taps @ alike @ taps)
        assert made.moments.white[row] == pytest.approx(np.sum(taps**2))
        # The pulse behind the electronics has the height 1, and both the same area.
        light = math.sqrt(whole / lit) * bell(middle - phase, lit)
        assert made.moments.shot[row] == pytest.approx(taps @ (alike * light) @ taps, rel=1e-5)
    shape = bell(away, whole)
    np.testing.assert_allclose(made.search, shape / np.sum(shape**2), rtol=1e-6)
    # Two neighbouring sums read one sample more than one.
    more = covariance(noise, away.size + 1, 0.0)
    first, second = np.append(made.search, 0.0), np.append(0.0, made.search)
    wanted = first @ more @ second / (first @ more @ first)
    assert made.neighbour == pytest.approx(wanted, rel=1e-9)


def test_without_noise_there_is_a_filter_too() -> None:
    made = MatchedFilter.of(PulseResponse(WIDTH**2), Noise(0.0, 0.0, 0.0, SIGMA))
    assert np.isfinite(made.shift).all()
    assert made.neighbour == 0.0


def test_a_pulse_is_as_wide_as_its_half_height_and_as_long_as_it_is_heard() -> None:
    """Claim: a ten-thousandth of the peak is where e^(−t²/2σ²) says, and two samples more are kept."""
    made = MatchedFilter.of(PulseResponse(WIDTH**2), COLOURS["both"])
    heard = math.hypot(WIDTH, SIGMA) * math.sqrt(2.0 * math.log(1e4))
    assert made.half == math.ceil(heard) + 2


@pytest.mark.parametrize("reversed_", [False, True])
def test_a_lopsided_pulse_is_held_as_far_as_its_longer_flank(reversed_: bool) -> None:
    """Claim: a filter reaches to either side as far as t² e^(−t/τ) is heard behind its centroid, to a ten-thousandth of
    its peak, and two samples more; as far of a pulse that rises as slowly as this one falls."""
    response = skewed_response()
    if reversed_:
        assert response.times is not None
        assert response.powers is not None
        (first, last), times, powers = response.ends, response.times, response.powers
        response = replace(response, ends=(-last, -first), times=-times[::-1], powers=powers[::-1])
    made = MatchedFilter.of(response, COLOURS["both"])
    time = np.linspace(-10.0 * TAU, 20.0 * TAU, 1001)
    heard = time[skewed(time) > 1e-4]
    assert heard[-1] > -2.0 * heard[0]
    assert made.half == math.ceil(heard[-1]) + 2


def test_the_filter_of_a_skewed_pulse_is_gauss_and_markovs() -> None:
    """Claim: the same of t² e^(−t/τ), whose height and delay go together; its shape by a plain convolution."""
    made = MatchedFilter.of(skewed_response(), COLOURS["both"])
    away = np.arange(-made.half, made.half + 1.0)
    inverse = np.linalg.inv(covariance(COLOURS["both"], away.size, RIDGE))
    for row in (0, PHASES + 9):
        off = away - (row / PHASES - 1.0)
        pulse, slope = skewed(off), (skewed(off - 1e-3) - skewed(off + 1e-3)) / 2e-3
        both = np.stack([pulse, slope], axis=1)
        taps = np.linalg.solve(both.T @ inverse @ both, both.T @ inverse)
        np.testing.assert_allclose(made.shift[row], taps[1], atol=2e-3 * np.abs(taps[1]).max())


@pytest.mark.parametrize("neighbour", [0.0, 0.6, 0.95])
@pytest.mark.parametrize("samples", [2, 40])
def test_a_threshold_keeps_the_rate_of_false_alarms(neighbour: float, samples: int) -> None:
    """Claim: 1 − exp(−Q(T) − (n − 1) P(y₀ ≤ T < y₁)) with P by the bivariate normal distribution; and its inverse."""
    threshold = 2.4
    pair = multivariate_normal([0.0, 0.0], [[1.0, neighbour], [neighbour, 1.0]])
    # P(y₀ ≤ T) less P(both ≤ T).
    rising = norm.cdf(threshold) - pair.cdf(np.array([threshold, threshold]))
    wanted = -math.expm1(-norm.sf(threshold) - (samples - 1) * rising)
    assert false_alarm_probability(threshold, samples, neighbour) == pytest.approx(wanted, rel=1e-4)
    assert threshold_for(wanted, samples, neighbour) == pytest.approx(threshold, abs=1e-4)


@pytest.mark.parametrize("neighbour", [0.0, 0.9, 0.9999, 1.0 + 1e-15])
@pytest.mark.parametrize("samples", [4, 1 << 16])
@pytest.mark.parametrize("false_alarms", [1e-12, 0.5])
def test_every_rate_of_false_alarms_that_may_be_set_has_a_threshold(
    neighbour: float, samples: int, false_alarms: float
) -> None:
    """Claim: the smallest and the largest, in the shortest and the longest record, are kept, with P(y₀ ≤ T < y₁) by
    integration over y₁; it is 0 where neighbours are alike, or more by rounding."""
    settings = PulseDetection(false_alarms=false_alarms)
    threshold = threshold_for(settings.false_alarms, samples, neighbour)
    width = math.sqrt(max(1.0 - neighbour**2, 0.0))

    def below(y: float) -> float:
        return float(norm.pdf(y) * norm.cdf((threshold - neighbour * y) / width))

    ends = threshold, threshold + 12.0
    near = [threshold + width * step for step in (1.0, 5.0, 20.0)]
    rising = quad(below, *ends, points=near, epsabs=0.0, epsrel=1e-9, limit=200)[0] if width > 0.0 else 0.0
    kept = -math.expm1(-norm.sf(threshold) - (samples - 1) * rising)
    assert kept == pytest.approx(false_alarms, rel=1e-6)


@pytest.mark.usefixtures("device")
def test_three_equations_are_solved() -> None:
    """Claim: Cramer's rule is NumPy's solution of symmetric systems, of either sign of every term."""
    rng = np.random.default_rng(2)
    matrices = rng.normal(size=(50, 3, 3))
    matrices = matrices + np.swapaxes(matrices, 1, 2) + 6.0 * np.sign(rng.normal(size=(50, 1, 1))) * np.eye(3)
    right = rng.normal(size=(50, 3))
    sums = [matrices[:, i, j] for i in range(3) for j in range(i, 3)] + list(right.T)
    found = _solve([auto.Float(one.astype(np.float32)) for one in sums])
    wanted = np.linalg.solve(matrices, right[..., None])[..., 0]
    sharp = np.linalg.cond(matrices) < 50.0
    assert sharp.sum() > 40
    for axis in range(3):
        np.testing.assert_allclose(found[axis].numpy()[sharp], wanted[sharp, axis], atol=1e-4)


def test_records_are_filtered_up_to_their_ends() -> None:
    """Claim: each sample is the sum of the taps times the samples about it, and beyond the ends there is nothing."""
    rng, samples = np.random.default_rng(5), 24
    rows = rng.normal(size=(BLOCK, samples)).astype(np.float32)
    packed = rows.reshape(-1, BLOCK, samples // 4, 4).transpose(0, 2, 1, 3).ravel()
    made = Waveforms(auto.Float(packed), BLOCK, samples, dr.zeros(auto.Float, BLOCK))
    for count in (3, 7, 11):
        taps = rng.normal(size=count)
        line = filter_records(made, taps).numpy().reshape(samples // 4, BLOCK, 4)
        found = line.transpose(1, 0, 2).reshape(BLOCK, samples)
        wanted = np.stack([np.correlate(row, taps, "same") for row in rows.astype(np.float64)])
        np.testing.assert_allclose(found, wanted, atol=1e-5)


def test_a_pulse_is_fitted_at_its_own_phase(device: Device) -> None:
    """Claim: shift and height of pulses without noise, to 1e-4, by the row of the table nearest to the shift."""
    made = MatchedFilter.of(PulseResponse(WIDTH**2), COLOURS["both"])
    away = np.arange(-made.half, made.half + 1.0)
    shift = np.array([-0.98, -0.55, -0.2, 0.0, 0.31, 0.77, 0.98])
    pulses = 3.0 * bell(away - shift[:, None], WIDTH**2 + SIGMA**2)
    samples = [auto.Float(column.astype(np.float32)) for column in pulses.T]
    found = TimingFilter.of(made).fit(samples, auto.Float((0.9 * shift).astype(np.float32)))
    np.testing.assert_allclose(found.shift.numpy(), shift, atol=1e-4)
    np.testing.assert_allclose(found.amplitude.numpy(), 3.0, rtol=1e-4)
    np.testing.assert_array_equal(found.phase.numpy(), np.rint((shift + 1.0) * PHASES))
