"""Kept signals that cannot be of their scenario are refused, and say what is wrong with them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.reprocess import KeptSignals

COLUMNS, PIXELS = 7, 4
SHOTS = np.array([12, 13, 14, 20, 21], dtype=np.uint32)


def part(**changes: Any) -> dict[str, Any]:
    """Columns of five voxels, before a scene of two objects and three materials."""
    shots = SHOTS.astype(np.int64)
    return {
        "row": (shots // COLUMNS).astype(np.uint16),
        "column": (shots % COLUMNS).astype(np.uint16),
        "laser_w": np.full((5, PIXELS), 1e-9),
        "truth.object": np.array([0, 1, 2, 2, 1]),
        "truth.material": np.array([0, 3, 1, 2, 3]),
        "truth.range_m": np.array([np.nan, 3.0, 4.0, 4.0, 5.0]),
        "theta_rad": np.linspace(-0.1, 0.1, 5),
        **changes,
    }


def check(given: Any, *, lit: bool = False, name: str = "triangulation") -> None:
    about = SimpleNamespace(objects=("wall", "ball"), materials=("grey", "white", "black"))
    scenario: Any = SimpleNamespace(
        raster=SimpleNamespace(columns=COLUMNS),
        lighting=SimpleNamespace(sky=lambda: SimpleNamespace(dark=not lit)),
        scanner=SimpleNamespace(position_sensor=SimpleNamespace(pixels=PIXELS)),
    )
    kept = KeptSignals(Path("out"), scenario, {name: about})  # type: ignore[dict-item]
    recorder: Any = SimpleNamespace(kept=("laser_w", "theta_rad", "truth.range_m", "background_w"))
    kept._check(name, given, SHOTS, scenario, recorder)


def test_what_belongs_together_is_taken() -> None:
    """Claim: in the dark and under the Sun; a truth that is not known is no damage, and numbers of things count from 0,
    for none, to the last name."""
    check(part())
    check(part(background_w=np.full((5, PIXELS), 2e-9)), lit=True)
    check({**part(), "laser_w": np.full((5, 9), 1e-9)}, name="tof")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"row": part()["row"] + 1}, "has other voxels"),
        ({"column": part()["column"][::-1]}, "has other voxels"),
        ({"laser_w": np.full((5, PIXELS + 1), 1e-9)}, f"lines have {PIXELS + 1} pixels"),
        ({"background_w": np.full((5, PIXELS), 2e-9)}, "or the background is missing"),
        ({"laser_w": np.full((5, PIXELS), np.nan)}, "laser_w holds something else"),
        ({"theta_rad": np.array([0.0, 0.1, -1e30, 0.0, 0.0])}, "theta_rad holds something else"),
        ({"truth.object": np.array([0, 1, 3, 2, 1])}, "truth.object has numbers without"),
        ({"truth.object": np.array([0, -1, 2, 2, 1])}, "truth.object has numbers without"),
        ({"truth.material": np.array([0, 3, 4, 2, 3])}, "truth.material has numbers without"),
    ],
)
def test_what_does_not_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        check(part(**changes))


def test_a_part_that_is_missing_is_refused() -> None:
    with pytest.raises(InputError, match="has other voxels"):
        check({})
    with pytest.raises(InputError, match="or the background is missing"):
        check(part(), lit=True)
