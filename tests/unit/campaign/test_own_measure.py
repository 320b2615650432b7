"""A measure of the user's own: named as its function, of what the run gave, and not one of the program's."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from scanner_sim.campaign.own_measure import OwnMeasure
from scanner_sim.foundation.errors import InputError


def measure(name: str, function: Any) -> OwnMeasure:
    own: Any = SimpleNamespace(short=name, load=lambda: function)
    return OwnMeasure(own)


def test_a_function_has_the_scan_or_else_the_track() -> None:
    """Claim: the column has the function's name; a tracking run gives its track, another its scan; as a float."""
    own = measure("corner", math.floor)
    assert own.column == "corner"
    for scan, track, found in ((2.5, None, 2.0), (None, 3.5, 3.0), (2.5, 3.5, 3.0)):
        value = own.value(SimpleNamespace(scan=scan, track=track))  # type: ignore[arg-type]
        assert value == found
        assert isinstance(value, float)


def test_names_of_the_program_are_taken() -> None:
    """Claim: a function with the name of a measure of the program is refused before it is loaded."""
    with pytest.raises(InputError, match="'sigma_range' is a measure of the program"):
        measure("sigma_range", math.floor).load()
