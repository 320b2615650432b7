"""Limits and defaults of every key that a file may hold stand once more in ``stated_limits.toml``.

A limit decides what is refused, with which message, and what the schema and the reference say. No physics depends on
it, so that nothing else would notice another one. Who changes one on purpose changes it there, too.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from scanner_sim.acceptance.plan import AcceptancePlan
from scanner_sim.calibration.plan import SelfCalibration
from scanner_sim.campaign.approach.plan import Approach
from scanner_sim.campaign.plan import Plan
from scanner_sim.config.calibration import CalibrationFile
from scanner_sim.config.scenario import Scenario
from scanner_sim.instrument.closed_loop.state_file import SavedState
from scanner_sim.scene.materials import Material

STATED = tomllib.loads(Path(__file__).with_name("stated_limits.toml").read_text(encoding="utf-8"))
ROOTS = (Scenario, AcceptancePlan, SelfCalibration, Approach, Plan, CalibrationFile, SavedState, Material)
WORDS = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<", "min_length": "items ≥", "max_length": "items ≤"}


def within(kind: Any, seen: dict[str, type[BaseModel]]) -> Iterator[str]:
    """Yield the limits that a type holds, and note the parts that it is made of."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        if kind.__name__ not in seen:
            seen[kind.__name__] = kind
            for field in kind.model_fields.values():
                list(within(field.annotation, seen))
        return
    for part in get_args(kind):
        if isinstance(part, FieldInfo):
            yield from bounds(part.metadata)
        elif any(hasattr(part, name) for name in WORDS):
            yield from bounds([part])
        else:
            yield from within(part, seen)


def bounds(metadata: Any) -> Iterator[str]:
    """Yield what pydantic's limits say, in words."""
    for one in metadata:
        for name, word in WORDS.items():
            if (limit := getattr(one, name, None)) is not None:
                yield f"{word} {limit!r}"


def parts() -> dict[str, type[BaseModel]]:
    """Return all parts that files may hold."""
    seen: dict[str, type[BaseModel]] = {}
    for root in ROOTS:
        list(within(root, seen))
    return seen


PARTS = parts()


def stated(part: type[BaseModel]) -> dict[str, str]:
    """Return what is known of the fields that have limits or a plain default."""
    found = {}
    for name, field in part.model_fields.items():
        # Those below come first: versions of pydantic order them otherwise.
        below = sorted(bounds(field.metadata), key=lambda text: (">≥" + text[0]).index(text[0]))
        about = [*below, *within(field.annotation, {})]
        if isinstance(field.default, bool | int | float | str):
            about.append(f"default {field.default!r}")
        if about:
            found[field.alias or name] = ", ".join(about)
    return found


def test_the_parts_are_those_that_are_stated() -> None:
    assert sorted(name for name, part in PARTS.items() if stated(part)) == sorted(STATED)


@pytest.mark.parametrize("name", STATED)
def test_limits_and_defaults_are_those_that_are_stated(name: str) -> None:
    assert stated(PARTS[name]) == STATED[name]
