"""How the mirrors follow their commands: a second-order servo with limits, exact between updates of the drive.

Three angles belong to each instant: the *commanded* one, the *true* one of the shaft, which lags behind, and the one
that is *measured*, which the encoder latched a little earlier (to it :mod:`scanner_sim.detector.encoders` adds noise
and steps). Angles are optical, twice the mechanical ones. Jitter, wobble and drift are
:class:`~scanner_sim.optics.deflection.Mirrors`'.
"""

from __future__ import annotations

import cmath
import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from scanner_sim.foundation.parts import Part
from scanner_sim.foundation.units import Angle, Dimension, Frequency, Ratio, Time

Array = NDArray[np.float64]

AngleRate = Annotated[float, Dimension("rad/s", ("280 rad/s",))]
AngleAcceleration = Annotated[float, Dimension("rad/s^2", ("2e5 rad/s^2",))]


class Galvanometers(Part):
    """The servos of the two mirrors, which are alike."""

    natural_frequency: Frequency = Field(ge=1.0, le=1e6)
    """Natural frequency ω/2π of a servo for small angles."""
    damping: Ratio = Field(ge=0.2, le=0.99)
    """Damping ζ, as a share of the critical one."""
    slew: AngleRate = Field(gt=0.0, le=1e6)
    """Fastest deflection, optical."""
    acceleration: AngleAcceleration = Field(gt=0.0, le=1e10)
    """Largest acceleration, optical: torque over inertia."""
    jump_share: Ratio = Field(gt=0.0, le=0.95)
    """Share of both limits that the command of a jump asks for; the rest is the servo's to settle."""
    settled: Angle = Field(gt=0.0, le=0.1)
    """Distance from the goal below which a jump has settled."""
    readout_delay: Time = Field(ge=0.0, le=1e-3)
    """By how much earlier than its voxel an encoder's reading is latched."""

    @property
    def omega(self) -> float:
        """Natural frequency ω [rad/s]."""
        return 2.0 * math.pi * self.natural_frequency

    @property
    def lag(self) -> float:
        """Lag behind a slow command [s], 2ζ/ω."""
        return 2.0 * self.damping / self.omega


class MirrorState(NamedTuple):
    """State of mirrors at an instant, each of one shape (...,): ``angle`` [rad], ``rate`` [rad/s], last ``command``."""

    angle: Array
    rate: Array
    command: Array


class MirrorMotion(NamedTuple):
    """Motion of mirrors, each (..., updates): ``commanded`` and ``true`` angle [rad], ``rate`` [rad/s], ``limited``.

    ``limited`` is where the servo's demand exceeded the acceleration or the speed that there is.
    """

    commanded: Array
    true: Array
    rate: Array
    limited: NDArray[np.bool_]


def at_rest(angle: ArrayLike) -> MirrorState:
    """Return mirrors at rest at their commanded angles [rad], any shape."""
    still = np.asarray(angle, dtype=np.float64)
    return MirrorState(still, np.zeros_like(still), still)


def response(galvanometers: Galvanometers, frequency: ArrayLike) -> NDArray[np.complex128]:
    """Return H = ω²/(s² + 2ζωs + ω²) at s = 2πi f for frequencies f [Hz], any shape."""
    ratio = np.asarray(frequency, dtype=np.float64) / galvanometers.natural_frequency
    return np.asarray(1.0 / (1.0 - ratio**2 + 2j * galvanometers.damping * ratio))


def follow(
    galvanometers: Galvanometers, state: MirrorState, command: ArrayLike, step: float
) -> tuple[MirrorMotion, MirrorState]:
    """Return how mirrors follow commands, and their state afterwards.

    Parameters
    ----------
    galvanometers
        The servos.
    state
        Their state one update before the first command, each of shape (...,).
    command
        Commanded angles [rad], shape (..., updates); between updates the command runs straight.
    step
        Time between updates [s].

    Returns
    -------
    MirrorMotion, MirrorState
        x″ = ω²(u − x) − 2ζω x′, solved exactly for commands of straight pieces. Where |x″| or |x′| would pass its limit
        it stays at the limit; that holds for whole updates, so that a limited motion is exact to one update.
    """
    wanted = np.asarray(command, dtype=np.float64)
    before = np.concatenate([np.asarray(state.command)[..., None], wanted[..., :-1]], axis=-1)
    angle, rate = _linear(galvanometers, state, before, wanted, step)
    limited = _beyond(galvanometers, state, rate, step)
    # Only mirrors that meet a limit are solved again, piece by piece.
    kept = limited.any(axis=-1)
    for mirror in np.argwhere(kept) if kept.any() else ():
        one = tuple(mirror)
        own = MirrorState(*(np.asarray(part)[one] for part in state))
        angle[one], rate[one], limited[one] = _limit(galvanometers, own, before[one], wanted[one], step)
    return MirrorMotion(wanted, angle, rate, limited), MirrorState(
        angle[..., -1], rate[..., -1], wanted[..., -1]
    )


def latch(motion: MirrorMotion, before: MirrorState, step: float, delay: float) -> Array:
    """Return the true angles a delay [s] before each update, shape (..., updates) [rad].

    ``before`` is the state one update before the first. Between updates the angle is the cubic through angles and
    rates at both ends, whose error of (step ω)⁴/384 of a motion is below a microradian for a pattern.

    Raises
    ------
    ValueError
        If the delay is longer than the whole motion: what happened before it is not known.
    """
    whole, part = divmod(delay / step, 1.0)
    back = int(whole)
    if back >= motion.true.shape[-1]:
        raise ValueError("the delay of the encoders is longer than the motion")
    angle = np.concatenate([np.asarray(before.angle)[..., None], motion.true], axis=-1)
    rate = np.concatenate([np.asarray(before.rate)[..., None], motion.rate], axis=-1) * step
    s = 1.0 - part
    start, end = angle[..., :-1], angle[..., 1:]
    cubic = (
        start * (1.0 + 2.0 * s) * (1.0 - s) ** 2
        + rate[..., :-1] * s * (1.0 - s) ** 2
        + end * s**2 * (3.0 - 2.0 * s)
        - rate[..., 1:] * s**2 * (1.0 - s)
    )
    if back == 0:
        return np.asarray(cubic)
    # Before the motion began the mirrors are taken to have been where they were at its start.
    held = np.repeat(angle[..., :1], back, axis=-1)
    return np.concatenate([held, cubic[..., :-back]], axis=-1)


def _linear(
    galvanometers: Galvanometers, state: MirrorState, before: Array, wanted: Array, step: float
) -> tuple[Array, Array]:
    """Solve the servo without limits: one complex first-order recursion per mirror.

    The deviation d = x − u + (2ζ/ω) u′ from the steady following of a ramp obeys the homogeneous equation while the
    command runs straight. With the pole s = −ζω + iω√(1 − ζ²) and z = d′ − s* d it turns by exp(s step) per update, and
    jumps by (s* − s_0) where the command's slope changes, s_0 = 2ζ/ω being the lag.
    """
    from scipy.signal import lfilter

    zeta, omega = galvanometers.damping, galvanometers.omega
    pole = complex(-zeta * omega, omega * math.sqrt(1.0 - zeta**2))
    slope = (wanted - before) / step
    start = np.asarray(state.angle) - before[..., 0] + galvanometers.lag * slope[..., 0]
    z0 = np.asarray(state.rate) - slope[..., 0] - pole.conjugate() * start
    kick = -(slope[..., 1:] - slope[..., :-1]) * (1.0 + pole.conjugate() * galvanometers.lag)
    turn = cmath.exp(pole * step)
    # z after each update, before the command's slope changes: z_k = turn (z_{k−1} + kick_{k−1}). The filter also
    # multiplies: NumPy's complex product depends on the processor.
    given = np.concatenate([z0[..., None], kick], axis=-1)
    z = lfilter([turn], [1.0, -turn], given, axis=-1)
    deviation = z.imag / pole.imag
    rate = z.real + pole.real * deviation
    return wanted - galvanometers.lag * slope + deviation, rate + slope


def _beyond(galvanometers: Galvanometers, state: MirrorState, rate: Array, step: float) -> NDArray[np.bool_]:
    """Return which updates ask for more than the limits: mean acceleration of an update, speed at its end."""
    before = np.concatenate([np.asarray(state.rate)[..., None], rate[..., :-1]], axis=-1)
    asked = (rate - before) / step
    return np.asarray((np.abs(asked) > galvanometers.acceleration) | (np.abs(rate) > galvanometers.slew))


def _limit(
    galvanometers: Galvanometers, state: MirrorState, before: Array, wanted: Array, step: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Solve one mirror with its limits: limited updates one by one, and the free pieces between them at once."""
    angle, rate = np.empty_like(wanted), np.empty_like(wanted)
    limited = np.zeros(wanted.shape, dtype=np.bool_)
    most, fastest = galvanometers.acceleration, galvanometers.slew
    zeta, omega, lag = galvanometers.damping, galvanometers.omega, galvanometers.lag
    pole = complex(-zeta * omega, omega * math.sqrt(1.0 - zeta**2))
    turn = cmath.exp(pole * step)
    first, x, v = 0, float(state.angle), float(state.rate)
    while first < len(wanted):
        # One update of the free servo, as in _linear.
        start, end = float(before[first]), float(wanted[first])
        slope = (end - start) / step
        z = turn * (v - slope - pole.conjugate() * (x - start + lag * slope))
        free = z.real + pole.real * z.imag / pole.imag + slope
        if abs(free - v) > most * step or abs(free) > fastest:
            push = min(max((free - v) / step, -most), most)
            now = min(max(v + push * step, -fastest), fastest)
            x, v = x + 0.5 * (v + now) * step, now
            angle[first], rate[first], limited[first] = x, v, True
            first += 1
            continue
        own = MirrorState(np.asarray(x), np.asarray(v), before[first])
        free_angle, free_rate = _linear(galvanometers, own, before[first:], wanted[first:], step)
        beyond = _beyond(galvanometers, own, free_rate, step)
        # The first update is free, whatever rounding says of it here.
        count = 1 + (int(np.argmax(beyond[1:])) if beyond[1:].any() else len(beyond) - 1)
        angle[first : first + count], rate[first : first + count] = free_angle[:count], free_rate[:count]
        first += count
        x, v = float(angle[first - 1]), float(rate[first - 1])
    return angle, rate, limited
