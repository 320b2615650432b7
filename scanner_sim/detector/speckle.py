"""Speckle on the line: how the charge of each pixel departs from the mean image of the laser's light.

The charge of pixel i is Q_i s_i. Q_i = ∫ e dx is the mean image on it, a sum of Gaussian clusters e_k, and s_i has mean
1, the variance

    v_i = [Σ_k b_ki √(C_k² ρ_k / M)]² / Q_i²,   b_ki² ≈ D ∫_i e_k² dx   (:func:`concentration`),

and the correlation of :class:`~scanner_sim.optics.speckle.Grain` with its neighbours. ρ_k is the pixel's variance under
an even light, for the cluster's own extent. This is exact for one cluster and cells that are small against the pixel or
pixels that are small against the spot; for several clusters it takes their profiles within a pixel to be alike (at most
8 % too much variance where they differ by the spot's width) and wider than half a pixel. Integrated speckle is nearly
gamma distributed (Goodman, *Speckle phenomena in optics*, 2007, sec 4.6); the gamma numbers come from correlated normal
ones by the cube of Wilson and Hilferty (*PNAS* 17, 1931), which keeps the mean to v³/729.

The pattern belongs to the beam's place on the surface. A Gaussian beam of 1/e² radius w that moves by δ keeps the
fields' correlation ∫A(x) A(x − δ) dx = exp(−δ²/2w²), hence that of the intensities exp(−δ²/w²) (Goodman, sec 6.1;
Yoshimura, *J. Opt. Soc. Am. A* 3, 1986). Here normal numbers lie on a lattice of (Θ, φ) R/w, of pitch
π/(2√2) radii, and are combined with the weights cos(πt/2), sin(πt/2) of each axis, whose squares sum to 1: averaged
over the lattice the correlation is (1 − δ/2a) cos(πδ/2a) + sin(πδ/2a)/π up to δ = 2a, within 0.03 of the Gaussian.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import drjit as dr
import drjit.auto.ad as auto

from scanner_sim.optics.laser import Laser
from scanner_sim.optics.speckle import Grain, patterns
from scanner_sim.streams import Stream, generator

CELL = math.pi / (2.0 * math.sqrt(2.0))
"""Pitch of the lattice of patterns, in 1/e² radii of the beam."""
_FOLLOWED = 4.0
"""Standard deviations of a cluster within which its speckle is followed: beyond lies 6e-5 of its light."""
_TAIL = 3.0
"""Standard deviations from which a Gaussian is an exponential within a pixel: there erf runs out of digits."""
_COARSEST = 20.0
"""Length of the grain [pixel] from which a pixel is a point."""


class LineLight(Protocol):
    """Gaussian clusters of light of m shots, Dr.Jit arrays of shape (c · m,): entry k · m + j is cluster k of shot j.

    ``amount`` [W], ``position`` and ``sigma`` [pixel] along the line, ``across`` mean square distance from its middle
    [pixel²], ``coherence`` C² of the light; ``shots`` m, ``count`` c.
    """

    amount: Any
    position: Any
    sigma: Any
    across: Any
    coherence: Any
    shots: int

    @property
    def count(self) -> int:
        """Number c of clusters of each shot."""


@dataclass
class BeamPlaces:
    """Where beams meet their surfaces, Dr.Jit arrays of shape (m,).

    ``horizontal`` and ``vertical`` place in pitches of the lattice; ``slimness`` range over the beam's radius, R/w.
    """

    horizontal: Any
    vertical: Any
    slimness: Any

    @classmethod
    def of(cls, theta: Any, phi: Any, distance: Any, laser: Laser) -> BeamPlaces:
        """Return the places of beams of true deflections Θ, φ [rad] that go a distance [m], Dr.Jit, shape (m,).

        A beam whose axis meets nothing (NaN) counts as one in the far field.
        """
        waist = dr.opaque(auto.Float, laser.waist_radius)
        rayleigh = dr.opaque(auto.Float, laser.rayleigh_length)
        twist = (distance - dr.opaque(auto.Float, laser.waist_distance)) / rayleigh
        slimness = distance * dr.rsqrt(1.0 + dr.square(twist)) / waist
        slimness = dr.select(dr.isfinite(slimness), slimness, rayleigh / waist)
        scale = slimness / CELL
        return cls(theta * scale, phi * dr.cos(theta) * scale, slimness)


@dataclass
class LineSpeckle:
    """What multiplies the laser's light on the pixels of m shots: tables about the light of each shot.

    ``factor`` entry k · m + j is pixel ``first``[j] + k of shot j; all other pixels keep their light.
    """

    factor: Any
    first: Any
    pixels: int
    shots: int

    def __call__(self, pixel: Any, place: Any) -> Any:
        """Return the factors of pixels of the shots at some places, 0 to m − 1; Dr.Jit arrays of one shape."""
        step = auto.Int32(pixel) - dr.gather(auto.Int32, self.first, place)
        near = (step >= 0) & (step < dr.opaque(auto.Int32, self.pixels))
        at = auto.UInt32(step) * dr.opaque(auto.UInt32, self.shots) + place
        return dr.select(near, dr.gather(auto.Float, self.factor, at, near), 1.0)


def line_speckle(
    light: LineLight,
    places: BeamPlaces,
    grain: Grain,
    sweep: Any,
    pixels: int,
    seed: int,
    *,
    whole: bool = False,
) -> LineSpeckle:
    """Return the speckle of m shots.

    Parameters
    ----------
    light
        Their light as it is on the average.
    places
        Where their beams are.
    grain
        The speckle's grain on the line.
    sweep
        Angle by which the beam moves in the dwell [rad], a number or a Dr.Jit array of shape (m,).
    pixels
        Pixels of the line.
    seed
        Seed of the patterns: a function of (seed, place of the beam, pixel) and of nothing else.
    whole
        Whether the tables have room for the whole line, whatever is lit: their size then does not depend on the light.

    Returns
    -------
    LineSpeckle
    """
    first, last = _groups_lit(light, grain.reach, pixels)
    count = auto.UInt32(last - first + 1)
    dr.eval(first, count)
    groups = (pixels + 2 * grain.reach) // 4 + 2 if whole else int(dr.max(count)[0])
    turned = dr.opaque(auto.Float, sweep) if isinstance(sweep, float) else sweep
    averaged = patterns(turned, places.slimness)
    shot = dr.arange(auto.UInt32, light.count * light.shots) % dr.opaque(auto.UInt32, light.shots)
    even = light.coherence * pixel_variance(grain, dr.square(light.sigma), light.across)
    amplitude = dr.sqrt(even / dr.gather(auto.Float, averaged, shot))
    white = _white(places, first, count, groups, seed)
    dr.eval(amplitude, white)
    factor = _factors(light, amplitude, white, first, count, groups, grain)
    return LineSpeckle(factor, 4 * first, 4 * groups, light.shots)


def _groups_lit(light: LineLight, reach: int, pixels: int) -> tuple[Any, Any]:
    """Return the first and the last group of four pixels that speckle is followed on, shape (m,)."""
    shot = dr.arange(auto.UInt32, light.shots)
    low, high = dr.full(auto.Float, dr.inf, light.shots), dr.full(auto.Float, -dr.inf, light.shots)
    for number in range(light.count):
        at = shot + number * light.shots
        lit = dr.gather(auto.Float, light.amount, at) > 0.0
        middle = dr.gather(auto.Float, light.position, at)
        away = _FOLLOWED * dr.gather(auto.Float, light.sigma, at) + 0.5
        low = dr.select(lit, dr.minimum(low, middle - away), low)
        high = dr.select(lit, dr.maximum(high, middle + away), high)
    start = dr.clip(dr.floor(low), 0.0, pixels - 1.0) - reach
    end = dr.clip(dr.ceil(high), 0.0, pixels - 1.0) + reach
    first = auto.Int32(dr.floor(0.25 * start))
    return first, dr.maximum(auto.Int32(dr.floor(0.25 * end)), first)


def _white(places: BeamPlaces, first: Any, count: Any, groups: int, seed: int) -> Any:
    """Return independent normal numbers of the pixels: entry (g · m + j) · 4 + k is pixel 4 (first[j] + g) + k.

    Shot j has ``count[j]`` groups, none has more than ``groups``.
    """
    m = dr.width(first)
    shot, shots = dr.arange(auto.UInt32, m), dr.opaque(auto.UInt32, m)
    nodes = []
    for coordinate in (places.horizontal, places.vertical):
        node = dr.floor(coordinate)
        sine, cosine = dr.sincos(0.5 * math.pi * (coordinate - node))
        nodes.append(((auto.Int32(node), cosine), (auto.Int32(node) + 1, sine)))
    corners = [
        (auto.UInt32(column & 0xFFFF) | (auto.UInt32(row & 0xFFFF) << 16), across * down)
        for column, across in nodes[0]
        for row, down in nodes[1]
    ]
    # Groups may begin before the array: the address must not be negative.
    sample = auto.UInt32(first + 0x10000)
    white = dr.zeros(auto.Float, 4 * groups * m)

    def draw(group: Any) -> tuple[Any]:
        total = auto.Array4f(0.0)
        for cell, weight in corners:
            normal = generator(seed, Stream.SPECKLE, cell, sample + group).next_float32x4_normal()
            total += weight * auto.Array4f(normal)
        dr.scatter(white, total, group * shots + shot)
        return (group + 1,)

    dr.while_loop((dr.zeros(auto.UInt32, m),), lambda group: group < count, draw)
    return white


def _factors(
    light: LineLight, amplitude: Any, white: Any, first: Any, count: Any, groups: int, grain: Grain
) -> Any:
    """Return the table of :class:`LineSpeckle`."""
    m, reach = light.shots, grain.reach
    shot, shots = dr.arange(auto.UInt32, m), dr.opaque(auto.UInt32, m)
    clusters = light.count
    weights = [dr.opaque(auto.Float, weight) for weight in grain.taps]
    table = dr.full(auto.Float, 1.0, 4 * groups * m)
    dr.make_opaque(table)

    def share(number: Any, pixel: Any, charge: Any, deviation: Any) -> tuple[Any, Any]:
        at = shot + number * shots
        sigma = dr.gather(auto.Float, light.sigma, at)
        apart = dr.abs(pixel - dr.gather(auto.Float, light.position, at))
        amount = dr.gather(auto.Float, light.amount, at)
        near = (amount > 0.0) & (apart < _FOLLOWED * sigma + 0.5)
        part = amount * gaussian_share(apart, sigma)
        concentrated = concentration if clusters == 1 else quick_concentration
        spread = dr.sqrt(concentrated(apart, sigma, grain)) * dr.gather(auto.Float, amplitude, at)
        return charge + dr.select(near, part, 0.0), deviation + dr.select(near, part * spread, 0.0)

    def settle(step: Any) -> tuple[Any]:
        pixel, zero = auto.Float(4 * first + auto.Int32(step)), dr.zeros(auto.Float, m)
        if clusters == 1:
            charge, deviation = share(auto.UInt32(0), pixel, zero, zero)
        else:
            _, charge, deviation = dr.while_loop(
                (auto.UInt32(0), zero, auto.Float(zero)),
                lambda number, *sums: number < clusters,
                lambda number, *sums: (number + 1, *share(number, pixel, *sums)),
            )
        normal = auto.Float(0.0)
        for tap, weight in enumerate(weights):
            here = step + tap - reach
            number = dr.gather(auto.Float, white, (here // 4 * shots + shot) * 4 + here % 4)
            normal = dr.fma(weight, number, normal)
        factor = dr.select(charge > 0.0, gamma_like(deviation / charge, normal), 1.0)
        dr.scatter(table, factor, step * shots + shot)
        return (step + 1,)

    end = 4 * count - reach
    dr.while_loop((dr.full(auto.UInt32, reach, m),), lambda step: step < end, settle)
    dr.eval(table)
    return table


def gamma_like(deviation: Any, normal: Any) -> Any:
    """Return numbers of mean 1 and a standard deviation, nearly gamma distributed, from standard normal ones.

    (1 − v/9 + √v z/3)³ with the variance v (Wilson and Hilferty, *PNAS* 17, 1931), not below 0.
    """
    root = dr.maximum(1.0 + deviation * (normal * (1.0 / 3.0) - deviation * (1.0 / 9.0)), 0.0)
    return root * dr.square(root)


def gaussian_share(apart: Any, sigma: Any) -> Any:
    """Return the share of a Gaussian on a pixel whose centre is ``apart``, 0 or more, from its middle [pixel]."""
    scale = math.sqrt(0.5) / sigma
    return 0.5 * (dr.erf((apart + 0.5) * scale) - dr.erf((apart - 0.5) * scale))


def concentration(apart: Any, sigma: Any, grain: Grain) -> Any:
    """Return by how much a pixel's relative variance exceeds that under an even light.

    Parameters
    ----------
    apart
        Distance of the pixel's centre from the middle of a Gaussian e, 0 or more [pixel].
    sigma
        Standard deviation of the Gaussian [pixel].
    grain
        The grain.

    Notes
    -----
    For fine grain it is κ = D ∫_i e² dx / (∫_i e dx)²; in the tail, where e is nearly exponential with the slope
    a = apart/σ², (a/2) coth(a/2). The light then fills the share 1/κ of the pixel only, and its grain loses the more
    to the next pixel: κ (1 − ℓκ)/(1 − ℓ) to first order in the loss ℓ under an even light, at least κ/2.
    """
    part = gaussian_share(apart, sigma)
    scale = dr.rcp(sigma)
    square = dr.erf((apart + 0.5) * scale) - dr.erf((apart - 0.5) * scale)
    square *= 0.25 / math.sqrt(math.pi) * scale
    half = dr.minimum(0.5 * apart * dr.square(scale), 40.0)
    decay = dr.exp(-2.0 * half)
    tail = half * (1.0 + decay) / dr.maximum(1.0 - decay, 1e-6)
    core = apart < _TAIL * sigma
    return _less_lost(
        dr.maximum(dr.select(core, square / dr.square(dr.maximum(part, 1e-6)), tail), 1.0), grain
    )


def quick_concentration(apart: Any, sigma: Any, grain: Grain) -> Any:
    """Return :func:`concentration` of spots wider than half a pixel, which are exponentials within it.

    κ = x coth x with x = apart/2σ², by its Padé approximant (15 + 6x²)/(15 + x²), good to 1.5 % up to x = 2.
    """
    squared = dr.square(0.5 * apart / dr.square(sigma))
    return _less_lost((15.0 + 6.0 * squared) / (15.0 + squared), grain)


def _less_lost(crowding: Any, grain: Grain) -> Any:
    """Return κ (1 − ℓκ)/(1 − ℓ), at least κ/2."""
    loss = dr.opaque(auto.Float, grain.loss)
    return crowding * dr.maximum((1.0 - loss * crowding) / (1.0 - loss), 0.5)


def pixel_variance(grain: Grain, along: Any, across: Any) -> Any:
    """Return the relative variance ρ of a pixel's charge for C = 1 under a light of finite extent.

    Parameters
    ----------
    grain
        The grain, with its ρ_0.
    along, across
        Variances of the light along and across the line [pixel²], Dr.Jit.

    Notes
    -----
    For Gaussian light and a Gaussian grain exp(−Δ²/2s²) the integral across is s/√(s² + 2σ_y²), and along
    the line the grain narrows to 1/s² + 1/2σ_x²; these factors relate a light to that of ``grain``.
    """
    squared = dr.opaque(auto.Float, grain.length**2)
    reference = dr.opaque(auto.Float, grain.length**2 + 2.0 * grain.across**2)
    seen = dr.sqrt(reference / (squared + 2.0 * across))
    narrowed = dr.sqrt(squared / (1.0 + 0.5 * squared / along))
    ratio = _box(narrowed) / _box(dr.opaque(auto.Float, grain.length))
    return dr.opaque(auto.Float, grain.variance) * seen * ratio


def _box(length: Any) -> Any:
    """Return ∫∫ exp(−(x − x')²/2s²) dx dx' over a pixel, for s in pixels."""
    s = dr.minimum(length, _COARSEST)
    inverse = dr.rcp(s)
    squares = 2.0 * dr.square(s) * (1.0 - dr.exp(-0.5 * dr.square(inverse)))
    return math.sqrt(2.0 * math.pi) * s * dr.erf(math.sqrt(0.5) * inverse) - squares
