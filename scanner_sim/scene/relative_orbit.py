"""Relative motion of two spacecraft on neighbouring orbits (Clohessy and Wiltshire 1960), coasting between impulses.

Lengths are along the local axes of the target's orbit: x ram, y starboard, z nadir
(:mod:`scanner_sim.scene.light.orbit`). Of the chaser relative to the target

    ẍ = 2 n ż,   ÿ = −n² y,   z̈ = 3 n² z − 2 n ẋ,

with n the rate of the target's circular orbit: W. H. Clohessy and R. S. Wiltshire, "Terminal guidance system for
satellite rendezvous", J. Aerospace Sci. 27 (1960) 653, in the axes of W. Fehse, "Automated Rendezvous and Docking of
Spacecraft", Cambridge 2003, eq 3.14. Left out: the square of distance over orbital radius, drag, the Earth's
flattening, the duration of a burn and its errors.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Count, Part
from scanner_sim.foundation.units import Dimension, Time
from scanner_sim.scene.light.earth import DEFAULT_ALTITUDE, Distance
from scanner_sim.scene.light.orbit import Attitude, period
from scanner_sim.scene.poses import Position

Array = NDArray[np.float64]

MOST_IMPULSES = 1000
"""Burns, and pulses of a glideslope."""
_FASTEST = 100.0
"""Largest relative speed along an axis [m/s]: the linear equations are of neighbouring orbits."""
_LATEST = 1e9

_Speed = Annotated[float, Dimension("m/s", ("10 mm/s",), ("m/s", "mm/s")), Field(ge=-_FASTEST, le=_FASTEST)]


class Burn(Part):
    """An impulse of the chaser."""

    time: Time = Field(ge=0.0, le=_LATEST)
    """When, since the start."""
    delta_v: tuple[_Speed, _Speed, _Speed] = Field(examples=[["-50 mm/s", "0 m/s", "0 m/s"]])
    """Change of velocity along ram, starboard and nadir."""


class Glideslope(Part):
    """A straight approach by pulses at even times, whose speed falls in proportion to the way that is left.

    H. B. Hablani, M. L. Tapper and D. J. Dana-Bashian, "Guidance and relative navigation for autonomous rendezvous in a
    circular orbit", J. Guid. Control Dyn. 25 (2002) 553: ρ̇ = a ρ + ρ̇_T along the line, and between pulses the
    chaser coasts. It leaves the line a little between them, the less the more pulses.
    """

    to: Position = Field(examples=[["-2 m", "0 m", "0 m"]])
    """Where it ends, as ``position``; there the chaser stays."""
    start_speed: _Speed = Field(gt=0.0)
    """Speed along the line at the start."""
    end_speed: _Speed = Field(gt=0.0)
    """Speed on arrival."""
    pulses: Count = Field(default=20, ge=2, le=MOST_IMPULSES)
    """Number of pulses before the one that stops it."""

    def duration(self, distance: float) -> float:
        """Return how long it takes [s] from a distance [m]: T = ln(ρ̇_T/ρ̇_0)/a with a = (ρ̇_0 − ρ̇_T)/ρ_0."""
        ratio = self.end_speed / self.start_speed
        if abs(ratio - 1.0) < 1e-9:
            return distance / self.start_speed
        return math.log(ratio) * distance / (self.end_speed - self.start_speed)

    def left(self, distance: float, time: Array) -> Array:
        """Return the way that is left [m] at times [s], of a distance at the start."""
        rate = (self.end_speed - self.start_speed) / distance
        # (e^{at} − 1)/a, and t where the speed is even.
        grown = np.expm1(rate * time) / rate if abs(rate) > 1e-15 else time
        return np.asarray(distance - self.start_speed * grown)


class _Legs(NamedTuple):
    """Coasting legs: when each begins [s] (n,), and the state [m, m/s] after the impulse there (n, 6)."""

    time: Array
    state: Array


class RelativeOrbit(Part):
    """An object on a circular orbit, approached by a chaser with the scanner.

    Both keep their attitude against the orbit. The object's own ``rotation`` says how it is turned before the scanner;
    its origin is the target's centre of mass.
    """

    type: Literal["clohessy_wiltshire"]
    """Kind of motion."""
    altitude: Distance = Field(default=DEFAULT_ALTITUDE, gt=100e3, le=1e9)
    """Height of the target's orbit above ground."""
    attitude: Attitude = Attitude()
    """Where the scanner looks, against the orbit."""
    mounting: Position = (0.0, 0.0, 0.0)
    """The scanner's place from the chaser's centre of mass, along ram, starboard and nadir."""
    position: Position = Field(examples=[["-30 m", "0 m", "0 m"]])
    """The chaser's centre of mass from the target's at the start, along ram, starboard and nadir."""
    velocity: tuple[_Speed, _Speed, _Speed] = (0.0, 0.0, 0.0)
    """Its velocity against those axes at the start."""
    burns: tuple[Burn, ...] = Field(default=(), max_length=MOST_IMPULSES)
    """Impulses, in the order of their times."""
    glideslope: Glideslope | None = None
    """A straight approach, in the place of ``velocity`` and ``burns``."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield burns that run backwards, two ways of flying at once, and pulses too far apart."""
        for index, (first, second) in enumerate(zip(self.burns[:-1], self.burns[1:], strict=True)):
            if second.time <= first.time:
                yield Fault(
                    f"burns[{index + 1}].time",
                    f"{second.time:g} s is not after the {first.time:g} s of the burn before.",
                    "Write the burns in the order of their times.",
                )
        slope = self.glideslope
        if slope is None:
            return
        for key, given in (("burns", self.burns), ("velocity", any(self.velocity))):
            if given:
                yield Fault(key, "the glideslope gives the impulses already.", "Keep one of them.")
        distance = float(np.linalg.norm(np.subtract(slope.to, self.position)))
        if distance == 0.0:
            yield Fault("glideslope.to", "it ends where it begins.", "Write another place.")
        elif self.rate * slope.duration(distance) / slope.pulses >= math.pi:
            yield Fault(
                "glideslope.pulses",
                f"there is {slope.duration(distance) / slope.pulses:.4g} s between pulses, half an orbit or more: no "
                "impulse is sure to reach the next place.",
                "Write more pulses, or a higher speed.",
            )

    @property
    def rate(self) -> float:
        """Rate of the target's orbit n [rad/s]."""
        return 2.0 * math.pi / period(self.altitude)

    @property
    def end(self) -> float | None:
        """When the chaser has arrived [s]; None where it coasts on."""
        if self.glideslope is None:
            return None
        return self.glideslope.duration(float(np.linalg.norm(np.subtract(self.glideslope.to, self.position))))

    @property
    def total_delta_v(self) -> float:
        """Sum of all impulses [m/s], that which stops the chaser among them."""
        legs = self._legs
        before = _coasted(self.rate, np.diff(legs.time), legs.state[:-1])[:, 3:]
        total = float(np.linalg.norm(legs.state[1:, 3:] - before, axis=1).sum())
        return total + float(np.linalg.norm(legs.state[0, 3:] - np.asarray(self.velocity)))

    def chaser(self, time: ArrayLike) -> Array:
        """Return the chaser's place and velocity at times [s] along those axes [m, m/s], shape (n, 6)."""
        t = np.maximum(np.atleast_1d(np.asarray(time, dtype=np.float64)), 0.0)
        legs = self._legs
        leg = np.searchsorted(legs.time, t, side="right") - 1
        found = _coasted(self.rate, t - legs.time[leg], legs.state[leg])
        if self.glideslope is not None:
            found[leg == len(legs.time) - 1] = legs.state[-1]
        return found

    def scanner_from_object(self, time: ArrayLike, start: Array) -> Array:
        """Return the poses at times [s], shape (n, 4, 4); of ``start`` (4, 4) the rotation stays."""
        turn = self.attitude.scanner_from_lvlh()
        away = self.chaser(time)[:, :3] + np.asarray(self.mounting)
        poses = np.tile(np.eye(4), (len(away), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = start[:3, :3], -away @ turn.T
        return poses

    @property
    def _legs(self) -> _Legs:
        return _legs_of(self)


def transition(rate: float, time: ArrayLike) -> Array:
    """Return the state-transition matrix of the Clohessy–Wiltshire equations.

    Parameters
    ----------
    rate
        Of the orbit, n [rad/s].
    time
        How long [s], shape (m,).

    Returns
    -------
    ndarray
        Φ with (r, v)(t) = Φ (r, v)(0), along ram, starboard and nadir [m, m/s], shape (m, 6, 6): the closed form of
        Clohessy and Wiltshire (1960); Fehse (2003), eq 3.15 to 3.19 for a free drift.
    """
    t = np.atleast_1d(np.asarray(time, dtype=np.float64))
    n, angle = rate, rate * t
    s, c = np.sin(angle), np.cos(angle)
    # 1 − cos, without loss where the angle is small.
    v = 2.0 * np.sin(0.5 * angle) ** 2
    one = np.ones_like(t)
    phi = np.zeros((len(t), 6, 6))
    entries = {
        (0, 0): one, (0, 2): 6.0 * (angle - s), (0, 3): 4.0 * s / n - 3.0 * t, (0, 5): 2.0 * v / n,
        (1, 1): c, (1, 4): s / n,
        (2, 2): 1.0 + 3.0 * v, (2, 3): -2.0 * v / n, (2, 5): s / n,
        (3, 2): 6.0 * n * v, (3, 3): 1.0 - 4.0 * v, (3, 5): 2.0 * s,
        (4, 1): -n * s, (4, 4): c,
        (5, 2): 3.0 * n * s, (5, 3): -2.0 * s, (5, 5): c,
    }  # fmt: skip
    for place, value in entries.items():
        phi[(slice(None), *place)] = value
    return phi


def _coasted(rate: float, time: Array, state: Array) -> Array:
    """Return states (n, 6) after coasting for times (n,)."""
    return np.asarray(np.einsum("nij,nj->ni", transition(rate, time), state))


@lru_cache(maxsize=64)
def _legs_of(motion: RelativeOrbit) -> _Legs:
    first = np.array([*motion.position, *motion.velocity])
    if motion.glideslope is not None:
        return _glideslope_legs(motion, motion.glideslope, first[:3])
    times, states = [0.0], [first]
    for burn in motion.burns:
        (state,) = _coasted(motion.rate, np.array([burn.time - times[-1]]), states[-1][None])
        state[3:] += burn.delta_v
        if burn.time == times[-1]:
            times, states = times[:-1], states[:-1]
        times.append(burn.time)
        states.append(state)
    return _Legs(np.array(times), np.stack(states))


def _glideslope_legs(motion: RelativeOrbit, slope: Glideslope, start: Array) -> _Legs:
    """Return the legs of a glideslope: after each pulse the velocity that reaches the next place, at last none."""
    end = np.asarray(slope.to)
    distance = float(np.linalg.norm(start - end))
    step = slope.duration(distance) / slope.pulses
    times: Array = step * np.arange(slope.pulses + 1, dtype=np.float64)
    left = slope.left(distance, times)
    left[-1] = 0.0
    places = end + left[:, None] * (start - end) / distance
    (phi,) = transition(motion.rate, step)
    reach = places[1:] - places[:-1] @ phi[:3, :3].T
    velocities = np.linalg.solve(phi[:3, 3:], reach.T).T
    return _Legs(times, np.concatenate([places, np.vstack([velocities, np.zeros(3)])], axis=1))
