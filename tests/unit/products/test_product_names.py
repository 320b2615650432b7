"""What stands under which name: columns of tracks and poses, numbers of summaries, by values that are all different."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim.pose.series import PoseSeries
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.transforms import rotation_from_vector
from scanner_sim.products import track_summary as track_module
from scanner_sim.products.budget import BudgetRow, Dominance, crossing
from scanner_sim.products.files.tables import check_columns, six_digits, table_csv
from scanner_sim.products.image import RangeImage
from scanner_sim.products.points import write_ply
from scanner_sim.products.pose import about_poses, pose_columns
from scanner_sim.products.summary import share_beyond, summary
from scanner_sim.products.track import about_track, track_columns, voxel_columns
from scanner_sim.products.track_summary import track_summary
from scanner_sim.ranging.axes import Axes
from scanner_sim.tracking.errors import ErrorParts
from scanner_sim.tracking.measurement import TargetAppearance
from scanner_sim.tracking.record import PatternRecord, Track, TrackStatus, TrackTarget
from scanner_sim.tracking.response import TargetKind
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.state import Refusal, TrackMode

Array = NDArray[np.float64]


def positive(size: int, seed: int) -> Array:
    """Return a covariance whose entries are all different."""
    root = np.random.default_rng(seed).normal(size=(size, size))
    return np.asarray(root @ root.T + size * np.eye(size))


def record(number: int, **changes: Any) -> PatternRecord:
    """Return a visit whose numbers are all different."""
    covariance = positive(3, number)
    one = np.ones(())
    errors = ErrorParts(
        white=0.5 * covariance, surface=0.1 * positive(3, 50 + number), turn=0.11 * one, approach=0.4 * one,
        range_fades=1.6 * one, pixels=0.04 * one,
        image=44.0 * one, image_width=0.9 * one, wobble=0.09 * one, wobble_time=0.06 * one, wobble_angle=0.07 * one,
        drift=np.array([0.2, -0.3]), common=np.array([[0.1, 0.02], [0.03, 0.2], [0.3, 0.04]]),
        dither=np.stack([0.02 * positive(3, 60 + number), 0.01 * positive(3, 70 + number)]), dwell_place=0.3 * one,
        dwell_step=2.1 * one, offset=np.array([0.15, -0.08]),
    )  # fmt: skip
    values = np.arange(5.0) + 10.0 * number
    samples = PatternSamples(
        *(values[None] + 100.0 * k for k in range(7)), status=np.full((1, 5), number, dtype=np.uint8)
    )
    made: dict[str, Any] = {
        "number": 3 * number + 2, "target": "node/1", "time": 0.5 + number, "mode": TrackMode.TRACK,
        "after": TrackMode.TRACK, "refusal": Refusal.NONE, "status": TrackStatus.MEASURED,
        "amplitude": 7e-3 + number, "centre": np.array([0.1, 0.2]) + number,
        "position": np.array([1.0, 2.0, 3.0]) + number, "covariance": covariance, "errors": errors,
        "point": np.array([4.0, 5.0, 6.0]) + number, "point_covariance": positive(3, 90 + number),
        "truth": np.array([1.5, 2.2, 3.1]) + number, "truth_point": np.array([7.0, 8.0, 9.0]) + number,
        "samples": samples,
    }  # fmt: skip
    return PatternRecord(**made | changes)


def run(*records: PatternRecord) -> Track:
    appearance = TargetAppearance(kind=TargetKind.BLACK, diameter=0.1)
    target = TrackTarget("node/1", "node", appearance, np.array([0.1, 0.2, 8.0]), np.zeros(3))
    return Track(records, (target,), 5, "schema: 1", "a program", Axes(0.05))


def test_columns_of_a_track_hold_what_their_names_say() -> None:
    made = [record(0), record(1)]
    columns = track_columns(run(*made))
    for row, one in enumerate(made):
        plain: dict[str, Any] = {
            "time_s": one.time, "visit": one.number, "amplitude_rad": one.amplitude,
            "centre_theta_rad": one.centre[0], "centre_phi_rad": one.centre[1], "status": 0,
        }  # fmt: skip
        angular, spatial = ("theta_rad", "phi_rad", "range_m"), ("x_m", "y_m", "z_m")
        for names, values, matrix, truth in (
            (angular, one.position, one.covariance, one.truth),
            (spatial, one.point, one.point_covariance, one.truth_point),
        ):
            for axis, name in enumerate(names):
                plain |= {name: values[axis], f"truth_{name}": truth[axis]}
                plain[f"sigma_{name}"] = np.sqrt(matrix[axis, axis])
        for name, i, j in (("theta_phi_rad2", 0, 1), ("theta_range_rad_m", 0, 2), ("phi_range_rad_m", 1, 2)):
            plain[f"cov_{name}"] = one.covariance[i, j]
        for name, i, j in (("xy_m2", 0, 1), ("xz_m2", 0, 2), ("yz_m2", 1, 2)):
            plain[f"cov_{name}"] = one.point_covariance[i, j]
        parts = one.errors
        for axis, name in enumerate(angular):
            plain[f"sigma_white_{name}"] = np.sqrt(parts.white[axis, axis])
            plain[f"sigma_surface_{name}"] = np.sqrt(parts.surface[axis, axis])
        plain |= {
            "cov_surface_theta_phi_rad2": parts.surface[0, 1], "surface_turn_rad": 0.11,
            "cov_surface_theta_range_rad_m": parts.surface[0, 2],
            "cov_surface_phi_range_rad_m": parts.surface[1, 2],
            "surface_approach_m": 0.4, "surface_range_fades": 1.6, "image_pixel": 44.0,
            "image_width_pixel": 0.9, "wobble_time_s": 0.06, "wobble_angle_rad": 0.07, "sigma_pixels_range_m": 0.2,
            "sigma_wobble_rad": 0.3, "drift_theta_rad": 0.2, "drift_phi_rad": -0.3,
        }  # fmt: skip
        for name, value in plain.items():
            assert columns[name][row] == pytest.approx(value), name


def test_voxels_of_a_track_hold_what_their_names_say() -> None:
    columns = voxel_columns(run(record(0), record(1)))
    np.testing.assert_array_equal(columns["visit"], [2] * 5 + [5] * 5)
    names = ("time_s", "theta_rad", "phi_rad", "signal", "sigma_signal", "range_m", "sigma_range_m")
    for number, name in enumerate(names):
        wanted = np.concatenate([np.arange(5.0), 10.0 + np.arange(5.0)]) + 100.0 * number
        np.testing.assert_array_equal(columns[name], wanted)
    np.testing.assert_array_equal(columns["status"], [0] * 5 + [1] * 5)


def series() -> PoseSeries:
    turns = np.array([[0.1, -0.2, 0.3], [0.4, 0.5, -0.6]])
    return PoseSeries(
        name="node", relative_to="", method="uv", time=np.array([1.0, 2.0]), position=np.arange(6.0).reshape(2, 3),
        rotation=rotation_from_vector(turns), covariance=np.stack([positive(6, 1), positive(6, 2)]),
        chi2=np.array([3.0, 4.0]), dof=np.array([5, 6]), targets=np.array([7, 8]),
        status=np.array([0, 1], dtype=np.int8), truth_position=np.arange(6.0).reshape(2, 3) + 0.25,
        truth_rotation=rotation_from_vector(turns + 0.01), lasting=np.stack([positive(6, 3), positive(6, 4)]),
        common=np.stack([positive(6, 5), positive(6, 6)]),
    )  # fmt: skip


def test_columns_of_poses_hold_what_their_names_say() -> None:
    """Claim: quaternions begin with w, the 21 covariances have their components and units in their names."""
    one = series()
    columns = pose_columns([one])
    for axis, name in enumerate("xyz"):
        np.testing.assert_array_equal(columns[f"{name}_m"], one.position[:, axis])
        np.testing.assert_array_equal(columns[f"truth_{name}_m"], one.truth_position[:, axis])
    for row, turn in enumerate(np.array([[0.1, -0.2, 0.3], [0.4, 0.5, -0.6]])):
        angle = np.linalg.norm(turn)
        wanted = [np.cos(0.5 * angle), *(np.sin(0.5 * angle) * turn / angle)]
        assert [columns[f"q{name}"][row] for name in "wxyz"] == pytest.approx(wanted)
    names = ("tx", "ty", "tz", "rx", "ry", "rz")
    for i in range(6):
        for j in range(i, 6):
            unit = "m2" if j < 3 else "rad2" if i >= 3 else "m_rad"
            label = f"cov_{names[i]}_{names[j]}_{unit}"
            np.testing.assert_array_equal(columns[label], one.covariance[:, i, j])
            np.testing.assert_array_equal(columns[f"lasting_{label}"], one.lasting[:, i, j])
            np.testing.assert_array_equal(columns[f"common_{label}"], one.common[:, i, j])
    for name in ("chi2", "dof", "targets", "status"):
        np.testing.assert_array_equal(columns[name], getattr(one, name))


def test_a_table_of_poses_says_what_its_columns_mean() -> None:
    """Claim: translations are in metres and turns in radians, as the covariances' names have it; the order of the
    quaternion is that of its columns; each code has its name."""
    one = series()
    said: Any = about_poses([one], "program 1.0")
    columns = pose_columns([one])
    for part, unit in said["units"].items():
        assert f"cov_{part}_{part}_{unit}2" in columns
        assert unit == {"t": "m", "r": "rad"}[part[0]]
    assert len(said["units"]) == 6
    assert [name for name in columns if name in ("qw", "qx", "qy", "qz")] == [
        f"q{letter}" for letter in said["rotation"].split()[-4:]
    ]
    assert said["rotation"].startswith("reference_from_object,")
    assert {code: text.split(":")[0] for code, text in said["status"].items()} == {
        str(int(code)): code.name for code in PoseStatus
    }
    assert said["series"] == [[one.name, one.relative_to, one.method, len(one.time)]]
    assert said["software"] == "program 1.0"


def test_a_table_of_visits_says_what_its_codes_and_targets_are() -> None:
    """Claim: each code has its name and sentence, and each target its own numbers."""
    made = run(record(0))
    said: Any = about_track(made)
    assert said["status"] == {str(int(code)): f"{code.name}: {code.sentence}" for code in TrackStatus}
    (target,), (told,) = made.targets, said["targets"]
    assert (told["name"], told["object"], told["kind"]) == (
        target.name,
        target.object,
        target.appearance.kind.value,
    )
    numbers = target.appearance.diameter, target.appearance.depth
    assert (told["diameter_m"], told["depth_m"]) == numbers
    assert told["expected_rad_rad_m"] == target.expected.tolist()
    assert told["centre_on_object_m"] == target.centre.tolist()
    assert (said["software"], said["seed"], said["scenario"]) == (made.made_by, made.seed, made.scenario_yaml)


def test_a_summary_of_a_track_counts_and_compares() -> None:
    """Claim: errors are measured less true, over their own σ; shares, losses and the first followed visit by hand."""
    lost = {"status": TrackStatus.NOT_FOUND, "refusal": Refusal.NOT_SEEN}
    nothing = {"position": np.full(3, np.nan), "covariance": np.full((3, 3), np.nan)} | lost
    made = [
        record(0, mode=TrackMode.SEARCH, after=TrackMode.ACQUIRE),
        record(1, mode=TrackMode.ACQUIRE, after=TrackMode.TRACK),
        record(2),
        record(3, status=TrackStatus.REFUSED, refusal=Refusal.SIZE),
        record(4, after=TrackMode.LOST, **nothing),
        record(5, mode=TrackMode.LOST, after=TrackMode.LOST, **nothing),
        record(6, mode=TrackMode.LOST, after=TrackMode.TRACK),
        record(7, after=TrackMode.LOST, **nothing),
    ]
    told = track_summary(run(*made), [series()])
    assert (told["visits"], told["duration_s"], told["voxels"]) == (8, 7.5, 40)
    assert [entry["visits"] for entry in told["status"]] == [4, 3, 1, 0, 0]
    target = told["targets"]["node/1"]
    assert (target["visits"], target["measured_share"]) == (8, 0.5)
    assert (target["followed_from_s"], target["losses"], target["state"]) == (1.5, 2, "lost")
    good = [made[number] for number in (0, 1, 2, 6)]
    error = np.array([one.position - one.truth for one in good])
    sigma = np.array([np.sqrt(np.diagonal(one.covariance)) for one in good])
    for axis, name in enumerate(("theta_rad", "phi_rad", "range_m")):
        assert target[f"sigma_{name}"] == pytest.approx(np.median(sigma[:, axis]))
        truth = target["truth"]
        assert truth["mean_error"][name] == pytest.approx(error[:, axis].mean())
        assert truth["rms_error"][name] == pytest.approx(np.sqrt(np.mean(error[:, axis] ** 2)))
        pull = error[:, axis] / sigma[:, axis]
        assert truth["rms_error_over_sigma"][name] == pytest.approx(np.sqrt(np.mean(pull**2)))
    (pose,) = told["poses"]
    assert pose["status"] == {"VALID": 1, "AMBIGUOUS": 1}
    one = series()
    valid = one.status == PoseStatus.VALID
    parts = ("tx_m", "ty_m", "tz_m", "rx_rad", "ry_rad", "rz_rad")
    (sigma,), (error,) = one.sigma[valid], one.error[valid]
    assert pose["sigma"] == pytest.approx(dict(zip(parts, sigma, strict=True)))
    assert pose["truth"]["mean_error"] == pytest.approx(dict(zip(parts, error, strict=True)))
    pull = np.abs(error / sigma)
    assert pose["truth"]["rms_error_over_sigma"] == pytest.approx(dict(zip(parts, pull, strict=True)))
    assert pose["truth"]["mean_error"]["ty_m"] == pytest.approx(-0.25)
    assert pose["truth"]["compared"] == 1


def image() -> RangeImage:
    """Return 4 × 5 voxels with known errors; the last row has no range."""
    theta, phi = np.linspace(-0.2, 0.3, 5), np.linspace(-0.1, 0.4, 4)
    truth = np.full((4, 5), 5.0)
    error = np.zeros((4, 5))
    error[0] = [0.137, -0.1, 0.2, 0.228, -0.273]
    status = np.zeros((4, 5))
    status[3] = 1
    ranges = np.where(status == 0, truth + error, np.nan)
    truth[2, :2] = np.nan
    layers = {
        "status": status,
        "range_m": ranges,
        "sigma_range_m": np.where(status == 0, 0.045, np.nan),
        "truth.range_m": truth,
    }
    return RangeImage({name: values.astype(np.float32) for name, values in layers.items()}, theta, phi)


def test_a_summary_of_an_image_compares_with_the_truth() -> None:
    """Claim: shares beyond 3, 5 and 6 σ, errors measured less true, quantiles, and the ends of both angles."""
    told = summary(image())
    assert told["theta_rad"] == [-0.2, pytest.approx(0.3)]
    assert told["phi_rad"] == [-0.1, pytest.approx(0.4)]
    assert told["valid_share"] == pytest.approx(0.75)
    truth = told["truth"]
    assert (truth["voxels_compared"], truth["voxels_without_truth"]) == (13, 2)
    error = np.array([0.137, -0.1, 0.2, 0.228, -0.273, *np.zeros(8)])
    assert truth["error_m"]["mean"] == pytest.approx(error.mean(), abs=1e-6)
    assert truth["error_m"]["rms"] == pytest.approx(np.sqrt(np.mean(error**2)), abs=1e-6)
    assert truth["error_m"]["95%"] == pytest.approx(np.quantile(error, 0.95), abs=1e-6)
    assert truth["error_m"]["5%"] == pytest.approx(np.quantile(error, 0.05), abs=1e-6)
    # 3.04, 2.2, 4.4, 5.07 and 6.07 standard deviations.
    shares = {"3 sigma": 4 / 13, "5 sigma": 2 / 13, "6 sigma": 1 / 13}
    assert truth["share_beyond"] == {name: pytest.approx(value) for name, value in shares.items()}
    assert share_beyond(image(), 5.0) == pytest.approx(2 / 13)


@pytest.mark.parametrize("way", ["tof", "fused"])
def test_a_summary_of_an_image_compares_each_rangefinder(way: str) -> None:
    """Claim: errors of time of flight, and of both ways together, are told under their names."""
    alone = image()
    ranges = np.where(alone["status"] == 0, alone["truth.range_m"] + np.float32(0.25), np.float32(np.nan))
    ranges = np.where(np.isfinite(alone["truth.range_m"]), ranges, alone["range_m"])
    more = {f"{way}.range_m": ranges, f"{way}.status": alone["status"]}
    told: Any = summary(replace(alone, channels={**alone.channels, **more}))["truth"]
    assert told[f"{way}.error_m"]["rms"] == pytest.approx(0.25, rel=1e-5)
    without: Any = summary(alone)["truth"]
    assert not {"tof.error_m", "fused.error_m"} & without.keys()


def test_without_an_uncertainty_no_error_is_so_many_of_it() -> None:
    """Claim: where σ is 0 the error over it is no number, and that of another component stays."""
    error, sigma = np.array([[3.0, 4.0], [-3.0, 4.0]]), np.array([[0.0, 2.0], [0.0, 2.0]])
    told: Any = track_module._compare_errors(error, sigma, ("a", "b"))
    assert told["rms_error"] == {"a": 3.0, "b": 4.0}
    assert told["rms_error_over_sigma"] == {"a": None, "b": 2.0}


def test_a_cloud_names_what_its_numbers_count(tmp_path: Path) -> None:
    """Claim: number 1 of objects and of materials is the first name; the fields are in their places."""
    one = image()
    names = ("P.X", "P.Y", "P.Z", "truth.object", "truth.material", "Y")
    layers = dict(one.channels)
    for number, name in enumerate(names):
        values = np.where(one.valid, 100.0 * number + np.arange(20.0).reshape(4, 5), np.nan)
        if name.startswith("truth"):
            values = np.full((4, 5), float(number - 2))
        layers[name] = values.astype(np.float32)
    full = RangeImage(layers, one.theta, one.phi, objects=("wall", "ball"), materials=("grey", "black"))
    write_ply(tmp_path / "points.ply", full)
    header, _, body = (tmp_path / "points.ply").read_bytes().partition(b"end_header\n")
    lines = header.decode().splitlines()
    for line in (
        "comment object 1 wall",
        "comment object 2 ball",
        "comment material 1 grey",
        "comment material 2 black",
    ):
        assert line in lines
    fields = [tuple(line.split()[1:]) for line in lines if line.startswith("property")]
    kinds = {"float": "<f4", "int": "<i4"}
    points = np.frombuffer(body, dtype=[(name, kinds[kind]) for kind, name in fields])
    assert points.size == 15
    np.testing.assert_array_equal(points["row"], np.repeat([0, 1, 2], 5))
    np.testing.assert_array_equal(points["column"], np.tile(np.arange(5), 3))
    for number, name in enumerate("xyz"):
        np.testing.assert_array_equal(points[name], 100.0 * number + np.arange(15))
    np.testing.assert_array_equal(points["intensity"], 500.0 + np.arange(15))
    np.testing.assert_array_equal(points["truth_object"], 1)
    np.testing.assert_array_equal(points["truth_material"], 2)
    np.testing.assert_allclose(points["sigma_range_m"], 0.045)


def row(mode: Any, distance: float, sigma: float) -> BudgetRow:
    return BudgetRow(mode, "all", distance, sigma, 2.0 * sigma, 0.0, 0.0, 10)


def test_ways_cross_where_their_logarithms_do() -> None:
    """Claim: R² 10⁻⁴ and 0.01 are equal at 10 m, exactly between powers; none where triangulation stays better."""
    places = (2.0, 5.0, 20.0, 40.0)
    rows = [row("triangulation", R, 1e-4 * R**2) for R in places] + [row("tof", R, 1e-2) for R in places]
    assert crossing(rows, "analytic_m") == pytest.approx(10.0)
    assert crossing(rows, "simulated_m") == pytest.approx(10.0)
    near = [one for one in rows if one.range_m < 10.0]
    assert np.isnan(crossing(near, "analytic_m"))


def test_what_dominates_is_counted_where_all_is_known() -> None:
    parts = np.array([[[3.0, 1.0, np.nan]], [[1.0, 2.0, 5.0]]])
    found = Dominance(("shot", "read"), parts, np.zeros(3), np.zeros(1), "tof")
    np.testing.assert_array_equal(found.largest, [[0, 1, -1]])
    assert found.shares() == {"shot": 0.5, "read": 0.5}


def test_numbers_of_studies_keep_six_digits() -> None:
    assert [six_digits(value) for value in (1.23456789, 1.2e-7, math.nan)] == ["1.23457", "1.2e-07", ""]


@pytest.mark.parametrize("value", [-1e31, 1e31])
def test_numbers_of_no_sense_are_refused(value: float) -> None:
    with pytest.raises(ValueError, match="any sense"):
        check_columns({"a": np.array([1.0, value])}, {"a": "number"})
    assert check_columns({"a": np.array([1.0, value])}, {"a": "any"})
    assert check_columns({"a": np.array([1.0, np.nan])}, {"a": "number"})
    with pytest.raises(ValueError, match="finite"):
        check_columns({"a": np.array([1.0, np.nan])}, {"a": "finite"})


def test_a_table_for_people_keeps_twelve_digits() -> None:
    text = table_csv({"a": np.array([1.23456789012345, np.nan]), "b": np.array([1, 2])})
    assert text == "a,b\n1.23456789012,1\n,2\n"


@pytest.mark.parametrize(("relative_to", "told"), [("", "scanner"), ("base", "base")])
def test_the_scanner_is_compared_with_the_camera(
    monkeypatch: pytest.MonkeyPatch, relative_to: str, told: str
) -> None:
    """Claim: of each pair the median σ, the mean and the rms of the differences, and their rms over σ, component by
    component; nothing where a run has no camera."""
    random = np.random.default_rng(3)
    difference, sigma = random.normal(size=(5, 6)), random.uniform(1.0, 2.0, (5, 6))
    one = SimpleNamespace(
        scanner=SimpleNamespace(name="node", relative_to=relative_to, method="joint"), time=np.arange(5.0),
        difference=difference, sigma=sigma,
    )  # fmt: skip
    monkeypatch.setattr(track_module, "beside_camera", lambda poses: iter([one] if poses else []))
    assert track_module._by_camera([]) == {}
    (pair,) = track_module._by_camera(["poses"])["scanner_less_camera"]  # type: ignore[list-item, misc]
    assert (pair["object"], pair["relative_to"], pair["method"], pair["compared"]) == (
        "node",
        told,
        "joint",
        5,
    )
    for name, values in (
        ("sigma", np.median(sigma, axis=0)),
        ("mean_difference", difference.mean(axis=0)),
        ("rms_difference", np.sqrt(np.mean(difference**2, axis=0))),
        ("rms_difference_over_sigma", np.sqrt(np.mean((difference / sigma) ** 2, axis=0))),
    ):
        assert list(pair[name].values()) == pytest.approx(values), name
