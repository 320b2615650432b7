"""What of a record is an echo, and what is told of clipped and broken ones."""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Digitiser, Photodiode, Pulse

from scanner_sim.detector.photodiode.photodiode import PhotodiodeNoise
from scanner_sim.detector.photodiode.waveform import BLOCK, Waveforms
from scanner_sim.foundation.status import Status
from scanner_sim.signals.waveform.detection import PulseDetector
from scanner_sim.signals.waveform.edges import cross, edge_table
from scanner_sim.signals.waveform.search import find_echoes
from scanner_sim.signals.waveform.settings import PulseDetection

Array = NDArray[np.float64]
CLOCK = Digitiser(rate=1e9, gate=(0.0, 30.0))
WHOLE = Photodiode(noise=PhotodiodeNoise(clock=False))

pytestmark = pytest.mark.usefixtures("device")


def records(lines: Array, background: float = 0.0) -> Waveforms:
    """Return records (m, samples) of digital numbers as the device holds them."""
    rows = np.zeros((-(-len(lines) // BLOCK) * BLOCK, lines.shape[1]), dtype=np.float32)
    rows[: len(lines)] = lines
    packed = rows.reshape(-1, BLOCK, lines.shape[1] // 4, 4).transpose(0, 2, 1, 3).ravel()
    light = dr.full(auto.Float, background, len(lines))
    return Waveforms(auto.Float(packed), len(lines), lines.shape[1], light)


def numbers(value: Any) -> Array:
    return np.asarray(value.numpy(), dtype=np.float64).ravel()


def way(*turns: float) -> Array:
    """Return a line of 64 samples that goes straight from turn to turn, five samples each, then stays."""
    line = np.interp(np.arange(64.0), 5.0 * np.arange(len(turns)), turns)
    return np.asarray(line)


WAYS = [
    # Turns, threshold, and the heights and samples of the echoes.
    ((0, 100, 85, 96, 0), 10.0, [(100, 5), (96, 15)]),
    ((0, 100, 91, 99, 0), 10.0, [(100, 5)]),
    ((0, 300, 275, 290, 0), 10.0, [(300, 5)]),
    ((0, 300, 275, 310, 0), 10.0, [(310, 15)]),
    ((0, 300, 265, 290, 0), 10.0, [(300, 5)]),
    ((0, 300, 265, 293, 0), 10.0, [(300, 5), (293, 15)]),
    ((0, 300, 265, 293, 0), 40.0, [(300, 5)]),
    ((0, 9, 0), 10.0, []),
    ((0, 9, 0), 8.0, [(9, 5)]),
    ((0, 20, 0, 300, 0, 40, 0), 10.0, [(20, 5), (300, 15), (40, 25)]),
    ((0, 20, 0, 300, 0, 40, 0), 30.0, [(300, 15), (40, 25)]),
    ((0, -50, 12, -50, 60, 0), 10.0, [(12, 10), (60, 20)]),
]


@pytest.mark.parametrize("wanted", ["first", "last", "strongest"])
def test_an_echo_stands_above_its_valleys(wanted: Any) -> None:
    """Claim: a peak above the threshold is one where the line falls behind it, and rises before it from the valley, by
    the threshold or a tenth of the height there, whichever is more; each record by its own threshold."""
    lines = np.stack([way(*turns) for turns, *_ in WAYS])
    made = records(lines)
    threshold = auto.Float([one for _, one, _ in WAYS])
    found = find_echoes(made, made.number, threshold, 1, wanted)
    assert numbers(found.count).tolist() == [len(echoes) for *_, echoes in WAYS]
    choose = {"first": lambda them: them[0], "last": lambda them: them[-1], "strongest": max}[wanted]
    for row, (*_, echoes) in enumerate(WAYS):
        if echoes:
            height, sample = choose(echoes)
            assert (numbers(found.height)[row], numbers(found.sample)[row]) == (height, sample)


def test_the_ends_of_a_record_hold_no_echo() -> None:
    """Claim: of 64 samples the first four and the last four are left out; what stands high at their edge ends there."""
    lines = np.zeros((4, 64))
    for row, at in enumerate((3, 4, 59, 60)):
        lines[row, at] = 50.0
    made = records(lines)
    found = find_echoes(made, made.number, auto.Float([10.0] * 4), 4, "first")
    assert numbers(found.count).tolist() == [0.0, 1.0, 1.0, 0.0]
    assert numbers(found.sample)[1:3].tolist() == [4.0, 59.0]
    open_end = records(way(0, 30)[None])
    assert numbers(find_echoes(open_end, open_end.number, auto.Float([10.0]), 0, "first").count)[0] == 1.0


def hump(middle: float, height: float) -> Array:
    """Return a Gaussian pulse in a record, as wide as one of the detector's."""
    sigma = math.hypot(2e-9 / 2.3548200450309493, WHOLE.response_sigma) * CLOCK.rate
    return np.asarray(height * np.exp(-0.5 * ((np.arange(CLOCK.samples) - middle) / sigma) ** 2))


@pytest.mark.parametrize("light", [0.0, 2.0])
def test_a_clipped_echo_is_as_high_as_it_is_long(light: float) -> None:
    """Claim: of pulses of half the saturation, of 1.2 times it, of five times on a step that hides where it rises, and
    of 0.8 times on such a step, the second is as high as it was before it was clipped, to 3 % (chords), and the third,
    SATURATED, as the saturation; the last is no pulse. Over the noise of a sample, of dark, of light of twice its
    variance, and of steps, each is as told."""
    background = light * WHOLE.dark_variance / WHOLE.light_variance
    detector = PulseDetector(Pulse(), WHOLE, CLOCK, PulseDetection(timing="leading_edge"))
    full, before = detector.full, np.arange(CLOCK.samples)
    lines = np.stack([
        hump(60.3, 0.5 * full),
        hump(70.6, 1.2 * full),
        np.maximum(hump(80.2, 5.0 * full), 0.6 * full * (before < 81)),
        np.maximum(hump(90.4, 0.8 * full), 0.3 * full * (before < 91)),
    ])  # fmt: skip
    lines = np.floor(np.minimum(lines, full))
    found = detector.detect(records(lines, background))
    assert numbers(found.status).tolist() == [
        Status.VALID, Status.VALID, Status.SATURATED, Status.BAD_SHAPE,
    ]  # fmt: skip
    step = CLOCK.step(WHOLE.saturation)
    signal = numbers(found.signal)
    np.testing.assert_allclose(signal, np.array([0.5, 1.2, 1.0, 0.8]) * full * step, rtol=0.03)
    sigma = numbers(found.sigma_signal)
    assert signal[2] == pytest.approx(full * step, rel=1e-6) == sigma[2]
    assert (sigma[[0, 1]] < 0.02 * signal[[0, 1]]).all()
    noise = math.sqrt((1.0 + light) * WHOLE.dark_variance + step**2 / 12.0)
    np.testing.assert_allclose(numbers(found.snr), signal / noise, rtol=1e-4)
    assert WHOLE.dark_variance < 10.0 * step**2


@pytest.mark.parametrize("timing", ["matched_filter", "leading_edge"])
def test_another_noise_is_stated_of_the_same_echo(timing: Any) -> None:
    """Claim: a detector that states the σ of a photodiode without an amplifier's noise finds the same echo at the same
    delay, though a fainter one before it would pass the threshold of less noise; σ of delay and height are smaller."""
    quiet = WHOLE.model_copy(update={"noise": PhotodiodeNoise(clock=False, amplifier=False)})
    settings = PulseDetection(timing=timing, echo="first")
    detector, fresh = (PulseDetector(Pulse(), diode, CLOCK, settings) for diode in (WHOLE, quiet))
    bounds = [
        float(numbers(one._threshold(auto.Float([one.noise.coloured])))[0]) for one in (detector, fresh)
    ]
    assert bounds[1] < 0.7 * bounds[0]
    faint = 0.5 * sum(bounds)
    made = records((hump(40.3, faint) + hump(90.4, 0.02 * detector.full))[None])
    whole, stated, other = (one.detect(made) for one in (detector, detector.stating(quiet), fresh))
    assert numbers(other.sample)[0] < 60.0
    for name in ("sample", "fraction", "signal", "echoes", "status"):
        np.testing.assert_array_equal(numbers(getattr(stated, name)), numbers(getattr(whole, name)))
    for name in ("sigma", "sigma_signal"):
        assert (numbers(getattr(stated, name)) < 0.99 * numbers(getattr(whole, name))).all()


def test_a_crossing_tells_how_high_the_pulse_is() -> None:
    """Claim: of Gaussian pulses of A times the level the table tells A by the width at the level, to 3 %: chords."""
    level, ratios = 100.0, np.array([1.7, 6.0, 40.0, 300.0])
    silent = Photodiode(noise=PhotodiodeNoise(**dict.fromkeys(PhotodiodeNoise.model_fields, False)))
    lines = np.stack([hump(70.0 + 0.23 * row, ratio * level) for row, ratio in enumerate(ratios)])
    made = records(lines)
    peak = auto.UInt32(lines.argmax(axis=1).astype(np.uint32))
    edges = cross(made, peak, auto.Float([level] * 4), auto.Bool([True] * 4))
    found = edge_table(Pulse(), silent, CLOCK, level).correction(edges)
    np.testing.assert_allclose(np.exp(numbers(found.log_height.value)), ratios, rtol=0.03)
