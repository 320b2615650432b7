"""The page of the ledger: every fact with its number, its source, and how the simulation stands to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from scanner_sim.config.preset import shipped_presets
from scanner_sim.validation.reproduce.family.entered import COMMAND, Entry, digest_of, is_held_out, values_of
from scanner_sim.validation.reproduce.family.judging import REACH
from scanner_sim.validation.reproduce.family.ledger import Fact, Source
from scanner_sim.validation.reproduce.item import Item, Row, Verdict
from scanner_sim.validation.reproduce.page import markdown_text, provenance
from scanner_sim.validation.reproduce.results import Result, picture_of

PAGE = "family.md"
"""The ledger's page."""

OPTIONS = "--family "
"""By which the verb makes it."""

HEADING = (
    "# Validation: the ledger of published facts\n\n"
    "Written by `scanner-sim reproduce --family` from simulated data."
)
"""How it begins: by this it is known."""

_INTRODUCTION = f"""\
{HEADING} What is
published of the family's instruments, and of ranging by light, stands here with its number, its source, and whether it
was *used* for a value of an instrument or *held out*. A held-out fact is a judge that nobody can tune: it set nothing.
Simulated numbers come from rendered scenes, detectors and estimators, closed forms stand beside them.

| verdict | means |
|---|---|
| agrees | the interval of the simulated number meets the published one and is not wider |
| differs | the intervals do not meet, be the simulation worse or better; the reason stands below |
| alike in kind | print has words only; what was found keeps a bound of our own |
| by construction | the fact was used: it cannot bear anything out |
| not judged | nothing of the kind is simulated, or the sample is too small to tell |
| no such instrument | the instrument is not among the shipped ones |
| not printed | a comparison beside the fact, with a closed form |

Simulated numbers have {REACH:g} standard errors to each side. Published ones have the interval that the ledger states,
with how it follows from print; where print has a bound, the other side is open.
"""


def page(
    items: Sequence[Item],
    results: Mapping[str, Result],
    facts: Mapping[str, Fact],
    entries: Mapping[str, Entry],
) -> str:
    """Return the page of the ledger in Markdown; items without a result say how to make them."""
    lines = [_INTRODUCTION]
    if results:
        lines += [provenance(list(results.values())), ""]
    lines += [*_overview(results, facts, entries), "", *_instruments(facts, entries)]
    for item in items:
        lines += ["", *_section(item, results.get(item.key), facts.get(item.key))]
    return "\n".join(lines) + "\n"


def _overview(
    results: Mapping[str, Result], facts: Mapping[str, Fact], entries: Mapping[str, Entry]
) -> list[str]:
    """Return how many facts stand how, and each in a row."""
    first = {key: results[key].rows[0] for key in facts if key in results and results[key].rows}
    held = {key for key, fact in facts.items() if is_held_out(key, fact, entries)}
    verdicts = [row.verdict for key, row in first.items() if key in held]
    counted = [_counted(verdicts.count(verdict), verdict) for verdict in Verdict if verdict in verdicts]
    lines = [f"Of {len(held & first.keys())} facts held out: {', '.join(counted)}.", ""] if counted else []
    lines += ["| fact | kind | use | published | simulated | verdict |", "|---" * 6 + "|"]
    for key, fact in facts.items():
        row = first.get(key)
        use = "held out" if key in held else "used"
        told = ["not made yet", ""] if row is None else [row.found, str(row.verdict)]
        cells = [markdown_text(text) for text in (fact.kind, use, fact.published.says, *told)]
        lines.append(f"| [{markdown_text(fact.title)}](#{key}) | {' | '.join(cells)} |")
    return lines


def _counted(number: int, verdict: Verdict) -> str:
    """Return how many facts have a verdict, in words: 1 agrees, 3 agree."""
    verb = verdict in (Verdict.AGREES, Verdict.DIFFERS)
    return f"{number} {str(verdict).removesuffix('s') if verb and number != 1 else verdict}"


def _instruments(facts: Mapping[str, Fact], entries: Mapping[str, Entry]) -> list[str]:
    """Return what shows that no instrument has changed since its held-out facts were entered."""
    named = sorted({name for fact in facts.values() for name in fact.instruments})
    lines = [
        "**Instruments as they were when their facts were entered.** An instrument that has changed since spends its "
        f"held-out facts: they count as used, and `{COMMAND} NAME` enters it anew.",
        "",
        "| instrument | entered | SHA-256 of its values | since then |",
        "|---|---|---|---|",
    ]
    for name in named:
        entry = entries.get(name)
        if name not in shipped_presets():
            cells = ["–", "–", "no such instrument"]
        elif entry is None:
            cells = ["–", f"`{digest_of(values_of(name))[:12]}` now", "not entered yet"]
        else:
            now = values_of(name)
            later = f"new: {', '.join(entry.later(now))}" if entry.later(now) else "unchanged"
            since = markdown_text("; ".join(entry.changes(now)) or later)
            spent = markdown_text("".join(f"; {key} used since {why}" for key, why in entry.spent.items()))
            cells = [entry.entered, f"`{entry.digest[:12]}`", since + spent]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


def _section(item: Item, result: Result | None, fact: Fact | None) -> list[str]:
    lines = [f"## {item.title} {{#{item.key}}}", "", f"**Published:** {item.says}"]
    if fact is not None:
        lines += ["", f"**Source** ({fact.kind}): {'; '.join(map(_source, fact.sources))}."]
        lines += ["", f"**Interval:** {fact.published.why}."]
    lines += ["", f"**Here:** {item.how}", ""]
    if result is None:
        return [*lines, f"Not made yet: `{item.command}`."]
    if result.drawn:
        lines += [f"![{item.title}]({picture_of(item)})", ""]
    lines += ["| quantity | published | closed form | simulated | verdict |", "|---" * 5 + "|"]
    lines += [_row(row) for row in result.rows]
    return [*lines, "", f"**Why:** {item.differences}", "", f"`{item.command}`"]


def _row(row: Row) -> str:
    cells = [row.what, row.paper or "–", row.expected or "–", row.found, str(row.verdict)]
    return "| " + " | ".join(map(markdown_text, cells)) + " |"


def _source(source: Source) -> str:
    read = f"read on {source.read}" if source.read else "not read"
    return f"{source.of} ({', '.join(filter(None, (f'`{source.at}`' if source.at else '', read)))})"
