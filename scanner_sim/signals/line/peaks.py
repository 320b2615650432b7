"""Peaks: from a digitised line to the sub-pixel position of the spot, with its σ.

A peak is found (:mod:`~scanner_sim.signals.line.search`), the light beside it is taken away, its position is estimated
(:mod:`~scanner_sim.signals.line.estimators`) and it is compared with the spot that it should be
(:mod:`~scanner_sim.signals.line.validation`). σ is the first-order propagation of each pixel's variance, taken from the
noise model at the whole measured charge, and of the baseline's, through the estimator's derivatives.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from scanner_sim.detector.line.exposure import Signal
from scanner_sim.detector.line.position_sensor import PositionSensor
from scanner_sim.foundation.device_types import Float, Mask, UInt32
from scanner_sim.foundation.status import Status
from scanner_sim.signals.line.bias import Bias
from scanner_sim.signals.line.calibration import SensorCalibration
from scanner_sim.signals.line.digital_line import (
    EVEN,
    MEDIAN_VARIANCE,
    SIDE,
    Around,
    Line,
    baseline_beside,
    no_baseline,
)
from scanner_sim.signals.line.estimators import estimate
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.likelihood import Width
from scanner_sim.signals.line.limits import SIDE_THRESHOLD, gate_of, limits_of
from scanner_sim.signals.line.search import brightest_pixel, spot_pixel
from scanner_sim.signals.line.speckle import ExpectedSpeckle
from scanner_sim.signals.line.validation import farthest_pixel, guard_pixels, judge_shape, white_charge
from scanner_sim.signals.line.window import NoisePeak
from scanner_sim.signals.processing import MARGIN, Processing

__all__ = ["MARGIN", "SensorCalibration", "Peaks", "faintest_signal", "find_peaks"]

_SIGNAL_PIXELS = 4
"""Pixels to each side of the brightest one whose charge is the peak's signal."""
_GLOSS_LIMIT = 1.5
"""Brightness relative to a white surface that none without gloss can have, tilt towards the lens included."""


@dataclass
class Peaks:
    """Peaks of a group of shots, Dr.Jit arrays of shape (m,).

    ``position`` and ``sigma`` [pixel], NaN where ``status`` is not 0; ``signal`` charge of the peak summed over nine
    pixels and ``sigma_signal``, its standard deviation by all but speckle [electron]; ``background`` charge beneath its
    brightest pixel [electron], 0 where it is not looked for; ``snr`` height of the peak over the standard deviation of
    its brightest pixel; ``status`` code.
    """

    position: Float
    sigma: Float
    signal: Float
    sigma_signal: Float
    background: Float
    snr: Float
    status: UInt32
    settled: Mask

    def settled_by(self, whole: Peaks) -> Peaks:
        """Return these where they are settled, else those of the whole lines."""
        peaks: Peaks = dr.select(self.settled, self, whole)
        dr.eval(peaks)
        return peaks


def find_peaks(
    signal: Signal,
    sensor: PositionSensor,
    processing: Processing,
    dwell: float,
    spot: ExpectedSpot | None = None,
    theta: Float = 0.0,
    bias: Bias | None = None,
    speckle: ExpectedSpeckle | None = None,
    noise: NoisePeak | None = None,
) -> Peaks:
    """Find the peak of every line.

    Parameters
    ----------
    signal
        Digitised lines of m shots.
    sensor
        The sensor whose calibration (gain, bias, dark charge, noise) is known.
    processing
        Estimator and thresholds.
    dwell
        Time spent on a shot [s].
    spot
        The spot that the laser makes on the line. Where nothing is known of it there is nothing to validate:
        the brightest pixel wins and the line is taken to be dark beside it.
    theta
        Deflections Θ [rad], Dr.Jit, shape (m,) or one number.
    bias
        Systematic error of the estimator, to be taken off; needs ``spot``.
    speckle
        What is known of the laser's speckle; needs ``spot``. Without it the light is taken to have none.
    noise
        What is known of the pixels that were not exposed, where that is a window only.

    Returns
    -------
    Peaks
    """
    line = Line(signal, SensorCalibration.of(sensor, dwell, signal.laser_off))
    sine, cosine = dr.sincos(auto.Float(theta))
    settings = processing.validation
    guard, limits = auto.Int32(0), None
    if spot is not None and settings.background:
        limits, away = limits_of(spot, processing, line.floor_sigma, cosine)
        found = spot_pixel(line, away, limits, gate_of(spot, processing, sine, cosine))
        guard = guard_pixels(spot, found.pixel, sine, cosine)
        baseline = baseline_beside(line, found.pixel, guard)
    else:
        found, baseline = brightest_pixel(line), no_baseline()
        if spot is not None:
            guard = guard_pixels(spot, found.pixel, sine, cosine)
    top = Around(line, found.pixel, baseline)
    height, whole_variance = top(0)
    dark_sigma = dr.sqrt(line.variance(found.pixel, baseline.level))
    threshold = dr.opaque(auto.Float, processing.threshold)
    low = ~(height > threshold * dark_sigma) | ~(found.level > SIDE_THRESHOLD * threshold)
    low |= line.window.first > line.window.last

    margin = MARGIN[processing.peak]
    inside = (found.pixel >= margin) & (found.pixel < line.pixels - margin)
    centre = dr.clip(found.pixel, margin, line.pixels - 1 - margin)

    def fit() -> _Fit:
        around = Around(line, centre, baseline)
        width = spot_speckle = None
        if spot is not None and speckle is not None:
            spot_speckle = speckle.about(spot, centre, sine, cosine)
        if spot is not None:
            width = Width.of(spot, centre, guard, (sine, cosine), settings.beam_width, farthest_pixel(spot))
        estimated = estimate(processing.peak, around, width, bias, spot_speckle)
        fitted = _Fit(
            estimated.shift,
            estimated.variance,
            estimated.within,
            estimated.converged,
            top.full(0),
            dr.zeros(auto.Float, line.shots),
        )
        if spot is not None:
            shape = judge_shape(top, spot, guard, sine, cosine, settings, spot_speckle)
            fitted.saturated |= shape.saturated
            fitted.charge = shape.charge
            if settings.shape:
                fitted.fits &= shape.fits
            fitted.variance += dr.square(dr.opaque(auto.Float, settings.misfit) * shape.misfit)
        return fitted

    # Of what is too low nothing is reported that the fit finds.
    fitted = dr.if_stmt((), ~low, fit, lambda: _Fit.none(line.shots))
    rivalled = found.rival > dr.opaque(auto.Float, processing.ambiguity) * found.height
    too_bright = glossy = auto.Bool(False)
    if spot is not None and settings.max_reflectance is not None:
        white = white_charge(spot, auto.Float(found.pixel), sine, cosine)
        too_bright = fitted.charge > dr.opaque(auto.Float, settings.max_reflectance) * white
        # What is brighter than white may be gloss or a glint: any other peak makes it doubtful.
        glossy = fitted.charge > _GLOSS_LIMIT * white
    status = auto.UInt32(Status.VALID)
    for failed, code in (
        ((rivalled | glossy) & (found.rival_level > threshold), Status.AMBIGUOUS),
        (too_bright, Status.BAD_AMPLITUDE),
        (~inside | ~fitted.within, Status.OUT_OF_ARRAY),
        (inside & ~fitted.fits, Status.BAD_SHAPE),
        (fitted.saturated, Status.SATURATED),
        (low, Status.BELOW_THRESHOLD),
        (low & found.broad, Status.BAD_SHAPE),
        (low & found.refused, Status.BAD_AMPLITUDE),
        (low & (found.brightest + line.known.dark >= line.known.full), Status.SATURATED),
    ):
        status = dr.select(failed, auto.UInt32(int(code)), status)
    valid = status == int(Status.VALID)
    total, total_variance = sum_signal(top)
    settled = dr.full(auto.Bool, True, line.shots)
    if noise is not None and limits is not None and spot is not None:
        reach = dr.maximum(guard + SIDE, max(farthest_pixel(spot), *MARGIN.values()))
        read = dr.minimum(found.pixel, centre) - reach, dr.maximum(found.pixel, centre) + reach
        rivals = threshold, dr.opaque(auto.Float, processing.ambiguity)
        settled = noise.settles(line, found, limits, away, read, rivals, glossy & ~low)
    peaks = Peaks(
        position=dr.select(valid, auto.Float(centre) + fitted.shift, dr.nan),
        sigma=dr.select(valid, dr.sqrt(fitted.variance), dr.nan),
        signal=dr.select(low, 0.0, total),
        sigma_signal=dr.sqrt(dr.maximum(total_variance, 1.0)),
        background=dr.select(low, 0.0, baseline.level),
        snr=height / dr.sqrt(dr.maximum(whole_variance, 1.0)),
        status=status,
        settled=settled,
    )
    dr.eval(peaks)
    return peaks


@dataclass
class _Fit:
    """What the fits to peaks tell, Dr.Jit arrays of shape (m,): of :class:`PeakEstimate` and of :class:`SpotFit`."""

    shift: Float
    variance: Float
    within: Mask
    fits: Mask
    saturated: Mask
    charge: Float

    @classmethod
    def none(cls, shots: int) -> _Fit:
        """Return that of lines without a peak."""
        nothing, no = dr.zeros(auto.Float, shots), dr.zeros(auto.Bool, shots)
        return cls(nothing, nothing, no, no, no, nothing)


def sum_signal(around: Around) -> tuple[Float, Float]:
    """Return the charge around the brightest pixel, and its variance by noise and by the light beneath it.

    An edge of the background beneath or beside the peak bends it away from the straight baseline. The outermost pixels,
    which the peak itself hardly reaches, show it: by the mean m of both the background beneath is wrong as a whole,
    though by no more than there is; and where they differ by 2h, an edge lies anywhere between them, which makes the
    whole wrong by up to h, h/√3 rms.
    """
    total, variance, pixels = auto.Float(0.0), auto.Float(0.0), auto.Float(0.0)
    for step in range(-_SIGNAL_PIXELS, _SIGNAL_PIXELS + 1):
        inside, (charge, noise) = around.inside(step), around(step)
        total += dr.select(inside, charge, 0.0)
        variance += dr.select(inside, noise, 0.0)
        pixels += dr.select(inside, 1.0, 0.0)
    baseline = around.baseline
    (left, left_noise), (right, right_noise) = (around(step) for step in (-_SIGNAL_PIXELS, _SIGNAL_PIXELS))
    chance = 0.25 * (left_noise + right_noise) + baseline.level_variance
    whole = dr.minimum(0.5 * dr.abs(left + right), dr.abs(baseline.level))
    apart = 0.5 * (right - left) + _SIGNAL_PIXELS * baseline.slope
    beneath = baseline.level_variance + dr.maximum(dr.square(whole) - EVEN * chance, 0.0)
    beneath += dr.maximum(dr.square(apart) - EVEN * chance, 0.0) / 3.0
    return total, variance + dr.square(pixels) * beneath


def faintest_signal(
    sigma_signal: NDArray[np.float64], width: NDArray[np.float64], processing: Processing
) -> NDArray[np.float64]:
    """Return the charge of the faintest spots that are found [electron], where nothing is.

    A spot of standard deviation s in the middle of a pixel has erf(1/(2√2 s)) of its charge there, which must reach the
    threshold. The pixel's σ is known from that of the sum over nine, of variance 9 + 81 V: they are summed above a
    baseline, the mean of the medians of both sides, of the variance V = 0.2104/2.

    Parameters
    ----------
    sigma_signal
        Standard deviation of the signal where there is no light (:attr:`Peaks.sigma_signal`) [electron], any shape.
    width
        s [pixel], of a shape that goes with it.
    processing
        Threshold, and whether there is a baseline.
    """
    pixels = 2 * _SIGNAL_PIXELS + 1
    summed = pixels + (0.5 * MEDIAN_VARIANCE * pixels**2 if processing.validation.background else 0.0)
    share = erf(np.sqrt(0.125) / width)
    return np.asarray(processing.threshold / np.sqrt(summed) * sigma_signal / share)
