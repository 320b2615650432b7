"""Peaks: from a digitised line to the sub-pixel position of the spot, with its σ.

With i the brightest pixel and f the line in electrons:

* ``centre_of_mass``: Σ j f_j / Σ f_j over i − 3 … i + 3;
* ``parabola``: vertex of the parabola through three pixels;
* ``gaussian``: the same on the logarithms, exact for a sampled Gaussian;
* ``blais_rioux_2``, ``_4``, ``_8``: zero crossing of g_h(i) = Σ_{k=1..h} f(i − k) − f(i + k), h = 1, 2, 4
  (Blais, Rioux, *Signal Processing* 11, 1986).

σ is the first-order propagation of each pixel's variance, taken from the noise model at the measured charge,
through the estimator's derivatives.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.detector.line import Signal
from scanner_sim.detector.position_sensor import PositionSensor
from scanner_sim.signals.processing import PeakMethod, Processing
from scanner_sim.status import Status

MARGIN: dict[PeakMethod, int] = {
    "centre_of_mass": 3,
    "parabola": 1,
    "gaussian": 1,
    "blais_rioux_2": 2,
    "blais_rioux_4": 3,
    "blais_rioux_8": 5,
}
"""Pixels to each side of the brightest one that an estimator reads."""
_SEPARATE = 6
"""Pixels beyond which a second maximum counts as a peak of its own."""
_UNROLLED = 8
"""Pixels that one turn of a loop looks at."""
_SUMMED = 4
"""Pixels to each side of the brightest one whose charge is the peak's signal."""
_NEAR_FULL = 5.0
"""Standard deviations of the read noise below the full well from which a pixel counts as saturated."""


@dataclass
class Peaks:
    """Peaks of a group of shots, Dr.Jit arrays of shape (m,).

    ``position`` and ``sigma`` [pixel], NaN where ``status`` is not 0; ``signal`` charge of the peak summed over
    nine pixels [electron]; ``snr`` charge of the brightest pixel over its standard deviation; ``status`` code.
    """

    position: Any
    sigma: Any
    signal: Any
    snr: Any
    status: Any


@dataclass(frozen=True)
class Calibration:
    """What is known of the sensor: how a number becomes a charge, and the variance of a charge.

    The methods take numbers, NumPy or Dr.Jit arrays.

    Attributes
    ----------
    bias, gain
        Digital number without charge, and electrons per digital number.
    dark
        Mean dark charge of a dwell [electron].
    floor
        Variance of a pixel without light [electron²].
    shot_noise
        1 if light has Poisson noise, else 0.
    prnu
        Relative standard deviation of the pixels' response.
    full
        Charge in the well [electron] from which a pixel counts as saturated.
    """

    bias: float
    gain: float
    dark: float
    floor: float
    shot_noise: float
    prnu: float
    full: float

    @classmethod
    def of(cls, sensor: PositionSensor, dwell: float) -> Calibration:
        """Return the calibration of a sensor that is exposed for a dwell [s]."""
        switches, gain = sensor.noise, sensor.electrons_per_number
        read = sensor.read_noise if switches.read else 0.0
        dark = sensor.dark_current * dwell if switches.dark else 0.0
        steps = gain**2 / 12.0 if switches.quantisation else 0.0
        well = min(sensor.full_well, (sensor.largest_number - sensor.bias) * gain)
        return cls(
            bias=float(sensor.bias),
            gain=gain,
            dark=dark,
            floor=read**2 + steps + (dark if switches.shot else 0.0),
            shot_noise=float(switches.shot),
            prnu=sensor.prnu if switches.prnu else 0.0,
            full=well - _NEAR_FULL * read if switches.saturation else float("inf"),
        )

    @property
    def floor_sigma(self) -> float:
        """Standard deviation of a pixel without light [electron]."""
        return float(self.floor**0.5)

    def charge(self, number: Any) -> Any:
        """Return the charge above the dark level [electron] of a digital number."""
        return (number - self.bias) * self.gain - self.dark

    def variance(self, charge: Any) -> Any:
        """Return the variance [electron²] of a pixel with a charge above the dark level [electron]."""
        light = (charge + abs(charge)) * 0.5
        return self.floor + self.shot_noise * light + (self.prnu * light) ** 2


class _Line:
    """Reads charges of one line per lane."""

    def __init__(self, signal: Signal, calibration: Calibration) -> None:
        self.pixels, self.shots = signal.pixels, signal.shots
        self._signal = signal
        self._shot = dr.arange(auto.UInt32, signal.shots)
        values: dict[str, Any] = {
            field.name: dr.opaque(auto.Float, getattr(calibration, field.name))
            for field in fields(calibration)
        }
        self.known = Calibration(**values)
        self.floor_sigma: Any = dr.opaque(auto.Float, calibration.floor_sigma)

    def charge(self, pixel: Any) -> Any:
        """Return the charge above the dark level [electron]."""
        address = self._signal.address(auto.UInt32(pixel), self._shot)
        return self.known.charge(dr.gather(auto.Float, self._signal.number, address))

    def variance(self, charge: Any) -> Any:
        """Return the variance [electron²] of a pixel that holds a charge."""
        return self.known.variance(charge)


def find_peaks(signal: Signal, sensor: PositionSensor, processing: Processing, dwell: float) -> Peaks:
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
        Time of exposure [s].

    Returns
    -------
    Peaks
    """
    line = _Line(signal, Calibration.of(sensor, dwell))
    brightest, height = _brightest(line)
    second = _second_peak(line, brightest)
    threshold = dr.opaque(auto.Float, processing.threshold) * line.floor_sigma
    margin = MARGIN[processing.peak]
    inside = (brightest >= margin) & (brightest < line.pixels - margin)
    centre = dr.clip(auto.Int32(brightest), margin, line.pixels - 1 - margin)
    shift, variance = _ESTIMATORS[processing.peak](line, centre)
    status = auto.UInt32(Status.VALID)
    for failed, code in (
        ((second > threshold) & (second > processing.ambiguity * height), Status.AMBIGUOUS),
        (~inside | ~(dr.abs(shift) <= margin), Status.OUT_OF_ARRAY),
        (height + line.known.dark >= line.known.full, Status.SATURATED),
        (~(height > threshold), Status.BELOW_THRESHOLD),
    ):
        status = dr.select(failed, auto.UInt32(int(code)), status)
    valid = status == int(Status.VALID)
    detected = status != int(Status.BELOW_THRESHOLD)
    peaks = Peaks(
        position=dr.select(valid, auto.Float(centre) + shift, dr.nan),
        sigma=dr.select(valid, dr.sqrt(variance), dr.nan),
        signal=dr.select(detected, _summed(line, brightest), 0.0),
        snr=height / dr.sqrt(dr.maximum(line.variance(height), 1.0)),
        status=status,
    )
    dr.eval(peaks)
    return peaks


def _brightest(line: _Line) -> tuple[Any, Any]:
    """Return number and charge of the brightest pixel of each line (the first of equals)."""

    def compare(pixel: Any, best: Any, height: Any) -> tuple[Any, Any, Any]:
        for step in range(_UNROLLED):
            here = dr.minimum(pixel + step, line.pixels - 1)
            charge = line.charge(here)
            higher = charge > height
            best, height = dr.select(higher, here, best), dr.select(higher, charge, height)
        return pixel + _UNROLLED, best, height

    start = (auto.UInt32(0), dr.zeros(auto.UInt32, line.shots), dr.full(auto.Float, -dr.inf, line.shots))
    _, best, height = dr.while_loop(start, lambda pixel, best, height: pixel < line.pixels, compare)
    return best, height


def _second_peak(line: _Line, brightest: Any) -> Any:
    """Return the charge of the brightest pixel that is no part of the first peak."""

    def compare(pixel: Any, height: Any) -> tuple[Any, Any]:
        for step in range(_UNROLLED):
            here = dr.minimum(pixel + step, line.pixels - 1)
            apart = dr.abs(auto.Int32(here) - auto.Int32(brightest)) > _SEPARATE
            height = dr.select(apart, dr.maximum(height, line.charge(here)), height)
        return pixel + _UNROLLED, height

    start = (auto.UInt32(0), dr.full(auto.Float, -dr.inf, line.shots))
    return dr.while_loop(start, lambda pixel, height: pixel < line.pixels, compare)[1]


def _summed(line: _Line, brightest: Any) -> Any:
    """Return the charge around the brightest pixel."""
    total = auto.Float(0.0)
    for step in range(-_SUMMED, _SUMMED + 1):
        pixel = auto.Int32(brightest) + step
        inside = (pixel >= 0) & (pixel < line.pixels)
        total += dr.select(inside, line.charge(dr.clip(pixel, 0, line.pixels - 1)), 0.0)
    return total


def _centre_of_mass(line: _Line, centre: Any) -> tuple[Any, Any]:
    reach = MARGIN["centre_of_mass"]
    charges = [line.charge(centre + step) for step in range(-reach, reach + 1)]
    total, moment = auto.Float(0.0), auto.Float(0.0)
    for step, charge in enumerate(charges, -reach):
        total += charge
        moment += step * charge
    shift, variance = moment / total, auto.Float(0.0)
    for step, charge in enumerate(charges, -reach):
        variance += dr.square((step - shift) / total) * line.variance(charge)
    return shift, variance


def _vertex(left: Any, middle: Any, right: Any) -> tuple[Any, Any, Any, Any]:
    """Return the vertex of a parabola through three points and its derivatives by them."""
    bend = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / bend
    return shift, (1.0 - 2.0 * shift) / (2.0 * bend), 2.0 * shift / bend, -(1.0 + 2.0 * shift) / (2.0 * bend)


def _parabola(line: _Line, centre: Any) -> tuple[Any, Any]:
    charges = [line.charge(centre + step) for step in (-1, 0, 1)]
    shift, *slopes = _vertex(*charges)
    variance = auto.Float(0.0)
    for slope, charge in zip(slopes, charges, strict=True):
        variance += dr.square(slope) * line.variance(charge)
    return shift, variance


def _gaussian(line: _Line, centre: Any) -> tuple[Any, Any]:
    """Return the vertex on logarithms; a pixel at or below the noise floor counts as half the floor."""
    measured = [line.charge(centre + step) for step in (-1, 0, 1)]
    charges = [dr.maximum(charge, dr.maximum(0.5 * line.floor_sigma, 1e-3)) for charge in measured]
    shift, *slopes = _vertex(*(dr.log(charge) for charge in charges))
    variance = auto.Float(0.0)
    for slope, charge in zip(slopes, charges, strict=True):
        variance += dr.square(slope / charge) * line.variance(charge)
    return shift, variance


def _blais_rioux(half: int) -> Any:
    """Return the estimator of Blais and Rioux with ``2 half`` filter taps."""

    def estimate(line: _Line, centre: Any) -> tuple[Any, Any]:
        reach = half + 1
        charges = {step: line.charge(centre + step) for step in range(-reach, reach + 1)}

        def response(at: int) -> Any:
            total = auto.Float(0.0)
            for step in range(1, half + 1):
                total += charges[at - step] - charges[at + step]
            return total

        before, here, after = response(-1), response(0), response(1)
        # g rises through zero at the peak: to the right of the centre where it is still negative there.
        right = here < 0.0
        low, high = dr.select(right, here, before), dr.select(right, after, here)
        rise = high - low
        shift = dr.select(right, 0.0, -1.0) - low / rise
        by_low, by_high = -high / dr.square(rise), low / dr.square(rise)
        variance = auto.Float(0.0)
        for step, charge in charges.items():
            taps = [_tap(step - at, half) for at in (-1, 0, 1)]
            slope = dr.select(
                right, by_low * taps[1] + by_high * taps[2], by_low * taps[0] + by_high * taps[1]
            )
            variance += dr.square(slope) * line.variance(charge)
        return shift, variance

    return estimate


def _tap(distance: int, half: int) -> float:
    """Return the weight of a pixel in g_h at a distance from its centre."""
    if distance == 0 or abs(distance) > half:
        return 0.0
    return 1.0 if distance < 0 else -1.0


_ESTIMATORS: dict[PeakMethod, Any] = {
    "centre_of_mass": _centre_of_mass,
    "parabola": _parabola,
    "gaussian": _gaussian,
    "blais_rioux_2": _blais_rioux(1),
    "blais_rioux_4": _blais_rioux(2),
    "blais_rioux_8": _blais_rioux(4),
}
