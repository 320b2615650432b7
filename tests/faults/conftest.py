"""What the tests of faults share: a small scenario, and processes of their own."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

Python = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def small(tmp_path: Path, small_scenario: str) -> Path:
    """The file of a scenario of 48 voxels, in a folder of its own."""
    path = tmp_path / "scenarios" / "small.yaml"
    path.parent.mkdir()
    path.write_text(small_scenario, encoding="utf-8")
    return path


@pytest.fixture
def python() -> Python:
    """Runs code in a fresh interpreter; a hang is a failure."""

    def run(code: str, *arguments: object, timeout: float = 240.0) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-c", code, *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, encoding="utf-8", timeout=timeout)

    return run
