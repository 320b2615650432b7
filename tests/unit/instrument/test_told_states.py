"""What a program tells of the world: which matrix is a rotation, the quaternion of a pose, and what is past."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scanner_sim import Scenario, load_scenario
from scanner_sim.config import resolved_yaml
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.closed_loop import tracker
from scanner_sim.instrument.closed_loop.saved_state import first_state, save_state
from scanner_sim.instrument.closed_loop.told import (
    _before,
    _is_rotation,
    _quaternion,
    check_knowledge,
    with_light,
    with_move,
)
from scanner_sim.instrument.closed_loop.tracker import Tracker
from scanner_sim.ranging.axes import Axes
from scanner_sim.scene.moves import Moves


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    """A node that may be moved, under the Sun."""
    return load_scenario(
        {
            "schema": 1,
            "lighting": {"sun": {"direction": (0.0, -1.0, -0.2)}},
            "scene": {
                "objects": [
                    {"name": "node", "array": {"diameter": 0.1, "plate": 0.4}, "position": (0.1, 0.05, 9.0),
                     "motion": {"type": "twist"}},
                    {"name": "wall", "shape": "rectangle", "size": (4.0, 4.0), "position": (0.0, 0.0, 12.0),
                     "material": "z93_white"},
                ]
            },
            "scan": {"type": "track", "targets": ["node"]},
        }
    )  # fmt: skip


@dataclass(frozen=True)
class Clock:
    """What waiting needs of a run's state."""

    clock: float


def told(scenario: Scenario, pose: Any, time: float | None, clock: float = 1.0) -> Moves:
    found = with_move(
        scenario,
        "node",
        pose,
        velocity=(0.1, -0.2, 0.3),
        turn_rate=(0.01, 0.02, -0.03),
        time=time,
        clock=clock,
    )
    motion = found.scene.objects[0].motion
    assert isinstance(motion, Moves)
    return motion


def test_a_turn_is_a_rotation_and_what_is_nearly_one_is_not() -> None:
    """Claim: columns of unit length at right angles, right-handed, to 10⁻⁶ in each of their six products."""
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    assert _is_rotation(turn.T.tolist())
    assert not _is_rotation((turn @ np.diag([1.0, 1.0, -1.0])).T.tolist())
    for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
        for size, good in ((0.8e-6, True), (1.2e-6, False)):
            stretch = np.eye(3)
            # RᵀR − 1 has twice a stretch on its diagonal, and a shear beside it.
            stretch[i, j] += 0.5 * size if i == j else size
            assert _is_rotation((turn @ stretch).T.tolist()) is good


def test_a_move_is_the_pose_that_was_told(scenario: Scenario) -> None:
    """Claim: position, quaternion with its scalar first, rates and time are those of the matrix; what is told for the
    same time is told anew."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), [0.5, -0.4, 8.0]
    (move,) = told(scenario, pose, 1.5).moves
    w, x, y, z = move.quaternion
    np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), pose[:3, :3], atol=1e-12)
    assert (move.time, move.position) == (1.5, (0.5, -0.4, 8.0))
    assert (move.velocity, move.turn_rate) == ((0.1, -0.2, 0.3), (0.01, 0.02, -0.03))
    assert told(scenario, pose, None).moves[0].time == 1.0
    # Late by rounding is in time, and later than that is the past.
    assert told(scenario, pose, 1.0 - 0.5e-9).moves[0].time == 1.0
    with pytest.raises(InputError, match="everything is measured"):
        told(scenario, pose, 1.0 - 2e-9)
    again = with_move(scenario, "node", pose, velocity=(0, 0, 0), turn_rate=(0, 0, 0), time=2.0, clock=1.0)
    assert [one.time for one in told(again, pose, 2.0).moves] == [2.0]
    assert [one.time for one in told(again, pose, 3.0).moves] == [2.0, 3.0]
    with pytest.raises(InputError, match="later than"):
        told(again, pose, 1.7)


def test_every_attitude_has_its_quaternion(scenario: Scenario) -> None:
    """Claim: of any turn, half turns among them, it is the one that turns as the matrix does, within rounding."""
    rng = np.random.default_rng(5)
    half = [np.pi * np.eye(3)[axis] for axis in range(3)]
    for turn in (*half, np.zeros(3), *rng.normal(size=(40, 3)) * 2.0):
        matrix = Rotation.from_rotvec(turn).as_matrix()
        w, x, y, z = (
            told(scenario, np.block([[matrix, np.zeros((3, 1))], [0.0, 0.0, 0.0, 1.0]]), 1.5)
            .moves[0]
            .quaternion
        )
        assert abs(math.hypot(w, x, y, z) - 1.0) < 1e-15
        np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), matrix, atol=4e-15)


def test_until_it_is_told_otherwise_an_object_moves_as_before(scenario: Scenario) -> None:
    """Claim: a node that leaves (0.1, 0.05, 9) at (0.2, 0, -0.4) m/s is where that takes it until it is moved, and goes
    on from the pose that it was told."""
    node, *others = scenario.scene.objects
    twist = type(node.motion)(type="twist", velocity=(0.2, 0.0, -0.4))
    drifting = scenario.model_copy(update={"scene": scenario.scene.moved({"node": twist})})
    pose = np.eye(4)
    pose[:3, 3] = [0.5, -0.4, 8.0]
    moved = with_move(drifting, "node", pose, velocity=(0, 0, 1), turn_rate=(0, 0, 0), time=2.0, clock=1.0)
    places = moved.scene.objects[0].pose_at([0.0, 1.5, 2.0, 2.5])[:, :3, 3]
    wanted = [[0.1, 0.05, 9.0], [0.4, 0.05, 8.4], [0.5, -0.4, 8.0], [0.5, -0.4, 8.5]]
    np.testing.assert_allclose(places, wanted, atol=1e-12)
    assert moved.scene.objects[1:] == tuple(others)


@pytest.mark.parametrize(
    "bad", [np.eye(3), np.diag([1.0, 1.0, 1.0, 2.0]), np.full((4, 4), np.nan), np.diag([1, 1, -1, 1])]
)
def test_what_is_no_pose_is_refused(scenario: Scenario, bad: Any) -> None:
    with pytest.raises(InputError):
        told(scenario, bad, 2.0)


def test_what_cannot_be_moved_says_so(scenario: Scenario) -> None:
    still: dict[str, Any] = {"velocity": (0, 0, 0), "turn_rate": (0, 0, 0), "time": None, "clock": 0.0}
    with pytest.raises(InputError, match="no object 'other'"):
        with_move(scenario, "other", np.eye(4), **still)
    with pytest.raises(InputError, match="'wall' is not declared to move"):
        with_move(scenario, "wall", np.eye(4), **still)


def test_light_changes_in_the_order_of_time(scenario: Scenario) -> None:
    first = with_light(scenario, sun=(0.0, 0.0, -1.0), earth=None, visible=0.5, time=2.0, clock=1.0)
    (change,) = first.lighting.changes
    assert (change.time, change.visible, change.earth) == (2.0, 0.5, None)
    np.testing.assert_allclose(change.sun, (0.0, 0.0, -1.0))
    both = with_light(first, sun=None, earth=None, visible=0.2, time=3.0, clock=1.0)
    assert [one.visible for one in both.lighting.changes] == [0.5, 0.2]


def test_a_covariance_is_symmetric_and_has_no_negative_variance() -> None:
    check_knowledge((0.1, 0.2, 0.3), np.diag([1.0, 2.0, 0.0]))
    check_knowledge(None, np.eye(6))
    for rates, covariance in (
        ((1.0, 2.0), None), ((1.0, 2.0, np.inf), None), (None, np.eye(4)), (None, np.diag([1.0, -1.0, 1.0])),
        (None, np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])),
    ):  # fmt: skip
        with pytest.raises(InputError):
            check_knowledge(rates, covariance)
    for endless in (np.inf, np.nan):
        with pytest.raises(InputError, match="6 × 6 numbers"):
            check_knowledge(None, np.diag([1.0, endless, 1.0]))


def test_what_is_told_of_a_target_is_what_a_state_may_hold() -> None:
    """Claim: rates up to 10⁷ and covariances up to 10¹² are taken, and beyond nothing that could not be saved."""
    check_knowledge((1e7, -1e7, 1e7), np.diag([1e12, 1.0, 1e12]))
    for rates, covariance, words in (
        ((0.0, -1.1e7, 0.0), None, r"no rates of a target.*1e\+07"),
        (None, np.diag([1.0, 1.0, 1.1e12]), r"nothing is known.*1e\+12"),
    ):
        with pytest.raises(InputError, match=words):
            check_knowledge(rates, covariance)


def test_quaternions_are_those_of_scipy() -> None:
    """Claim: for turns from none to half a turn, about any axis, to rounding: half turns have no trace to divide by."""
    rng = np.random.default_rng(5)
    axes = np.concatenate([np.eye(3), -np.eye(3), rng.standard_normal((50, 3))])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    for angle in (0.0, 1e-9, 1.0, 2.0, 2.6, np.pi - 1e-9, np.pi):
        for turn in Rotation.from_rotvec(angle * axes):
            found = np.array(_quaternion(turn.as_matrix().tolist()))
            wanted = turn.as_quat(scalar_first=True)
            assert np.abs(found * np.sign(found @ wanted) - wanted).max() < 1e-12


def test_what_was_told_for_the_same_time_is_told_anew() -> None:
    one, other = SimpleNamespace(time=1.0), SimpleNamespace(time=2.0)
    assert _before((one, other), 2.0, "it was told") == (one,)
    assert _before((one, other), 3.0, "it was told") == (one, other)
    assert _before((), 3.0, "it was told") == ()
    for time, good in ((2.01, True), (1.99, False)):
        if good:
            assert _before((one, other), time, "it was told") == (one, other)
        else:
            with pytest.raises(InputError, match=r"it was told for 2 s already, later than 1\.99 s"):
                _before((one, other), time, "it was told")


def test_a_run_goes_on_where_and_with_what_it_is_told_to(
    scenario: Scenario, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Claim: a saved run is continued on the device and by the threads that are asked for, like one that begins."""
    state = first_state(scenario.targets, scenario.following.tracker)
    save_state(tmp_path / "run.state", state, resolved_yaml(scenario), "test")
    asked: list[dict[str, Any]] = []
    monkeypatch.setattr(tracker, "Visits", lambda scenarios, **how: asked.append(how))
    Tracker.resume(tmp_path / "run.state", device="cuda", threads=3)
    Tracker.resume(tmp_path / "run.state", device="cpu")
    assert asked == [{"device": "cuda", "threads": 3}, {"device": "cpu", "threads": None}]


def test_a_run_that_goes_on_says_how_it_began(
    scenario: Scenario, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Claim: what was said when a run began is said of it, too, once it was saved and continued; no state of an
    earlier file has such words, and is read all the same."""
    said = "scan.tracker.start: the camera tells no pose of 'node'"
    state = replace(first_state(scenario.targets, scenario.following.tracker), said=(said,))
    save_state(tmp_path / "run.state", state, resolved_yaml(scenario), "test")
    beside = SimpleNamespace(said=[("the mesh is large",)], axes=Axes(0.0))
    monkeypatch.setattr(tracker, "Visits", lambda scenarios, **how: beside)
    content = json.loads((tmp_path / "run.state").read_text(encoding="utf-8"))
    del content["state"]["said"]
    (tmp_path / "earlier.state").write_text(json.dumps(content), encoding="utf-8")
    for name, wanted in (("run.state", [said]), ("earlier.state", [])):
        warnings = Tracker.resume(tmp_path / name).track([]).warnings
        assert warnings == ("the mesh is large", *wanted, "'node/1' was never visited: the run is too short")


@pytest.mark.parametrize(
    ("time", "words"),
    [(2.0, ""), (1e9, ""), (1.999, "1.999 s is before 2 s"), (1.1e9, "1.1e+09 s is too late")],
)
def test_a_run_waits_until_times_that_there_are(time: float, words: str) -> None:
    """Claim: from the time that has come until 10⁹ s; a time beyond is not called past."""
    own: Any = SimpleNamespace(time=2.0, state=Clock(2.0))
    if words:
        with pytest.raises(InputError) as found:
            Tracker.wait(own, time)
        assert words in found.value.message
    else:
        Tracker.wait(own, time)
    assert own.state.clock == (2.0 if words else time)


@pytest.mark.parametrize("step", [1e-2, 1e-3, 1e-4, 1e-6])
def test_a_quick_controllers_states_are_all_kept(scenario: Scenario, step: float) -> None:
    """Claim: of states that are told a step apart, however short, each holds until the next one, and of changes of the
    light too: halfway between two of them the object is where the earlier one and its velocity take it."""
    known, pose = scenario, np.eye(4)
    times = [2.0 + step * number for number in range(4)]
    for number, time in enumerate(times):
        pose[:3, 3] = [float(number), 0.0, 8.0]
        known = with_move(known, "node", pose, velocity=(0, 1, 0), turn_rate=(0, 0, 0), time=time, clock=time)
        known = with_light(known, sun=None, earth=None, visible=0.1 * number, time=time, clock=time)
    places = known.scene.objects[0].pose_at(np.array(times) + 0.5 * step)[:, :3, 3]
    # Times near 2 s are known to their rounding, 4e-16 s.
    np.testing.assert_allclose(places, [[number, 0.5 * step, 8.0] for number in range(4)], atol=1e-15)
    assert [(one.time, one.visible) for one in known.lighting.changes] == [
        (time, pytest.approx(0.1 * number)) for number, time in enumerate(times)
    ]
