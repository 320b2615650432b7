"""Overlapping echoes: pulses wider than one surface makes them.

Two surfaces in one spot, nearer to each other than the pulse is long, return one pulse between them: it is wider, by f
(1 − f) Δ² in variance for shares f, 1 − f a time Δ apart, and its delay lies between the two. A change δv of a pulse's
variance adds A δv ∂p/∂v to the record. The filter that detects it is the best linear one, blind to amplitude and delay,
so that its noise is known (Kay, *Fundamentals of statistical signal processing* 1, 1993, ch. 4). A surface inclined by
α stretches the pulse of a beam of radius w by (w tanα/c)², which is allowed for up to the steepest one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve
from scipy.special import ndtri

from scanner_sim.detector.photodiode.photodiode import Digitiser
from scanner_sim.detector.photodiode.pulse_response import PulseResponse
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.device_types import Float, Mask
from scanner_sim.optics.laser import Laser
from scanner_sim.signals.waveform.filter import PHASES, Moments, Noise, SampledPulse, moments_of
from scanner_sim.signals.waveform.fit import PulseFit

Array = NDArray[np.float64]

_FALSE_ALARM = 1e-4
"""Probability that noise makes a pulse of one surface look like two."""
_WIDTH_UNCERTAINTY = 0.01
"""Relative error with which the variance of the instrument's own pulse is known."""
_STEEPEST = math.tan(math.radians(80.0))
"""Slope of the steepest surface whose stretched pulses pass."""
_DERIVATIVE_STEP = 0.02
"""Relative change of the variance by which the derivative is taken."""
_NONZERO = 1e-20


@dataclass(frozen=True, eq=False)
class OverlapTest:
    """The filter for a pulse's width on the device, and what one surface can explain of it.

    ``taps`` by phase; ``variance`` coloured, white and shot terms by phase; ``count`` of taps; ``known`` variance that
    the pulse itself may be off by [sample²]; ``laser`` and ``digitiser`` of the instrument.
    """

    taps: Float
    variance: tuple[Float, Float, Float]
    count: int
    known: float
    laser: Laser
    digitiser: Digitiser

    @classmethod
    def of(cls, response: PulseResponse, noise: Noise, laser: Laser, digitiser: Digitiser) -> OverlapTest:
        """Return the test for a pulse behind electronics."""
        weights, moments = width_filter(response, noise)
        flat = [
            auto.Float(values.astype(np.float32).ravel())
            for values in (weights, moments.coloured, moments.white, moments.shot)
        ]
        whole = response.variance + noise.sigma**2
        return cls(
            flat[0],
            (flat[1], flat[2], flat[3]),
            weights.shape[1],
            _WIDTH_UNCERTAINTY * whole,
            laser,
            digitiser,
        )

    def __call__(
        self,
        samples: list[Float],
        fit: PulseFit,
        delay: Float,
        current: Float,
        noise: tuple[Float, Float, Float],
    ) -> Mask:
        """Return which pulses are too wide, Dr.Jit, shape (m,).

        Parameters
        ----------
        samples
            The samples about each peak [digital number], 2K + 1 arrays of shape (m,).
        fit
            The pulse fitted to them.
        delay
            Delay of the pulse from the record's start [sample].
        current
            Its amplitude [A].
        noise
            Variances: coloured [A²], white [A²], shot per amplitude [A].
        """
        wider = auto.Float(0.0)
        for tap, sample in enumerate(samples):
            wider = dr.fma(dr.gather(auto.Float, self.taps, fit.phase * self.count + tap), sample, wider)
        wider = wider / dr.maximum(fit.amplitude, _NONZERO)
        coloured, white, shot = (dr.gather(auto.Float, values, fit.phase) for values in self.variance)
        variance = coloured * noise[0] + white * noise[1] + shot * noise[2] * current
        chance = dr.sqrt(dr.maximum(variance, 0.0)) / dr.maximum(current, _NONZERO)
        limit = (
            float(-ndtri(_FALSE_ALARM)) * chance
            + dr.opaque(auto.Float, self.known)
            + self._largest_stretch(delay)
        )
        return (fit.amplitude > 0.0) & (wider > limit)

    def _largest_stretch(self, delay: Float) -> Float:
        """Return the variance [sample²] by which the steepest surface stretches a pulse of some delay."""
        clock, laser = self.digitiser, self.laser
        seconds = delay * dr.opaque(auto.Float, 1.0 / clock.rate) + dr.opaque(auto.Float, clock.start)
        away = seconds * (0.5 * SPEED_OF_LIGHT) - dr.opaque(auto.Float, laser.waist_distance)
        twist = away / dr.opaque(auto.Float, laser.rayleigh_length)
        waist = dr.opaque(auto.Float, laser.waist_radius * _STEEPEST / SPEED_OF_LIGHT * clock.rate)
        return dr.square(waist) * (1.0 + dr.square(twist))


def width_filter(response: PulseResponse, noise: Noise) -> tuple[Array, Moments]:
    """Return the taps that tell by how much a pulse's variance is larger, times its amplitude, and their variance.

    For each phase of the pulse, −1 to 1 in steps of 1/PHASES; shape (2 · PHASES + 1, 2K + 1). The last row of
    (B R⁻¹ Bᵀ)⁻¹ B R⁻¹, with B the pulse, its derivatives by delay and by variance, and R the noise's covariance.
    """
    pulse = SampledPulse(response, noise.sigma)
    away = np.arange(-pulse.half, pulse.half + 1, dtype=np.float64)
    _, covariance = noise.covariance(away.size)
    phases = np.arange(-PHASES, PHASES + 1) / PHASES
    time = away[None, :] - phases[:, None]
    change = _DERIVATIVE_STEP * (response.variance + pulse.variance)
    change = min(change, 0.5 * pulse.variance)
    ends = [response.values(time, pulse.variance + side * change) / pulse.peak for side in (1.0, -1.0)]
    basis = np.stack([pulse.values(time), pulse.slope(time), (ends[0] - ends[1]) / (2.0 * change)], axis=1)
    matched = solve(covariance, basis.reshape(-1, away.size).T, assume_a="pos").T.reshape(basis.shape)
    products = np.einsum("pit,pjt->pij", basis, matched)
    weights = np.linalg.solve(products, matched)[:, 2, :]
    return weights, moments_of(weights, noise, pulse, phases)
