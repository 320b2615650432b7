"""The page of the ledger: what it counts, and what it says of each fact and each instrument."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from scanner_sim.validation.reproduce.family import page
from scanner_sim.validation.reproduce.item import Verdict


def fact(title: str, *instruments: str) -> Any:
    return SimpleNamespace(
        title=title, kind="measured", instruments=instruments,
        published=SimpleNamespace(says=f"{title} says", why="print"),
        sources=[SimpleNamespace(of="A, B", read="2026-11-02", at="p. 3"), SimpleNamespace(of="C", read="", at="")],
    )  # fmt: skip


def row(verdict: Verdict, **more: str) -> Any:
    return SimpleNamespace(
        **{"what": "w", "paper": "", "expected": "", "found": "f|1", "verdict": verdict} | more
    )


def test_facts_held_out_are_counted_by_their_first_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: only held-out ones count, each by its first row; a single one agrees, several agree; what is not made yet
    is said, and does not count."""
    monkeypatch.setattr(page, "is_held_out", lambda key, fact, entries: key != "used")
    facts = {key: fact(key) for key in ("a", "b", "c", "used", "not", "none")}
    results: Any = {
        "a": SimpleNamespace(rows=[row(Verdict.AGREES), row(Verdict.DIFFERS)]),
        "b": SimpleNamespace(rows=[row(Verdict.AGREES)]), "c": SimpleNamespace(rows=[row(Verdict.DIFFERS)]),
        "used": SimpleNamespace(rows=[row(Verdict.DIFFERS)]), "none": SimpleNamespace(rows=[]),
        "other": SimpleNamespace(rows=[row(Verdict.AGREES)]),
    }  # fmt: skip
    head, _, _, _, *lines = page._overview(results, facts, {})
    assert head == "Of 3 facts held out: 2 agree, 1 differs."
    cells = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]
    assert [one[0] for one in cells] == [f"[{key}](#{key})" for key in facts]
    assert [one[2] for one in cells] == ["held out", "held out", "held out", "used", "held out", "held out"]
    assert [one[3] for one in cells] == [f"{key} says" for key in facts]
    assert [one[5] for one in cells] == ["agrees", "agrees", "differs", "differs", "", ""]
    assert cells[4][4] == cells[5][4] == "not made yet"
    assert cells[0][4] == r"f\|1"


def test_instruments_are_told_as_they_were_entered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: each that a fact names, once, in order of names: not there, not entered, unchanged, with what is new, or
    with what has changed, and which of its facts are spent."""
    names = ("gone", "fresh", "same", "more", "moved")
    monkeypatch.setattr(page, "shipped_presets", lambda: names[1:])
    monkeypatch.setattr(page, "values_of", lambda name: {"of": name})
    monkeypatch.setattr(page, "digest_of", lambda values: f"{values['of']}0123456789abcdef")

    def entry(changes: tuple[str, ...], later: tuple[str, ...], spent: dict[str, str]) -> Any:
        return SimpleNamespace(
            entered="2026-11-05", digest="fedcba9876543210", spent=spent,
            changes=lambda now: changes if now in ({"of": "moved"}, {"of": "same"}, {"of": "more"}) else None,
            later=lambda now: later,
        )  # fmt: skip

    entries = {
        "same": entry((), (), {}), "more": entry((), ("k", "l"), {}),
        "moved": entry(("p was 1, is 2",), ("k",), {"crack": "that day"}), "gone": entry((), (), {}),
    }  # fmt: skip
    facts = {"a": fact("a", "same", "gone", "moved"), "b": fact("b", "more", "same", "fresh")}
    lines = page._instruments(facts, entries)[4:]
    entered = "2026-11-05 | `fedcba987654`"
    assert lines == [
        "| fresh | – | `fresh0123456` now | not entered yet |", "| gone | – | – | no such instrument |",
        f"| more | {entered} | new: k, l |", f"| moved | {entered} | p was 1, is 2; crack used since that day |",
        f"| same | {entered} | unchanged |",
    ]  # fmt: skip


@pytest.mark.parametrize("drawn", [True, False])
def test_a_fact_is_told_with_its_sources_and_its_rows(drawn: bool) -> None:
    """Claim: title with its anchor, what is published, sources with place and day, the interval, how it is simulated; a
    table of rows, – where there is no number; why it differs, and by which command it is made."""
    item: Any = SimpleNamespace(
        key="crack",
        title="A crack",
        says="seen",
        how="so",
        differences="thus",
        command="make it",
        picture="p",
    )
    lines = page._section(item, None, fact("a"))
    assert lines == [
        "## A crack {#crack}", "", "**Published:** seen", "",
        "**Source** (measured): A, B (`p. 3`, read on 2026-11-02); C (not read).", "", "**Interval:** print.", "",
        "**Here:** so", "", "Not made yet: `make it`.",
    ]  # fmt: skip
    rows = [row(Verdict.AGREES, paper="1 mm", expected="2 mm", found="3 mm"), row(Verdict.NOT_JUDGED)]
    result: Any = SimpleNamespace(drawn=drawn, rows=rows)
    found = page._section(item, result, None)
    assert any(line.startswith("![A crack](") for line in found) is drawn
    assert found[:5] == ["## A crack {#crack}", "", "**Published:** seen", "", "**Here:** so"]
    assert found[-8:] == [
        "| quantity | published | closed form | simulated | verdict |", "|---|---|---|---|---|",
        "| w | 1 mm | 2 mm | 3 mm | agrees |", rf"| w | – | – | f\|1 | {Verdict.NOT_JUDGED} |", "", "**Why:** thus", "",
        "`make it`",
    ]  # fmt: skip
