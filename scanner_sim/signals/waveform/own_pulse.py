"""The user's timing of echoes: what it is given of waveforms, and what the instrument adds to what it returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.photodiode.noise_colour import correlation
from scanner_sim.foundation.status import Status
from scanner_sim.signals.own import Function, estimated, refuse, row_sums
from scanner_sim.signals.waveform.filter import Noise, SampledPulse

Array = NDArray[np.float64]

_TOGETHER = 4096
"""Records that a function is given at once: bounds the memory."""


@dataclass(frozen=True, eq=False)
class KnownRecords:
    """What an instrument knows of n waveforms beside their currents; nothing of it is the truth.

    Attributes
    ----------
    time
        Time of each sample since the pulse was sent [s], by the nominal rate of the clock, shape (samples,).
    step
        Current of one digital number [A].
    saturated
        Which samples reach the amplifier's limit, shape (n, samples).
    threshold
        Current [A] that noise alone exceeds anywhere in a record with the probability
        ``processing.pulse.false_alarms``, shape (n,).
    coloured
        Variance of a sample without signal [A²] by amplifier, dark current and the background that the bias monitor
        tells, correlated in time, shape (n,).
    noise, shape
        All of the noise, and the pulse behind the electronics: for the methods.
    """

    time: Array
    step: float
    saturated: NDArray[np.bool_]
    threshold: Array
    coloured: Array
    noise: Noise
    shape: SampledPulse

    def pulse(self, time: Array) -> Array:
        """Return the pulse that a surface facing the beam sends back, of height 1, at times [s] from its centroid."""
        return self.shape.values(np.asarray(time) * self._rate)

    def delay_sigma(self, gradient: Array, currents: Array) -> Array:
        """Return σ of delays [s] to first order: correlated noise of the samples, and the signal's own shot noise.

        Parameters
        ----------
        gradient
            Derivative of each delay by each sample [s/A], shape (n, samples).
        currents
            The records [A], shape (n, samples).
        """
        (used,) = np.nonzero((gradient != 0.0).any(axis=0))
        if not used.size:
            return np.zeros(len(gradient))
        window = slice(int(used[0]), int(used[-1]) + 1)
        slope, current = gradient[:, window], np.maximum(currents[:, window], 0.0)
        scaled = slope * np.sqrt(self.coloured[:, None] + self.noise.per_current * current)
        variance = row_sums(scaled**2) + self.noise.white * row_sums(slope**2)
        alike = correlation(np.arange(slope.shape[1], dtype=np.float64), self.noise.sigma)
        for lag in range(1, slope.shape[1]):
            variance = variance + 2.0 * alike[lag] * row_sums(scaled[:, lag:] * scaled[:, :-lag])
        return np.sqrt(variance)

    @property
    def _rate(self) -> float:
        return float((self.time.size - 1) / (self.time[-1] - self.time[0]))


@dataclass(frozen=True, eq=False)
class OwnDelays:
    """Delays of m records as a function told them: [s], their σ [s], status, and the sample at the top of each echo."""

    delay: Array
    sigma: Array
    status: NDArray[np.uint32]
    top: NDArray[np.int64]


def find_own_delays(
    name: str,
    function: Function,
    records: NDArray[np.float32],
    known: KnownRecords,
    full: float,
) -> OwnDelays:
    """Return what a function of the user's tells of records.

    Parameters
    ----------
    name, function
        The function.
    records
        Digital numbers, shape (m, samples).
    known
        What is known of all of them; ``saturated`` is left open.
    full
        Digital number at which the amplifier saturates.

    Returns
    -------
    OwnDelays
        The top is the highest of the three samples where the pulse has it; it means nothing where nothing was found.

    Raises
    ------
    InputError
        If the function fails or returns what is no such thing; see :func:`~scanner_sim.signals.own.estimated`.
    """
    parts = []
    for first in range(0, len(records), _TOGETHER):
        rows = slice(first, first + _TOGETHER)
        numbers = records[rows].astype(np.float64)
        currents = numbers * known.step
        own = KnownRecords(
            known.time,
            known.step,
            numbers >= full - 0.5,
            known.threshold[rows],
            known.coloured[rows],
            known.noise,
            known.shape,
        )
        delay, sigma, status = estimated(name, function, len(currents), currents.copy(), own)
        outside = (status == Status.VALID) & ~((delay >= known.time[0]) & (delay <= known.time[-1]))
        refuse(
            name,
            outside,
            f"valid delays outside of the record, {known.time[0]:.4g} s to {known.time[-1]:.4g} s",
        )
        parts.append((delay, sigma, status, _top(currents, delay, known)))
    return OwnDelays(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _top(currents: Array, delay: Array, known: KnownRecords) -> NDArray[np.int64]:
    """Return the highest of the three samples where each pulse has its top, not the first or last of the record."""
    found = np.where(np.isfinite(delay), delay, known.time[0])
    place = (found - known.time[0]) * known._rate + known.shape.summit
    near = np.clip(np.rint(place).astype(np.int64)[:, None] + [-1, 0, 1], 1, currents.shape[1] - 2)
    best = np.take_along_axis(currents, near, axis=1).argmax(axis=1)
    return np.take_along_axis(near, best[:, None], axis=1)[:, 0]
