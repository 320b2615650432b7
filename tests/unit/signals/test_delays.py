"""Delays of pulses without noise, by every timing, at every phase of a sample and up to the ends of the record."""

from __future__ import annotations

from typing import Any

import drjit.auto.ad as auto
import numpy as np
import pytest
from numpy.typing import NDArray
from prototype import Digitiser, Photodiode, Pulse

from scanner_sim.detector.photodiode.photodiode import PhotodiodeNoise
from scanner_sim.foundation.status import Status
from scanner_sim.signals.waveform.calibration import peak_of, send
from scanner_sim.signals.waveform.detection import PulseDetector
from scanner_sim.signals.waveform.settings import TIMINGS, PulseDetection

pytestmark = pytest.mark.usefixtures("device")

Array = NDArray[np.float64]
SILENT = dict.fromkeys(PhotodiodeNoise.model_fields, False)
CLOCK = Digitiser(rate=1e9, jitter=0.0, gate=(0.0, 30.0))


def diode(*switches: str) -> Photodiode:
    return Photodiode(noise=PhotodiodeNoise(**{**SILENT, **dict.fromkeys(switches, True)}))


def timed(where: Array, timing: str, share: float, pulse: Any, *more: str) -> tuple[Any, Array]:
    """Return the delays of pulses of a share of the saturation at places in the record, and those places [sample].

    The detector reckons with amplifier and quantisation; the record has neither, but ``more``.
    """
    known = diode("amplifier", "quantisation", *more)
    peak = peak_of(pulse, known, CLOCK) * pulse.pulse_energy * CLOCK.rate * known.amperes_per_watt
    light = np.full(where.size, share * known.saturation / peak)
    found = PulseDetector(pulse, known, CLOCK, PulseDetection(timing=timing)).detect(
        send(light, where, pulse, diode(*more), CLOCK)
    )
    return found, found.sample.numpy() + found.fraction.numpy().astype(np.float64)


@pytest.mark.parametrize("shape", ["gaussian", "t2_exponential"])
@pytest.mark.parametrize("timing", TIMINGS)
def test_a_pulse_without_noise_has_its_delay(timing: str, shape: str) -> None:
    """Claim: at 32 phases of a sample the delay is that of the pulse's centroid, to 3e-3 sample of the tables and
    single precision; the whole sample lies below it and the fraction within 0 and 1; all pulses are seen, once each,
    as high as they are to 4 %: an edge is told by two samples."""
    pulse = Pulse(shape=shape)
    where = 80.0 + 0.5 / 32.0 + np.arange(32) * (3.0 + 1.0 / 32.0)
    where = where[where < 170.0]
    found, delay = timed(where, timing, 0.5, pulse)
    assert (found.status.numpy() == Status.VALID).all()
    assert (found.echoes.numpy() == 1).all()
    assert np.abs(delay - where).max() < 3e-3
    assert found.fraction.numpy().min() >= 0.0
    assert found.fraction.numpy().max() < 1.0
    height = found.signal.numpy() / Photodiode().saturation
    np.testing.assert_allclose(height, 0.5, rtol=0.04)


@pytest.mark.parametrize("timing", TIMINGS)
def test_a_pulse_is_timed_where_its_window_fits_into_the_record(timing: str) -> None:
    """Claim: one whose highest sample has half a window and a sample more behind it in the record has a delay; the next
    is out of the gate."""
    pulse = Pulse(shape="gaussian")
    half = PulseDetector(pulse, Photodiode(), CLOCK, PulseDetection(timing=timing)).half
    latest = CLOCK.samples - 1 - half
    found, _ = timed(np.array([latest - 1.0, latest - 0.8, latest - 0.2, latest]) + 0.01, timing, 0.5, pulse)
    valid, beyond = Status.VALID, Status.OUT_OF_GATE
    assert found.status.numpy().tolist() == [valid, valid, beyond, beyond]


def test_a_clipped_pulse_is_timed_by_its_edge() -> None:
    """Claim: of four times the saturation the delay is told by the crossing of half of it, to 0.01 sample."""
    pulse = Pulse(shape="gaussian")
    where = 60.0 + np.arange(16) * (4.0 + 1.0 / 16.0)
    found, delay = timed(where, "matched_filter", 4.0, pulse, "saturation")
    valid = found.status.numpy() == Status.VALID
    assert valid.all()
    assert np.abs(delay - where).max() < 1e-2


def test_whole_numbers_stand_above_the_threshold_by_half_a_step() -> None:
    """Claim: rounded to digital numbers, the threshold is the first half one that is no less than the noise times what
    is asked for; a converter without steps has that itself."""
    dark = np.linspace(1.0, 3.0, 12) * diode("amplifier").dark_variance
    for known in (diode("amplifier", "quantisation"), diode("amplifier")):
        detector = PulseDetector(Pulse(), known, CLOCK, PulseDetection(timing="constant_fraction"))
        asked = detector.threshold * np.sqrt(dark) / detector.step
        assert asked.max() > 1.5
        found = detector._threshold(auto.Float(dark.tolist())).numpy().astype(np.float64)
        if known.noise.quantisation:
            np.testing.assert_array_equal(found % 1.0, 0.5)
            assert (found >= asked).all()
            assert (found < asked + 1.0).all()
            assert np.unique(found).size > 1
        else:
            np.testing.assert_allclose(found, asked, rtol=1e-5)
