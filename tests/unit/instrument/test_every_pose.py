"""All poses of a run: of a camera its own, the scanner's, both together, and between its arrays."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from scanner_sim.instrument.closed_loop import every_pose as module


@pytest.mark.parametrize("camera", [True, False])
def test_poses_stand_in_their_order(camera: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: without a camera the scanner's alone; with one its poses of three arrays, over the run's duration, the
    scanner's, those of both, and each later array seen from each earlier one."""
    methods = ("camera", "joint") if camera else ("joint",)
    scenario = SimpleNamespace(pose=SimpleNamespace(methods=methods), following=SimpleNamespace(duration=7.0))
    track: Any = SimpleNamespace(scenario_yaml="text")
    asked: list[Any] = []

    def read(text: str, *, name: str, stored: bool) -> Any:
        assert (text, stored) == ("text", True)
        assert name
        return scenario

    def frames(*given: Any, **named: Any) -> tuple[str, ...]:
        asked.append((given, named))
        return ("a", "b", "c")

    monkeypatch.setattr(module, "scenario_from_text", read)
    monkeypatch.setattr(module, "camera_series", frames)
    monkeypatch.setattr(module, "poses_of", lambda one: ("s", "t") if one is track else ())
    monkeypatch.setattr(module, "relative_series", lambda one, other: f"{other} from {one}")
    monkeypatch.setattr(module, "combined_series", lambda found: [f"both of {' '.join(found)}"])
    options: Any = {"device": "cpu", "progress": print, "keep": repr}
    found = module.every_pose(track, **options)
    if not camera:
        assert (found, asked) == (("s", "t"), [])
        return
    assert asked == [((scenario, 7.0), options)]
    between = ("b from a", "c from a", "c from b")
    assert found == ("a", "b", "c", "s", "t", "both of a b c s t", *between)
