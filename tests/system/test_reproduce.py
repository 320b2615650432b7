"""``scanner-sim reproduce``: all of the paper is there, work that is done is kept, and the shipped page is complete."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from scanner_sim.cli import app
from scanner_sim.foundation.errors import InputError
from scanner_sim.validation.reproduce import Item, Outcome, Task, Verdict, all_items, reproduce
from scanner_sim.validation.reproduce import run as flow
from scanner_sim.validation.reproduce.item import against_print, alike, chosen, row_of_claim
from scanner_sim.validation.reproduce.page import PAGE
from scanner_sim.validation.reproduce.results import read_result

ROOT = Path(__file__).resolve().parents[2]
ITEMS = all_items()
PARTS = {
    *(f"eq{number}" for number in range(1, 20)),
    "table1",
    "table2",
    *(
        f"fig{name}"
        for name in ("1", "2a", "2b", "4", "5", "12", "12b", "13", "14", "15", "15b", "16", "17", "18")
    ),
}
"""What issue and paper ask for. Figures 3 and 6 to 11 are photographs and drawings without data."""

pytestmark = pytest.mark.usefixtures("device")


def task(**changes: Any) -> Task:
    return replace(Task(quick=True, device="cpu", repository=ROOT), **changes)


def drawing(path: Path) -> None:
    path.write_bytes(b"a picture")


@pytest.fixture
def two(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """Two items that only count how often they are made."""
    made = {"eq1": 0, "eq2": 0}

    def maker(key: str) -> Callable[[Task], Outcome]:
        def make(_: Task) -> Outcome:
            made[key] += 1
            if made[key] < 0:
                raise KeyboardInterrupt
            return Outcome((row_of_claim("a length", "1 m", "", "1 m", True),), drawing)

        return make

    items = tuple(Item(key, f"Item {key}", "so", "thus", "none", maker(key), (f"{key}x",)) for key in made)
    monkeypatch.setattr(flow, "all_items", lambda: items)
    return made


def test_every_equation_table_and_figure_is_there() -> None:
    assert {key for item in ITEMS for key in (item.key, *item.aliases)} == PARTS
    for item in ITEMS:
        assert all((item.title, item.says, item.how, item.differences)), item.key


@pytest.mark.parametrize(
    ("found", "error", "verdict", "words"),
    [
        (4.0, 0.1, Verdict.AGREES, "4 mm"),
        (3.3, 0.1, Verdict.AGREES, "3.3 mm"),
        (0.17, 0.01, Verdict.DIFFERS, "0.17 mm, 21 times less"),
        (45.0, 1.0, Verdict.DIFFERS, "45 mm, 10 times more"),
    ],
)
def test_better_than_printed_differs_as_much_as_worse(
    found: float, error: float, verdict: Verdict, words: str
) -> None:
    """Claim: a printed size is judged from both sides, three standard errors beyond its digits."""
    row = against_print("depth", "4 mm", (3.5, 4.5), found, error, "mm")
    assert (row.verdict, row.found) == (verdict, words)


def test_what_was_chosen_from_the_paper_counts_apart() -> None:
    """Claim: neither numbers chosen from the paper nor words of it count as agreement; all of them may fail."""
    assert chosen("bandwidth", "20 m", "", "20 m", True).verdict is Verdict.CHOSEN
    assert alike("kind", "immune", "", "yes", True).verdict is Verdict.ALIKE
    assert chosen("bandwidth", "20 m", "", "5 m", False).verdict is Verdict.DIFFERS
    assert alike("kind", "immune", "", "no", False).verdict is Verdict.DIFFERS


def test_what_is_done_is_kept(two: dict[str, int], tmp_path: Path) -> None:
    """Claim: an interrupted run goes on where it was, and a finished one makes nothing again."""
    two["eq2"] = -9
    with pytest.raises(KeyboardInterrupt):
        reproduce(tmp_path, task())
    assert read_result(tmp_path, flow.all_items()[0]) is not None
    assert "`scanner-sim reproduce --only eq2`" in (tmp_path / PAGE).read_text(encoding="utf-8")
    two["eq2"] = 0
    reproduce(tmp_path, task())
    reproduce(tmp_path, task())
    assert two == {"eq1": 1, "eq2": 1}
    assert not [path.name for path in tmp_path.iterdir() if "half" in path.name]


@pytest.mark.parametrize(
    "spoil",
    [
        lambda folder: (folder / "eq1.json").write_text("{", encoding="utf-8"),
        lambda folder: (folder / "eq1.json").write_text('{"rows": 5}', encoding="utf-8"),
        lambda folder: (folder / "eq1.png").unlink(),
    ],
)
def test_what_is_broken_is_made_again(
    spoil: Callable[[Path], None], two: dict[str, int], tmp_path: Path
) -> None:
    reproduce(tmp_path, task())
    spoil(tmp_path)
    reproduce(tmp_path, task())
    assert two == {"eq1": 2, "eq2": 1}


@pytest.mark.parametrize("name", ["index.md", "eq1.png", "eq2.json"])
@pytest.mark.parametrize("anew", [False, True])
def test_files_of_the_user_are_never_overwritten(
    two: dict[str, int], tmp_path: Path, name: str, anew: bool
) -> None:
    """Claim: a folder with such a file but no page of ours is refused before the work; one with other files is not."""
    (tmp_path / name).write_text("mine")
    (tmp_path / "notes.md").write_text("mine")
    with pytest.raises(InputError, match=f"{name} but no page of this program"):
        reproduce(tmp_path, task(), anew=anew)
    assert {path.name for path in tmp_path.iterdir()} == {name, "notes.md"}
    assert (tmp_path / name).read_text() == "mine"
    assert two == {"eq1": 0, "eq2": 0}
    (tmp_path / name).unlink()
    reproduce(tmp_path, task(), anew=anew)
    reproduce(tmp_path, task(), anew=True)
    assert (tmp_path / "notes.md").read_text() == "mine"


def test_a_result_that_was_sent_puts_no_tags_on_the_page(two: dict[str, int], tmp_path: Path) -> None:
    reproduce(tmp_path, task())
    path = tmp_path / "eq1.json"
    found = json.loads(path.read_text(encoding="utf-8"))
    found["rows"][0]["found"] = "<script>|</td>\x1b"
    path.write_text(json.dumps(found), encoding="utf-8")
    reproduce(tmp_path, task())
    page = (tmp_path / PAGE).read_text(encoding="utf-8")
    assert "<script>" not in page
    assert "&lt;script&gt;" in page
    found["rows"][0]["found"] = ["no text"]
    path.write_text(json.dumps(found), encoding="utf-8")
    reproduce(tmp_path, task())
    assert two == {"eq1": 2, "eq2": 1}


def test_other_seeds_and_whole_runs_are_made_again(two: dict[str, int], tmp_path: Path) -> None:
    """Claim: a quick result does not stand for a whole one, nor a seed for another; a whole one serves a quick run."""
    for made, asked in enumerate((task(), task(seed=5), task(quick=False, seed=5)), start=1):
        reproduce(tmp_path, asked)
        assert two["eq1"] == made
    reproduce(tmp_path, task(seed=5))
    assert two["eq1"] == 3
    reproduce(tmp_path, task(seed=5), anew=True)
    assert two["eq1"] == 4


def test_items_have_further_names(two: dict[str, int], tmp_path: Path) -> None:
    assert set(reproduce(tmp_path, task(), only=["eq2x"])) == {"eq2"}
    assert two == {"eq1": 0, "eq2": 1}
    with pytest.raises(InputError, match="no item 'eq3'") as error:
        reproduce(tmp_path, task(), only=["eq3"])
    assert "Did you mean eq" in error.value.remedy


def test_the_verb_makes_an_item_and_says_how_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    arguments = ["reproduce", "--quick", "--only", "eq3", "-o", str(tmp_path / "paper"), "--device", "cpu"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "Equation 3: coordinates" in result.stdout
    found = json.loads((tmp_path / "paper" / "eq3.json").read_text(encoding="utf-8"))
    assert found["seed"] == 2000
    assert all(row["verdict"] != "differs" for row in found["rows"])
    text = (tmp_path / "paper" / PAGE).read_text(encoding="utf-8")
    assert "![Equation 3: coordinates](eq3.png)" in text
    assert CliRunner().invoke(app, ["reproduce", "--only", "fog12"]).exit_code == 2


def test_without_the_shipped_scenarios_the_remedy_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="lighting_orbit") as error:
        reproduce(tmp_path / "out", task(repository=tmp_path), only=["table1"])
    assert "folder of the repository" in error.value.remedy


@pytest.mark.parametrize("item", ITEMS, ids=lambda item: item.key)
def test_the_shipped_page_has_it(item: Item) -> None:
    """Claim: the page of the documents was made in full, and what differs from the paper is explained."""
    result = read_result(ROOT / "docs" / "validation", item)
    assert result is not None, f"run: {item.command} -o docs/validation"
    assert not result.quick
    assert all(row.what and row.found for row in result.rows)
    if any(row.verdict is Verdict.DIFFERS for row in result.rows):
        assert len(item.differences) > 60
    text = (ROOT / "docs" / "validation" / PAGE).read_text(encoding="utf-8")
    assert all(row.found in text for row in result.rows)
