"""A scenario written back as YAML: complete, readable, and the same again when it is read."""

from __future__ import annotations

import json
from functools import lru_cache

import yaml

from scanner_sim.config.built import drawn_departures
from scanner_sim.config.document import core_schema
from scanner_sim.config.scenario import Scenario

HEADING = "# Scanner Sim scenario, schema 1, resolved: every value is written out.\n"


@core_schema
class _Dumper(yaml.SafeDumper):
    """Quotes texts by the rules by which they are read again."""

    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002 (the name is PyYAML's)
        """Write equal values out: anchors make a file hard to read."""
        return True


def _list(dumper: yaml.SafeDumper, items: list[object]) -> yaml.Node:
    short = all(isinstance(item, bool | int | float | str) for item in items)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", items, flow_style=short)


_Dumper.add_representer(list, _list)


def resolved_yaml(scenario: Scenario) -> str:
    """Return a scenario as YAML with every default written out and a unit on every dimensional number.

    Reading it gives an equal scenario, to the last bit of every number. Paths are absolute, so the text means
    the same in any folder.
    """
    data = scenario.model_dump(mode="json", by_alias=True)
    return (
        HEADING
        + _drawn(scenario)
        + "".join(_section(json.dumps({key: value})) for key, value in data.items())
    )


def _drawn(scenario: Scenario) -> str:
    """Return what was drawn of the instrument as built, as a comment: a truth, which a program reads past."""
    found = drawn_departures(scenario)
    lines = (f"#   {name}: {value}\n" for name, value in found.items())
    return "# Truth: the instrument as built, drawn from its tolerances:\n" + "".join(lines) if found else ""


@lru_cache(maxsize=64)
def _section(data: str) -> str:
    """Return a section as YAML, from JSON: the scenarios of a campaign have most of them in common."""
    found: str = yaml.dump(
        json.loads(data),
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        width=10**6,
        default_flow_style=False,
    )
    return found
