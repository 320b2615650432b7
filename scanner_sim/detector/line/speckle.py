"""Speckle on the line: how the charge of each pixel departs from the mean image of the laser's light.

The light of a spot has a few modes that fluctuate (:class:`~scanner_sim.optics.speckle.Packets`). A pixel of the mean
charge Q_i and a spot of the charge Q hence holds

    Q_i + Q Σ_n b_n ∂ⁿK̄_i,   b_n = z_n C √(A_n/M) (rσ)ⁿ/√n!

with normal numbers z_n and what the dwell leaves of their variance, A_n; the energy b_0 is nearly gamma distributed
(Goodman, *Speckle phenomena in optics*, 2007, ch. 4), by the cube of Wilson and Hilferty (*PNAS* 17, 1931). Light on
several surfaces is taken as two spots, before and behind its largest gap along the line, each with modes of its own.

The pattern belongs to the surface (:mod:`~scanner_sim.detector.surface_noise`).

Not modelled: what consecutive dwells of a continuous sweep have in common beyond the positions of their middles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.detector.packets import dwell_average, gamma_like, mode_edges, mode_ratios
from scanner_sim.detector.surface_noise import SurfacePoints, coarse_numbers, fine_numbers
from scanner_sim.foundation.device_loops import for_each
from scanner_sim.foundation.device_types import Float, Int32, Mask, UInt32
from scanner_sim.foundation.streams import Seed
from scanner_sim.optics.line_image import ArrayPlace
from scanner_sim.optics.speckle import Optics, Packets, packets_of

_SPOT_SIGMAS = 4.0
"""Standard deviations of a spot within which its speckle is followed: beyond lies 6e-5 of its light."""
_LEAST_GAP = 3.0
"""Gap between the light of two spots, in standard deviations of the beam's image in the focal plane."""
_LEAST_IMAGE_VARIANCE = 1e-3
"""Least variance of a geometric image, of the beam's."""
_LEAST_SHARE = 1e-5
"""Share of a spot on a pixel from which it is followed: below, single precision runs out of digits."""


class LineLight(Protocol):
    """Gaussian clusters of light of m shots, Dr.Jit arrays of shape (c · m,): entry k · m + j is cluster k of shot j.

    ``amount`` [W], ``position`` and ``sigma`` [pixel] along the line, those of a shot ascending; ``coherence`` C² of
    the light, 0 for what has no speckle; ``shots`` m, ``count`` c.
    """

    amount: Float
    position: Float
    sigma: Float
    coherence: Float

    @property
    def shots(self) -> int:
        """Number m of shots."""

    @property
    def count(self) -> int:
        """Number c of clusters of each shot."""


@dataclass
class LineSpeckle:
    """What multiplies the laser's light on the pixels of m shots: tables about the light of each shot.

    ``factor`` entry k · m + j is pixel ``first``[j] + k of shot j; all other pixels keep their light.
    """

    factor: Float
    first: Int32
    pixels: int
    shots: int

    def __call__(self, pixel: UInt32, index: UInt32) -> Float:
        """Return the factors of pixels of shots by their indices, 0 to m − 1; Dr.Jit arrays of one shape."""
        step = auto.Int32(pixel) - dr.gather(auto.Int32, self.first, index)
        near = (step >= 0) & (step < dr.opaque(auto.Int32, self.pixels))
        at = auto.UInt32(step) * dr.opaque(auto.UInt32, self.shots) + index
        return dr.select(near, dr.gather(auto.Float, self.factor, at, near), 1.0)


@dataclass
class _Spot:
    """A spot of m shots, Dr.Jit arrays of shape (m,): its light, and C² of it."""

    amount: Float
    position: Float
    variance: Float
    coherence: Float


def line_speckle(
    light: LineLight,
    positions: SurfacePoints,
    optics: Optics,
    focal_length: float,
    seen_at: Callable[[Float], ArrayPlace],
    travel: tuple[Float, Float],
    pixels: int,
    seed: Seed,
    *,
    fixed_size: bool = False,
) -> LineSpeckle:
    """Return the speckle of m shots.

    Parameters
    ----------
    light
        Their light as it is on the average.
    positions
        Where their beams are.
    optics
        The optics.
    focal_length
        Of the lens, in pixels.
    seen_at
        How the array sees the beam of the shots at positions [pixel], shape (m,); lengths in pixels.
    travel
        Angles by which the beam moves in the dwell along the line's direction and across it [rad], numbers or Dr.Jit
        arrays of shape (m,).
    pixels
        Pixels of the line.
    seed
        Seed of the patterns: a function of (seed, object, position of the beam on it) and of nothing else.
    fixed_size
        Whether the tables have room for the whole line, whatever is lit: their size then does not depend on the light.

    Returns
    -------
    LineSpeckle
    """
    beam = dr.square(0.5 * dr.opaque(auto.Float, focal_length) * positions.radius / positions.distance)
    spots = _spots(light, beam)
    along, across = (
        (dr.opaque(auto.Float, way) if isinstance(way, float) else way) * positions.distance for way in travel
    )
    left = dwell_average(along, across, positions.radius)
    blur = dr.opaque(auto.Float, optics.aberration**2 + optics.diffusion**2)
    aberration = dr.opaque(auto.Float, optics.aberration**2)
    parts = []
    for number, spot in enumerate(spots):
        seen = seen_at(spot.position)
        image = (spot.variance - seen.spread(blur, aberration)) / dr.square(seen.along)
        own = packets_of(optics, dr.maximum(image, _LEAST_IMAGE_VARIANCE * beam), beam, seen)
        ratios = mode_ratios(optics, own.ratio)
        parts.append((spot, own, ratios, _amplitudes(spot, own, left, positions, len(ratios), number, seed)))
    first, count = _pixels_lit(spots, pixels)
    dr.eval(first, count, parts)
    # A GPU has room for whole lines, and would wait while the host asks how long they are.
    on_gpu = dr.backend_v(auto.Float) == dr.JitBackend.CUDA
    steps = pixels if fixed_size or on_gpu else int(dr.max(count)[0])
    return LineSpeckle(_factors(parts, first, count, steps), first, steps, light.shots)


def _spots(light: LineLight, beam: Float) -> list[_Spot]:
    """Gather the coherent light of each shot into one spot, or into two where its clusters leave a gap."""
    m = light.shots
    shot = dr.arange(auto.UInt32, m)

    def cluster(number: UInt32) -> list[Float]:
        at = shot + number * dr.opaque(auto.UInt32, m)
        return [
            dr.gather(auto.Float, values, at)
            for values in (light.amount, light.position, light.sigma, light.coherence)
        ]

    if light.count == 1:
        amount, position, sigma, coherence = cluster(auto.UInt32(0))
        return [_Spot(amount, position, dr.square(sigma), coherence)]
    gap = _LEAST_GAP * dr.sqrt(beam)

    def add(number: UInt32, last: Float, second: Mask, *sums: Float) -> tuple[Any, ...]:
        amount, position, sigma, coherence = cluster(number)
        amount = dr.select(coherence > 0.0, amount, 0.0)
        lit = amount > 0.0
        second = second | (lit & (position - last > gap))
        # Moments about the first lit cluster: about pixel 0 the variance would drown in rounding.
        origin = dr.select(lit & ~dr.isfinite(last), position, sums[0])
        away = position - origin
        moments = (amount, amount * away, amount * (dr.square(away) + dr.square(sigma)), amount * coherence)
        added = [
            total + dr.select(second == bool(part), moment, 0.0)
            for part in (0, 1)
            for total, moment in zip(sums[1 + 4 * part : 5 + 4 * part], moments, strict=True)
        ]
        return dr.select(lit, position, last), second, origin, *added

    zeros = [dr.zeros(auto.Float, m) for _ in range(9)]
    start = (dr.full(auto.Float, dr.inf, m), dr.full(auto.Bool, False, m), *zeros)
    _, _, origin, *sums = for_each(light.count, add, *start)
    spots = []
    for part in (0, 1):
        amount, first, second, contrast = sums[4 * part : 4 * part + 4]
        over = dr.rcp(dr.maximum(amount, 1e-30))
        away = first * over
        spots.append(_Spot(amount, origin + away, second * over - dr.square(away), contrast * over))
    return spots


def _pixels_lit(spots: list[_Spot], pixels: int) -> tuple[Int32, Int32]:
    """Return the first pixel that speckle is followed on, and their number, shape (m,)."""
    low, high = auto.Float(dr.inf), auto.Float(-dr.inf)
    for spot in spots:
        lit = spot.amount > 0.0
        away = _SPOT_SIGMAS * dr.sqrt(dr.maximum(spot.variance, 0.0)) + 0.5
        low = dr.select(lit, dr.minimum(low, spot.position - away), low)
        high = dr.select(lit, dr.maximum(high, spot.position + away), high)
    first = auto.Int32(dr.clip(dr.floor(low), 0.0, pixels - 1.0))
    last = auto.Int32(dr.clip(dr.ceil(high), 0.0, pixels - 1.0))
    return first, dr.maximum(last - first + 1, 1)


def _amplitudes(
    spot: _Spot,
    own: Packets,
    left: tuple[Float, Float],
    positions: SurfacePoints,
    count: int,
    number: int,
    seed: Seed,
) -> list[Float]:
    """Return the amplitudes of the energy and of so many other modes, each over (rσ)ⁿ/√n!, shape (m,)."""
    energy, position = own.moving(*left)
    spread = dr.sqrt(spot.coherence * own.energy)
    if number == 0:
        first = fine_numbers(positions, seed)
        others = coarse_numbers(positions, count, 1, seed)
    else:
        # The second of two spots is seldom there: its energy and position may have the other modes' correlation.
        others = coarse_numbers(positions, count + 2, 2, seed)
        first, others = others[:2], others[2:]
    tilt = dr.sqrt(own.on_surface) * first[1] + dr.sqrt(1.0 - own.on_surface) * others[0]
    amplitude = spread * dr.sqrt(position)
    return [
        gamma_like(spread * dr.sqrt(energy), first[0]) - 1.0,
        amplitude * tilt,
        *(amplitude * other for other in others[1:]),
    ]


def _factors(
    parts: list[tuple[_Spot, Packets, list[Float], list[Float]]], first: Int32, count: Int32, steps: int
) -> Float:
    """Return the table of :class:`LineSpeckle`."""
    m = dr.width(first)
    shot, shots = dr.arange(auto.UInt32, m), dr.opaque(auto.UInt32, m)
    table = dr.full(auto.Float, 1.0, steps * m)
    dr.make_opaque(table)

    def edges(position: Float) -> list[Float]:
        """Return light and fluctuation of each spot up to a position [pixel]."""
        found = []
        for spot, own, ratios, amplitudes in parts:
            away = position - spot.position
            mean = 0.5 * dr.erf(away * dr.rsqrt(2.0 * spot.variance))
            modes = mode_edges(ratios, away / own.sigma)
            total = auto.Float(0.0)
            for amplitude, mode in zip(amplitudes, modes, strict=True):
                total = dr.fma(amplitude, mode, total)
            found += [mean, total]
        return found

    def settle(step: UInt32, *before: Float) -> tuple[Any, ...]:
        after = edges(auto.Float(first + auto.Int32(step)) + 0.5)
        charge, change = auto.Float(0.0), auto.Float(0.0)
        for number, (spot, *_) in enumerate(parts):
            mean, total = (after[2 * number + k] - before[2 * number + k] for k in (0, 1))
            lit = (spot.amount > 0.0) & (mean > _LEAST_SHARE)
            charge += dr.select(lit, spot.amount * mean, 0.0)
            change += dr.select(lit, spot.amount * total, 0.0)
        factor = dr.select(charge > 0.0, dr.maximum(1.0 + change / charge, 0.0), 1.0)
        dr.scatter(table, factor, step * shots + shot)
        return step + 1, *after

    start = (dr.zeros(auto.UInt32, m), *edges(auto.Float(first) - 0.5))
    dr.while_loop(start, lambda step, *rest: auto.Int32(step) < count, settle)
    dr.eval(table)
    return table
