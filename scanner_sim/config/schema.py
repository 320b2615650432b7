"""The JSON schema of scenario files, for editors."""

from __future__ import annotations

import re
from typing import Any

from scanner_sim.scenario import Scenario

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of scenario files (draft 2020-12).

    It knows keys, choices, units and bounds of plain numbers; what several values must not be together, only
    loading finds out.
    """
    schema = Scenario.model_json_schema(by_alias=True, mode="validation")
    schema = {"$schema": DIALECT, "title": "Scanner Sim scenario", **_tidy(schema)}
    # Editors complain about an unknown key otherwise, when the file names its schema in the document itself.
    schema["title"] = "Scanner Sim scenario"
    return schema


def _tidy(node: Any) -> Any:
    """Remove what means nothing to an editor: numeric bounds of texts with units, and reST marks."""
    if isinstance(node, list):
        return [_tidy(item) for item in node]
    if not isinstance(node, dict):
        return node
    tidy = {key: _tidy(value) for key, value in node.items()}
    if tidy.get("type") == "string":
        for bound in ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum"):
            tidy.pop(bound, None)
    if isinstance(tidy.get("description"), str):
        text = re.sub(r":\w+:`~?([^`]*)`", r"\1", tidy["description"]).replace("``", "")
        tidy["description"] = re.sub(r"[ \n]*\n[ \n]*", " ", text)
    return tidy
