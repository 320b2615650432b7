"""Where Sun and Earth stand as seen from an orbit.

Directions are given along the local axes of the orbit (LVLH), right-handed: x ram (forward, horizontal),
y starboard (against the orbit's normal), z nadir (down). The Sun is infinitely far away.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Annotated, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from scanner_sim.foundation.errors import Fault, printable
from scanner_sim.foundation.parts import Part
from scanner_sim.foundation.units import Angle
from scanner_sim.scene.light.earth import DEFAULT_ALTITUDE, EARTH_RADIUS, Distance
from scanner_sim.scene.light.elements import elements_fault, sun_from_elements
from scanner_sim.scene.poses import Turns

GRAVITY: Final = 3.986_004_418e14
"""Gravitational constant of the Earth GM [m³/s²] (IERS Conventions 2010, Technical Note 36, table 1.1)."""
OBLIQUITY: Final = math.radians(23.44)
"""Angle between equator and ecliptic [rad] (IAU 2006: 23.4393° at J2000)."""

AXES: Final[dict[str, tuple[float, float, float]]] = {
    "ram": (1.0, 0.0, 0.0),
    "wake": (-1.0, 0.0, 0.0),
    "starboard": (0.0, 1.0, 0.0),
    "port": (0.0, -1.0, 0.0),
    "nadir": (0.0, 0.0, 1.0),
    "zenith": (0.0, 0.0, -1.0),
}
"""Unit vectors along the local axes, by name."""


Axis = Literal["ram", "wake", "zenith", "nadir", "port", "starboard"]

_NEARER = "Choose a time near to that of the elements, or newer elements."


def period(altitude: float) -> float:
    """Return the period of a circular orbit [s]: 2π √(a³/GM) with a = R + h, h the altitude [m]."""
    return 2.0 * math.pi * math.sqrt((EARTH_RADIUS + altitude) ** 3 / GRAVITY)


def largest_beta(inclination: float) -> float:
    """Return the largest |β| [rad] that an orbit of this inclination [rad] ever has.

    The Sun climbs up to 23.44° above the equator, and the orbit's normal stands ``inclination`` from the pole,
    or π less that for a retrograde orbit.
    """
    return min(min(inclination, math.pi - inclination) + OBLIQUITY, math.pi / 2.0)


def sun_from_anomaly(beta: float, anomaly: float) -> NDArray[np.float64]:
    """Return the direction to the Sun along the local axes, shape (3,).

    Parameters
    ----------
    beta
        Angle from the orbital plane to the Sun [rad], positive towards the orbit's normal (port).
    anomaly
        Angle along the orbit from orbital noon, where the Sun stands highest [rad].

    Returns
    -------
    ndarray
        (−cosβ sinθ, −sinβ, −cosβ cosθ).
    """
    return np.array(
        [
            -math.cos(beta) * math.sin(anomaly),
            -math.sin(beta),
            -math.cos(beta) * math.cos(anomaly),
        ]
    )


class Attitude(Part):
    """How the scanner is turned against the orbit: ram is forwards, port is left of it, nadir is down."""

    forward: Axis = "ram"
    """Where it looks (its z axis)."""
    down: Axis = "nadir"
    """What is down in its pictures (its y axis)."""
    rotation: Turns = ()
    """Turns of the scanner about its own axes after that, the first one first."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield two directions on one line."""
        if abs(np.dot(AXES[self.forward], AXES[self.down])) > 0.5:
            yield Fault(
                "down",
                f"'{self.down}' lies along the line of sight, '{self.forward}', so it is not down in the picture.",
                "Choose a direction square to forward.",
            )

    def scanner_from_lvlh(self) -> NDArray[np.float64]:
        """Return the rotation matrix (3, 3) from the orbit's axes (ram, starboard, nadir) to the scanner's."""
        y, z = np.array(AXES[self.down]), np.array(AXES[self.forward])
        turned = np.eye(3)
        for turn in (self.rotation,) if not isinstance(self.rotation, tuple) else self.rotation:
            turned = turn.matrix() @ turned
        return np.asarray(turned.T @ np.stack([np.cross(y, z), y, z]))


class Orbit(Part):
    """A circular orbit and a position on it."""

    altitude: Distance = Field(default=DEFAULT_ALTITUDE, gt=100e3, le=1e9)
    """Height above ground."""
    inclination: Angle = Field(default=math.radians(51.6), ge=0.0, le=math.pi)
    """Angle between the orbit and the equator; it bounds beta."""
    beta: Angle = Field(default=0.0, ge=-math.pi / 2.0, le=math.pi / 2.0)
    """Angle from the orbit's plane to the Sun, positive to port."""
    anomaly: Angle = Field(default=0.0, ge=-2.0 * math.pi, le=2.0 * math.pi)
    """Position on the orbit, counted forwards from orbital noon."""
    attitude: Attitude = Attitude()
    """Where the scanner looks."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a Sun higher above the orbit's plane than it ever stands."""
        limit = largest_beta(self.inclination)
        if abs(self.beta) > limit + 1e-9:
            yield Fault(
                "beta",
                f"{math.degrees(self.beta):.6g} deg is impossible: with an inclination of "
                f"{math.degrees(self.inclination):.6g} deg the Sun stands at most {math.degrees(limit):.6g} deg "
                "from the orbit's plane (inclination + 23.44 deg).",
                "Reduce beta or change the inclination.",
            )


class TwoLineElements(Part):
    """A real orbit, and a time."""

    line1: str = Field(examples=["1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927"])
    """First line of the elements."""
    line2: str = Field(examples=["2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537"])
    """Second line."""
    time: Annotated[datetime, BeforeValidator(_utc)] = Field(examples=["2008-09-20T12:25:40Z"])
    """Time in UTC."""
    attitude: Attitude = Attitude()
    """Where the scanner looks."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield lines that are damaged, and a time at which the orbit does not exist."""
        found = elements_fault(self.line1, self.line2)
        if found is not None:
            yield Fault(*found, "Copy both lines again, with all their spaces.")
            return
        try:
            _, altitude = sun_from_elements(self.line1, self.line2, self.time)
        except ValueError as error:
            yield Fault("time", f"the orbit cannot be followed to then: {error}.", _NEARER)
            return
        if altitude <= 100e3:
            yield Fault("time", f"the orbit has come down to {1e-3 * altitude:.4g} km by then.", _NEARER)


def _utc(value: object) -> datetime:
    """Return a time of the scenario as an aware datetime."""
    try:
        found = value if isinstance(value, datetime) else datetime.fromisoformat(str(value))
        found = found.replace(tzinfo=UTC) if found.tzinfo is None else found.astimezone(UTC)
    except (ValueError, OverflowError):
        found = datetime.min.replace(tzinfo=UTC)
    if not 1957 <= found.year <= 2099:
        raise PydanticCustomError(
            "quantity",
            "{reason}; write for example {example}",
            {
                "reason": printable(f"'{value}' is no time in UTC from 1957 to 2099"),
                "example": "2026-06-21T12:00:00Z",
            },
        )
    return found
