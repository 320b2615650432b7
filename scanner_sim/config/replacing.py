"""Values that replace others in the plain data of a scenario, by their keys."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from scanner_sim.config.document import (
    LONGEST_NUMBER,
    Document,
    Location,
    Value,
    read_document,
    spell,
    value_at,
)
from scanner_sim.config.preset import ONE_OF
from scanner_sim.config.wording import choice, shown
from scanner_sim.foundation.errors import Fault


def plain(value: Any) -> Value:
    """Return a copy in dictionaries and lists, which overrides may change."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, int) and value.bit_length() > 4 * LONGEST_NUMBER:
        # Python does not even write such a number as text.
        return f"a number of {value.bit_length()} bits"
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value


def steps_of(key: str) -> list[str]:
    """Return the steps of a key, ``scene.objects[0].size`` or ``scene.objects.0.size``.

    Raises
    ------
    ValueError
        If one of them is empty.
    """
    steps = _split(str(key))
    if not all(steps):
        raise ValueError("this is no key. Write for example scanner.laser.power.")
    return steps


def _split(key: str) -> list[str]:
    return re.sub(r"\[([\w-]+)\]", r".\1", key.strip()).split(".")


def location_of(data: Value, steps: Sequence[str]) -> Location:
    """Return where a key stands in the plain data of a scenario; objects that are named become indices.

    Raises
    ------
    ValueError
        If a list on the way has no such entry.
    """
    location: Location = ()
    inside = data
    for step in steps:
        found: str | int = _index(inside, step, location) if isinstance(inside, list) else step
        location = (*location, found)
        inside = value_at(inside, (found,))
    return location


def make_room(data: Value, changes: Mapping[str, object]) -> None:
    """Take out what a new value excludes, where nothing else was asked for: a pulse has a peak power or an energy."""
    for key in changes:
        block, _, last = str(key).rpartition(".")
        others = {f"{block}.{other}" for other in ONE_OF} - {key}
        if last in ONE_OF and not others & changes.keys():
            inside = value_at(data, block.split("."))
            if isinstance(inside, dict) and inside.get(last) is not None:
                inside.update({other.rpartition(".")[2]: None for other in others})


def put_overrides(document: Document, overrides: Sequence[str], faults: list[Fault]) -> dict[Location, str]:
    """Put the overrides into the data; return which location each of them filled."""
    origins: dict[Location, str] = {}
    changes: dict[str, object] = {}
    for text in overrides:
        path, equals, value_text = text.partition("=")
        steps = _split(path)
        if not equals or not all(steps):
            faults.append(
                Fault(
                    f"override {shown(text)}",
                    "this is not KEY=VALUE.",
                    "Write for example scanner.laser.power=20 mW.",
                )
            )
            continue
        value = read_document(value_text.strip())
        if value.faults:
            faults += [
                Fault(f"override {shown(text)}", fault.problem, fault.remedy) for fault in value.faults
            ]
            continue
        try:
            origins[put(document.data, steps, value.data)] = text
            changes[".".join(steps)] = value.data
        except ValueError as error:
            faults.append(Fault(f"override {shown(text)}", str(error)))
    make_room(document.data, changes)
    return origins


def put(data: Value, steps: list[str], value: Value) -> Location:
    """Put a value into the data; return its location, or that of the first key that had to be made.

    Raises
    ------
    ValueError
        If the way there leads through something that has no keys.
    """
    inside: Value = data
    location: Location = ()
    made: Location = ()
    for number, step in enumerate(steps):
        last = number == len(steps) - 1
        if isinstance(inside, list):
            index = _index(inside, step, location)
            location = (*location, index)
            if last:
                inside[index] = value
            inside = inside[index]
        elif isinstance(inside, dict):
            location = (*location, step)
            if last:
                inside[step] = value
            elif inside.get(step) is None:
                inside[step] = {}
                made = made or location
            inside = inside[step]
        else:
            raise ValueError(f"{spell(location)} is {shown(inside)}, which has no keys. Set it as a whole.")
    return made or location


def _index(items: list[Value], step: str, location: Location) -> int:
    """Return the index that a step names: a number, or the name of an object."""
    names = [str(item.get("name")) if isinstance(item, dict) else "" for item in items]
    if step in names:
        return names.index(step)
    if step.isdecimal() and len(step) < 10 and int(step) < len(items):
        return int(step)
    if step.isdecimal():
        raise ValueError(f"{spell(location)} has {len(items)} entries, counted from 0.")
    known = tuple(name for name in names if name)
    raise ValueError(
        f"{spell(location)} has no entry called {shown(step)}. {choice(step, known) if known else 'Write an index.'}"
    )
