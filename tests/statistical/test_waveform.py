"""Waveforms against closed forms: noise, its colour, saturation, converter, clock.

Levels: a right program fails a test of this file for fewer than one in 10⁴ seeds; seeds are fixed.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from prototype import Digitiser, Photodiode, Pulse

from scanner_sim.analytic import time_of_flight as judge
from scanner_sim.detector.photodiode.photodiode import PhotodiodeNoise
from scanner_sim.detector.photodiode.waveform import Waveforms, noise_sigma, record
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.render.beam.light import Light

pytestmark = pytest.mark.usefixtures("device")

ANALOGUE = PhotodiodeNoise(saturation=False, quantisation=False, clock=False)


def echoes(m: int, share: float, sample: float, digitiser: Digitiser, numbers: Any = None) -> Light:
    """Return one echo for each of m shots, at a sample of the record."""
    number = dr.arange(auto.UInt32, m) if numbers is None else auto.UInt32(numbers)
    path = SPEED_OF_LIGHT * (sample / digitiser.rate + digitiser.start)
    coarse = np.floor(path * 64.0) / 64.0
    return Light(
        dr.arange(auto.UInt32, m),
        number,
        dr.full(auto.Float, share, m),
        dr.full(auto.Float, path - coarse, m),
        dr.zeros(auto.Float, m),
        reference=dr.full(auto.Float, coarse, m),
    )


def recorded(
    m: int,
    share: float,
    sample: float,
    pulse: Pulse,
    diode: Photodiode,
    digitiser: Digitiser,
    **more: Any,
) -> Waveforms:
    sent = echoes(m, share, sample, digitiser, more.pop("numbers", None))
    return record(sent, sent.shot, pulse, diode, digitiser, more.pop("seed", 1), **more)


GRID = [
    (gain, background, bandwidth)
    for gain in (1.0, 10.0, 50.0)
    for background in (0.0, 1.4e-8, 1e-6)
    for bandwidth in (0.1e9, 0.4e9, 1e9)
]


@pytest.mark.parametrize(("gain", "background", "bandwidth"), GRID)
def test_the_receivers_snr_is_the_closed_form(gain: float, background: float, bandwidth: float) -> None:
    """Claim: the signal over the scatter of a sample is M R₀ P_s/√(2q M² F […] B + 2q I_ds B + i² B).

    Set-up: a pulse of 400 ns, steady at its middle, of 1 µW at the diode; gain 1 to 50; background from none over a
    white wall in full Sun behind the 30 nm filter (14 nW into 5 mrad) to seventy times that; B 0.1 to 1 GHz; 30 000
    records of three samples far apart. Expected: the judge's. Tolerance: 2 %; the standard error of a
    scatter from 90 000 numbers is 0.24 %.
    """
    diode = Photodiode(gain=gain, bandwidth=bandwidth, noise=ANALOGUE)
    digitiser = Digitiser(gate=(60.0, 66.0), rate=1e9)
    pulse = Pulse(width=400e-9, peak_power=1.0)
    middle = digitiser.samples // 2
    got = recorded(30_000, 1e-6, middle, pulse, diode, digitiser, background=background).records()
    some = got[:, [middle - 12, middle, middle + 12]] * digitiser.step(diode.saturation)
    parts = {"gain": gain, "responsivity": 0.95, "k": 0.45, "bulk": 0.5e-9, "surface": 5e-9}
    expected = judge.receiver_snr(1e-6, background, amplifier=2e-12, bandwidth=bandwidth, **parts)
    signal = some.mean(axis=0)
    assert signal[1] == pytest.approx(gain * 0.95 * 1e-6, rel=5e-3)
    scatter = np.sqrt(np.mean(some.var(axis=0)))
    assert signal[1] / scatter == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(("bandwidth", "rate"), [(200e6, 1e9), (100e6, 2e9), (1e9, 1e9)])
def test_noise_is_coloured_by_the_electronics(bandwidth: float, rate: float) -> None:
    """Claim: samples k apart correlate as e^(−(k Δt)²/4σ_h²).

    Set-up: 20 000 dark records without converter. Expected: the autocorrelation of white noise behind a Gaussian of
    the stated bandwidth, at lags of 0 to 8; the scatter of the diode's own formula. Tolerance: 0.006 in correlation,
    above five standard errors (0.001 from a million or more independent samples); 1 % in scatter.
    """
    diode = Photodiode(bandwidth=bandwidth, noise=ANALOGUE)
    digitiser = Digitiser(gate=(0.0, 20.0), rate=rate)
    got = recorded(20_000, 0.0, 50.0, Pulse(), diode, digitiser).records().astype(np.float64)
    variance = np.mean(got**2)
    assert np.sqrt(variance) * digitiser.step(diode.saturation) == pytest.approx(
        np.sqrt(diode.dark_variance), rel=0.01
    )
    sigma = np.sqrt(np.log(2.0)) / (2.0 * np.pi * bandwidth) * rate
    for lag in range(9):
        here = np.mean(got[:, : got.shape[1] - lag] * got[:, lag:]) / variance
        assert here == pytest.approx(np.exp(-0.25 * (lag / sigma) ** 2), abs=0.006)


def test_shot_noise_follows_the_pulse_through_the_electronics() -> None:
    """Claim: the noise's variance over a short pulse is q M² F R₀ ∫ P(s) h²(t − s) ds, and its covariance alike.

    Set-up: 100 000 records of one 2 ns pulse with shot noise alone, B 200 MHz. Expected: covariance of samples i, j
    = q M² F R₀ ∫ P(s) h(t_i − s) h(t_j − s) ds, by quadrature, from 3 samples before the peak to 3 behind. Tolerance:
    3 % of the largest for the light that is sampled before the electronics (2.6 % at most, mean of eight seeds), and
    4.8 standard errors from the records' own fourth moments: level 10⁻⁴ for 49 numbers.
    """
    diode = Photodiode(
        bulk_dark_current=0.0,
        surface_dark_current=0.0,
        noise=PhotodiodeNoise(amplifier=False, saturation=False, quantisation=False, clock=False),
    )
    digitiser, pulse = Digitiser(gate=(0.0, 10.0)), Pulse(peak_power=1.0)
    got = recorded(100_000, 1e-5, 40.3, pulse, diode, digitiser).records().astype(np.float64)
    got *= digitiser.step(diode.saturation)
    window = np.arange(37, 44)
    found = np.cov(got[:, window].T)
    away = got[:, window] - got[:, window].mean(axis=0)
    fourth = np.einsum("ni,nj->ij", away**2, away**2) / len(away)
    error = np.sqrt((fourth - found**2) / len(away))
    sigma_h = np.sqrt(np.log(2.0)) / (2.0 * np.pi * 200e6)
    s = np.linspace(-8e-9, 8e-9, 4001)
    light = 1e-5 * np.exp(-0.5 * (s / (2e-9 / 2.35482)) ** 2)
    t = (window - 40.3) * 1e-9
    h = np.exp(-0.5 * ((t[:, None] - s) / sigma_h) ** 2) / (np.sqrt(2.0 * np.pi) * sigma_h)
    density = 1.602176634e-19 * 10.0**2 * judge.excess_noise(10.0, 0.45) * 0.95
    expected = density * np.trapezoid(h[:, None] * h[None] * light, s, axis=2)
    assert (np.abs(found - expected) < 0.03 * expected.max() + 4.8 * error).all()


def test_a_number_depends_on_its_address_alone() -> None:
    """Claim: shots give the same records in any order and company, and another seed gives others.

    Set-up: all terms on; shots 0–199 together, then 70, 3 and 199. Expected: equal, bit for bit.
    """
    digitiser, diode, pulse = Digitiser(), Photodiode(), Pulse()
    whole = recorded(200, 1e-7, 90.2, pulse, diode, digitiser).records()
    some = np.array([70, 3, 199], np.uint32)
    few = recorded(3, 1e-7, 90.2, pulse, diode, digitiser, numbers=some).records()
    np.testing.assert_array_equal(whole[some], few)
    other = recorded(200, 1e-7, 90.2, pulse, diode, digitiser, seed=2).records()
    assert (whole != other).mean() > 0.5


def test_the_converter_counts_in_whole_numbers_between_its_ends() -> None:
    """Claim: numbers are whole and end at the saturation, and rounding adds step²/12.

    Set-up: dark records with 8 bits and noise of 2.3 steps, whose negative side the converter's range just holds;
    then a strong pulse with 14 bits. Expected: whole numbers; the scatter of :func:`noise_sigma`; the largest number is
    the saturation to a step. Tolerance: 1 % of the scatter, above five standard errors.
    """
    digitiser = Digitiser(bits=8)
    diode = Photodiode(saturation=2e-5)
    dark = recorded(2000, 0.0, 50.0, Pulse(), diode, digitiser, background=1e-6).records()
    assert (dark == np.rint(dark)).all()
    step = digitiser.step(2e-5)
    assert dark.std() * step == pytest.approx(noise_sigma(diode, digitiser, 1e-6), rel=0.01)
    strong = recorded(10, 1e-3, 90.0, Pulse(), Photodiode(), Digitiser()).records()
    assert strong.max() == np.rint(0.5e-3 / Digitiser().step(0.5e-3))


def test_the_clock_jitters_drifts_and_folds() -> None:
    """Claim: jitter moves each shot's whole record, drift stretches the time, and the period is folded.

    Set-up: noise-free pulses at 60 ns: centroids of 20 000 records with 50 ps of jitter; with 100 ppm of drift; and
    from one pulse period later. Expected: scatter 50 ps; a shift of 100 ppm of the delay; the same place. Tolerance:
    2.5 % (five standard errors), 1 %, and 1e-3 samples, single precision after the folding.
    """
    quiet = PhotodiodeNoise(shot=False, amplifier=False, saturation=False, quantisation=False)
    diode, pulse = Photodiode(noise=quiet), Pulse()

    def centroid(digitiser: Digitiser, m: int, sample: float) -> np.ndarray:
        got = recorded(m, 1e-7, sample, pulse, diode, digitiser).records().astype(np.float64)
        return np.asarray((got * np.arange(got.shape[1])).sum(axis=1) / got.sum(axis=1))

    assert np.std(centroid(Digitiser(jitter=50e-12), 20_000, 70.0)) == pytest.approx(0.05, rel=0.025)
    still = Digitiser(jitter=0.0)
    delay = 70.0 + still.start * still.rate
    drifting = centroid(Digitiser(jitter=0.0, drift=1e-4), 1, 70.0) - centroid(still, 1, 70.0)
    assert drifting[0] == pytest.approx(1e-4 * delay, rel=0.01)
    period = still.rate / pulse.repetition_rate
    assert centroid(still, 1, 70.0 + period)[0] == pytest.approx(70.0, abs=1e-3)
