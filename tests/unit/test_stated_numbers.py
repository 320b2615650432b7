"""Numbers that users rely on without writing them: defaults, materials, physical constants, limits of what is told.

They stand once more in ``stated_numbers.toml``, for no other test depends on their values: a changed default is another
instrument, and a changed limit another verdict. Who changes one on purpose changes it there, too, and in the documents.
"""

from __future__ import annotations

import importlib
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel

from scanner_sim.acceptance.plan import AcceptancePlan
from scanner_sim.calibration.plan import SelfCalibration
from scanner_sim.config.scanner import Scanner
from scanner_sim.detector.frame.exposure import AutomaticExposure
from scanner_sim.detector.frame.glare import Glare
from scanner_sim.detector.frame.sensor import FrameSensor
from scanner_sim.detector.frame.video_camera import CameraLens, FrameSampling, VideoOrientation
from scanner_sim.pose.settings import PoseSettings
from scanner_sim.render.settings import Transport
from scanner_sim.scan.lissajous import LissajousPattern
from scanner_sim.scan.schedule import Visiting
from scanner_sim.scene.light.lighting import Earth, Sun
from scanner_sim.scene.light.orbit import Orbit
from scanner_sim.scene.materials import MATERIALS
from scanner_sim.scene.retroreflectors import RetroLobe
from scanner_sim.scene.visible import VISIBLE
from scanner_sim.signals.processing import Processing
from scanner_sim.tracking.state import TrackerSettings

STATED = tomllib.loads(Path(__file__).with_name("stated_numbers.toml").read_text(encoding="utf-8"))
PARTS = (
    Scanner, Processing, Transport, LissajousPattern, Visiting, TrackerSettings, Sun, Earth, Orbit, PoseSettings,
    RetroLobe, FrameSensor, VideoOrientation, CameraLens, FrameSampling, Glare,
)  # fmt: skip


def numbers(part: BaseModel, place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of a part with their places, parts within it taken apart; None as a word."""
    for field, about in type(part).model_fields.items():
        name, value = about.alias or field, getattr(part, field)
        if isinstance(value, BaseModel):
            yield from numbers(value, f"{place}{name}.")
        elif isinstance(value, tuple):
            yield f"{place}{name}", [str(one) if not isinstance(one, float | int) else one for one in value]
        else:
            yield f"{place}{name}", value if isinstance(value, bool | int | float | str) else str(value)


def assert_stated(found: dict[str, Any], stated: dict[str, Any]) -> None:
    """Assert that the same names have the same values, numbers to rounding."""
    assert sorted(found) == sorted(stated)
    for name, value in found.items():
        wanted = stated[name]
        if isinstance(value, float | list) and not isinstance(value, bool) and value:
            wanted = pytest.approx(wanted, rel=1e-12, abs=0.0) if not _words(value) else wanted
        assert value == wanted, name


def _words(value: Any) -> bool:
    return isinstance(value, list) and any(isinstance(one, str) for one in value)


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.__name__)
def test_defaults_are_those_that_are_stated(part: type[BaseModel]) -> None:
    assert_stated(dict(numbers(part())), STATED["defaults"][part.__name__])


@pytest.mark.parametrize(
    "plan", [AcceptancePlan, SelfCalibration, AutomaticExposure], ids=lambda plan: plan.__name__
)
def test_defaults_of_plans_are_those_that_are_stated(plan: type[BaseModel]) -> None:
    about = {name: field.default for name, field in plan.model_fields.items()}
    found = {name: value for name, value in about.items() if isinstance(value, int | float | str)}
    assert_stated(found, STATED["plans"][plan.__name__])


def test_materials_are_those_that_are_stated() -> None:
    assert sorted(MATERIALS) == sorted(STATED["materials"])
    for name, material in MATERIALS.items():
        found = {place: value for place, value in numbers(material) if place != "source"}
        assert_stated(found, STATED["materials"][name])


def test_what_surfaces_are_in_visible_light_is_what_is_stated() -> None:
    found = {name: [seen.reflectance, seen.eta or 0.0, seen.k or 0.0] for name, seen in VISIBLE.items()}
    assert_stated(found, STATED["visible"])


@pytest.mark.parametrize(("place", "value"), STATED["constants"].items(), ids=lambda value: str(value))
def test_constants_are_those_that_are_stated(place: str, value: Any) -> None:
    module, _, name = place.rpartition(".")
    assert getattr(importlib.import_module(f"scanner_sim.{module}"), name) == pytest.approx(value, rel=1e-12)
