"""The lists of planted faults fit the sources."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def plant() -> ModuleType:
    """The program that plants the faults."""
    spec = importlib.util.spec_from_file_location("plant", Path(__file__).with_name("plant.py"))
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules["plant"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_fault_can_be_planted_and_names_tests_that_exist(plant: ModuleType, repo_root: Path) -> None:
    """Claim: each fault's text stands once in its file, nothing is listed twice, and its tests are there."""
    if not (repo_root / "scanner_sim").is_dir():
        pytest.skip("the faults are planted in the sources")
    faults = plant.faults()
    assert len(faults) == len({fault.name for fault in faults})
    for fault in faults:
        text = (repo_root / "scanner_sim" / fault.file).read_text(encoding="utf-8")
        assert text.count(fault.was) == 1, fault.name
        assert fault.was != fault.now, fault.name
        for name in fault.tests:
            assert (repo_root / "tests" / name).is_file(), name
