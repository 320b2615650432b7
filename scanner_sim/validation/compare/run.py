"""The whole comparison: each law that applies is measured, and all of them are judged as one family."""

from __future__ import annotations

from collections.abc import Callable, Collection

from scanner_sim.foundation.errors import InputError
from scanner_sim.products.comparison import Comparison, Finding
from scanner_sim.products.provenance import versions
from scanner_sim.render.guest import guest
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup, law_name
from scanner_sim.validation.compare.judge import judge_checks
from scanner_sim.validation.compare.law import Law
from scanner_sim.validation.compare.laws import LAWS

LEVEL = 1e-3
"""Probability with which a right program breaks any law, by default."""

Progress = Callable[[int, int], None]
Say = Callable[[str], None]


def chosen_laws(names: Collection[str]) -> tuple[Law, ...]:
    """Return the laws of some names, or all of them where there are none, in their order.

    Raises
    ------
    InputError
        For a name that no law has.
    """
    wanted = {law_name(name) for name in names}
    known = {law.name: law for law in LAWS}
    strangers = sorted(wanted - known.keys())
    if strangers:
        raise InputError(f"there is no law called {strangers[0]}.", remedy=f"There are: {', '.join(known)}.")
    return tuple(law for law in LAWS if not wanted or law.name in wanted)


@guest()
def compare(
    setting: ComparisonSetup,
    *,
    only: Collection[str] = (),
    level: float = LEVEL,
    progress: Progress | None = None,
    say: Say | None = None,
) -> Comparison:
    """Measure and judge the laws of a setting.

    Parameters
    ----------
    setting
        Instrument, scene or targets, effort.
    only
        Names of the laws to judge; none for all.
    level
        Probability with which a right program breaks any of them, 0 to 1.
    progress, say
        Called with the laws done and the laws in all; and with what is done now.

    Returns
    -------
    Comparison
        Without a baseline. The same setting gives the same numbers.

    Raises
    ------
    InputError
        For a name that no law has, a level that is none, or targets that the instrument cannot see.
    """
    if not 0.0 < level < 1.0:
        raise InputError(
            f"a level of {level:g} is not between 0 and 1.", remedy="Write for example --level 0.001."
        )
    laws = chosen_laws(only)
    cases, reasons = [], {}
    for number, law in enumerate(laws):
        if progress is not None:
            progress(number, len(laws))
        if say is not None:
            say(law.title)
        reasons[law.name] = law.applies(setting)
        if not reasons[law.name]:
            measured, predicted = law.measure(setting), law.predict(setting)
            reasons[law.name] = "" if measured else law.nothing
            cases += [(law.name, case, measured[case], predicted[case]) for case in measured]
    checks = judge_checks([(case, found, expected) for _, case, found, expected in cases], level)
    findings = tuple(
        Finding(
            law.name,
            law.title,
            law.source,
            law.statement,
            _scene(law, setting),
            reasons[law.name],
            tuple(check for (name, *_), check in zip(cases, checks, strict=True) if name == law.name),
        )
        for law in laws
    )
    target = f"flat targets of {setting.flat}" if setting.target else "own scene"
    return Comparison(
        setting.scenario.seed, setting.seeds, level, setting.quick, target, findings, dict(versions())
    )


def _scene(law: Law, setting: ComparisonSetup) -> str:
    match law.scene:
        case "signals":
            return "noise put onto signals"
        case "scene" if setting.own_scene:
            return "the scenario's own scene"
        case "scene":
            return f"planes, {setting.flat}"
        case _:
            return f"flat targets, {setting.flat}"
