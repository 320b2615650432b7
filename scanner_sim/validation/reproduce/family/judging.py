"""How a simulated number stands to a published one: intervals, and nothing else, decide."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from scanner_sim.validation.reproduce.family.ledger import Published
from scanner_sim.validation.reproduce.item import Row, Verdict

REACH = 3.0
"""Standard errors to each side of a simulated number: among thirty true facts one is missed once in twelve ledgers."""


@dataclass(frozen=True)
class Finding:
    """A simulated number and its standard error, in the unit of the fact; infinite where no end was found."""

    value: float
    error: float

    @property
    def ends(self) -> tuple[float, float]:
        """The interval."""
        return self.value - REACH * self.error, self.value + REACH * self.error

    def text(self, unit: str) -> str:
        """Return the number with its interval, as precise as it is."""
        if not math.isfinite(self.value):
            return "beyond all that was tried" if self.value > 0.0 else "none"
        reach = REACH * self.error
        digits = 2 if reach <= 0.0 else 1 - math.floor(math.log10(reach))
        if reach <= 0.0 or digits > 6:
            return f"{self.value:.3g} {unit}".strip()
        shown = max(digits, 0)
        return f"{self.value:.{shown}f} ± {reach:.{shown}f} {unit}".strip()


@dataclass(frozen=True)
class Measured:
    """What an experiment has found.

    Attributes
    ----------
    finding
        The number that is judged.
    expected
        The same by a closed form; empty where there is none.
    rows
        Comparisons beside it.
    draw
        Draws its picture to a path; None for none.
    """

    finding: Finding
    expected: str = ""
    rows: tuple[Row, ...] = ()
    draw: Callable[[Path], None] | None = None


def standing(published: Published, finding: Finding) -> Verdict:
    """Return whether both intervals meet.

    Where they do, the simulated one must not be wider than the published one, or than the bound where there is only
    one: an interval that meets everything bears nothing out. A number that is none misses.
    """
    low = -math.inf if published.at_least is None else published.at_least
    high = math.inf if published.at_most is None else published.at_most
    least, most = finding.ends
    if not (least <= high and most >= low):
        return Verdict.DIFFERS
    scale = high - low if math.isfinite(high - low) else abs(high if math.isfinite(high) else low)
    if most - least > scale:
        return Verdict.NOT_JUDGED
    return Verdict.ALIKE if published.ours else Verdict.AGREES


def judged(published: Published, finding: Finding, *, used: bool) -> Verdict:
    """Return the same, but for a fact that set a default: what agrees with it does so by construction."""
    verdict = standing(published, finding)
    return Verdict.CHOSEN if used and verdict in (Verdict.AGREES, Verdict.ALIKE) else verdict


def published_text(published: Published) -> str:
    """Return a published number with its interval."""
    low, high, unit = published.at_least, published.at_most, published.unit
    if low is None:
        ends = f"at most {high:g}"
    elif high is None:
        ends = f"at least {low:g}"
    else:
        ends = f"{low:g} to {high:g}"
    return f"{published.says} [{ends}{f' {unit}' if unit else ''}]"
