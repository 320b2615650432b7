"""Noise-free pulses sent through the receiver: what estimators are calibrated with."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.photodiode.photodiode import Digitiser, Photodiode, PhotodiodeNoise
from scanner_sim.detector.photodiode.pulse_response import PulseResponse
from scanner_sim.detector.photodiode.waveform import Waveforms, record
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_types import Float, UInt32
from scanner_sim.optics.pulse import Pulse
from scanner_sim.signals.waveform.filter import SampledPulse

Array = NDArray[np.float64]

_SILENT = PhotodiodeNoise(shot=False, amplifier=False, saturation=True, quantisation=False, clock=False)
_COARSE = 64.0
HEIGHT = 0.3
"""Amplitude over the saturation of the pulses of :func:`send_all_phases`."""


@dataclass
class _Sent:
    """Echoes of pulses that are sent through the receiver."""

    amount: Float
    position: Float
    sigma: Float
    reference: Float


def noise_free_receiver(
    pulse: Pulse, photodiode: Photodiode, digitiser: Digitiser
) -> tuple[Photodiode, Digitiser, float]:
    """Return the receiver without noise, a record that is long enough for one pulse, and its middle [sample]."""
    sigma = photodiode.response_sigma * digitiser.rate
    low, high = PulseResponse.of(pulse, digitiser.rate).span(sigma**2)
    half = (max(-low, high) + 8.0) / digitiser.rate
    reach = 0.5 * SPEED_OF_LIGHT * 2.0 * half
    clock = digitiser.model_copy(update={"gate": (0.0, reach)})
    silent = photodiode.model_copy(update={"noise": _SILENT})
    return silent, clock, float(np.floor(0.5 * clock.samples))


def peak_of(pulse: Pulse, photodiode: Photodiode, digitiser: Digitiser) -> float:
    """Return the height of a pulse of area 1 behind the electronics [1/sample]."""
    return SampledPulse(
        PulseResponse.of(pulse, digitiser.rate), photodiode.response_sigma * digitiser.rate
    ).peak


def send(share: Array, truth: Array, pulse: Pulse, photodiode: Photodiode, digitiser: Digitiser) -> Waveforms:
    """Record pulses of some shares of the power at some delays [sample] from the record's start."""
    # The whole samples go into the reference, whose double precision loses nothing.
    metres = (truth / digitiser.rate + digitiser.start) * SPEED_OF_LIGHT
    coarse = np.floor(metres * _COARSE) / _COARSE
    count = share.size
    echoes = _Sent(
        auto.Float(for_device(share)),
        auto.Float(for_device(metres - coarse)),
        dr.zeros(auto.Float, count),
        auto.Float(for_device(coarse)),
    )
    return record(echoes, dr.arange(auto.UInt32, count), pulse, photodiode, digitiser, 0)


def send_all_phases(
    pulse: Pulse, photodiode: Photodiode, digitiser: Digitiser, count: int
) -> tuple[Waveforms, Array, UInt32]:
    """Record pulses at ``count`` phases within a sample; return records, true delays and peaks [sample]."""
    silent, clock, middle = noise_free_receiver(pulse, photodiode, digitiser)
    truth = middle + (np.arange(count) + 0.5) / count
    peak = peak_of(pulse, photodiode, digitiser) * pulse.pulse_energy * digitiser.rate
    share = np.full(count, HEIGHT * photodiode.saturation / (peak * silent.amperes_per_watt))
    waveforms = send(share, truth, pulse, silent, clock)
    return waveforms, truth, auto.UInt32(for_device(waveforms.records().argmax(axis=1), np.uint32))
