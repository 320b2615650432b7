"""The run of a tracker, visit after visit, with an eye that sees the truth: turns, times, numbers, and what is kept."""

from __future__ import annotations

from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import Scenario, load_scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.closed_loop import visits as module
from scanner_sim.instrument.closed_loop.records import Recorder, point_of
from scanner_sim.instrument.closed_loop.tracker import Tracker
from scanner_sim.instrument.closed_loop.whole_track import track_of
from scanner_sim.products.error_columns import error_columns, errors_from
from scanner_sim.ranging.axes import Axes
from scanner_sim.ranging.coordinates import angles_and_range
from scanner_sim.render.device import Device
from scanner_sim.tracking.errors import ErrorParts
from scanner_sim.tracking.measurement import Measurement
from scanner_sim.tracking.record import TrackStatus
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.state import TrackCommand, TrackMode, command

Array = NDArray[np.float64]

MOVING = {"type": "twist", "velocity": (0.05, 0.02, 0.0), "turn_rate": (0.0, 0.0, 0.2)}
LATE = 7e-3


def node(name: str, x: float, **more: Any) -> dict[str, Any]:
    return {"name": name, "array": {"diameter": 0.1, "plate": 0.15}, "position": (x, 0.1, 8.0), **more}


def scenario(*targets: Any, **pattern: Any) -> Scenario:
    return load_scenario(
        {
            "schema": 1,
            "scene": {"objects": [node("a", -0.5, motion=MOVING), node("b", 0.5), node("c", 1.2)]},
            "scan": {
                "type": "track",
                "duration": 20.0,
                "targets": list(targets) or ["a", "b"],
                "pattern": pattern,
            },
        }
    )


class TrueEye:
    """Sees every target where it is, with a small covariance, and remembers what it was asked."""

    def __init__(self, known: Any, _: Any) -> None:
        self.recorder, self.asked = Recorder(known[0]), []

    def expect(self, *known: Any) -> Any:
        return known

    def measure(self, *_: Any) -> None:
        pass

    def see(self, target: Any, _: Any, expected: Any) -> tuple[Any, Any, Any]:
        orders, motion, visit, *_ = expected
        (order,), (number,) = orders, visit.tolist()
        self.asked.append(SimpleNamespace(target=target, order=order, motion=motion, visit=number))
        time = float(motion.time.mean()) + 1e-4
        one = np.ones(1)
        covariance = np.diag([1e-10, 2e-10, 1e-6])
        place = self.recorder.truth(target, time)[0]
        radius = 0.5 * target.appearance.diameter / place[2] * one
        seen = Measurement(
            time * one, place[None], covariance[None], radius, 1e-6 * one, one, 0.4 * one, one > 0.0
        )
        lanes = [motion.time] + 6 * [0.0 * motion.time]
        samples = PatternSamples(*lanes, status=np.zeros(motion.time.shape, np.uint8))
        return samples, seen, ErrorParts.all_white(covariance[None])


@pytest.fixture
def run(device: Device, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return what makes a tracker of a scenario, without any scene to render."""
    empty = SimpleNamespace(loaded=SimpleNamespace(notes=(), extents={}))
    monkeypatch.setattr(module, "Instrument", lambda *_, **__: empty)
    nowhere = SimpleNamespace(at=lambda _, used: (None, used), follow=lambda _: None)
    monkeypatch.setattr(module, "FrozenInstrument", lambda _: SimpleNamespace(situations=lambda: [nowhere]))
    monkeypatch.setattr(module, "TargetSensor", TrueEye)
    return Tracker


def test_targets_are_visited_in_turn_and_on_time(run: Any) -> None:
    """Claim: by turns, one number a visit, each pattern at the end of its period, ordered for the pattern's middle."""
    known = scenario()
    tracker = run(known)
    points, dwell = known.following.pattern.points, known.scanner.dwell
    period = known.following.visiting.period(points, dwell, 2, known.scanner.galvanometers)
    for visit in range(8):
        state = tracker.state
        record = next(tracker)
        asked = tracker._visits._sensor.asked[-1]
        index = visit % 2
        assert (record.number, asked.visit, record.target) == (visit, visit, ("a/1", "b/1")[index])
        assert asked.order.number == visit // 2
        start = state.clock + period - points * dwell
        middle = start + 0.5 * points * dwell
        expected = command(state.tracks[index], known.following.tracker, 0.1, middle)
        np.testing.assert_allclose(asked.order.position, expected.position, rtol=0.0, atol=1e-12)
        assert asked.motion.time[0, 0] >= start
        assert tracker.state.clock == pytest.approx(
            max(start + points * dwell, tracker.state.mirrors.time), abs=1e-12
        )
        assert tracker.state.visits == visit + 1
        assert record.time == pytest.approx(float(asked.motion.time.mean()) + 1e-4)
        truth, point = tracker._visits._recorders[0].truth(known.targets[index], record.time)
        np.testing.assert_array_equal(record.truth, truth)
        np.testing.assert_array_equal(record.truth_point, point)
        np.testing.assert_allclose(record.point, point, atol=1e-12)
    assert all(track.mode is TrackMode.TRACK for track in tracker.state.tracks)


def test_voxels_of_a_pattern_are_a_dwell_apart_with_the_laser_off_for_a_part_of_it(run: Any) -> None:
    """Claim: a laser that is off for a quarter of each dwell shines on every voxel of a pattern for less, but the
    voxels follow one another by the dwell, and the mirrors are where they end."""
    known = scenario()
    known = known.model_copy(update={"scanner": known.scanner.model_copy(update={"laser_off": 0.25})})
    tracker, dwell = run(known), known.scanner.dwell
    assert known.scanner.exposure == pytest.approx(0.75 * dwell)
    for _ in range(2):
        next(tracker)
        time = tracker._visits._sensor.asked[-1].motion.time[0]
        np.testing.assert_allclose(np.diff(time), dwell, rtol=1e-6)
        assert tracker.state.mirrors.time == pytest.approx(time[-1] + 0.5 * dwell, abs=1e-9)


def test_a_late_pattern_moves_those_that_follow(run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    known = scenario()
    tracker, true = run(known), module.run_visits
    numbers = []

    def late(galvanometers: Any, mirrors: Any, pattern: Any, course: Any, **asked: Any) -> Any:
        numbers.append(int(course.number[0]))
        motion, (after,) = true(galvanometers, mirrors, pattern, course, **asked)
        end = float(course.start[0]) + pattern.points * asked["dwell"]
        return motion, [replace(after, time=end + LATE)]

    monkeypatch.setattr(module, "run_visits", late)
    starts = [tracker._visits.start(tracker.state)]
    for _ in range(4):
        next(tracker)
        starts.append(tracker._visits.start(tracker.state))
    points, dwell = known.following.pattern.points, known.scanner.dwell
    period = known.following.visiting.period(points, dwell, 2, known.scanner.galvanometers)
    np.testing.assert_allclose(np.diff(starts), period + LATE, rtol=1e-9)
    assert numbers == [0, 0, 1, 1]


def test_looking_ahead_changes_no_visit(run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a visit takes up what was done ahead of it and is the same; after a command mirrors are run anew."""
    known, true = scenario(), module.run_visits
    numbers = []

    def counted(*given: Any, **asked: Any) -> Any:
        numbers.append(int(given[3].number[0]))
        return true(*given, **asked)

    monkeypatch.setattr(module, "run_visits", counted)
    plain, ahead = run(known), run(known)
    for visit in range(8):
        own = next(plain)
        numbers.clear()
        assert [ahead.look_ahead() for _ in range(3)] == [True, True, False]
        other = next(ahead)
        assert numbers == [visit // 2]
        assert (own.number, own.target, own.time) == (other.number, other.target, other.time)
        np.testing.assert_array_equal(own.position, other.position)
        np.testing.assert_array_equal(own.truth, other.truth)
        for asked, before in zip(
            vars(ahead._visits._sensor.asked[-1].motion).values(),
            vars(plain._visits._sensor.asked[-1].motion).values(),
            strict=True,
        ):
            np.testing.assert_array_equal(asked, before)
    ahead.look_ahead()
    for tracker in (plain, ahead):
        tracker.point("a/1", 0.1, 0.05, 7.0)
        next(tracker)
    eyes = [tracker._visits._sensor.asked[-1] for tracker in (plain, ahead)]
    assert [eye.order.mode for eye in eyes] == 2 * [TrackMode.SEARCH]
    np.testing.assert_array_equal(eyes[0].motion.true_theta, eyes[1].motion.true_theta)


def test_nothing_is_ahead_of_a_run_that_is_over_or_out_of_view(run: Any) -> None:
    tracker = run(scenario({"target": "a", "expected": (0.6, 0.0, 8.0)}))
    assert not tracker.look_ahead()
    tracker = run(scenario())
    tracker.wait(30.0)
    assert not tracker.look_ahead()


def test_others_are_those_that_are_followed(run: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a target that was dropped cannot take another's measurement."""
    tracker, true = run(scenario()), module.advance_all
    seen = []

    def advance_all(*state: Any) -> Any:
        seen.append(len(state[-1][0]))
        return true(*state)

    monkeypatch.setattr(module, "advance_all", advance_all)
    for _ in range(6):
        next(tracker)
    assert seen[-1] == 1
    tracker.drop("b/1")
    assert next(tracker).target == "a/1"
    assert next(tracker).target == "a/1"
    assert seen[-2:] == [0, 0]


def test_a_measurement_is_there_after_the_last_voxel_of_its_pattern(run: Any) -> None:
    """Claim: when that voxel's dwell has ended, and the latency with it."""
    known = scenario()
    tracker = run(known)
    for _ in range(3):
        record = next(tracker)
        late = 0.5 * known.scanner.dwell + known.scanner.latency.whole
        assert record.available == pytest.approx(float(record.samples.time.max()) + late, abs=1e-9)


def test_others_are_those_whose_place_is_known() -> None:
    """Claim: targets that are followed and tracked, but for that whose turn it is; not those searched for or lost."""
    modes = (TrackMode.TRACK, TrackMode.SEARCH, TrackMode.LOST, TrackMode.TRACK, TrackMode.TRACK)
    tracks = [SimpleNamespace(mode=mode, motion=number) for number, mode in enumerate(modes)]
    state = SimpleNamespace(tracks=tracks, followed=(True, True, True, True, False))
    for index, others in ((0, [3]), (3, [0]), (1, [0, 3])):
        turn: Any = SimpleNamespace(state=state, index=index)
        assert module._others(turn) == others


def test_a_new_search_keeps_the_count_of_patterns(run: Any) -> None:
    """Claim: patterns go on being turned by their number, so that no dither is run twice."""
    tracker = run(scenario())
    for _ in range(6):
        next(tracker)
    tracker.drop("a/1")
    tracker.search("a/1")
    assert tracker.state.followed == (True, True)
    assert (tracker.state.tracks[0].patterns, tracker.state.tracks[0].mode) == (3, TrackMode.SEARCH)
    tracker.point("b/1", 0.1, 0.05, 7.0)
    assert (tracker.state.tracks[1].patterns, tracker.state.tracks[1].mode) == (3, TrackMode.SEARCH)
    np.testing.assert_array_equal(tracker.state.tracks[1].expected, [0.1, 0.05, 7.0])


def test_targets_out_of_view_take_no_time_but_where_there_are_no_others(run: Any) -> None:
    """Claim: of two such targets the second lets a period go by; with another in view only its visits do."""
    out = {"target": "a", "expected": (0.6, 0.0, 8.0)}, {"target": "b", "expected": (-0.6, 0.0, 8.0)}
    known = scenario(*out)
    points, dwell = known.following.pattern.points, known.scanner.dwell
    period = known.following.visiting.period(points, dwell, 2, known.scanner.galvanometers)
    for other, name, visited in ((out[1], "b/1", False), ("c", "c/1", True)):
        tracker = run(scenario(out[0], other))
        told = [(next(tracker), tracker.state) for _ in range(4)]
        assert [record.target for record, _ in told] == ["a/1", name, "a/1", name]
        missed = [record.status is TrackStatus.OUT_OF_VIEW for record, _ in told]
        assert missed == [True, not visited, True, not visited]
        assert len(tracker._visits._sensor.asked) == 2 * visited
        # Mirrors begin with an update of their drive: up to one late at each visit.
        clocks = [state.clock for _, state in told]
        late = 2.01 * visited * dwell / known.following.visiting.updates
        np.testing.assert_allclose(clocks, [0.0, period, period, 2.0 * period], rtol=1e-9, atol=late)
        assert [state.skipped for _, state in told] == [1, 0, 1, 0]


def test_a_pattern_is_in_view_with_all_of_its_width(run: Any) -> None:
    """Claim: |Θ| + A and |φ| + a A lie within the largest deflection, 0.5 rad; a is the pattern's aspect."""
    tracker = run(scenario(aspect=2.0))
    for theta, phi, inside in ((0.47, 0.0, True), (0.49, 0.0, False), (0.0, 0.45, True), (0.0, 0.47, False)):
        for sign in (1.0, -1.0):
            place = np.array([sign * theta, sign * phi, 8.0])
            assert tracker._visits.in_view(TrackCommand(TrackMode.TRACK, place, 0.02, 0)) is inside


@pytest.mark.parametrize(
    ("theta", "phi", "wanted"),
    [(0.1, -0.2, 0.01), (-0.4915, 0.1, 0.0085), (0.1, 0.483, 0.0085), (0.495, 0.1, 1.22 * 0.00625)],
)
def test_a_search_has_the_room_that_the_mirrors_leave(
    run: Any, theta: float, phi: float, wanted: float
) -> None:
    """Claim: a disc of 0.1 m at 8 m, searched with 1.6 of its radius, is searched with what is left to 0.5 rad where
    that is less, in φ for a pattern that is twice as high; never with less than 1.22 of its radius."""
    tracker = run(scenario({"target": "a", "expected": (theta, phi, 8.0)}, aspect=2.0))
    visits, state = tracker._visits, tracker.state
    order = visits._order(state, 0, visits._middle(visits.start(state)), 0)
    assert order.mode is TrackMode.SEARCH
    assert order.amplitude == pytest.approx(wanted)
    # A target that was lost is looked for in the same room.
    lost = replace(state.tracks[0], mode=TrackMode.LOST)
    order = visits._order(module.with_track(state, 0, lost), 0, visits._middle(visits.start(state)), 0)
    assert order.mode is TrackMode.LOST
    assert order.amplitude == pytest.approx(wanted)


def test_an_amplitude_is_fixed_until_it_is_left_to_the_tracker_again(run: Any) -> None:
    """Claim: each target's own, above 0 and below 1.5 rad; of what is named otherwise nothing changes."""
    tracker = run(scenario())
    tracker.amplitude("b/1", 0.013)
    assert tracker.state.amplitudes == (None, 0.013)
    for _ in range(2):
        next(tracker)
    assert tracker._visits._sensor.asked[0].order.amplitude != 0.013
    assert tracker._visits._sensor.asked[1].order.amplitude == 0.013
    tracker.amplitude("a/1", 1.49)
    for refused in (0.0, -0.02, 1.51, float("nan")):
        with pytest.raises(InputError, match="no amplitude"):
            tracker.amplitude("a/1", refused)
    tracker.amplitude("b/1", None)
    assert tracker.state.amplitudes == (1.49, None)


def test_truth_is_the_turned_objects_centre_at_that_time() -> None:
    known = scenario()
    item = known.scene.objects[0]
    target = replace(known.targets[0], centre=np.array([0.2, -0.1, 0.0]))
    pose = item.pose_at(3.0)[0]
    expected = pose[:3, :3] @ target.centre + pose[:3, 3]
    truth, point = Recorder(known).truth(target, 3.0)
    np.testing.assert_allclose(point, expected, rtol=1e-12)
    # 0.6 rad about z, and 3 s on its way.
    turned = np.array([[np.cos(0.6), -np.sin(0.6)], [np.sin(0.6), np.cos(0.6)]]) @ [0.2, -0.1]
    np.testing.assert_allclose(point[:2], [-0.5 + 0.15 + turned[0], 0.1 + 0.06 + turned[1]], atol=1e-12)
    distance, theta, phi = angles_and_range(*expected, known.scanner.mirrors.axis_separation)
    np.testing.assert_allclose(truth, [theta, phi, distance], rtol=1e-12)


def test_a_point_has_the_covariance_that_its_place_gives_it(run: Any) -> None:
    tracker = run(scenario())
    record = next(tracker)
    separation = tracker.scenario.scanner.mirrors.axis_separation
    rows = [
        (point_of(record.position + step, separation)[0] - point_of(record.position - step, separation)[0])
        / 2e-6
        for step in 1e-6 * np.eye(3)
    ]
    slope = np.array(rows).T
    np.testing.assert_allclose(
        record.point_covariance, slope @ record.covariance @ slope.T, rtol=1e-5, atol=1e-13
    )


@pytest.mark.parametrize(("limited", "status"), [(True, TrackStatus.LIMITED), (False, TrackStatus.NOT_FOUND)])
def test_what_was_not_seen_may_lie_at_the_mirrors(run: Any, limited: bool, status: TrackStatus) -> None:
    """Claim: without a target no position is told, whatever a fit made of the pattern, and of its errors no
    part: their columns give back that none is known."""
    tracker = run(scenario())
    record = next(tracker)
    lost = tracker.state.tracks[0]
    nothing = replace(module.NOTHING, position=np.ones((1, 3)), covariance=np.eye(3)[None])
    after = module.advance(lost, nothing, tracker._scan.tracker, 0.1, 1.0)
    order = TrackCommand(TrackMode.TRACK, record.position, 6e-3, 1)
    made = tracker._visits._recorders[0].record(
        1,
        tracker.targets[0],
        order,
        after,
        record.samples,
        nothing,
        ErrorParts.stack([record.errors]),
        limited,
    )
    assert made.status is status
    assert made.time == pytest.approx(float(record.samples.time.mean()))
    for told in (made.position, made.covariance, made.point, made.point_covariance):
        assert np.isnan(told).all()
    parts = ErrorParts.stack([made.errors])
    again = errors_from(error_columns(parts), made.covariance[None])
    for field in fields(parts):
        assert np.isnan(getattr(parts, field.name)).all()
        np.testing.assert_allclose(
            getattr(again, field.name), getattr(parts, field.name), rtol=1e-12, atol=1e-18
        )


def test_things_are_where_they_stand_in_the_middle_of_a_pattern(run: Any) -> None:
    """Claim: the world is asked for the mean of the first and the last shot's time, and for what was used of it."""
    tracker, asked = run(scenario()), []

    def at(time: float, used: Any) -> tuple[Any, Any]:
        asked.append((time, used))
        return None, used

    tracker._visits._situations[0] = SimpleNamespace(at=at, follow=lambda _: None)
    for _ in range(3):
        used = tracker.state.used
        next(tracker)
        (time,) = tracker._visits._sensor.asked[-1].motion.time
        assert asked.pop() == (pytest.approx(0.5 * (time[0] + time[-1]), rel=1e-12), used)
    assert asked == []


def test_what_a_run_has_not_seen_is_said() -> None:
    """Claim: of targets without a visit, and of those without a measurement, with what was mostly the matter; of one
    that was measured once nothing is said; what is said of the scene stands before."""
    known = scenario("a", "b", "c")
    names = [target.name for target in known.targets]
    codes = [TrackStatus.NOT_FOUND, TrackStatus.REFUSED, TrackStatus.REFUSED, TrackStatus.MEASURED]
    records: Any = [SimpleNamespace(target=names[1], status=code) for code in codes[:3]]
    records += [SimpleNamespace(target=names[2], status=code) for code in codes[1:]]
    assert track_of(known, tuple(records), Axes(0.05), ("it is dark",)).warnings == (
        "it is dark",
        f"'{names[0]}' was never visited: the run is too short",
        f"'{names[1]}' was never measured; mostly: {TrackStatus.REFUSED.sentence}",
    )


def test_a_track_has_the_seed_of_its_scenario_and_not_that_of_its_light() -> None:
    """Claim: of a run whose light was drawn by another seed, what is kept names the seed that its scenario has."""
    known = scenario()
    lit = known.transport.model_copy(update={"light_seed": 3})
    track = track_of(known.model_copy(update={"seed": 7, "transport": lit}), (), Axes(0.05))
    assert track.seed == 7
    lines = [line.strip() for line in track.scenario_yaml.splitlines()]
    assert {"seed: 7", "light_seed: 3"} <= set(lines)


def test_a_visit_is_that_of_the_state_that_is_handed_over(run: Any) -> None:
    """Claim: whoever tries out visits from other states than the run's own gets those that the run made from them, in
    any order, and the run is where it was."""
    tracker = run(scenario())
    states, records = [tracker.state], []
    for _ in range(5):
        records.append(next(tracker))
        states.append(tracker.state)
    for number in (3, 0, 4, 1, 2):
        record, after = tracker.visit(states[number])
        assert (record.number, record.time) == (number, records[number].time)
        np.testing.assert_array_equal(record.position, records[number].position)
        assert (after.visits, after.clock) == (states[number + 1].visits, states[number + 1].clock)
        np.testing.assert_array_equal(after.mirrors.state.angle, states[number + 1].mirrors.state.angle)
        assert tracker.state is states[-1]


def test_a_search_during_a_run_begins_then(run: Any) -> None:
    """Claim: what is known of a target that is searched for is what is known of one that is pointed at where it is
    expected: a place at the run's time, and no rates. A state that is read or saved tells so."""
    searched, pointed = run(scenario()), run(scenario())
    for tracker in (searched, pointed):
        for _ in range(6):
            next(tracker)
    expected = searched.state.tracks[0].expected
    searched.search("a/1")
    pointed.point("a/1", *expected.tolist())
    known, same = searched.state.tracks[0].motion, pointed.state.tracks[0].motion
    assert searched.time > 0.0
    assert float(known.time) == searched.time
    np.testing.assert_array_equal(known.mean, [*expected, 0.0, 0.0, 0.0])
    for one, other in zip(known, same, strict=True):
        np.testing.assert_array_equal(one, other)
