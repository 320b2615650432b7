"""Lines of charge: what the digital numbers of the sensor say, pixel by pixel, with their variances."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.detector.line import Signal
from scanner_sim.detector.position_sensor import PositionSensor

_NEAR_FULL = 5.0
"""Standard deviations of the read noise below the full well from which a pixel counts as saturated."""
_MEDIAN_VARIANCE = 0.2104
"""Variance of the median of seven standard normal numbers (David, Nagaraja, *Order statistics*, 2003)."""
SIDE = 7
"""Pixels on each side of a peak that tell its background."""


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


class Line:
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

    def pair(self, pixel: Any) -> tuple[Any, Any]:
        """Return the charges of an even pixel and of the next: faster than one by one."""
        address = self._signal.address(auto.UInt32(pixel), self._shot)
        numbers = dr.gather(auto.Array2f, self._signal.number, address // 2)
        return self.known.charge(numbers[0]), self.known.charge(numbers[1])

    def variance(self, charge: Any) -> Any:
        """Return the variance [electron²] of a pixel that holds a charge."""
        return self.known.variance(charge)


@dataclass
class Baseline:
    """The light beneath a peak, a straight line in the distance from a pixel, with the variances of its two terms.

    Dr.Jit arrays of shape (m,): ``level`` [electron], ``slope`` [electron/pixel], their variances, and ``doubt``, by
    how much the level may be wrong where the light has an edge beneath the peak [electron]: half the difference
    of the two sides.
    """

    level: Any
    slope: Any
    level_variance: Any
    slope_variance: Any
    doubt: Any


def no_baseline() -> Baseline:
    """Return the baseline of a line without any light but the peak's."""
    return Baseline(*(auto.Float(0.0) for _ in range(5)))


def baseline_beside(line: Line, centre: Any, guard: Any) -> Baseline:
    """Return the straight line through the medians of seven pixels on either side of a peak.

    Parameters
    ----------
    line
        The lines.
    centre
        Brightest pixel of each peak, Dr.Jit signed, shape (m,).
    guard
        Pixels to each side that the peak covers and that are left out, shape (m,).

    Returns
    -------
    Baseline
        Where the array ends on one side, the other side's median alone, without a slope; where it ends on
        both, none. The variances are those of medians of normal noise.
    """
    sides, inside = [], []
    for direction in (-1, 1):
        nearest = centre + direction * (guard + 1)
        farthest = nearest + direction * (SIDE - 1)
        inside.append((farthest >= 0) & (farthest < line.pixels))
        start = dr.select(inside[-1], nearest, centre)
        step = dr.select(inside[-1], direction, 0)
        sides.append(_median([line.charge(start + number * step) for number in range(SIDE)]))
    (left, right), (on_left, on_right) = sides, inside
    both = on_left & on_right
    distance = auto.Float(guard) + 0.5 * (SIDE + 1)
    noise = [_MEDIAN_VARIANCE * line.variance(side) for side in sides]
    one = dr.select(on_left, left, dr.select(on_right, right, 0.0))
    one_noise = dr.select(on_left, noise[0], dr.select(on_right, noise[1], 0.0))
    return Baseline(
        dr.select(both, 0.5 * (left + right), one),
        dr.select(both, 0.5 * (right - left) / distance, 0.0),
        dr.select(both, 0.25 * (noise[0] + noise[1]), one_noise),
        dr.select(both, 0.25 * (noise[0] + noise[1]) / dr.square(distance), 0.0),
        dr.select(both, 0.5 * dr.abs(right - left), 0.0),
    )


def _median(values: list[Any]) -> Any:
    """Return the median of an odd number of values: the ends are sorted away two by two."""
    values = list(values)
    while len(values) > 1:
        for place in range(len(values) - 1):
            low, high = values[place], values[place + 1]
            values[place], values[place + 1] = dr.minimum(low, high), dr.maximum(low, high)
        values.pop()
        for place in range(len(values) - 1, 0, -1):
            low, high = values[place - 1], values[place]
            values[place - 1], values[place] = dr.minimum(low, high), dr.maximum(low, high)
        values.pop(0)
    return values[0]


class Around:
    """Charges about the brightest pixel of each peak, above a baseline; called with a step in pixels."""

    def __init__(self, line: Line, centre: Any, baseline: Baseline) -> None:
        self.line, self.centre, self.baseline = line, centre, baseline
        self.floor_sigma = line.floor_sigma

    def raw(self, step: int) -> Any:
        """Return the charge above the dark level; beyond the array's ends that of its last pixel."""
        return self.line.charge(dr.clip(self.centre + step, 0, self.line.pixels - 1))

    def inside(self, step: int) -> Any:
        """Tell where a pixel lies on the array."""
        pixel = self.centre + step
        return (pixel >= 0) & (pixel < self.line.pixels)

    def __call__(self, step: int) -> tuple[Any, Any]:
        """Return the charge above the baseline, and the variance of the whole charge."""
        raw = self.raw(step)
        return raw - (self.baseline.level + step * self.baseline.slope), self.line.variance(raw)
