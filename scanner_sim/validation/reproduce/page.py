"""The page of validation: every item with its picture, what the paper says, and what was found."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from scanner_sim.foundation.errors import printable
from scanner_sim.products.provenance import PROGRAMS, in_order, software
from scanner_sim.validation.reproduce.item import Item, Verdict
from scanner_sim.validation.reproduce.results import Result, picture_of

PAGE = "index.md"
"""The page of the paper's items."""

HEADING = "# Validation: the paper, made again\n\nWritten by `scanner-sim reproduce` from simulated data."
"""How it begins: by this it is known."""

VERDICTS = (Verdict.AGREES, Verdict.DIFFERS, Verdict.ALIKE, Verdict.CHOSEN, Verdict.UNPRINTED)
"""The verdicts that it has."""

_INTRODUCTION = f"""\
{HEADING} For each equation, table and figure of F. Blais, J.-A. Beraldin,
S. F. El-Hakim, *Range Error Analysis of an Integrated Time-of-Flight, Triangulation, and Photogrammetric 3D Laser
Scanning System*, 2000: what the paper says, what was found, and where they differ and why. *Expected* is the equation
as it is meant, or a closed form of `scanner_sim/analytic`, which shares no physics code with the simulator. What others
have published of such instruments stands in the [ledger of published facts](family.md).

| verdict | means |
|---|---|
| agrees | what was found bears out the paper, from both sides, within the simulation's noise or the digits printed |
| differs | it does not, be it worse or better than printed; the reason stands below the table |
| alike in kind | the paper has words or a picture here; what was found is of that kind, by a bound of our own |
| by construction | it follows from numbers that were chosen from the paper, and hence is no agreement |
| not printed | the paper has no number here; what was found agrees with the closed form |

Base, axis separation, aperture, bandwidth, reflectances, Δp and the time-of-flight unit are printed nowhere, and the
figures carry no numbers that could be read here: what can be compared are laws, that is slopes, crossings and ratios.
"""


def page(items: Sequence[Item], results: Mapping[str, Result]) -> str:
    """Return the page of some items, in Markdown; items without a result say how to make them."""
    lines = [_INTRODUCTION]
    if results:
        lines += [provenance(list(results.values())), ""]
    lines += [f"| item | {' | '.join(VERDICTS)} |", "|---" * (1 + len(VERDICTS)) + "|"]
    for item in items:
        result = results.get(item.key)
        counts = (
            ["not made yet", *[""] * (len(VERDICTS) - 1)]
            if result is None
            else [str(result.count(verdict) or "–") for verdict in VERDICTS]
        )
        lines.append(f"| [{item.title}](#{item.key}) | {' | '.join(counts)} |")
    for item in items:
        lines += ["", *_section(item, results.get(item.key))]
    return "\n".join(lines) + "\n"


def provenance(results: Sequence[Result]) -> str:
    """Return when, with which seeds and with which programs results were made, in a sentence."""
    dates = sorted({markdown_text(result.date) for result in results})
    span = dates[0] if len(dates) == 1 else f"{dates[0]} to {dates[-1]}"
    programs = ({name: result.made_by.get(name, "?") for name in PROGRAMS} for result in results)
    made = " and with ".join(dict.fromkeys(markdown_text(software(in_order(one))) for one in programs))
    seeds = ", ".join(str(seed) for seed in sorted({result.seed for result in results}))
    quick = sum(result.quick for result in results)
    short = f" {quick} of the items were made with `--quick`." if quick else ""
    return f"Made on {span}, seed {seeds}, with {made}.{short}"


def _section(item: Item, result: Result | None) -> list[str]:
    lines = [
        f"## {item.title} {{#{item.key}}}",
        "",
        f"**The paper:** {item.says}",
        "",
        f"**Here:** {item.how}",
        "",
    ]
    if result is None:
        return [*lines, f"Not made yet: `{item.command}`."]
    lines += [f"![{item.title}]({picture_of(item)})", ""]
    lines += ["| quantity | paper | expected | found | verdict |", "|---|---|---|---|---|"]
    for row in result.rows:
        cells = [row.what, row.paper or "–", row.expected or "–", row.found, str(row.verdict)]
        lines.append("| " + " | ".join(map(markdown_text, cells)) + " |")
    lines += ["", f"**Differences:** {item.differences}", "", f"`{item.command}`"]
    return [*lines, "", f"The same by other verbs: {item.also}"] if item.also else lines


def markdown_text(text: str) -> str:
    """Return a text as a page shows it to the letter: no tags, links, pictures, code or cells come of it."""
    return re.sub(
        r"[\\`|<>&!]|\](?=[(\[])", lambda found: _SPELT.get(found[0], "\\" + found[0]), printable(text)
    )


_SPELT = {"<": "&lt;", ">": "&gt;", "&": "&amp;"}
