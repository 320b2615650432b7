"""A comparison as one page for a browser: everything is in the file, pictures too."""

from __future__ import annotations

import html
import math

from scanner_sim.foundation.errors import printable
from scanner_sim.products.comparison import CONFIDENCE, Check, Comparison, Finding
from scanner_sim.products.pictures.comparison import finding_picture

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #22262b; margin: 2.5rem auto; max-width: 68rem; padding: 0 1.2rem; }
h1 { font-size: 1.6rem; margin-bottom: .2rem; } h2 { font-size: 1.15rem; margin: 2.4rem 0 .2rem; }
p { max-width: 50rem; } .aside { color: #6b737c; }
.holds { color: #2b6f8f; } .broken { color: #b4331a; font-weight: 600; } .none { color: #6b737c; }
table { border-collapse: collapse; font-size: .82rem; margin: .6rem 0; } .wide { overflow-x: auto; }
th, td { padding: .22rem .6rem; text-align: right; border-bottom: 1px solid #e3e6e9; white-space: nowrap; }
th { color: #6b737c; font-weight: 600; } th:first-child, td:first-child { text-align: left; }
td.words { text-align: left; white-space: normal; }
img { max-width: 100%; } details { margin: 1rem 0; }
pre { font-size: .8rem; background: #f6f7f8; padding: .8rem; overflow: auto; }
a { color: inherit; }
"""
_LEGEND = (
    "Points: simulated less predicted, with {confidence:g} % intervals. Dark band: how far the closed form itself may "
    "be off. Light band: the smallest deviation that would have been found in 90 % of runs."
)


def escape(text: str) -> str:
    """Return a text as a page shows it to the letter; lines stay lines."""
    return html.escape(printable(text, lines=True))


def comparison_page(comparison: Comparison, scenario_yaml: str) -> str:
    """Return the page: verdicts of all laws, what differs from a baseline, then each law with picture and numbers.

    Parameters
    ----------
    comparison
        What was found.
    scenario_yaml
        The scenario, as it is written beside the page.
    """
    body = [
        "<h1>Simulation against closed forms</h1>",
        f"<p class='aside'>{escape(_about(comparison))}</p>",
        f"<p>{_verdict(comparison)}</p>",
        _overview(comparison),
        _changes(comparison),
        *(_law(finding) for finding in comparison.findings if finding.checks),
        f"<details><summary>Scenario</summary><pre>{escape(scenario_yaml)}</pre></details>",
    ]
    head = (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>Simulation against closed forms</title><style>{_STYLE}</style></head><body>\n"
    )
    return head + "\n".join(part for part in body if part) + "\n</body></html>\n"


def _about(comparison: Comparison) -> str:
    seeds = f"seed {comparison.seed}"
    if comparison.seeds > 1:
        seeds = f"seeds {comparison.seed} to {comparison.seed + comparison.seeds - 1}"
    effort = "a quarter of the shots, " if comparison.quick else ""
    made = ", ".join(f"{program} {number}" for program, number in comparison.versions.items())
    return f"{comparison.target}; {seeds}, {effort}family-wise level {comparison.level:g}. {made}."


def _verdict(comparison: Comparison) -> str:
    judged = sum(1 for finding in comparison.findings if finding.checks)
    checks = sum(len(finding.checks) for finding in comparison.findings)
    if comparison.broken:
        names = ", ".join(escape(finding.title) for finding in comparison.broken)
        return f"<span class='broken'>Broken: {names}.</span> {judged} laws, {checks} checks."
    power = escape(power_words(comparison))
    return f"<span class='holds'>All {judged} laws that apply hold</span>, in {checks} checks. {power}"


def _overview(comparison: Comparison) -> str:
    rows = []
    for finding in comparison.findings:
        kind = {"holds": "holds", "broken": "broken"}.get(finding.verdict, "none")
        if finding.checks:
            worst = worst_check(finding)
            link = f"<a href='#{finding.name}'>{escape(finding.title)}</a>"
            cells = f"<td>{len(finding.checks)}</td>{_numbers(worst)}"
        else:
            link = escape(finding.title)
            cells = f"<td class='words none' colspan='8'>{escape(finding.reason)}</td>"
        rows.append(f"<tr><td>{link}</td><td class='{kind}'>{finding.verdict}</td>{cells}</tr>")
    head = "".join(
        f"<th>{name}</th>"
        for name in (
            "law",
            "verdict",
            "checks",
            "predicted",
            "simulated",
            "interval",
            "deviation",
            "p",
            "90 %",
            "99 %",
        )
    )
    note = (
        "<p class='aside'>The numbers are those of a law's worst check; p is that of the whole family. The last two "
        "columns say which deviation would have been found with 90 % and 99 % probability.</p>"
    )
    return f"<div class='wide'><table><tr>{head}</tr>{''.join(rows)}</table></div>{note}"


def _law(finding: Finding) -> str:
    rows = "".join(
        f"<tr><td>{escape(check.case)}</td><td>{escape(check.quantity)}</td>{_numbers(check)}"
        f"<td class='{'broken' if check.broken else 'holds'}'>{'broken' if check.broken else 'holds'}</td></tr>"
        for check in finding.checks
    )
    names = (
        "case",
        "quantity",
        "predicted",
        "simulated",
        "interval",
        "deviation",
        "p",
        "90 %",
        "99 %",
        "verdict",
    )
    head = "".join(f"<th>{name}</th>" for name in names)
    return (
        f"<h2 id='{finding.name}'>{escape(finding.title)}</h2>"
        f"<p class='aside'>{escape(finding.source)} · {escape(finding.scene)} · <code>--only {finding.name}</code></p>"
        f"<p>{escape(finding.statement)}</p>"
        f"<img alt='{escape(finding.title)}' src='{finding_picture(finding)}'>"
        f"<p class='aside'>{_LEGEND.format(confidence=100.0 * CONFIDENCE)}</p>"
        f"<details><summary>Numbers</summary><div class='wide'><table><tr>{head}</tr>{rows}</table></div></details>"
    )


def _changes(comparison: Comparison) -> str:
    if comparison.baseline is None:
        return ""
    if not comparison.baseline:
        return "<p class='holds'>Nothing differs from the baseline.</p>"
    rows = "".join(
        f"<tr><td>{escape(change.law)}</td><td>{escape(change.case)}</td><td>{escape(change.what)}</td>"
        f"<td>{short(change.before)}</td><td>{short(change.now)}</td><td>{short(change.adjusted_p)}</td></tr>"
        for change in comparison.baseline
    )
    head = "".join(f"<th>{name}</th>" for name in ("law", "case", "what", "before", "now", "p"))
    return (
        "<h2 class='broken'>Different from the baseline</h2>"
        f"<div class='wide'><table><tr>{head}</tr>{rows}</table></div>"
    )


def _numbers(check: Check) -> str:
    """Return the cells of a check's numbers."""
    unit = f" {escape(check.unit)}" if check.unit else ""
    interval = "no noise" if check.form == "exact" else f"{short(check.low)} … {short(check.high)}"
    return (
        f"<td>{short(check.predicted)}{unit}</td><td>{short(check.simulated)}</td><td>{interval}</td>"
        f"<td>{percent(check)}</td><td>{short(check.adjusted_p, 2)}</td>"
        f"<td>{share(check.detects_90)}</td><td>{share(check.detects_99)}</td>"
    )


def worst_check(finding: Finding) -> Check:
    """Return the check that is least probable, and among equals the one with the largest share of what is found."""
    return min(
        finding.checks,
        key=lambda check: (check.adjusted_p, check.p, -abs(check.effect) / max(check.detects_90, 1e-300)),
    )


def power_of(finding: Finding) -> tuple[float, float]:
    """Return the smallest relative deviations that are found in any check of a law with 90 % and 99 % probability."""
    return max(check.detects_90 for check in finding.checks), max(
        check.detects_99 for check in finding.checks
    )


def power_words(comparison: Comparison) -> str:
    """Return in words what a comparison can detect; empty where no law has noise in it."""
    noisy = [
        (power_of(finding)[0], finding.name)
        for finding in comparison.findings
        if any(check.form != "exact" for check in finding.checks)
    ]
    if not noisy:
        return ""
    (least, sharp), (most, blunt) = min(noisy), max(noisy)
    words = (
        f"Of laws with noise, {sharp} finds {share(least)} with 90 % probability, {blunt} only {share(most)}"
    )
    if comparison.quick:
        words += (
            "; without --quick, from four times the shots, half of that but for what closed forms leave out"
        )
    return words + ". Smaller deviations pass unseen."


def percent(check: Check) -> str:
    """Return a check's relative deviation in words, of one in plain numbers."""
    if check.relative_to == "one":
        return f"{check.effect:+.2g}"
    return f"{100.0 * check.effect:+.2g} %"


def share(value: float) -> str:
    """Return a share in per cent."""
    return f"{100.0 * value:.2g} %"


def short(value: float, digits: int = 4) -> str:
    """Return a number with few digits; a dash where there is none."""
    return "–" if math.isnan(value) else f"{value:.{digits}g}"
