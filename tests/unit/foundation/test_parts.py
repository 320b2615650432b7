"""What every part of a scenario refuses, whatever its own limits are."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from pydantic import ValidationError

from scanner_sim.foundation.parts import Count, MeshFile, Number, Part, Switch


class Plain(Part):
    """A part without limits of its own."""

    number: Number = 0.0
    count: Count = 0
    switch: Switch = False


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan, "1"])
def test_numbers_are_finite_and_no_texts(value: float | str) -> None:
    with pytest.raises(ValidationError, match="number"):
        Plain(number=value)


@pytest.mark.parametrize("value", [5.0, "5", True])
def test_counts_are_whole(value: float | str) -> None:
    with pytest.raises(ValidationError, match="count"):
        Plain(count=value)


@pytest.mark.parametrize("value", [1, "yes", "off", 0.0])
def test_switches_are_true_or_false(value: float | str) -> None:
    with pytest.raises(ValidationError, match="switch"):
        Plain(switch=value)


def test_parts_cannot_be_changed_and_know_their_keys() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        Plain().number = 1.0
    with pytest.raises(ValidationError, match="nothing_of_it"):
        Plain(nothing_of_it=1)


def test_endings_are_read_in_any_case(tmp_path: Path) -> None:
    class Meshed(Part):
        file: MeshFile

    path = tmp_path / "PART.PLY"
    path.write_text("ply\n", encoding="utf-8")
    assert Meshed(file=path).file == path
    other = tmp_path / "part.txt"
    other.write_text("", encoding="utf-8")
    with pytest.raises(ValidationError, match=r"part\.txt is none of the kinds"):
        Meshed(file=other)


class Whole(Part):
    """A part with a part."""

    inner: Plain = Plain()
    other: Number = 1.0


def test_a_mapping_changes_a_part_within_and_leaves_the_rest() -> None:
    made = Whole(inner=Plain(number=3.0, count=2))
    assert made.changed(inner={"count": 5}, other=4.0) == Whole(inner=Plain(number=3.0, count=5), other=4.0)
    assert made.changed(inner=Plain()).inner == Plain()
    with pytest.raises(AttributeError, match="numbre"):
        made.changed(inner={"numbre": 1.0})
