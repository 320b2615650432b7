"""Maximum likelihood: the Gaussian spot, integrated over the pixels, fitted to the line with the noise's own weights.

The spot of N electrons at µ with the variance v leaves on pixel i

    m_i = N/2 [erf(e_{i+1/2}) − erf(e_{i−1/2})],   e_x = (x − µ)/√(2v),

and the pixel's variance is that of the noise model *at m_i*: at the measured charge, pixels that are low by chance
would count too much and pull the fit down. Fisher scoring on θ = (ln N, µ, ln v),

    δθ = (F + P)⁻¹ [Σ_i (f_i − m_i)/var_i ∂m_i/∂θ + P (θ₀ − θ)],   F = Σ_i ∂m_i/∂θ ∂m_i/∂θᵀ/var_i,

solves the likelihood equations of Poisson numbers with a normal read noise: with σ_r² added, mean and variance are both
m_i + σ_r² (Snyder, Hammoud, White, *J. Opt. Soc. Am. A* 10, 1993; Smith, Joseph, Rieger, Lidke, *Nature
Methods* 7, 2010; Huang et al., *Nature Methods* 10, 2013, for a variance of each pixel's own).

P is what is known of the width beforehand: a surface that faces the scanner makes the expected spot, tilted ones and
edges make others. The spot is even about µ, so a wrong width hardly moves a fit of many pixels, but that of a spot
narrower than a pixel it does; with the width fitted it moves neither.

A shadow's edge beneath the spot bends the far flanks most, and those have the largest weights where the light is
taken to be even. The difference of the light on the two sides therefore counts as noise of every pixel in the weights:
the fit then leans on the spot's steep middle, as least squares would.

Not modelled: spots that are not Gaussian. What does not fit is the business of the test of shape.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.foundation.device_loops import for_each
from scanner_sim.foundation.device_types import Float, Int32, Local, Mask, UInt32
from scanner_sim.signals.line.digital_line import Baseline
from scanner_sim.signals.line.expected import ExpectedSpot
from scanner_sim.signals.line.pixel_row import read_rows

_SCORING_STEPS = 6
"""Steps of the scoring: at a peak of five times the noise one line in 1000 has then not converged, at ten none."""
_CONVERGED_SIGMAS = 0.2
"""Largest last step, in standard deviations of the position, of a fit that has converged."""
_CONVERGED_PIXELS = 1e-3
"""The same in pixels: where there is hardly any noise."""
_WIDTH_UNCERTAINTY = 0.005
"""Relative standard deviation to which the variance v on a facing surface is known, from a calibration of the focus."""
_FREE_WIDTH = 1e3
_SIDES = 8
"""Pixels to each side that are fitted where nothing is known of the spot."""
_LEAST_SPOT, _LARGEST_SPOT = 0.02, 400.0
"""Limits of the variance of a spot [pixel²]."""
_LEAST_VARIANCE = 1.0
"""Least variance of a pixel [electron²]: without any noise all count alike."""

Slopes = dict[int, Float]
"""Derivative of the position by the charge of the pixel at each step [pixel/electron]."""


class Pixels(Protocol):
    """A source of charges about a pixel, such as :class:`~scanner_sim.signals.line.digital_line.Around`.

    A step is a number, or that of the turn of a loop (Dr.Jit signed).
    """

    @property
    def baseline(self) -> Baseline:
        """The light beneath the peak."""

    @property
    def line(self) -> Any:
        """What knows the variance of a pixel that holds a charge."""

    @property
    def floor_sigma(self) -> Float:
        """Standard deviation of a pixel without light [electron]."""

    def pixel(self, step: Int32) -> Int32:
        """Return the pixel at a step."""

    def inside(self, step: Int32) -> Mask:
        """Return whether a pixel lies on the array."""

    def __call__(self, step: Int32) -> tuple[Float, Float]:
        """Return the charge above the baseline [electron] and its variance [electron²]."""


@dataclass
class Width:
    """What is known of a spot's width before it is fitted.

    Attributes
    ----------
    variance
        Variance v of the spot on a surface that faces the scanner [pixel²], Dr.Jit, shape (m,).
    spread
        Standard deviation of ln v over the surfaces there are, shape (m,).
    guard
        Pixels to each side of the brightest one that the spot covers, Dr.Jit signed, shape (m,).
    reach
        Largest of them anywhere on the line.
    """

    variance: Float
    spread: Float
    guard: Int32
    reach: int

    @classmethod
    def of(
        cls,
        spot: ExpectedSpot,
        centre: Int32,
        guard: Int32,
        deflection: tuple[Float, Float],
        limits: tuple[float, float],
        reach: int,
    ) -> Width:
        """Return the width that a spot has at a pixel.

        Parameters
        ----------
        spot
            The spot.
        centre
            Brightest pixels, Dr.Jit signed, shape (m,).
        guard, reach
            As the attributes.
        deflection
            Sine and cosine of the deflections Θ, shape (m,).
        limits
            Least and largest image of the beam, relative to that on a facing surface: the standard deviation is a
            quarter of what lies between.
        """
        beam, spread = spot.variances(auto.Float(centre), *deflection)
        variance = beam + spread
        quarter = dr.opaque(auto.Float, 0.25 * (limits[1] ** 2 - limits[0] ** 2)) * beam / variance
        return cls(variance, dr.sqrt(dr.square(quarter) + _WIDTH_UNCERTAINTY**2), guard, reach)

    @classmethod
    def certain(cls, sigma: Float, widest: float) -> Width:
        """Return the width of spots of known standard deviations [pixel], shape (m,), none above the widest."""
        guard = auto.Int32(dr.clip(dr.ceil(4.0 * sigma), 3.0, 24.0))
        return cls(dr.square(sigma), auto.Float(_WIDTH_UNCERTAINTY), guard, min(math.ceil(4.0 * widest), 24))

    @classmethod
    def unknown(cls) -> Width:
        """Return the width of a spot that nothing is known of: it is fitted freely."""
        one = auto.Float(1.0)
        return cls(one, _FREE_WIDTH * one, auto.Int32(_SIDES), _SIDES)


@dataclass
class LineFit:
    """Fitted spots, Dr.Jit arrays of shape (m,).

    ``shift`` from the centre pixel [pixel]; ``slopes`` its derivatives by the charges; ``prior_variance`` the part of
    its variance that comes from what was not known of the width [pixel²]; ``converged`` where the scoring converged;
    ``charge`` N [electron] and ``variance`` v [pixel²] of the spot.
    """

    shift: Float
    slopes: Slopes
    prior_variance: Float
    converged: Mask
    charge: Float
    variance: Float


def fit_spot(around: Pixels, width: Width, first: Float, speckle: Float | None = None) -> LineFit:
    """Fit charge, position and width of the spot.

    Parameters
    ----------
    around
        Charges about the brightest pixel.
    width
        What is known of the width.
    first
        A first guess of the shift from the brightest pixel [pixel], shape (m,).
    speckle
        Relative variance V of the spot's charge by speckle of single pixels, shape (m,); without it there is none. It
        enters the weights as V N m_i (:attr:`~scanner_sim.signals.line.speckle.SpotSpeckle.single`).

    Returns
    -------
    LineFit
    """
    charges, _, counts = read_rows(around, width.reach, width.guard)
    likelihood = _Likelihood(around, width, auto.Float(0.0) if speckle is None else speckle)
    rows, fitted, moved = likelihood.maximum([charges, counts], first)
    rows, matrix, _ = likelihood.score(rows, fitted)
    row = inverse_of(matrix)[1]
    charge, position, spread = fitted
    away: Float = dr.abs(position)
    converged = dr.abs(moved) <= dr.maximum(_CONVERGED_SIGMAS * dr.sqrt(row[1]), _CONVERGED_PIXELS)
    converged &= away <= auto.Float(width.guard)
    slopes = likelihood.slopes(rows, fitted, row)
    return LineFit(position, slopes, dr.square(row[2]) * likelihood.known, converged, charge, spread)


_Spot: TypeAlias = tuple[Float, Float, Float]
"""Charge N [electron], position from the brightest pixel [pixel] and variance v [pixel²], shape (m,) each."""


class _Likelihood:
    """The likelihood of spots on the pixels about a peak; ``known`` is the information on ln v before the fit.

    Rows are the charges above the baseline and where they count, one value for each step.
    """

    def __init__(self, around: Pixels, width: Width, speckle_variance: Float) -> None:
        self.around, self.width, self.speckle_variance = around, width, speckle_variance
        self.known = dr.rcp(dr.square(width.spread))
        self._logarithm = dr.log(width.variance)
        # Both sides apart: where between them the light changes is unknown, and each pixel may be wrong by as much.
        self._uneven = around.baseline.step_squared
        self._count = 2 * width.reach + 1

    def maximum(self, rows: list[Local], first: Float) -> tuple[list[Local], _Spot, Float]:
        """Return the rows, the spot that scoring from a first position ends with, and the last step of its position."""
        middle = self.around(0)[0]
        zeros = dr.zeros(auto.Float, dr.width(middle))
        spread = self.width.variance + auto.Float(zeros)
        height = dr.maximum(middle, dr.maximum(self.around.floor_sigma, 1.0))
        charge = height * dr.sqrt(2.0 * math.pi * (spread + 1.0 / 12.0))
        state: Any = (dr.zeros(auto.UInt32, dr.width(middle)), rows, (charge, first + zeros, spread), zeros)
        ended: Any = dr.while_loop(state, lambda turn, *rest: turn < _SCORING_STEPS, self._improve)
        return ended[1], ended[2], ended[3]

    def _improve(self, turn: UInt32, rows: list[Local], fitted: _Spot, last: Float) -> tuple[Any, ...]:
        rows, matrix, sums = self.score(rows, fitted)
        inverse = inverse_of(matrix)
        brighter, moved, wider = (
            sum(inverse[row][column] * sums[column] for column in range(3)) for row in range(3)
        )
        charge, position, spread = fitted
        # The weights follow the fit: in strong noise they make it oscillate about its position, which half a step
        # reaches.
        moved = dr.select(moved * last < 0.0, 0.5 * moved, moved)
        farthest = dr.maximum(0.5, 0.7 * dr.sqrt(spread))
        moved = dr.clip(moved, -farthest, farthest)
        fitted = (
            charge * (1.0 + dr.clip(brighter, -0.7, 3.0)),
            dr.clip(position + moved, -auto.Float(self.width.reach), self.width.reach),
            dr.clip(spread * dr.exp(dr.clip(wider, -0.7, 0.7)), _LEAST_SPOT, _LARGEST_SPOT),
        )
        return turn + 1, rows, fitted, moved

    def score(self, rows: list[Local], fitted: _Spot) -> tuple[list[Local], list[Float], list[Float]]:
        """Return the rows, the information as (qq, qm, qw, mm, mw, ww), and the score."""

        def add(number: UInt32, rows: list[Local], before: list[Float], sums: list[Float]) -> tuple[Any, ...]:
            weight, slopes, after = self._laid(number, rows, before, fitted)
            residual = weight * (rows[0].read(number) - slopes[0])
            added = [weight * slopes[i] * slopes[j] for i in range(3) for j in range(i, 3)]
            added += [residual * slope for slope in slopes]
            return rows, after, [total + value for total, value in zip(sums, added, strict=True)]

        start = self._left_edge(fitted), [auto.Float(0.0) for _ in range(9)]
        rows, _, sums = for_each(self._count, add, rows, *start)
        matrix, sums = sums[:6], sums[6:]
        matrix[5] += self.known
        sums[2] += self.known * (self._logarithm - dr.log(fitted[2]))
        return rows, matrix, sums

    def slopes(self, rows: list[Local], fitted: _Spot, row: list[Float]) -> Slopes:
        """Return the derivatives of the position by the charges, from its row of the inverse information."""

        def derive(number: UInt32, rows: list[Local], before: list[Float], found: Local) -> tuple[Any, ...]:
            weight, slopes, after = self._laid(number, rows, before, fitted)
            found.write(weight * sum(row[index] * slopes[index] for index in range(3)), number)
            return rows, after, found

        found = dr.alloc_local(auto.Float, self._count)
        found = for_each(self._count, derive, rows, self._left_edge(fitted), found)[2]
        return {number - self.width.reach: found.read(auto.UInt32(number)) for number in range(self._count)}

    def _laid(
        self, number: UInt32, rows: list[Local], before: list[Float], fitted: _Spot
    ) -> tuple[Float, list[Float], list[Float]]:
        """Return the weight of a pixel, the model and its derivatives there, and what the next pixel begins with."""
        around, (charge, position, spread) = self.around, fitted
        scale = dr.rsqrt(2.0 * spread)
        by_position, by_width = charge * scale / math.sqrt(math.pi), charge * (0.5 / math.sqrt(math.pi))
        edge, below, density = before
        step = auto.Float(number) - self.width.reach
        edge_next = (step + 0.5 - position) * scale
        below_next, density_next = dr.erf(edge_next), dr.exp(-dr.square(edge_next))
        model = 0.5 * charge * (below_next - below)
        moved = by_position * (density - density_next)
        widened = by_width * (edge * density - edge_next * density_next)
        whole = model + around.baseline.level + step * around.baseline.slope
        pixel = around.pixel(auto.Int32(number) - self.width.reach)
        variance = dr.maximum(around.line.variance(pixel, whole), _LEAST_VARIANCE)
        variance += self.speckle_variance * charge * model + self._uneven
        weight = dr.select(rows[1].read(number) > 0.0, dr.rcp(variance), 0.0)
        return weight, [model, moved, widened], [edge_next, below_next, density_next]

    def _left_edge(self, fitted: _Spot) -> list[Float]:
        """Return what the first pixel begins with."""
        _, position, spread = fitted
        edge = (-self.width.reach - 0.5 - position) * dr.rsqrt(2.0 * spread)
        return [edge, dr.erf(edge), dr.exp(-dr.square(edge))]


def inverse_of(matrix: list[Float]) -> list[list[Float]]:
    """Return the inverse of a positive symmetric matrix given as (00, 01, 02, 11, 12, 22).

    Its diagonal is made 1 first, so that no product leaves the range of single precision.
    """
    scale = [dr.rsqrt(dr.maximum(matrix[index], 1e-30)) for index in (0, 3, 5)]
    a, b, c = (
        matrix[1] * scale[0] * scale[1],
        matrix[2] * scale[0] * scale[2],
        matrix[4] * scale[1] * scale[2],
    )
    determinant = dr.maximum(1.0 + 2.0 * a * b * c - a * a - b * b - c * c, 1e-6)
    entries = (
        (1.0 - c * c, b * c - a, a * c - b),
        (b * c - a, 1.0 - b * b, a * b - c),
        (a * c - b, a * b - c, 1.0 - a * a),
    )
    over = dr.rcp(determinant)
    return [[entries[i][j] * scale[i] * scale[j] * over for j in range(3)] for i in range(3)]
