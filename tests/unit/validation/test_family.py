"""The ledger of published facts: its form, its verdicts, and what keeps its facts held out."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from scanner_sim.config.preset import shipped_presets
from scanner_sim.foundation.errors import InputError, ScenarioError
from scanner_sim.validation.reproduce import Task, Verdict
from scanner_sim.validation.reproduce.family import book, entered
from scanner_sim.validation.reproduce.family.entered import Entry, digest_of, enter, is_held_out, values_of
from scanner_sim.validation.reproduce.family.experiments import EXPERIMENTS
from scanner_sim.validation.reproduce.family.judging import Finding, Measured, judged, standing
from scanner_sim.validation.reproduce.family.ledger import Fact, Published, read_ledger, shipped_ledger

FACTS = shipped_ledger()
TASK = Task(quick=True, device="cpu", repository=Path())
ONE_FACT = """\
schema: 1
facts:
  crack:
    title: A crack
    says: A crack is seen.
    kind: measured
    sources: [{of: "A. Author, Journal 1 (2000) 1"}]
    use: held out
    entered: 2026-11-23
    instruments: [nrc_2000]
    quantity: width
    published: {at_least: 1, at_most: 2, unit: mm, says: 1 to 2 mm, why: as printed}
    how: so
    reason: thus
"""


def between(low: float | None, high: float | None, *, ours: bool = False) -> Published:
    return Published(at_least=low, at_most=high, unit="mm", says="so much", why="as printed", ours=ours)


@pytest.mark.parametrize(
    ("low", "high", "value", "error", "verdict"),
    [
        (1.0, 2.0, 1.5, 0.01, Verdict.AGREES),
        (1.0, 2.0, 2.2, 0.08, Verdict.AGREES),
        (1.0, 2.0, 2.2, 0.06, Verdict.DIFFERS),
        (1.0, 2.0, 0.8, 0.06, Verdict.DIFFERS),
        (1.0, 2.0, 0.8, 0.08, Verdict.AGREES),
        (1.0, 2.0, 1.5, 0.2, Verdict.NOT_JUDGED),
        (1.0, 2.0, 9.0, 0.5, Verdict.DIFFERS),
        (None, 1.0, 0.001, 0.001, Verdict.AGREES),
        (None, 1.0, 1.2, 0.05, Verdict.DIFFERS),
        (None, 1.0, 0.5, 0.2, Verdict.NOT_JUDGED),
        (0.5, None, 40.0, 0.01, Verdict.AGREES),
        (0.5, None, 0.4, 0.03, Verdict.DIFFERS),
        (0.5, None, 0.4, 0.034, Verdict.AGREES),
        (0.5, None, 40.0, 0.09, Verdict.NOT_JUDGED),
        (1.0, 2.0, math.inf, 0.0, Verdict.DIFFERS),
        (1.0, None, math.nan, 0.0, Verdict.DIFFERS),
    ],
)
def test_intervals_alone_decide(
    low: float | None, high: float | None, value: float, error: float, verdict: Verdict
) -> None:
    """Claim: three standard errors reach the published interval or they do not, and too wide ones tell nothing."""
    assert standing(between(low, high), Finding(value, error)) is verdict


def test_words_and_used_facts_bear_nothing_out() -> None:
    """Claim: a bound of our own makes no agreement, nor does a fact that set a default; both may fail."""
    words, good, bad = between(1.0, 2.0, ours=True), Finding(1.5, 0.0), Finding(3.0, 0.0)
    assert standing(words, good) is Verdict.ALIKE
    assert judged(words, good, used=True) is Verdict.CHOSEN
    assert judged(between(1.0, 2.0), good, used=True) is Verdict.CHOSEN
    assert judged(between(1.0, 2.0), bad, used=True) is Verdict.DIFFERS
    assert standing(words, bad) is Verdict.DIFFERS


@pytest.mark.parametrize(
    ("finding", "text"),
    [
        (Finding(1.8451, 0.0223), "1.845 ± 0.067 mm"),
        (Finding(152.3, 4.1), "152 ± 12 mm"),
        (Finding(0.00069, 0.0), "0.00069 mm"),
        (Finding(math.inf, 0.0), "beyond all that was tried"),
        (Finding(math.nan, 0.0), "none"),
    ],
)
def test_numbers_are_told_as_precisely_as_they_are(finding: Finding, text: str) -> None:
    assert finding.text("mm") == text


def made(monkeypatch: pytest.MonkeyPatch, fact: Fact, value: float, *, used: bool = False) -> Verdict:
    """The verdict of a fact whose experiment finds a value."""
    monkeypatch.setattr(book, "EXPERIMENTS", {"crack": lambda task, name: Measured(Finding(value, 0.01))})
    outcome = book.item_of("crack", fact, used=used).make(TASK)
    return outcome.rows[0].verdict


def test_a_planted_miss_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a fact whose interval the simulation misses differs on the page, from either side, used or held out."""
    fact = read_ledger(ONE_FACT)["crack"]
    assert made(monkeypatch, fact, 1.5) is Verdict.AGREES
    assert made(monkeypatch, fact, 0.9) is Verdict.DIFFERS
    assert made(monkeypatch, fact, 2.1) is Verdict.DIFFERS
    assert made(monkeypatch, fact, 2.1, used=True) is Verdict.DIFFERS
    assert made(monkeypatch, fact, 1.5, used=True) is Verdict.CHOSEN


def test_an_instrument_that_is_not_there_breaks_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    fact = read_ledger(ONE_FACT.replace("nrc_2000", "nrc_1900"))["crack"]
    assert made(monkeypatch, fact, 1.5) is Verdict.NO_INSTRUMENT


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("kind: measured", "kind: guessed"), r"line 6, facts\.crack\.kind"),
        (("at_least: 1,", "at_least: 3,"), r"must ascend"),
        (("at_least: 1, at_most: 2, ", ""), r"needs an end"),
        (("    reason: thus\n", ""), r"facts\.crack\.reason: this key is missing"),
        (('sources: [{of: "A. Author, Journal 1 (2000) 1"}]', "sources: []"), r"facts\.crack\.sources"),
        (("    how: so", "    hwo: so"), r"hwo: there is no such key"),
        (("    how: so", "    how: so\n    how: thus"), r"line 14, facts\.crack\.how"),
        (("at_least: 1", "at_least: one"), r"facts\.crack\.published\.at_least"),
        (("schema: 1", "schema: 2"), r"schema"),
    ],
)
def test_faults_of_the_ledger_are_told_with_their_place(change: tuple[str, str], message: str) -> None:
    assert change[0] in ONE_FACT
    with pytest.raises(ScenarioError, match=message):
        read_ledger(ONE_FACT.replace(*change))


def test_what_another_page_tells_is_copied_anew_each_time() -> None:
    """Claim: facts that the paper's page judges are made again, however often that page was."""
    for key, fact in FACTS.items():
        assert book.item_of(key, fact, used=True).copied is (fact.elsewhere is not None)


def test_every_fact_has_one_judge_and_enough_are_held_out() -> None:
    """Claim: a fact is judged by an experiment, on the paper's page, or is said not to be; at least eight judge."""
    for key, fact in FACTS.items():
        ways = (key in EXPERIMENTS, fact.elsewhere is not None, bool(fact.not_judged))
        assert sum(ways) == 1, key
        assert (key in EXPERIMENTS) <= bool(fact.instruments), key
        assert len(fact.reason) > 40, key
    assert EXPERIMENTS.keys() <= FACTS.keys()
    held = [key for key in EXPERIMENTS if FACTS[key].use == "held out"]
    assert len(held) >= 8, held


def test_a_named_file_counts_by_what_it_holds(tmp_path: Path) -> None:
    """Claim: an instrument with a measured pulse changes with the samples of its file, not with the file's place or
    name."""
    text = """\
schema: 1
about: a pulse of its own
extends: nrc_2000
scanner:
  lidar:
    pulse:
      shape: {value: PULSE, mark: assumed, source: a test}
"""
    found = []
    for folder, name, content in (("a", "one.csv", "1,2"), ("b", "two.CSV", "1,2"), ("c", "one.csv", "1,3")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / name).write_text(content, encoding="utf-8")
        (tmp_path / folder / "mine.yaml").write_text(text.replace("PULSE", name), encoding="utf-8")
        found.append(values_of(str(tmp_path / folder / "mine.yaml")))
    entry = Entry(entered="2026-11-23", digest=digest_of(found[0]), values=found[0])
    assert digest_of(found[1]) == entry.digest != digest_of(found[2])
    assert entry.changes(found[1]) == ()
    (change,) = entry.changes(found[2])
    assert change.startswith("lidar.pulse.shape was a file of SHA-256 ")


def test_no_instrument_has_changed_since_its_facts_were_entered() -> None:
    """Claim: what judges an instrument has set none of its values.

    A failure says what has changed. Either take the change back, or run the command that the message names: it enters
    the instrument anew and turns its held-out facts into used ones.
    """
    entries = entered.read_entries()
    if not entries:
        pytest.skip(f"no instrument is entered yet: run {entered.COMMAND}")
    named = {name for fact in FACTS.values() if fact.use == "held out" for name in fact.instruments}
    for name in sorted(named & set(shipped_presets())):
        assert name in entries, f"{name} is not entered: run {entered.COMMAND} {name}"
        changes = entries[name].changes(values_of(name))
        assert not changes, (
            f"{name} has changed since its facts were held out: {'; '.join(changes)}. Take the change back, or run "
            f"{entered.COMMAND} {name}: its held-out facts then count as used."
        )


def spoilt(values: Mapping[str, Any]) -> dict[str, Any]:
    return {**values, "receiver.aperture": "99 mm"}


def test_a_changed_instrument_spends_its_facts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a changed value turns held-out facts of that instrument, and of no other, into used ones for good."""
    facts = {"crack": read_ledger(ONE_FACT)["crack"], "other": FACTS["tilt"]}
    before = enter(["nrc_2000"], {}, facts, "2026-11-23")
    assert before["nrc_2000"].digest == digest_of(values_of("nrc_2000"))
    assert is_held_out("crack", facts["crack"], before)
    assert enter(["nrc_2000"], before, facts, "2026-11-24")["nrc_2000"].spent == {}

    true = entered.values_of
    monkeypatch.setattr(entered, "values_of", lambda name: spoilt(true(name)))
    assert not is_held_out("crack", facts["crack"], before)
    after = enter(["nrc_2000"], before, facts, "2026-12-01")["nrc_2000"]
    assert after.digest != before["nrc_2000"].digest
    assert after.spent == {"crack": "2026-12-01: receiver.aperture was 25 mm, is 99 mm"}
    kept = enter(["nrc_2000"], {"nrc_2000": after}, facts, "2026-12-02")["nrc_2000"]
    assert kept.spent == after.spent
    monkeypatch.setattr(entered, "values_of", true)
    again = enter(["nrc_2000"], {"nrc_2000": after}, facts, "2026-12-03")
    assert not is_held_out("crack", facts["crack"], again)
    with pytest.raises(InputError, match="no shipped instrument 'nrc_1900'"):
        enter(["nrc_1900"], {}, facts, "2026-11-23")


def test_a_new_key_is_shown_and_a_lost_one_spends() -> None:
    entry = Entry(entered="2026-11-23", digest="", values={"a": 1, "b": "2 mm"})
    assert entry.changes({"a": 1, "b": "2 mm", "c": 0}) == ()
    assert entry.later({"a": 1, "b": "2 mm", "c": 0}) == ("c",)
    assert entry.changes({"a": 1}) == ("b was 2 mm, is gone",)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda content: content["nrc_2000"]["values"].update({"rate": "1 Hz"}), "changed by hand"),
        (lambda content: content["nrc_2000"].pop("digest"), "is broken"),
    ],
)
def test_entries_that_were_changed_by_hand_are_refused(
    spoil: Callable[[dict[str, Any]], Any], message: str, tmp_path: Path
) -> None:
    path = tmp_path / "instruments.json"
    entered.write_entries(enter(["nrc_2000"], {}, FACTS, "2026-11-23"), path)
    assert entered.read_entries(path)["nrc_2000"].changes(values_of("nrc_2000")) == ()
    content = json.loads(path.read_text(encoding="utf-8"))
    spoil(content)
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        entered.read_entries(path)


def test_the_command_says_what_it_did(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, true = tmp_path / "instruments.json", entered.values_of
    read, write = entered.read_entries, entered.write_entries
    monkeypatch.setattr(entered, "read_entries", lambda: read(path))
    monkeypatch.setattr(entered, "write_entries", lambda entries: write(entries, path))
    entered.main(["nrc_2000"])
    monkeypatch.setattr(entered, "values_of", lambda name: spoilt(true(name)))
    entered.main(["nrc_2000"])
    entered.main(["nrc_2000"])
    first, second, third = capsys.readouterr().out.splitlines()
    assert "now used" not in first
    assert "now used: speckle_limit, factor_ten" in second
    assert "now used" not in third, "what was used before is no news"
