"""Plates of targets that a search runs out of."""

from __future__ import annotations

import math
import re
from typing import Any

import pytest

from scanner_sim import load_scenario
from scanner_sim.config.warnings import scenario_warnings

DISC = 0.06
REACH = 1.6 * 0.5 * DISC
"""Of a search's first pattern along Θ and along φ [m]."""


def plates_needed(plate: float, **item: Any) -> int | None:
    """Return how large the plates of a disc of 60 mm at 9 m should be [mm], or None where nothing is said."""
    array = {"diameter": DISC, "rows": 1, "columns": 1, "plate": plate}
    found = load_scenario(
        {
            "schema": 1,
            "scene": {"objects": [{"name": "near", "array": array, "position": (0.0, 0.0, 9.0)} | item]},
            "scan": {"type": "track", "targets": ["near"]},
        }
    )
    said = [words for words in scenario_warnings(found) if ".array.plate" in words]
    assert len(said) < 2
    return int(re.findall(r"to (\d+) mm", said[0])[0]) if said else None


def test_plates_hold_the_patterns_of_a_search_as_they_hang() -> None:
    """Claim: plates are enough that hold a square of 1.6 radii and the beam, turned as the array is.

    Corners of that square lie at 1.6 r on both axes; in the frame of a plate that is turned by α, at 1.6 r (cos α + sin
    α); in one that leans by β about an axis in its plane, at 1.6 r/cos β. The beam of 9 m has a radius below 10 mm.
    """
    beam = 0.5 * plates_needed(0.0625) * 1e-3 - REACH
    assert 1e-3 < beam < 10e-3
    for turn, reach in (
        (
            {"rotation": {"axis": "z", "angle": "20 deg"}},
            math.cos(math.radians(20)) + math.sin(math.radians(20)),
        ),
        (
            {"rotation": {"axis": "z", "angle": "-35 deg"}},
            math.cos(math.radians(35)) + math.sin(math.radians(35)),
        ),
        ({"rotation": {"axis": "y", "angle": "60 deg"}}, 2.0),
        ({"rotation": {"axis": "x", "angle": "-60 deg"}}, 2.0),
    ):
        wanted = 2e3 * (REACH * reach + beam)
        assert plates_needed(0.0625, **turn) == pytest.approx(wanted, abs=2.0)
        assert plates_needed(1e-3 * (wanted + 2.0), **turn) is None


def test_plates_of_what_moves_hold_them_however_they_turn() -> None:
    """Claim: what moves may come to hang at any roll: its plates hold a circle through the square's corners."""
    still, moving = plates_needed(0.0625), plates_needed(0.0625, motion={"type": "twist"})
    assert moving - still == pytest.approx(2e3 * REACH * (math.sqrt(2.0) - 1.0), abs=1.0)
    assert plates_needed(0.15, motion={"type": "twist"}) is None
    assert plates_needed(0.12, motion={"type": "twist"}) is not None
    assert plates_needed(0.12) is None


def test_of_an_array_seen_edge_on_nothing_is_said() -> None:
    assert plates_needed(0.0625, rotation={"axis": "y", "angle": "90 deg"}) is None
