"""A raster between two visits: when it starts, which numbers its shots have, and the state that it leaves."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest

from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.closed_loop import tracker, visits


@dataclass(frozen=True)
class State:
    """What a raster needs of a run's state."""

    visits: int
    clock: float
    mirrors: str
    skipped: int


def test_a_raster_takes_its_time_and_the_numbers_of_whole_visits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: 25 shots have the numbers of three visits of ten, after those of the four before; the clock goes on from
    the raster's start by its time, and nothing is skipped."""
    raster: Any = SimpleNamespace(shots=25)
    asked: list[Any] = []

    class Stay:
        def resume(self) -> Stay:
            return self

        def __enter__(self) -> None:
            asked.append("in")

        def __exit__(self, *_: object) -> None:
            asked.append("out")

    def first(scenario: str, given: Any, mirrors: str, clock: float) -> float:
        assert (scenario, given, mirrors) == ("scenario", raster, "mirrors")
        return clock + 0.25

    def measured(*given: Any, **named: Any) -> str:
        asked.append((given, named))
        return "image"

    monkeypatch.setattr(visits, "first_time", first)
    monkeypatch.setattr(visits, "measure_raster", measured)
    monkeypatch.setattr(visits, "raster_time", lambda shots, dwell: shots * dwell)
    monkeypatch.setattr(visits, "mirrors_after", lambda given, end: f"after {end:g}")
    own: Any = SimpleNamespace(
        _pattern=SimpleNamespace(points=10), _stay=Stay(), _device="cpu", _threads=3,
        _scanner=SimpleNamespace(dwell=0.5),
    )  # fmt: skip
    state: Any = State(visits=4, clock=2.0, mirrors="mirrors", skipped=6)
    image, after = visits.Visits.scan(own, raster, "scenario", state)  # type: ignore[arg-type]
    assert image == "image"
    assert asked == ["in", (("scenario", raster, 2.25, 40), {"device": "cpu", "threads": 3}), "out"]
    assert after == State(visits=7, clock=14.75, mirrors="after 14.75", skipped=0)


@pytest.mark.parametrize("layers", [None, ("range_m",), ()])
def test_a_run_goes_on_from_the_state_after_a_raster(layers: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the raster that is asked for is measured in the run's scenario from its state, which then is the next;
    the layers that are asked for are kept, or all."""
    monkeypatch.setattr(tracker, "between_visits", lambda *given: given)
    image = SimpleNamespace(keeping=lambda kept: ("kept", kept))

    def scan(asked: Any, scenario: str, state: str) -> Any:
        assert asked == ("scenario", 2, 3, (0.1, 0.2), (-0.3, 0.4))
        assert (scenario, state) == ("scenario", "state")
        return image, "after"

    own: Any = SimpleNamespace(scenario="scenario", state="state", _visits=SimpleNamespace(scan=scan))
    found: Any = tracker.Tracker.scan(own, 2, 3, (0.1, 0.2), (-0.3, 0.4), layers=layers)
    assert found == (image if layers is None else ("kept", layers))
    assert own.state == "after"


def test_a_raster_with_a_layer_that_there_is_not_is_as_if_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: what is refused has not moved the run, whose next raster begins when this one would have."""
    monkeypatch.setattr(tracker, "between_visits", lambda *given: given)

    def keeping(_: Any) -> None:
        raise InputError("this result has no layer 'depth'.")

    image = SimpleNamespace(keeping=keeping)
    visited = SimpleNamespace(scan=lambda *_: (image, "after"))
    own: Any = SimpleNamespace(scenario="scenario", state="state", _visits=visited)
    with pytest.raises(InputError, match="no layer 'depth'"):
        tracker.Tracker.scan(own, 2, 3, (0.1, 0.2), (-0.3, 0.4), layers=("depth",))
    assert own.state == "state"
