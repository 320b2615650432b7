"""Mutants of scenarios, plans, meshes, XML scenes, saved tracking runs and results end with a result or one message,
and what was found once stays mended. `make fuzz` opens as many as there is time for."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

FUZZ = Path(__file__).with_name("fuzz.py")


def fuzz(*arguments: str) -> None:
    done = subprocess.run(
        [sys.executable, str(FUZZ), *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


# Every one must pass: the numbers say how much is looked at, not how often it may fail. All in one run, as the saved
# run and the results from which mutants are made are the same for all.
@pytest.mark.slow
def test_what_was_once_found_and_mutants_and_what_they_are_made_from() -> None:
    numbers = ("-n", "40", "--states", "20", "--scenes", "30", "--results", "30", "--plans", "20")
    fuzz("--corpus", "--originals", *numbers, "--seed", "1", "--every", "8", "--workers", "1")
