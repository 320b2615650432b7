"""Faults of values: what pydantic found, said in the words of the scenario."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, SupportsFloat

from pydantic import ValidationError

from scanner_sim.config.document import Location, Value, value_at
from scanner_sim.config.outline import Slot, kinds_of_key, locations_of_key, slot_at
from scanner_sim.config.preset import DEFAULT
from scanner_sim.config.scenario import Scenario
from scanner_sim.config.wording import capital, choice, inline_yaml, nearest, shorten, shown
from scanner_sim.foundation.parts import Part
from scanner_sim.scene.objects import KINDS, SHAPES


class RawFault(NamedTuple):
    """A fault whose location is not yet spelt out."""

    location: Location
    problem: str
    remedy: str


def faults_found(
    error: ValidationError, data: Value, inside: Location = (), root: type[Part] = Scenario
) -> list[RawFault]:
    """Return the faults that pydantic found ``inside`` data, in its own order and without repetitions.

    The ``root`` is what the data are of.
    """
    found: dict[RawFault, None] = {}
    for details in error.errors(include_url=False):
        tagged: Location = (*inside, *details["loc"])
        location = tuple(step for step in tagged if not (isinstance(step, str) and step.startswith("(")))
        for fault in _translate(details, tagged, location, data, root):
            found.setdefault(fault)
    return list(found)


def _translate(
    details: Mapping[str, Any], tagged: Location, location: Location, data: Value, root: type[Part]
) -> Iterator[RawFault]:
    context = details.get("ctx", {})
    slot, came = slot_at(tagged, root), value_at(data, location)
    match details["type"]:
        case "impossible":
            for fault in context["faults"]:
                steps = filter(None, fault.location.split("."))
                inside = tuple(int(step) if step.isdigit() else step for step in steps)
                yield RawFault((*location, *inside), fault.problem, fault.remedy)
        case "extra_forbidden":
            yield RawFault(location, *_unknown(str(location[-1]), slot_at(tagged[:-1], root)))
        case "missing" if isinstance(location[-1], int):
            yield _wrong_length(location[:-1], slot_at(tagged[:-1], root), data)
        case "too_long" | "too_short":
            least, most = context.get("min_length", 0), context.get("max_length", math.inf)
            # Entries with faults of their own are not counted by pydantic.
            if not (isinstance(came, list) and least <= len(came) <= most):
                yield _wrong_length(location, slot, data, least, most)
        case "missing":
            yield RawFault(
                location, "this key is missing.", f"Write for example '{location[-1]}: {slot.example}'."
            )
        case "object_kind":
            yield _kind_of_object(location, came)
        case "union_tag_invalid" if isinstance(came, dict) and "type" not in came:
            kinds = _kinds(context["expected_tags"])
            yield RawFault(location, "the key 'type' is missing.", f"Possible: {', '.join(kinds)}.")
        case "union_tag_invalid" if isinstance(came, dict):
            kinds = _kinds(context["expected_tags"])
            problem = f"{shown(came['type'])} is not possible here."
            yield RawFault((*location, "type"), problem, choice(came["type"], kinds))
        case "estimator":
            remedy = f"{choice(came, context['names'])} {context['remedy']}"
            yield RawFault(location, f"there is no estimator {shown(came)}.", remedy)
        case "literal_error" if location == ("schema",):
            yield RawFault(
                location, f"{shown(came)} is no version that this program reads.", "Write 'schema: 1'."
            )
        case "literal_error":
            yield RawFault(location, f"{shown(came)} is not possible here.", choice(came, slot.choices))
        case "greater_than" | "greater_than_equal" | "less_than" | "less_than_equal":
            yield RawFault(location, _out_of_bounds(details, slot, came), _default(slot))
        case "finite_number":
            yield RawFault(
                location, f"{shown(came)} is not a finite number.", f"Write for example {slot.example}."
            )
        case "string_pattern_mismatch":
            problem = f"{shown(came)} is no name: a letter, then letters, digits, - and _ are possible."
            yield RawFault(location, problem, f"Write for example {slot.example}.")
        case "string_too_long":
            yield RawFault(
                location, "this name is too long.", f"At most {context['max_length']} letters are possible."
            )
        case "quantity" | "unit_missing":
            yield RawFault(location, f"{context['reason']}.", f"Write for example {slot.example}.")
        case "material":
            yield RawFault(location, context["problem"], context["remedy"])
        case "input_file":
            problem, _, remedy = context["problem"].partition("; ")
            yield RawFault(location, problem if problem.endswith(".") else f"{problem}.", capital(remedy))
        case _:
            yield RawFault(location, f"{shown(came)} is not {_expected_kind(details['type'])}.", _write(slot))


def _kinds(tags: str) -> tuple[str, ...]:
    """Return the values of the key ``type`` from pydantic's list of tags, ``'(twist)', '(file)'``."""
    return tuple(tag.strip(" '()") for tag in tags.split(","))


_WANTED = {
    "bool": "true or false",
    "int": "a whole number",
    "float": "a plain number",
    "string": "a word",
    "tuple": "a list",
    "model": "a block of keys",
    "dataclass": "a block of keys",
    "path": "the name of a file",
}


def _expected_kind(kind: str) -> str:
    return _WANTED.get(kind.split("_")[0], "possible here")


def _write(slot: Slot) -> str:
    if slot.part is not None and not (slot.field is not None and slot.field.examples):
        key = slot.keys[0]
        return f"Write keys below it; known are {', '.join(slot.keys)}." if key else ""
    return f"Write for example {slot.example}."


def _unknown(key: str, slot: Slot) -> tuple[str, str]:
    """Say what an unknown key should have been."""
    near = nearest(key, slot.keys)
    if near:
        return "there is no such key.", f"Did you mean '{near}'?"
    known = f"known here are {', '.join(slot.keys)}."
    if kinds := kinds_of_key(key, slot):
        words = " or ".join(f"'{kind}'" for kind in kinds)
        return "there is no such key here.", f"It belongs to the kind {words}; {known}"
    elsewhere = locations_of_key(key, slot.root)[:2]
    if elsewhere:
        return "there is no such key here.", f"It belongs to {' or '.join(elsewhere)}; {known}"
    return "there is no such key.", capital(known)


def _kind_of_object(location: Location, came: Value) -> RawFault:
    example = "{name: wall, shape: rectangle, size: [4 m, 4 m], material: grey_reference}"
    if not isinstance(came, dict):
        return RawFault(location, f"{shown(came)} is not an object.", f"Write for example {example}.")
    kinds = [key for key in KINDS if came.get(key) is not None]
    if kinds == ["shape"]:
        return RawFault(
            (*location, "shape"), f"{shown(came['shape'])} is no shape.", choice(came["shape"], SHAPES)
        )
    if kinds:
        named = f"{', '.join(kinds[:-1])} and {kinds[-1]}"
        return RawFault(location, f"it has the keys {named}, which exclude one another.", "Keep one of them.")
    for key in came:
        if near := nearest(key, KINDS):
            return RawFault((*location, key), "there is no such key.", f"Did you mean '{near}'?")
    return RawFault(
        location,
        f"it has none of the keys {', '.join(KINDS)}, so it is no object.",
        f"Write for example {example}.",
    )


def _wrong_length(
    location: Location, slot: Slot, data: Value, least: int = 0, most: float = math.inf
) -> RawFault:
    came = value_at(data, location)
    count = len(came) if isinstance(came, list) else 0
    entries = "1 entry" if count == 1 else f"{count} entries"
    example = f"Write for example {slot.example}."
    if slot.example == inline_yaml(None) and not least <= count <= most:
        example = f"It takes {least} or more." if count < least else f"It takes {most} or fewer."
    return RawFault(location, f"this list has {entries}.", example)


def _out_of_bounds(details: Mapping[str, Any], slot: Slot, came: Value) -> str:
    ((_, bound),) = (item for item in details["ctx"].items() if item[0] != "error")
    relation = {
        "greater_than": "more than",
        "greater_than_equal": "at least",
        "less_than": "less than",
        "less_than_equal": "at most",
    }[details["type"]]
    limit = f"{bound:g}" if slot.dimension is None else str(slot.dimension.format(float(bound)))
    if slot.dimension is not None and isinstance(came, SupportsFloat):
        came = slot.dimension.format(float(came))
    return f"{shorten(str(came))} is not possible; it must be {relation} {limit}."


def _default(slot: Slot) -> str:
    who = "The default is" if slot.preset is None else f"{DEFAULT} has"
    return f"{who} {slot.default}." if slot.default else ""
