"""Mutants of scenarios, meshes, XML scenes, saved tracking runs and results end with a result or with one message, and
what was found once stays mended. `make fuzz` opens as many as there is time for."""

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


def test_what_was_once_found_is_refused_or_gives_a_result() -> None:
    fuzz("--corpus")


@pytest.mark.slow
def test_what_the_mutants_are_made_from_opens() -> None:
    fuzz("--originals")


# Every one must pass: the number says how much is looked at, not how often it may fail.
@pytest.mark.slow
def test_mutants_of_scenarios() -> None:
    fuzz("-n", "120", "--seed", "1", "--every", "4", "--workers", "1")


@pytest.mark.slow
def test_mutants_of_saved_runs() -> None:
    fuzz("--states", "60", "--seed", "1", "--workers", "1")


@pytest.mark.slow
def test_mutants_of_meshes_and_xml_scenes() -> None:
    fuzz("--scenes", "120", "--seed", "1", "--workers", "1")


@pytest.mark.slow
def test_mutants_of_results() -> None:
    fuzz("--results", "120", "--seed", "1", "--workers", "1")
