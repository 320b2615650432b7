"""Approaches: their epochs, what each run has of them, what is wrong with a file, and tables of known tries."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.stats import binomtest, chi2

from scanner_sim.campaign.approach.methods import METHODS
from scanner_sim.campaign.approach.reading import PlannedApproach, read_approach
from scanner_sim.campaign.approach.results import (
    NO_RESULT,
    _by_condition,
    _by_epoch,
    rms_interval,
    share_interval,
    study_of,
    unit_of,
)
from scanner_sim.foundation.errors import ScenarioError
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.approach import ApproachStudy, EpochRow, approach_json
from scanner_sim.products.files.tables import texts
from scanner_sim.products.pictures.approach import _component, draw_conditions
from scanner_sim.products.pose_study import COMPONENTS
from scanner_sim.validation.studies.conditions import Condition

BASE = """\
schema: 1
scene:
  objects:
    - {name: vehicle, shape: box, size: [2 m, 2 m, 1 m], material: z93_white, position: [0 m, 0 m, 9 m]}
    - name: far
      array: {diameter: 100 mm, plate: 300 mm, rows: 2, columns: 2, spacing: [1 m, 1 m]}
      parent: vehicle
      position: [0 m, 0 m, -0.6 m]
    - name: near
      array: {diameter: 25 mm, plate: 80 mm, rows: 2, columns: 2, spacing: [0.2 m, 0.2 m]}
      parent: vehicle
      position: [0 m, 0 m, -0.6 m]
    - {name: loose, array: {diameter: 50 mm, plate: 100 mm, rows: 2, columns: 2, spacing: [0.2 m, 0.2 m]},
       position: [3 m, 0 m, 9 m]}
    - {name: single, array: {diameter: 50 mm, plate: 100 mm}, parent: vehicle, position: [0 m, 0.9 m, -0.6 m]}
lighting:
  orbit: {altitude: 400 km, beta: 15 deg, anomaly: 60 deg, attitude: {forward: ram, down: nadir}}
scan: {type: track, targets: [far]}
"""
HEAD = "schema: 1\nbase: base.yaml\nobject: vehicle\n"
POINTS = (
    "[{time: 0 s, position: [0 m, 0 m, 15 m]}, "
    "{time: 300 s, position: [0.2 m, 0 m, 5 m], rotation: {axis: z, angle: 8 deg}}]"
)
PATH = f"trajectory: {{type: waypoints, interpolation: linear, points: {POINTS}}}\n"
REST = "epochs: {count: 3}\narrays: [{array: near, below: 8 m}, {array: far}]\n"


@pytest.fixture
def write(tmp_path: Path):
    (tmp_path / "base.yaml").write_text(BASE, encoding="utf-8")

    def written(text: str) -> Path:
        (tmp_path / "approach.yaml").write_text(text, encoding="utf-8")
        return tmp_path / "approach.yaml"

    return written


def test_epochs_are_even_in_time_and_take_the_array_of_their_range(write) -> None:
    planned = read_approach(write(HEAD + PATH + REST))
    assert [point.epoch.time for point in planned.points] == [0.0, 150.0, 300.0]
    assert [point.array for point in planned.points] == ["far", "far", "near"]
    assert planned.campaign.plan.shape == (3, 2, 8)


def test_the_camera_takes_one_frame_beside_the_tracks_of_the_first_ranging(write) -> None:
    """Claim: runs by triangulation have the camera's pose, those by time of flight do not, and none has two frames."""
    planned = read_approach(write(HEAD + PATH + REST))
    asked = [planned.campaign.scenario(planned.run(0, ranging)) for ranging in ("triangulation", "tof")]
    assert [one.pose.methods for one in asked] == [("camera", "uv", "xyz", "joint"), ("xyz", "joint")]
    assert all(len(one.camera.frame_times(one.following.duration)) == 1 for one in asked)
    without = read_approach(write(HEAD + PATH + REST + "methods: [joint]\n"))
    assert without.campaign.base.pose.methods == ("joint",)
    assert not any(name.startswith("camera") for name in without.measures)


def test_a_spacing_is_of_the_range_there_and_back(write) -> None:
    """Claim: epochs lie where the range has changed by another step, also where the path turns round."""
    there = "[{time: 0 s, position: [0 m, 0 m, 9 m]}, {time: 100 s, position: [0 m, 0 m, 6 m]},"
    back = " {time: 140 s, position: [0 m, 0 m, 8 m]}]"
    path = f"trajectory: {{type: waypoints, interpolation: linear, points: {there}{back}}}\n"
    text = HEAD + path + "epochs: {spacing: 0.8 m}\narrays: [{array: far}]\n"
    found = read_approach(write(text)).points
    assert [one.epoch.distance for one in found] == pytest.approx(
        [9.0, 8.2, 7.4, 6.6, 6.2, 7.0, 7.8], abs=2e-3
    )


def test_a_run_moves_as_the_path_does_about_its_epoch(write) -> None:
    """Claim: half a second later the object of a run is where the path has it, and half a second before the path's end
    it was there; the first run is the base's.

    Set-up: a smooth path through three waypoints. Tolerance: half its largest acceleration, below 1 mm/s², times the
    square of the time, and as much for turns.
    """
    points = POINTS.replace("5 m]", "5 m]").replace("}]", "}, {time: 400 s, position: [0 m, 0 m, 4 m]}]")
    text = HEAD + f"trajectory: {{type: waypoints, points: {points}}}\n" + REST
    planned = read_approach(write(text))
    # What stands for all runs is the first epoch, by the first way of ranging.
    base, first = planned.campaign.base, planned.campaign.scenario(planned.run(0))
    assert base.replace({"seed": first.seed}) == first
    motion = planned.approach.trajectory
    for number, point in enumerate(planned.points):
        scenario = planned.campaign.scenario(planned.run(number))
        vehicle = scenario.scene.objects[0]
        for after in (0.0, -0.5 if point is planned.points[-1] else 0.5):
            truth = motion.scanner_from_object([point.epoch.time + after], np.eye(4))[0]
            assert vehicle.pose_at(after)[0] == pytest.approx(truth, abs=0.5e-3 * after**2 + 1e-9)


OTHERS = """\
    - {name: drone, shape: sphere, diameter: 0.2 m, material: z93_white, position: [3 m, 0 m, 20 m],
       motion: {type: twist, velocity: [0 m/s, 4 mm/s, 10 mm/s], turn_rate: [0 deg/s, 0.3 deg/s, 0 deg/s]}}
    - name: antenna
      shape: box
      size: [0.1 m, 0.1 m, 0.1 m]
      material: z93_white
      parent: vehicle
      motion: {type: waypoints, interpolation: linear, points: [
        {time: 0 s, position: [0 m, 0 m, 1 m]},
        {time: 200 s, position: [0 m, 2 m, 1 m], rotation: {axis: x, angle: 20 deg}}]}
lighting:
  changes: [{time: 100 s, visible: 50 %}, {time: 200 s, visible: 25 %}]
"""


def test_each_epoch_has_the_world_of_its_time(write, tmp_path: Path) -> None:
    """Claim: what moves by itself, freely or on the vehicle, and what is told of the light go on from epoch to epoch,
    half a second into a try as at its begin.

    Set-up: epochs at 0, 150 and 300 s; a drone at even rates, and an antenna that is out after 200 s.
    """
    path = write(HEAD + PATH + REST)
    (tmp_path / "base.yaml").write_text(BASE.replace("lighting:\n", OTHERS), encoding="utf-8")
    planned = read_approach(path)
    for number, told in enumerate(((), (0.5,), (0.25,))):
        scenario = planned.campaign.scenario(planned.run(number))
        drone, antenna = scenario.scene.objects[-2:]
        vehicle = next(one for one in scenario.scene.objects if one.name == "vehicle")
        for after in (0.0, 0.5):
            time = 150.0 * number + after
            turned = math.radians(0.3) * time
            (pose,) = drone.pose_at(after)
            assert pose[:3, 3] == pytest.approx([3.0, 4e-3 * time, 20.0 + 1e-2 * time], abs=1e-9)
            across = [math.cos(turned), 0.0, -math.sin(turned)]
            assert pose[:3, 0] == pytest.approx(across, abs=1e-9)
            out = min(time / 200.0, 1.0)
            own = np.linalg.inv(vehicle.pose_at(after)[0]) @ antenna.pose_at(after)[0]
            assert own[:3, 3] == pytest.approx([0.0, 2.0 * out, 1.0], abs=1e-9)
            lean = math.radians(20.0) * out
            assert own[:3, 1] == pytest.approx([0.0, math.cos(lean), math.sin(lean)], abs=1e-9)
        assert tuple(one.visible for one in scenario.lighting.changes) == told
        assert scenario.lighting.sky().sun_dimming == pytest.approx(told[0] if told else 1.0)


def test_other_objects_arrive_as_the_followed_one_does(write, tmp_path: Path) -> None:
    """Claim: at the end of its path an object that is not followed has the rates of just before, by way over time;
    after that it stands still.
    """
    path = write(HEAD + PATH + REST)
    for seconds, velocity in ((300.0, 1.0 / 300.0), (150.0, 0.0)):
        points = (
            f"[{{time: 0 s, position: [3 m, 0 m, 10 m]}}, {{time: {seconds} s, position: [3 m, 0 m, 9 m]}}]"
        )
        motion = f"motion: {{type: waypoints, interpolation: linear, points: {points}}}"
        base = BASE.replace("position: [3 m, 0 m, 9 m]}", "position: [3 m, 0 m, 9 m], " + motion + "}")
        (tmp_path / "base.yaml").write_text(base, encoding="utf-8")
        planned = read_approach(path)
        scenario = planned.campaign.scenario(planned.run(len(planned.points) - 1))
        (loose,) = (one for one in scenario.scene.objects if one.name == "loose")
        assert loose.position == pytest.approx((3.0, 0.0, 9.0), abs=1e-9)
        assert loose.motion.velocity == pytest.approx((0.0, 0.0, -velocity), abs=1e-9)


def test_each_epoch_has_the_light_of_its_time(write) -> None:
    """Claim: the place on the orbit goes on by 2π t/T; other lights start elsewhere."""
    text = HEAD + PATH + REST + "orbits: [{beta: -5 deg, anomaly: 179 deg}, {beta: 0 deg, anomaly: 0 deg}]\n"
    planned = read_approach(write(text))
    period = planned.campaign.base.lighting.period
    assert period is not None
    for number, point in enumerate(planned.points):
        light = planned.campaign.scenario(planned.run(number)).lighting.orbit
        assert light is not None
        start, beta = ((math.radians(179.0), math.radians(-5.0)), (0.0, 0.0))[point.orbit]
        assert light.beta == pytest.approx(beta)
        apart = light.anomaly - start - 2.0 * math.pi * point.epoch.time / period
        assert math.remainder(apart, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-12)
        assert abs(light.anomaly) <= math.pi


def test_elements_go_on_in_time(write, tmp_path: Path) -> None:
    lines = (
        "    line1: 1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\n"
        "    line2: 2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\n"
    )
    path = write(HEAD + PATH + REST)
    start = BASE.index("  orbit:")
    end = BASE.index("scan:")
    light = f"  tle:\n{lines}    time: 2008-09-20T12:25:40Z\n"
    (tmp_path / "base.yaml").write_text(BASE[:start] + light + BASE[end:], encoding="utf-8")
    planned = read_approach(path)
    times = [planned.campaign.scenario(planned.run(number)).lighting.tle.time for number in range(3)]
    assert [(time - times[0]).total_seconds() for time in times] == [0.0, 150.0, 300.0]


SLOPE = "{to: [-3 m, 0 m, 0 m], start_speed: 20 mm/s, end_speed: 5 mm/s}"
WILTSHIRE = "trajectory: {{type: clohessy_wiltshire, position: [-15 m, 0 m, 0 m], glideslope: {}{}}}\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PATH + REST.replace("far}", "fra}"), ("line 6, arrays[1].array", "no target array 'fra'", "far")),
        (PATH + REST.replace("array: far", "array: loose"), ("'loose' is not fixed to 'vehicle'", "parent: vehicle")),
        (PATH + REST.replace("array: far", "array: single"), ("'single' have no pose", "two rows")),
        (PATH + REST.replace("below: 8 m", "below: 8"), ("arrays[0].below", "unit")),
        (PATH + "epochs: {count: 3}\narrays: [{array: far}, {array: near}]\n", ("no range is left",)),
        (PATH + "epochs: {count: 3}\narrays: []\n", ("line 6, arrays",)),
        (PATH + "epochs: {count: 3, end: 301 s}\narrays: [{array: far}]\n", ("301 s is not on the path", "300 s")),
        (PATH + "epochs: {count: 3, start: 20 s, end: 10 s}\narrays: [{array: far}]\n", ("Times run forwards",)),
        (PATH + "epochs: {}\narrays: [{array: far}]\n", ("neither count nor spacing",)),
        (PATH + "epochs: {spacing: 40 m}\narrays: [{array: far}]\n",
         ("range changes by 9.996 m in all", "Write a smaller one, or count: 8.")),
        (PATH + "epochs: {spacing: 1 um}\narrays: [{array: far}]\n", ("steps of 1e-06 m", "Write a larger one: ")),
        ("trajectory: {type: waypoints, points: [{time: 0 s, position: [0 m, 0 m, 15 m]}]}\n" + REST,
         ("trajectory.points: this list has 1 entry. It takes 2 or more.",)),
        (PATH.replace("[0.2 m, 0 m, 5 m]", "[.nan, 0 m, 5 m]") + REST, ("1 fault", ".nan is not a finite number")),
        (PATH + "epochs: {count: 3}\narrays: [{array: near, below: 8 m}]\n", ("at 0 s the range is 15 m", "no array")),
        (PATH + REST + "methods: [uv, uv]\n", ("uv is named twice",)),
        (PATH + REST + "methods: [camera_of_mine]\n", ("methods[0]", "Possible")),
        (PATH.replace("time: 300 s", "time: -3 s") + REST, ("trajectory",)),
        (PATH.replace("position: [0.2 m, 0 m, 5 m]", "position: [9 m, 0 m, 5 m]") + REST,
         ("at 300 s 'far/1' leaves the field of view", "deg are possible")),
        (PATH.replace("[0.2 m, 0 m, 5 m]", "[0 m, 0 m, 0.7 m]") + REST, ("at 300 s", "range of", "m to")),
        (PATH.replace("[0 m, 0 m, 15 m]", "[0 m, 0 m, 60 m]") + REST, ("at 0 s 'far/1' is at a range of 59",)),
        (PATH.replace("[0.2 m, 0 m, 5 m]", "[0 m, 0 m, -5 m]") + REST, ("at 300 s the object is behind the scanner",)),
        ("trajectory: {type: twist, velocity: [0 m/s, 0 m/s, -10 mm/s]}\n" + REST, ("nothing says where its last",)),
        (WILTSHIRE.format(SLOPE, ", altitude: 500 km") + REST, ("500 km here, and 400 km",)),
        (WILTSHIRE.format(SLOPE, ", attitude: {forward: wake}") + REST, ("looks elsewhere",)),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_place_or_time(write, text: str, words: tuple[str, ...]) -> None:
    with pytest.raises(ScenarioError) as raised:
        read_approach(write(HEAD + text))
    said = " ".join(str(raised.value).split())
    assert all(word in said for word in words), said


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("  orbit: {altitude: 400 km, beta: 15 deg, anomaly: 60 deg, attitude: {forward: ram, down: nadir}}",
         "  sun: {direction: [0, -1, 0]}", ("base", "has no orbit", "tle")),
        ("scan: {type: track, targets: [far]}",
         "scan: {type: raster, rows: 2, columns: 2, horizontal: [-1 deg, 1 deg], vertical: [-1 deg, 1 deg]}",
         ("does not follow targets",)),
        ("name: vehicle", "name: module", ("parent",)),
    ],
)  # fmt: skip
def test_what_the_scenario_lacks_is_said(
    write, tmp_path: Path, old: str, new: str, words: tuple[str, ...]
) -> None:
    path = write(HEAD + PATH + REST)
    (tmp_path / "base.yaml").write_text(BASE.replace(old, new), encoding="utf-8")
    with pytest.raises(ScenarioError) as raised:
        read_approach(path)
    assert all(word in str(raised.value) for word in words), str(raised.value)


def known_table(planned: PlannedApproach, error: float, sigma: float) -> dict[str, np.ndarray]:
    """Return rows whose errors are ±error, and whose first try of each epoch by time of flight failed."""
    runs = np.arange(len(planned.campaign))
    points, rangings, tries = np.unravel_index(runs, planned.campaign.plan.shape)
    table = {"run": runs, "axis_0": points, "axis_1": rangings, "repeat": tries, "seed": 7 * runs}
    failed = (rangings == 1) & (tries == 0)
    table["fault"] = texts(["a disk was full." if one else "" for one in failed])
    for method in ("camera", "uv", "xyz", "joint"):
        table[f"{method}_status"] = np.where(failed, np.nan, float(PoseStatus.VALID))
        for number, component in enumerate(COMPONENTS, start=1):
            signed = number * error * np.where(tries % 2, 1.0, -1.0)
            table[f"{method}_{component}"] = np.where(failed, np.nan, signed)
            table[f"{method}_{component}_sigma"] = np.where(failed, np.nan, number * sigma)
    # A pose that is doubted counts as none.
    table["uv_status"] = np.where(points == 1, float(PoseStatus.AMBIGUOUS), table["uv_status"])
    return table


def known_study(write, error: float = 2e-3) -> ApproachStudy:
    """Return what the known tries tell; by angles alone the second of three epochs has no pose."""
    planned = read_approach(write(HEAD + PATH + REST + "tries: 4\n"))
    light = [EpochRow(0, k, 150.0 * k, 15.0 - 5 * k, "far", code, Condition(code).words, 1.0, 1.0, 0.0)
             for k, code in enumerate((0, 0, 4))]  # fmt: skip
    return study_of("known", planned, known_table(planned, error, 1e-3), light)


def test_a_stated_sigma_is_drawn_where_its_neighbours_have_no_pose(write) -> None:
    """Claim: each epoch with a pose has a bar at its σ [mm], and a method with lone poses has no more of them."""
    study = known_study(write)
    axes = Figure().subplots()
    _component(axes, study, [row for row in study.rows if row.component == "t_y"], "t_y")
    bars = [found for found in axes.collections if found.get_linewidth()[0] == pytest.approx(1.4)]
    ends = [np.array([one for one in found.get_segments() if len(one) == 2]) for found in bars]
    by_method = dict(zip(study.methods, ends, strict=True))
    assert {name: len(found) for name, found in by_method.items()} == {
        "camera": 3, "uv": 2, "xyz": 3, "joint": 3, "xyz_tof": 3, "joint_tof": 3,
    }  # fmt: skip
    for found in ends:
        np.testing.assert_allclose(found[..., 1], 2.0)
    np.testing.assert_allclose(np.sort(by_method["uv"][..., 0].prod(axis=1)), [25.0, 225.0], rtol=0.01)


def test_errors_by_condition_have_ticks_that_can_be_read(write) -> None:
    """Claim: errors are marked at 1, 2, 5, 10 …, in plain numbers, in mm and in thousandths of a degree."""
    drawn: list[Figure] = []
    with mock.patch("scanner_sim.products.pictures.style.save", lambda figure, _: drawn.append(figure)):
        draw_conditions(known_study(write), BytesIO())
    _, place, attitude = drawn[0].axes
    for axes, unit in ((place, "mm"), (attitude, "m°")):
        assert axes.get_ylabel().endswith(f"[{unit}]")
        axes.set_ylim(0.9, 110.0)
        marks = [text.get_text() for text in axes.get_yticklabels()]
        assert [mark for mark in marks if 0.9 <= float(mark) <= 110.0] == [
            "1",
            "2",
            "5",
            "10",
            "20",
            "50",
            "100",
        ]


def test_tables_of_known_tries(write) -> None:
    """Claim: what stands in the rows of a campaign comes out as shares, errors, σ and coverage of each method."""
    study = known_study(write)
    rows = {(row.method, row.epoch, row.component): row for row in study.rows}
    assert rows["joint", 0, "t_y"].error == pytest.approx(4e-3)
    assert rows["joint", 0, "t_y"].sigma == pytest.approx(2e-3)
    assert rows["joint", 0, "t_y"].bias == pytest.approx(0.0, abs=1e-12)
    assert (rows["joint", 0, "t_y"].z, rows["joint", 0, "t_y"].covered) == (pytest.approx(2.0), 0.0)
    assert (rows["xyz", 0, "omega_z"].tries, rows["xyz", 0, "omega_z"].unit) == (4, "rad")
    assert (rows["joint_tof", 2, "t_x"].valid, rows["joint_tof", 2, "t_x"].availability) == (3, 0.75)
    assert (rows["uv", 1, "t_x"].valid, rows["uv", 0, "t_x"].valid) == (0, 4)
    assert math.isnan(rows["uv", 1, "t_x"].error)
    cells = {(row.method, row.condition): row for row in study.conditions}
    assert (cells["uv", 0].epochs, cells["uv", 0].tries, cells["uv", 0].valid) == (2, 8, 4)
    assert cells["joint", 4].position_m == pytest.approx(2e-3 * math.sqrt(14.0))
    assert cells["joint", 4].attitude_sigma_rad == pytest.approx(1e-3 * math.sqrt(77.0))
    # Errors of 2 σ are beyond the 1.96 that hold 95 %, those of 1.9 σ within.
    nearer = known_study(write, 1.9e-3)
    assert cells["joint", 4].covered == cells["xyz_tof", 0].covered == 0.0
    assert {row.covered for row in nearer.conditions if row.valid} == {1.0}
    assert {row.covered for row in nearer.rows if row.valid} == {1.0}
    assert cells["joint", 2].tries == 0
    assert math.isnan(cells["joint", 2].availability)
    assert study.faults == ("a disk was full.",)
    assert [(one.name, one.meaning) for one in study.labels] == [
        (one.words, one.meaning) for one in Condition
    ]
    lost = study.tries["status"] == NO_RESULT
    assert set(study.tries["method"][lost]) == {"xyz_tof", "joint_tof"}
    assert '"tries"' in approach_json(replace(study, warnings=()))


def test_epochs_of_several_orbits_have_their_own_tries() -> None:
    """Claim: two orbits, two epochs, two methods, two tries: each row tells the size of its own errors and σ."""
    places = list(itertools.product((0, 1), (0, 1), ("camera", "uv"), (-1.0, 1.0)))
    size = np.array([1e-3 * (1 + orbit + 2 * epoch + 4 * (name == "uv")) for orbit, epoch, name, _ in places])
    tries = {
        "orbit": np.array([orbit for orbit, *_ in places]),
        "epoch": np.array([epoch for _, epoch, *_ in places]),
        "method": np.array([name for *_, name, _ in places]),
        "status": np.full(len(places), PoseStatus.VALID),
    }
    for axis, component in enumerate(COMPONENTS):
        tries[f"{component}_error_{unit_of(component)}"] = (axis + 1) * size * [sign for *_, sign in places]
        tries[f"{component}_sigma_{unit_of(component)}"] = 0.5 * (axis + 1) * size
    epochs = [
        EpochRow(o, k, 50.0 * k, 9.0 + o, "far", 0, "lit", 1.0, 1.0, 0.0) for o in (0, 1) for k in (0, 1)
    ]
    for number, method in enumerate(METHODS[one] for one in ("camera", "uv")):
        rows = list(_by_epoch(method, tries, epochs))
        assert len(rows) == 4 * len(COMPONENTS)
        for row in rows:
            own = 1e-3 * (1 + row.orbit + 2 * row.epoch + 4 * number) * (1 + COMPONENTS.index(row.component))
            assert (row.tries, row.valid, row.range_m) == (2, 2, 9.0 + row.orbit)
            assert (row.error, row.sigma, row.z) == pytest.approx((own, 0.5 * own, 2.0))


def test_a_condition_covers_as_many_components_as_lie_within() -> None:
    """Claim: of two tries with one and with three of six components beyond 1.96 σ, two thirds are covered."""
    off = {"t_x": (3.0, 3.0), "omega_x": (0.5, 3.0), "omega_z": (0.5, 3.0)}
    tries = {
        "method": np.array(["uv", "uv", "uv"]),
        "condition": np.array([0, 0, 4]),
        "status": np.full(3, PoseStatus.VALID),
    }
    for component in COMPONENTS:
        tries[f"{component}_error_{unit_of(component)}"] = 1e-3 * np.array(
            [*off.get(component, (1.0, 1.0)), 9.0]
        )
        tries[f"{component}_sigma_{unit_of(component)}"] = np.full(3, 1e-3)
    found = _by_condition(METHODS["uv"], Condition.NORMAL, tries, [])
    assert (found.tries, found.valid) == (2, 2)
    assert found.covered == pytest.approx(1.0 - 4.0 / 12.0)


@pytest.mark.parametrize(("count", "total"), [(0, 6), (3, 6), (6, 6), (1, 50)])
def test_intervals_of_shares_are_the_exact_ones(count: int, total: int) -> None:
    exact = binomtest(count, total).proportion_ci(0.95, "exact")
    assert share_interval(count, total) == pytest.approx((count / total, exact.low, exact.high))


def test_intervals_of_errors_hold_as_often_as_they_say() -> None:
    """Claim: an rms of n normal errors has σ in its interval in 95 % of cases: its ends are quantiles of χ²."""
    size, low, high = rms_interval(np.array([1.0, -1.0, 1.0, -1.0]))
    assert size == 1.0
    assert chi2.cdf(4.0 / np.array([low, high]) ** 2, 4) == pytest.approx([0.975, 0.025])
    assert all(math.isnan(value) for value in rms_interval(np.zeros(0)))
    assert math.isnan(share_interval(0, 0)[0])
