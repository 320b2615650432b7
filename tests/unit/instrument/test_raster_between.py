"""A raster between two visits: when it starts, which numbers its shots have, and the state that it leaves."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim import load_scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.closed_loop import tracker, visits
from scanner_sim.instrument.closed_loop.raster_between import scene_from
from scanner_sim.scene.moves import Moves
from scanner_sim.scene.objects import Scene


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


def moving(*motions: dict[str, Any]) -> Scene:
    """Return a scene of objects with these motions, the first of which carries another one."""
    ball = {"shape": "sphere", "diameter": 0.1, "material": {"reflectance": 0.5}}
    objects = [
        ball | {"name": f"ball{number}", "position": (0.1, 0.2 * number, 4.0), "motion": motion,
                "rotation": {"axis": (1, 2, 0.5), "angle": 0.4}}
        for number, motion in enumerate(motions)
    ]  # fmt: skip
    objects.append(ball | {"name": "carried", "parent": "ball0", "position": (0.3, 0.0, 0.2)})
    objects.append(ball | {"name": "still", "position": (0.0, 0.0, 9.0)})
    scan = {"type": "raster", "rows": 2, "columns": 2, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}
    return load_scenario({"schema": 1, "scene": {"objects": objects}, "scan": scan}).scene


def test_a_kept_scene_has_its_objects_where_the_raster_saw_them() -> None:
    """Claim: from the raster's start on, objects, what they carry and what rests are where they are in the run at that
    time: to rounding where they move evenly, are told to jump, or wait to be told; along a smooth path within a T²/4 of
    pieces of 1.3 s/64. What moves evenly is one state."""
    told = {
        "type": "moves",
        "before": {"type": "twist", "velocity": (0.0, 0.0, 1.0)},
        "moves": [
            {
                "time": 2.4,
                "position": (0.0, 0.0, 5.0),
                "velocity": (0.0, 0.0, 0.3),
                "turn_rate": (0.0, 0.2, 0.0),
            },
            {"time": 2.7, "position": (1.0, 0.0, 5.0), "quaternion": (1.0, 2.0, 0.0, 0.0)},
            {"time": 9.0, "position": (2.0, 0.0, 5.0)},
        ],
    }
    ways = [{"time": time, "position": (0.1 * time**2, 0.0, 4.0 + time)} for time in (0.0, 2.0, 5.0)]
    scene = moving(
        {"type": "twist", "velocity": (0.1, 0.0, 0.5), "turn_rate": (0.1, 0.3, -0.2)},
        told,
        {"type": "waypoints", "points": ways},
    )
    start, end = 2.0, 3.3
    kept = scene_from(scene, start, end)
    time = np.linspace(0.0, end - start, 1000)[:-1]
    for own, other in zip(scene.objects, kept.objects, strict=True):
        apart = np.abs(other.pose_at(time) - own.pose_at(start + time)).max()
        path = own.pose_at(np.linspace(start, end, 200))[:, :3, 3]
        bend = np.abs(np.diff(path, 2, axis=0)).max() / ((end - start) / 199) ** 2
        assert apart < (bend * (1.3 / 64.0) ** 2 / 3.0 if own.name == "ball2" else 1e-9), own.name
    motions = [item.motion for item in kept.objects]
    assert [None if motion is None else len(motion.moves) for motion in motions] == [1, 3, 64, None, None]  # type: ignore[union-attr]
    assert [item.parent for item in kept.objects] == [item.parent for item in scene.objects]


def test_fast_turns_and_far_things_are_kept() -> None:
    """Claim: a turn of 50 rad/s during a raster of a minute, 47 rad in each of its 64 pieces, is kept as it is; what
    flies farther than an object may be is kept at that distance."""
    scene = moving(
        {"type": "twist", "turn_rate": (0.0, 50.0, 0.0)}, {"type": "twist", "velocity": (7000.0, 0.0, 0.0)}
    )
    turning, far = (item.motion for item in scene_from(scene, 20.0, 80.0).objects[:2])
    assert isinstance(turning, Moves)
    assert isinstance(far, Moves)
    (move,) = turning.moves
    np.testing.assert_allclose(move.turn_rate, [0.0, 50.0, 0.0], atol=1e-6)
    assert {one.position[0] for one in far.moves} == {1e5}
