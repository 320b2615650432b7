"""Numbers on the way to a comparison that no long run need be asked for."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim import load_scenario
from scanner_sim.validation.compare import test_bench as stand
from scanner_sim.validation.compare.closed_forms import ClosedForms

SCAN = {"rows": 2, "columns": 2, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}


def test_lines_of_the_stand_are_charges(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: 64 is no charge, and each number above it 500 electrons; shots lie where their groups say."""
    sensor = {"gain": 500.0, "bias": 64, "pixels": 8}
    scenario = load_scenario({"schema": 1, "scan": SCAN, "scanner": {"position_sensor": sensor}})
    numbers = np.stack([np.full(8, 64.0), np.arange(8.0) + 64.0])
    group = SimpleNamespace(index=np.array([1, 0]), signal=SimpleNamespace(lines=lambda: numbers))
    made = SimpleNamespace(expose=lambda aim: (None, [group]))
    monkeypatch.setattr(stand, "Instrument", lambda *_, **__: made)
    setting: Any = SimpleNamespace(device="cpu")
    aim: Any = SimpleNamespace(shot=np.arange(2))
    found = stand.lines(setting, scenario, aim)
    np.testing.assert_allclose(found, [500.0 * np.arange(8.0), np.zeros(8)])


@pytest.mark.parametrize(("filter_", "passed"), [("none", 0.6), ({"transmission": 0.7}, 0.42)])
def test_lens_and_filter_both_take_light(filter_: Any, passed: float) -> None:
    scanner = {"receiver": {"transmission": 0.6}, "filter": filter_}
    scenario = load_scenario({"schema": 1, "scan": SCAN, "scanner": scanner})
    assert ClosedForms(scenario).peak_transmission == pytest.approx(passed)
