"""Tracking runs from scenarios, as a whole: one, or several side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.closed_loop.start import start_of
from scanner_sim.instrument.closed_loop.visits import Visits
from scanner_sim.instrument.closed_loop.whole_track import track_of
from scanner_sim.instrument.memory import check_patterns
from scanner_sim.instrument.together import own_instrument
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.tracking.record import PatternRecord, Track

Progress = Callable[[float, float], None]
"""Called with the time that is done and the time in all [s]."""


def track(
    scenario: Scenario,
    *,
    device: DeviceChoice = "auto",
    threads: int | None = None,
    progress: Progress | None = None,
) -> Track:
    """Follow the targets of a scenario for the time that it says: :func:`track_many` of one run.

    Parameters
    ----------
    scenario
        Instrument, scene and a scan of type ``track``.
    device, threads
        Where to compute; the result does not depend on the threads.
    progress
        Called after each visit.

    Returns
    -------
    Track

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the device cannot be used, the scenario scans a raster, or the memory that is free does not hold the result.
    """
    (made,) = track_many((scenario,), device=device, threads=threads, progress=progress)
    return made


@guest()
def track_many(
    scenarios: Sequence[Scenario],
    *,
    device: DeviceChoice = "auto",
    threads: int | None = None,
    progress: Progress | None = None,
) -> tuple[Track, ...]:
    """Follow the targets of several scenarios side by side: each run as if it were alone, to the last byte.

    Parameters
    ----------
    scenarios
        One for each run. They may differ in ``seed``, in ``position``, ``rotation`` and ``motion`` of the objects that
        move, in ``scan.duration``, ``scan.tracker`` and where targets are ``expected``, and in nothing else.
    device, threads
        Where to compute; the results do not depend on the threads.
    progress
        Called after each turn, in which every run that is not finished makes a visit, with the sums of all runs.

    Returns
    -------
    tuple of Track
        One for each scenario.

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If there are no scenarios, they differ in what must be alike, the device cannot be used, a scenario scans a
        raster, or the memory that is free does not hold the results.
    """
    check_alike(scenarios)
    check_patterns(scenarios)
    states = [start_of(scenario, device) for scenario in scenarios]
    visits = Visits(scenarios, device=device, threads=threads)
    records: list[list[PatternRecord]] = [[] for _ in scenarios]
    durations = [scenario.following.duration for scenario in scenarios]
    running = list(range(len(scenarios)))
    while running := [run for run in running if not visits.finished(states[run], run)]:
        made = visits.after([states[run] for run in running], running)
        for run, (record, state) in zip(running, made, strict=True):
            records[run].append(record)
            states[run] = state
        if progress is not None:
            done = sum(min(state.clock, most) for state, most in zip(states, durations, strict=True))
            progress(done, sum(durations))
    said = [(*beside, *state.said) for beside, state in zip(visits.said, states, strict=True)]
    return tuple(
        track_of(scenario, tuple(own), visits.axes, told)
        for scenario, own, told in zip(scenarios, records, said, strict=True)
    )


def check_alike(scenarios: Sequence[Scenario]) -> None:
    """Check that scenarios can be followed side by side.

    Raises
    ------
    InputError
        If there are none, or with the first key in which one of them differs from the first and may not.
    """
    if not scenarios:
        raise InputError("there are no scenarios to follow.", remedy="Name at least one.")
    if len(scenarios) == 1:
        return
    if own_instrument(scenarios[0]) and len({scenario.seed for scenario in scenarios}) > 1:
        raise InputError(
            "each seed draws another instrument as built or another vibration; side by side they need one.",
            remedy="Write scanner.as_built.seed and leave its vibration out, or follow them one by one.",
        )
    first = _shared_part(scenarios[0])
    for number, scenario in enumerate(scenarios[1:], start=2):
        key = _difference(first, _shared_part(scenario))
        if key is not None:
            raise InputError(
                f"scenario {number} differs from the first in '{key}'; side by side they must be alike but for seed, "
                "scan.duration, scan.tracker, expected places of targets, and the motion of what moves.",
                remedy="Follow it on its own. An object that stands elsewhere in each run needs a motion: one without "
                "speed will do.",
            )


def _shared_part(scenario: Scenario) -> dict[str, Any]:
    """Return what runs side by side must have in common, as a tree."""
    tree = scenario.model_dump()
    for key in ("duration", "tracker"):
        tree["scan"].pop(key, None)
    tree["scan"]["targets"] = [
        {"target": target.name, "centre": target.centre.tolist()} | target.appearance.model_dump()
        for target in scenario.targets
    ]
    for item in tree["scene"]["objects"]:
        if item["motion"] is not None:
            item |= {"position": None, "rotation": None, "motion": "its own"}
    return tree | {"seed": None}


def _difference(one: Any, other: Any, key: str = "") -> str | None:
    """Return the key of the first difference of two trees; None where there is none."""
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        pairs: Iterable[tuple[Any, Any, str]] = (
            (one[name], other[name], f"{key}.{name}".lstrip(".")) for name in one
        )
    elif isinstance(one, list | tuple) and isinstance(other, list | tuple) and len(one) == len(other):
        pairs = ((a, b, f"{key}[{number}]") for number, (a, b) in enumerate(zip(one, other, strict=True)))
    else:
        return None if one == other else key
    return next((found for pair in pairs if (found := _difference(*pair)) is not None), None)
