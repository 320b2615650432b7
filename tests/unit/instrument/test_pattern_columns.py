"""Columns of patterns: what is at hand, what is made when asked for, and parts joined."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.instrument.closed_loop.frozen_instrument import FrozenInstrument
from scanner_sim.instrument.closed_loop.pattern_columns import PatternColumns
from scanner_sim.instrument.samples import Samples
from scanner_sim.scan.protocol import Aim


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


@pytest.mark.parametrize(("count", "launched"), [(2, [2]), (3, [4]), (5, [8]), (9, [8, 1]), (19, [8, 8, 4])])
def test_patterns_are_launched_by_powers_of_two(count: int, launched: list[int]) -> None:
    """Claim: of patterns of a thousand shots eight are launched together, and fewer as the next power of two, filled
    up by the last; each keeps its shots, its run and where things are, and none is read twice."""
    numbers = np.repeat(np.arange(count), 1000)
    aim = Aim(numbers.astype(np.uint32), *(value + 0.5 * numbers for value in (0.0, 0.1, 0.2, 0.3, 0.4)))
    run, about, seen = 100 + np.arange(count), [f"at {number}" for number in range(count)], []

    def measured(part: Aim, own: Any, places: Any) -> PatternColumns:
        row = np.asarray(own) - 100
        assert part.shot.tolist() == np.repeat(row, 1000).tolist()
        np.testing.assert_array_equal(part.travel_phi, 0.4 + 0.5 * part.shot)
        assert places == [f"at {number}" for number in row]
        seen.append(len(row))
        at_hand = {"range_m": part.phi}
        return PatternColumns(lambda: at_hand, lambda: Samples(at_hand, {}, {}))

    bench: Any = SimpleNamespace(fast=True, _measured=measured)
    found = FrozenInstrument.measure(bench, aim, run, about)  # type: ignore[arg-type]
    assert seen == launched
    np.testing.assert_array_equal(found["range_m"], aim.phi)
