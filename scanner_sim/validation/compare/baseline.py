"""Comparison with an earlier comparison: byte for byte with the same seed, by statistics with another."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.named_files import read_text_file
from scanner_sim.products.comparison import Change, Check, Comparison, comparison_from_json
from scanner_sim.validation.compare.judge import holm, same
from scanner_sim.validation.compare.law import Measured

_PREDICTION = 1e-9
"""Relative change of a prediction that is no rounding."""


def read_baseline(path: str | Path) -> Comparison:
    """Return the comparison of a ``compare.json``.

    Raises
    ------
    InputError
        If the file cannot be read, or is none.
    """
    remedy = "Name the compare.json that scanner-sim compare wrote."
    text = read_text_file(Path(path))
    try:
        return comparison_from_json(text)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InputError(f"{path} is no comparison.", remedy=remedy) from None


def against(now: Comparison, before: Comparison) -> Comparison:
    """Return a comparison with what differs from an earlier one.

    Parameters
    ----------
    now, before
        Only laws that both have are compared, so that one law can be tried alone.

    Returns
    -------
    Comparison
        With the same seed, number of seeds and effort every number must be the same, bit for bit. Otherwise predictions
        must agree to rounding, numbers without noise to the accuracy of their closed form, and measured ones in
        statistics: Welch's t for means, Fisher's F for standard deviations, Holm's procedure at the
        level of ``now``. A check that only one of them has is a difference too.
    """
    repeated = (now.seed, now.seeds, now.quick) == (before.seed, before.seeds, before.quick)
    earlier = {finding.name: finding for finding in before.findings}
    changes: list[Change] = []
    random: list[tuple[str, Check, Check]] = []
    for finding in now.findings:
        if finding.name not in earlier:
            continue
        old = {check.case: check for check in earlier[finding.name].checks}
        new = {check.case: check for check in finding.checks}
        for case in [*old, *(case for case in new if case not in old)]:
            if case not in old or case not in new:
                one = new.get(case) or old[case]
                what = "new check" if case in new else "check is gone"
                changes.append(Change(finding.name, case, one.quantity, what, math.nan, math.nan, 0.0))
                continue
            was, found = old[case], new[case]
            if repeated:
                changes += _unequal(finding.name, was, found)
                continue
            if not math.isclose(was.predicted, found.predicted, rel_tol=_PREDICTION, abs_tol=1e-300):
                changes.append(
                    _change(finding.name, was, found, "prediction", was.predicted, found.predicted, 0.0)
                )
            random.append((finding.name, was, found))
    probabilities = holm([same(_measured(found), _measured(was), found.accuracy) for _, was, found in random])
    for (law, was, found), p in zip(random, probabilities, strict=True):
        if p < now.level:
            changes.append(_change(law, was, found, "simulated", was.simulated, found.simulated, p))
    return dataclasses.replace(now, baseline=tuple(changes))


def _unequal(law: str, was: Check, found: Check) -> list[Change]:
    """Return the numbers of a check that are not the same, bit for bit."""
    return [
        _change(law, was, found, what, getattr(was, name), getattr(found, name), 0.0)
        for what, name in (
            ("prediction", "predicted"),
            ("simulated", "simulated"),
            ("standard error", "error"),
        )
        if getattr(was, name) != getattr(found, name)
        and not (math.isnan(getattr(was, name)) and math.isnan(getattr(found, name)))
    ]


def _change(law: str, was: Check, found: Check, what: str, before: float, now: float, p: float) -> Change:
    return Change(law, found.case, was.quantity, what, before, now, p)


def _measured(check: Check) -> Measured:
    return Measured(check.form, check.simulated, check.error, check.freedom)
