"""Lines of charge, pixel by pixel with their variances, and the light beneath a peak."""

from __future__ import annotations

from dataclasses import dataclass, fields

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.detector.line.exposure import Signal, Window
from scanner_sim.foundation.device_types import Float, Int32, Mask, UInt32
from scanner_sim.signals.line.calibration import SensorCalibration

MEDIAN_VARIANCE = 0.2104
"""Variance of the median of seven standard normal numbers (David, Nagaraja, *Order statistics*, 2003)."""
EVEN = 9.0
"""Squared difference of the baseline's two sides, over its variance, that counts as none: noise hardly exceeds it."""
SIDE = 7
"""Pixels on each side of a peak from which its background is estimated."""


class Line:
    """Reads charges of one line per lane, within the window that was exposed."""

    def __init__(self, signal: Signal, calibration: SensorCalibration) -> None:
        self.pixels, self.shots = signal.pixels, signal.shots
        self.subtracted = signal.exposures == 2
        self.window = Window.whole(signal.shots, signal.pixels) if signal.window is None else signal.window
        self._signal = signal
        self._shot = dr.arange(auto.UInt32, signal.shots)
        values: dict[str, Float] = {
            field.name: dr.opaque(auto.Float, getattr(calibration, field.name))
            for field in fields(calibration)
        }
        self.known = SensorCalibration(**values)
        self.floor_sigma: Float = dr.opaque(auto.Float, calibration.floor_sigma)

    def charge(self, pixel: Int32) -> Float:
        """Return the charge above the dark level and above what was subtracted [electron]."""
        lit, unlit = self._numbers(pixel)
        return self._difference(lit, unlit) if self.subtracted else self.known.charge(lit)

    def pair(self, pixel: UInt32) -> tuple[Float, Float, Float]:
        """Return the charges of an even pixel and of the next, faster than one by one, and the fuller one's well.

        The well is the largest charge of an exposure above the dark level [electron].
        """
        index = self._signal.pair(auto.UInt32(pixel), self._shot)
        if not self.subtracted:
            numbers = dr.gather(auto.Array2f, self._signal.number, index)
            charges = self.known.charge(numbers[0]), self.known.charge(numbers[1])
            return *charges, dr.maximum(*charges)
        both = dr.gather(auto.Array4f, self._signal.number, index)
        fullest = self.known.charge(dr.max(both))
        return self._difference(both[0], both[2]), self._difference(both[1], both[3]), fullest

    def variance(self, pixel: Int32, charge: Float) -> Float:
        """Return the variance [electron²] of a pixel if it holds a charge above what was subtracted."""
        if not self.subtracted:
            return self.known.variance(charge)
        return self.known.variance_above(self.known.ambient(self._numbers(pixel)[1]), charge)

    def full(self, pixel: Int32) -> Mask:
        """Return whether a pixel is saturated in an exposure."""
        lit, unlit = self._numbers(pixel)
        return self._is_full(dr.maximum(lit, unlit) if self.subtracted else lit)

    def beneath(self, pixel: Int32, charge: Float, side: Float, active: Mask) -> tuple[Float, Mask]:
        """Return the variance of a peak's pixel without the peak, and whether it is full.

        Parameters
        ----------
        pixel, charge
            Pixel of a maximum and its charge [electron].
        side
            Charge beside the maximum [electron].
        active
            Where it is one: elsewhere nothing is read.
        """
        if not self.subtracted:
            return self.known.variance(side), charge >= self.known.full - self.known.dark
        lit, unlit = self._numbers(pixel, active)
        variance = self.known.variance_above(self.known.ambient(unlit), side)
        return variance, self._is_full(dr.maximum(lit, unlit))

    def _numbers(self, pixel: Int32, active: Mask = True) -> tuple[Float, Float]:
        """Return the digital numbers with and without the laser; the first twice where there is one exposure."""
        address = self._signal.address(auto.UInt32(pixel), self._shot)
        lit = dr.gather(auto.Float, self._signal.number, address, active)
        if not self.subtracted:
            return lit, lit
        return lit, dr.gather(auto.Float, self._signal.number, address + 2, active)

    def _difference(self, lit: Float, unlit: Float) -> Float:
        """Return c; 0 where the background alone fills the pixel, so that nothing is known of the laser."""
        difference = self.known.charge(lit) - self.known.ambient(unlit)
        return dr.select(self._is_full(unlit), 0.0, difference)

    def _is_full(self, number: Float) -> Mask:
        return self.known.charge(number) + self.known.dark >= self.known.full


@dataclass
class Baseline:
    """The light beneath a peak, a straight line in the distance from a pixel, with the variances of its two terms.

    Dr.Jit arrays of shape (m,): ``level`` [electron], ``slope`` [electron/pixel], their variances, ``doubt``, by
    how much the level may be wrong where the light has an edge beneath the peak [electron]: half the difference
    of the two sides, and ``distance`` from the peak to the middle of each side [pixel].
    """

    level: Float
    slope: Float
    level_variance: Float
    slope_variance: Float
    doubt: Float
    distance: Float

    @property
    def step_squared(self) -> Float:
        """Squared difference of the two sides beyond what noise makes of even light [electron²]."""
        return dr.maximum(4.0 * (dr.square(self.doubt) - EVEN * self.level_variance), 0.0)


def no_baseline() -> Baseline:
    """Return the baseline of a line without any light but the peak's."""
    none = auto.Float(0.0)
    return Baseline(none, none, none, none, none, distance=auto.Float(1.0))


def baseline_beside(line: Line, centre: Int32, guard: Int32) -> Baseline:
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
    sides, inside, noise = [], [], []
    for direction in (-1, 1):
        nearest = centre + direction * (guard + 1)
        farthest = nearest + direction * (SIDE - 1)
        inside.append((farthest >= 0) & (farthest < line.pixels))
        start = dr.select(inside[-1], nearest, centre)
        step = dr.select(inside[-1], direction, 0)
        pixels = [start + number * step for number in range(SIDE)]
        sides.append(_median([line.charge(pixel) for pixel in pixels]))
        noise.append(MEDIAN_VARIANCE * _mean_variance(line, pixels, sides[-1]))
    (left, right), (on_left, on_right) = sides, inside
    both = on_left & on_right
    distance = auto.Float(guard) + 0.5 * (SIDE + 1)
    one = dr.select(on_left, left, dr.select(on_right, right, 0.0))
    one_noise = dr.select(on_left, noise[0], dr.select(on_right, noise[1], 0.0))
    return Baseline(
        dr.select(both, 0.5 * (left + right), one),
        dr.select(both, 0.5 * (right - left) / distance, 0.0),
        dr.select(both, 0.25 * (noise[0] + noise[1]), one_noise),
        dr.select(both, 0.25 * (noise[0] + noise[1]) / dr.square(distance), 0.0),
        dr.select(both, 0.5 * dr.abs(right - left), 0.0),
        distance,
    )


def _mean_variance(line: Line, pixels: list[Int32], charge: Float) -> Float:
    """Return the variance of pixels that hold a charge: their mean, where what was subtracted differs."""
    if not line.subtracted:
        return line.known.variance(charge)
    return sum(line.variance(pixel, charge) for pixel in pixels) / len(pixels)


def _median(values: list[Float]) -> Float:
    """Return the median of an odd number of values: the ends are sorted away two by two."""
    values = list(values)
    while len(values) > 1:
        for index in range(len(values) - 1):
            low, high = values[index], values[index + 1]
            values[index], values[index + 1] = dr.minimum(low, high), dr.maximum(low, high)
        values.pop()
        for index in range(len(values) - 1, 0, -1):
            low, high = values[index - 1], values[index]
            values[index - 1], values[index] = dr.minimum(low, high), dr.maximum(low, high)
        values.pop(0)
    return values[0]


class Around:
    """Charges about the brightest pixel of each peak, above a baseline; called with a step in pixels."""

    def __init__(self, line: Line, centre: Int32, baseline: Baseline) -> None:
        self.line, self.centre, self.baseline = line, centre, baseline
        self.floor_sigma = line.floor_sigma

    def pixel(self, step: Int32) -> Int32:
        """Return the pixel at a step; beyond the array's ends its last one."""
        return dr.clip(self.centre + step, 0, self.line.pixels - 1)

    def full(self, step: Int32) -> Mask:
        """Return whether a pixel is saturated."""
        return self.line.full(self.pixel(step))

    def inside(self, step: Int32) -> Mask:
        """Return whether a pixel lies on the array."""
        pixel = self.centre + step
        return (pixel >= 0) & (pixel < self.line.pixels)

    def __call__(self, step: Int32) -> tuple[Float, Float]:
        """Return the charge above the baseline, and the variance of the whole charge."""
        pixel = self.pixel(step)
        raw = self.line.charge(pixel)
        return raw - (self.baseline.level + step * self.baseline.slope), self.line.variance(pixel, raw)
