"""Lists that are too short or too long: what is said of them, and that entries with faults are counted all the same."""

from __future__ import annotations

from typing import Any

import pytest

from scanner_sim import load_scenario
from scanner_sim.foundation.errors import ScenarioError


def point(**changes: Any) -> dict[str, Any]:
    return {"time": "1 s", "position": ["0 m", "0 m", "5 m"]} | changes


def faults_of(*points: dict[str, Any]) -> list[tuple[str, str]]:
    """Return place and problem of each fault of a scenario whose target goes through points."""
    motion = {"type": "waypoints", "points": list(points)}
    item = {"name": "node", "shape": "sphere", "diameter": "1 m", "position": ["0 m", "0 m", "5 m"],
            "material": "grey_reference", "motion": motion}  # fmt: skip
    scan = {
        "type": "raster",
        "rows": 4,
        "columns": 4,
        "horizontal": ["-1 deg", "1 deg"],
        "vertical": ["-1 deg", "1 deg"],
    }
    with pytest.raises(ScenarioError) as error:
        load_scenario({"schema": 1, "scene": {"objects": [item]}, "scan": scan})
    places = [one.location.rpartition("motion.")[2].partition(" ")[0] for one in error.value.faults]
    return [(place, one.problem) for place, one in zip(places, error.value.faults, strict=True)]


def test_a_list_says_how_many_entries_it_has() -> None:
    """Claim: of two waypoints that are wanted one, or none, are too few, which is the one fault."""
    assert faults_of(point()) == [("points", "this list has 1 entry.")]
    assert faults_of() == [("points", "this list has 0 entries.")]


def test_entries_with_faults_count_in_the_length() -> None:
    """Claim: two waypoints are enough if either has a fault: its fault alone is told."""
    for wrong in (0, 1):
        points = [point(time="1 s"), point(time="2 s")]
        points[wrong] = point(place=3)
        ((place, _),) = faults_of(*points)
        assert place.startswith(f"points[{wrong}]")
