"""A measure of the user's own: named as its function, of what the run gave, and not one of the program's."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.campaign.own_measure import OwnMeasure
from scanner_sim.campaign.reading import read_campaign
from scanner_sim.campaign.store import Row, columns_of_runs, opened
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


@pytest.mark.parametrize(
    ("returned", "said"),
    [
        (np.ones(2), "returns a ndarray, not a number"),
        (1 + 2j, "returns a complex, not a number"),
        (None, "returns a NoneType, not a number"),
        ("far", "returns a str, not a number"),
        (10**400, "returns a int, not a number"),
        (RuntimeError("no way"), "fails: RuntimeError: no way"),
        (SystemExit(2), "fails: SystemExit: 2"),
    ],
)
def test_a_function_without_a_number_is_named(returned: Any, said: str) -> None:
    """Claim: what it raises and what is no number is told as a fault of the measure, and not of the program."""

    def mine(_: Any) -> Any:
        if isinstance(returned, BaseException):
            raise returned
        return returned

    outcome: Any = SimpleNamespace(scan=0.0, track=None)
    with pytest.raises(InputError, match=f"the measure 'mine' {said}"):
        measure("mine", mine).value(outcome)
    assert math.isnan(measure("mine", lambda _: math.nan).value(outcome))


def test_names_of_the_program_are_taken() -> None:
    """Claim: a function with the name of a measure of the program is refused before it is loaded."""
    with pytest.raises(InputError, match="'sigma_range' is a measure of the program"):
        measure("sigma_range", math.floor).load()


def test_names_of_the_other_columns_are_taken(tmp_path: Path, small_scenario: str) -> None:
    """Claim: every column beside the measures, the varied keys among them; it would take the place of that column."""
    (tmp_path / "small.yaml").write_text(small_scenario, encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(
        "schema: 1\nbase: small.yaml\nvary: [{keys: {ranging: [tof, both]}}]\n", encoding="utf-8"
    )
    campaign = read_campaign(tmp_path / "plan.yaml")
    with opened(tmp_path / "out", campaign, ("valid_share",)) as store:
        store.add(Row(0, 1, "", 0.5, {"valid_share": 1.0}))
        (table,) = store.rows()
    taken = columns_of_runs(campaign)
    assert (*taken, "valid_share") == tuple(table)
    for name in taken:
        with pytest.raises(InputError, match=f"'{name}' is a column of the campaign already"):
            measure(name, math.floor).check(taken)
    measure("nearest", math.floor).check(taken)
