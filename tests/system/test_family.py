"""``scanner-sim reproduce --family``: facts are made and kept, and the shipped page is of this program."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from scanner_sim.cli import app
from scanner_sim.validation.reproduce import Item, Result, Verdict
from scanner_sim.validation.reproduce.family.book import family
from scanner_sim.validation.reproduce.family.ledger import shipped_ledger
from scanner_sim.validation.reproduce.family.page import PAGE
from scanner_sim.validation.reproduce.results import read_result

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = ROOT / "docs" / "validation"
FACTS = shipped_ledger()
BOOK = family()

pytestmark = pytest.mark.usefixtures("device")


def shipped(item: Item) -> Result:
    result = read_result(SHIPPED, item)
    assert result is not None, f"run: {item.command} -o docs/validation"
    return result


def test_the_verb_makes_facts_and_their_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: facts are made by their keys, one that is made is kept, and all the others stand on the page too."""
    monkeypatch.chdir(ROOT)
    folder = tmp_path / "family"
    keys = ("speckle_share", "camera_dots", "angular_error")
    arguments = ["reproduce", "--family", "--quick", "-o", str(folder), "--device", "cpu"]
    arguments += [word for key in keys for word in ("--only", key)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert PAGE in result.stdout
    text = (folder / PAGE).read_text(encoding="utf-8")
    found = {key: json.loads((folder / f"{key}.json").read_text(encoding="utf-8"))["rows"][0] for key in keys}
    assert {key: row["verdict"] for key, row in found.items()} == {
        "speckle_share": "alike in kind",
        "camera_dots": "not judged",
        "angular_error": "differs",
    }
    assert all(row["found"] in text for row in found.values())
    assert (folder / "speckle_share.png").read_bytes().startswith(b"\x89PNG")
    assert not (folder / "camera_dots.png").exists()
    assert "Not made yet: `scanner-sim reproduce --family --only crack`." in text
    assert "![The speckle" not in text

    before = (folder / "speckle_share.json").stat().st_mtime_ns
    assert CliRunner().invoke(app, arguments).exit_code == 0
    assert (folder / "speckle_share.json").stat().st_mtime_ns == before
    wrong = CliRunner().invoke(app, ["reproduce", "--family", "--only", "carck", "-o", str(folder)])
    assert wrong.exit_code == 2
    assert "Did you mean crack?" in wrong.output


@pytest.mark.parametrize("item", BOOK.items, ids=lambda item: item.key)
def test_the_shipped_page_is_of_these_facts_and_instruments(item: Item) -> None:
    """Claim: the page was made in full from this ledger and these instruments, whose digests the results keep."""
    result = shipped(item)
    assert not result.quick
    kept = {name: result.made_by.get(name) for name in item.inputs}
    assert kept == item.inputs, f"a fact or an instrument has changed: run {item.command} -o docs/validation"
    text = (SHIPPED / PAGE).read_text(encoding="utf-8")
    assert all(row.found in text for row in result.rows)


def test_enough_held_out_facts_are_judged_and_those_that_fail_are_explained() -> None:
    """Claim: at least eight held-out facts have a verdict; what differs has a reason of more than a phrase."""
    items = {item.key: item for item in BOOK.items}
    verdicts = {key: shipped(items[key]).rows[0].verdict for key in FACTS}
    judges = (Verdict.AGREES, Verdict.ALIKE, Verdict.DIFFERS)
    held = [key for key in FACTS if items[key].inputs["use"] == "held out" and verdicts[key] in judges]
    assert len(held) >= 8, held
    for key in FACTS:
        if verdicts[key] is Verdict.DIFFERS:
            assert len(FACTS[key].reason) > 100, key


def test_facts_of_the_papers_page_say_what_it_says() -> None:
    """Claim: a fact that is judged there has the number and the verdict of that page as it is."""
    items = {item.key: item for item in BOOK.items}
    for key, fact in FACTS.items():
        if fact.elsewhere is not None:
            rows = json.loads((SHIPPED / f"{fact.elsewhere.item}.json").read_text(encoding="utf-8"))["rows"]
            (there,) = [row for row in rows if row["what"].startswith(fact.elsewhere.row)]
            here = shipped(items[key]).rows[0]
            assert (here.found, here.verdict) == (there["found"], there["verdict"]), key
