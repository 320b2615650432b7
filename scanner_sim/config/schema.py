"""The JSON schema of scenario files, for editors."""

from __future__ import annotations

import re
from typing import Any

from scanner_sim.config.outline import EACH, outline
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.parts import Part

DIALECT = "https://json-schema.org/draft/2020-12/schema"

_NUMERIC = ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")
_NO_KEYWORDS = ("ge", "gt", "le", "lt")


def json_schema(part: type[Part] = Scenario, name: str = "scenario") -> dict[str, Any]:
    """Return the JSON schema of scenario files, or of those of another part of that ``name`` (draft 2020-12).

    It knows keys, choices, units and the bounds of plain numbers; what several values must not be together is
    found when a file is loaded.
    """
    schema: dict[str, Any] = _tidy(part.model_json_schema(by_alias=True, mode="validation"))
    _spell_defaults(schema, part)
    return {"$schema": DIALECT, **schema, "title": f"Scanner Sim {name}"}


def _tidy(node: Any) -> Any:
    """Return a schema without what means nothing to an editor: titles, bounds of texts, marks of reST.

    What releases of pydantic write in different ways is written in one: the same schema has the same bytes.
    """
    if isinstance(node, list):
        return [_tidy(item) for item in node]
    if not isinstance(node, dict):
        return node
    tidy = {
        key: _tidy(value)
        for key, value in node.items()
        if key not in _NO_KEYWORDS and not (key == "title" and isinstance(value, str))
    }
    if tidy.get("type") == "string":
        # The values inside are numbers, so pydantic bounds them; in a file they are texts with units.
        tidy = {key: value for key, value in tidy.items() if key not in _NUMERIC}
    if "const" in tidy:
        tidy.pop("enum", None)
    if [*map(set, tidy.get("allOf", ()))] == [{"$ref"}]:
        tidy = tidy.pop("allOf")[0] | tidy
    if isinstance(tidy.get("description"), str):
        text = re.sub(r":\w+:`~?([^`]*)`", r"\1", tidy["description"]).replace("``", "")
        tidy["description"] = " ".join(text.split())
    return tidy


def _spell_defaults(schema: dict[str, Any], root: type[Part]) -> None:
    """Write defaults as a file would spell them: with units."""
    slots = outline(root)
    for location, slot in slots.items():
        part = slots[location[:-1]].part if location else None
        if part is None or slot.field is None:
            continue
        node = schema if part is root else schema["$defs"][part.__name__]
        if root is Scenario and location[0] == "scanner" and len(location) > 1:
            # What a scenario leaves out its preset has.
            node.pop("required", None)
        if slot.preset is not None and slot.part is None:
            node["properties"][location[-1]]["default"] = slot.preset
        default = slot.field.default
        entry = slots.get((*location, EACH))
        if slot.dimension is not None and isinstance(default, float):
            node["properties"][location[-1]]["default"] = slot.dimension.format(default)
        elif entry is not None and entry.dimension is not None and isinstance(default, tuple) and default:
            node["properties"][location[-1]]["default"] = [entry.dimension.format(item) for item in default]
