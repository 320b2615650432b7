"""Comparisons beside earlier ones, their verdicts, and what they are as JSON: by made-up numbers."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from scanner_sim.foundation.errors import InputError
from scanner_sim.products.comparison import Check, Comparison, Finding, comparison_from_json, comparison_json
from scanner_sim.validation.compare.baseline import against, read_baseline

CHECK = Check(
    "8 m",
    "range",
    "m",
    "mean",
    8.0,
    0.0,
    8.001,
    1e-3,
    20.0,
    7.999,
    8.003,
    1e-4,
    8.0,
    "",
    0.3,
    0.6,
    1e-3,
    2e-3,
    False,
)


def comparison(*checks: Check, **more: Any) -> Comparison:
    finding = Finding("eq1", "Range", "paper", "p = f d/R", "wall", "", checks)
    return Comparison(
        **({"seed": 1, "seeds": 1, "level": 0.01, "quick": False, "target": "wall"} | more),
        findings=(finding,),
        versions={"scanner-sim": "1"},
    )


def changed(before: Check, now: Check, **more: Any) -> list[str]:
    found = against(comparison(now, **more), comparison(before)).baseline
    assert found is not None
    return [change.what for change in found]


@pytest.mark.parametrize(
    ("name", "what"), [("predicted", "prediction"), ("simulated", "simulated"), ("error", "standard error")]
)
def test_the_same_run_has_the_same_bits(name: str, what: str) -> None:
    assert changed(CHECK, CHECK) == []
    value = getattr(CHECK, name)
    assert changed(CHECK, replace(CHECK, **{name: math.nextafter(value, 9.0)})) == [what]


@pytest.mark.parametrize("other", [{"seed": 2}, {"seeds": 2}, {"quick": True}])
def test_other_runs_agree_in_their_statistics(other: dict[str, Any]) -> None:
    """Claim: a difference of 1 of √2 standard errors is none, one of 10 is; predictions agree to a part in 1e9."""
    assert changed(CHECK, replace(CHECK, simulated=8.002), **other) == []
    assert changed(CHECK, replace(CHECK, simulated=8.015), **other) == ["simulated"]
    assert changed(CHECK, replace(CHECK, predicted=8.0 * (1.0 + 1e-10)), **other) == []
    assert changed(CHECK, replace(CHECK, predicted=8.0 * (1.0 + 1e-8)), **other) == ["prediction"]


def test_a_check_of_one_of_both_is_a_difference() -> None:
    other = replace(CHECK, case="9 m")
    found = against(comparison(CHECK, other), comparison(CHECK)).baseline
    assert [change.what for change in found or ()] == ["new check"]
    found = against(comparison(CHECK), comparison(CHECK, other)).baseline
    assert [change.what for change in found or ()] == ["check is gone"]


def test_one_broken_check_breaks_a_law_and_a_difference_fails() -> None:
    broken = replace(CHECK, case="9 m", broken=True)
    assert comparison(CHECK, broken).findings[0].verdict == "broken"
    assert comparison(CHECK).findings[0].verdict == "holds"
    assert comparison().findings[0].verdict == "does not apply"
    assert comparison(CHECK).passed
    assert not comparison(CHECK, broken).passed
    assert not against(comparison(replace(CHECK, error=2e-3)), comparison(CHECK)).passed
    assert against(comparison(CHECK), comparison(CHECK)).passed


@pytest.mark.parametrize("freedom", [20.0, math.inf])
def test_a_comparison_comes_back_from_json(freedom: float) -> None:
    made = comparison(replace(CHECK, freedom=freedom))
    assert comparison_from_json(comparison_json(made)) == made


def test_numbers_that_are_none_are_the_same_and_only_laws_of_both_are_compared() -> None:
    nothing = replace(CHECK, error=math.nan)
    assert changed(nothing, nothing) == []
    assert changed(nothing, CHECK) == ["standard error"]
    made = comparison(CHECK)
    other = replace(made, findings=(replace(made.findings[0], name="eq2"),))
    assert against(made, other).baseline == ()


def test_a_difference_is_told_with_its_law_and_both_numbers() -> None:
    (change,) = against(comparison(replace(CHECK, simulated=8.5)), comparison(CHECK)).baseline or ()
    assert (change.law, change.case, change.quantity, change.what) == ("eq1", "8 m", "range", "simulated")
    assert (change.before, change.now, change.adjusted_p) == (8.001, 8.5, 0.0)
    (change,) = against(comparison(replace(CHECK, simulated=8.5), seed=2), comparison(CHECK)).baseline or ()
    assert (change.before, change.now) == (8.001, 8.5)
    assert 0.0 < change.adjusted_p < 1e-9


@pytest.mark.parametrize("text", ["", "{}", "[]", "null", '{"findings": 3}'])
def test_a_file_that_is_no_comparison_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "compare.json"
    path.write_text(text)
    with pytest.raises(InputError, match="is no comparison") as fault:
        read_baseline(path)
    assert "compare.json" in fault.value.remedy
    path.write_text(comparison_json(comparison(CHECK)))
    assert read_baseline(path) == comparison(CHECK)
