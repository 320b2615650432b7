"""What each request asks of the run, and what it is answered: every number arrives where it belongs."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.foundation.errors import InputError, RunError
from scanner_sim.serve import answers, session
from scanner_sim.serve import messages as ask
from scanner_sim.serve.session import Session


class Tracker(SimpleNamespace):
    """A tracker that keeps what it is asked: a call by its name, its numbers and its options."""

    asked: list[Any]

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return lambda *given, **options: self.asked.append((name, *given, options))


def served(**more: Any) -> Any:
    """Return a served run whose tracker is at 5 s, and has made three visits."""
    run: Any = object.__new__(Session)
    following, mirrors = SimpleNamespace(duration=9.0), SimpleNamespace(axis_separation=0.05)
    scenario = SimpleNamespace(seed=7, following=following, scanner=SimpleNamespace(mirrors=mirrors))
    run.tracker = Tracker(asked=[], time=5.0, finished=False, scenario=scenario, targets=(), state=None)
    run.records, run.realtime, run.overruns = ["a", "b", "c"], None, 4
    run._handed, run._save, run._filter, run._filtered = 0, None, None, 0
    for name, value in more.items():
        setattr(run, name, value)
    return run


def asked_of(run: Any, command: str, **content: Any) -> Any:
    """Return what a request is answered, without the time and the end that every answer has."""
    kind: Any = getattr(ask, {"save": "Save"}.get(command, command.capitalize()))
    found = run.answer(kind(protocol=ask.PROTOCOL, command=command, **content))
    assert (found.pop("time"), found.pop("finished")) == (run.tracker.time, run.tracker.finished)
    return found


COVARIANCE = tuple(tuple(float(6 * row + column) for column in range(6)) for row in range(6))


@pytest.mark.parametrize(
    ("command", "content", "call"),
    [
        ("light", {"sun": (1.0, 2.0, 3.0), "earth": (4.0, 5.0, 6.0), "visible": 0.5, "time": 7.0},
         ("light", {"sun": (1.0, 2.0, 3.0), "earth": (4.0, 5.0, 6.0), "visible": 0.5, "time": 7.0})),
        ("point", {"target": "t", "theta": 0.1, "phi": 0.2, "range": 3.0, "rates": (4.0, 5.0, 6.0),
                   "covariance": COVARIANCE},
         ("point", "t", 0.1, 0.2, 3.0, {"rates": (4.0, 5.0, 6.0), "covariance": COVARIANCE})),
        ("search", {"target": "t"}, ("search", "t", {})),
        ("drop", {"target": "t"}, ("drop", "t", {})),
        ("amplitude", {"target": "t", "amplitude": 0.25}, ("amplitude", "t", 0.25, {})),
        ("wait", {"time": 8.0}, ("wait", 8.0, {})),
    ],
    ids=["light", "point", "search", "drop", "amplitude", "wait"],
)  # fmt: skip
def test_what_is_told_reaches_the_tracker(
    command: str, content: dict[str, Any], call: tuple[Any, ...]
) -> None:
    run = served()
    assert asked_of(run, command, **content) == {}
    assert run.tracker.asked == [call]


def test_a_run_is_told_what_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "target_map", lambda target: f"map of {target}")
    run = served(realtime=2.5)
    run.tracker.targets, run.tracker.state = ("t", "u"), SimpleNamespace(visits=17)
    found = asked_of(run, "open")
    assert found.pop("software").startswith("scanner-sim ")
    assert found == {
        "seed": 7, "duration": 9.0, "axis_separation": 0.05, "realtime": 2.5, "targets": ["map of t", "map of u"],
        "visits": 17,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("wanted", "left", "made"), [(2, 9, ["d", "e"]), (4, 3, ["d", "e", "f"]), (1, 0, [])]
)
def test_steps_give_what_they_made(
    monkeypatch: pytest.MonkeyPatch, wanted: int, left: int, made: list[str]
) -> None:
    """Claim: as many visits as asked, fewer where the run ends; their records alone, with truth and voxels as asked."""
    run = served()
    monkeypatch.setattr(session, "record_map", lambda one, truth, voxels: (one, truth, voxels))
    rest = list("defghijkl")[:left]
    run.visit = lambda: bool(rest) and (run.records.append(rest.pop(0)) or True)
    found = asked_of(run, "step", visits=wanted, truth=True)
    assert found == {"records": [(one, True, False) for one in made]}


def test_a_free_running_clock_hands_out_what_was_made_since(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: each record once, in their order, as many as are asked for; what waits is told."""
    monkeypatch.setattr(session, "record_map", lambda one, truth, voxels: (one, truth, voxels))
    run = served(realtime=1.0)
    run.tracker.state = SimpleNamespace(visits=3, tracks=(), followed=(), amplitudes=())
    assert asked_of(run, "step", visits=2, voxels=True) == {
        "records": [("a", False, True), ("b", False, True)]
    }
    assert asked_of(run, "state")["waiting"] == 1
    assert asked_of(run, "step", visits=2) == {"records": [("c", False, False)]}
    assert asked_of(run, "step", visits=2) == {"records": []}
    run.records.append("d")
    assert asked_of(run, "step", visits=9) == {"records": [("d", False, False)]}


def test_the_state_of_a_run_is_told_target_by_target() -> None:
    run = served()
    mode = SimpleNamespace
    run.tracker.targets = (mode(name="t"), mode(name="u"))
    run.tracker.state = SimpleNamespace(
        visits=11, tracks=(mode(mode=mode(value="track")), mode(mode=mode(value="lost"))), followed=(True, False),
        amplitudes=(0.1, None),
    )  # fmt: skip
    assert asked_of(run, "state") == {
        "visits": 11, "overruns": 4, "waiting": 0, "targets": [
            {"name": "t", "mode": "track", "followed": True, "amplitude": 0.1},
            {"name": "u", "mode": "lost", "followed": False, "amplitude": None},
        ],
    }  # fmt: skip


def test_a_raster_is_measured_as_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    run = served()
    run.tracker.scan = lambda *given, **options: (given, options)
    monkeypatch.setattr(session, "raster_map", lambda image, layers: (image, layers))
    found = asked_of(
        run, "raster", rows=3, columns=4, horizontal=(-0.1, 0.2), vertical=(-0.3, 0.4), layers=("Y",)
    )
    assert found == {"raster": (((3, 4, (-0.1, 0.2), (-0.3, 0.4)), {"layers": ("Y",)}), ("Y",))}


@pytest.mark.parametrize(("time", "when"), [(None, 5.0), (6.5, 6.5)])
def test_the_filter_is_asked_for_now_unless_a_time_is_said(
    monkeypatch: pytest.MonkeyPatch, time: float | None, when: float
) -> None:
    asked: list[Any] = []
    known = SimpleNamespace(
        predict=lambda *given: given, sight=lambda *given: given,
        push=lambda velocity, **options: asked.append((velocity, options)),
    )  # fmt: skip
    run = served(_fed=lambda: known)
    monkeypatch.setattr(session, "pose_map", lambda pose: pose)
    monkeypatch.setattr(session, "sight_map", lambda seen: seen)
    assert asked_of(run, "pose", object="o", time=time) == {"pose": (when, "o")}
    assert asked_of(run, "sight", target="t", time=time) == {"sight": ("t", when)}
    assert asked_of(run, "push", object="o", velocity=(1.0, 2.0, 3.0), time=4.0, sigma=0.5) == {}
    assert asked == [((1.0, 2.0, 3.0), {"time": 4.0, "name": "o", "sigma": 0.5})]


def test_a_run_is_saved_where_the_server_was_told_to() -> None:
    with pytest.raises(InputError, match="saves nothing"):
        asked_of(served(), "save")
    run = served(_save=lambda one: [str(len(one.records))])
    assert asked_of(run, "save") == {"files": ["3"]}
    assert asked_of(run, "close") == {}


def test_a_visit_is_made_when_it_is_due() -> None:
    """Claim: one that is due at the clock's time is made, and adds its record and its state; none after the end."""
    run = served()
    run.tracker.state = "s0"
    run.tracker.visit = lambda state: (f"visit of {state}", "s1")
    assert not run.run_until(4.999)
    assert run.run_until(5.0)
    assert (run.records[-1], run.tracker.state) == ("visit of s0", "s1")
    run.tracker.finished = True
    assert not run.run_until(9.0)
    assert len(run.records) == 4


def test_what_cannot_be_looked_ahead_is_left_to_the_visit() -> None:
    def fails() -> bool:
        raise RunError("later")

    run = served()
    for look, left in ((lambda: True, True), (lambda: False, False), (fails, False)):
        run.tracker.look_ahead = look
        assert run.look_ahead() is left


@pytest.mark.parametrize(
    ("length", "taken"), [(1.0, True), (0.9991, True), (1.0009, True), (0.9989, False), (1.0011, False)]
)
def test_attitudes_have_length_one_to_a_thousandth(
    monkeypatch: pytest.MonkeyPatch, length: float, taken: bool
) -> None:
    """Claim: all states are told at once, each on top of the one before, with the run's clock; or none of them."""
    asked: list[Any] = []

    def with_state(told: Any, name: str, **options: Any) -> Any:
        asked.append((name, options))
        return (told, name)

    monkeypatch.setattr(session, "with_state", with_state)
    run = served()
    good = {
        "object": "o",
        "position": (1.0, 2.0, 3.0),
        "velocity": (4.0, 5.0, 6.0),
        "turn_rate": (7.0, 8.0, 9.0),
        "time": 6.0,
    }
    other = {
        "object": "p",
        "position": (0.0, 0.0, 1.0),
        "quaternion": tuple(length * one for one in (0.5, -0.5, 0.5, 0.5)),
    }
    moves = tuple(ask.ObjectState.model_validate(one) for one in (good, other))
    if not taken:
        with pytest.raises(InputError, match="is no attitude"):
            run._tell(moves)
        assert run.tracker.asked == []
        return
    run._tell(moves)
    assert run.tracker.asked == [("follow", ((run.tracker.scenario, "o"), "p"), {})]
    assert asked[0] == ("o", {
        "time": 6.0, "clock": 5.0, "position": (1.0, 2.0, 3.0), "quaternion": (1.0, 0.0, 0.0, 0.0),
        "velocity": (4.0, 5.0, 6.0), "turn_rate": (7.0, 8.0, 9.0),
    })  # fmt: skip
    assert asked[1][1]["quaternion"] == other["quaternion"]
    run.tracker.asked.clear()
    run._tell(())
    assert run.tracker.asked == []


def test_a_state_of_other_targets_is_refused() -> None:
    """Claim: name, object, looks and place on the object must be those that are served."""

    def target(**changes: Any) -> Any:
        told = {"name": "t", "object": "o", "appearance": "looks", "centre": np.array([1.0, 2.0, 3.0])}
        return SimpleNamespace(**told | changes)

    def check(saved: Any) -> None:
        tracker: Any = SimpleNamespace(targets=(saved,))
        scenario: Any = SimpleNamespace(targets=(target(),))
        session._check_same_targets(tracker, scenario, "file")  # type: ignore[arg-type]

    check(target())
    for other in ({"name": "x"}, {"object": "x"}, {"appearance": "x"}, {"centre": np.array([1.0, 2.0, 3.1])}):
        with pytest.raises(InputError, match="a state of other targets"):
            check(target(**other))


@dataclasses.dataclass
class Samples:
    """Two columns of voxels, as samples have more of them."""

    theta: np.ndarray
    signal: np.ndarray


@pytest.mark.parametrize("truth", [True, False])
@pytest.mark.parametrize("voxels", [True, False])
def test_a_visit_is_told_with_its_covariances(
    monkeypatch: pytest.MonkeyPatch, truth: bool, voxels: bool
) -> None:
    """Claim: every number under its own name; the range and its σ are the third of the position and of its covariance;
    the truth and the voxels of the first of the visits only where they are asked for."""
    monkeypatch.setattr(answers, "array", lambda values: values.tolist())
    three = np.arange(9.0).reshape(3, 3)
    record: Any = SimpleNamespace(
        number=3, target="t", time=1.5, available=1.75, mode=SimpleNamespace(value="track"),
        after=SimpleNamespace(value="lost"), refusal=SimpleNamespace(value="none"), status=np.int64(2),
        amplitude=np.float64(0.1),
        position=np.array([0.1, 0.2, 9.0]), covariance=three + 8.0 * np.diag([0.0, 0.0, 1.0]),
        errors=SimpleNamespace(white=three + 1.0, lasting=three + 2.0), point=np.array([4.0, 5.0, 6.0]),
        point_covariance=three + 3.0, truth=np.array([0.3, 0.4, 8.0]), truth_point=np.array([7.0, 8.0, 9.0]),
        samples=Samples(theta=np.array([[1.0, 2.0], [3.0, 4.0]]), signal=np.array([[5.0, 6.0], [7.0, 8.0]])),
    )  # fmt: skip
    found = answers.record_map(record, truth=truth, voxels=voxels)
    expected: dict[str, Any] = {
        "number": 3, "target": "t", "time": 1.5, "available": 1.75, "mode": "track", "after": "lost", "refusal": "none",
        "status": 2, "amplitude": 0.1, "position": [0.1, 0.2, 9.0], "covariance": record.covariance.tolist(),
        "white": (three + 1.0).tolist(), "lasting": (three + 2.0).tolist(), "range": 9.0, "sigma_range": 4.0,
        "point": [4.0, 5.0, 6.0], "point_covariance": (three + 3.0).tolist(),
    }  # fmt: skip
    expected |= {"truth": [0.3, 0.4, 8.0], "truth_point": [7.0, 8.0, 9.0]} if truth else {}
    expected |= {"voxels": {"theta": [1.0, 2.0], "signal": [5.0, 6.0]}} if voxels else {}
    assert found == expected


def test_targets_and_rasters_are_told_by_their_names(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(answers, "array", lambda values: ("array", values))
    appearance = SimpleNamespace(kind=SimpleNamespace(value="disc"), diameter=0.1)
    target: Any = SimpleNamespace(
        name="t", object="o", appearance=appearance, expected=np.array([0.1, 0.2, 3.0]),
        centre=np.array([4.0, 5.0, 6.0]),
    )  # fmt: skip
    assert answers.target_map(target) == {
        "name": "t", "object": "o", "kind": "disc", "diameter": 0.1, "expected": [0.1, 0.2, 3.0],
        "centre": [4.0, 5.0, 6.0],
    }  # fmt: skip

    class Image(dict[str, Any]):
        theta, phi = "angles", "others"

    image: Any = Image({"status": "s", "Y": "y"})
    assert answers.raster_map(image, ("Y", "status")) == {
        "theta": ("array", "angles"), "phi": ("array", "others"),
        "layers": {"status": ("array", "s"), "Y": ("array", "y")},
    }  # fmt: skip


@pytest.mark.parametrize("status", ["starting", "tracking"])
def test_a_pose_that_starts_has_no_attitude(status: str) -> None:
    class Known(str):
        @property
        def value(self) -> str:
            return str(self)

    pose: Any = SimpleNamespace(
        object="o", time=1.5, status=Known(status), position=np.array([1.0, 2.0, 3.0]),
        quaternion=np.array([4.0, 5.0, 6.0, 7.0]), velocity=np.array([8.0, 9.0, 10.0]),
        turn_rate=np.array([11.0, 12.0, 13.0]), covariance=np.eye(2), surprise=np.float64(0.5),
    )  # fmt: skip
    found = answers.pose_map(pose)
    attitude = found.pop("quaternion")
    assert found == {
        "object": "o", "time": 1.5, "status": status, "position": [1.0, 2.0, 3.0], "velocity": [8.0, 9.0, 10.0],
        "turn_rate": [11.0, 12.0, 13.0], "covariance": [[1.0, 0.0], [0.0, 1.0]], "surprise": 0.5,
    }  # fmt: skip
    assert attitude == [4.0, 5.0, 6.0, 7.0] if status == "tracking" else all(map(math.isnan, attitude))


@pytest.mark.parametrize(
    ("error", "kind"), [(InputError("a", remedy="b"), "input"), (RunError("a", remedy="b"), "run")]
)
def test_faults_are_answers_of_their_kind(error: Any, kind: str) -> None:
    answer = answers.refused_by(5, error)
    assert answer == {
        "protocol": ask.PROTOCOL, "id": 5, "ok": False, "error": {"kind": kind, "message": "a", "remedy": "b"}
    }  # fmt: skip
    assert answers.done(6, {"x": 1}) == {"protocol": ask.PROTOCOL, "id": 6, "ok": True, "x": 1}
