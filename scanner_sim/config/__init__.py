"""Scenarios as text: read with every fault at its line, written back complete, described for editors."""

from __future__ import annotations

from scanner_sim.config.load import load_scanner, load_scenario, scenario_from_text
from scanner_sim.config.resolved import resolved_yaml
from scanner_sim.config.schema import json_schema
from scanner_sim.config.warnings import scenario_warnings

__all__ = [
    "json_schema",
    "load_scanner",
    "load_scenario",
    "resolved_yaml",
    "scenario_from_text",
    "scenario_warnings",
]
