"""The example of a docking begins as it says: it finds its targets at 25 m and its filter follows them."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.mark.slow
@pytest.mark.usefixtures("device")
def test_the_first_half_second_of_the_example(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: from 25 m the search succeeds, the filter begins, and closes the loop within 5 cm of the truth."""
    monkeypatch.syspath_prepend(str(DOCS))
    docking = importlib.import_module("docking")
    monkeypatch.setattr(docking, "END", 24.6)
    tracker, records, log = docking.approach(1, "eclipse")
    assert 30 < len(records) < 200
    assert np.linalg.norm(log.estimate[-1] - log.truth[-1]) < 0.05
    assert np.isfinite(log.nees[-1])
    assert log.truth[-1][2] < 24.7
    assert tracker.track(records).scenario_yaml.count("quaternion") > 30
