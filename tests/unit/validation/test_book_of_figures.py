"""The book of reproduced figures: its order, which results serve again, what is written and told."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from scanner_sim.foundation.errors import InputError
from scanner_sim.validation.reproduce import page, results, run
from scanner_sim.validation.reproduce.item import Outcome, Row, Task, Verdict
from scanner_sim.validation.reproduce.results import Book, Result

TASK = Task(quick=False, device="cpu", repository=Path(), seed=7)
ROWS = (Row("w", "1 mm", "2 mm", "3 mm", Verdict.AGREES), Row("v", "", "", "f|1", Verdict.DIFFERS))


def item(key: str, **more: Any) -> Any:
    told: dict[str, Any] = {
        "key": key, "title": f"title of {key}", "says": "says", "how": "how", "differences": "why",
        "command": f"make {key}",
        "also": "", "inputs": {}, "aliases": (), "make": None, "copied": False,
    }  # fmt: skip
    return SimpleNamespace(**told | more)


def made(key: str, **more: Any) -> Result:
    told: dict[str, Any] = {
        "key": key, "rows": ROWS, "quick": False, "seed": 7, "date": "2026-11-02", "made_by": {"scanner-sim": "9"}
    }  # fmt: skip
    return Result(**told | more)


def test_items_stand_in_the_order_of_the_paper() -> None:
    """Claim: equations, then tables, then figures, each by its number, letters after the bare number."""
    keys = ["fig12b", "table2", "eq10", "fig2a", "fig12", "eq2", "fig2b", "table1"]
    ordered = sorted((item(key) for key in keys), key=run._place)
    assert [one.key for one in ordered] == [
        "eq2",
        "eq10",
        "table1",
        "table2",
        "fig2a",
        "fig2b",
        "fig12",
        "fig12b",
    ]
    every = [one.key for one in run.all_items()]
    assert len(every) == len(set(every))
    assert every == [one.key for one in sorted(run.all_items(), key=run._place)]


def test_items_are_chosen_by_key_or_by_another_name() -> None:
    items = (item("eq1"), item("fig2", aliases=("fig2a", "fig2b")), item("fig3"))
    assert run.chosen_items(items, ()) == items
    assert [one.key for one in run.chosen_items(items, ("fig2b", "eq1", "fig2"))] == ["eq1", "fig2"]
    with pytest.raises(InputError, match="no item 'fig4'") as fault:
        run.chosen_items(items, ("eq1", "fig4"))
    assert fault.value.remedy.startswith("Did you mean fig")
    with pytest.raises(InputError) as fault:
        run.chosen_items(items, ("zzz",))
    assert fault.value.remedy == "There are eq1, fig2, fig2a, fig2b, fig3."


@pytest.mark.parametrize(
    ("result", "quick", "again"),
    [
        (None, False, False), ({}, False, True), ({}, True, True), ({"quick": True}, True, True),
        ({"quick": True}, False, False), ({"seed": 8}, False, False), ({"made_by": {"scanner-sim": "8"}}, False, False),
    ],
)  # fmt: skip
def test_a_result_serves_again_as_it_was_made(
    monkeypatch: pytest.MonkeyPatch, result: dict[str, Any] | None, quick: bool, again: bool
) -> None:
    """Claim: with the same seed, programs and inputs; a whole one serves where a quick one is asked for, not the other
    way round."""
    monkeypatch.setattr(results, "versions", lambda: {"scanner-sim": "9"})
    found = None if result is None else made("eq1", **result)
    assert results.serves(found, item("eq1"), dataclasses.replace(TASK, quick=quick)) is again
    assert not results.serves(made("eq1"), item("eq1", inputs={"fact": "1"}), TASK)
    with_input = made("eq1", made_by={"scanner-sim": "9", "fact": "1"})
    assert results.serves(with_input, item("eq1", inputs={"fact": "1"}), TASK)
    assert not results.serves(with_input, item("eq1", inputs={"fact": "1"}, copied=True), TASK)


@pytest.mark.parametrize("drawn", [True, False])
def test_a_result_comes_back_with_its_picture(tmp_path: Path, drawn: bool) -> None:
    """Claim: of its own key, whole, and with its picture where it has one; else it is made again."""
    one = item("eq1")
    outcome = Outcome(ROWS, (lambda path: Path(path).write_text("PNG")) if drawn else None)
    result = results.result_of(one, TASK, outcome)
    assert (result.key, result.rows, result.quick, result.seed, result.drawn) == (
        "eq1",
        ROWS,
        False,
        7,
        drawn,
    )
    assert [result.count(verdict) for verdict in (Verdict.AGREES, Verdict.DIFFERS, Verdict.ALIKE)] == [
        1,
        1,
        0,
    ]
    writers = results.writers_of(result, one, outcome)
    assert set(writers) == ({"eq1.png", "eq1.json"} if drawn else {"eq1.json"})
    for name, write in writers.items():
        write(tmp_path / name)
    assert json.loads((tmp_path / "eq1.json").read_text())["rows"][1]["found"] == "f|1"
    assert results.read_result(tmp_path, one) == result
    (tmp_path / "eq2.json").write_text((tmp_path / "eq1.json").read_text())
    (tmp_path / "eq2.png").touch()
    assert results.read_result(tmp_path, item("eq2")) is None
    if drawn:
        (tmp_path / "eq1.png").unlink()
        assert results.read_result(tmp_path, one) is None
    (tmp_path / "eq3.json").write_text("{")
    assert results.read_result(tmp_path, item("eq3")) is None
    assert results.read_result(tmp_path, item("eq4")) is None


@pytest.mark.parametrize(
    ("page_text", "files", "refused"),
    [
        ("# Ours\nmore", ("eq1.png", "book.md"), None), ("# Our", ("book.md",), "holds book.md but"),
        ("# Theirs", ("eq1.json", "fig9.png"), "holds book.md, eq1.json but"), (None, (), None),
        (None, ("eq1.png",), "holds eq1.png but"), (None, ("fig9.png",), None),
    ],
)  # fmt: skip
def test_files_of_others_are_not_replaced(
    tmp_path: Path, page_text: str | None, files: tuple[str, ...], refused: str | None
) -> None:
    """Claim: where the page begins as ours all files are ours; else none of the names that would be written may be
    there."""
    for name in files:
        (tmp_path / name).touch()
    if page_text is not None:
        (tmp_path / "book.md").write_text(page_text)
    book = Book("book.md", "# Ours", (), lambda items, found: "")
    if refused is None:
        results.refuse_strangers(tmp_path, book, [item("eq1")])
        return
    with pytest.raises(InputError, match=refused):
        results.refuse_strangers(tmp_path, book, [item("eq1")])


@pytest.mark.parametrize("anew", [True, False])
def test_what_serves_is_not_made_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, anew: bool) -> None:
    """Claim: only chosen items are made, those that serve only where all is wanted anew; the page holds every result
    that is there, and is written after each; the bar tells the title of the next one."""
    monkeypatch.setattr(results, "versions", lambda: {"scanner-sim": "9"})
    asked: list[str] = []

    def maker(key: str) -> Any:
        def make(task: Task) -> Outcome:
            asked.append(key)
            return Outcome(ROWS, lambda path: Path(path).write_text("PNG"))

        return make

    items = tuple(item(key, make=maker(key)) for key in ("eq1", "eq2", "fig3"))
    texts: list[Any] = []
    book = Book(
        "book.md",
        "# Ours",
        items,
        lambda all_of, found: texts.append(sorted(found)) or f"# Ours {sorted(found)}",
    )
    run.reproduce(tmp_path, TASK, only=("eq1",), book=book)
    assert asked == ["eq1"]
    said: list[Any] = []
    found = run.reproduce(
        tmp_path, TASK, only=("eq1", "fig3"), anew=anew, book=book, progress=lambda *given: said.append(given)
    )
    assert asked == ["eq1", *(["eq1"] if anew else []), "fig3"]
    assert list(found) == ["eq1", "fig3"]
    assert said == [(0, 2, "title of eq1"), (1, 2, "title of fig3"), (2, 2, "")]
    assert texts[-1] == ["eq1", "fig3"]
    assert (tmp_path / "book.md").read_text() == "# Ours ['eq1', 'fig3']"
    assert {one.name for one in tmp_path.iterdir()} == {
        "book.md",
        "eq1.json",
        "eq1.png",
        "fig3.json",
        "fig3.png",
    }


def test_the_page_counts_verdicts_and_tells_each_item() -> None:
    """Claim: a line for each item with how many rows have each verdict, – for none; items in full with – where there is
    no number, and by which command they are made; no mark of Markdown comes of what was found."""
    items = [item("eq1", also="`other`"), item("eq2")]
    text = page.page(items, {"eq1": made("eq1")})
    lines = text.splitlines()
    counts = {Verdict.AGREES: "1", Verdict.DIFFERS: "1"}
    head = next(number for number, one in enumerate(lines) if one.startswith("| item |"))
    assert lines[head] == f"| item | {' | '.join(page.VERDICTS)} |"
    assert (
        lines[head + 2]
        == f"| [title of eq1](#eq1) | {' | '.join(counts.get(one, '–') for one in page.VERDICTS)} |"
    )
    assert lines[head + 3].startswith("| [title of eq2](#eq2) | not made yet |")
    assert "| w | 1 mm | 2 mm | 3 mm | agrees |" in lines
    assert r"| v | – | – | f\|1 | differs |" in lines
    assert "The same by other verbs: `other`" in lines
    assert "![title of eq1](eq1.png)" in lines
    assert lines[-1] == "Not made yet: `make eq2`."
    assert page.markdown_text("<a> & `b` ![c](d)") == r"&lt;a&gt; &amp; \`b\` \![c\](d)"


@pytest.mark.parametrize(
    ("dates", "quick", "words"),
    [
        (("2026-11-02",), 0, "Made on 2026-11-02, seed 7, with"),
        (("2026-11-05", "2026-11-02", "2026-11-03"), 2, "Made on 2026-11-02 to 2026-11-05, seed 7, 8, with"),
    ],
)  # fmt: skip
def test_results_tell_when_and_with_what_they_were_made(
    dates: tuple[str, ...], quick: int, words: str
) -> None:
    found = [
        made(f"eq{number}", date=date, quick=number < quick, seed=7 + (number == 1))
        for number, date in enumerate(dates)
    ]
    told = page.provenance(found)
    assert told.startswith(words)
    assert told.endswith(f"{quick} of the items were made with `--quick`." if quick else ".")
    assert ("--quick" in told) is bool(quick)


def test_results_of_several_versions_tell_all_of_them() -> None:
    """Claim: each set of programs once, in the order of the items; an old result beside new ones hides none."""
    rest = ", ".join(f"{name} ?" for name in ("mitsuba", "drjit", "numpy", "OpenEXR"))
    found = [
        made(f"eq{number}", made_by={"scanner-sim": version})
        for number, version in enumerate(("9", "10", "9"))
    ]
    expected = f"Made on 2026-11-02, seed 7, with scanner-sim 9, {rest} and with scanner-sim 10, {rest}."
    assert page.provenance(found) == expected


def test_shipped_scenarios_are_found_in_the_repository(repo_root: Path, tmp_path: Path) -> None:
    task = dataclasses.replace(TASK, repository=repo_root)
    assert task.config("quickstart") == repo_root / "configs" / "quickstart.yaml"
    with pytest.raises(InputError, match=r"none\.yaml is not there"):
        task.config("none")
    assert (task.choose(5, 2), dataclasses.replace(task, quick=True).choose(5, 2)) == (5, 2)
