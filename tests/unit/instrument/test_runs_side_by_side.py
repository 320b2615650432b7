"""Runs side by side: each goes on until its own time is over, and what is done of all is told."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.instrument.closed_loop import track as module

Array = NDArray[np.float64]

STEPS = (0.3, 0.5, 0.25)
DURATIONS = (1.0, 0.9, 0.2)


@dataclass(frozen=True)
class Clock:
    """The state of a run: its number, and what its time is."""

    run: int
    clock: float = 0.0


class Visits:
    """Makes visits of a run's own length, of the runs that are asked for."""

    def __init__(self, scenarios: Any, *, device: Any, threads: Any) -> None:
        self.asked = (scenarios, device, threads)
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
    monkeypatch.setattr(module, "start_of", lambda known, _: (Clock(known.run), (f"start {known.run}",)))
    monkeypatch.setattr(module, "Visits", Visits)
    monkeypatch.setattr(module, "track_of", lambda *about: about)
    told: list[tuple[float, float]] = []
    found = module.track_many(scenarios, device="cpu", progress=lambda *done: told.append(done))
    for run, (scenario, records, said) in enumerate(found):  # type: ignore[misc]
        count = int(np.ceil(DURATIONS[run] / STEPS[run]))
        assert scenario is scenarios[run]
        assert records == tuple(f"{run} at {STEPS[run] * (1 + step):.2f}" for step in range(count))
        assert said == (f"beside {run}", f"start {run}")
    for turn, (done, whole) in enumerate(told, start=1):
        wanted = sum(min(turn * step, most) for step, most in zip(STEPS, DURATIONS, strict=True))
        assert done == pytest.approx(wanted)
        assert whole == pytest.approx(2.1)
    assert len(told) == 4
