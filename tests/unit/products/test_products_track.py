"""Tracks in files: tables that say all, read back as they were written, whole or not at all."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_track import POINTS, SIGMA, make_track

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.frames import rotation_about
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.closed_loop.poses import poses_of
from scanner_sim.pose.settings import PoseSettings
from scanner_sim.products.files import track_folder
from scanner_sim.products.files.contents import (
    DOTS,
    FORMAT_FILES,
    FRAME_PICTURE,
    FRAMES,
    PAGE,
    RUN,
    TRACK,
    converted_files,
    planned_track_files,
)
from scanner_sim.products.files.folder import check_target
from scanner_sim.products.files.tables import read_parquet, table_csv, write_parquet
from scanner_sim.products.files.track_folder import write_track
from scanner_sim.products.pose import pose_columns, read_poses
from scanner_sim.products.settings import Output
from scanner_sim.products.track import (
    _ANGULAR,
    _SIGMAS,
    _SPATIAL,
    ERRORS,
    _check_order,
    read_track,
    track_columns,
)
from scanner_sim.products.track_summary import track_summary
from scanner_sim.products.true_poses import TruePoses
from scanner_sim.ranging.axes import Axes
from scanner_sim.tracking.errors import ErrorParts
from scanner_sim.tracking.record import Track, TrackStatus
from scanner_sim.tracking.samples import PatternSamples

BARE = Output(pictures=False)


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
    track = replace(track, axes=Axes(0.052, 1e-3, -2e-3))
    write_track(track, tmp_path / "run", BARE)
    again = read_track(tmp_path / "run")
    assert again.axes == track.axes
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
    assert names == set(planned_track_files(Output(), 2))
    others = {PAGE, FRAMES, DOTS, FRAME_PICTURE, *converted_files(tuple(FORMAT_FILES))}
    assert names == set(TRACK.files) - others


def test_what_is_switched_off_is_not_written(track: Track, tmp_path: Path) -> None:
    output = Output(pictures=False, patterns=False)
    names = tuple(path.name for path in write_track(track, tmp_path / "run", output))
    assert (
        names
        == ("track.csv", "track.parquet", "scenario.yaml", "summary.json")
        == planned_track_files(output, 0)
    )
    assert read_track(tmp_path / "run").records[0].samples.time.shape == (1, 0)


def test_targets_are_read_with_their_form(track: Track, tmp_path: Path) -> None:
    """Claim: spheres stay spheres, and what an earlier version wrote, which did not say so, is flat."""
    first, *others = track.targets
    ball = replace(first, appearance=first.appearance.model_copy(update={"surface": "sphere"}))
    write_track(replace(track, targets=(ball, *others)), tmp_path / "run", BARE)
    assert [one.appearance for one in read_track(tmp_path / "run").targets] == [
        one.appearance for one in (ball, *others)
    ]
    table = tmp_path / "run" / "track.parquet"
    columns, about = read_parquet(table)
    for said in about["targets"]:
        del said["surface"]
    write_parquet(table, columns, about)
    assert [one.appearance for one in read_track(tmp_path / "run").targets] == [
        one.appearance for one in track.targets
    ]
    about["targets"][1]["surface"] = "cube"
    write_parquet(table, columns, about)
    with pytest.raises(InputError, match="surface"):
        read_track(tmp_path / "run")


def test_a_run_of_an_earlier_version_is_read(track: Track, tmp_path: Path) -> None:
    """Claim: without the columns that came later a table is read; when its measurements were there is not known, and
    its mirrors turn about the designed axes, where its scenario tells these."""
    write_track(track, tmp_path / "run", BARE)
    table = tmp_path / "run" / "track.parquet"
    columns, about = read_parquet(table)
    later = {"available_s", "surface_approach_m", "surface_range_fades"}
    kept, said = {name: values for name, values in columns.items() if name not in later}, dict(about)
    del said["axes"]
    write_parquet(table, kept, said)
    assert read_track(tmp_path / "run").axes == Axes(0.05)
    old = read_track(tmp_path / "run").records
    assert np.isnan([record.available for record in old]).all()
    assert min(float(record.errors.approach) for record in old) > 1e6
    assert {float(record.errors.range_fades) for record in old} == {1.0}
    for one, record in zip(old, track.records, strict=True):
        np.testing.assert_array_equal(one.position, record.position)
    write_parquet(table, kept, said | {"scenario": "schema: 1"})
    with pytest.raises(InputError, match="axes of the mirrors are not told"):
        read_track(tmp_path / "run")


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
        # Quaternions round their rotation, of which no number exceeds 1: sixteen units in the last place of 1.
        for name in ("rotation", "truth_rotation"):
            np.testing.assert_allclose(getattr(one, name), getattr(two, name), rtol=0.0, atol=16.0 * 2.0**-52)
        # Of a covariance the upper half is written; what rounds both halves apart is a share of both σ.
        for name in ("covariance", "lasting", "common"):
            sigma = np.sqrt(np.diagonal(one.covariance, axis1=1, axis2=2))
            apart = (getattr(one, name) - getattr(two, name)) / (sigma[:, :, None] * sigma[:, None])
            assert np.nanmax(np.abs(apart)) < 1e-12, name
            np.testing.assert_array_equal(np.isnan(getattr(one, name)), np.isnan(getattr(two, name)))
    text = (tmp_path / "run" / "pose.csv").read_text().splitlines()
    assert text[0].startswith("time_s,object,method,x_m,y_m,z_m,qw,qx,qy,qz,cov_tx_tx_m2,")
    assert "cov_tx_rx_m_rad" in text[0]
    assert text[0].endswith("common_cov_rz_rz_rad2")
    assert "cov_rz_rz_rad2,status,chi2,dof,targets,truth_x_m" in text[0]
    table = tmp_path / "run" / "pose.parquet"
    columns, about = read_parquet(table)
    earlier = {name: values for name, values in columns.items() if not name.startswith("common_")}
    write_parquet(table, earlier, about)
    assert all(np.isnan(one.common).all() and not np.isnan(one.lasting).all() for one in read_poses(table))


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
    plain = {
        "target",
        "state",
        "next_state",
        "status",
        "visit",
        "refusal",
        "dwell_place",
        "dwell_step",
        "surface_range_fades",
        "offset_theta",
        "offset_phi",
    }
    ends = ("_s", "_m", "_rad", "_rad2", "_m2", "_rad_m", "_pixel")
    assert all(name.endswith(ends) for name in track_columns(track).keys() - plain)


@pytest.mark.parametrize(
    ("visits", "targets", "whole"),
    [([0, 1, 4], "aab", True), ([0, 1, 1], "aab", False), ([-1, 0, 1], "aab", False), ([0, 2, 1], "aab", False),
     ([0, 1, 2], "aac", False)],
)  # fmt: skip
def test_visits_are_numbered_upwards_and_go_to_targets(visits: list[int], targets: str, whole: bool) -> None:
    columns = dict.fromkeys((*_SIGMAS, *_ANGULAR, *_SPATIAL, *ERRORS), np.zeros(3))
    columns |= {"visit": np.array(visits), "target": np.array(list(targets)), "status": np.zeros(3)}
    if whole:
        _check_order(columns, None, {"a", "b"})
    else:
        with pytest.raises(ValueError, match=r"order|no target"):
            _check_order(columns, None, {"a", "b"})


@pytest.mark.parametrize("poses", [np.eye(4)[None], np.full((2, 4, 4), math.nan), np.zeros((2, 3, 4))])
def test_true_poses_are_finite_pairs_of_matrices(poses: Any) -> None:
    """Claim: what is stored comes back as text, of each object to the last bit; one matrix, numbers that are none and
    matrices of another shape are refused."""
    rng = np.random.default_rng(6)
    good = TruePoses((0.1, 1.0 / 3.0), {name: rng.normal(size=(2, 4, 4)) for name in ("node", "arm")})
    again = TruePoses.of_plain(json.loads(json.dumps(good.plain())))
    assert again.time == good.time
    assert list(again.scanner_from_object) == ["node", "arm"]
    for name, pose in good.scanner_from_object.items():
        np.testing.assert_array_equal(again.scanner_from_object[name], pose)
    with pytest.raises(ValueError, match="no pair of matrices"):
        TruePoses.of_plain({"time_s": [0.0, 1.0], "scanner_from_object": {"node": poses.tolist()}})


@pytest.mark.parametrize(
    ("visits", "codes", "words"),
    [
        ([0, 0, 3], [0, max(Status), 1], ""),
        ([0, 3, 0], [0, 0, 0], "voxels are not in the order of their visits"),
        ([0, 0, 3], [0, -1, 0], "voxels have a status that there is not"),
        ([0, 0, 3], [0, 0, max(Status) + 1], "voxels have a status that there is not"),
    ],
)
def test_voxels_go_by_their_visits_and_have_a_status(visits: list[int], codes: list[int], words: str) -> None:
    columns = dict.fromkeys((*_SIGMAS, *_ANGULAR, *_SPATIAL, *ERRORS), np.zeros(2))
    columns |= {"visit": np.array([0, 3]), "target": np.array(["a", "a"]), "status": np.zeros(2)}
    voxels: Any = {"visit": np.array(visits), "status": np.array(codes)}
    if not words:
        _check_order(columns, voxels, {"a"})
        return
    with pytest.raises(ValueError, match=words):
        _check_order(columns, voxels, {"a"})


@pytest.mark.parametrize("name", [_SIGMAS[0], _ANGULAR[2], _SPATIAL[1], ERRORS[0]])
@pytest.mark.parametrize(("status", "held"), [(TrackStatus.MEASURED, False), (TrackStatus.REFUSED, True)])
def test_what_was_measured_has_numbers(name: str, status: TrackStatus, held: bool) -> None:
    """Claim: of a target that was measured each number is of some sense; of what was refused it need not be."""
    columns = dict.fromkeys((*_SIGMAS, *_ANGULAR, *_SPATIAL, *ERRORS), np.zeros(2))
    columns |= {
        "visit": np.array([0, 3]),
        "target": np.array(["a", "a"]),
        "status": np.array([0, int(status)]),
    }
    for number in (math.nan, 1e300):
        told = columns | {name: np.array([0.0, number])}
        if held:
            _check_order(told, None, {"a"})
        else:
            with pytest.raises(ValueError, match="no number of any sense"):
                _check_order(told, None, {"a"})


def test_pictures_of_a_run_are_drawn_of_what_they_show(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: each under its name, of the run, its visit, its poses and what lies behind it, to the path that is given;
    those of poses, and of a visit that tells something, only where there is one."""
    drawn: list[tuple[Any, ...]] = []
    for name in ("draw_pattern", "draw_track", "draw_field", "draw_poses", "draw_outlines"):
        monkeypatch.setattr(track_folder, name, lambda *given, name=name: drawn.append((name, *given)))
    made: Any = "track"
    given: Any = {"poses": ["pose"], "backdrop": "behind", "rim": "rim"}
    monkeypatch.setattr(track_folder, "telling_visit", lambda track: f"visit of {track}")
    for name, draw in track_folder.pictures_of(made, **given).items():
        draw(Path(name))
    assert drawn == [
        ("draw_pattern", "track", "visit of track", Path("pattern.png"), "rim"),
        ("draw_track", "track", Path("track.png")),
        ("draw_field", "track", Path("field.png"), "behind"),
        ("draw_poses", ["pose"], Path("pose.png")),
        ("draw_outlines", "track", ["pose"], Path("outline.png")),
    ]
    monkeypatch.setattr(track_folder, "telling_visit", lambda track: None)
    assert list(track_folder.pictures_of(made)) == ["track.png", "field.png"]
    # Visits are counted from 0.
    monkeypatch.setattr(track_folder, "telling_visit", lambda track: 0)
    assert list(track_folder.pictures_of(made)) == ["pattern.png", "track.png", "field.png"]


@pytest.mark.parametrize("where", ["expected_rad_rad_m", "centre_on_object_m"])
@pytest.mark.parametrize("away", [1e9, -1e9])
def test_a_table_whose_target_lies_nowhere_is_refused(
    track: Track, tmp_path: Path, where: str, away: float
) -> None:
    """Claim: no coordinate is as far off as 1e9, to either side; a little less is read."""
    write_track(track, tmp_path / "run", BARE)
    table = tmp_path / "run" / "track.parquet"
    columns, said = read_parquet(table)
    about: Any = said
    targets = about["targets"]
    targets[1][where][2] = 0.999 * away
    write_parquet(table, columns, about)
    read_track(tmp_path / "run")
    targets[1][where][2] = away
    write_parquet(table, columns, about)
    with pytest.raises(InputError, match="a target lies nowhere"):
        read_track(tmp_path / "run")
    targets[1][where][2] = 1.0
    about["axes"]["offset_m"] = away
    write_parquet(table, columns, about)
    with pytest.raises(InputError, match="the mirrors turn about nothing"):
        read_track(tmp_path / "run")
