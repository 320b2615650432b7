"""YAML and Python are two spellings of the same thing: every shipped scenario has a twin, and both are equal."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from scanner_sim import load_scenario

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
SCENARIOS = sorted(CONFIGS.glob("*.yaml"))


def test_each_has_a_twin_and_no_twin_is_left_over() -> None:
    twins = {path.stem for path in (CONFIGS / "python").glob("*.py")}
    assert twins == {path.stem for path in SCENARIOS}, "run: python docs/twins.py"


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_both_spellings_are_the_same_scenario(path: Path) -> None:
    """Claim: the program's scenario equals the file's, number for number, wherever it is started."""
    twin = runpy.run_path(str(CONFIGS / "python" / f"{path.stem}.py"))
    assert twin["scenario"] == load_scenario(path), "run: python docs/twins.py"
