"""An estimator of the peak is one row of a table and one function, and the judge has its twin."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from scanner_sim.analytic import estimators as judge
from scanner_sim.signals import processing
from scanner_sim.signals.line import estimators

FIT = "maximum_likelihood"
"""The one that needs more than the charges, and stands in functions of its own on both sides."""

ADDED = f"""\
import sys, types
from pathlib import Path

def loaded(name, file, mark, row):
    before, found, after = Path(file).read_text(encoding="utf-8").partition(mark)
    assert found
    module = sys.modules[name] = types.ModuleType(name)
    module.__file__ = file
    exec(compile(before + found + row + after, file, "exec"), module.__dict__)
    return module

loaded("scanner_sim.signals.processing", {processing.__file__!r}, '"parabola": 1,', '"brightest": 1,')
from scanner_sim.render.device import activate
activate("cpu")
name = "scanner_sim.signals.line.estimators"
function = '"brightest": lambda around: (0.0 * around(0)[0], {{0: auto.Float(0.0)}}),'
estimators = loaded(name, {estimators.__file__!r}, 'CLOSED_FORMS: dict[PeakMethod, Estimator] = {{', function)

from scanner_sim.config import json_schema, load_scenario

scenario = load_scenario(sys.argv[1], ["processing.peak=brightest"])
assert scenario.processing.peak == "brightest"
assert "brightest" in json_schema()["$defs"]["Processing"]["properties"]["peak"]["anyOf"][0]["enum"]
"""


def test_each_estimator_has_its_function() -> None:
    missing = set(processing.MARGIN) - {*estimators.CLOSED_FORMS, FIT}
    assert not missing, f"without a function in signals/line/estimators.py: {missing}"
    assert not set(estimators.CLOSED_FORMS) - set(processing.MARGIN), "without a row in MARGIN"


def test_each_estimator_has_its_twin_in_the_judge() -> None:
    """Claim: the judge has each estimator under its name; what one line gives is compared in ``statistical``."""
    missing = {
        name for name in processing.MARGIN if name not in judge.ESTIMATORS and not hasattr(judge, name)
    }
    assert not missing, f"without a twin in analytic/estimators.py: {missing}"


@pytest.mark.slow
def test_a_row_and_a_function_make_an_estimator(repo_root: Path) -> None:
    """Claim: scenarios and their schema know what stands in the table; no other list of names is kept."""
    config = f"{repo_root}/configs/plane.yaml"
    done = subprocess.run([sys.executable, "-c", ADDED, config], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
