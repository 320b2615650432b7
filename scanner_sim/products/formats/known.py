"""What is needed of the scenario that a result carries as text: when shots were, and which echo was timed."""

from __future__ import annotations

from datetime import datetime

import yaml
from pydantic import BaseModel, ValidationError

from scanner_sim.foundation.units import FROM_FILE, Frequency, Length

_Loader = yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader


class _Mirrors(BaseModel):
    axis_separation: Length


class _Scanner(BaseModel):
    rate: Frequency
    mirrors: _Mirrors


class _Elements(BaseModel):
    time: datetime


class _Lighting(BaseModel):
    tle: _Elements | None = None


class _Pulse(BaseModel):
    echo: str


class _Processing(BaseModel):
    pulse: _Pulse


class Known(BaseModel):
    """What is needed of the scenario that a result carries in its text."""

    ranging: str
    scanner: _Scanner
    lighting: _Lighting
    processing: _Processing

    @property
    def epoch(self) -> datetime | None:
        """When the scan starts, in UTC."""
        return None if self.lighting.tle is None else self.lighting.tle.time


def known_of(scenario_yaml: str) -> Known | None:
    """Return what is needed of a resolved scenario; None where a result was made without one."""
    try:
        return Known.model_validate(yaml.load(scenario_yaml, _Loader), context=FROM_FILE)
    except (yaml.YAMLError, ValidationError, RecursionError):
        return None
