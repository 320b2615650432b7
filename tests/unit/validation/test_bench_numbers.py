"""Numbers on the way to a comparison, and in files of waveforms, that no long run need be asked for."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim import load_scenario
from scanner_sim.products.waveforms import _SHAPES, _waveforms
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


@pytest.mark.parametrize("name", ["row", "column", "echoes", "status"])
def test_counts_in_a_file_are_not_negative(name: str) -> None:
    """Claim: 0 is a row, a number of echoes and a status, −1 is none."""
    variables: dict[str, Any] = {
        key: np.zeros((2, 4) if key == "number" else 2, dtype=np.float64 if "f" in kinds else np.int32)
        for key, kinds in _SHAPES.items()
    }
    numbers = {"start_s": 0.0, "rate_hz": 1e9, "step_a": 1e-8}
    assert _waveforms(variables, numbers).row.tolist() == [0, 0]
    variables[name][1] = -1
    with pytest.raises(ValueError, match=f"variable {name} has numbers"):
        _waveforms(variables, numbers)
