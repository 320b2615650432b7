"""The whole comparison: each law that applies is measured, and all of them are judged as one family."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.products.comparison import Comparison, Finding
from scanner_sim.products.provenance import versions
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.validation.compare.closed_forms import EstimatorForms
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup, FlatTarget, law_name
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


def compare(
    scenario: Scenario,
    *,
    target: str | None = None,
    only: Collection[str] = (),
    seeds: int = 1,
    level: float = LEVEL,
    quick: bool = False,
    closed_forms: Mapping[str, Callable[..., float]] | None = None,
    device: DeviceChoice = "auto",
) -> Comparison:
    """Judge the simulation of a scenario's instrument by closed forms, law by law, as ``scanner-sim compare`` does.

    Parameters
    ----------
    scenario
        Instrument, processing and scene.
    target
        Flat targets instead of the scene, as ``"50 % at 3 m, 10 m"``.
    only
        Names of the laws to judge; none for all.
    seeds
        Number of consecutive seeds whose samples are pooled.
    level
        Probability with which a right program breaks any of them, 0 to 1.
    quick
        Whether to take a quarter of the shots.
    closed_forms
        Of an estimator of the peak that is your own: functions by the names ``position`` and ``sigma``, see
        :class:`~scanner_sim.validation.compare.closed_forms.EstimatorForms`. Laws that need what is not given do not
        apply.
    device
        Where to compute.

    Returns
    -------
    Comparison
        Its ``findings`` hold a verdict and checks for each law, ``unjudging`` the laws that say nothing about
        estimators of your own.

    Raises
    ------
    InputError
        As :func:`judge_laws`; and for a target or a closed form that is none.
    """
    flat = None if target is None else FlatTarget.parse(target)
    forms = EstimatorForms.of(closed_forms or {})
    setting = ComparisonSetup(scenario, flat, seeds, quick, device, forms)
    return judge_laws(setting, only=only, level=level)


@guest()
def judge_laws(
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
        reasons[law.name] = (
            _unlike(law, setting) or _without(law, setting) or _formless(law, setting) or law.applies(setting)
        )
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
            law.exercises,
        )
        for law in laws
    )
    target = f"flat targets of {setting.flat}" if setting.target else "own scene"
    return Comparison(
        setting.scenario.seed,
        setting.seeds,
        level,
        setting.quick,
        target,
        findings,
        dict(versions()),
        own={"peak": setting.own_peak, "pulse": setting.own_pulse},
    )


def _unlike(law: Law, setting: ComparisonSetup) -> str:
    """Return why a law does not speak of the instrument as it is built and believed; empty where it does."""
    own = setting.scenario
    if law.of_built or (own.scanner.as_built is None and own.processing.calibration is None):
        return ""
    return "it is of an instrument as designed: leave scanner.as_built and processing.calibration out"


def _without(law: Law, setting: ComparisonSetup) -> str:
    """Return which detector a law lacks; empty where it lacks none."""
    if law.rangefinder is None or law.rangefinder in setting.scenario.scanner.rangefinders:
        return ""
    part = "position sensor" if law.rangefinder == "triangulation" else "time-of-flight unit"
    return f"the instrument has no {part}"


def _formless(law: Law, setting: ComparisonSetup) -> str:
    """Return which closed form of the user's own estimator a law lacks; empty where it lacks none."""
    missing = [name for name in law.needs if setting.own_peak and not setting.closed_forms.has(name)]
    if not missing:
        return ""
    return f"no closed form is given of {setting.own_peak}'s {missing[0]}: closed_forms={{'{missing[0]}': function}}"


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
