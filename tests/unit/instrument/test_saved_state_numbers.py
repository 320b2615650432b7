"""What a saved tracking run may hold: each number against the others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim import load_scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.closed_loop.saved_state import first_state, load_state, save_state
from scanner_sim.instrument.closed_loop.state_file import FASTEST, VAGUEST, SavedState
from scanner_sim.tracking.measurement import TargetAppearance
from scanner_sim.tracking.prediction import predict
from scanner_sim.tracking.record import TrackTarget
from scanner_sim.tracking.response import TargetKind
from scanner_sim.tracking.state import TrackerSettings, TrackMode, pointed


def complaints(**changed: Any) -> list[str]:
    """Return the keys that two tracks, at 1 s, are refused for."""
    told: dict[str, Any] = {"tracks": (None, None), "followed": (True, True), "amplitudes": (None, None)}
    told |= {"turn": 1, "skipped": 1, "clock": 1.0, "mirrors": SimpleNamespace(time=1.0)}
    return [fault.location for fault in SavedState.model_construct(**(told | changed)).cross_checks()]


@pytest.mark.parametrize(("changed", "key"), [
    ({"turn": 2}, "turn"),
    ({"skipped": 2}, "skipped"),
    ({"followed": (True,)}, "followed"),
    ({"amplitudes": (None,) * 3}, "amplitudes"),
    ({"mirrors": SimpleNamespace(time=1.001)}, "mirrors.time"),
])  # fmt: skip
def test_one_step_too_far_is_refused_and_the_last_possible_is_not(changed: dict[str, Any], key: str) -> None:
    """Claim: of two targets number 1 is the last whose turn it may be, or that may wait; mirrors are never ahead."""
    assert complaints() == []
    assert complaints(**changed) == [key]


@pytest.mark.parametrize(("rate", "doubt", "wait"), [(-0.1, 1e-4, 3000.0), (FASTEST, VAGUEST, 1e9)])
def test_a_target_that_nobody_saw_for_long_is_saved(
    rate: float, doubt: float, wait: float, tmp_path: Path
) -> None:
    """Claim: wherever the prediction of a target leads until it is given up, behind the scanner and round it too, and
    as uncertain as it then is, a state that was saved is read back."""
    settings = TrackerSettings(acceleration_psd=1e6, range_acceleration_psd=1e6)
    target = TrackTarget(
        "a",
        "a",
        TargetAppearance(kind=TargetKind.BLACK, diameter=0.1),
        np.array([0.0, 0.0, 8.0]),
        np.zeros(3),
    )
    told = pointed([0.0, 0.0, 8.0], settings, 0.0, [rate] * 3, doubt * np.eye(6))
    unrest = np.full(3, settings.acceleration_psd)
    gone = replace(told, mode=TrackMode.SEARCH, motion=predict(told.motion, wait, unrest))
    state = replace(first_state((target,), settings), clock=wait, tracks=(gone,))
    save_state(tmp_path / "state.json", state, "scenario", "test")
    (back,) = load_state(tmp_path / "state.json")[0].tracks
    for one, other in zip(back.motion, gone.motion, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("place", "possible"),
    [
        ((9.99, -9.99, 8.0), True),
        ((10.01, 0.0, 8.0), False),
        ((0.0, -10.01, 8.0), False),
        ((0.0, 0.0, 0.999e6), True),
        ((0.0, 0.0, 1.001e6), False),
        ((0.0, 0.0, 1.001e-6), True),
        ((0.0, 0.0, 0.999e-6), False),
    ],
)
def test_a_scenario_is_loaded_if_its_state_is_read_back(
    place: tuple[float, float, float], possible: bool, tmp_path: Path
) -> None:
    """Claim: where a target may be expected a state may have it: to ±10 rad, from 1 µm to 1000 km, and no further."""
    node = {"name": "node", "array": {"diameter": 0.1, "plate": 0.15}, "position": (0.0, 0.0, 8.0)}
    asked = {"target": "node", "expected": place}
    given = {"schema": 1, "scene": {"objects": [node]}, "scan": {"type": "track", "targets": [asked]}}
    appearance = TargetAppearance(kind=TargetKind.BLACK, diameter=0.1)
    target = TrackTarget("node", "node", appearance, np.array(place), np.zeros(3))
    save_state(tmp_path / "state.json", first_state((target,), TrackerSettings()), "scenario", "test")
    if possible:
        assert load_scenario(given).targets[0].expected.tolist() == list(place)
        assert load_state(tmp_path / "state.json")[0].tracks[0].expected.tolist() == list(place)
        return
    with pytest.raises(InputError, match="which is no place"):
        load_scenario(given)
    with pytest.raises(InputError, match="expected"):
        load_state(tmp_path / "state.json")
