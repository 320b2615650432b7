"""What studies of targets count: which measurements are taken, what of their errors is common, where targets stand."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from scanner_sim import load_scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.target_layouts import circle, line_and_one, pyramid, square
from scanner_sim.pose.transforms import rotation_from_vector
from scanner_sim.products.pose_study import COMPONENTS
from scanner_sim.render.device import Device
from scanner_sim.tracking.state import TrackerSettings
from scanner_sim.validation.studies import pose_study, target_errors, target_grid
from scanner_sim.validation.studies.pose_study import StudyPlan, plan_study, target_rows
from scanner_sim.validation.studies.target_errors import TargetErrors, _MeasuredPatterns, _taken, _voxel_sigma
from scanner_sim.validation.studies.target_grid import (
    StudyTarget,
    grid_motions,
    nearest_distance,
    spread_distances,
)

Array = NDArray[np.float64]

ALONE = {"lidar": "none"}
"""An instrument that triangulates alone."""
SCAN = {"type": "raster", "rows": 2, "columns": 2, "horizontal": [-0.1, 0.1], "vertical": [-0.1, 0.1]}


def scenario(**parts: Any) -> Any:
    return load_scenario({"schema": 1, "scan": SCAN, **parts})


def pool(distance: float = 7.0) -> TargetErrors:
    """Two positions of three observations; of the second one has no range by time of flight."""
    error = np.zeros((2, 3, 4))
    error[0, :, 0], error[1, :, 0] = [1.0, 2.0, 3.0], [-2.0, -2.0, -5.0]
    error[:, :, 1] = 7.0
    error[0, :, 3], error[1, :, 3] = [2.0, 4.0, np.nan], [np.nan, np.nan, 6.0]
    sigma = np.broadcast_to([1.0, 2.0, 3.0, 4.0], error.shape).copy()
    sigma[np.isnan(error)] = np.nan
    sigma[0, 0, 0] = 5.0
    return TargetErrors(distance, ("triangulation", "tof"), error, sigma, np.array([0.1, 0.2, 0.3, 0.4]))


def test_errors_of_a_pool_are_root_mean_squares_of_what_was_found() -> None:
    """Claim: by hand: of Θ the squares 1, 4, 9, 4, 4, 25; its means 2 and −3 are common to a position; of time of
    flight 3 of 6 are found, with squares 4, 16, 36 and means 3 and 6."""
    found = pool()
    np.testing.assert_allclose(found.scatter, np.sqrt([47.0 / 6.0, 49.0, 0.0, 56.0 / 3.0]))
    np.testing.assert_allclose(found.common, np.sqrt([(4.0 + 9.0) / 2.0, 49.0, 0.0, (9.0 + 36.0) / 2.0]))
    np.testing.assert_allclose(found.stated, np.sqrt([(25.0 + 5.0) / 6.0, 4.0, 9.0, 16.0]))
    np.testing.assert_allclose(found.found, [1.0, 1.0, 1.0, 0.5])
    error, sigma = found.of("tof")
    np.testing.assert_array_equal(error, found.error[..., [0, 1, 3]])
    np.testing.assert_array_equal(sigma, found.sigma[..., [0, 1, 3]])
    np.testing.assert_array_equal(found.of("triangulation")[0], found.error[..., :3])


def test_a_table_of_targets_has_a_row_for_each_quantity() -> None:
    rows = target_rows([pool(), pool(9.0)])
    assert [(row.range_m, row.quantity, row.unit) for row in rows] == [
        (distance, name, unit)
        for distance in (7.0, 9.0)
        for name, unit in (("theta", "rad"), ("phi", "rad"), ("range_triangulation", "m"), ("range_tof", "m"))
    ]
    alone = TargetErrors(7.0, ("triangulation",), pool().error[..., :3], pool().sigma[..., :3], np.ones(3))
    assert [row.quantity for row in target_rows([alone])] == ["theta", "phi", "range_triangulation"]
    last = rows[3]
    assert (last.voxel, last.found, last.stated, last.observations) == (0.4, 0.5, 4.0, 6)
    assert last.scatter == pytest.approx(math.sqrt(56.0 / 3.0))
    assert last.common == pytest.approx(math.sqrt(22.5))


@pytest.mark.parametrize(
    ("changes", "taken"),
    [
        ({}, True),
        ({"found": False}, False),
        # The disc's radius is seen at 0.05/5 rad; 20 % of it and 3 σ of 0.1 mrad are 2.3 mrad.
        ({"radius": 12.29e-3}, True),
        ({"radius": 12.31e-3}, False),
        ({"radius": 7.71e-3}, True),
        ({"radius": 7.69e-3}, False),
        # However large σ is: by no more than half.
        ({"radius": 14.9e-3, "sigma_radius": 9e-3}, True),
        ({"radius": 15.1e-3, "sigma_radius": 9e-3}, False),
        # Both angles' σ together within half a radius, 5 mrad: 3 and 4 are 5.
        ({"sigma": (2.99e-3, 3.99e-3)}, True),
        ({"sigma": (3.01e-3, 4.01e-3)}, False),
        ({"misfit": 2.99}, True),
        ({"misfit": 3.01}, False),
        ({"radius": np.nan}, False),
    ],
)
def test_what_a_tracker_would_take(changes: dict[str, Any], taken: bool) -> None:
    """Claim: firm fits of a disc of about the right size that fit, by the limits of the tracker; 100 mm at 5 m."""
    given = {
        "found": True,
        "radius": 1e-2,
        "sigma_radius": 1e-4,
        "sigma": (1e-4, 1e-4),
        "misfit": 1.0,
    } | changes
    covariance = np.diag([*np.square(given.pop("sigma")), 9.0])
    seen: Any = SimpleNamespace(
        position=np.array([[0.1, 0.2, 5.0]]),
        covariance=covariance[None],
        **{name: np.array([value]) for name, value in given.items()},
    )
    target: Any = SimpleNamespace(diameter=0.1, tracker=SimpleNamespace(size_tolerance=0.2, misfit=3.0))
    assert _taken(seen, target).tolist() == [taken]


def test_voxels_state_medians_of_what_is_known() -> None:
    known = scenario()
    reading = float(known.scanner.mirrors.reading_sigma(np.zeros(1), np.zeros(1))[0])
    layers: Any = {"sigma_range_m": [1.0, np.nan, 3.0, 9.0], "tof.sigma_range_m": [np.nan, np.inf, 5.0, 4.0]}
    np.testing.assert_allclose(_voxel_sigma(known, layers), [reading, reading, 3.0, 4.5])
    layers = {"sigma_range_m": [np.nan], "tof.sigma_range_m": [2.0]}
    np.testing.assert_allclose(_voxel_sigma(known, layers), [reading, reading, np.nan, 2.0])
    layers = {"sigma_range_m": [3.0]}
    np.testing.assert_allclose(_voxel_sigma(scenario(scanner=ALONE), layers), [reading, reading, 3.0])


def test_patterns_that_were_measured_are_looked_up_by_their_shots() -> None:
    found = _MeasuredPatterns({"a": np.arange(5.0)}).measure(
        SimpleNamespace(shot=np.array([3, 1])),  # type: ignore[arg-type]
        np.zeros(2, dtype=np.int64),
    )
    assert found["a"].tolist() == [3.0, 1.0]


def test_errors_are_measured_less_true_at_each_position(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: angles and their σ are the line's, ranges of either way each its own; each distance about the middle one
    has a seed of its own, and each centre as many patterns after one another as are asked for."""
    centres = np.array([[0.1, 0.2, 7.0], [-0.1, 0.3, 8.0]])
    asked: list[tuple[float, int]] = []

    def grid(known: Any, target: Any, where: float, seed: int, device: Any) -> Any:
        # The instrument is the scenario's own, whatever the seed.
        assert known.scanner.as_built.seed == known.seed
        asked.append((where, seed))
        return SimpleNamespace(scenario=known, measure=lambda aim: {"at": aim}), centres

    def seen(known: Any, layers: Any, motions: Any, truth: Array, target: Any, ranging: str) -> Any:
        assert truth.tolist() == np.repeat(centres, 3, axis=0).tolist()
        step = {"triangulation": [1e-3, 2e-3, 3e-3], "tof": [9.0, 9.0, 4e-3]}[ranging]
        return truth + step, np.broadcast_to(np.array(step) / 10.0, truth.shape)

    monkeypatch.setattr(target_errors, "target_grid", grid)
    monkeypatch.setattr(target_errors, "grid_motions", lambda *_: None)
    monkeypatch.setattr(target_errors, "aim_of", lambda *_: None)
    monkeypatch.setattr(target_errors, "_seen", seen)
    voxels = iter([np.full(4, 1.0), np.full(4, 4.0)])
    monkeypatch.setattr(target_errors, "_voxel_sigma", lambda *_: next(voxels))
    known, target = scenario(scanner={"as_built": {"base": {"tolerance": 1e-3}}}), StudyTarget.of(scenario())
    found = target_errors.measure_targets(known, target, 7.0, positions=2, patterns=3)
    np.testing.assert_allclose(found.error, np.broadcast_to([1e-3, 2e-3, 3e-3, 4e-3], (2, 6, 4)), atol=1e-12)
    np.testing.assert_allclose(found.sigma, np.broadcast_to([1e-4, 2e-4, 3e-4, 4e-4], (2, 6, 4)))
    np.testing.assert_allclose(found.voxel, 2.5)
    assert found.distance == 7.0
    np.testing.assert_allclose([where for where, _ in asked], spread_distances(known, 7.0, 2))
    assert len({seed for _, seed in asked}) == 2
    target_errors_of_nine = asked.copy()
    voxels = iter([np.full(4, 1.0)] * 2)
    target_errors.measure_targets(known, target, 9.0, positions=2, patterns=3)
    # An instrument that has one rangefinder is asked for its ranges alone.
    voxels = iter([np.full(3, 1.0)] * 2)
    alone = target_errors.measure_targets(
        scenario(scanner=ALONE | known.scanner.model_dump(include={"as_built"})),
        target,
        9.0,
        positions=2,
        patterns=3,
    )
    assert alone.rangings == ("triangulation",)
    np.testing.assert_allclose(alone.error, np.broadcast_to([1e-3, 2e-3, 3e-3], (2, 6, 3)), atol=1e-12)
    assert not {seed for _, seed in target_errors_of_nine} & {seed for _, seed in asked[2:]}


@pytest.mark.parametrize("count", [1, 4])
def test_spots_lie_evenly_within_a_pixel(count: int) -> None:
    """Claim: at the distances p = s t/(1 − g t), t = d/R, is the middle one's and ±(i + ½)/n − ½ of a pixel."""
    known = scenario()
    image, pitch = known.scanner.receiver.line_image, known.scanner.position_sensor.pitch
    tangent = known.scanner.receiver.baseline / spread_distances(known, 8.0, count)
    middle = known.scanner.receiver.baseline / 8.0
    place, there = (image.scale * t / (1.0 - image.slope * t) for t in (tangent, middle))
    np.testing.assert_allclose((place - there) / pitch, (np.arange(count) + 0.5) / count - 0.5, atol=1e-6)


def test_the_nearest_target_is_within_the_mirrors_and_the_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the pattern's amplitude, half a diameter times the tracker's, is seen under four fifths of what both
    mirrors can follow, of φ with its aspect; but no nearer than 1.1 times the line's nearest range."""
    known = scenario()
    target = StudyTarget.of(known, 0.3)
    pattern = target.pattern.model_copy(update={"aspect": 2.0})
    target = StudyTarget(0.3, target.disc, target.plate, pattern, target.tracker, target.visiting)
    rate = 1.0 / (pattern.points * known.scanner.dwell)
    limits = {3.0 * rate: 4e-3, 2.0 * rate: 6e-3}
    monkeypatch.setattr(
        target_grid,
        "attainable_amplitude",
        lambda _, f: next(a for r, a in limits.items() if math.isclose(r, f)),
    )
    radius = 0.15 * target.tracker.track_amplitude
    assert nearest_distance(known, target) == pytest.approx(radius / (0.8 * 3e-3))
    limits[2.0 * rate] = 60.0
    assert nearest_distance(known, target) == pytest.approx(radius / (0.8 * 4e-3))
    limits[3.0 * rate] = 40.0
    assert nearest_distance(known, target) == pytest.approx(1.1 * known.scanner.nearest_range)


def test_targets_of_a_study_are_the_scenarios_or_black_on_white() -> None:
    array = {"name": "node", "array": {"diameter": 0.25, "plate": 0.6}, "position": (0.0, 0.0, 9.0),
             "disc": "z93_white", "material": "grey_reference"}  # fmt: skip
    tracker = {"track_amplitude": 1.7}
    known = scenario(
        scene={"objects": [array]}, scan={"type": "track", "targets": ["node"], "tracker": tracker}
    )
    own = StudyTarget.of(known)
    assert (own.diameter, own.disc, own.plate) == (0.25, "z93_white", "grey_reference")
    assert own.tracker.track_amplitude == 1.7
    assert StudyTarget.of(known, 0.4).diameter == 0.4
    other = StudyTarget.of(scenario())
    assert (other.diameter, other.disc, other.plate) == (0.1, "target_black", "target_white")
    assert other.tracker == TrackerSettings()


def test_a_grid_has_room_for_its_patterns(device: Device) -> None:
    """Claim: 36 discs square to z at a distance, as far apart as their plates are wide: 1.1 times the pattern and four
    spot radii to each side, and centres whose points are those of the grid."""
    known = scenario()
    target = StudyTarget.of(known)
    made, centres = target_grid.target_grid(known, target, 9.0, 5, "cpu")
    (grid,) = made.scenario.scene.objects
    amplitude = 0.05 * target.tracker.track_amplitude
    wide = 2.2 * (amplitude + 4.0 * known.scanner.laser.radius(9.0))
    assert grid.array.plate == pytest.approx(wide)
    assert grid.array.spacing == pytest.approx((wide, wide))
    assert (made.scenario.seed, made.scenario.ranging, made.scenario.lighting.sun) == (5, "both", "none")
    assert made.scenario.processing.range_gate is None
    alone, _ = target_grid.target_grid(scenario(scanner=ALONE), target, 9.0, 5, "cpu")
    assert alone.scenario.ranging == "triangulation"
    theta, phi, r = centres.T
    separation = known.scanner.mirrors.axis_separation
    ahead = r * np.cos(theta) - separation
    points = np.stack([r * np.sin(theta), ahead * np.sin(phi), ahead * np.cos(phi) + separation])
    np.testing.assert_allclose(points[2], 9.0, atol=1e-9)
    places = np.unique(np.round(points[:2].T / wide, 6), axis=0)
    wanted = np.arange(6) - 2.5
    np.testing.assert_allclose(places, np.array([(x, y) for x in wanted for y in wanted]), atol=1e-5)


def test_patterns_go_over_each_target_in_turn() -> None:
    """Claim: patterns of one visit each, two periods apart, the same figure about their targets but for its dither, as
    wide as the tracker's amplitude of the disc at the mean distance."""
    known = scenario()
    target = StudyTarget.of(known)
    still = target.pattern.model_copy(update={"dither_sampling": False, "inversion": False})
    target = StudyTarget(0.1, target.disc, target.plate, still, target.tracker, target.visiting)
    centres = np.array([[0.1, -0.05, 8.0], [-0.2, 0.15, 12.0]])
    found = grid_motions(known, target, centres, 3)
    scanner = known.scanner
    period = target.visiting.period(still.points, scanner.dwell, 2, scanner.galvanometers)
    amplitude = target.tracker.track_amplitude * 0.05 / 10.0
    for name, column in (("theta", 0), ("phi", 1)):
        for kind in ("commanded", "true", "latched"):
            away = getattr(found, f"{kind}_{name}") - np.repeat(centres[:, column], 3)[:, None]
            assert away.shape == (6, still.points)
            np.testing.assert_allclose(away, away[:1].repeat(6, axis=0), atol=1e-12)
        commanded = getattr(found, f"commanded_{name}")[0] - centres[0, column]
        assert np.abs(commanded).max() == pytest.approx(amplitude, rel=2e-3)
    np.testing.assert_allclose(np.diff(found.time[:, 0]), 2.0 * period)
    # Its last dwell ends with the period, or less than a dwell later, where turning round takes longer.
    assert found.time[0, -1] + 0.5 * scanner.dwell == pytest.approx(period, abs=scanner.dwell)
    moved = grid_motions(known, StudyTarget.of(known), centres, 2)
    away = moved.commanded_theta - np.repeat(centres[:, 0], 2)[:, None]
    assert all(np.abs(away[one] - away[other]).max() > 1e-5 for one in range(4) for other in range(one))


def test_a_plan_has_the_ranges_at_which_targets_are_followed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: 10 m times powers of √2 from the nearest distance to nine tenths of the farthest range; fewer than three
    are none; arrays of the scene stand behind the study's own, lines of them do not."""
    array = {"array": {"diameter": 0.1, "plate": 0.3, "rows": 2, "columns": 3, "spacing": (0.4, 0.9)},
             "position": (0.0, 0.0, 9.0)}  # fmt: skip
    line = array | {"array": array["array"] | {"rows": 1}}  # type: ignore[operator]
    ball = {
        "name": "ball",
        "shape": "sphere",
        "diameter": 0.2,
        "position": (0.0, 0.0, 9.0),
        "material": "z93_white",
    }
    known = scenario(scene={"objects": [ball, {"name": "own", **array}, {"name": "line", **line}]})
    target = StudyTarget.of(known)
    monkeypatch.setattr(pose_study, "nearest_distance", lambda *_: 4.9)
    # 28.3 m is nearer, and no nearer than nine tenths of it.
    monkeypatch.setattr(type(known.scanner), "farthest_range", 30.0)
    plan = plan_study(known, target)
    wanted = [10.0 * math.sqrt(2.0) ** power for power in range(-2, 3)]
    np.testing.assert_allclose(plan.distances, wanted)
    assert plan.arrays[0].points.tolist() == square(1.0).points.tolist()
    own = [one for one in plan.arrays if "own" in one.name or "line (own)" in one.name]
    assert [(one.name, one.size, len(one.points)) for one in own] == [("own (own)", pytest.approx(0.9), 6)]
    assert plan.steps == len(plan.distances) * (1 + len(plan.arrays))
    small = [square(0.5), square(2.0), line_and_one(1.0), pyramid(1.0)]
    large = [square(1.0, 3), *(circle(1.0, count) for count in (4, 6, 8, 12))]
    for quick, others, effort in ((False, small + large, (2000, 4, 4)), (True, small, (400, 2, 2))):
        made = plan_study(known, target, quick=quick)
        assert [one.points.tolist() for one in made.arrays[1:-1]] == [one.points.tolist() for one in others]
        assert tuple(vars(made).values())[2:] == effort
    monkeypatch.setattr(pose_study, "nearest_distance", lambda *_: 4.9)
    assert plan_study(known, target, quick=True).distances == (5.0, 10.0, 20.0)
    monkeypatch.setattr(pose_study, "nearest_distance", lambda *_: 9.9)
    assert len(plan_study(known, target).distances) == 3
    monkeypatch.setattr(pose_study, "nearest_distance", lambda *_: 10.1)
    with pytest.raises(InputError, match="fewer than three"):
        plan_study(known, target)


def test_rows_of_an_array_are_the_poses_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: root mean square, mean and stated σ of each component of the poses that were found, less the array's own
    place; its interval has the degrees of freedom 1/(1/poses + 1/observations) of the poses and of the pool."""
    errors = np.array([[1.0, 2.0, 3.0], [3.0, 2.0, -3.0], [9.0, 9.0, 9.0]]) * 1e-3
    turns = np.array([[1.0, 0.0, 2.0], [1.0, 0.0, -4.0], [9.0, 9.0, 9.0]]) * 1e-3
    covariance = np.tile(np.diag([4.0, 1.0, 9.0, 1.0, 1.0, 1.0]), (3, 1, 1))
    covariance[2] = np.nan
    pose = SimpleNamespace(
        position=errors + np.array([0.0, 0.0, 7.0]),
        rotation=rotation_from_vector(turns),
        covariance=covariance,
        sigma=np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)),
        status=np.array([PoseStatus.AMBIGUOUS, PoseStatus.VALID, PoseStatus.VALID]),
    )
    asked = []

    def estimated(array: Any, measured: Any, sigma: Any, method: str, separation: float) -> Any:
        asked.append((method, measured))
        return pose

    monkeypatch.setattr(
        pose_study, "_observed", lambda *given: (given[-1], None) if given[-1] != "tof" else None
    )
    monkeypatch.setattr(pose_study, "_estimated", estimated)
    plan = StudyPlan((7.0,), (square(1.0),), 3, 1, 1)
    rows = list(pose_study._array_rows(scenario(), plan, square(1.0), pool()))
    assert asked == [(method, "triangulation") for method in ("uv", "xyz", "joint")]
    assert len(rows) == 30
    x, _, z, *turned = rows[:6]
    assert [(row.array, row.targets, row.size_m, row.range_m) for row in rows] == [
        ("square", 4, square(1.0).size, 7.0)
    ] * 30
    assert [row.component for row in rows[:6]] == list(COMPONENTS)
    assert [(row.method, row.ranging) for row in rows[::6]] == list(pose_study.MODES)
    assert (x.simulated, x.bias, x.stated) == pytest.approx((math.sqrt(5e-6), 2e-3, 2.0))
    assert (z.simulated, z.bias, z.stated) == pytest.approx((3e-3, 0.0, 3.0), abs=1e-12)
    assert (turned[2].simulated, turned[2].bias) == pytest.approx((math.sqrt(10e-6), -1e-3), rel=1e-6)
    assert [row.unit for row in rows[:6]] == ["m"] * 3 + ["rad"] * 3
    # 2 poses, 6 observations: 1.5 degrees of freedom.
    low, high = (math.sqrt(5e-6 * 1.5 / chi2.ppf(share, 1.5)) for share in (0.975, 0.025))
    assert (x.low, x.high) == pytest.approx((low, high))
    assert (x.ambiguous, x.poses) == (pytest.approx(1.0 / 3.0), 2)
    assert (rows[-1].poses, rows[-1].ranging) == (0, "tof")
    assert math.isnan(rows[-1].simulated)
    alone = TargetErrors(7.0, ("triangulation",), pool().error[..., :3], pool().sigma[..., :3], np.ones(3))
    found = list(pose_study._array_rows(scenario(), plan, square(1.0), alone))
    assert [(row.method, row.ranging) for row in found[::6]] == list(pose_study.MODES[:3])


def test_an_array_of_which_no_pose_is_determined_has_rows_without_errors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: where no pose has a covariance, none counts: no error, no σ and no interval is told of any component."""
    pose = SimpleNamespace(
        position=np.zeros((3, 3)),
        rotation=np.tile(np.eye(3), (3, 1, 1)),
        sigma=np.full((3, 6), np.nan),
        covariance=np.full((3, 6, 6), np.nan),
        status=np.array([PoseStatus.UNDETERMINED, PoseStatus.NO_CONSENSUS, PoseStatus.UNDETERMINED]),
    )
    monkeypatch.setattr(pose_study, "_observed", lambda *given: (given[-1], None))
    monkeypatch.setattr(pose_study, "_estimated", lambda *given: pose)
    plan = StudyPlan((7.0,), (square(1.0),), 3, 1, 1)
    rows = list(pose_study._array_rows(scenario(), plan, square(1.0), pool()))
    assert len(rows) == len(pose_study.MODES) * 6
    for row in rows:
        assert (row.poses, row.ambiguous) == (0, 0.0)
        assert np.isnan([row.simulated, row.low, row.high, row.stated, row.bias]).all()


@pytest.mark.parametrize("ranging", ["triangulation", "tof"])
def test_targets_are_seen_as_the_tracker_does(monkeypatch: pytest.MonkeyPatch, ranging: Any) -> None:
    """Claim: by the light of the line and the ranges of the way that is asked for, each pattern by itself, expected
    where its target is, and pulses that are all of a range by both; what a tracker would not take has no position and
    no σ."""
    layers = {name: np.array([float(number)]) for number, name in enumerate(
        ("range_m", "sigma_range_m", "status", "tof.range_m", "tof.sigma_range_m", "tof.status", "Y", "sigma_Y")
    )}  # fmt: skip
    truth = np.array([[0.1, 0.2, 7.0], [0.1, 0.2, 7.0], [-0.3, 0.4, 8.0]])
    covariance = np.arange(27.0).reshape(3, 3, 3) + 1.0
    seen = SimpleNamespace(position=truth + 1e-3, covariance=covariance)
    told: dict[str, Any] = {}

    class Sensor:
        def __init__(self, scenarios: Any, instrument: Any) -> None:
            (told["scenario"],), told["layers"] = scenarios, instrument._layers

        def measure(self, motions: Any, visits: Any, run: Any) -> Any:
            told.update(motions=motions, visits=visits.tolist(), run=run.tolist())
            return "measured"

        def expect(self, orders: Any, *about: Any) -> Any:
            told["about"] = [about[0], about[1].tolist(), about[2].tolist()]
            told["orders"] = [(one.position.tolist(), one.number) for one in orders]
            return "expected"

        def see(self, followed: Any, measured: Any, expected: Any) -> Any:
            told["see"] = (followed, measured, expected)
            return None, seen, None

    monkeypatch.setattr(target_errors, "TargetSensor", Sensor)
    monkeypatch.setattr(
        target_errors, "_taken", lambda found, target: np.array([True, found is not seen, True])
    )
    known: Any = SimpleNamespace(targets=("first", "second"), model_copy=lambda update: update)
    found, sigma = target_errors._seen(known, layers, "motions", truth, "target", ranging)  # type: ignore[arg-type]
    prefix = "tof." if ranging == "tof" else ""
    assert told["layers"] == {
        name: layers[f"{prefix}{name}"] for name in ("range_m", "sigma_range_m", "status")
    } | {name: layers[name] for name in ("Y", "sigma_Y")} | {"tof.sigma_range_m": np.zeros(1)}
    assert told["scenario"] == {"ranging": "both" if ranging == "tof" else "triangulation"}
    assert (told["motions"], told["visits"], told["run"]) == ("motions", [0, 1, 2], [0, 0, 0])
    assert told["orders"] == [(place, number) for number, place in enumerate(truth.tolist())]
    assert told["about"] == ["motions", [0, 1, 2], [0, 0, 0]]
    assert told["see"] == ("first", "measured", "expected")
    np.testing.assert_allclose(found, np.where([[True], [False], [True]], truth + 1e-3, np.nan))
    diagonal = np.sqrt([[1.0, 5.0, 9.0], [np.nan] * 3, [19.0, 23.0, 27.0]])
    np.testing.assert_allclose(sigma, diagonal)
