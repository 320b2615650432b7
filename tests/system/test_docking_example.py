"""The example of a docking begins as it says: it finds its targets at 25 m and its filter follows them."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.mark.slow
@pytest.mark.usefixtures("device")
def test_the_first_seconds_of_the_example(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: with the Sun behind the scanner the search at 25 m succeeds, the filter begins, and closes the loop.

    Expected: it is within six σ along each axis, and visits keep to one of each target for a command, but for the time
    of one command after the filter's begin: rounds follow at once there, eight or so of 45 ms, so that the next
    patterns lie on their targets, within half a radius of the beam in the median (two where a command is waited for).
    """
    monkeypatch.syspath_prepend(str(DOCS))
    docking = importlib.import_module("docking")
    monkeypatch.setattr(docking, "END", 23.6)
    approach = docking.Approach(1, "low Sun")
    approach.fly()
    log, records = approach.log, approach.records
    assert approach.target.range < 23.6
    assert 16 < len(records) < 120
    away = np.abs(log.estimate[-1] - log.truth[-1])
    assert (away < 6.0 * log.sigma[-1]).all()
    known = np.isfinite(log.nees)
    assert known[-1]
    steady = [record.time for record, begun in zip(records, known, strict=True) if begun][4:]
    assert np.ptp(steady[-8::4]) == pytest.approx(docking.COMMANDS, abs=0.02)
    first = [
        record
        for record, begun in zip(records, known, strict=True)
        if begun and record.time < log.time[int(np.argmax(known))] + 0.8 * docking.COMMANDS
    ]
    assert len(first) > 20
    assert np.median([np.hypot(*record.errors.offset) for record in first]) < 0.5
    there, never = log.nees_at((23.8, 10.0))
    nearer = np.array(log.truth)[:, 2] - docking.RING < 23.8
    assert there == log.nees[int(np.argmax(nearer))]
    assert np.isnan(never)
    assert approach.tracker.track(records).scenario_yaml.count("quaternion") > 5
