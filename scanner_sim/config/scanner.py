"""The instrument as a whole; what is not said of it comes from its preset."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    Discriminator,
    Field,
    SerializerFunctionWrapHandler,
    Tag,
    ValidationInfo,
    model_serializer,
    model_validator,
)

from scanner_sim.config.preset import DEFAULT, fill, preset_of
from scanner_sim.detector.line.position_sensor import PositionSensor
from scanner_sim.detector.photodiode.photodiode import Digitiser, Photodiode
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.device_types import FloatLike
from scanner_sim.foundation.errors import Fault, InputError
from scanner_sim.foundation.parts import Part
from scanner_sim.foundation.units import Frequency, Ratio, Time
from scanner_sim.optics.as_built import AsBuilt
from scanner_sim.optics.deflection import Mirrors
from scanner_sim.optics.filter import FilterChoice, laser_gain
from scanner_sim.optics.galvanometer import Galvanometers
from scanner_sim.optics.laser import Laser
from scanner_sim.optics.line_image import ArrayPlace
from scanner_sim.optics.pulse import Pulse
from scanner_sim.optics.receiver import Receiver
from scanner_sim.optics.speckle import Optics
from scanner_sim.ranging.ranges import Geometry

_SPOTS = 8
"""Places of the line at which the modes of speckle are counted."""
_LEAST_STRETCH = 0.2
"""Least distance of the array from the lens, of that where it sees infinity."""
FILLED = {"scanner": "filled"}
"""Validation context where the scanner's block already has what its preset says."""

RangefinderName: TypeAlias = Literal["triangulation", "tof"]
_INCIDENCES = 65
"""Positions along the array at which its filter is looked at."""
_LEAST_PASSED = 1e-2
"""Share of the laser's light below which a filter misses it."""


class Lidar(Part):
    """The time-of-flight unit: one pulse for each voxel, through the beam, mirrors and filter of the triangulation."""

    pulse: Pulse
    """The laser's pulse."""
    photodiode: Photodiode
    """The avalanche photodiode and its amplifier; its ``place`` says whether it looks along the laser."""
    digitiser: Digitiser
    """The converter that records the waveform, and its clock."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a record that is longer than the time between pulses: echoes would stand in it twice."""
        recorded, period = self.digitiser.samples / self.digitiser.rate, 1.0 / self.pulse.repetition_rate
        if recorded > period:
            yield Fault(
                "digitiser.gate",
                f"its record of {recorded:.4g} s is longer than the {period:.4g} s from pulse to pulse, so that echoes "
                "of two pulses would stand in it.",
                "Narrow the gate, or lower scanner.lidar.pulse.repetition_rate.",
            )

    def apparent_range(self, distance: float) -> float:
        """Return the range [m] at which the record has a surface at a distance [m], by whichever pulse."""
        middle, period = 0.5 * SPEED_OF_LIGHT * self.digitiser.middle, self.pulse.ambiguity_range
        return distance - period * round((distance - middle) / period)


PositionSensorChoice = Annotated[
    Annotated[Literal["none"], Tag("(word)")] | Annotated[PositionSensor, Tag("(sensor)")],
    Discriminator(lambda value: "(word)" if isinstance(value, str) else "(sensor)"),
    Field(examples=["none"]),
]
"""A line sensor, or ``none``: an instrument that does not triangulate."""
LidarChoice = Annotated[
    Annotated[Literal["none"], Tag("(word)")] | Annotated[Lidar, Tag("(unit)")],
    Discriminator(lambda value: "(word)" if isinstance(value, str) else "(unit)"),
    Field(examples=["none"]),
]
"""A time-of-flight unit, or ``none``."""


class Latency(Part):
    """What passes between the last light of a tracking pattern and its measurement at whoever steers by it."""

    processing: Time = Field(ge=0.0, le=1e3)
    """Time in which the instrument works out what the pattern shows."""
    transfer: Time = Field(ge=0.0, le=1e3)
    """Time in which it is sent."""

    @property
    def whole(self) -> float:
        """Both together [s]."""
        return self.processing + self.transfer


class Scanner(Part):
    """An auto-synchronised laser scanner.

    What is not written comes from its preset, a file of an instrument that has a source for each value.
    """

    preset: str = Field(default=DEFAULT, examples=[DEFAULT, "my_scanner.yaml"])
    """Instrument whose values stand where nothing else is written: the name of a shipped one, or a file."""
    laser: Laser
    """The laser and its beam."""
    mirrors: Mirrors
    """The deflection."""
    galvanometers: Galvanometers
    """The servos that turn the mirrors, which tracking needs; a raster's lag is taken to be calibrated."""
    receiver: Receiver
    """The receiving lens."""
    filter: FilterChoice
    """The interference filter, or ``none``."""
    line_choice: PositionSensorChoice = Field(alias="position_sensor")
    """The line sensor of the triangulation, or ``none``."""
    lidar_choice: LidarChoice = Field(alias="lidar")
    """The time-of-flight unit, where ``ranging`` asks for it, or ``none``."""
    rate: Frequency = Field(ge=1e-3, le=1e9)
    """Voxels per second; its inverse is the dwell."""
    laser_off: Ratio = Field(ge=0.0, le=0.9)
    """Share of the dwell in which the laser is off: the line then sees the background alone, which is subtracted. 0 is
    a laser that always shines."""
    as_built: AsBuilt | None = None
    """How the instrument that measures departs from all this, which it believes; by default it does not."""
    latency: Latency
    """How long after its light a measurement of a target is there; by default at the end of its pattern."""

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, data: Any, info: ValidationInfo) -> Any:
        context = info.context if isinstance(info.context, dict) else {}
        if not isinstance(data, Mapping) or FILLED.items() <= context.items():
            return data
        return fill(data, preset_of(data, context.get("folder", "")))

    @model_serializer(mode="wrap")
    def _as_in_files(self, written: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Return the keys of files, so that what is written can be read again."""
        keys = {name: field.alias or name for name, field in type(self).model_fields.items()}
        return {keys.get(name, name): value for name, value in written(self).items()}

    def cross_checks(self) -> Iterator[Fault]:
        """Yield an instrument that measures or sees nothing, too few pulses, and an array in the near range."""
        if not self.rangefinders:
            yield Fault(
                "position_sensor",
                "the instrument has neither a position sensor nor a time-of-flight unit, so it measures nothing.",
                "Describe one of position_sensor and lidar.",
            )
        if (blind := self.blindness(self.rangefinders)) is not None:
            yield blind
        if "triangulation" in self.rangefinders:
            yield from self._line_contradictions()
        elif self.rangefinders and (rare := self.rare_pulses()) is not None:
            yield rare

    def _line_contradictions(self) -> Iterator[Fault]:
        image, sensor = self.receiver.line_image, self.position_sensor
        if self.point_spread < 1e-8:
            yield Fault(
                "receiver.aberration",
                "neither the lens nor the sensor blurs the image: a point of light would fall between two pixels.",
                "Write 10 nm or more for receiver.aberration or position_sensor.diffusion.",
            )
        if image.depth <= 0.0:
            return  # The receiver has told it.
        if 1.0 + image.skew * (sensor.offset + sensor.length) < _LEAST_STRETCH:
            yield Fault(
                "receiver.array_tilt",
                "the far end of the array leans towards the lens so much that no light reaches it.",
                "Tilt it the other way, or reduce the tilt, position_sensor.pixels, pitch or offset.",
            )
        elif self.nearest_range <= self.receiver.baseline:
            end = self.position_sensor.offset + self.position_sensor.length
            yield Fault(
                "position_sensor.pixels",
                f"the array ends at p = {1e3 * end:.4g} mm and sees ranges from {self.nearest_range:.4g} m, "
                "nearer than the base of "
                f"{self.receiver.baseline:g} m: such rays do not pass the lens.",
                "Reduce pixels, pitch or offset, or raise receiver.focal_length.",
            )

    def rare_pulses(self) -> Fault | None:
        """Return the fault of fewer pulses than voxels; None where each voxel has one."""
        repetition_rate = self.lidar.pulse.repetition_rate
        if repetition_rate >= self.rate:
            return None
        return Fault(
            "lidar.pulse.repetition_rate",
            f"{repetition_rate:.4g} pulses a second leave some of {self.rate:.4g} voxels without one.",
            "Raise it, or lower scanner.rate.",
        )

    def blindness(self, rangefinders: tuple[RangefinderName, ...]) -> Fault | None:
        """Return why none of some rangefinders sees the laser's nominal line at any range; None where one does."""
        found = [self._blindness(name) for name in rangefinders]
        return found[0] if found and None not in found else None

    def _blindness(self, name: RangefinderName) -> Fault | None:
        """Return why a rangefinder does not see the laser's nominal line at any range; None where it does.

        A laser that drifts out of the band is possible, and warned of.
        """
        by_line = name == "triangulation"
        key = "position_sensor" if by_line else "lidar.photodiode"
        response = self.position_sensor.response if by_line else self.lidar.photodiode.response
        nominal, line = self.laser.changed(drift=0.0), f"{1e9 * self.laser.wavelength:.6g} nm"
        if not response[0] <= nominal.line <= response[1]:
            problem = f"it does not reach the laser's {line}, so nothing is ever seen."
            return Fault(f"{key}.response", problem, "Change it, or laser.wavelength.")
        incidence = self._incidences if by_line else np.zeros(1)
        passed = laser_gain(self.filter, nominal, response, incidence)
        if passed.max() < _LEAST_PASSED:
            problem = f"its band misses the laser's {line} at all ranges, so nothing is ever seen."
            return Fault(
                "filter", problem, "Change filter.centre or filter.bandwidth, or write 'filter: none'."
            )
        return None

    @property
    def _incidences(self) -> NDArray[np.float64]:
        """Incidences on the filter of light that images along the array [rad]."""
        sensor = self.position_sensor
        positions = np.linspace(sensor.offset, sensor.offset + sensor.length, _INCIDENCES)
        return np.arctan([self.receiver.line_image.tangent(float(p)) for p in positions])

    @property
    def rangefinders(self) -> tuple[RangefinderName, ...]:
        """What the instrument can measure ranges with."""
        parts: dict[RangefinderName, object] = {"triangulation": self.line_choice, "tof": self.lidar_choice}
        return tuple(name for name, part in parts.items() if part != "none")

    @property
    def seeing(self) -> tuple[RangefinderName, ...]:
        """Those of them that see the laser."""
        return tuple(name for name in self.rangefinders if self._blindness(name) is None)

    @property
    def position_sensor(self) -> PositionSensor:
        """The line sensor.

        Raises
        ------
        InputError
            If the instrument has none.
        """
        if self.line_choice == "none":
            raise InputError(
                "this needs triangulation, and the instrument has no position sensor.",
                remedy="Choose an instrument that has one: scanner-sim instruments lists those that are shipped.",
            )
        return self.line_choice

    @property
    def lidar(self) -> Lidar:
        """The time-of-flight unit.

        Raises
        ------
        InputError
            If the instrument has none.
        """
        if self.lidar_choice == "none":
            raise InputError(
                "this needs time of flight, and the instrument has no unit for it.",
                remedy="Choose an instrument that has one: scanner-sim instruments lists those that are shipped.",
            )
        return self.lidar_choice

    @property
    def dwell(self) -> float:
        """Time spent on a voxel [s]."""
        return 1.0 / self.rate

    @property
    def exposure(self) -> float:
        """Time for which the laser shines on a voxel [s]."""
        return (1.0 - self.laser_off) * self.dwell

    @property
    def point_spread(self) -> float:
        """Standard deviation of the image of a point on the line [m], per axis: the lens's and the sensor's."""
        return math.hypot(self.receiver.aberration, self.position_sensor.diffusion)

    @property
    def nearest_range(self) -> float:
        """Nearest range that the array sees on the axis [m] (eq 1 at Θ = 0)."""
        return self._range_at(self.position_sensor.offset + self.position_sensor.length)

    @property
    def farthest_range(self) -> float:
        """Farthest range that the array sees on the axis [m]; infinite where it starts at p = 0."""
        start = self.position_sensor.offset
        return self._range_at(start) if start > 0.0 else float("inf")

    def seen_at(self, distance: FloatLike) -> ArrayPlace:
        """Return how the line sees the beam, not deflected, at ranges [m]; lengths in pixels."""
        image, d = self.receiver.line_image, self.receiver.baseline
        return image.at(image.position(d / distance), d, self.position_sensor.pitch)

    def places(self, positions: Iterable[float]) -> Iterator[tuple[float, float]]:
        """Yield positions on the line [m] with the ranges [m] that are seen there, the beam not deflected."""
        for position in positions:
            yield float(position), self._range_at(float(position))

    def _range_at(self, position: float) -> float:
        image, d = self.receiver.line_image, self.receiver.baseline
        return image.scale * d / position + image.slope * d

    def seen_by(self, rangefinder: RangefinderName) -> tuple[float, float]:
        """Return the nearest and farthest range [m] that a rangefinder sees on the axis: its array, or its gate."""
        if rangefinder == "tof":
            return self.lidar.digitiser.gate
        return self.nearest_range, self.farthest_range


def geometry_of(scanner: Scanner) -> Geometry:
    """Return the calibration of an instrument; pitch and offset are NaN without a position sensor."""
    receiver, sensor, mirrors = scanner.receiver, scanner.line_choice, scanner.mirrors
    return Geometry(
        scale=receiver.line_image.scale,
        baseline=receiver.baseline,
        axis_separation=mirrors.axis_separation,
        pitch=math.nan if sensor == "none" else sensor.pitch,
        offset=math.nan if sensor == "none" else sensor.offset,
        synchronisation=mirrors.synchronisation,
        slope=receiver.line_image.slope,
        pulse_by="coaxial" if scanner.lidar_choice == "none" else scanner.lidar.photodiode.place,
        focus=None if receiver.array_tilt == "ideal" else receiver.line_image,
    )


def speckle_optics(scanner: Scanner) -> Optics:
    """Return what the laser's speckle depends on, on the line of an instrument."""
    receiver, sensor, laser = scanner.receiver, scanner.position_sensor, scanner.laser
    cell = laser.wavelength * receiver.focal_length / receiver.aperture
    steps = (np.arange(_SPOTS) + 1.0) / _SPOTS
    images = (
        (
            0.5 * laser.radius(distance) * receiver.focal_length / distance,
            receiver.line_image.at(position, receiver.baseline, sensor.pitch),
        )
        for position, distance in scanner.places(sensor.offset + steps * sensor.length)
    )
    return Optics.of(cell, receiver.aberration, sensor.diffusion, sensor.pitch, images)
