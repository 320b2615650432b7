"""A track whose world is told from outside, visit by visit: what moves, and what lights it."""

from __future__ import annotations

import gc
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from same_bytes import content

from scanner_sim import InputError, Scenario, Tracker, load_scenario, simulate, track, track_many
from scanner_sim.analytic import geometry as judge
from scanner_sim.scene.light.clock import SkyClock
from scanner_sim.tracking.record import PatternRecord, TrackStatus

pytestmark = pytest.mark.usefixtures("device")
Array = NDArray[np.float64]

SPEED = 2.0**-4
"""Velocity along x, half that along z [m/s]: a power of two, so that x₀ + v t is rounded once, however summed."""
START = (0.125, 0.0, 7.0)
SUN = {"sun": {"direction": [-0.35, -0.45, -0.8]}}
LOW_ORBIT = {"orbit": {"anomaly": 0.3}}


def scenario(motion: Any = None, lighting: Any = None, **more: Any) -> Scenario:
    array = {"diameter": 0.1, "plate": 0.3, "columns": 2, "spacing": [0.4, 0.4]}
    motion = {"type": "twist"} if motion is None else motion
    node = {"name": "node", "array": array, "position": START, "motion": motion}
    wall = {
        "name": "wall",
        "shape": "rectangle",
        "size": (1, 1),
        "material": "z93_white",
        "position": (3, 0, 9),
    }
    hung = {
        "name": "hung",
        "shape": "sphere",
        "diameter": 0.1,
        "material": "z93_white",
        "position": (0, 2, 0),
    }
    scene = {"objects": [node, wall, {**hung, "parent": "node"}]}
    scan = {"type": "track", "targets": ["node"], "duration": 0.2} | more.pop("scan", {})
    light = {} if lighting is None else {"lighting": lighting}
    few = {"pattern_beamlets": 19, "background_samples": 2}
    return load_scenario(
        {"schema": 1, "seed": 4, "scene": scene, "scan": scan, "transport": few} | light | more
    )


def placed(time: float) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = START[0] + SPEED * time, START[1], START[2] + 2.0 * SPEED * time
    return pose


def told(known: Scenario, visits: int = 100) -> tuple[Tracker, list[PatternRecord]]:
    """Follow what is told to move evenly before every visit, at times of few bits."""
    tracker, records = Tracker(known), []
    while not tracker.finished and len(records) < visits:
        time = float(np.ceil(tracker.time * 1024.0) / 1024.0)
        tracker.move("node", np.eye(4), time=time)
        tracker.move("node", placed(time), velocity=(SPEED, 0.0, 2.0 * SPEED), time=time)
        records.append(next(tracker))
    return tracker, records


def rendered(tracker: Tracker) -> tuple[int, list[int]]:
    """Return how often kernels were recorded, and windows of the background rendered."""
    frozen: Any = tracker._visits._sensor._instrument
    recorded = sum(each.recordings for window in frozen.windows for each in window._renderers.values())
    return frozen.recordings + recorded, [window.rendered for window in frozen.windows]


@pytest.mark.parametrize(
    "lighting",
    [None, *(pytest.param(sky, marks=pytest.mark.slow) for sky in (SUN, LOW_ORBIT))],
    ids=["dark", "sunlit", "orbit"],
)
def test_moved_visit_by_visit_equals_the_motion(lighting: Any, tmp_path: Path) -> None:
    """Claim: an object that is told before every visit where it is and how fast gives the bytes of a motion of a file:
    voxels, background and truth. So does the scenario in which the moves were kept.

    Set-up: 10 pixels a second; times and speeds of few bits, so that both sums round alike. It can fail by a window
    that keeps an old pose, an old slot or an old sky.
    """
    tracker, records = told(scenario(lighting=lighting))
    rows = [",".join(map(str, (time, *placed(time)[:3, 3], 1, 0, 0, 0))) for time in (0.0, 1.0)]
    (tmp_path / "node.csv").write_text("\n".join(["time_s,x_m,y_m,z_m,qw,qx,qy,qz", *rows]))
    filed = track(scenario({"type": "file", "file": tmp_path / "node.csv"}, lighting)).records
    assert len(records) == len(filed) == 20
    assert sum(record.status is TrackStatus.MEASURED for record in records) > 15
    assert content(records) == content(list(filed))
    assert content(list(track(tracker.scenario).records)) == content(records)


@pytest.mark.slow
def test_an_even_turn_is_that_of_a_twist_under_the_sun() -> None:
    """Claim: the same of a turn, whose sums round otherwise: voxels alike, truth within a few roundings."""
    rates = np.array([0.0, 0.1, 0.25])
    tracker, records = Tracker(scenario(lighting=SUN)), []
    twist = track(scenario({"type": "twist", "turn_rate": rates.tolist()}, SUN)).records
    item = scenario({"type": "twist", "turn_rate": rates.tolist()}).scene.objects[0]
    while not tracker.finished:
        tracker.move("node", item.pose_at(tracker.time)[0], turn_rate=rates)
        records.append(next(tracker))
    for one, other in zip(records, twist, strict=True):
        np.testing.assert_allclose(one.truth_point, other.truth_point, rtol=0.0, atol=1e-13)
        np.testing.assert_allclose(one.samples.signal, other.samples.signal, rtol=1e-5)


def test_moves_record_no_kernel_and_windows_follow() -> None:
    """Claim: other poses, speeds and skies launch what was recorded; a window is rendered anew where what it shows has
    moved by more than a quarter of a bin, and not where it has moved by less."""
    tracker, _ = told(scenario(lighting=SUN, scan={"duration": 9.0}), 8)
    # Materials of all scenes are part of a kernel: one of another test that ends meanwhile has all recorded anew.
    gc.collect()
    next(tracker)
    kernels, before = rendered(tracker)
    here = placed(tracker.time)
    for shift in (0.0, 1e-5, 2e-5, 0.0):
        pose = here.copy()
        pose[0, 3] += shift
        for _ in range(2):
            tracker.move("node", pose)
            next(tracker)
    recorded, after = rendered(tracker)
    # Both targets once: the object no longer moves, which is no quarter of a bin before a visit, 20 ms later, is.
    assert after[0] - before[0] <= 4
    pose[0, 3] += 5e-3
    tracker.move("node", pose)
    for _ in range(2):
        next(tracker)
    assert rendered(tracker)[1][0] - after[0] == 2
    tracker.light(sun=(-0.3, -0.5, -0.8), visible=0.5)
    next(tracker)
    assert rendered(tracker)[0] - kernels <= 3
    assert recorded - kernels <= 3


@pytest.mark.slow
def test_the_background_is_that_of_the_object_where_it_is() -> None:
    """Claim: an object that is told to speed up stands in the background within a quarter of a bin of where it is, and
    is not rendered anew for every visit.

    Set-up: at rest until 0.1 s, then 1.5 m/s², told before each visit; 0.3 m/s at the end. A bin is half a milliradian,
    3.5 mm there. A background that keeps an old speed is 30 mm off.
    """
    tracker, pace = Tracker(scenario(lighting=SUN, scan={"duration": 0.3})), 1.5
    farthest, used = 0.0, []
    while not tracker.finished:
        since = max(tracker.time - 0.1, 0.0)
        pose = np.eye(4)
        pose[:3, 3] = START[0] + 0.5 * pace * since**2, *START[1:]
        tracker.move("node", pose, velocity=(pace * since, 0.0, 0.0))
        record = next(tracker)
        middle = float(record.samples.time.mean())
        situation, _ = tracker._visits._situations[0].at(middle, tracker.state.used)
        (item, *_), (seen, *_) = situation.items, situation.background
        apart = item.pose_at(middle)[0, :3, 3] - seen.pose_at(middle)[0, :3, 3]
        farthest = max(farthest, float(np.linalg.norm(apart)))
        used.append(tracker.state.used)
    assert record.truth_point[0] > START[0] + 0.02 - 0.2
    assert 0.05 * 3.5e-3 < farthest < 0.25 * 3.6e-3
    assert 3 < len({id(one) for one in used}) < len(used) - 3


@pytest.mark.slow
@pytest.mark.parametrize("lighting", [SUN, LOW_ORBIT], ids=["sunlit", "orbit"])
def test_a_run_that_was_told_is_saved_and_goes_on(lighting: Any, tmp_path: Path) -> None:
    """Claim: moves and light are saved, and the rest of a run is the same bytes after a resumption."""

    def drive(tracker: Tracker, visits: int) -> list[PatternRecord]:
        found = []
        for _ in range(visits):
            pose = placed(tracker.time)
            pose[1, 3] += 3e-3 * np.sin(40.0 * tracker.time)
            tracker.move("node", pose, velocity=(SPEED, 0.1, 2.0 * SPEED))
            tracker.light(visible=max(0.0, 1.0 - 4.0 * tracker.time))
            found.append(next(tracker))
        return found

    tracker = Tracker(scenario(lighting=lighting))
    drive(tracker, 7)
    tracker.save(tmp_path / "told.state")
    again = Tracker.resume(tmp_path / "told.state")
    assert again.scenario == tracker.scenario
    assert content(drive(again, 6)) == content(drive(tracker, 6))


@pytest.mark.slow
def test_runs_side_by_side_may_have_been_told() -> None:
    """Claim: scenarios with moves go in lock-step, each with the bytes that it has alone."""
    first, _ = told(scenario(lighting=SUN, scan={"duration": 0.1}))
    both = (first.scenario, scenario(lighting=SUN, scan={"duration": 0.1}))
    for run, known in zip(track_many(both), both, strict=True):
        assert content(run) == content(track(known))


def test_an_eclipse_is_told_and_an_orbit_runs() -> None:
    """Claim: without the Sun's light there is as much background as in the dark, and a quarter of it for a quarter;
    an orbit's sky goes on by itself."""
    level = {}
    for share in (1.0, 0.25, 0.0):
        tracker = Tracker(scenario(lighting=SUN))
        tracker.light(visible=share)
        record = next(tracker)
        frozen: Any = tracker._visits._sensor._instrument
        (layers,) = frozen.windows[0]._kept.values()
        level[share] = float(layers[0].numpy().mean())
        assert record.status is not TrackStatus.OUT_OF_VIEW
    assert level[0.0] == 0.0
    assert level[0.25] == pytest.approx(0.25 * level[1.0], rel=1e-5)
    clock = SkyClock(scenario(lighting=LOW_ORBIT).lighting)
    assert clock.sky(0.1) is clock.sky(0.9)
    turned = np.arccos(clock.sky(0.5).sun_direction @ clock.sky(1.5).sun_direction)
    assert turned == pytest.approx(np.sqrt(3.986e14 / 6771.0e3**3), rel=1e-4)


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (lambda run: run.move("nodes", np.eye(4)), "there is no object 'nodes'"),
        (lambda run: run.move("wall", np.eye(4)), "'wall' is not declared to move"),
        (lambda run: run.move("hung", np.eye(4)), "Move 'node', to which it is fixed"),
        (lambda run: run.move("node", np.eye(3)), "is no pose"),
        (lambda run: run.move("node", 2.0 * np.eye(4)), "is no pose"),
        (lambda run: run.move("node", np.diag([1.0, 1.0, -1.0, 1.0])), "holds no rotation"),
        (lambda run: run.move("node", np.full((4, 4), np.nan)), "is no pose"),
        (lambda run: run.move("node", np.eye(4), velocity=(np.inf, 0, 0)), "cannot be moved so"),
        (lambda run: run.move("node", np.eye(4), velocity=(1.0, 0.0)), "cannot be moved so"),
        (lambda run: run.move("node", np.eye(4), time=run.time - 1e-3), "everything is measured"),
        (lambda run: run.move("node", np.eye(4), time=np.nan), "everything is measured"),
        (lambda run: [run.move("node", np.eye(4), time=t) for t in (5.0, 4.0)], "was moved for 5 s already"),
        (lambda run: run.light(visible=0.5), "there is no light to change"),
    ],
)
def test_what_cannot_be_told_is_refused(command: Any, message: str) -> None:
    tracker = Tracker(scenario())
    next(tracker)
    before = tracker.scenario
    with pytest.raises(InputError) as caught:
        command(tracker)
    assert message in f"{caught.value.message} {caught.value.remedy}"
    if "5 s" not in message:
        assert tracker.scenario is before


@pytest.mark.parametrize("change", [{"sun": (0, 0, 0)}, {"visible": 1.5}, {"earth": (0, 1)}, {"time": -1.0}])
def test_light_that_is_none_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        Tracker(scenario(lighting=SUN)).light(**change)


def test_a_raster_between_visits_takes_its_time_and_leaves_the_rest_alone() -> None:
    """Claim: a raster begins when the mirrors have settled, lasts a dwell a voxel, sees objects where they are then,
    and its shots meet numbers of their own; the same again gives the same bytes, and visits go on after it. The
    scenario that is kept with it, simulated, sees the objects at the same places.

    Set-up: the target moves by 0.5 m/s along z, so that 11 ms of 12 × 16 voxels are 5 mm. Tolerance: 6 σ of a mean. Of
    a target at rest two rasters see the same speckle, and noise of their own makes them differ by 0.023 of σ² (0.021 to
    0.026 of thirty pairs); with the same numbers 0.001 were left, by which the mirrors err in between.
    """

    def run() -> tuple[Tracker, Any, PatternRecord]:
        tracker = Tracker(scenario({"type": "twist", "velocity": (0.0, 0.0, 0.5)}, scan={"duration": 5.0}))
        for _ in range(6):
            next(tracker)
        tracker.wait(2.0)
        # On the plate of the second target, beside its disc.
        image = tracker.scan(12, 16, (0.0305, 0.0335), (0.0155, 0.0185))
        return tracker, image, next(tracker)

    (tracker, image, record), (_, again, after) = run(), run()
    dwell, points = tracker.scenario.scanner.dwell, tracker.scenario.following.pattern.points
    assert tracker.state.visits == 6 + -(-12 * 16 // points) + 1
    begin = 2.0 + 192 * dwell
    assert begin < record.samples.time[0, 0] < begin + 0.03
    for name, values in image.channels.items():
        np.testing.assert_array_equal(values, again.channels[name])
    assert content(record) == content(after)
    assert record.status is TrackStatus.MEASURED
    valid = image.channels["status"] == 0
    assert valid.mean() > 0.9
    depth = image.channels["P.Z"] if "P.Z" in image.channels else image.channels["Z"]
    sigma = float(np.median(image.channels["sigma_range_m"][valid]))
    middle = 2.0 + 0.5 * 192 * dwell + 2e-3
    expected = START[2] + 0.5 * middle
    assert abs(float(np.mean(depth[valid])) - expected) < 6.0 * sigma / np.sqrt(valid.sum()) + 2e-3
    again = simulate(load_scenario(yaml.safe_load(image.scenario_yaml)), device="cpu")
    np.testing.assert_allclose(again["truth.range_m"], image["truth.range_m"], atol=1e-3)
    still = Tracker(scenario())
    one, other = (still.scan(12, 16, (0.0305, 0.0335), (0.0155, 0.0185)).channels for _ in range(2))
    assert np.nanmean(((one["peak_px"] - other["peak_px"]) / one["sigma_peak_px"]) ** 2) > 0.01


def test_what_a_filter_knows_points_the_search() -> None:
    """Claim: a target that is pointed with its rates is looked for where it goes, in patterns that grow to three
    standard deviations and no further."""
    tracker = Tracker(scenario(scan={"duration": 9.0}))
    tracker.drop("node/2")
    truth = next(tracker).truth
    sure, rates = np.diag([1e-4, 1e-4, 1e-2, 1e-6, 1e-6, 1e-3]) ** 2, (0.5, 0.0, 0.0)
    tracker.point("node/1", truth[0] + 0.2, truth[1], truth[2], rates=rates, covariance=sure)
    found = [next(tracker) for _ in range(4)]
    for before, record in pairwise(found):
        assert record.mode.value == "lost"
        # The first of them began late, for the mirrors had to jump; others by a tenth of a millisecond at most.
        if before is not found[0]:
            step = float(record.samples.time.mean() - before.samples.time.mean())
            assert record.centre[0] - before.centre[0] == pytest.approx(0.5 * step, abs=0.5e-4)
        assert record.amplitude == pytest.approx(1.6 * 0.05 / 7.0, rel=1e-3)
    assert found[0].centre[0] == pytest.approx(truth[0] + 0.2, abs=0.5 * 0.01)
    tracker.point("node/1", truth[0] + 0.2, truth[1], truth[2], covariance=np.diag([2e-3, 2e-3, 0.1]) ** 2)
    wide = [next(tracker).amplitude for _ in range(3)]
    assert max(wide) == pytest.approx(0.05 / 7.0 + 3.0 * 2e-3, rel=0.05)
    tracker.point("node/1", *truth, covariance=sure)
    assert next(tracker).status is TrackStatus.MEASURED


def test_a_target_that_moves_as_told_is_expected_where_it_goes() -> None:
    """Claim: the pattern after the first sighting of a target that was told with its rates lies on it.

    Set-up: a target that moves by 0.3 m/s across and comes nearer by 0.6 m/s, told with its true rates. Expected: the
    second pattern's middle is off by what the first measurement errs by and by what σ of the rates makes of the time
    between them. Tolerance: six of these; with rates of zero it would be off by some twenty σ.
    """
    motion = {"type": "twist", "velocity": (0.3, 0.0, -0.6)}
    known = scenario(motion=motion, scan={"targets": ["node/1"]})
    separation, velocity = known.scanner.mirrors.axis_separation, np.array([0.3, 0.0, -0.6])
    point = np.array(START) + np.array([-0.2, 0.0, 0.0])
    ends = [judge.shot_from_point(point + step * velocity, separation) for step in (0.0, 1e-4)]
    truth, later = (np.array([theta, phi, reach]) for reach, theta, phi in ends)
    rates = (later - truth) / 1e-4
    sure = np.diag([1e-3, 1e-3, 1e-2, 1e-4, 1e-4, 1e-3]) ** 2
    tracker = Tracker(known)
    tracker.point("node/1", *truth, rates=rates, covariance=sure)
    first, second = next(tracker), next(tracker)
    assert first.status is second.status is TrackStatus.MEASURED
    samples = second.samples.time[0]
    middle = 0.5 * float(samples[0] + samples[-1])
    there = second.truth[:2] + (middle - second.time) * rates[:2]
    step = middle - first.time
    allowed = 6.0 * np.sqrt(np.diag(first.covariance)[:2] + (step * 1e-4) ** 2)
    assert (np.abs(second.centre - there) < allowed).all()
    assert step * rates[0] > 15.0 * np.sqrt(first.covariance[0, 0])


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (lambda run: run.point("node/1", 0.0, 0.0, 7.0, rates=(1.0, 2.0)), "no rates"),
        (lambda run: run.point("node/1", 0.0, 0.0, 7.0, covariance=np.eye(2)), "no covariance"),
        (lambda run: run.point("node/1", 0.0, 0.0, 7.0, covariance=-np.eye(3)), "no covariance"),
        (lambda run: run.wait(-1.0), "is before"),
        (lambda run: run.wait(np.nan), "is before"),
        (lambda run: run.scan(0, 4, (0.0, 0.1), (0.0, 0.1)), "no such raster"),
        (lambda run: run.scan(4, 4, (0.0, 9.0), (0.0, 0.1)), "no such raster"),
        (lambda run: run.scan(512, 512, (0.0, 0.1), (0.0, 0.1)), "are more than"),
    ],
)
def test_other_impossible_commands_are_refused(command: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        command(Tracker(scenario()))


def test_a_measurement_is_there_after_its_pattern_and_the_latency() -> None:
    """Claim: it is valid at the time of its light and available at the end of the pattern's last dwell, later by the
    instrument's latency; nothing else changes with that."""
    late = {"scanner": {"latency": {"processing": 2e-3, "transfer": 0.5e-3}}}
    now, later = (next(Tracker(scenario(**more))) for more in ({}, late))
    dwell = scenario().scanner.dwell
    assert now.available == pytest.approx(float(now.samples.time[0, -1]) + 0.5 * dwell, abs=1e-12)
    assert later.available - now.available == pytest.approx(2.5e-3, abs=1e-12)
    assert content(now.samples) == content(later.samples)
    assert now.time == later.time < now.available
    np.testing.assert_allclose(now.errors.white + now.errors.lasting, now.covariance, rtol=1e-12)
