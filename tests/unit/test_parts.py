"""What every part of a scenario refuses, whatever its own limits are."""

from __future__ import annotations

import math

import pytest
from pydantic import ValidationError

from scanner_sim.parts import Count, Number, Part, Switch


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
