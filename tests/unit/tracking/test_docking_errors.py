"""The benchmark of dockings' errors: what it prints of runs, and of ranges that no run tells anything of."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_track import make_track

BENCHMARKS = Path(__file__).resolve().parents[3] / "benchmarks"


@pytest.fixture
def errors(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The benchmark's module, which finds the example beside the guides by itself."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("docking_errors")


def test_ranges_without_a_run_of_more_than_eight_visits_are_reported(
    errors: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """Claim: a bin of range tells of the runs with more than eight visits in it, and of none where there is none.

    Set-up: made tracks at 8 m, of 40 visits and of eight. Expected: of the first the three z² of its visits, of
    the second, and in all other bins, nothing.
    """
    long, short = (
        [record for record in make_track(seconds, objects=1).records if errors.tracked(record)]
        for seconds in (0.4, 0.1)
    )
    assert len(long) > 30
    assert len(short) == 8
    lines = {}
    for name, runs in (("long", [long, short]), ("short", [short])):
        errors.report(runs)
        lines[name] = [line for line in capsys.readouterr().out.splitlines() if "z²" in line]
        assert len(lines[name]) == 7
    assert sum(line.endswith("z² [], outward []") for line in lines["long"]) == 6
    assert all(line.endswith("z² [], outward []") for line in lines["short"])
    z = np.array([(one.position - one.truth) / np.sqrt(np.diag(one.covariance)) for one in long])
    (said,) = (line for line in lines["long"] if not line.endswith("z² [], outward []"))
    assert "8.9 to" in said
    assert all(f"'{value:.2f} ± 0.00'" in said for value in (z**2).mean(axis=0))


def test_means_are_of_the_runs_that_know(errors: Any) -> None:
    """Claim: mean and standard error of each number are those of the runs that have it."""
    values = [np.array([1.0, np.nan, np.nan]), np.array([3.0, 2.0, np.nan])]
    assert errors.said(values) == ["2.00 ± 0.71", "2.00 ± 0.00", "none"]
    assert errors.said([]) == []
