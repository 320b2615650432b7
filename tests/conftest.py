"""What every test may ask for."""

from __future__ import annotations

from pathlib import Path

import hypothesis
import pytest

from scanner_sim.render.device import Device, activate

# Derandomised: a red test is red again on the next run. No deadline: the first call compiles a kernel.
hypothesis.settings.register_profile("deterministic", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("deterministic")


SCENARIO = """\
schema: 1
seed: 3
scene:
  objects:
    - {name: wall, shape: rectangle, size: [8 m, 8 m], position: [0 m, 0 m, 9 m], material: grey_reference}
scan: {type: raster, rows: 6, columns: 8, horizontal: [-2 deg, 2 deg], vertical: [-2 deg, 2 deg]}
output: {pictures: false}
"""


@pytest.fixture(scope="session")
def small_scenario() -> str:
    """A scenario of 48 voxels as text."""
    return SCENARIO


@pytest.fixture(scope="session")
def device() -> Device:
    """The processor, activated: ask for it in every test that needs Mitsuba."""
    return activate("cpu")


@pytest.fixture(scope="session")
def repo_root() -> Path:
    """The folder that holds ``configs``, ``scenes`` and ``tests``."""
    return Path(__file__).resolve().parents[1]
