"""Exposure of the line sensor: from watts on the pixels to digital numbers.

The chain of a charge-integrating array: photons to electrons (quantum efficiency, response of each pixel), dark
charge, Poisson noise, full well with anti-blooming, read noise, converter. (Janesick, *Photon transfer*, 2007,
chs 3 to 5.)

The line may be exposed twice in a dwell, with the laser on and off, at the same angles of the mirrors: the second
exposure sees the background alone, to be subtracted later. Each is read and digitised on its own, with its own
noise; the pixels' response is that of both. Not modelled: the mirrors' motion between the exposures, image lag, the
time of the second read-out, and the laser's rise and decay.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.line.position_sensor import PositionSensor
from scanner_sim.foundation.constants import PLANCK, SPEED_OF_LIGHT
from scanner_sim.foundation.device_streams import RunSeeds, generator
from scanner_sim.foundation.device_types import Float, Mask, UInt32
from scanner_sim.foundation.streams import Seed, Stream

LinePower = Callable[[UInt32, UInt32], tuple[Float, Float, Float]]
"""Power on a pixel of the line and on the next [W], and the larger of what the background has on both, as a function of
(pixel, index of the shot in its group)."""

_INVERSION_LIMIT = 40.0
"""Mean below which Poisson numbers are found by inversion; above, the series is good enough."""
_FLOAT_EPSILON = 2.0**-24
"""What float32 does not notice beside 1."""
_LARGEST_NORMAL = 5.65
"""No normal number is farther from 0: they are √(−2 ln u) of numbers u of 23 bits, times a sine or cosine (Box, Muller,
*Ann. Math. Stat.* 29, 1958), 5.6466 at most."""
_ROUNDING = 1e-6
"""More than single precision rounds a digital number by, of 1 and of itself."""
_BLOCK = 64
"""Shots whose lines are stored interleaved: a block fits the cache, and neighbours load together."""


@dataclass
class Window:
    """Pixels of m lines, from ``first``, which is even, to ``last``; none where that is less. Dr.Jit, shape (m,)."""

    first: UInt32
    last: UInt32

    @classmethod
    def whole(cls, shots: int, pixels: int) -> Window:
        """Return all pixels of so many lines."""
        return cls(dr.zeros(auto.UInt32, shots), dr.full(auto.UInt32, pixels - 1, shots))

    def where(self, wanted: Mask) -> Window:
        """Return the same pixels where they are wanted, elsewhere none."""
        return Window(dr.select(wanted, self.first, 2), dr.select(wanted, self.last, 0))


@dataclass
class Signal:
    """Digitised lines of a group of shots.

    Attributes
    ----------
    number
        Digital numbers, Dr.Jit float array; :meth:`address` gives the index of each. Two neighbours stand together,
        and behind them the same two of the exposure without the laser, where there is one.
    shots, pixels
        Number m of shots, and of pixels in each line.
    laser_off
        Share of the dwell that the exposure without the laser took; 0 where there is none.
    window
        The pixels that were exposed; None for all. No other number means anything.
    background_peak
        The background on the brightest of these pixels [W], Dr.Jit, shape (m,).
    """

    number: Float
    shots: int
    pixels: int
    laser_off: float = 0.0
    window: Window | None = None
    background_peak: Float = None

    @property
    def exposures(self) -> int:
        """Number of exposures of each line, 1 or 2."""
        return 2 if self.laser_off > 0.0 else 1

    def pair(self, pixel: UInt32, index: UInt32) -> UInt32:
        """Return where in ``number`` the pair of a pixel (0 to pixels − 1) of shot ``index`` (0 to m − 1) stands."""
        row = index // _BLOCK * ((self.pixels + 1) // 2) + pixel // 2
        return row * _BLOCK + index % _BLOCK

    def address(self, pixel: UInt32, index: UInt32) -> UInt32:
        """Return where a pixel of shot ``index`` stands; 2 further is that of the exposure without the laser."""
        return 2 * self.exposures * self.pair(pixel, index) + pixel % 2

    def lines(self, exposure: int = 0) -> NDArray[np.float32]:
        """Return the digital numbers of an exposure as a NumPy array of shape (m, pixels).

        Raises
        ------
        ValueError
            If not all pixels were exposed.
        """
        if self.window is not None:
            raise ValueError("of these lines only a window was exposed")
        pairs = (self.pixels + 1) // 2
        blocks = self.number.numpy().reshape(-1, pairs, _BLOCK, self.exposures, 2)[:, :, :, exposure]
        lines = blocks.transpose(0, 2, 1, 3).reshape(-1, 2 * pairs)
        return np.asarray(lines[: self.shots, : self.pixels])


def electrons_per_watt(sensor: PositionSensor, wavelength: float, dwell: float) -> float:
    """Return the electrons that one watt on a pixel frees during a dwell: QE t λ / (h c)."""
    return sensor.quantum_efficiency * dwell * wavelength / (PLANCK * SPEED_OF_LIGHT)


def pairwise(power: Callable[[UInt32, UInt32], Float]) -> LinePower:
    """Return the power on a pixel and on the next from that on any pixel, by the same arguments; no background."""
    return lambda pixel, index: (power(pixel, index), power(pixel + 1, index), auto.Float(0.0))


def expose(
    power: LinePower,
    shot: UInt32,
    sensor: PositionSensor,
    wavelength: float,
    dwell: float,
    seed: int | RunSeeds,
    *,
    background: LinePower | None = None,
    laser_off: float = 0.0,
    window: Window | None = None,
    onto: Signal | None = None,
) -> Signal:
    """Expose, read and digitise the lines of a group of shots.

    Parameters
    ----------
    power
        Function of (pixel, index) that gives the power [W] on a pixel of the shot with an index, 0 to m − 1, and on
        the next pixel, and what of it the background has at most; both are Dr.Jit unsigned arrays of one shape.
    shot
        Numbers of the m shots (they address the noise), Dr.Jit unsigned.
    sensor
        The line sensor.
    wavelength, dwell
        Wavelength [m] and time spent on a shot [s].
    seed
        Seed of the noise, or those of several runs' shots.
    background
        The power [W] without the laser, by the same arguments; wanted where ``laser_off`` is not 0.
    laser_off
        Share s of the dwell t in which the laser is off, 0 to below 1: the line is exposed for (1 − s) t to all the
        light, and for s t to the background.
    window
        The pixels that are wanted; by default all.
    onto
        A signal of the same shots, whose memory takes the numbers.

    Returns
    -------
    Signal

    Raises
    ------
    ValueError
        If the laser is off for a time and no background is given.
    """
    lights = [(power, Stream.DETECTOR, (1.0 - laser_off) * dwell)]
    if laser_off > 0.0:
        if background is None:
            raise ValueError("the exposure without the laser needs the background's power")
        lights.append((background, Stream.AMBIENT, laser_off * dwell))
    shots, pairs = dr.width(shot), (sensor.pixels + 1) // 2
    index, own, each, line = dr.arange(auto.UInt32, shots), seed, seed, auto.UInt32(0)
    if isinstance(seed, RunSeeds):
        own, each, line = seed.lanes, seed.each, seed.run * dr.opaque(auto.UInt32, sensor.pixels)
    response = pixel_response(sensor, each)
    signal = Signal(auto.Float(), shots, sensor.pixels, laser_off, window)
    if onto is None:
        blocks = (shots + _BLOCK - 1) // _BLOCK
        signal.number = dr.empty(auto.Float, blocks * pairs * _BLOCK * 2 * len(lights))
    else:
        signal.number = onto.number
    packet = auto.Array2f if len(lights) == 1 else auto.Array4f

    def read_pair(pixel: UInt32, brightest: Float) -> tuple[UInt32, Float]:
        numbers = []
        for light, stream, time in lights:
            # One call of the generator makes four numbers: light and read noise of two pixels.
            normal = generator(own, stream, shot, pixel // 2).next_float32x4_normal()
            electrons = dr.opaque(auto.Float, electrons_per_watt(sensor, wavelength, time))
            *both, beneath = light(pixel, index)
            brightest = dr.maximum(brightest, beneath)
            for side, watts in enumerate(both):
                at = pixel + side
                charge = watts * electrons * dr.gather(auto.Float, response, line + at, at < sensor.pixels)
                numbers.append(_read_out(charge, normal[2 * side], normal[2 * side + 1], sensor, time))
        dr.scatter(signal.number, packet(*numbers), signal.pair(pixel, index))
        return pixel + 2, brightest

    wanted = Window.whole(shots, sensor.pixels) if window is None else window
    start = wanted.first, dr.zeros(auto.Float, shots)
    signal.background_peak = dr.while_loop(start, lambda pixel, _: pixel <= wanted.last, read_pair)[1]
    dr.eval(signal.number, signal.background_peak)
    return signal


def pixel_response(sensor: PositionSensor, seed: Seed) -> Float:
    """Return the relative response of each pixel, the same for every shot of a seed.

    Shape (pixels,), or of the lines of several seeds one after the other, (seeds · pixels,).
    """
    pixel, own = dr.arange(auto.UInt32, sensor.pixels), seed
    if dr.is_array_v(seed):
        place, pixels = (
            dr.arange(auto.UInt32, dr.width(seed) * sensor.pixels),
            dr.opaque(auto.UInt32, sensor.pixels),
        )
        pixel, own = place % pixels, dr.gather(auto.UInt64, seed, place // pixels)
    normal = generator(own, Stream.RESPONSE, auto.UInt32(0), pixel).next_float32x4_normal()[0]
    spread = sensor.prnu if sensor.noise.prnu else 0.0
    response = dr.maximum(1.0 + dr.opaque(auto.Float, spread) * normal, 0.0)
    dr.eval(response)
    return response


def _dark_charge(sensor: PositionSensor, dwell: float) -> float:
    """Return the mean dark charge of a pixel [electron]."""
    return sensor.dark_current * dwell if sensor.noise.dark else 0.0


def _read_out(
    charge: Float, shot_normal: Float, read_normal: Float, sensor: PositionSensor, dwell: float
) -> Float:
    """Return the digital numbers of pixels that a mean charge [electron] of light falls on."""
    switches, dark = sensor.noise, _dark_charge(sensor, dwell)
    charge = charge + dr.opaque(auto.Float, dark)
    if switches.shot:
        charge = poisson(charge, shot_normal, least=dark)
    if switches.saturation:
        charge = dr.minimum(charge, dr.opaque(auto.Float, sensor.full_well))
    if switches.read:
        charge = dr.fma(read_normal, dr.opaque(auto.Float, sensor.read_noise), charge)
    number = charge / dr.opaque(auto.Float, sensor.electrons_per_number) + dr.opaque(auto.Float, sensor.bias)
    if switches.quantisation:
        number = dr.round(number)
    if switches.saturation:
        number = dr.clip(number, 0.0, dr.opaque(auto.Float, sensor.largest_number))
    return number


def unlit_numbers(sensor: PositionSensor, dwell: float) -> tuple[float, float]:
    """Return the least and the largest digital number that noise can make of a pixel without light.

    Those of both normal numbers at their ends: the digital number ascends with either.
    """
    switches, dark, found = sensor.noise, _dark_charge(sensor, dwell), []
    for sign, charge in zip((-1.0, 1.0), _poisson_ends(dark) if switches.shot else (dark, dark), strict=True):
        if switches.saturation:
            charge = min(charge, sensor.full_well)
        if switches.read:
            charge += sign * _LARGEST_NORMAL * sensor.read_noise
        number = charge / sensor.electrons_per_number + sensor.bias
        number += sign * _ROUNDING * (1.0 + abs(number))
        if switches.quantisation:
            number = round(number)
        found.append(min(max(number, 0.0), sensor.largest_number) if switches.saturation else number)
    return found[0], found[1]


def _poisson_ends(mean: float) -> tuple[float, float]:
    """Return the least and the largest number that :func:`poisson` makes of a mean, or a little beyond them."""
    if mean >= _INVERSION_LIMIT:
        least, largest = (mean + _deviation(mean, end) for end in (-_LARGEST_NORMAL, _LARGEST_NORMAL))
        return max(least - 1.0, 0.0), largest + 1.0
    count, term = 0.0, math.exp(-mean)
    while term > _FLOAT_EPSILON or count < mean:
        count += 1.0
        term *= mean / count
    return 0.0, count + 1.0


def poisson(mean: Float, normal: Float, least: float = 0.0) -> Float:
    """Return Poisson numbers of the given means, each from one standard normal number.

    Above a mean of 40 the quantile follows from the Cornish-Fisher series to the fourth cumulant (Johnson, Kotz,
    Balakrishnan, *Continuous univariate distributions* 1, 1994, sec. 12.5), below by inverting the
    distribution term by term.

    Parameters
    ----------
    mean
        Means, 0 or more.
    normal
        Standard normal numbers, same shape.
    least
        A mean that none of ``mean`` is below: where it is high enough, inversion is left out.
    """
    z, series = normal, _deviation(mean, normal)
    large = dr.maximum(dr.floor(mean + series + 0.5), 0.0)
    if least >= _INVERSION_LIMIT:
        return large
    few = mean < _INVERSION_LIMIT

    def search(count: Float, term: Float, total: Float) -> tuple[Float, Float, Float]:
        count = count + 1.0
        term = term * mean / count
        return count, term, total + term

    def unfinished(count: Float, term: Float, total: Float) -> Mask:
        # Near 1 the sum stops short of a target by rounding: beyond the mean a term below it ends the search.
        return few & (target > total) & ((term > _FLOAT_EPSILON) | (count < mean))

    first = dr.exp(-mean)
    target = 0.5 * (1.0 + dr.erf(z * 0.7071067811865476))
    small, _, _ = dr.while_loop((dr.zeros(auto.Float), first, first), unfinished, search)
    return dr.select(few, small, large)


def _deviation(mean: Float, z: Float) -> Float:
    """Return how far Poisson numbers lie from their mean at standard normal numbers, by the Cornish-Fisher series."""
    root = dr.sqrt(mean)
    return z * root + (dr.square(z) - 1.0) / 6.0 - (z * dr.square(z) - z) / (72.0 * dr.maximum(root, 1.0))
