"""What is told of a comparison: cells of tables, what could have been found, captions, and whom laws do not judge."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import pytest

from scanner_sim.cli import comparing
from scanner_sim.products import comparison_page as page
from scanner_sim.products.comparison import (
    Change,
    Check,
    Comparison,
    Finding,
    comparison_from_json,
    comparison_json,
)

CHECK = Check(
    case="8 m", quantity="range", unit="mm", form="mean", predicted=8.00123456, accuracy=0.0, simulated=8.0098765,
    error=1e-3, freedom=20.0, low=7.999, high=8.003, effect=-1.234e-3, scale=8.0, relative_to="", p=0.3,
    adjusted_p=0.0678, detects_90=2e-3, detects_99=3e-3, broken=False,
)  # fmt: skip


def finding(name: str, *checks: Check, **more: Any) -> Finding:
    given = {
        "title": "t",
        "source": "s",
        "statement": "st",
        "scene": "wall",
        "reason": "",
        "exercises": "",
    } | more
    return Finding(name=name, checks=checks, **given)


def comparison(*findings: Finding, **more: Any) -> Comparison:
    given = {"seed": 1, "seeds": 1, "level": 0.02, "quick": False, "target": "wall", "versions": {}} | more
    return Comparison(findings=findings, **given)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (page.short(math.nan), "–"), (page.short(0.0123456), "0.01235"), (page.short(123456.0, 2), "1.2e+05"),
        (page.share(0.01234), "1.2 %"), (page.share(0.9949), "99 %"), (page.share(1.0), "100 %"),
        (page.share(12.346), "1235 %"), (page.percent(CHECK), "-0.12 %"),
        (page.percent(replace(CHECK, effect=0.0345)), "+3.5 %"),
        (page.percent(replace(CHECK, relative_to="one", effect=0.0345)), "+0.035"),
    ],
)  # fmt: skip
def test_numbers_are_told_with_few_digits(given: str, words: str) -> None:
    assert given == words


def test_the_worst_check_is_the_least_probable() -> None:
    """Claim: by the probability among all laws, then by its own, then by how large the deviation is beside what is
    found in nine of ten runs, of either sign."""
    usual = replace(CHECK, case="usual")
    for better in (
        replace(CHECK, adjusted_p=0.05, p=0.9), replace(CHECK, p=0.2, effect=0.0),
        replace(CHECK, effect=1.3e-3), replace(CHECK, effect=-1.3e-3), replace(CHECK, detects_90=1.9e-3),
    ):  # fmt: skip
        for checks in ((usual, better), (better, usual)):
            assert page.worst_check(finding("u", *checks)) is better


def test_what_a_comparison_can_find_is_that_of_its_weakest_checks() -> None:
    """Claim: of laws with noise the sharpest and the bluntest are named, each by its weakest check; exact ones do not
    count, and without any noise there is nothing to tell."""
    exact = finding("exact", replace(CHECK, form="exact", detects_90=1e-9))
    sharp = finding("sharp", CHECK, replace(CHECK, detects_90=0.01), replace(CHECK, form="exact"))
    blunt = finding("blunt", replace(CHECK, detects_90=0.25))
    words = page.power_words(comparison(exact, blunt, finding("silent"), sharp))
    assert words == (
        "Of laws with noise, sharp finds 1 % with 90 % probability, blunt only 25 %. Smaller deviations pass unseen."
    )
    assert "without --quick" in page.power_words(comparison(sharp, quick=True))
    assert page.power_words(comparison(exact)) == ""


def test_a_caption_names_what_is_drawn() -> None:
    noisy, exact, bounded = CHECK, replace(CHECK, form="exact"), replace(CHECK, accuracy=0.1)
    found = page.caption(finding("u", exact), 99.5)
    assert found.startswith("Points: simulated less predicted, without noise. Dark band")
    found = page.caption(finding("u", exact, noisy), 99.5)
    assert "with 99.5 % intervals" in found
    assert "Dark band" not in found
    assert "Light band" in found
    assert "Dark band" in page.caption(finding("u", noisy, bounded), 99.5)


def test_laws_that_do_not_judge_an_estimator_of_ones_own_say_so() -> None:
    """Claim: without one nothing is said; with one of the peak, laws of the pulse's are the program's, those that use
    none say what they are about, those that do not apply why, and the rest judges."""
    kinds: dict[str, Any] = {
        "peak": finding("peak", CHECK, exercises="peak"), "pulse": finding("pulse", CHECK, exercises="pulse"),
        "light": finding("light", CHECK), "none": finding("none", reason="too dark", exercises="peak"),
    }  # fmt: skip
    assert comparison(*kinds.values()).unjudging == {}
    told = comparison(*kinds.values(), own={"peak": "mine", "pulse": ""})
    assert told.own_estimators == ("mine",)
    assert set(told.unjudging) == {"pulse", "light", "none"}
    assert told.unjudging["none"] == "does not apply: too dark"
    assert told.unjudging["pulse"] == "judges the pulse estimator, which is the program's"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("predicted", 1.01e75), ("accuracy", 1.01e75), ("simulated", 1.01e75), ("error", 1.01e75),
        ("predicted", -1.01e75), ("error", -1e-9), ("freedom", 0.0), ("freedom", -1.0),
    ],
)  # fmt: skip
def test_a_comparison_with_numbers_that_none_has_is_refused(name: str, value: float) -> None:
    """Claim: one such number among all is enough: those whose fourth powers no float holds, errors below nothing."""
    assert comparison_from_json(comparison_json(comparison(finding("u", replace(CHECK, predicted=-0.99e75)))))
    text = comparison_json(
        comparison(finding("u", CHECK), finding("v", CHECK, replace(CHECK, **{name: value})))
    )
    with pytest.raises(ValueError, match="8 m has numbers that no comparison has"):
        comparison_from_json(text)


def test_missing_numbers_come_back_as_none_at_all_and_freedom_as_boundless() -> None:
    made = comparison(
        finding("u", replace(CHECK, freedom=math.inf, low=math.nan, error=0.0)), own={"peak": "m"}
    )
    text = comparison_json(made)
    content = json.loads(text)
    assert content["passed"] is True
    assert content["findings"][0]["verdict"] == "holds"
    again = comparison_from_json(text)
    (check,) = again.findings[0].checks
    assert check.freedom == math.inf
    assert math.isnan(check.low)
    assert again.own == {"peak": "m"}


@pytest.mark.parametrize("own", [True, False])
@pytest.mark.parametrize("earlier", [None, 0, 2])
def test_a_comparison_is_printed_law_by_law(
    monkeypatch: pytest.MonkeyPatch, own: bool, earlier: int | None
) -> None:
    """Claim: each law that applies with its worst check, predicted with its unit, what is found in 90 and 99 %; then
    what does not apply or does not judge; then what differs from before; the verdict counts broken laws, with the
    level."""
    told: list[Any] = []
    monkeypatch.setattr(comparing, "print_rows", lambda rows, **_: told.append(rows))
    monkeypatch.setattr(comparing, "print_table", told.append)
    monkeypatch.setattr(comparing.typer, "echo", told.append)
    worst = replace(CHECK, case="9 m", adjusted_p=0.0001, broken=earlier == 2)
    changes = tuple(
        Change("u", f"{n} m", "range", "simulated", 1.00001, 2.0, 0.0345) for n in range(earlier or 0)
    )
    found = comparison(
        finding("u", CHECK, worst, exercises="peak"), finding("v", reason="too dark"),
        own={"peak": "mine"} if own else {}, baseline=None if earlier is None else changes,
    )  # fmt: skip
    comparing._print(found)
    head, row = told[0]
    assert head == [
        "law",
        "verdict",
        "checks",
        "worst case",
        "predicted",
        "simulated",
        "deviation",
        "p",
        "90 %",
        "99 %",
    ]
    verdict = "broken" if earlier == 2 else "holds"
    assert row == ["u", verdict, "2", "9 m", "8.001 mm", "8.01", "-0.12 %", "0.0001", "0.2 %", "0.3 %"]
    said = "\nSay nothing about mine:" if own else "\nDoes not apply:"
    assert told[1:3] == [said, {"v": "does not apply: too dark" if own else "too dark"}]
    rest = told[3:]
    if earlier == 2:
        assert rest.pop(0) == "\nDifferent from the baseline:"
        rows = [["law", "case", "what", "before", "now", "p"]]
        rows += [["u", f"{n} m", "simulated", "1", "2", "0.035"] for n in range(2)]
        assert rest.pop(0) == rows
    elif earlier == 0:
        assert rest.pop(0) == "\nNothing differs from the baseline."
    start = "\n1 of the laws broken" if earlier == 2 else "\nAll laws that apply hold"
    assert rest[0].startswith(f"{start} (family-wise level 0.02;")
    assert rest[1].startswith("Of laws with noise, u finds")
