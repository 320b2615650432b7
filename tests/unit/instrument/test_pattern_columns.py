"""Columns of patterns: what is at hand, what is made when asked for, and parts joined."""

from __future__ import annotations

import numpy as np
import pytest

from scanner_sim.instrument.closed_loop.pattern_columns import PatternColumns
from scanner_sim.instrument.samples import Samples


def part(first: float, made: list[float]) -> PatternColumns:
    at_hand = {"range_m": first + np.arange(3.0)}

    def make() -> Samples:
        made.append(first)
        return Samples({**at_hand, "P.X": 10.0 * at_hand["range_m"]}, {"object": np.full(3, int(first))}, {})

    return PatternColumns(at_hand, make)


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
