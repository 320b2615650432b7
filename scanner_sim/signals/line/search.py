"""Search: which pixel of a line is the laser's spot.

Without background the brightest pixel is. With it the light of the Sun decides: shadow edges, bright materials,
glints. The search then asks for a *contrast* that neither an edge nor a broad pedestal has: the weighted mean
(1, 2, 1)/4 of three pixels less the brighter of the two sides, each the mean of three pixels beyond the spot's
reach. An edge is as bright as its brighter side, so its contrast is zero wherever it lies. Peaks rank by
their contrast over the noise of their brighter side. Sunlit struts and soft glints are broader than any spot: a peak
that is still well above its sides one pixel before them is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.foundation.device_types import Float, Int32, Mask, UInt32
from scanner_sim.signals.line.digital_line import Line
from scanner_sim.signals.line.limits import SIDE_PIXELS, Gate, Limits, farthest_side

_LEAST_SEPARATION = 6
"""Pixels beyond which a second maximum counts as a peak of its own."""
_PIXELS_PER_TURN = 8
"""Pixels that one turn of a loop looks at."""
_GATE_BONUS = 1e5
"""Added to the level of peaks inside the range gate, so that they rank before all outside it."""
_FLANK_NOISE = 3.0
"""Noise granted to the flanks of a peak, in standard deviations of a pixel."""


@dataclass
class StrongestPeak:
    """The strongest peak of each line, Dr.Jit arrays of shape (m,).

    ``pixel`` brightest pixel; ``height`` what its rival is compared with, and ``rival`` the same of the next
    separate peak [electron]; ``level`` and ``rival_level`` how far the brightest pixel and the rival stand out, in
    the unit of the threshold; ``brightest`` charge of the fullest pixel of the whole line; ``refused`` where a
    stronger peak was left out as too bright for its range, ``broad`` where one was as too broad for a spot; ``rank``
    the level of its contrast, by which peaks rank; below 0 outside of the range gate, where there is one.
    """

    pixel: Int32
    height: Float
    level: Float
    rival: Float
    rival_level: Float
    brightest: Float
    refused: Mask
    broad: Mask
    rank: Float


def brightest_pixel(line: Line) -> StrongestPeak:
    """Return the brightest pixel of each line (the first of equals)."""

    def compare(pixel: UInt32, best: UInt32, height: Float) -> tuple[UInt32, UInt32, Float]:
        for step in range(_PIXELS_PER_TURN):
            here = dr.minimum(pixel + step, line.pixels - 1)
            charge = line.charge(here)
            higher = charge > height
            best, height = dr.select(higher, here, best), dr.select(higher, charge, height)
        return pixel + _PIXELS_PER_TURN, best, height

    start = (auto.UInt32(0), dr.zeros(auto.UInt32, line.shots), dr.full(auto.Float, -dr.inf, line.shots))
    _, best, height = dr.while_loop(start, lambda pixel, best, height: pixel < line.pixels, compare)

    def compare_apart(pixel: UInt32, second: Float) -> tuple[UInt32, Float]:
        for step in range(_PIXELS_PER_TURN):
            here = dr.minimum(pixel + step, line.pixels - 1)
            apart = dr.abs(auto.Int32(here) - auto.Int32(best)) > _LEAST_SEPARATION
            second = dr.select(apart, dr.maximum(second, line.charge(here)), second)
        return pixel + _PIXELS_PER_TURN, second

    start_apart = (auto.UInt32(0), dr.full(auto.Float, -dr.inf, line.shots))
    second = dr.while_loop(start_apart, lambda pixel, second: pixel < line.pixels, compare_apart)[1]
    level, second_level = height / line.floor_sigma, second / line.floor_sigma
    return StrongestPeak(
        auto.Int32(best),
        height,
        level,
        second,
        second_level,
        height,
        auto.Bool(False),
        auto.Bool(False),
        level,
    )


def spot_pixel(line: Line, away: int, limits: Limits, gate: Gate | None) -> StrongestPeak:
    """Return the brightest pixel of the peak of each line that stands out most like a spot.

    Parameters
    ----------
    line
        The lines.
    away
        Distance of the nearest pixel of each side.
    limits
        Peaks beyond them are left out.
    gate
        Where the spot is expected; a peak outside of it is no rival of one inside.

    Returns
    -------
    StrongestPeak
    """
    found = _Search(line, away, limits, gate).found()
    rank, contrast, rival = found.best[1], found.best[2], found.rival
    if gate is not None:
        rival[0] = dr.select(rank < _GATE_BONUS, rival[0], rival[0] - _GATE_BONUS)
        rank -= _GATE_BONUS
    top, charge, mean = _brightest_of_three(line, dr.clip(found.best[0], 0, line.pixels - 1))
    side = mean - contrast
    return StrongestPeak(
        top,
        contrast,
        (charge - side) * dr.rsqrt(dr.maximum(line.variance(top, side), 1e-12)),
        rival[1],
        rival[0],
        found.brightest,
        found.too_bright > contrast,
        found.too_broad > contrast,
        rank,
    )


@dataclass
class _Found:
    """What a search knows of the pixels that it has passed, Dr.Jit arrays of shape (m,).

    ``best`` and ``current`` peaks as pixel, level and contrast; ``rival`` level and contrast; ``brightest`` charge of
    the fullest pixel; ``too_bright`` and ``too_broad`` contrast of the strongest that were left out.
    """

    best: list[Any]
    current: list[Any]
    rival: list[Float]
    brightest: Float
    too_bright: Float
    too_broad: Float

    def pass_by(self, top: Mask, new: tuple[Int32, Float, Float]) -> None:
        """Take in a new maximum: maxima that are not separate make one peak.

        The peak that is being passed is ``current``; when the next one begins, it is ranked
        against the best and its rival.
        """
        best, current, rival = self.best, self.current, self.rival
        apart = top & (new[0] - current[0] > _LEAST_SEPARATION)
        wins = apart & (current[1] > best[1])
        candidate = [dr.select(wins, best[k], current[k]) for k in (1, 2)]
        closer = apart & (candidate[0] > rival[0])
        self.rival = [dr.select(closer, candidate[k], rival[k]) for k in (0, 1)]
        self.best = [dr.select(wins, current[k], best[k]) for k in range(3)]
        renewed = apart | (top & (new[1] > current[1]))
        self.current = [dr.select(renewed, new[k], current[k]) for k in range(3)]


class _Search:
    """The search of lines for what stands out most like a spot, pixel by pixel."""

    def __init__(self, line: Line, away: int, limits: Limits, gate: Gate | None) -> None:
        self.line, self.away, self.limits, self.gate = line, away, limits, gate
        self.half, self.end = farthest_side(away), line.window.last
        self.ends = line.charge(line.window.first), line.charge(self.end)
        self.full = line.known.full - line.known.dark

    def found(self) -> _Found:
        """Return what the whole window of each line holds."""
        line = self.line
        window, filled = [self.ends[0]] * self.half, dr.full(auto.Float, -dr.inf, line.shots)
        for pixel in range(0, self.half, 2):
            charges, fullest = self._pair(line.window.first + pixel)
            window, filled = [*window, *charges], dr.maximum(filled, fullest)
        zero = dr.zeros(auto.Float, line.shots)
        nowhere = dr.full(auto.Int32, -2 * _LEAST_SEPARATION, line.shots)
        nothing = _Found([nowhere, zero, zero], [nowhere, zero, zero], [zero, zero], filled, zero, zero)
        start: Any = (line.window.first, window, nothing)
        found: _Found = dr.while_loop(start, lambda pixel, *rest: pixel <= self.end, self._compare)[2]
        never = dr.full(auto.Int32, 2 * (line.pixels + _LEAST_SEPARATION), line.shots)
        found.pass_by(auto.Bool(True), (never, zero, zero))
        return found

    def _pair(self, pixel: UInt32) -> tuple[tuple[Float, Float], Float]:
        """Return the charges of a pixel and the next, those of the ends beyond them, and of the fuller one."""
        left, right, fullest = self.line.pair(2 * dr.minimum(pixel // 2, self.end // 2))
        last = self.ends[1]
        return (
            dr.select(pixel <= self.end, left, last),
            dr.select(pixel + 1 <= self.end, right, last),
        ), fullest

    def _compare(self, pixel: UInt32, window: list[Float], found: _Found) -> tuple[Any, ...]:
        """Look at the pixels of one turn; the window holds what is as near to them as their sides."""
        half, away, window = self.half, self.away, list(window)
        for step in range(0, _PIXELS_PER_TURN, 2):
            charges, fullest = self._pair(pixel + half + step)
            window += charges
            found.brightest = dr.maximum(found.brightest, fullest)
        sums = [window[k] + window[k + 1] + window[k + 2] for k in range(len(window) - 2)]
        for step in range(_PIXELS_PER_TURN):
            here = auto.Int32(pixel) + step
            side = dr.maximum(sums[step], sums[step + half + away]) * (1.0 / SIDE_PIXELS)
            three = window[step + half - 1 : step + half + 2]
            flank = 0.5 * (window[step + half - away + 1] + window[step + half + away - 1]) - side
            found.pass_by(*self._judge(found, here, three, side, flank, may_be_first=step == 0))
        return pixel + _PIXELS_PER_TURN, window[_PIXELS_PER_TURN:], found

    def _judge(
        self, found: _Found, here: Int32, three: list[Float], side: Float, flank: Float, *, may_be_first: bool
    ) -> tuple[Mask, tuple[Int32, Float, Float]]:
        """Return whether a pixel is the top of what may be a spot, and its pixel, level and contrast."""
        limits, (before, middle, after) = self.limits, three
        contrast = 0.25 * (before + 2.0 * middle + after) - side
        top = (middle > before) & (middle >= after) & (contrast > 0.0) & (here <= auto.Int32(self.end))
        if may_be_first:
            top |= (here == 0) & (middle >= after) & (contrast > 0.0)
        squared = dr.square(auto.Float(here) + limits.origin)
        limit = dr.fma(limits.charge[1], squared, limits.charge[0])
        # A full pixel is no spot's where the limit is lower, nor where the light beside it is bright too.
        variance, is_full = self.line.beneath(here, middle, side, top)
        doubtful = is_full & ((limit < self.full) | (contrast < 0.5 * self.full))
        dim = contrast <= dr.select(doubtful, 0.0, limit)
        found.too_bright = dr.select(top & ~dim, dr.maximum(found.too_bright, contrast), found.too_bright)
        top &= dim & (contrast >= limits.dimmest * squared)
        scale = dr.rsqrt(dr.maximum(variance, 1e-12))
        level = contrast * scale
        share = dr.fma(limits.flank[1], squared, limits.flank[0])
        narrow = flank * scale <= dr.fma(share, level, _FLANK_NOISE)
        found.too_broad = dr.select(top & ~narrow, dr.maximum(found.too_broad, contrast), found.too_broad)
        top &= narrow
        if self.gate is not None:
            expected = (auto.Float(here) >= self.gate.first) & (auto.Float(here) <= self.gate.last)
            level += dr.select(expected & (level > self.gate.level), _GATE_BONUS, 0.0)
        return top, (here, level, contrast)


def _brightest_of_three(line: Line, peak: Int32) -> tuple[Int32, Float, Float]:
    """Return the brightest of a pixel and its two neighbours, its charge, and the mean of all three (1, 2, 1)/4."""
    top, charge = peak, line.charge(peak)
    mean = 0.5 * charge
    for step in (-1, 1):
        other = dr.clip(peak + step, 0, line.pixels - 1)
        beside = line.charge(other)
        mean += 0.25 * beside
        top, charge = dr.select(beside > charge, other, top), dr.maximum(beside, charge)
    return top, charge, mean
