"""Records of pulses by what they keep: charge, centroid, the next pulse's place, and where their noise comes from.

Levels: a right program fails a test of this file for fewer than one in 10⁴ seeds; seeds are fixed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from claims import mean
from numpy.typing import NDArray
from prototype import Digitiser, Photodiode, Pulse
from scipy.special import erf

from scanner_sim.detector.photodiode.noise_colour import colouring_taps, shot_covariance
from scanner_sim.detector.photodiode.photodiode import PhotodiodeNoise
from scanner_sim.detector.photodiode.waveform import record

pytestmark = pytest.mark.usefixtures("device")

Array = NDArray[np.float64]
C = 299_792_458.0
CLOCK = Digitiser(rate=1e9, jitter=0.0, drift=0.0, gate=(0.0, 30.0))
SILENT = dict.fromkeys(PhotodiodeNoise.model_fields, False)


@dataclass
class Echoes:
    """Echoes of shots as a receiver hands them on."""

    amount: Any
    position: Any
    sigma: Any
    reference: Any


def diode(*switches: str, **more: Any) -> Photodiode:
    return Photodiode(noise=PhotodiodeNoise(**{**SILENT, **dict.fromkeys(switches, True)}), **more)


def recorded(
    share: Array, sample: Array, known: Any, pulse: Any, spread: float = 0.0, background: float = 0.0
) -> Array:
    """Return the currents [A] of echoes with shares of the pulse at places in the record, one each shot."""
    path = C * (sample / CLOCK.rate + CLOCK.start)
    coarse = np.floor(path)
    echoes = Echoes(
        auto.Float(share.astype(np.float32)),
        auto.Float((path - coarse).astype(np.float32)),
        dr.full(auto.Float, spread * C / CLOCK.rate, share.size),
        auto.Float(coarse.astype(np.float32)),
    )
    found = record(echoes, dr.arange(auto.UInt32, share.size), pulse, known, CLOCK, 5, background=background)
    return np.asarray(found.records().astype(np.float64)) * CLOCK.step(known.saturation)


@pytest.mark.parametrize("spread", [0.0, 2.0])
@pytest.mark.parametrize("shape", ["gaussian", "t2_exponential"])
def test_a_record_keeps_charge_centroid_and_width(shape: str, spread: float) -> None:
    """Claim: the sum of the samples is energy · share · R₀ M · rate, their centroid the delay, and their variance that
    of pulse, electronics and surface together: 1e-3 of the sum over samples."""
    pulse, known = Pulse(shape=shape), diode()
    where, share = np.array([80.0, 100.37, 141.81]), np.array([1e-6, 2e-6, 5e-7])
    current = recorded(share, where, known, pulse, spread)
    charge = share * pulse.pulse_energy * CLOCK.rate * known.amperes_per_watt
    np.testing.assert_allclose(current.sum(axis=1), charge, rtol=2e-3)
    time = np.arange(current.shape[1])
    middle = current @ time / current.sum(axis=1)
    np.testing.assert_allclose(middle, where, atol=5e-3)
    width = ((time - middle[:, None]) ** 2 * current).sum(axis=1) / current.sum(axis=1)
    wanted = (pulse.sigma**2 + known.response_sigma**2) * CLOCK.rate**2 + spread**2
    np.testing.assert_allclose(width, wanted, rtol=2e-2)


def test_an_echo_of_the_pulse_before_comes_at_its_own_time() -> None:
    """Claim: a path that is longer by one period of the pulses gives the same record."""
    pulse, known = Pulse(repetition_rate=2e5), diode()
    period = CLOCK.rate / pulse.repetition_rate
    near, far = (
        recorded(np.array([1e-6]), np.array([90.25 + more]), known, pulse)[0] for more in (0.0, period)
    )
    np.testing.assert_allclose(far, near, atol=2e-3 * near.max())


@pytest.mark.parametrize("gate", [(0.0, 130.0), (90.0, 110.0), (140.0, 160.0), (430.0, 460.0)])
def test_a_record_has_the_echoes_of_all_pulses_that_come_in_it(gate: tuple[float, float]) -> None:
    """Claim: below, across and beyond the ambiguity range the record has the echo of whichever pulse of an even train
    comes in it: of 299 surfaces the centroids are those of the sum over all pulses."""
    clock, pulse, known = CLOCK.model_copy(update={"gate": gate}), Pulse(repetition_rate=1e6), diode()
    distance = np.arange(1.0, 300.0)
    echoes = Echoes(
        dr.full(auto.Float, 1e-6, distance.size),
        dr.zeros(auto.Float, distance.size),
        dr.zeros(auto.Float, distance.size),
        auto.Float((2.0 * distance).astype(np.float32)),
    )
    records = record(echoes, dr.arange(auto.UInt32, distance.size), pulse, known, clock, 5).records()
    begins, samples = 2.0 * gate[0] / C - 12e-9, records.shape[1]
    place = (2.0 * distance[:, None] / C + np.arange(-9, 9) * 1e-6 - begins) * 1e9
    whole, out = (place > 8.0) & (place < samples - 9.0), (place < -8.0) | (place > samples + 7.0)
    seen, unseen = whole.any(axis=1), out.all(axis=1)
    assert seen.sum() > 20
    assert unseen.sum() > 20
    assert not records[unseen].any()
    middle = records[seen] @ np.arange(samples) / records[seen].sum(axis=1)
    np.testing.assert_allclose(middle, place[whole], atol=5e-3)


@pytest.mark.parametrize("shape", ["gaussian", "t2_exponential"])
def test_each_shot_has_the_sum_of_its_own_echoes(shape: str) -> None:
    """Claim: of 83 shots with three echoes each, of other places, widths and shares, one of them without light, every
    record is the sum of those of single echoes: 1e-5 of the highest sample, of single precision."""
    pulse, known, shots = Pulse(shape=shape), diode(), 83
    number = np.arange(3 * shots)
    coarse = 12.0 + 0.05 * np.arange(shots)
    share = np.where(number == 40, 0.0, 1e-6 * (1.0 + 0.01 * number))
    away, spread = 0.7 + 3.1 * (number // shots) + 0.011 * (number % 7), 0.02 * (1.0 + number % 5)

    def current(which: slice, shot: slice) -> Array:
        parts = (auto.Float(one[which].astype(np.float32)) for one in (share, away, spread))
        echoes = Echoes(*parts, auto.Float(coarse[shot].astype(np.float32)))
        found = record(echoes, dr.arange(auto.UInt32, coarse[shot].size), pulse, known, CLOCK, 5)
        return np.asarray(found.records().astype(np.float64))

    every = slice(None)
    alone = sum(current(slice(first, first + shots), every) for first in (0, shots, 2 * shots))
    np.testing.assert_allclose(current(every, every), alone, atol=1e-5 * np.max(alone))
    assert np.max(alone, axis=1).min() > 0.3 * np.max(alone)


def test_noise_without_light_has_the_variance_and_colour_of_the_diode() -> None:
    """Claim: the mean of x_t x_{t+k} is (dark + per light · background) e^(−k²/4s²), k = 0, 1, 3: over 1500 records of
    228 samples."""
    known, background = diode("shot", "amplifier"), 2e-7
    noise = recorded(np.zeros(1500), np.full(1500, 100.0), known, Pulse(), background=background)
    variance = known.dark_variance + known.light_variance * background
    sigma = known.response_sigma * CLOCK.rate
    for lag in (0, 1, 3):
        both = (noise[:, : noise.shape[1] - lag] * noise[:, lag:]).mean(axis=1) / variance
        assert mean(both, float(np.exp(-0.25 * (lag / sigma) ** 2)))
    assert mean(noise.mean(axis=1) / np.sqrt(variance))


def test_shot_noise_is_that_of_the_light_and_lies_where_it_is() -> None:
    """Claim: the sum of a record's noise squared is on average per light times the light of all samples, and its
    centroid the pulse's: over 3000 records of one pulse."""
    pulse, known = Pulse(shape="gaussian"), diode("shot", bulk_dark_current=0.0, surface_dark_current=0.0)
    n, share, where = 3000, 3e-6, 110.4
    still = recorded(np.array([share]), np.array([where]), diode(), pulse)[0]
    noise = recorded(np.full(n, share), np.full(n, where), known, pulse) - still
    light = share * pulse.pulse_energy * CLOCK.rate
    squares = noise**2 / (known.light_variance * light)
    assert mean(squares.sum(axis=1), 1.0)
    away = np.arange(noise.shape[1]) - where
    assert mean(squares @ away, 0.0)


@pytest.mark.parametrize("lag", [0, 1, 2])
def test_shared_shot_noise_is_the_sum_over_white_noise(lag: int) -> None:
    """Claim: cov(x_t, x_{t+k}) = Σ_j c_{t−j} c_{t+k−j} L(j), with the taps c about each sample, by loops."""
    sigma = 0.66
    taps = colouring_taps(sigma)
    half = taps.size // 2

    def light(time: Array) -> Array:
        return np.asarray(1.0 + erf(0.3 * time))

    for first in (-2, 0, 3):
        wanted = 0.0
        for source in range(first - 2 * taps.size, first + 2 * taps.size):
            one, other = first - source + half, first + lag - source + half
            if 0 <= one < taps.size and 0 <= other < taps.size:
                wanted += taps[one] * taps[other] * float(light(np.array(float(source))))
        middle = np.array([first + 0.5 * lag])
        assert shot_covariance(lag, middle, sigma, light)[0] == pytest.approx(wanted, rel=1e-9)
