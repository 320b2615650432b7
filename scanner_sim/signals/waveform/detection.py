"""From waveforms to delays: find the echoes, choose one, time it, and say how well.

The instrument knows its own pulse, its noise and, from the bias monitor, the mean background; nothing of the scene.
σ is propagated to first order from the noise at the samples, with its correlation and the signal's own shot noise. It
does not know of echoes that overlap, nor of pulses that slopes have stretched.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.photodiode.noise_colour import correlation
from scanner_sim.detector.photodiode.photodiode import Digitiser, Photodiode
from scanner_sim.detector.photodiode.pulse_response import PulseResponse
from scanner_sim.detector.photodiode.waveform import Waveforms, quantisation_variance
from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_numbers import beside
from scanner_sim.foundation.device_types import Float, Int32, Mask, UInt32
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.status import Status
from scanner_sim.optics.laser import Laser
from scanner_sim.optics.pulse import Pulse
from scanner_sim.signals.own import Function
from scanner_sim.signals.waveform.calibration import send_all_phases
from scanner_sim.signals.waveform.edge_timing import EdgeTiming, TimedEcho, vertex
from scanner_sim.signals.waveform.filter import (
    MatchedFilter,
    Noise,
    SampledPulse,
    moments_of,
    threshold_for,
)
from scanner_sim.signals.waveform.fit import PulseFit, TimingFilter, fit_gaussian, fit_weights
from scanner_sim.signals.waveform.overlap import OverlapTest
from scanner_sim.signals.waveform.own_pulse import KnownRecords, find_own_delays
from scanner_sim.signals.waveform.search import FoundEcho, filter_records, find_echoes
from scanner_sim.signals.waveform.settings import PULSES, PulseDetection

_LEAST_LEVEL = 1e-4
"""Level, over the saturation, of the leading edge where there is no noise to set one."""
_CALIBRATION = 64
"""Phases at which an estimator's constant error is computed."""
_LEAST_WHITE = 1e-12


@dataclass
class Delays:
    """Delays of m shots, Dr.Jit arrays of shape (m,).

    Attributes
    ----------
    sample, fraction
        Whole and fraction of the delay [sample] from the record's start; NaN in ``fraction`` without a valid echo.
    sigma
        Standard deviation of the delay [sample], clock apart; NaN likewise.
    signal, sigma_signal
        Amplitude of the echo [A] and its standard deviation; of a clipped one by the time above half the saturation,
        and a lower bound where its edges are not in the record.
    snr
        Amplitude over the noise of a sample without signal.
    echoes
        Number of echoes in the record.
    status
        Codes of :class:`Status`.
    """

    sample: Int32
    fraction: Float
    sigma: Float
    signal: Float
    sigma_signal: Float
    snr: Float
    echoes: UInt32
    status: UInt32

    def seconds(self, digitiser: Digitiser) -> NDArray[np.float64]:
        """Return the delays since the pulse [s] in double precision, by the nominal rate of the clock."""
        whole = self.sample.numpy().astype(np.float64)
        fraction = self.fraction.numpy().astype(np.float64)
        return np.asarray((whole + fraction) / digitiser.rate + digitiser.start)


class PulseDetector:
    """Detection for one instrument: its filters and tables are computed once.

    Parameters
    ----------
    pulse, photodiode, digitiser
        The instrument as it knows itself.
    settings
        How echoes are found and timed.
    laser
        The beam, which limits how far a surface can stretch a pulse; without it overlapping echoes are not looked for.

    Raises
    ------
    InputError
        If the level is not below the saturation, or the record is too short for the pulse.
    """

    def __init__(
        self,
        pulse: Pulse,
        photodiode: Photodiode,
        digitiser: Digitiser,
        settings: PulseDetection,
        laser: Laser | None = None,
    ) -> None:
        self.pulse, self.photodiode, self.digitiser, self.settings = pulse, photodiode, digitiser, settings
        self.step = digitiser.step(photodiode.saturation)
        self.noise = _noise_of(photodiode, digitiser)
        self._stated = photodiode, self.noise
        response = PulseResponse.of(pulse, digitiser.rate)
        self.shape = SampledPulse(response, self.noise.sigma)
        self.filter = MatchedFilter.of(response, self.noise)
        self.overlap: OverlapTest | None = None
        if laser is not None and settings.overlap:
            self.overlap = OverlapTest.of(response, self.noise, laser, digitiser)
        self.half = self.filter.half
        searched = digitiser.samples - 2 * self.half
        if searched < 4:
            raise InputError(
                f"a record of {digitiser.samples} samples is too short for a pulse of {2 * self.half + 1}.",
                remedy="Widen the digitiser's gate.",
            )
        self.matched = settings.timing in ("matched_filter", "gaussian_fit")
        neighbour = (
            self.filter.neighbour if self.matched else float(correlation(np.ones(1), self.noise.sigma)[0])
        )
        self.threshold = threshold_for(settings.false_alarms, searched, neighbour)
        self.edges = EdgeTiming(pulse, photodiode, digitiser, self.noise, settings.fraction)
        self.full = self.edges.full
        level = settings.level
        least = _LEAST_LEVEL * photodiode.saturation / self.step
        self.level = max(self._dark_threshold, least) if level is None else level / self.step
        if not self.level < self.full:
            raise InputError(
                f"the level of {self.level * self.step:.3g} A is not below the saturation of "
                f"{photodiode.saturation:.3g} A.",
                remedy="Lower the detection's level, or raise the photodiode's saturation.",
            )

    def stating(self, photodiode: Photodiode) -> PulseDetector:
        """Return the same detection, whose σ is that of another photodiode's noise.

        Filters, levels, thresholds and hence all that it finds stay. Not so for a timing of the user's own: the
        function is told the other noise, and may find other delays by it; the thresholds that it is told stay.
        """
        made, noise = copy(self), _noise_of(photodiode, self.digitiser)
        made._stated = photodiode, noise
        made.edges = EdgeTiming(self.pulse, photodiode, self.digitiser, noise, self.settings.fraction)
        return made

    def detect(self, waveforms: Waveforms) -> Delays:
        """Find and time the echo of every record.

        Parameters
        ----------
        waveforms
            The records of m shots by this instrument.
        """
        heard = _coloured(waveforms, self.photodiode, self.noise)
        stated = self._stated[1]
        coloured = heard if stated is self.noise else _coloured(waveforms, *self._stated)
        own = PULSES.function(self.settings.timing)
        if own is not None:
            return self._detect_by(own, waveforms, heard, coloured)
        line = filter_records(waveforms, self.filter.search) if self.matched else waveforms.number
        threshold = self._threshold(heard)
        found = find_echoes(waveforms, line, threshold, self.half, self.settings.echo)
        some = found.count > 0
        inside = (found.sample >= self.half) & (found.sample < waveforms.samples - 1 - self.half)
        good = some & inside
        samples = self._samples_about(waveforms, found.sample, good)
        highest = samples[0]
        for value in samples[1:]:
            highest = dr.maximum(highest, value)
        clipped = good & (highest >= dr.opaque(auto.Float, self.full - 0.5))
        timed = self._time_echo(waveforms, found, samples, coloured, good)
        wide = good & ~clipped & self._is_too_wide(found, samples, heard)
        rounding, least = beside(coloured, stated.white, _LEAST_WHITE * self.step**2)
        quiet = dr.sqrt(coloured + rounding + least)
        if math.isfinite(self.full):
            timed = timed.or_where(clipped, self.edges.clipped(waveforms, found.sample, coloured, clipped))
        status = auto.UInt32(Status.VALID)
        for failed, code in (
            (wide, Status.OVERLAP),
            (clipped & ~timed.whole, Status.SATURATED),
            (~clipped & ~timed.whole, Status.BAD_SHAPE),
            (~inside, Status.OUT_OF_GATE),
            (~some, Status.BELOW_THRESHOLD),
        ):
            status = dr.select(failed, auto.UInt32(int(code)), status)
        valid = status == int(Status.VALID)
        carry = dr.floor(timed.shift)
        signal = dr.select(some, timed.height, 0.0)
        delays = Delays(
            sample=dr.select(valid, auto.Int32(timed.sample) + auto.Int32(carry), 0),
            fraction=dr.select(valid, timed.shift - carry, dr.nan),
            sigma=dr.select(valid, dr.sqrt(timed.variance), dr.nan),
            signal=signal,
            sigma_signal=dr.select(some, dr.sqrt(timed.height_variance), quiet),
            snr=signal / quiet,
            echoes=found.count,
            status=status,
        )
        dr.eval(delays)
        return delays

    def _detect_by(self, function: Function, waveforms: Waveforms, heard: Float, coloured: Float) -> Delays:
        """Return the delays that a function of the user's tells; the echoes are those that it found.

        Their heights are read about these delays, as those of pulses that are timed by their edges.
        """
        clock, stated = self.digitiser, self._stated[1]
        threshold = self._threshold(heard) + dr.zeros(auto.Float, waveforms.shots)
        known = KnownRecords(
            time=clock.start + np.arange(waveforms.samples) / clock.rate,
            step=self.step,
            saturated=np.zeros(0, dtype=bool),
            threshold=threshold.numpy().astype(np.float64) * self.step,
            coloured=coloured.numpy().astype(np.float64),
            noise=stated,
            shape=self.shape,
        )
        found = find_own_delays(self.settings.timing, function, waveforms.records(), known, self.full)
        valid, top = found.status == Status.VALID, auto.UInt32(for_device(found.top, np.uint32))
        some = auto.Bool(valid)
        height, variance = self.edges.height(waveforms, top, coloured, some)
        samples = np.where(valid, (found.delay - clock.start) * clock.rate, 0.0)
        quiet = auto.Float(for_device(np.sqrt(known.coloured + stated.white + _LEAST_WHITE * self.step**2)))
        signal = dr.select(some, height, 0.0)
        delays = Delays(
            sample=auto.Int32(for_device(np.floor(samples), np.int32)),
            fraction=auto.Float(for_device(np.where(valid, samples - np.floor(samples), np.nan))),
            sigma=auto.Float(for_device(found.sigma * clock.rate)),
            signal=signal,
            sigma_signal=dr.select(some, dr.sqrt(variance), quiet),
            snr=signal / quiet,
            echoes=auto.UInt32(for_device(valid, np.uint32)),
            status=auto.UInt32(for_device(found.status, np.uint32)),
        )
        dr.eval(delays)
        return delays

    @property
    def _dark_threshold(self) -> float:
        """Threshold of the searched line in the dark [digital number]."""
        return self._round_threshold(self.threshold * math.sqrt(self.noise.coloured) / self.step)

    def _round_threshold(self, numbers: float) -> float:
        # Between two digital numbers, so that what the converter rounds up to it would have passed it unrounded.
        rounds = self.photodiode.noise.quantisation
        return math.ceil(numbers + 0.5) - 0.5 if rounds else max(numbers, _LEAST_WHITE)

    def _threshold(self, coloured: Float) -> Float:
        """Return the threshold of the searched line [digital number] under each shot's background."""
        times = dr.opaque(auto.Float, self.threshold / self.step)
        if self.matched:
            moments = self.filter.searched
            share, white = beside(
                coloured, float(moments.coloured[0]), self.noise.white * float(moments.white[0])
            )
            return dr.maximum(times * dr.sqrt(coloured * share + white), _LEAST_WHITE)
        numbers = times * dr.sqrt(coloured)
        if self.photodiode.noise.quantisation:
            numbers = dr.ceil(numbers + 0.5) - 0.5
        least = self.level if self.settings.timing == "leading_edge" else _LEAST_WHITE
        return dr.maximum(numbers, dr.opaque(auto.Float, least))

    def _samples_about(self, waveforms: Waveforms, peak: UInt32, good: Mask) -> list[Float]:
        shot = dr.arange(auto.UInt32, waveforms.shots)
        return [
            dr.gather(auto.Float, waveforms.number, waveforms.address(peak + step - self.half, shot), good)
            for step in range(2 * self.half + 1)
        ]

    def _time_echo(
        self, waveforms: Waveforms, found: FoundEcho, samples: list[Float], coloured: Float, good: Mask
    ) -> TimedEcho:
        """Return what the settings' way of timing finds."""
        if self.settings.timing == "leading_edge":
            corrected = self.settings.walk_correction
            return self.edges.at_level(
                waveforms, found.sample, coloured, good, self.level, corrected=corrected
            )
        if not self.matched:
            return self.edges.fraction_of(waveforms, found.sample, coloured, good)
        position, _ = vertex(*(samples[self.half + step] for step in (-1, 0, 1)))
        fit = self.timing.fit(samples, dr.clip(position - beside(position, self.shape.summit)[0], -1.0, 1.0))
        if self.settings.timing == "gaussian_fit":
            fit, _ = fit_gaussian(samples, fit, self._gaussian_width)
            rows = dr.zeros(auto.UInt32, waveforms.shots)
            by_height, by_shift = (
                [dr.gather(auto.Float, values, rows + row) for values in self._fit_moments] for row in (0, 1)
            )
            shift = fit.shift - dr.opaque(auto.Float, self._fit_offset)
        else:
            (by_shift, by_height), shift = self.timing.variances(fit.phase), fit.shift
        current = dr.maximum(fit.amplitude, _LEAST_WHITE) * dr.opaque(auto.Float, self.step)
        white, per_current = beside(current, self._stated[1].white, self._stated[1].per_current)
        noise = coloured, white, current * per_current
        variance, of_height = (
            sum((term * part for term, part in zip(terms, noise, strict=True)), auto.Float(0.0))
            for terms in (by_shift, by_height)
        )
        away: Float = dr.abs(fit.shift)
        sane = good & (fit.amplitude > 0.0) & (away < self.half)
        height = fit.amplitude * dr.opaque(auto.Float, self.step)
        return TimedEcho(found.sample, shift, variance / dr.square(current), height, of_height, sane)

    def _is_too_wide(self, found: FoundEcho, samples: list[Float], coloured: Float) -> Mask:
        """Return which pulses are wider than a surface makes them."""
        if self.overlap is None:
            return auto.Bool(False)
        position, _ = vertex(*(samples[self.half + step] for step in (-1, 0, 1)))
        fit = self.timing.fit(samples, dr.clip(position - beside(position, self.shape.summit)[0], -1.0, 1.0))
        current = dr.maximum(fit.amplitude, _LEAST_WHITE) * dr.opaque(auto.Float, self.step)
        noise = coloured, *beside(current, self.noise.white, self.noise.per_current)
        return self.overlap(samples, fit, auto.Float(found.sample) + fit.shift, current, noise)

    @cached_property
    def timing(self) -> TimingFilter:
        """The matched filter on the device."""
        return TimingFilter.of(self.filter)

    @cached_property
    def _gaussian_width(self) -> float:
        return math.sqrt(self.shape.response.variance + self.shape.variance)

    @cached_property
    def _fit_moments(self) -> tuple[Float, Float, Float]:
        """Variances of the fitted Gaussian's height and of its shift times it, one behind the other."""
        weights = fit_weights(self.half, self._gaussian_width)
        return moments_of(weights, self.noise, self.shape, np.zeros(2)).on_device()

    @cached_property
    def _fit_offset(self) -> float:
        """Mean error of the Gaussian fit on this pulse [sample]: 0 for a Gaussian one."""
        waveforms, truth, top = send_all_phases(self.pulse, self.photodiode, self.digitiser, _CALIBRATION)
        samples = self._samples_about(waveforms, top, top >= 0)
        start = PulseFit(
            dr.zeros(auto.Float, truth.size), samples[self.half], dr.zeros(auto.UInt32, truth.size)
        )
        fit, _ = fit_gaussian(samples, start, self._gaussian_width)
        return float(np.mean(top.numpy() + fit.shift.numpy().astype(np.float64) - truth))


def _noise_of(photodiode: Photodiode, digitiser: Digitiser) -> Noise:
    return Noise(
        photodiode.dark_variance,
        quantisation_variance(photodiode, digitiser),
        photodiode.light_variance / photodiode.amperes_per_watt,
        photodiode.response_sigma * digitiser.rate,
    )


def _coloured(waveforms: Waveforms, photodiode: Photodiode, noise: Noise) -> Float:
    """Return the variance of the coloured noise of records without signal [A²], shape (m,)."""
    light = waveforms.background * dr.opaque(auto.Float, photodiode.light_variance)
    return light + dr.opaque(auto.Float, noise.coloured)


def pulse_detector(
    pulse: Pulse, photodiode: Photodiode, digitiser: Digitiser, settings: PulseDetection, laser: Laser
) -> PulseDetector:
    """Return the detector of an instrument, calibrated once for all its runs; arguments of :class:`PulseDetector`."""
    return _calibrated(auto.Float, pulse.text, pulse, photodiode, digitiser, settings, laser)


@lru_cache(maxsize=2)
def _calibrated(
    kind: Any,  # noqa: ARG001 (arrays of another device are of no use)
    text: str,  # noqa: ARG001 (nor are those of another file)
    *parts: Any,
) -> PulseDetector:
    return PulseDetector(*parts)
