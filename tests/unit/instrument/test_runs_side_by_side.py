"""Runs side by side: each goes on until its own time is over, and what is done of all is told."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import InputError, Scenario, load_scenario
from scanner_sim.instrument.closed_loop import track as module
from scanner_sim.instrument.closed_loop.track import check_alike

Array = NDArray[np.float64]

STEPS = (0.3, 0.5, 0.25)
DURATIONS = (1.0, 0.9, 0.2)


@dataclass(frozen=True)
class Clock:
    """The state of a run: its number, what is said of it, and what its time is."""

    run: int
    said: tuple[str, ...]
    clock: float = 0.0


class Visits:
    """Makes visits of a run's own length, of the runs that are asked for."""

    def __init__(self, scenarios: Any, *, device: Any, threads: Any) -> None:
        self.asked = (scenarios, device, threads)
        self.axes = "of the mirrors"
        self.said = [(f"beside {run}",) for run in range(len(scenarios))]

    def finished(self, state: Clock, run: int) -> bool:
        """Return whether a run's time is over."""
        assert state.run == run
        return state.clock >= DURATIONS[run]

    def after(self, states: Any, running: Any) -> Any:
        """Return one record and the state after it of each run."""
        assert [state.run for state in states] == running
        later = [replace(state, clock=state.clock + STEPS[state.run]) for state in states]
        return [(f"{state.run} at {state.clock:.2f}", state) for state in later]


def test_runs_end_each_at_its_own_time_and_tell_what_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a run has the records and warnings that are its own, in the order of time, up to the first that reaches
    its duration; the progress is the sum of the times that are done, none beyond its duration, of the sum of all."""
    scenarios: Any = [
        SimpleNamespace(run=run, following=SimpleNamespace(duration=duration))
        for run, duration in enumerate(DURATIONS)
    ]
    for name in ("check_alike", "check_patterns", "activate"):
        monkeypatch.setattr(module, name, lambda *_: None, raising=False)
    monkeypatch.setattr(module, "start_of", lambda known, _: Clock(known.run, (f"start {known.run}",)))
    monkeypatch.setattr(module, "Visits", Visits)
    monkeypatch.setattr(module, "track_of", lambda *about: about)
    told: list[tuple[float, float]] = []
    found = module.track_many(scenarios, device="cpu", progress=lambda *done: told.append(done))
    for run, (scenario, records, axes, said) in enumerate(found):  # type: ignore[misc]
        count = int(np.ceil(DURATIONS[run] / STEPS[run]))
        assert scenario is scenarios[run]
        assert records == tuple(f"{run} at {STEPS[run] * (1 + step):.2f}" for step in range(count))
        assert axes == "of the mirrors"
        assert said == (f"beside {run}", f"start {run}")
    for turn, (done, whole) in enumerate(told, start=1):
        wanted = sum(min(turn * step, most) for step, most in zip(STEPS, DURATIONS, strict=True))
        assert done == pytest.approx(wanted)
        assert whole == pytest.approx(2.1)
    assert len(told) == 4


def followed(**changes: Any) -> Scenario:
    """Two arrays, one of which moves, and a wall that stands."""
    array = {"diameter": 0.1, "plate": 0.2}
    objects = [
        {"name": "a", "array": array, "position": (0.0, 0.0, 5.0), "motion": {"type": "twist"}},
        {"name": "b", "array": array, "position": (1.0, 0.0, 6.0)},
    ]
    scan = {"type": "track", "targets": ["a", "b"], "duration": 2.0}
    return load_scenario({"schema": 1, "seed": 1, "scene": {"objects": objects}, "scan": scan}).replace(
        changes
    )


@pytest.mark.parametrize(
    "changes",
    [
        {"seed": 7},
        {"scan.duration": 3.0},
        {"scan.tracker": {"acceleration_psd": 0.5}},
        {"scene.objects.a.position": (0.1, 0.2, 5.5)},
        {"scene.objects.a.rotation": {"axis": "y", "angle": 0.1}},
        {"scene.objects.a.motion": {"type": "twist", "velocity": (0.0, 0.1, 0.0)}},
        {"scan.targets": [{"target": "a", "offset": (1e-3, 0.0, 0.0)}, "b"]},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_runs_may_differ_in_seed_time_and_what_moves(changes: dict[str, Any]) -> None:
    check_alike([followed(), followed(), followed(**changes)])


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"scene.objects.b.position": (1.0, 0.1, 6.0)}, r"scene\.objects\[1\]\.position\[1\]"),
        ({"scene.objects.a.array.diameter": 0.11}, r"scan\.targets|scene\.objects\[0\]\.array\.diameter"),
        ({"scan.targets": ["b", "a"]}, r"scan\.targets\[0\]\.(target|centre)"),
        ({"scan.targets": ["a"]}, r"scan\.targets"),
        ({"scanner.laser.power": 0.02}, r"scanner\.laser\.power"),
        ({"scan.pattern.points": 96}, r"scan\.pattern\.points"),
        ({"ranging": "tof"}, "ranging"),
    ],
)
def test_runs_that_differ_in_more_are_told_the_first_key(changes: dict[str, Any], key: str) -> None:
    """Claim: the first scenario that is not as the first is named by its number, from 1, with the key."""
    check_alike([followed(**changes)])
    with pytest.raises(InputError, match=rf"scenario 3 differs from the first in '({key})'"):
        check_alike([followed(), followed(seed=2), followed(**changes)])


def test_runs_of_drawn_instruments_need_one_seed() -> None:
    """Claim: where the seed draws the instrument, runs of one seed go together and others do not; of none there is
    nothing to follow."""
    drawn = {"scanner.as_built": {"base": {"tolerance": "0.1 mm"}}}
    check_alike([followed(**drawn), followed(**drawn)])
    check_alike([followed(seed=5, **drawn)])
    with pytest.raises(InputError, match="each seed draws another instrument"):
        check_alike([followed(**drawn), followed(seed=5, **drawn)])
    with pytest.raises(InputError, match="no scenarios"):
        check_alike([])
