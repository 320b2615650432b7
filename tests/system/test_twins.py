"""YAML and Python are two spellings of the same thing: each shipped scenario, made as a program, equals its file."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from scanner_sim import load_scenario

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
SCENARIOS = sorted(CONFIGS.glob("*.yaml"))


@pytest.fixture
def twins(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The program that spells scenarios in Python."""
    monkeypatch.syspath_prepend(str(CONFIGS.parent / "docs"))
    return importlib.import_module("twins")


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_both_spellings_are_the_same_scenario(path: Path, twins: ModuleType) -> None:
    """Claim: the program's scenario equals the file's, number for number, wherever it is started."""
    made: dict[str, Any] = {"__file__": str(twins.TWINS / f"{path.stem}.py"), "__name__": path.stem}
    exec(twins.twin(path), made)
    assert made["scenario"] == load_scenario(path)


def test_the_two_that_are_shipped_are_those_that_are_made(twins: ModuleType) -> None:
    assert {path.stem for path in twins.TWINS.glob("*.py")} == set(twins.SHIPPED)
    for name in twins.SHIPPED:
        made = twins.twin(CONFIGS / f"{name}.yaml")
        assert (twins.TWINS / f"{name}.py").read_text(encoding="utf-8") == made, "run: python docs/twins.py"
