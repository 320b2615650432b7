"""What every test may ask for, and other seeds for all of them."""

from __future__ import annotations

import faulthandler
import gc
import os
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import hypothesis
import numpy as np
import pytest
import typer.testing

from scanner_sim.render.device import Device, activate

# What is compiled once is there for the next process, of which tests start hundreds.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# For the processes that run tests and those that tests start: more threads of linear algebra would wait for a core.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Beside its relative tolerance pytest grants 1e-12, which is all of a variance in rad² or of a charge in coulombs. What
# may differ from zero by rounding says by how much.
type(pytest.approx(0.0)).DEFAULT_ABSOLUTE_TOLERANCE = 0.0

# Typer's runner puts all verbs together anew for every command, which takes longer than many of them.
typer.testing._get_command = cache(typer.testing._get_command)  # type: ignore[attr-defined]

WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
"""Processes that run tests at once."""

SHIFT = int(os.environ.get("SCANNER_SIM_SEED_SHIFT", "0"))
"""Added to every seed, of the tests and of the simulator: what ``tests/seeds.py`` varies."""

# Derandomised: a red test is red again on the next run; with shifted seeds examples are drawn from the shift, which
# ``tests/seeds.py`` tells Hypothesis. No deadline: the first call compiles a kernel.
hypothesis.settings.register_profile("repeated", derandomize=SHIFT == 0, deadline=None, database=None)
hypothesis.settings.load_profile("repeated")


SCENARIO = """\
schema: 1
seed: 3
scene:
  objects:
    - {name: wall, shape: rectangle, size: [8 m, 8 m], position: [0 m, 0 m, 9 m], material: grey_reference}
scan: {type: raster, rows: 6, columns: 8, horizontal: [-2 deg, 2 deg], vertical: [-2 deg, 2 deg]}
output: {pictures: false}
"""


DEATHS = "SCANNER_SIM_TEST_DEATHS"
"""Variable that names the folder in which each process of several writes where it died."""


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    """Let processes that run tests write where they die into files: beside all their output it would be lost.

    Last, because pytest has it written to the standard error output.
    """
    if not hasattr(config, "workerinput"):
        folder = tempfile.TemporaryDirectory()
        config.add_cleanup(folder.cleanup)
        os.environ[DEATHS] = folder.name
        return
    file = (Path(os.environ[DEATHS]) / config.workerinput["workerid"]).open("w", encoding="utf-8")
    config.add_cleanup(file.close)
    faulthandler.enable(file)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say where processes died, without the list of all loaded libraries and what runs every test."""
    for path in sorted(Path(os.environ[DEATHS]).iterdir()):
        told = path.read_text(encoding="utf-8").partition("\nExtension modules")[0].splitlines()
        if told:
            terminalreporter.section(f"where {path.name} died")
            for line in told:
                if not any(f"/{library}/" in line for library in ("_pytest", "pluggy", "xdist", "execnet")):
                    terminalreporter.write_line(line)


def pytest_collection_finish() -> None:
    """Leave modules and collected tests out of the search for garbage, and search less often."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


@pytest.fixture(scope="session")
def small_scenario() -> str:
    """A scenario of 48 voxels as text."""
    return SCENARIO


@pytest.fixture(scope="session")
def device() -> Device:
    """The processor, activated: ask for it in every test that needs Mitsuba.

    Each process of several takes its share of the cores: threads beyond them spin while they wait for each other.
    """
    return activate("cpu", None if WORKERS == 1 else max(1, (os.cpu_count() or 1) // WORKERS))


@pytest.fixture(scope="session")
def repo_root() -> Path:
    """The folder that holds ``configs``, ``scenes`` and ``tests``."""
    return Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session", autouse=SHIFT != 0)
def shifted_seeds(device: Device) -> None:
    """Draw other random numbers everywhere: the three generators take another key for the same seed."""
    import drjit.auto.ad as auto

    host, bits, on_device = np.random.default_rng, np.random.Philox, auto.Philox4x32

    def other_host(seed: Any = None) -> np.random.Generator:
        # Libraries pass on generators that they were given, whose seeds are shifted already.
        if seed is None or isinstance(
            seed, np.random.SeedSequence | np.random.Generator | np.random.BitGenerator
        ):
            return host(seed)
        return host([SHIFT, *np.atleast_1d(seed).tolist()])

    np.random.default_rng = other_host  # type: ignore[assignment]
    np.random.Philox = lambda key, counter: bits(key=key + (SHIFT << 96), counter=counter)  # type: ignore[misc,assignment]
    auto.Philox4x32 = lambda seed, *address: on_device(auto.UInt64(seed) + (SHIFT << 40), *address)
