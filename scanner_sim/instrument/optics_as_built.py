"""The optics that light meets, of an instrument as it was built."""

from __future__ import annotations

import numpy as np

from scanner_sim.config.scanner import Scanner, geometry_of
from scanner_sim.config.scenario import Scenario
from scanner_sim.optics.band_irradiance import band_irradiance
from scanner_sim.optics.built_instrument import BuiltInstrument
from scanner_sim.optics.filter import laser_gain, peak_transmission
from scanner_sim.optics.lens_errors import LensErrors
from scanner_sim.render.incident import Throughput
from scanner_sim.render.transport import OpticalLayout

_LINE = ("pitch", "height", "offset", "diffusion")
_LENS = ("radial_1", "radial_2", "tangential")


def optics_as_built(scanner: Scanner, built: BuiltInstrument | None) -> OpticalLayout:
    """Return the optics of a scanner with its true lengths, and how they depart from the design otherwise.

    The lengths of its line are 0 where it has none.
    """
    sensor = scanner.line_choice
    line = {name: 0.0 if sensor == "none" else getattr(sensor, name) for name in _LINE}
    return OpticalLayout(
        laser=scanner.laser,
        receiver=scanner.receiver,
        axis_separation=scanner.mirrors.axis_separation,
        filter_transmission=peak_transmission(scanner.filter),
        **line,
        axes=None if built is None else _axes(built),
        lens=None if built is None or sensor == "none" else _lens(built, sensor.offset + sensor.length),
    )


def line_throughput(scenario: Scenario, scanner: Scanner, optics: OpticalLayout) -> Throughput:
    """Return what each pixel makes of the laser's and the Sun's light behind the filter of a scanner as built."""
    sensor, sun, laser = scanner.position_sensor, scenario.lighting.sun, scanner.laser
    position = geometry_of(scanner).position(np.arange(sensor.pixels, dtype=np.float64))
    angle = np.arctan(optics.receiver.line_image.tangent(position))
    bands = np.zeros((2, sensor.pixels))
    if sun != "none":
        bands[:] = band_irradiance(sun, scanner.filter, sensor.response, laser.wavelength, angle)
    passed = laser_gain(scanner.filter, laser, sensor.response, angle)
    stray = 0.0 if scanner.as_built is None else scanner.as_built.stray_light or 0.0
    return Throughput(optics, sensor.pixels, passed, bands[0], bands[1], stray)


def _axes(built: BuiltInstrument) -> tuple[float, float] | None:
    axes = built.value("axis_offset"), built.value("axis_skew")
    return axes if any(axes) else None


def _lens(built: BuiltInstrument, end: float) -> LensErrors | None:
    radial_1, radial_2, along = (built.value(name) for name in _LENS)
    across, blur = built.own.tangential_across or 0.0, built.own.field_blur or 0.0
    if not any((radial_1, radial_2, along, across, blur)):
        return None
    return LensErrors(radial_1, radial_2, across, along, blur, end)
