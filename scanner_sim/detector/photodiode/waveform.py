"""Waveforms: from pulses of light on the photodiode to digital numbers.

Each echo is the pulse at its own delay, widened by the depth of what it met and by the electronics, evaluated at the
samples' times in closed form: there are no bins of range. Shot noise follows the light, is filtered with the other
noise by the electronics, and clipped and rounded with the signal (the chain: Richmond and Cain, *Direct-detection LADAR
systems*, SPIE Press, 2010, ch. 3).

Not modelled: the avalanche's rise with gain (gain–bandwidth product), its sag under strong light, slow recovery after
saturation, the droop of AC coupling, aperture jitter between the samples of one record, and non-Gaussian statistics of
the avalanche's gain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import drjit as dr
import drjit.auto.ad as auto
import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.photodiode.noise_colour import colouring_taps, light_noise_variance
from scanner_sim.detector.photodiode.photodiode import Digitiser, Photodiode
from scanner_sim.detector.photodiode.pulse_response import DeviceResponse, PulseResponse
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.device_streams import generator
from scanner_sim.foundation.device_types import Float, Int32, UInt32
from scanner_sim.foundation.streams import Seed, Stream
from scanner_sim.optics.pulse import Pulse

BLOCK = 64
"""Shots whose records are stored interleaved: a block fits the cache, and neighbours load together."""
_ECHO_SIGMAS = 7.0
"""Standard deviations to which an echo is followed."""


class ReceivedEchoes(Protocol):
    """Light that comes back, of m shots with c Gaussian echoes each: k · m + j is echo k of shot j.

    ``amount`` the share of the pulse's power that reaches the photodiode; ``position`` the path there and back [m],
    counted from the shot's ``reference`` (shape (m,)), and its standard deviation ``sigma`` [m].
    """

    amount: Float
    position: Float
    sigma: Float
    reference: Float


@dataclass
class Waveforms:
    """Digitised records of m shots.

    Attributes
    ----------
    number
        Digital numbers, Dr.Jit float array; :meth:`address` gives the index of each.
    shots, samples
        Number m of shots, and n of samples of each.
    background
        Light of the background [W] that the bias monitor measured, shape (m,).
    """

    number: Float
    shots: int
    samples: int
    background: Float

    def address(self, sample: UInt32, index: UInt32) -> UInt32:
        """Return where in ``number`` a sample (0 to n − 1) of shot ``index`` (0 to m − 1) stands."""
        row = index // BLOCK * (self.samples // 4) + sample // 4
        return 4 * (row * BLOCK + index % BLOCK) + sample % 4

    def records(self) -> NDArray[np.float32]:
        """Return the digital numbers as a NumPy array of shape (m, n)."""
        blocks = self.number.numpy().reshape(-1, self.samples // 4, BLOCK, 4)
        records = blocks.transpose(0, 2, 1, 3).reshape(-1, self.samples)[: self.shots]
        return np.ascontiguousarray(records)


class ClockErrors(NamedTuple):
    """How a clock departs from its design: ``zero``, by which ranges read too far [m], and ``scale`` of delays."""

    zero: float = 0.0
    scale: float = 0.0


EXACT_CLOCK = ClockErrors()


@dataclass
class Arrivals:
    """Echoes in the clock's own time: sample ``first`` + ``position`` [sample], ``variance`` [sample²], ``power`` [W].

    ``power`` is per density of the pulse in samples; ``early`` and ``late`` are the samples between which a shot's
    light arrives.
    """

    first: Int32
    position: Float
    variance: Float
    power: Float
    early: Float
    late: Float
    shots: int
    count: int

    def light(self, sample: Int32, index: UInt32, response: DeviceResponse, extra: float) -> list[Float]:
        """Return the light [W] at four samples in a row, smoothed by a Gaussian of ``extra`` [sample²].

        Four at a time, because reading an echo takes as long as evaluating it.
        """
        more = dr.opaque(auto.Float, extra)
        early, late = (dr.gather(auto.Float, end, index) for end in (self.early, self.late))
        sample = auto.Float(auto.Int32(sample) - dr.gather(auto.Int32, self.first, index))
        near = (sample + 3.0 > early) & (sample < late)

        def added(*state: Any) -> tuple[Any, ...]:
            number, *totals = state
            at = index + number * dr.opaque(auto.UInt32, self.shots)
            apart = sample - dr.gather(auto.Float, self.position, at)
            variance = dr.gather(auto.Float, self.variance, at) + more
            power = dr.gather(auto.Float, self.power, at)
            four = response.four(apart, variance)
            return number + 1, *(
                dr.fma(power, value, total) for value, total in zip(four, totals, strict=True)
            )

        start = (auto.UInt32(0), *(dr.zeros(auto.Float, dr.width(index)) for _ in range(4)))
        if self.count == 1:
            return [dr.select(near, value, 0.0) for value in added(*start)[1:]]
        return list(dr.while_loop(start, lambda number, *totals: near & (number < self.count), added)[1:])


def record(
    echoes: ReceivedEchoes,
    shot: UInt32,
    pulse: Pulse,
    photodiode: Photodiode,
    digitiser: Digitiser,
    seed: Seed,
    background: Float = 0.0,
    clock: ClockErrors = EXACT_CLOCK,
) -> Waveforms:
    """Record the waveforms of m shots.

    Parameters
    ----------
    echoes
        What comes back.
    shot
        Numbers of the shots (they address the noise), shape (m,), Dr.Jit unsigned.
    pulse, photodiode, digitiser
        The instrument.
    seed
        Seed of the noise, or that of each shot.
    background
        Light of Sun and Earth on the photodiode [W], shape (m,) or one number: shot noise, since AC coupling takes
        the direct current off.
    clock
        How the clock departs from its design.

    Returns
    -------
    Waveforms
    """
    m, n = dr.width(shot), digitiser.samples
    background = auto.Float(background) + dr.zeros(auto.Float, m)
    arrivals = arrive(echoes, shot, pulse, photodiode, digitiser, seed, clock)
    sigma = photodiode.response_sigma * digitiser.rate
    response = PulseResponse.of(pulse, digitiser.rate)
    electrical = response.on_device(sigma**2)
    blocks = (m + BLOCK - 1) // BLOCK
    lane = dr.arange(auto.UInt32, blocks * (n // 4) * BLOCK)
    quad, index = _quad_and_index(lane, n // 4, m)
    noisy = photodiode.noise.shot or photodiode.noise.amplifier
    taps = colouring_taps(sigma)
    if noisy:
        white = _white(arrivals, shot, photodiode, response, sigma, seed, background, n)
        quads = n // 4 + (taps.size - 1) // 4
        around = [
            dr.gather(auto.Array4f, white, _lane(quad + step, index, quads))
            for step in range((taps.size - 1) // 4 + 1)
        ]
        under = [four[component] for four in around for component in range(4)]
        weights = [dr.opaque(auto.Float, float(tap)) for tap in taps]
    numbers = []
    lit = arrivals.light(4 * quad, index, electrical, sigma**2)
    scale = dr.opaque(auto.Float, photodiode.amperes_per_watt)
    step = dr.opaque(auto.Float, digitiser.step(photodiode.saturation))
    for side in range(4):
        current = scale * lit[side]
        if noisy:
            for tap, weight in enumerate(weights):
                current = dr.fma(weight, under[side + tap], current)
        if photodiode.noise.saturation:
            full = dr.opaque(auto.Float, photodiode.saturation)
            current = dr.clip(current, -full / 16.0, full)
        number = current / step
        numbers.append(dr.round(number) if photodiode.noise.quantisation else number)
    number = dr.empty(auto.Float, 4 * dr.width(lane))
    dr.scatter(number, auto.Array4f(*numbers), lane)
    dr.eval(number, background)
    return Waveforms(number, m, n, background)


def arrive(
    echoes: ReceivedEchoes,
    shot: UInt32,
    pulse: Pulse,
    photodiode: Photodiode,
    digitiser: Digitiser,
    seed: Seed,
    clock: ClockErrors = EXACT_CLOCK,
) -> Arrivals:
    """Return when echoes arrive by the digitiser's clock.

    Pulses follow each other evenly, and so do their echoes: of those of one surface the record has the one that comes
    nearest to its middle, whichever pulse it is of. The reference of each shot is reckoned in double precision, all
    else relative to it.
    """
    m, count = dr.width(shot), dr.width(echoes.amount) // dr.width(shot)
    drift, jitter = (digitiser.drift, digitiser.jitter) if photodiode.noise.clock else (0.0, 0.0)
    rate = digitiser.rate * (1.0 + drift + clock.scale)
    per_metre = dr.opaque(auto.Float64, rate / SPEED_OF_LIGHT)
    period = dr.opaque(auto.Float64, digitiser.rate / pulse.repetition_rate)
    shift = dr.opaque(auto.Float64, 2.0 * clock.zero * rate / SPEED_OF_LIGHT)
    when = auto.Float64(echoes.reference) * per_metre + shift
    when = when - dr.opaque(auto.Float64, digitiser.start * digitiser.rate)
    when = when - period * dr.round((when - dr.opaque(auto.Float64, 0.5 * digitiser.samples)) / period)
    normal = generator(seed, Stream.CLOCK, shot, auto.UInt32(0)).next_float32x4_normal()[0]
    when = when + auto.Float64(normal * dr.opaque(auto.Float, jitter * digitiser.rate))
    first = dr.floor(when)
    fraction = auto.Float(when - first)
    step = dr.opaque(auto.UInt32, m)
    index = dr.arange(auto.UInt32, m * count) % step
    to_samples = dr.opaque(auto.Float, rate / SPEED_OF_LIGHT)
    position = echoes.position * to_samples + dr.gather(auto.Float, fraction, index)
    spread = echoes.sigma * to_samples
    power = echoes.amount * dr.opaque(auto.Float, pulse.pulse_energy * digitiser.rate)
    response = PulseResponse.of(pulse, digitiser.rate)
    sigma = photodiode.response_sigma * digitiser.rate
    # The window holds both the optical and the electrical pulse: the later is the wider one.
    low, high = response.span(sigma**2)
    shots = dr.arange(auto.UInt32, m)
    early, late = dr.full(auto.Float, dr.inf, m), dr.full(auto.Float, -dr.inf, m)
    for number in range(count):
        at = shots + number * step
        lit = dr.gather(auto.Float, power, at) > 0.0
        middle, reach = dr.gather(auto.Float, position, at), _ECHO_SIGMAS * dr.gather(auto.Float, spread, at)
        early = dr.select(lit, dr.minimum(early, middle + dr.opaque(auto.Float, low) - reach), early)
        late = dr.select(lit, dr.maximum(late, middle + dr.opaque(auto.Float, high) + reach), late)
    arrivals = Arrivals(auto.Int32(first), position, dr.square(spread), power, early, late, m, count)
    dr.eval(arrivals.first, position, arrivals.variance, power, early, late)
    return arrivals


def quad_lanes(shots: int, samples: int) -> tuple[UInt32, UInt32, UInt32]:
    """Return lanes of four samples each in the order of storage: lane, number of the four, index of the shot."""
    blocks = (shots + BLOCK - 1) // BLOCK
    lane = dr.arange(auto.UInt32, blocks * (samples // 4) * BLOCK)
    return (lane, *_quad_and_index(lane, samples // 4, shots))


def _quad_and_index(lane: UInt32, quads: int, shots: int) -> tuple[UInt32, UInt32]:
    row = lane // BLOCK
    block = row // quads
    index = block * BLOCK + lane % BLOCK
    # The last block may be filled in part.
    return row - block * quads, dr.minimum(index, dr.opaque(auto.UInt32, shots - 1))


def _lane(quad: UInt32, index: UInt32, quads: int) -> UInt32:
    return (index // BLOCK * quads + quad) * BLOCK + index % BLOCK


def _white(
    arrivals: Arrivals,
    shot: UInt32,
    photodiode: Photodiode,
    response: PulseResponse,
    sigma: float,
    seed: Seed,
    background: Float,
    samples: int,
) -> Float:
    """Return white noise [A] before the electronics, for the samples and half a filter on either side."""
    half = colouring_taps(sigma).size // 2
    quads = samples // 4 + half // 2
    lane, quad, index = quad_lanes(arrivals.shots, 4 * quads)
    own = dr.gather(auto.UInt64, seed, index) if dr.is_array_v(seed) else seed
    normal = generator(
        own, Stream.PHOTODIODE, dr.gather(auto.UInt32, shot, index), quad
    ).next_float32x4_normal()
    extra = light_noise_variance(sigma)
    optical = response.on_device(extra)
    per_light = dr.opaque(auto.Float, photodiode.light_variance)
    steady = dr.opaque(auto.Float, photodiode.dark_variance) + per_light * dr.gather(
        auto.Float, background, index
    )
    variances = [steady] * 4
    if photodiode.noise.shot:
        lit = arrivals.light(auto.Int32(4 * quad) - half, index, optical, extra)
        variances = [dr.fma(per_light, light, steady) for light in lit]
    values = [dr.sqrt(variance) * normal[side] for side, variance in enumerate(variances)]
    white = dr.empty(auto.Float, 4 * dr.width(lane))
    dr.scatter(white, auto.Array4f(*values), lane)
    dr.eval(white)
    return white


def quantisation_variance(photodiode: Photodiode, digitiser: Digitiser) -> float:
    """Return the variance of rounding, step²/12 [A²] (Bennett, *Bell System Technical Journal* 27, 1948)."""
    step = digitiser.step(photodiode.saturation)
    return step**2 / 12.0 if photodiode.noise.quantisation else 0.0


def noise_sigma(photodiode: Photodiode, digitiser: Digitiser, background: float) -> float:
    """Return the standard deviation [A] of a sample without signal under some background [W]."""
    steady = photodiode.dark_variance + photodiode.light_variance * background
    return math.sqrt(steady + quantisation_variance(photodiode, digitiser))
