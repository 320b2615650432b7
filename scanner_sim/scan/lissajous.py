"""Lissajous patterns: the figures that track a target (eqs 6 and 7)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Count, Number, Part, Switch
from scanner_sim.foundation.units import Angle, Ratio

Array = NDArray[np.float64]

QUARTER = -0.5 * math.pi
"""The phase that makes a sine of eqs 6 and 7."""
_SINE = 1e-6
"""Cosine of a phase below which it makes a sine."""
_FIRST, _SECOND, _THIRD = 0.8191725133961645, 0.6710436067037893, 0.5497004779019703
"""1/g, 1/g² and 1/g³ of g⁴ = g + 1: steps of a sequence that fills a cube evenly (Roberts 2018, *R₃*)."""
_STEPS = np.array([_FIRST, _SECOND, _THIRD])

Cycles = Annotated[str, Field(pattern=r"^[1-9][0-9]?:[1-9][0-9]?$", examples=["3:2"])]


class LissajousPattern(Part):
    """A figure of m cycles along Θ and n along φ, measured at ``points`` even instants."""

    ratio: Cycles = "3:2"
    """Cycles along Θ and along φ in one pattern, ``m:n``."""
    points: Count = Field(default=128, ge=8, le=65536)
    """Voxels of a pattern, N."""
    amplitude: Angle = Field(default=6e-3, gt=0.0, lt=1.5, examples=["6 mrad"])
    """Amplitude A_x along Θ."""
    aspect: Number = Field(default=1.0, gt=0.0, le=100.0)
    """Amplitude along φ over that along Θ, A_y/A_x."""
    phases: tuple[Angle, Angle] = (QUARTER, QUARTER)
    """Phases of Θ and φ. By default both are sines, which cross the figure's centre; with phases (90°, 0) a 3:2 figure
    passes 0.43 of the amplitude away from it, and a small target in the centre is never hit."""
    dither_sampling: Switch = True
    """Move the instants of measurement along the figure from pattern to pattern, by up to one point."""
    dither_phase: Angle = Field(default=0.0, ge=0.0, le=math.pi)
    """Change the phase of Θ from pattern to pattern by up to this to both sides: another figure each time."""
    dither_position: Ratio = Field(default=0.0, ge=0.0, le=1.0)
    """Move the figure from pattern to pattern by up to this share of its amplitude to both sides."""
    inversion: Switch = True
    """Run every second pattern with the amplitudes −A, which cancels the bias of lag and delay."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield figures that retrace themselves and figures with too few points for their cycles."""
        m, n = self.cycles
        if math.gcd(m, n) > 1:
            low = f"{m // math.gcd(m, n)}:{n // math.gcd(m, n)}"
            yield Fault("ratio", f"{m}:{n} runs the figure {low} several times.", f"Write {low}.")
        if self.points < 8 * max(m, n):
            yield Fault(
                "points",
                f"{self.points} points sample {max(m, n)} cycles with fewer than eight points each.",
                f"Write at least {8 * max(m, n)}.",
            )

    @property
    def cycles(self) -> tuple[int, int]:
        """Cycles m along Θ and n along φ."""
        m, n = self.ratio.split(":")
        return int(m), int(n)


class Figure(NamedTuple):
    """What varies of eqs 6 and 7 from pattern to pattern; each of shape (patterns, 2), Θ first.

    ``amplitude`` (signed) and ``position`` P [rad], ``phase`` [rad] at the pattern's start.
    """

    amplitude: Array
    phase: Array
    position: Array


def figures(
    pattern: LissajousPattern, number: ArrayLike, centre: ArrayLike, amplitude: ArrayLike | None = None
) -> Figure:
    """Return the figures of patterns with the given numbers.

    Parameters
    ----------
    pattern
        The figure that is varied.
    number
        Number of each pattern, counted from 0, shape (patterns,). It alone decides on dither and inversion. A pattern
        and the inverted one after it have the same dither, so that they differ in nothing else.
    centre
        Where each is put before dithering, (Θ, φ) [rad], shape (patterns, 2) or (2,).
    amplitude
        Amplitude of each along Θ [rad], shape (patterns,); by default the figure's.

    Returns
    -------
    Figure
        Dither follows an additive sequence in three dimensions, whose first K members are spread more evenly than
        random ones, and which needs no random numbers.
    """
    pair, sign = _pairs(pattern, number)
    even = np.modf(0.5 + pair[:, None] * _STEPS)[0]
    along = np.asarray(pattern.amplitude if amplitude is None else amplitude, dtype=np.float64)
    size = along[..., None] * np.array([1.0, pattern.aspect])
    phase = np.zeros((len(pair), 2)) + np.asarray(pattern.phases, dtype=np.float64)
    if pattern.dither_phase:
        phase[:, 0] += pattern.dither_phase * (2.0 * even[:, 2] - 1.0)
    if pattern.dither_sampling:
        step = 2.0 * math.pi / pattern.points * np.array(pattern.cycles)
        phase += (even[:, :1] - 0.5) * step
    position = np.zeros((len(pair), 2)) + np.asarray(centre, dtype=np.float64)
    if pattern.dither_position:
        position += pattern.dither_position * size * (2.0 * even[:, 1:] - 1.0)
    return Figure(sign[:, None] * size, phase, position)


def dwell_places(pattern: LissajousPattern, number: ArrayLike, lag: float) -> Array | None:
    """Return how far along the curve of a figure its dwells lie, in points, shape (patterns,).

    Parameters
    ----------
    pattern, number
        As of :func:`figures`.
    lag
        Time by which the mirrors follow the command, in dwells.

    Returns
    -------
    ndarray or None
        u: middles of dwells lie at whole numbers and u points on the curve that all patterns run over. A figure of two
        sines runs over it backwards where it is inverted, and lags to the other side. None where figures differ or are
        no sines, which have no such curve.
    """
    sines = all(abs(math.cos(phase)) < _SINE for phase in pattern.phases)
    if pattern.dither_phase or pattern.dither_position or (pattern.inversion and not sines):
        return None
    pair, sign = _pairs(pattern, number)
    even = np.modf(0.5 + pair * _FIRST)[0] if pattern.dither_sampling else 0.5
    return np.asarray(sign * (even - lag))


def _pairs(pattern: LissajousPattern, number: ArrayLike) -> tuple[NDArray[np.int64], Array]:
    """Return the number of the pair to which each pattern belongs, and 1, or −1 for the inverted one."""
    count = np.atleast_1d(np.asarray(number, dtype=np.int64))
    pair = count // 2 if pattern.inversion else count
    return pair, np.where(pattern.inversion & (count % 2 == 1), -1.0, 1.0)


def figure_angles(figure: Figure, cycles: tuple[int, int], share: ArrayLike) -> tuple[Array, Array]:
    """Return (Θ, φ) of figures, each of shape (patterns, times) [rad].

    Parameters
    ----------
    figure
        The figures.
    cycles
        m and n.
    share
        Time since a pattern's start over its duration, t/T, shape (times,).

    Returns
    -------
    theta, phi
        A_x cos(2π m t/T + φ_x) + P_x and A_y cos(2π n t/T + φ_y) + P_y (eqs 6 and 7).
    """
    turn = 2.0 * math.pi * np.asarray(share, dtype=np.float64)
    theta, phi = (
        figure.amplitude[:, axis, None] * np.cos(cycles[axis] * turn + figure.phase[:, axis, None])
        + figure.position[:, axis, None]
        for axis in (0, 1)
    )
    return theta, phi


def figure_slopes(figure: Figure, cycles: tuple[int, int], share: Array) -> Array:
    """Return d(Θ, φ)/d(t/T) of figures [rad], shape (patterns, 2, times); over T they are rates.

    Arguments as in :func:`figure_angles`.
    """
    turn = 2.0 * math.pi * np.array(cycles)[:, None]
    return -turn * figure.amplitude[:, :, None] * np.sin(turn * share + figure.phase[:, :, None])


def sample_shares(points: int, per_point: int = 1) -> Array:
    """Return t/T of ``per_point`` even updates of the drive for each point, shape (points · per_point,).

    The first is one update after the start and the last at the end. With one per point they are the ends of the
    dwells; with an even number, every ``per_point``-th from ``per_point``/2 − 1 on is the middle of a dwell.
    """
    return np.arange(1, points * per_point + 1) / (points * per_point)


def frequencies(pattern: LissajousPattern, dwell: float) -> tuple[float, float]:
    """Return the frequencies [Hz] at which a pattern drives Θ and φ, m/(N dwell) and n/(N dwell)."""
    m, n = pattern.cycles
    return m / (pattern.points * dwell), n / (pattern.points * dwell)
