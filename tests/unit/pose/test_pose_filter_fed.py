"""The filter that is fed with records: it begins by itself, tells later times, and takes in what it is told."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from claims import LEVEL, mean_square
from made_track import DG, make_track
from numpy.typing import NDArray
from scipy.stats import chi2

from scanner_sim import FilteredPose, InputError, PoseFilter
from scanner_sim.pose.collinearity import project
from scanner_sim.pose.first_motions import Push
from scanner_sim.pose.pose_filter import FilterStatus
from scanner_sim.tracking.errors import ErrorParts
from scanner_sim.tracking.record import PatternRecord, Track, TrackStatus

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def run() -> Track:
    """Four targets on one object for 0.4 s."""
    return make_track(objects=1)


def fed(
    run: Track, records: tuple[PatternRecord, ...] | None = None
) -> tuple[PoseFilter, list[FilteredPose]]:
    poses = PoseFilter(run.targets, axis_separation=DG)
    return poses, [poses.update(record) for record in (run.records if records is None else records)]


def test_it_carries_the_reference_filters_state(run: Track) -> None:
    """Claim: fed with records it says what the law does of them, from the first visit on that three targets allow.

    With errors that are told to be white, as those of this run are, squared distances have the law of χ², but for a
    twentieth, the accelerations that the filter grants and the run lacks; so has the last position.
    """
    run = replace(
        run,
        records=tuple(
            replace(record, errors=ErrorParts.all_white(record.covariance)) for record in run.records
        ),
    )
    poses, said = fed(run)
    starting = [pose.status is FilterStatus.STARTING for pose in said]
    begun = starting.index(False)
    assert 2 <= begun <= 8
    assert all(starting[:begun])
    assert not any(starting[begun:])
    state = poses.model.begin(run.records[: begun + 1])
    for record, pose in zip(run.records[begun + 1 :], said[begun + 1 :], strict=True):
        state = poses.model.updated(state, record)
        if record.status is not TrackStatus.MEASURED:
            continue
        np.testing.assert_array_equal(pose.position, state.position[0])
        np.testing.assert_array_equal(pose.covariance, state.covariance_of(0))
        assert pose.surprise == state.surprise
    error = said[-1].position - [-1.2 + 4e-3, 0.2, 8.0 - 2e-3]
    assert error @ np.linalg.solve(said[-1].covariance[:3, :3], error) < chi2.isf(LEVEL, 3)
    distances = np.array([pose.surprise for pose in said[begun + 1 :]])
    claim = mean_square(np.sqrt(distances / 3.0), freedom=3 * len(distances), slack=0.05)
    assert claim, claim


def test_it_is_causal_and_refused_visits_change_nothing(run: Track) -> None:
    """Claim: what it said of a visit does not depend on later ones; lost, late and foreign ones are passed over."""
    _, said = fed(run)
    _, part = fed(run, run.records[:20])
    np.testing.assert_array_equal(part[-1].covariance, said[19].covariance)
    poses, _ = fed(run, run.records[:20])
    before, last = poses.state, run.records[20]
    for other in (
        replace(last, status=TrackStatus.REFUSED),
        replace(last, target="stranger"),
        replace(last, time=run.records[18].time),
    ):
        poses.update(other)
        assert poses.state is before


def test_it_tells_later_times_and_says_when_it_coasts(run: Track) -> None:
    """Claim: a prediction goes on evenly and its σ grows; a tenth of a second is fresh, a second is not; the past is no
    prediction, and asking changes nothing."""
    poses, said = fed(run)
    last = said[-1]
    soon, late = poses.predict(last.time + 0.1), poses.predict(last.time + 1.0)
    assert (soon.status, late.status) == (FilterStatus.FOLLOWING, FilterStatus.COASTING)
    np.testing.assert_allclose(late.position, last.position + last.velocity, rtol=1e-12)
    assert (late.sigma[:3] > soon.sigma[:3]).all()
    assert (soon.sigma[:3] > last.sigma[:3]).all()
    np.testing.assert_array_equal(poses.predict(last.time).covariance, last.covariance)
    # A fifth of a second is what it waits where nobody says how long.
    waits = [poses.predict(last.time + after).status for after in (0.199, 0.201)]
    assert waits == [FilterStatus.FOLLOWING, FilterStatus.COASTING]
    with pytest.raises(InputError, match="before the last visit"):
        poses.predict(last.time - 1e-3)


def test_a_push_changes_the_velocity_from_its_time_on(run: Track) -> None:
    """Claim: a told change of velocity moves what comes after it, by its σ less surely, and leaves what is before."""
    poses, said = fed(run)
    end = said[-1].time
    poses.push((0.1, 0.0, -0.2), time=end + 0.5, sigma=1e-2)
    before, then = poses.predict(end + 0.4), poses.predict(end + 1.0)
    plain, _ = fed(run)
    np.testing.assert_array_equal(before.position, plain.predict(end + 0.4).position)
    moved = then.position - plain.predict(end + 1.0).position
    np.testing.assert_allclose(moved, [0.05, 0.0, -0.1], atol=1e-12)
    more = np.diag(then.covariance)[6:9] - np.diag(plain.predict(end + 1.0).covariance)[6:9]
    np.testing.assert_allclose(more, 1e-4, rtol=1e-9)
    later = replace(run.records[-1], time=end + 0.6)
    poses.update(later)
    assert poses.state is not None
    assert not poses._pushes


def test_a_visit_after_a_push_meets_what_was_predicted(run: Track) -> None:
    """Claim: a visit that tells next to nothing leaves the pose that was predicted for its time, with two pushes at
    their own times before it: 0.1 m/s moves by 10 mm in the last tenth of a second."""
    poses, said = fed(run)
    end = said[-1].time
    for after, change in ((0.2, (0.0, 0.1, 0.0)), (0.5, (0.1, 0.0, -0.2))):
        poses.push(change, time=end + after, sigma=1e-3)
    wanted = poses.predict(end + 0.6)
    last = run.records[-1]
    found = poses.update(
        replace(last, time=end + 0.6, errors=replace(last.errors, white=last.errors.white + 1e6 * np.eye(3)))
    )
    np.testing.assert_allclose(found.position, wanted.position, atol=1e-9)
    np.testing.assert_allclose(found.velocity, wanted.velocity, atol=1e-9)
    np.testing.assert_allclose(found.covariance, wanted.covariance, rtol=1e-6, atol=1e-12)


def test_a_push_before_the_beginning_counts_once(run: Track) -> None:
    """Claim: a push that is told between the first visits is part of the motion with which the filter begins, and is
    not taken in again with the visits that follow."""
    first, second = run.records[:2]
    time, change = 0.5 * (first.time + second.time), np.array([2e-3, 0.0, -1e-3])
    poses = PoseFilter(run.targets, axis_separation=DG)
    poses.update(first)
    poses.push(change, time=time, sigma=1e-3)
    begun = next(
        number
        for number, record in enumerate(run.records[1:], 1)
        if poses.update(record).status != "starting"
    )
    state = poses.model.begin(run.records[: begun + 1], [Push(time, 0, change, 1e-3)])
    for record in run.records[begun + 1 : begun + 4]:
        state = poses.model.updated(state, record)
        poses.update(record)
    assert poses.state is not None
    np.testing.assert_array_equal(poses.state.velocity, state.velocity)
    np.testing.assert_array_equal(poses.state.covariance, state.covariance)


def test_it_says_where_a_target_is_to_be_seen(run: Track) -> None:
    """Claim: place, rates and covariance are those of the predicted pose: against differences of the projection."""
    poses, said = fed(run)
    time = said[-1].time + 0.3
    pose, seen = poses.predict(time), poses.sight("node/3", time)
    point = np.asarray(poses.model.targets["node/3"][1])

    def at(error: Array) -> Array:
        turned = pose.rotation @ point
        where = pose.position + error[:3] + turned + np.cross(error[3:6], turned)
        return np.asarray(project(where[:, None], DG, with_range=True)[0][:, 0])

    np.testing.assert_allclose(seen.position, at(np.zeros(6)), rtol=1e-12)
    step = 1e-6
    onward = poses.predict(time + 1e-4)
    ahead = project((onward.position + onward.rotation @ point)[:, None], DG, with_range=True)[0][:, 0]
    np.testing.assert_allclose(seen.rates, (ahead - seen.position) / 1e-4, atol=1e-6)
    slope = np.stack([(at(step * one) - at(-step * one)) / (2.0 * step) for one in np.eye(6)], axis=1)
    np.testing.assert_allclose(seen.covariance[:3, :3], slope @ pose.covariance[:6, :6] @ slope.T, rtol=1e-5)
    assert np.linalg.eigvalsh(seen.covariance)[0] > 0.0


def test_what_it_cannot_do_is_refused(run: Track) -> None:
    with pytest.raises(InputError, match="three targets"):
        PoseFilter(run.targets[:2], axis_separation=DG)
    three = {"a": (0.0, 0.0, 0.0), "b": (1.0, 0.0, 0.0), "c": (0.0, 1.0, 0.0)}
    others = {f"other/{name}": place for name, place in three.items()}
    assert PoseFilter({"one": three, "other": others}, axis_separation=DG).objects == ("one", "other")
    with pytest.raises(InputError, match="two objects have a target 'b'"):
        PoseFilter({"one": three, "other": {**others, "b": three["b"]}}, axis_separation=DG)
    with pytest.raises(InputError, match="three targets"):
        PoseFilter({"one": three, "other": {name: three[name] for name in "ab"}}, axis_separation=DG)
    poses = PoseFilter(run.targets, axis_separation=DG)
    unknown = poses.predict(0.0)
    for value, shape in (
        (unknown.position, (3,)), (unknown.velocity, (3,)), (unknown.turn_rate, (3,)),
        (unknown.rotation, (3, 3)), (unknown.covariance, (12, 12)),
    ):  # fmt: skip
        np.testing.assert_array_equal(value, np.full(shape, np.nan))
    with pytest.raises(InputError, match="no pose yet"):
        poses.sight("node/1", 0.0)
    with pytest.raises(InputError, match="knows no target"):
        poses.sight("node/9", 0.0)
    with pytest.raises(InputError, match="knows no 'other'"):
        poses.predict(0.0, "other")
    wrong: tuple[Any, ...] = ((0.0, np.nan, 0.0), (0.0, "fast", 0.0), (0.0, None), 0.0)
    for change in wrong:
        with pytest.raises(InputError, match="no change of a velocity"):
            poses.push(change, time=0.0)
    for record in run.records:
        poses.update(record)
    poses.restart()
    assert poses.predict(0.0).status is FilterStatus.STARTING


def test_numbers_stay_numbers_at_the_limits(run: Track) -> None:
    """Claim: pushes up to the largest speed of an object and times up to the latest of a run give finite poses, as do
    the visits after; anything beyond is refused and changes nothing."""
    poses, untold = (PoseFilter(run.targets, axis_separation=DG) for _ in range(2))
    for record in run.records[:40]:
        poses.update(record)
        untold.update(record)
    now = run.records[39].time
    for velocity, sigma in (((0.0, 1.01e5, 0.0), 0.0), ((0.0, 0.0, -1e300), 0.0), ((0.0, 0.0, 0.0), 1e200)):
        with pytest.raises(InputError, match="no change of an object's velocity"):
            poses.push(velocity, time=now, sigma=sigma)
    with pytest.raises(InputError, match="s is too late"):
        poses.predict(1.01e9)
    with pytest.raises(InputError, match="s is too late"):
        poses.push((0.0, 0.1, 0.0), time=1.01e9)
    for target, one in (("", poses.predict(now + 0.1)), ("node/1", poses.sight("node/1", now + 0.1))):
        other = untold.sight(target, now + 0.1) if target else untold.predict(now + 0.1)
        np.testing.assert_array_equal(one.covariance, other.covariance)
        np.testing.assert_array_equal(one.position, other.position)
    poses.push((-1e5, 1e5, 1e5), time=now, sigma=1e5)
    for one in (poses.predict(now + 1.0), poses.predict(1e9)):
        assert np.isfinite([*one.position, *one.velocity, *one.covariance.ravel()]).all()
    for record in run.records[40:]:
        assert np.isfinite(poses.update(record).covariance).all()


def test_objects_with_two_targets_are_left_out(run: Track) -> None:
    """Claim: of a tracker's targets those count whose object has three."""
    pair = [replace(target, object="other", name=f"other/{target.name}") for target in run.targets[:2]]
    assert PoseFilter([*run.targets, *pair], axis_separation=DG).objects == ("node",)


def test_two_targets_are_too_few_to_begin(run: Track) -> None:
    two = [record for record in run.records if record.target in {target.name for target in run.targets[:2]}]
    with pytest.raises(InputError, match="2 targets were measured"):
        PoseFilter(run.targets, axis_separation=DG).model.begin(two)


def test_a_pose_is_fresh_for_its_patience_and_no_longer(run: Track) -> None:
    """Claim: until the patience is over since the last visit it follows, from then on it coasts."""
    last = max(record.time for record in run.records)
    until = last + 0.3
    poses = PoseFilter(run.targets, axis_separation=DG, patience=until - last)
    for record in run.records:
        poses.update(record)
    assert poses.predict(until).status is FilterStatus.FOLLOWING
    assert poses.predict(float(np.nextafter(until, 9.0))).status is FilterStatus.COASTING


def test_a_push_moves_the_body_that_is_pushed() -> None:
    """Claim: of two bodies the first motion of the one that is pushed knows of it, that of the other is as without."""
    run = make_track()
    model, visits = PoseFilter(run.targets, axis_separation=DG).model, run.records[:32]
    seen = [record for record in visits if record.status is TrackStatus.MEASURED]
    time = 0.5 * (seen[0].time + seen[-1].time)
    plain = model._first(seen, [])
    for body in (0, 1):
        found = model._first(seen, [Push(time, body, np.array([3e-3, -2e-3, 4e-3]), 1e-3)])
        other = 1 - body
        for name in ("position", "rotation", "velocity", "turn_rate"):
            np.testing.assert_array_equal(getattr(found, name)[other], getattr(plain, name)[other])
        assert np.abs(found.velocity[body] - plain.velocity[body]).max() > 1e-3


@pytest.mark.parametrize("turned", [False, True])
def test_what_names_no_object_is_of_the_first(turned: bool) -> None:
    """Claim: with two objects, in either order, a prediction without a name is of the one whose targets come first; so
    is a push: 0.1 m/s from the last visit on move that one alone, by 50 mm in half a second."""
    run = make_track()
    poses = PoseFilter(run.targets[::-1] if turned else run.targets, axis_separation=DG)
    for record in run.records:
        poses.update(record)
    end = run.records[-1].time
    first, second = ("z1", "node") if turned else ("node", "z1")
    assert poses.objects == (first, second)
    before = {name: poses.predict(end + 0.5, name) for name in (first, second)}
    # The objects stand 2.4 m apart.
    assert np.linalg.norm(before[first].position - before[second].position) > 2.0
    said = poses.predict(end + 0.5)
    assert said.object == first
    np.testing.assert_array_equal(said.position, before[first].position)
    poses.push((0.0, 0.1, 0.0), time=end)
    moved = {name: poses.predict(end + 0.5, name).position - before[name].position for name in before}
    np.testing.assert_allclose(moved[first], [0.0, 0.05, 0.0], atol=1e-12)
    np.testing.assert_array_equal(moved[second], 0.0)


def test_a_filter_takes_each_of_its_settings_for_what_it_is() -> None:
    """Claim: accelerations and fastest motions are those of places and those of turns, in this order."""
    three = {"a": (0.0, 0.0, 0.0), "b": (1.0, 0.0, 0.0), "c": (0.0, 1.0, 0.0)}
    settings = {"acceleration": 2e-6, "turn_acceleration": 3e-6, "fastest": 0.4, "fastest_turn": 0.5}
    found = PoseFilter({"one": three}, axis_separation=DG, **settings).model
    for name, value in settings.items():
        assert getattr(found, name) == value
