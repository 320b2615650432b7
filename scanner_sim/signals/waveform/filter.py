"""Filters for a pulse of known shape in noise of known colour, and the threshold for a rate of false alarms.

A pulse of amplitude A at τ in noise of covariance R: the likelihood's maximum is where the whitened matched filter
pᵀR⁻¹x is largest, and its accuracy reaches the Cramér–Rao bound at high signal-to-noise ratio (Van Trees, *Detection,
estimation, and modulation theory* 1, 1968, secs. 2.4 and 4.3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit.auto.ad as auto
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve, toeplitz
from scipy.optimize import brentq
from scipy.special import ndtr, owens_t

from scanner_sim.detector.photodiode.noise_colour import correlation
from scanner_sim.detector.photodiode.pulse_response import PulseResponse
from scanner_sim.foundation.device_types import Float

Array = NDArray[np.float64]

PHASES = 64
"""Phases of the timing filter within a sample; between them one Newton step is exact to 1e-5 samples."""
_RIDGE = 1e-3
"""White noise that the filter reckons with on top, over the variance: keeps faith with shapes not quite known."""
_FAINT = 1e-4
"""Share of the peak below which the pulse is over."""
_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class Noise:
    """Second moments of the noise at the samples.

    ``coloured`` and ``white`` variance without light [A²]; ``per_current`` further variance per current of the signal
    [A]; ``sigma`` standard deviation of the electronics' response [sample].
    """

    coloured: float
    white: float
    per_current: float
    sigma: float

    def covariance(self, count: int) -> tuple[Array, Array]:
        """Return the correlation matrix of the coloured part, and the covariance that filters reckon with."""
        matrix = toeplitz(correlation(np.arange(count, dtype=np.float64), self.sigma))
        whole = self.coloured + self.white
        if whole == 0.0:
            return matrix, matrix + _RIDGE * np.eye(count)
        return matrix, self.coloured * matrix + (self.white + _RIDGE * whole) * np.eye(count)


@dataclass(frozen=True, eq=False)
class Moments:
    """Variance of a weighted sum: ``coloured`` and ``white`` per variance of either, ``shot`` per amplitude's."""

    coloured: Array
    white: Array
    shot: Array

    def on_device(self) -> tuple[Float, Float, Float]:
        """Return them one behind the other on the device."""
        coloured, white, shot = (
            auto.Float(values.astype(np.float32)) for values in (self.coloured, self.white, self.shot)
        )
        return coloured, white, shot


@dataclass(frozen=True, eq=False)
class MatchedFilter:
    """A matched filter for a pulse that peaks at 1.

    Attributes
    ----------
    half
        Half length K; the filters have 2K + 1 taps.
    search
        Taps for finding the pulse, shape (2K + 1,).
    searched
        Variance of the searched line.
    neighbour
        Correlation of neighbouring samples of the searched line in the dark.
    shift, amplitude
        For each phase φ of the pulse, −1 to 1 in steps of 1/PHASES, the taps whose sums tell how far the pulse lies
        beyond φ (times its amplitude) and how high it is: shape (2 · PHASES + 1, 2K + 1).
    moments, height_moments
        Variances of the sums by ``shift`` and by ``amplitude``.
    """

    half: int
    search: Array
    searched: Moments
    neighbour: float
    shift: Array
    amplitude: Array
    moments: Moments
    height_moments: Moments

    @classmethod
    def of(cls, response: PulseResponse, noise: Noise) -> MatchedFilter:
        """Return the filter for a pulse that no slope has stretched."""
        pulse = SampledPulse(response, noise.sigma)
        half = pulse.half
        away = np.arange(-half, half + 1, dtype=np.float64)
        _, covariance = noise.covariance(away.size)
        phases = np.arange(-PHASES, PHASES + 1) / PHASES
        shape = pulse.values(away[None, :] - phases[:, None])
        slope = pulse.slope(away[None, :] - phases[:, None])
        # Solved for all phases at once: (taps, phases).
        matched, sloped = (solve(covariance, rows.T, assume_a="pos").T for rows in (shape, slope))
        energy = np.sum(shape * matched, axis=1, keepdims=True)
        both = np.sum(slope * matched, axis=1, keepdims=True)
        information = np.sum(slope * sloped, axis=1, keepdims=True) - both**2 / energy
        shift = (sloped - both / energy * matched) / information
        # Without whitening: its side lobes would make echoes of clipped and of stretched pulses.
        search = shape[PHASES] / np.sum(shape[PHASES] ** 2)
        plain = moments_of(search[None, :], noise, pulse, np.zeros(1))
        whole = noise.coloured * plain.coloured[0] + noise.white * plain.white[0]
        lagged = 0.0
        if whole > 0.0:
            ahead = noise.coloured * correlation(away[:, None] - away[None, :] - 1.0, noise.sigma)
            ahead = ahead + noise.white * (away[:, None] - away[None, :] == 1.0)
            lagged = float(search @ ahead @ search / whole)
        amplitude = matched / energy
        moments, of_height = (moments_of(taps, noise, pulse, phases) for taps in (shift, amplitude))
        return cls(half, search, plain, lagged, shift, amplitude, moments, of_height)


class SampledPulse:
    """A pulse behind the electronics, with a peak of 1; times in samples from the pulse's centroid."""

    def __init__(self, response: PulseResponse, sigma: float) -> None:
        self.response, self.variance = response, sigma**2
        low, high = response.span(self.variance)
        time = np.linspace(low, high, 8193)
        values = response.values(time, self.variance)
        self.peak = float(values.max())
        """Height of a pulse of area 1."""
        self.summit = float(time[values.argmax()])
        """Time of the peak from the centroid."""
        heard = time[values > _FAINT * self.peak]
        self.half = math.ceil(max(-heard[0], heard[-1])) + 2
        """Half length of a window that holds the pulse."""
        above = time[values > 0.5 * self.peak]
        self.width = float(above[-1] - above[0])
        """Full width at half maximum."""

    def values(self, time: Array) -> Array:
        """Return the pulse at some times."""
        return self.response.values(time, self.variance) / self.peak

    def slope(self, phase_time: Array) -> Array:
        """Return the pulse's derivative by its own delay, −p'."""
        ahead, behind = self.values(phase_time - _STEP), self.values(phase_time + _STEP)
        return (ahead - behind) / (2.0 * _STEP)

    def light(self, time: Array) -> Array:
        """Return the shot noise's variance over its course, per amplitude: the light smoothed by h²."""
        return self.response.values(time, 0.5 * self.variance) / self.peak


def moments_of(weights: Array, noise: Noise, pulse: SampledPulse, phases: Array) -> Moments:
    """Return the variances of sums by rows of weights; the signal's shot noise with the pulse at each row's phase.

    The covariance of shot noise at two samples is the light in their middle, smoothed by h², times the correlation.
    """
    half = weights.shape[1] // 2
    matrix, _ = noise.covariance(weights.shape[1])
    away = np.arange(-half, half + 1, dtype=np.float64)
    middle = 0.5 * (away[:, None] + away[None, :])
    shot = np.array(
        [
            row @ (matrix * pulse.light(middle - phase)) @ row
            for row, phase in zip(weights, phases, strict=True)
        ]
    )
    coloured = np.einsum("ij,jk,ik->i", weights, matrix, weights)
    return Moments(coloured, np.sum(weights**2, axis=1), shot)


def false_alarm_probability(threshold: float, samples: int, neighbour: float) -> float:
    """Return the probability that a line of normal noise begins above a threshold or crosses it upwards.

    1 − exp(−Q(T) − (n − 1) P(y₀ ≤ T < y₁)), crossings taken as independent, which they are for rare ones (Leadbetter,
    Lindgren, Rootzén, *Extremes and related properties of random sequences and processes*, 1983, ch. 4). The chance of
    a crossing is twice Owen's function (Owen, *Ann. Math. Statist.* 27, 1956, 1075).

    Parameters
    ----------
    threshold
        T in standard deviations.
    samples
        Samples n of the line.
    neighbour
        Correlation of neighbouring samples.
    """
    upwards = 2.0 * float(owens_t(threshold, math.sqrt(max(1.0 - neighbour, 0.0) / (1.0 + neighbour))))
    return float(-math.expm1(-float(ndtr(-threshold)) - (samples - 1) * upwards))


def threshold_for(false_alarms: float, samples: int, neighbour: float) -> float:
    """Return the threshold [standard deviation] that noise alone passes with some probability per line."""
    return float(
        brentq(
            lambda t: math.log(false_alarm_probability(t, samples, neighbour) / false_alarms),
            -3.0,
            12.0,
        )
    )
