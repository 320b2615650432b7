"""What lights the scene besides the laser: the Sun and the Earth, placed by hand or by an orbit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import timedelta
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Field, Tag, model_validator

from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Number, Part
from scanner_sim.foundation.units import Ratio, Temperature, Time
from scanner_sim.scene.light.earth import (
    DEFAULT_ALTITUDE,
    EARTH_RADIUS,
    Distance,
    angle_between,
    earth_angular_radius,
    visible_share,
)
from scanner_sim.scene.light.elements import elements_age, elements_period, sun_from_elements
from scanner_sim.scene.light.orbit import AXES, Orbit, TwoLineElements, period, sun_from_anomaly

OLDEST_ELEMENTS = 14.0
"""Days after which elements of a low orbit are doubtful: the error along the orbit reaches tens of kilometres."""
_EXCESS = "it follows from the orbit already."


Direction = tuple[Number, Number, Number]
"""A vector of any length but zero."""


class Sun(Part):
    """The Sun: a uniform disc."""

    direction: Direction | None = Field(default=None, examples=[[0.3, -0.8, -0.5]])
    """From the scene towards the Sun, in the scanner's frame; with an orbit it follows from that."""
    spectrum: Literal["planck", "astm_g173"] = "planck"
    """Black body (eq 17), or the spectrum measured outside of the atmosphere (ASTM G-173, at its mean distance)."""
    temperature: Temperature = Field(default=5770.0, ge=1000.0, le=50_000.0)
    """Temperature of the black body."""
    radius: Distance = Field(default=695_000e3, ge=1e3, le=1e12)
    """Radius of the disc (the paper's 69 500 km lost a zero)."""
    distance: Distance = Field(default=149.68e9, ge=1e6, le=1e15)
    """Distance."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a direction without length and a Sun that would swallow the scene."""
        yield from _directionless(self.direction)
        if self.radius >= 0.1 * self.distance:
            yield Fault(
                "distance",
                f"a Sun with a radius of {self.radius:g} m at {self.distance:g} m is no small disc.",
                "Move it to more than ten times its radius.",
            )

    @property
    def angular_radius(self) -> float:
        """Angular radius of the disc [rad]: asin(radius/distance)."""
        return math.asin(self.radius / self.distance)


class Earth(Part):
    """The Earth: a Lambertian sphere, lit by the Sun."""

    direction: Direction | None = Field(default=None, examples=[[0.0, 1.0, 0.0]])
    """From the scene towards the Earth's centre, in the scanner's frame; with an orbit it follows from that."""
    altitude: Distance | None = Field(default=None, gt=100e3, le=1e10)
    """Height of the scene above the ground; by default 400 km, with an orbit the orbit's."""
    albedo: Ratio = Field(default=0.2, ge=0.0, le=1.0)
    """Reflectance in the filter's band (at 1.5 um: ocean 0.02, ice cloud 0.3, water cloud 0.6)."""
    albedo_out_of_band: Ratio = Field(default=0.29, ge=0.0, le=1.0)
    """Reflectance in the rest of the detector's response; the mean over the Earth and the spectrum is 0.29."""
    albedo_visible: Ratio = Field(default=0.3, ge=0.0, le=1.0)
    """Reflectance in visible light, for the video camera (0.29 over the whole spectrum; ocean 0.06, clouds to 0.8)."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a direction without length."""
        yield from _directionless(self.direction)


class LightChange(Part):
    """Sun and Earth from a time on, as somebody else's clock of the orbit has them."""

    time: Time = Field(ge=0.0, le=1e9)
    """From when on, since the start."""
    sun: Direction | None = Field(default=None, examples=[[0.3, -0.8, -0.5]])
    """From the scene towards the Sun, in the scanner's frame; left out, where it is without the change."""
    earth: Direction | None = Field(default=None, examples=[[0.0, 1.0, 0.0]])
    """From the scene towards the Earth's centre; left out, where it is without the change."""
    visible: Ratio | None = Field(default=None, ge=0.0, le=1.0, examples=[0.4])
    """Share of the Sun's light that arrives, 0 in an eclipse; where the Earth hides more of it, that counts."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield directions without length."""
        for name in ("sun", "earth"):
            for fault in _directionless(getattr(self, name)):
                yield Fault(name, fault.problem, fault.remedy)


@dataclass(frozen=True, eq=False)
class Sky:
    """Sun and Earth as the scene sees them, in the scanner's frame.

    Attributes
    ----------
    sun_direction
        Unit vector towards the Sun's centre, shape (3,); None without a Sun. It stays in an eclipse.
    sun_angular_radius
        Angular radius of its disc [rad].
    sun_visible
        Share of the Sun's light that arrives, 0 to 1: below 1 in the penumbra, 0 in an eclipse.
    sun_dimming
        That share over what the Earth's disc leaves of the Sun's: 1 but where a change of the light says less.
    earth_direction
        Unit vector towards the Earth's centre, shape (3,); None without an Earth.
    earth_angular_radius
        Angular radius of its disc [rad].
    earth_altitude, earth_radius
        Height of the scene above the ground, and radius of the sphere [m].
    albedo, albedo_out_of_band, albedo_visible
        Reflectance of the Earth in the filter's band, outside of it, and in visible light.
    phase
        Angle between the Sun and the zenith [rad]: 0 over the Earth's noon, π over its midnight; NaN where Sun
        or Earth is missing.
    """

    sun_direction: NDArray[np.float64] | None = None
    sun_angular_radius: float = 0.0
    sun_visible: float = 0.0
    earth_direction: NDArray[np.float64] | None = None
    earth_angular_radius: float = 0.0
    earth_altitude: float = DEFAULT_ALTITUDE
    earth_radius: float = EARTH_RADIUS
    albedo: float = 0.0
    albedo_out_of_band: float = 0.0
    albedo_visible: float = 0.0
    phase: float = float("nan")
    sun_dimming: float = 1.0

    @property
    def dark(self) -> bool:
        """Whether there is no Sun: then nothing but the laser lights the scene."""
        return self.sun_direction is None


def _by_form(kind: str) -> Discriminator:
    return Discriminator(lambda value: "(word)" if isinstance(value, str) else kind)


SunChoice = Annotated[
    Annotated[Literal["none"], Tag("(word)")] | Annotated[Sun, Tag("(sun)")],
    _by_form("(sun)"),
    Field(examples=[{"direction": [0.3, -0.8, -0.5]}]),
]
EarthChoice = Annotated[
    Annotated[Literal["none"], Tag("(word)")] | Annotated[Earth, Tag("(earth)")],
    _by_form("(earth)"),
    Field(examples=[{"direction": [0.0, 1.0, 0.0]}]),
]


class Lighting(Part):
    """Sun and Earth; by default it is dark.

    Their directions are written down, or they follow from an orbit: then both are there unless they are
    ``none``, and the Sun may be eclipsed.
    """

    sun: SunChoice = "none"
    """The Sun, or ``none``."""
    earth: EarthChoice = "none"
    """The Earth, or ``none``."""
    orbit: Orbit | None = None
    """A circular orbit that places both."""
    tle: TwoLineElements | None = None
    """A real orbit that places both."""
    changes: tuple[LightChange, ...] = ()
    """What a controller told of Sun and Earth during a track, in the order of time; each holds until the next."""

    @model_validator(mode="before")
    @classmethod
    def _in_orbit_both_are_there(cls, data: Any) -> Any:
        if not isinstance(data, dict) or (data.get("orbit") is None and data.get("tle") is None):
            return data
        return {"sun": {}, "earth": {}, **data}

    def cross_checks(self) -> Iterator[Fault]:
        """Yield directions given twice or not at all, and a Sun behind the Earth."""
        if self.orbit is not None and self.tle is not None:
            yield Fault("tle", "there is an orbit already.", "Keep one of orbit and tle.")
        placed = self.orbit is not None or self.tle is not None
        for name, body in (("sun", self.sun), ("earth", self.earth)):
            if body == "none":
                continue
            if placed and body.direction is not None:
                yield Fault(f"{name}.direction", _EXCESS, "Keep one of them.")
            elif not placed and body.direction is None:
                yield Fault(
                    name,
                    "it has no direction.",
                    "Write 'direction: [x, y, z]' from the scene towards it, in the scanner's frame, or an orbit.",
                )
        if placed and self.earth != "none" and self.earth.altitude is not None:
            yield Fault("earth.altitude", _EXCESS, "Remove it.")
        if not placed:
            yield from self._hidden_sun()
        if self.changes and self.sun == "none":
            yield Fault(
                "changes", "without a Sun there is no light to change.", "Give lighting.sun or an orbit."
            )
        for index, (first, second) in enumerate(zip(self.changes[:-1], self.changes[1:], strict=True)):
            if not second.time > first.time:
                yield Fault(
                    f"changes[{index + 1}].time",
                    f"{second.time:g} s is not after the {first.time:g} s before.",
                    "Write the changes in the order of their times.",
                )

    def change_at(self, after: float) -> LightChange | None:
        """Return the change that holds at a time [s], None before the first."""
        return next((change for change in reversed(self.changes) if after >= change.time), None)

    def _hidden_sun(self) -> Iterator[Fault]:
        """Yield a Sun that was put behind the Earth by hand: nobody means that."""
        if self.sun == "none" or self.earth == "none" or None in (self.sun.direction, self.earth.direction):
            return
        sky = self.sky()
        if sky.sun_visible == 0.0:
            separation = math.degrees(math.pi - sky.phase)
            yield Fault(
                "sun.direction",
                f"the Sun stands behind the Earth: {separation:.4g} deg from the Earth's centre, whose disc has a "
                f"radius of {math.degrees(sky.earth_angular_radius):.4g} deg.",
                "Turn sun.direction or earth.direction, or write 'sun: none' for a dark scene; an eclipse is "
                "described by an orbit.",
            )

    def sky(self, after: float = 0.0, change: LightChange | None = None) -> Sky:
        """Return Sun and Earth in the scanner's frame, ``after`` seconds after the stated moment.

        Directions that were written down stay where they are. A ``change`` counts in place of the one that holds then.

        Raises
        ------
        ValueError
            If an orbit from elements cannot be followed to that time.
        """
        sun_direction, earth_direction, altitude = self._directions(after)
        told = self.change_at(after) if change is None else change
        if told is not None:
            sun_direction = sun_direction if told.sun is None else _unit(told.sun)
            earth_direction = earth_direction if told.earth is None else _unit(told.earth)
        sun = Sun() if self.sun == "none" else self.sun
        share, phase, disc = 1.0, float("nan"), 0.0
        if earth_direction is not None:
            disc = earth_angular_radius(altitude)
        if sun_direction is not None and earth_direction is not None:
            separation = angle_between(sun_direction, earth_direction)
            share, phase = visible_share(separation, sun.angular_radius, disc), math.pi - separation
        arriving = share if told is None or told.visible is None else min(share, told.visible)
        lit = (
            self.earth
            if self.earth != "none"
            else Earth(albedo=0.0, albedo_out_of_band=0.0, albedo_visible=0.0)
        )
        return Sky(
            sun_direction=sun_direction,
            sun_angular_radius=0.0 if sun_direction is None else sun.angular_radius,
            sun_visible=0.0 if sun_direction is None else arriving,
            sun_dimming=arriving / share if share > 0.0 else 1.0,
            earth_direction=earth_direction,
            earth_angular_radius=disc,
            earth_altitude=altitude,
            albedo=lit.albedo,
            albedo_out_of_band=lit.albedo_out_of_band,
            albedo_visible=lit.albedo_visible,
            phase=phase,
        )

    def _directions(
        self, after: float
    ) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None, float]:
        """Return the directions of Sun and Earth in the scanner's frame, and the altitude [m]."""
        sun: NDArray[np.float64] | None = None
        earth: NDArray[np.float64] | None = None
        if self.orbit is not None:
            altitude, attitude = self.orbit.altitude, self.orbit.attitude
            anomaly = self.orbit.anomaly + 2.0 * math.pi * after / period(altitude)
            local = sun_from_anomaly(self.orbit.beta, anomaly)
        elif self.tle is not None:
            attitude = self.tle.attitude
            local, altitude = sun_from_elements(self.tle.line1, self.tle.line2, self.tle.time, after)
        else:
            sun = None if self.sun == "none" else _unit(self.sun.direction)
            earth = None if self.earth == "none" else _unit(self.earth.direction)
            given = None if self.earth == "none" else self.earth.altitude
            return sun, earth, DEFAULT_ALTITUDE if given is None else given
        turn = attitude.scanner_from_lvlh()
        sun = None if self.sun == "none" else turn @ local
        earth = None if self.earth == "none" else turn @ np.array(AXES["nadir"])
        return sun, earth, altitude

    def at(self, after: float) -> Lighting:
        """Return the lighting whose stated moment is ``after`` seconds later, with the change that holds then alone."""
        told = self.change_at(after)
        changes = () if told is None else (told.model_copy(update={"time": 0.0}),)
        update: dict[str, Any] = {"changes": changes}
        if self.orbit is not None:
            turn = 2.0 * math.pi * after / period(self.orbit.altitude)
            update["orbit"] = self.orbit.model_copy(
                update={"anomaly": math.remainder(self.orbit.anomaly + turn, 2.0 * math.pi)}
            )
        if self.tle is not None:
            update["tle"] = self.tle.model_copy(update={"time": self.tle.time + timedelta(seconds=after)})
        return self.model_copy(update=update)

    @property
    def runs(self) -> bool:
        """Whether Sun and Earth move by an orbit's clock."""
        return self.sun != "none" and (self.orbit is not None or self.tle is not None)

    @property
    def period(self) -> float | None:
        """Duration of one orbit [s]; None where there is no orbit."""
        if self.orbit is not None:
            return period(self.orbit.altitude)
        return None if self.tle is None else elements_period(self.tle.line1, self.tle.line2)


def orbit_times(lighting: Lighting, count: int) -> NDArray[np.float64]:
    """Return ``count`` evenly spaced times of one orbit [s], shape (count,), from the stated moment on.

    Raises
    ------
    ValueError
        If the lighting has no orbit.
    """
    if lighting.period is None:
        raise ValueError("this lighting has no orbit")
    return np.asarray(np.arange(count) * (lighting.period / count))


def skies(lighting: Lighting, times: NDArray[np.float64]) -> Iterator[Sky]:
    """Yield the sky at each of some times [s] after the stated moment."""
    for after in times:
        yield lighting.sky(float(after))


def lighting_warnings(lighting: Lighting) -> tuple[str, ...]:
    """Return a sentence for everything that is possible but probably not meant."""
    found = []
    if lighting.sun == "none" and lighting.earth != "none":
        found.append("lighting.sun: without a Sun the Earth is dark too")
    if lighting.tle is not None:
        age = elements_age(lighting.tle.line1, lighting.tle.line2, lighting.tle.time) / 86400.0
        if abs(age) > OLDEST_ELEMENTS:
            found.append(
                f"lighting.tle.time: {abs(age):.0f} days from the elements' own, where SGP4 is far off"
            )
    return tuple(found)


def _directionless(direction: tuple[float, float, float] | None) -> Iterator[Fault]:
    """Yield a vector that points nowhere."""
    if direction is not None and not 1e-100 < math.hypot(*direction) < 1e100:
        yield Fault(
            "direction", f"{list(direction)} has no direction.", "Write a vector such as [0.3, -0.8, -0.5]."
        )


def _unit(direction: tuple[float, float, float] | None) -> NDArray[np.float64] | None:
    return None if direction is None else np.asarray(np.asarray(direction) / np.linalg.norm(direction))
