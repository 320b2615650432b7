"""A scenario as a verb of the command line gets it: loaded, with warnings of what looks unintended."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from scanner_sim.cli.report import warn
from scanner_sim.config import load_scenario, scenario_warnings
from scanner_sim.config.scenario import Scenario


def load_and_warn(config: Path, overrides: Sequence[str], quiet: bool) -> Scenario:
    """Return the scenario of a file; warn of what looks unintended, unless ``quiet``.

    Raises
    ------
    ScenarioError
        With all faults of the file.
    """
    scenario = load_scenario(config, overrides)
    if not quiet:
        for sentence in scenario_warnings(scenario):
            warn(sentence)
    return scenario
