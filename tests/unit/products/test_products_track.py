"""Tracks in files: tables that say all, read back as they were written, whole or not at all."""

from __future__ import annotations

import csv
import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from scanner_sim.config import load_scenario, resolved_yaml
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.frames import rotation_about
from scanner_sim.instrument.closed_loop.poses import poses_of
from scanner_sim.pose.settings import PoseSettings
from scanner_sim.products.files.contents import RUN, TRACK, planned_track_files
from scanner_sim.products.files.folder import check_target
from scanner_sim.products.files.tables import read_parquet, table_csv, write_parquet
from scanner_sim.products.files.track_folder import write_track
from scanner_sim.products.pose import pose_columns, read_poses
from scanner_sim.products.settings import Output
from scanner_sim.products.track import read_track, track_columns
from scanner_sim.products.track_summary import track_summary
from scanner_sim.ranging.coordinates import angles_and_range, coordinates
from scanner_sim.scene.targets import target_positions
from scanner_sim.tracking.errors import ErrorParts
from scanner_sim.tracking.measurement import TargetAppearance
from scanner_sim.tracking.record import PatternRecord, Track, TrackStatus, TrackTarget
from scanner_sim.tracking.response import TargetKind
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.state import Refusal, TrackMode

DG, STEP, POINTS = 0.05, 0.01, 128
SIGMA = np.array([40e-6, 40e-6, 4e-3])
"""Of a made-up observation: Θ, φ [rad], R [m]."""

BARE = Output(pictures=False)


def array(name: str, x: float, rate: float) -> dict[str, object]:
    """Four targets that drift and turn."""
    return {
        "name": name,
        "array": {
            "diameter": "100 mm",
            "rows": 2,
            "columns": 2,
            "spacing": ["1 m", "1 m"],
            "plate": "200 mm",
        },
        "position": [f"{x} m", "0.2 m", "8 m"],
        "motion": {
            "type": "twist",
            "velocity": ["10 mm/s", "0 mm/s", "-5 mm/s"],
            "turn_rate": ["0 deg/s", f"{rate} deg/s", "0 deg/s"],
        },
    }


def make_track(seconds: float = 0.4, seed: int = 1, objects: int = 2) -> Track:
    """A run that a tracker might have made: known truth, made-up noise of known σ, one target acquired late."""
    random = np.random.default_rng(seed)
    scene = [array("node", -1.2, 1.0), array("z1", 1.2, -1.0)][:objects]
    names = [f"{item['name']}/{member}" for item in scene for member in range(1, 5)]
    scan = {"type": "track", "targets": names}
    scenario = load_scenario({"schema": 1, "scene": {"objects": scene}, "scan": scan})
    appearance = TargetAppearance(kind=TargetKind.BLACK, diameter=0.1, depth=0.3)
    centres = target_positions(2, 2, 1.0, 1.0)
    members = [(item, centre) for item in scenario.scene.objects for centre in centres]
    records = []
    for number in range(round(seconds / STEP)):
        which = number % len(names)
        item, centre = members[which]
        time = (number + 0.5) * STEP
        pose = item.pose_at(time)[0]
        point = pose[:3, :3] @ centre + pose[:3, 3]
        r, theta, phi = angles_and_range(*point, DG)
        truth = np.array([theta, phi, r])
        place = truth + SIGMA * random.standard_normal(3)
        late = which == 1 and number < 2 * len(names)
        found = not late
        blank = 0.0 if found else np.nan
        records.append(
            PatternRecord(
                number=number,
                target=names[which],
                time=time,
                mode=TrackMode.SEARCH if late else TrackMode.TRACK,
                after=TrackMode.SEARCH if late else TrackMode.TRACK,
                refusal=Refusal.NOT_SEEN if late else Refusal.NONE,
                status=TrackStatus.NOT_FOUND if late else TrackStatus.MEASURED,
                amplitude=30e-3 if late else 10e-3,
                centre=truth[:2] + 1e-4,
                position=place + blank,
                covariance=np.diag(SIGMA**2) + blank,
                errors=errors_of(blank),
                point=np.stack(coordinates(place[2], place[0], place[1], DG)) + blank,
                point_covariance=np.diag([1e-8, 2e-8, 1e-5]) + blank,
                truth=truth,
                truth_point=point,
                samples=pattern_of(truth, time, 30e-3 if late else 10e-3, random),
            )
        )
    targets = tuple(
        TrackTarget(
            name, name.split("/")[0], appearance, next(r.truth for r in records if r.target == name), centre
        )
        for name, (_, centre) in zip(names, members, strict=True)
    )
    return Track(
        records=tuple(records),
        targets=targets,
        seed=seed,
        scenario_yaml=resolved_yaml(scenario),
        made_by="scanner-sim 0",
        warnings=("A warning.",),
    )


def errors_of(blank: float) -> ErrorParts:
    """Every part, none as large as the next."""
    surface = np.diag([0.1, 0.2, 0.3]) * SIGMA**2
    surface[0, 1] = surface[1, 0] = 0.05 * SIGMA[0] * SIGMA[1]
    rest = replace(
        ErrorParts.all_white(np.zeros((3, 3))),
        surface=surface,
        turn=np.asarray(0.05),
        pixels=np.asarray(0.4 * SIGMA[2] ** 2),
        image=np.asarray(44.0),
        image_width=np.asarray(0.9),
        wobble=np.asarray(0.01 * SIGMA[0] ** 2),
        wobble_time=np.asarray(0.05),
        wobble_angle=np.asarray(0.06),
        drift=np.array([0.1, 0.2]) * SIGMA[:2],
    )
    return replace(rest, white=np.diag(SIGMA**2) - rest.whole + blank)


def pattern_of(
    truth: np.ndarray, time: float, amplitude: float, random: np.random.Generator
) -> PatternSamples:
    """A 3:2 figure over a dark disc on a bright plate."""
    turn = 2.0 * np.pi * np.arange(1, POINTS + 1) / POINTS
    theta = truth[0] + 1e-4 + amplitude * np.sin(3.0 * turn)
    phi = truth[1] + 1e-4 + amplitude * np.sin(2.0 * turn)
    off = np.hypot(theta - truth[0], phi - truth[1]) > 0.05 / truth[2]
    signal = np.where(off, 8e5, 5e4) * (1.0 + 0.02 * random.standard_normal(POINTS))
    return PatternSamples(
        time=(time + 50e-6 * (np.arange(POINTS) - 63.5))[None],
        theta=theta[None],
        phi=phi[None],
        signal=signal[None],
        sigma_signal=np.sqrt(signal)[None],
        range=(truth[2] + 0.01 * random.standard_normal(POINTS))[None],
        sigma_range=np.full((1, POINTS), 0.01),
        status=np.zeros((1, POINTS), dtype=np.uint8),
    )


@pytest.fixture(scope="module")
def track() -> Track:
    return make_track()


def assert_same(one: object, two: object) -> None:
    """Fields equal, arrays to the last bits but those lost in a root and its square."""
    for field in fields(one):  # type: ignore[arg-type]
        a, b = getattr(one, field.name), getattr(two, field.name)
        if isinstance(a, PatternSamples):
            assert_same(a, b)
        elif isinstance(a, ErrorParts):
            # White is what the others leave of the covariance.
            for part in fields(a):
                first, second = (np.asarray(getattr(errors, part.name)) for errors in (a, b))
                size = np.nan_to_num(np.abs(first)).max(initial=0.0)
                np.testing.assert_allclose(first, second, rtol=1e-12, atol=1e-12 * size)
        elif isinstance(a, np.ndarray):
            np.testing.assert_allclose(a, b, rtol=1e-15, atol=0.0)
        else:
            assert a == b, field.name


def test_a_track_is_read_as_it_was_written(track: Track, tmp_path: Path) -> None:
    write_track(track, tmp_path / "run", BARE)
    again = read_track(tmp_path / "run")
    for one, two in zip(track.records, again.records, strict=True):
        assert_same(one, two)
    for one, two in zip(track.targets, again.targets, strict=True):
        assert_same(one, two)
    assert (again.seed, again.scenario_yaml, again.made_by, again.warnings) == (
        track.seed, track.scenario_yaml, track.made_by, track.warnings
    )  # fmt: skip


def test_the_table_begins_as_the_contract_says(track: Track, tmp_path: Path) -> None:
    write_track(track, tmp_path / "run", BARE)
    with (tmp_path / "run" / "track.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    measured = ["theta_rad", "phi_rad", "range_m", "x_m", "y_m", "z_m"]
    wanted = ["time_s", "target", "state", *measured, *(f"sigma_{name}" for name in measured), "status"]
    wanted += [f"truth_{name}" for name in measured]
    assert list(rows[0])[: len(wanted)] == wanted
    assert len(rows) == len(track.records)
    columns, about = read_parquet(tmp_path / "run" / "track.parquet")
    assert list(columns) == list(rows[0])
    for name in ("theta_rad", "sigma_range_m", "truth_z_m"):
        spelt = [float(row[name] or "nan") for row in rows]
        np.testing.assert_allclose(spelt, columns[name], rtol=1e-11, equal_nan=True)
    assert rows[1]["state"] == "search"
    assert rows[1]["theta_rad"] == ""
    assert rows[1]["truth_theta_rad"]
    assert about["scenario"] == track.scenario_yaml


@pytest.mark.slow
def test_the_same_track_gives_the_same_bytes(track: Track, tmp_path: Path) -> None:
    poses = poses_of(track)
    for name in ("one", "two"):
        write_track(track, tmp_path / name, poses=poses)
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes(), path.name
    names = {path.name for path in (tmp_path / "one").iterdir()}
    assert names == set(TRACK.files) == set(planned_track_files(Output(), 2))


def test_what_is_switched_off_is_not_written(track: Track, tmp_path: Path) -> None:
    output = Output(pictures=False, patterns=False)
    names = tuple(path.name for path in write_track(track, tmp_path / "run", output))
    assert (
        names
        == ("track.csv", "track.parquet", "scenario.yaml", "summary.json")
        == planned_track_files(output, 0)
    )
    assert read_track(tmp_path / "run").records[0].samples.time.shape == (1, 0)


def test_an_empty_run_is_written(track: Track, tmp_path: Path) -> None:
    empty = replace(track, records=())
    write_track(empty, tmp_path / "run", poses=poses_of(empty))
    assert read_track(tmp_path / "run").records == ()


def test_an_existing_result_stays_unless_asked_for(track: Track, tmp_path: Path) -> None:
    write_track(track, tmp_path / "run", BARE)
    with pytest.raises(InputError, match="already holds a result"):
        write_track(track, tmp_path / "run", BARE)
    with pytest.raises(InputError, match="not ours to replace"):
        check_target(tmp_path / "run", True, RUN)
    write_track(track, tmp_path / "run", replace_output(), overwrite=True)
    assert not (tmp_path / "run" / "patterns.parquet").exists()


def replace_output() -> Output:
    return Output(pictures=False, patterns=False)


def test_files_of_others_are_refused(tmp_path: Path, track: Track) -> None:
    with pytest.raises(InputError, match=r"no track\.parquet"):
        read_track(tmp_path)
    (tmp_path / "track.parquet").write_text("no table")
    with pytest.raises(InputError, match="cannot be read as Parquet"):
        read_track(tmp_path)
    write_parquet(tmp_path / "track.parquet", {"time_s": np.zeros(3)}, {})
    with pytest.raises(InputError, match="not of this version"):
        read_track(tmp_path)


def test_the_summary_counts_and_compares(track: Track) -> None:
    summary = track_summary(track, poses_of(track))
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert summary["visits"] == 40
    assert summary["voxels"] == 40 * POINTS
    assert [row["visits"] for row in summary["status"]] == [38, 2, 0, 0, 0]
    late = summary["targets"]["node/2"]
    assert late["measured_share"] == pytest.approx(3 / 5)
    assert late["followed_from_s"] == pytest.approx(2 * 0.08 + 0.015)
    assert late["sigma_theta_rad"] == pytest.approx(SIGMA[0])
    assert {(row["object"], row["relative_to"], row["method"]) for row in summary["poses"]} == {
        (name, to, method)
        for name, to in (("node", "scanner"), ("z1", "scanner"), ("z1", "node"))
        for method in ("uv", "xyz", "joint")
    }


def test_poses_are_read_as_they_were_written(track: Track, tmp_path: Path) -> None:
    poses = poses_of(track)
    write_track(track, tmp_path / "run", BARE, poses=poses)
    own, relative = (read_poses(tmp_path / "run" / f"{name}.parquet") for name in ("pose", "relative_pose"))
    for one, two in zip(poses, (*own, *relative), strict=True):
        assert (one.label, one.method) == (two.label, two.method)
        for name in ("time", "position", "chi2", "dof", "targets", "status", "truth_position"):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
        # Quaternions round, and of a covariance the upper half is written.
        for name in ("rotation", "truth_rotation", "covariance", "lasting"):
            np.testing.assert_allclose(getattr(one, name), getattr(two, name), rtol=1e-12, atol=1e-15)
    text = (tmp_path / "run" / "pose.csv").read_text().splitlines()
    assert text[0].startswith("time_s,object,method,x_m,y_m,z_m,qw,qx,qy,qz,cov_tx_tx_m2,")
    assert "cov_tx_rx_m_rad" in text[0]
    assert text[0].endswith("lasting_cov_rz_rz_rad2")
    assert "cov_rz_rz_rad2,status,chi2,dof,targets,truth_x_m" in text[0]


def test_methods_may_be_chosen(track: Track) -> None:
    assert poses_of(track, PoseSettings(methods=())) == ()
    (only,) = poses_of(make_track(objects=1), PoseSettings(methods=("joint",)))
    assert only.method == "joint"
    assert pose_columns([only])["object"][0] == "node"


def test_texts_with_commas_keep_their_column() -> None:
    table = table_csv({"a": np.array(['x,"y'], dtype=object), "b": np.array([np.nan]), "c": np.array([3])})
    assert table == 'a,b,c\n"x,""y",,3\n'


def test_turns_of_errors_are_about_the_scanners_axes() -> None:
    (series,) = poses_of(make_track(objects=1), PoseSettings(methods=("joint",)))
    turned = replace(series, rotation=rotation_about([0.0, 1.0, 0.0], 0.01) @ series.truth_rotation)
    np.testing.assert_allclose(turned.error[:, 3:], [[0.0, 0.01, 0.0]] * len(series.time), atol=1e-12)


def test_columns_have_units_in_their_names(track: Track) -> None:
    plain = {"target", "state", "next_state", "status", "visit", "refusal"}
    ends = ("_s", "_m", "_rad", "_rad2", "_m2", "_rad_m", "_pixel")
    assert all(name.endswith(ends) for name in track_columns(track).keys() - plain)
