"""What a saved tracking run may hold: each number against the others."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from scanner_sim.instrument.closed_loop.state_file import SavedState


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
