"""A comparison as one page for a browser: everything is in the file, pictures too."""

from __future__ import annotations

import math
from pathlib import Path

from scanner_sim.products.comparison import CONFIDENCE, Check, Comparison, Finding
from scanner_sim.products.page_template import page_template
from scanner_sim.products.pictures.comparison import finding_picture


def comparison_page(comparison: Comparison, scenario_yaml: str) -> str:
    """Return the page: verdicts of all laws, what differs from a baseline, then each law with picture and numbers.

    Parameters
    ----------
    comparison
        What was found.
    scenario_yaml
        The scenario, as it is written beside the page.
    """
    judged = [finding for finding in comparison.findings if finding.checks]
    template = page_template(
        Path(__file__).with_name("comparison_page.html"),
        short=short,
        share=share,
        percent=percent,
        worst=worst_check,
        picture=finding_picture,
        caption=caption,
    )
    return template.render(
        comparison=comparison,
        judged=judged,
        checks=sum(len(finding.checks) for finding in judged),
        power=power_words(comparison),
        confidence=100.0 * CONFIDENCE,
        scenario_yaml=scenario_yaml,
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


def caption(finding: Finding, confidence: float) -> str:
    """Return in words what the picture of a law shows: only what is drawn there."""
    dark = "Dark band: how far the closed form itself may be off"
    if all(check.form == "exact" for check in finding.checks):
        return f"Points: simulated less predicted, without noise. {dark}; a point beyond it breaks the law."
    words = [f"Points: simulated less predicted, with {confidence:g} % intervals."]
    if any(check.accuracy > 0.0 for check in finding.checks):
        words.append(f"{dark}.")
    words.append("Light band: the smallest deviation that would have been found in 90 % of runs.")
    return " ".join(words)


def percent(check: Check) -> str:
    """Return a check's relative deviation in words, of one in plain numbers."""
    if check.relative_to == "one":
        return f"{check.effect:+.2g}"
    return f"{100.0 * check.effect:+.2g} %"


def share(value: float) -> str:
    """Return a share in per cent."""
    return f"{100.0 * value:.0f} %" if value >= 1.0 else f"{100.0 * value:.2g} %"


def short(value: float, digits: int = 4) -> str:
    """Return a number with few digits; a dash where there is none."""
    return "–" if math.isnan(value) else f"{value:.{digits}g}"
