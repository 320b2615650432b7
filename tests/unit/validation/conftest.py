"""What tests of reproduced figures share."""

from __future__ import annotations

from pathlib import Path

import pytest
from made_benches import quick_task

from scanner_sim.validation.reproduce.item import Task


@pytest.fixture
def task(repo_root: Path) -> Task:
    """A small task of figures."""
    return quick_task(repo_root)
