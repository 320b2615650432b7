"""Parts of the preset ``nrc_2000``, with changes: the parts themselves have no numbers of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from scanner_sim.config.scanner import Scanner
from scanner_sim.foundation.parts import Part
from scanner_sim.optics.line_image import ArrayPlace

NRC_2000 = Scanner()


def _changed(part: Part) -> Callable[..., Any]:
    """Return what makes a part with changes; it checks itself as any part does."""

    def make(**changes: Any) -> Part:
        own = dict(part) | changes
        if changes.get("energy") is not None:
            own["peak_power"] = changes.get("peak_power")
        return type(part)(**own)

    return make


Laser = _changed(NRC_2000.laser)
Mirrors = _changed(NRC_2000.mirrors)
TemperatureCourse = _changed(NRC_2000.mirrors.temperature)
Galvanometers = _changed(NRC_2000.galvanometers)
Receiver = _changed(NRC_2000.receiver)
BandpassFilter = _changed(NRC_2000.filter)
PositionSensor = _changed(NRC_2000.position_sensor)
Pulse = _changed(NRC_2000.lidar.pulse)
Photodiode = _changed(NRC_2000.lidar.photodiode)
Digitiser = _changed(NRC_2000.lidar.digitiser)
SHARP = ArrayPlace(stretch=1.0, across=1.0, skewed=1.0, defocus=0.0, shift=0.0)
"""An upright array in the focal plane, in focus."""
