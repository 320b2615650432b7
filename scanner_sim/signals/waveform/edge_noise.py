"""Noise of a delay that is read from a few samples of the record: to first order, with all that samples share.

A delay τ of samples x_k errs by Σ w_k δx_k with w_k = ∂τ/∂x_k, and the record's samples have the covariance

    cov(x_j, x_k) = ρ(j − k) coloured + shot(j − k, (j + k)/2) + white δ_jk

with ρ of the electronics, and shot the pulse's own noise behind them
(:func:`~scanner_sim.detector.photodiode.noise_colour.shot_covariance`). On the skirts of a pulse it is far below what
the signal there tells: the electronics smooth the signal by h and its noise by h², which is narrower.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import drjit as dr
import drjit.auto.ad as auto
import numpy as np

from scanner_sim.detector.photodiode.noise_colour import light_noise_variance, shot_covariance
from scanner_sim.foundation.device_numbers import beside, over
from scanner_sim.foundation.device_types import Float
from scanner_sim.signals.waveform.filter import Noise, SampledPulse

_DENSITY = 32
"""Nodes of the table per sample: 1e-3 of the value where the pulse has fallen to 1e-6 of its peak."""
_FARTHEST = 6.0
"""Lag, in standard deviations of the electronics' response, from which samples have 1e-4 of their noise in common."""


@dataclass
class Tap:
    """A sample that a delay is read from, Dr.Jit arrays: its ``place`` [sample] and ``weight`` ∂τ/∂x [sample/A]."""

    place: Float
    weight: Float

    def times(self, factor: Float) -> Tap:
        """Return the tap with its weight multiplied."""
        return Tap(self.place, self.weight * factor)


@dataclass
class ShotCourse:
    """The shot noise of a pulse of height 1 behind the electronics, on the device, over the time from its centroid.

    Attributes
    ----------
    shot
        Rows of the covariance of samples 0, 1, 2 … apart over the time of their middle, per variance of the noise that
        light as strong as the peak would make all the time.
    nodes, lags
        Nodes of a row, and number of rows.
    first
        Time of the first node [sample].
    """

    shot: Float
    nodes: int
    lags: int
    first: float

    @classmethod
    def of(cls, shape: SampledPulse) -> ShotCourse:
        """Return that of a pulse behind the electronics."""
        sigma = math.sqrt(shape.variance)
        low, high = shape.response.span(shape.variance)
        time = np.arange(np.floor(low) * _DENSITY, np.ceil(high) * _DENSITY + 1.0) / _DENSITY
        extra, lags = light_noise_variance(sigma), math.ceil(_FARTHEST * sigma) + 1
        shot = [
            shot_covariance(lag, time, sigma, lambda at: shape.response.values(at, extra)) / shape.peak
            for lag in range(lags)
        ]
        return cls(auto.Float(np.concatenate(shot).astype(np.float32)), time.size, lags, float(time[0]))

    def shared(self, lag: Float, middle: Float) -> Float:
        """Return the covariance of samples a lag apart, at the time of their middle [sample]."""
        near = lag < dr.opaque(auto.Float, float(self.lags))
        node = (middle - dr.opaque(auto.Float, self.first)) * _DENSITY
        node = dr.clip(node, 0.0, dr.opaque(auto.Float, self.nodes - 1.001))
        first = auto.UInt32(node)
        start = auto.UInt32(dr.select(near, lag, 0.0)) * dr.opaque(auto.UInt32, self.nodes) + first
        left, right = (dr.gather(auto.Float, self.shot, start + step, near) for step in (0, 1))
        return dr.fma(node - auto.Float(first), right - left, left)


def delay_variance(
    taps: Sequence[Tap], noise: Noise, course: ShotCourse, pulse: tuple[Float, Float], coloured: Float
) -> Float:
    """Return the variance of a delay [sample²].

    Parameters
    ----------
    taps
        The samples that it is read from.
    noise, course
        Of the instrument.
    pulse
        Place of the pulse's centroid, counted as the taps' places are [sample], and its height [A].
    coloured
        Variance of the coloured noise without signal [A²], shape (m,).
    """
    centroid, height = pulse
    variance, per_current, white = auto.Float(0.0), *beside(height, noise.per_current, noise.white)
    shot = per_current * height
    for one, other in combinations_with_replacement(taps, 2):
        lag = dr.abs(one.place - other.place)
        alike = dr.exp(-0.25 * dr.square(over(lag, max(noise.sigma, 1e-9))))
        covariance = alike * coloured + dr.select(lag == 0.0, white, 0.0)
        covariance += shot * course.shared(lag, 0.5 * (one.place + other.place) - centroid)
        variance += one.weight * other.weight * covariance * (1.0 if one is other else 2.0)
    return dr.maximum(variance, 0.0)
