"""A comparison of a simulation with closed forms as a product: checks, laws, changes, and the folder of files."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from pydantic import TypeAdapter

from scanner_sim.products.json_text import json_text

CONFIDENCE = 0.95
"""Confidence of the intervals; verdicts have a level of their own."""

_BEYOND = 1e75
"""Numbers whose fourth powers leave float64 were not found by a simulation."""

Form = Literal["exact", "mean", "spread"]
"""What is compared: a number without noise, a mean, or a standard deviation."""
Verdict = Literal["holds", "broken", "does not apply"]
Exercises = Literal["light", "peak", "pulse", "built-in", "targets", ""]
"""What a law's measurement goes through: light alone, before any estimator; the scenario's estimator of the peak, or of
the pulse; one of the program's, whatever the scenario's; the tracking of given signals. Empty where nobody has said."""

_BESIDE = {
    "light": "judges light, before any estimator",
    "built-in": "judges the built-in estimator only",
    "targets": "judges the tracking of given signals",
}


@dataclass(frozen=True)
class Check:
    """One number of a law: predicted by its closed form, and simulated.

    Attributes
    ----------
    case, quantity, unit
        Where it was measured, what it is, and its unit (empty for a pure number).
    form
        A number without noise, a mean or a standard deviation.
    predicted, accuracy
        By the closed form, and how far that may be off by its own neglected orders.
    simulated, error, freedom
        What was found; standard error and degrees of freedom (0 and infinity where there is no noise in it).
    low, high
        95 % confidence interval of the simulated number.
    effect, scale, relative_to
        (simulated − predicted) over ``scale``, which is the prediction, or what ``relative_to`` names.
    p
        Probability of a deviation at least as large if the law holds.
    adjusted_p
        The same for the whole family of checks (Holm); below the level the law is broken.
    detects_90, detects_99
        Smallest relative deviation that would have broken the law with 90 % and 99 % probability.
    broken
        The verdict.
    """

    case: str
    quantity: str
    unit: str
    form: Form
    predicted: float
    accuracy: float
    simulated: float
    error: float
    freedom: float
    low: float
    high: float
    effect: float
    scale: float
    relative_to: str
    p: float
    adjusted_p: float
    detects_90: float
    detects_99: float
    broken: bool


@dataclass(frozen=True)
class Finding:
    """What was found about one law: its checks, or the reason why it does not apply."""

    name: str
    title: str
    source: str
    statement: str
    scene: str
    reason: str
    checks: tuple[Check, ...]
    exercises: Exercises = ""

    @property
    def verdict(self) -> Verdict:
        """Broken where one check is; does not apply where there is none."""
        if not self.checks:
            return "does not apply"
        return "broken" if any(check.broken for check in self.checks) else "holds"


@dataclass(frozen=True)
class Change:
    """A number that differs from an earlier comparison: before, now, and the probability of such a difference."""

    law: str
    case: str
    quantity: str
    what: str
    before: float
    now: float
    adjusted_p: float


@dataclass(frozen=True)
class Comparison:
    """A whole comparison.

    Attributes
    ----------
    seed, seeds
        Seed of the first run, and how many consecutive ones were pooled.
    level
        Probability with which a right program breaks any law at all.
    quick
        Whether fewer shots were taken.
    target
        The flat target in words, or the scenario's own scene.
    findings
        Of all laws, in their order.
    versions
        Of the programs.
    baseline
        Differences from an earlier comparison; None where there was none to compare with.
    own
        Names of the scenario's estimators that are the user's own, by ``peak`` and ``pulse``; empty where they are not.
    """

    seed: int
    seeds: int
    level: float
    quick: bool
    target: str
    findings: tuple[Finding, ...]
    versions: dict[str, str]
    baseline: tuple[Change, ...] | None = None
    own: dict[str, str] = field(default_factory=dict)

    @property
    def own_estimators(self) -> tuple[str, ...]:
        """Names of the scenario's estimators that are the user's own."""
        return tuple(name for name in self.own.values() if name)

    @property
    def unjudging(self) -> dict[str, str]:
        """Which laws say nothing about the user's own estimators, by name, and why; empty where there are none."""
        if not self.own_estimators:
            return {}
        found = {}
        for finding in self.findings:
            if not finding.checks:
                found[finding.name] = f"does not apply: {finding.reason}"
            elif finding.exercises in _BESIDE:
                found[finding.name] = _BESIDE[finding.exercises]
            elif not self.own.get(finding.exercises, ""):
                found[finding.name] = f"judges the {finding.exercises} estimator, which is the program's"
        return found

    @property
    def broken(self) -> tuple[Finding, ...]:
        """The laws that are broken."""
        return tuple(finding for finding in self.findings if finding.verdict == "broken")

    @property
    def passed(self) -> bool:
        """Whether no law is broken and nothing differs from the baseline."""
        return not self.broken and not self.baseline


def comparison_json(comparison: Comparison) -> str:
    """Return a comparison as JSON: all numbers in full, null for what is not finite; no date, host or path."""
    content = asdict(comparison)
    for finding, plain in zip(comparison.findings, content["findings"], strict=True):
        plain["verdict"] = finding.verdict
    content["passed"] = comparison.passed
    return json_text(content, indent=1)


def comparison_from_json(text: str) -> Comparison:
    """Return the comparison of :func:`comparison_json`.

    Raises
    ------
    ValueError, KeyError, TypeError, AttributeError, RecursionError
        If the text is not one.
    """
    content: dict[str, Any] = json.loads(text)
    findings = []
    for plain in content["findings"]:
        plain = {name: value for name, value in plain.items() if name != "verdict"}
        findings.append(plain | {"checks": [_numbers(check) for check in plain["checks"]]})
    rest = {name: content[name] for name in ("seed", "seeds", "level", "quick", "target", "versions")}
    rest["own"] = content.get("own", {})
    read = TypeAdapter(Comparison).validate_python({"findings": findings, **rest})
    for check in (check for finding in read.findings for check in finding.checks):
        if check.error < 0.0 or not check.freedom > 0.0 or max(map(abs, _finite_numbers(check))) > _BEYOND:
            raise ValueError(f"{check.case} has numbers that no comparison has")
    return read


def _finite_numbers(check: Check) -> list[float]:
    """Return the finite numbers that a later comparison computes with."""
    numbers = (check.predicted, check.accuracy, check.simulated, check.error)
    return [number for number in numbers if math.isfinite(number)] or [0.0]


def _numbers(check: dict[str, Any]) -> dict[str, Any]:
    """Return a check with infinity for the only number that may be missing: degrees of freedom."""
    infinite = {"freedom": math.inf} if check["freedom"] is None else {}
    return {name: math.nan if value is None else value for name, value in check.items()} | infinite
