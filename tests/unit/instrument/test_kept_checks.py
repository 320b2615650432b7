"""Signals are kept part by part, and those that cannot be of their scenario are refused and say what is wrong."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument import signal_records
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


def test_signals_are_recorded_part_by_part(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: each part holds the next voxels, as many as go together and the rest at last, with their places, light and
    signals; after each it is told how many are done of how many."""
    monkeypatch.setattr(signal_records, "voxels_together", lambda samples: samples // 3)
    monkeypatch.setattr(signal_records, "about_of", lambda *_: "about")
    monkeypatch.setattr(signal_records, "raster_aim", lambda raster, shots, dwell: (raster, shots, dwell))
    monkeypatch.setattr(signal_records, "_where", lambda _, aim: {"where": aim})
    monkeypatch.setattr(signal_records, "drawn", lambda *given: {"drawn": given[2:]})
    labels = SimpleNamespace(names=())
    instrument: Any = SimpleNamespace(
        scenario=SimpleNamespace(raster="raster", scanner=SimpleNamespace(dwell=5e-5)),
        loaded=SimpleNamespace(object_labels=labels, material_labels=labels),
        fire=lambda aim: (("fired", aim), None),
    )
    recorder: Any = SimpleNamespace(
        samples=12,
        light=lambda shots: {"light": shots},
        kind=lambda columns, about: (columns, about),
    )
    shots = np.arange(100, 110, dtype=np.uint32)
    told: list[tuple[int, int]] = []
    parts: Any = list(signal_records.recorded(instrument, recorder, shots, lambda *done: told.append(done)))
    assert told == [(4, 10), (8, 10), (10, 10)]
    assert [len(columns["where"][1]) for columns, _ in parts] == [4, 4, 2]
    np.testing.assert_array_equal(np.concatenate([columns["where"][1] for columns, _ in parts]), shots)
    for columns, about in parts:
        aim = columns["where"]
        assert (about, aim[0], aim[2]) == ("about", "raster", 5e-5)
        light = {"light": ("fired", aim)}
        assert columns["light"] == light["light"]
        assert columns["drawn"] == (aim, light)
