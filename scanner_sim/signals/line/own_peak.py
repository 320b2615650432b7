"""The user's estimator of the peak: what it is given of lines, and what the instrument adds to what it returns."""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.line.exposure import Signal
from scanner_sim.detector.line.position_sensor import PositionSensor
from scanner_sim.detector.packets import mode_edges
from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_types import Float
from scanner_sim.foundation.status import Status
from scanner_sim.signals.line.calibration import SensorCalibration, measured_charges
from scanner_sim.signals.line.digital_line import Around, Line, baseline_beside, no_baseline
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.peaks import Peaks, sum_signal
from scanner_sim.signals.line.speckle import ExpectedSpeckle
from scanner_sim.signals.line.validation import guard_pixels
from scanner_sim.signals.own import Function, estimated, refuse, row_sums
from scanner_sim.signals.processing import Processing

Array = NDArray[np.float64]

_TOGETHER = 4096
"""Lines that a function is given at once: bounds the memory."""


@dataclass(frozen=True, eq=False)
class KnownLines:
    """What an instrument knows of n lines beside their charges; nothing of it is the truth.

    Attributes
    ----------
    gain
        Electrons of one digital number.
    read_noise, dark
        Standard deviation of the read noise and mean dark charge [electron]; the dark charge is taken off the lines.
    pitch
        Distance of two pixels [m].
    threshold
        Of the scenario, in standard deviations of a pixel without light.
    theta
        Commanded deflections Θ [rad], shape (n,).
    variance
        Of each pixel's charge by noise, at the charge that was measured [electron²], shape (n, pixels).
    saturated
        Which pixels are full, shape (n, pixels).
    spot, speckle
        The spot that the laser makes, and its speckle: for the methods.
    """

    gain: float
    read_noise: float
    dark: float
    pitch: float
    threshold: float
    theta: Array
    variance: Array
    saturated: NDArray[np.bool_]
    spot: ExpectedSpot
    speckle: ExpectedSpeckle | None

    def spot_sigma(self, position: Array) -> Array:
        """Return the expected standard deviation of spots at positions [pixel], shape (n,), without the pixel's width.

        It is that on a surface which faces the scanner; a tilted one makes it wider or narrower.
        """
        beam, spread = self.spot.variances(np.maximum(position, 0.0), np.sin(self.theta), np.cos(self.theta))
        return np.asarray(np.sqrt(beam + spread))

    def position_sigma(self, gradient: Array, position: Array, charge: Array) -> Array:
        """Return σ of positions [pixel] to first order: noise of each pixel and speckle, with its covariance.

        Parameters
        ----------
        gradient
            Derivative of each position by the charge of each pixel [pixel/electron], shape (n, pixels).
        position
            The positions [pixel], shape (n,); NaN for none.
        charge
            Charge of each whole spot [electron], shape (n,).
        """
        variance = row_sums(gradient**2 * self.variance)
        if self.speckle is not None:
            variance = variance + charge**2 * self._by_speckle(gradient, position)
        return np.asarray(np.sqrt(variance))

    def _by_speckle(self, gradient: Array, position: Array) -> Array:
        """Return the variance by speckle for spots of charge 1, the sum of ``SpotSpeckle.propagated_variance``."""
        assert self.speckle is not None
        found = np.isfinite(position)
        place = np.where(found, position, 0.0)
        theta = auto.Float(for_device(self.theta))
        sine, cosine = dr.sincos(theta)
        known = self.speckle.about(self.spot, auto.Int32(for_device(np.rint(place), np.int32)), sine, cosine)
        energy, others, sigma, *ratios = (
            np.broadcast_to(np.asarray(part.numpy(), dtype=np.float64), place.shape)
            for part in (known.energy, known.others, known.packets.sigma, *known.ratios)
        )
        (used,) = np.nonzero((gradient != 0.0).any(axis=0))
        if not used.size:
            return np.where(found, 0.0, np.nan)
        first, last = int(used[0]), int(used[-1])
        edges = np.arange(first, last + 2) - 0.5
        modes = mode_edges([ratio[:, None] for ratio in ratios], (edges - place[:, None]) / sigma[:, None])
        moved = [row_sums(gradient[:, first : last + 1] * np.diff(mode, axis=1)) for mode in modes]
        return np.where(found, energy * moved[0] ** 2 + others * sum(one**2 for one in moved[1:]), np.nan)


def find_own_peaks(
    function: Function,
    signal: Signal,
    sensor: PositionSensor,
    processing: Processing,
    dwell: float,
    spot: ExpectedSpot,
    theta: Float,
    speckle: ExpectedSpeckle | None,
) -> Peaks:
    """Return the peaks of lines by a function of the user's; arguments as of :func:`~.peaks.find_peaks`.

    Positions, σ and status are the function's. Light, background and their σ are the instrument's, about the brightest
    of the three pixels at each position, or of the whole line where there is none.

    Raises
    ------
    InputError
        If the function fails or returns what is no such thing; see :func:`~scanner_sim.signals.own.estimated`.
    """
    calibration = SensorCalibration.of(sensor, dwell, signal.laser_off)
    theta = auto.Float(theta) + dr.zeros(auto.Float, signal.shots)
    numbers = [signal.lines(exposure) for exposure in range(signal.exposures)]
    parts = []
    for first in range(0, signal.shots, _TOGETHER):
        rows = slice(first, first + _TOGETHER)
        charge, sigma = measured_charges([part[rows] for part in numbers], calibration)
        known = KnownLines(
            gain=calibration.gain,
            read_noise=sensor.read_noise if sensor.noise.read else 0.0,
            dark=calibration.dark,
            pitch=sensor.pitch,
            threshold=processing.threshold,
            theta=theta.numpy()[rows].astype(np.float64),
            variance=sigma**2,
            saturated=_full([part[rows] for part in numbers], calibration),
            spot=spot,
            speckle=None if speckle is None else _of_rows(speckle, rows, signal.shots),
        )
        place, error, status = estimated(processing.peak, function, len(charge), charge.copy(), known)
        valid = status == Status.VALID
        outside = valid & ~((place >= -0.5) & (place <= sensor.pixels - 0.5))
        refuse(processing.peak, outside, f"valid positions outside of the line, 0 to {sensor.pixels - 1}")
        parts.append((place, error, status, _brightest(charge, place)))
    place, error, status, pixel = (np.concatenate(column) for column in zip(*parts, strict=True))
    line, centre = Line(signal, calibration), auto.Int32(for_device(pixel, np.int32))
    sine, cosine = dr.sincos(theta)
    baseline = no_baseline()
    if processing.validation.background:
        baseline = baseline_beside(line, centre, guard_pixels(spot, centre, sine, cosine))
    around = Around(line, centre, baseline)
    height, variance = around(0)
    total, total_variance = sum_signal(around)
    code = auto.UInt32(for_device(status, np.uint32))
    low = code == int(Status.BELOW_THRESHOLD)
    peaks = Peaks(
        position=auto.Float(for_device(place)),
        sigma=auto.Float(for_device(error)),
        signal=dr.select(low, 0.0, total),
        sigma_signal=dr.sqrt(dr.maximum(total_variance, 1.0)),
        background=dr.select(low, 0.0, baseline.level),
        snr=height / dr.sqrt(dr.maximum(variance, 1.0)),
        status=code,
        settled=dr.full(auto.Bool, True, signal.shots),
    )
    dr.eval(peaks)
    return peaks


def _of_rows(speckle: ExpectedSpeckle, rows: slice, shots: int) -> ExpectedSpeckle:
    """Return what is known of the speckle of some of m shots."""
    along, across = (
        way if isinstance(way, float) else auto.Float(for_device(np.broadcast_to(way.numpy(), shots)[rows]))
        for way in speckle.travel
    )
    return replace(speckle, travel=(along, across))


def _full(numbers: list[NDArray[np.float32]], calibration: SensorCalibration) -> NDArray[np.bool_]:
    """Return which pixels are full in an exposure, shape (m, pixels)."""
    fullest = np.maximum.reduce(numbers).astype(np.float64)
    return np.asarray(calibration.charge(fullest) + calibration.dark >= calibration.full)


def _brightest(charge: Array, place: Array) -> NDArray[np.int64]:
    """Return the brightest pixel of the three at each position, or of the whole line, shape (m,)."""
    last = charge.shape[1] - 1
    found = np.isfinite(place)
    near = np.clip(np.rint(np.where(found, place, 0.0)).astype(np.int64)[:, None] + [-1, 0, 1], 0, last)
    rows = np.arange(len(charge))
    chosen = near[rows, charge[rows[:, None], near].argmax(axis=1)]
    return np.asarray(np.where(found, chosen, charge.argmax(axis=1)))
