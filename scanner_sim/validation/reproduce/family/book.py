"""The ledger as items of one page: each fact is an experiment, a comparison of the paper's page, or not judged."""

from __future__ import annotations

import hashlib
from functools import partial
from pathlib import Path

from scanner_sim.config.preset import shipped_presets
from scanner_sim.validation.reproduce.family.crossing import ITEM as MAP
from scanner_sim.validation.reproduce.family.entered import digest_of, is_held_out, read_entries, values_of
from scanner_sim.validation.reproduce.family.experiments import EXPERIMENTS
from scanner_sim.validation.reproduce.family.judging import judged, published_text
from scanner_sim.validation.reproduce.family.ledger import Fact, shipped_ledger
from scanner_sim.validation.reproduce.family.page import HEADING, OPTIONS, PAGE, page
from scanner_sim.validation.reproduce.item import Item, Outcome, Row, Task, Verdict
from scanner_sim.validation.reproduce.results import Book, read_result
from scanner_sim.validation.reproduce.run import all_items, chosen_items


def family() -> Book:
    """Return the ledger's facts and their page."""
    facts, entries = shipped_ledger(), read_entries()
    items = tuple(item_of(key, fact, used=not is_held_out(key, fact, entries)) for key, fact in facts.items())
    return Book(PAGE, HEADING, (*items, MAP), partial(page, facts=facts, entries=entries))


def item_of(key: str, fact: Fact, *, used: bool) -> Item:
    """Return a fact as an item; it is made again where its number, its use or one of its instruments has changed."""
    shipped = shipped_presets()
    inputs = {name: digest_of(values_of(name))[:12] for name in fact.instruments if name in shipped}
    # What is said of a fact may be worded anew without another experiment.
    judged_by = fact.model_dump_json(include={"quantity", "published", "elsewhere", "not_judged"})
    inputs["fact"] = hashlib.sha256(judged_by.encode()).hexdigest()[:12]
    inputs["use"] = "used" if used else "held out"
    return Item(
        key,
        fact.title,
        fact.says,
        fact.how,
        fact.reason,
        partial(_make, key, fact, used),
        options=OPTIONS,
        inputs=inputs,
        copied=fact.elsewhere is not None,
    )


def _make(key: str, fact: Fact, used: bool, task: Task) -> Outcome:
    published = published_text(fact.published)

    def told(found: str, verdict: Verdict) -> Outcome:
        return Outcome((Row(fact.quantity, published, "", found, verdict),))

    if fact.not_judged:
        return told(fact.not_judged, Verdict.NOT_JUDGED)
    if fact.elsewhere is not None:
        row = _row_elsewhere(task.repository / "docs" / "validation", fact.elsewhere.item, fact.elsewhere.row)
        if row is None:
            command = f"scanner-sim reproduce --only {fact.elsewhere.item} -o docs/validation"
            return told(f"make it first: {command}", Verdict.NOT_JUDGED)
        verdict = Verdict.CHOSEN if used and row.verdict is Verdict.AGREES else row.verdict
        return told(row.found, verdict)
    missing = [name for name in fact.instruments if name not in shipped_presets()]
    if missing:
        return told(f"no such instrument: {', '.join(missing)}", Verdict.NO_INSTRUMENT)
    made = EXPERIMENTS[key](task, *fact.instruments)
    first = Row(
        fact.quantity,
        published,
        made.expected,
        made.finding.text(fact.published.unit),
        judged(fact.published, made.finding, used=used),
    )
    return Outcome((first, *made.rows), made.draw)


def _row_elsewhere(folder: Path, key: str, start: str) -> Row | None:
    """Return a comparison of the paper's page by how it begins; None where it was not made."""
    (item,) = chosen_items(all_items(), [key])
    result = read_result(folder, item)
    return next((row for row in result.rows if row.what.startswith(start)), None) if result else None
