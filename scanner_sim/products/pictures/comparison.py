"""Pictures of a comparison: every check of every law against its closed form, on one sheet or law by law."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from scanner_sim.foundation.html_text import png_address
from scanner_sim.products.comparison import CONFIDENCE, Check, Comparison, Finding
from scanner_sim.products.pictures.style import FAINT, INK, drawing

HOLDS, BROKEN, NEUTRAL = "#2b6f8f", "#b4331a", "#cfd6db"
"""Colours of what holds, of what is broken, and of the accuracy of a closed form."""
_OTHERS = "#a8b0b7"
"""Colour of laws that say nothing about an estimator of the user's own."""
_POINT = 2.6


def draw_comparison(comparison: Comparison, path: str | Path) -> None:
    """Draw for each law the deviation of every check from its prediction, in units of what would have been found.

    1 is the deviation that breaks the law in 90 % of runs; so laws of any kind and unit share one axis.
    """
    judged = [finding for finding in comparison.findings if finding.checks]
    with drawing(path, (7.4, 1.3 + 0.26 * max(len(judged), 1)), layout="constrained") as figure:
        axes = figure.subplots()
        axes.axvspan(-1.0, 1.0, color="#f2f4f5", lw=0)
        axes.axvline(0.0, color=FAINT, lw=0.6)
        for row, finding in enumerate(judged):
            for number, check in enumerate(finding.checks):
                spread = 0.5 * (number + 0.5) / len(finding.checks) - 0.25
                away, low, high = _scaled(check)
                colour = _OTHERS if finding.name in comparison.unjudging else HOLDS
                colour = BROKEN if check.broken else colour
                if high > low:
                    axes.plot([low, high], [row + spread] * 2, color=colour, lw=0.7)
                axes.plot(away, row + spread, "o", color=colour, ms=_POINT)
        axes.set_yticks(range(len(judged)), [finding.title for finding in judged])
        axes.set_ylim(len(judged) - 0.4, -0.6)
        axes.set_xlim(-1.04 * _WIDEST, 1.04 * _WIDEST)
        label = "deviation over the smallest that is found in 90 % of runs"
        if comparison.unjudging:
            label += f"\ngrey: laws that say nothing about {' and '.join(comparison.own_estimators)}"
        axes.set_xlabel(label)
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.tick_params(axis="y", length=0)
        verdict = "all laws hold" if not comparison.broken else f"{len(comparison.broken)} broken"
        axes.set_title(
            f"Simulation against closed forms: {verdict}", loc="left", weight="bold", size=10.5, pad=16
        )
        count = sum(len(finding.checks) for finding in judged)
        about = f"{len(judged)} laws, {count} checks, family-wise level {comparison.level:g}  ·  "
        about += f"bars: {100.0 * CONFIDENCE:g} % intervals"
        axes.text(0.0, 1.01, about, transform=axes.transAxes, color=FAINT, va="bottom")


_WIDEST = 2.0


def _scaled(check: Check) -> tuple[float, float, float]:
    """Return deviation and interval in units of what is found in 90 % of runs, no farther than the edge."""
    unit = check.detects_90 * check.scale
    if unit <= 0.0 or not math.isfinite(unit):
        return (_WIDEST if check.broken else 0.0,) * 3
    ends = ((value - check.predicted) / unit for value in (check.simulated, check.low, check.high))
    away, low, high = (float(np.clip(end, -_WIDEST, _WIDEST)) for end in ends)
    return away, low, high


def finding_picture(finding: Finding) -> str:
    """Return a picture of a law's checks as a PNG in the text form of a web page's address.

    Deviations with intervals over the accuracy of the closed form (dark) and what would have been found (light); beside
    them, where a law holds at several ranges, simulated numbers and the line of their predictions in logarithms.
    """
    checks, ranged = finding.checks, _ranged(finding)
    height = 0.8 + 0.19 * max(len(checks), 8 if ranged else 0)
    target = io.BytesIO()
    with drawing(target, (8.2, height), dpi=130, layout="constrained") as figure:
        axes = figure.subplots(1, 2, width_ratios=(1.0, 1.6)) if ranged else [figure.subplots()]
        if ranged:
            _draw_ranges(axes[0], ranged)
        unit, times = _unit(finding)
        for row, check in enumerate(checks):
            _draw_check(axes[-1], row, check, times)
        axes[-1].axvline(0.0, color=FAINT, lw=0.6)
        axes[-1].set_yticks(range(len(checks)), [check.case for check in checks])
        axes[-1].set_ylim(len(checks) - 0.4, -0.6)
        axes[-1].set_xlabel(_axis(finding, unit))
        axes[-1].ticklabel_format(axis="x", style="plain", useOffset=False)
        axes[-1].spines[["top", "right", "left"]].set_visible(False)
        axes[-1].tick_params(axis="y", length=0)
    return png_address(target.getvalue())


def _unit(finding: Finding) -> tuple[str, float]:
    """Return the unit of a picture's deviations and how many of it make one: millionths where all are tiny."""
    widest = max(max(abs(check.effect), check.detects_90) for check in finding.checks)
    return ("millionths", 1e6) if widest < 1e-4 else ("%", 100.0)


def _axis(finding: Finding, unit: str) -> str:
    named = {check.relative_to for check in finding.checks}
    if named == {"prediction"}:
        return f"relative deviation [{unit}]"
    if named <= {"prediction", "one"}:
        return f"relative deviation [{unit}]; of exponents and shares: the deviation itself"
    return f"deviation over the {' or '.join(sorted(named))} [{unit}]"


def _ranged(finding: Finding) -> list[tuple[float, Check]]:
    """Return a law's checks at ranges on the axis with those ranges [m], if there are three of them or more."""
    found = []
    for check in finding.checks:
        distance, _, unit = check.case.partition(" ")
        if unit == "m" and check.predicted > 0.0:
            found.append((float(distance), check))
    return found if len(found) > 2 else []


def _draw_ranges(axes: Axes, ranged: list[tuple[float, Check]]) -> None:
    """Draw simulated numbers against range, and the line of the predictions."""
    x = [distance for distance, _ in ranged]
    axes.plot(x, [check.predicted for _, check in ranged], color=FAINT, lw=1.0)
    for distance, check in ranged:
        colour = BROKEN if check.broken else HOLDS
        axes.plot([distance] * 2, [check.low, check.high], color=colour, lw=1.0)
        axes.plot(distance, check.simulated, "o", color=colour, ms=3.5)
    axes.set(xscale="log", yscale="log", xlabel="range [m]")
    first = ranged[0][1]
    axes.set_ylabel(f"{first.quantity} [{first.unit}]" if first.unit else first.quantity)
    ticks = [tick for tick in (1, 2, 3, 5, 10, 20, 30, 50, 100) if min(x) <= tick <= max(x)]
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.set_xticks([], minor=True)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_check(axes: Axes, row: int, check: Check, times: float) -> None:
    """Draw the accuracy of the prediction, what would be found, and what was, in units of which one has ``times``."""
    scale = times / check.scale if check.scale else times
    colour = BROKEN if check.broken else HOLDS
    found, accuracy = times * check.detects_90, check.accuracy * scale
    axes.barh(row, 2.0 * found, left=-found, height=0.62, color="#f0f2f4", lw=0)
    axes.barh(row, 2.0 * accuracy, left=-accuracy, height=0.62, color=NEUTRAL, lw=0)
    ends = np.array([check.low, check.high]) - check.predicted
    axes.plot(ends * scale, [row, row], color=colour, lw=1.0)
    axes.plot((check.simulated - check.predicted) * scale, row, "o", color=colour, ms=3.0, mec=INK, mew=0.2)
