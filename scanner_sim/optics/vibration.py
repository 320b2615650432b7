"""Vibration of the platform: a spectrum of the scanner's own pose, and the motion that a seed makes of it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Part
from scanner_sim.foundation.streams import Stream, host_generator
from scanner_sim.foundation.units import Dimension, Frequency

Array = NDArray[np.float64]

AngleSpectrum = Annotated[float, Dimension("rad^2/Hz", ("1e-12 rad^2/Hz",))]
LengthSpectrum = Annotated[float, Dimension("m^2/Hz", ("1e-12 m^2/Hz",))]

_AXES = 3
_LINES = 256
"""Sines of which the motion of an axis is made."""


class Vibration(Part):
    """How the platform shakes: power spectral densities of its turns and shifts, one-sided, alike about three axes.

    Between two points a density is a power of the frequency, as specifications of random vibration have it; beyond the
    first and the last there is none.
    """

    turn: tuple[tuple[Frequency, AngleSpectrum], ...] | None = Field(
        default=None, max_length=1000, examples=[[["5 Hz", "1e-10 rad^2/Hz"], ["500 Hz", "1e-14 rad^2/Hz"]]]
    )
    """Points (frequency, density) of the turns about x, y and z through the scanner's origin."""
    shift: tuple[tuple[Frequency, LengthSpectrum], ...] | None = Field(
        default=None, max_length=1000, examples=[[["5 Hz", "1e-12 m^2/Hz"], ["500 Hz", "1e-16 m^2/Hz"]]]
    )
    """Points (frequency, density) of the shifts along x, y and z."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield spectra that are no spectra."""
        for key in ("turn", "shift"):
            points = getattr(self, key)
            if points is None:
                continue
            frequencies = [frequency for frequency, _ in points]
            if len(points) < 2 or any(b <= a for a, b in zip([0.0, *frequencies], frequencies, strict=False)):
                yield Fault(
                    key,
                    "the frequencies of a spectrum must be two or more, above 0 and ascending.",
                    "Write [[5 Hz, …], [500 Hz, …]].",
                )
            if any(density <= 0.0 for _, density in points):
                yield Fault(key, "a density of 0 or less has no logarithm.", "Leave such points out.")

    def motion(self, time: Array, seed: int) -> Array:
        """Return turns (about x, y, z) [rad] and shifts [m] at times [s], shape (..., 6).

        Each axis is a sum of 256 sines, one for each band of the same ratio of frequencies, with the power of
        its band, a frequency drawn within it and a phase drawn evenly (Shinozuka, Deodatis, *Appl. Mech. Rev.* 44,
        1991, 191-204): a function of the time alone.
        """
        found = np.zeros((*np.shape(time), 2 * _AXES))
        for first, points in ((0, self.turn), (_AXES, self.shift)):
            if points:
                for axis in range(first, first + _AXES):
                    found[..., axis] = _sines(np.array(points), time, seed, axis)
        return found

    def correlation(self, apart: Array) -> tuple[Array, Array]:
        """Return the correlations of turns and of shifts at times so far apart [s], of their shape.

        ∫ S cos(2π f τ) df over the power: what a mean of many voxels keeps of them.
        """
        found = [
            np.zeros(np.shape(apart)) if points is None else _alike(np.array(points), np.asarray(apart))
            for points in (self.turn, self.shift)
        ]
        return found[0], found[1]

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard deviations of a turn [rad] and of a shift [m] of one axis."""
        return _rms(self.turn), _rms(self.shift)


def _rms(points: tuple[tuple[float, float], ...] | None) -> float:
    return math.sqrt(_cumulative(np.array(points), np.array([points[-1][0]]))[0]) if points else 0.0


def _cumulative(points: Array, frequency: Array) -> Array:
    """Return the power below frequencies: each piece S = S₀ (f/f₀)ⁿ integrated in closed form."""
    low, high = points[:-1], points[1:]
    power = np.log(high[:, 1] / low[:, 1]) / np.log(high[:, 0] / low[:, 0])
    total = np.zeros(len(frequency))
    for (start, density), end, order in zip(low, high[:, 0], power, strict=True):
        ratio = np.log(np.clip(frequency, start, end) / start)
        # expm1 keeps n = −1, whose integral is a logarithm.
        grown = (order + 1.0) * ratio
        shape = np.where(np.abs(grown) < 1e-12, 1.0, np.expm1(grown) / np.where(grown == 0.0, 1.0, grown))
        total += density * start * ratio * shape
    return np.asarray(total)


def _alike(points: Array, apart: Array) -> Array:
    edges = np.geomspace(points[0, 0], points[-1, 0], _LINES + 1)
    power = np.diff(_cumulative(points, edges))
    middle, half = math.tau * 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    found = np.zeros(apart.shape)
    # The power of a band lies evenly in it: sinc(2 Δf τ) cos(2π f τ) of a band of 2 Δf about f.
    for share, rate, width in zip(power / power.sum(), middle, half, strict=True):
        found += share * np.sinc(2.0 * width * apart) * np.cos(rate * apart)
    return found


def _sines(points: Array, time: Array, seed: int, axis: int) -> Array:
    edges = np.geomspace(points[0, 0], points[-1, 0], _LINES + 1)
    power = np.diff(_cumulative(points, edges))
    drawn = host_generator(seed, Stream.VIBRATION, axis).random((2, _LINES))
    frequency = edges[:-1] * (edges[1:] / edges[:-1]) ** drawn[0]
    found = np.zeros(np.shape(time))
    for amplitude, rate, phase in zip(np.sqrt(2.0 * power), frequency, drawn[1], strict=True):
        found += amplitude * np.cos(math.tau * (rate * np.asarray(time) + phase))
    return np.asarray(found)
