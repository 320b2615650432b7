"""The instrument as a whole; what is not said of it comes from its preset."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import Field, ValidationInfo, model_validator

from scanner_sim.config.preset import DEFAULT, fill, preset_of
from scanner_sim.detector.line.position_sensor import PositionSensor
from scanner_sim.detector.photodiode.photodiode import Digitiser, Photodiode
from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Part
from scanner_sim.foundation.units import Frequency, Ratio
from scanner_sim.optics.as_built import AsBuilt
from scanner_sim.optics.deflection import Mirrors
from scanner_sim.optics.filter import FilterChoice
from scanner_sim.optics.galvanometer import Galvanometers
from scanner_sim.optics.laser import Laser
from scanner_sim.optics.pulse import Pulse
from scanner_sim.optics.receiver import Receiver
from scanner_sim.optics.speckle import Optics
from scanner_sim.ranging.ranges import Geometry

FILLED = {"scanner": "filled"}
"""Validation context where the scanner's block already has what its preset says."""


class Lidar(Part):
    """The time-of-flight unit: one pulse for each voxel, through the beam, mirrors and filter of the triangulation."""

    pulse: Pulse
    """The laser's pulse."""
    photodiode: Photodiode
    """The avalanche photodiode and its amplifier; its ``place`` says whether it looks along the laser."""
    digitiser: Digitiser
    """The converter that records the waveform, and its clock."""


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
    position_sensor: PositionSensor
    """The line sensor of the triangulation."""
    lidar: Lidar
    """The time-of-flight unit, where ``ranging`` asks for it."""
    rate: Frequency = Field(ge=1e-3, le=1e9)
    """Voxels per second; its inverse is the dwell."""
    laser_off: Ratio = Field(ge=0.0, le=0.9)
    """Share of the dwell in which the laser is off: the line then sees the background alone, which is subtracted. 0 is
    a laser that always shines."""
    as_built: AsBuilt | None = None
    """How the instrument that measures departs from all this, which it believes; by default it does not."""

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, data: Any, info: ValidationInfo) -> Any:
        context = info.context if isinstance(info.context, dict) else {}
        if not isinstance(data, Mapping) or FILLED.items() <= context.items():
            return data
        return fill(data, preset_of(data, context.get("folder", "")))

    def cross_checks(self) -> Iterator[Fault]:
        """Yield an array that reaches into the near range, where the equations no longer hold."""
        if self.nearest_range <= self.receiver.baseline:
            end = self.position_sensor.offset + self.position_sensor.length
            yield Fault(
                "position_sensor.pixels",
                f"the array ends at p = {1e3 * end:.4g} mm and sees ranges from {self.nearest_range:.4g} m, "
                "nearer than the base of "
                f"{self.receiver.baseline:g} m: such rays do not pass the lens.",
                "Reduce pixels, pitch or offset, or raise receiver.focal_length.",
            )
        if self.point_spread < 1e-8:
            yield Fault(
                "receiver.aberration",
                "neither the lens nor the sensor blurs the image: a point of light would fall between two pixels.",
                "Write 10 nm or more for receiver.aberration or position_sensor.diffusion.",
            )

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
        """Nearest range that the array sees on the axis [m]: f d / p_max (eq 1 at Θ = 0)."""
        end = self.position_sensor.offset + self.position_sensor.length
        return self.receiver.focal_length * self.receiver.baseline / end

    @property
    def farthest_range(self) -> float:
        """Farthest range that the array sees on the axis [m]; infinite where it starts at p = 0."""
        start = self.position_sensor.offset
        return self.receiver.focal_length * self.receiver.baseline / start if start > 0.0 else float("inf")


def geometry_of(scanner: Scanner) -> Geometry:
    """Return the calibration of an instrument's triangulation."""
    receiver, sensor, mirrors = scanner.receiver, scanner.position_sensor, scanner.mirrors
    return Geometry(
        focal_length=receiver.focal_length,
        baseline=receiver.baseline,
        axis_separation=mirrors.axis_separation,
        pitch=sensor.pitch,
        offset=sensor.offset,
        synchronisation=mirrors.synchronisation,
    )


def speckle_optics(scanner: Scanner) -> Optics:
    """Return what the laser's speckle depends on, on the line of an instrument."""
    receiver, sensor, laser = scanner.receiver, scanner.position_sensor, scanner.laser
    cell = laser.wavelength * receiver.focal_length / receiver.aperture
    near = scanner.nearest_range
    widest = 0.5 * float(laser.radius(near)) * receiver.focal_length / near
    return Optics.of(cell, receiver.aberration, sensor.diffusion, sensor.pitch, widest)
