"""Columns of patterns: what is at hand, what is made when asked for, and parts joined."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from scanner_sim.instrument.closed_loop.pattern_columns import PatternColumns
from scanner_sim.instrument.samples import Samples


def part(first: float, made: list[float]) -> PatternColumns:
    at_hand = {"range_m": first + np.arange(3.0)}

    def make() -> Samples:
        made.append(first)
        return Samples({**at_hand, "P.X": 10.0 * at_hand["range_m"]}, {"object": np.full(3, int(first))}, {})

    return PatternColumns(lambda: at_hand, make)


def test_other_columns_are_made_once_and_when_asked_for() -> None:
    """Claim: what is at hand makes nothing; the first other column makes all of them, once."""
    made: list[float] = []
    columns = part(1.0, made)
    assert columns["range_m"].tolist() == [1.0, 2.0, 3.0]
    assert made == []
    assert columns["P.X"].tolist() == [10.0, 20.0, 30.0]
    assert columns["truth.object"].tolist() == [1, 1, 1]
    assert set(columns) == {"range_m", "P.X", "truth.object"}
    assert len(columns) == 3
    assert made == [1.0]
    with pytest.raises(KeyError, match="no column 'Y'"):
        columns["Y"]


def test_parts_are_joined_by_their_first_shots() -> None:
    """Claim: so many shots of each part, one after the other, in every column; nothing is made before it is asked."""
    made: list[float] = []
    both = PatternColumns.joined([(part(1.0, made), 3), (part(7.0, made), 2)])
    assert both["range_m"].tolist() == [1.0, 2.0, 3.0, 7.0, 8.0]
    assert made == []
    assert both["P.X"].tolist() == [10.0, 20.0, 30.0, 70.0, 80.0]
    assert both["truth.object"].tolist() == [1, 1, 1, 7, 7]


def test_columns_are_fetched_once_and_when_asked_for() -> None:
    """Claim: kernels that were launched are waited for by who asks for a column, not before; joined ones too."""
    fetched: list[str] = []

    def columns(name: str) -> PatternColumns:
        def fetch() -> dict[str, Any]:
            fetched.append(name)
            return {"range_m": np.arange(3.0)}

        return PatternColumns(fetch, lambda: Samples({}, {}, {}))

    one, both = columns("one"), PatternColumns.joined([(columns("two"), 3), (columns("three"), 1)])
    assert fetched == []
    for _ in range(2):
        assert one["range_m"].tolist() == [0.0, 1.0, 2.0]
        assert both["range_m"].tolist() == [0.0, 1.0, 2.0, 0.0]
    assert fetched == ["one", "two", "three"]
