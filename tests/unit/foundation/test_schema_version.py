"""Which versions of a scenario are read, and from what."""

from __future__ import annotations

from typing import Any

import pytest

from scanner_sim import load_scenario
from scanner_sim.foundation.errors import InputError


@pytest.mark.parametrize("version", [True, 1.0, "1", 0, -1])
def test_only_the_whole_number_is_a_version(version: Any) -> None:
    with pytest.raises(InputError, match=r"no version that this program reads.*\n?.*Write 'schema: 1'"):
        load_scenario({"schema": version})


def test_a_newer_version_asks_for_a_newer_program() -> None:
    with pytest.raises(InputError, match="newer scanner-sim"):
        load_scenario({"schema": 2})


def test_overrides_leave_the_callers_own_scenario_alone() -> None:
    """Claim: lists, in tuples too, are copied before an override changes them."""
    scan = {
        "type": "raster",
        "rows": 4,
        "columns": 4,
        "horizontal": [-0.1, 0.1],
        "vertical": [-0.1, 0.1],
    }
    wall: dict[str, Any] = {
        "name": "wall",
        "shape": "rectangle",
        "size": [1.0, 1.0],
        "material": "grey_reference",
        "position": [0.0, 0.0, 8.0],
    }
    own = {"schema": 1, "scan": scan, "scene": {"objects": [wall]}}
    moved = load_scenario(own, ["scene.objects.wall.position.2=9 m"])
    assert moved.scene.objects[0].position[2] == 9.0
    assert wall["position"] == [0.0, 0.0, 8.0]
    in_tuples = {"schema": 1, "scan": scan, "scene": {"objects": ({**wall, "position": (0.0, 0.0, 8.0)},)}}
    moved = load_scenario(in_tuples, ["scene.objects.0.position.2=7 m"])
    assert moved.scene.objects[0].position[2] == 7.0
