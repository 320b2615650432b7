"""A scenario that follows targets, through the command line: its files, its pictures, and each pattern again."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from scanner_sim.cli import app
from scanner_sim.cli.plan import plan
from scanner_sim.config import load_scenario
from scanner_sim.instrument.closed_loop.poses import poses_of, rims_of
from scanner_sim.products.files.tables import read_parquet
from scanner_sim.products.pose import read_poses
from scanner_sim.products.track import read_track

pytestmark = pytest.mark.usefixtures("device")

SCENARIO = """\
schema: 1
seed: 4
scene:
  objects:
    - name: node
      array: {diameter: 100 mm, rows: 2, columns: 2, spacing: [1 m, 1 m], plate: 300 mm}
      position: [0 m, 0 m, 8 m]
      rotation: [{axis: y, angle: 20 deg}]
      motion: {type: twist, velocity: [10 mm/s, 0 mm/s, 0 mm/s], turn_rate: [0 deg/s, 1 deg/s, 0 deg/s]}
    - {name: ball, shape: sphere, diameter: 120 mm, position: [0.1 m, 0 m, 7 m], material: {reflectance: 0.6}}
scan: {type: track, duration: 0.3 s, targets: [node, ball]}
"""


def invoke(*words: object) -> Result:
    return CliRunner().invoke(app, list(map(str, words)))


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scenario") / "follow.yaml"
    path.write_text(SCENARIO)
    return path


def ran(config: Path, name: str, *words: str) -> Path:
    path = config.parent / name
    result = invoke("run", config, "-o", path, "--device", "cpu", *words)
    assert result.exit_code == 0, result.output
    for word in ("node/4", "ball", "track.parquet", "joint", "measured"):
        assert word in result.output
    return path


@pytest.fixture(scope="module")
def folder(config: Path) -> Path:
    return ran(config, "run", "--set", "output.pictures=false")


@pytest.fixture(scope="module")
def drawn(config: Path) -> Path:
    """The same run with its pictures, which take longer than all else."""
    return ran(config, "drawn")


@pytest.mark.slow
def test_what_was_planned_is_written(drawn: Path, config: Path) -> None:
    planned = plan(load_scenario(config), drawn)["files"].split(", ")
    assert set(planned) == {path.name for path in drawn.iterdir()}
    assert "pose.csv" in planned
    assert "relative_pose.csv" not in planned
    assert invoke("run", config, "-o", drawn, "--dry-run").exit_code == 2


def test_tables_summary_and_scenario_tell_one_story(folder: Path) -> None:
    track = read_track(folder)
    columns, about = read_parquet(folder / "track.parquet")
    summary = json.loads((folder / "summary.json").read_text())
    assert about["scenario"] == track.scenario_yaml == (folder / "scenario.yaml").read_text()
    assert summary["visits"] == len(track.records) == len(columns["time_s"])
    voxels = read_parquet(folder / "patterns.parquet")[0]
    assert summary["voxels"] == len(voxels["visit"]) == 128 * len(track.records)
    # What is stored of a pattern's voxels is what was measured: within the pattern, at the range of the target.
    record = track.records[-1]
    mine = voxels["visit"] == record.number
    assert np.abs(voxels["theta_rad"][mine] - record.centre[0]).max() < 1.2 * record.amplitude
    assert np.nanmedian(voxels["range_m"][mine]) == pytest.approx(record.truth[2], abs=0.1)


def test_poses_come_out_near_the_truth_and_are_those_of_the_table(folder: Path) -> None:
    stored = read_poses(folder / "pose.parquet")
    assert [(one.name, one.method) for one in stored] == [("node", way) for way in ("uv", "xyz", "joint")]
    for one, again in zip(stored, poses_of(read_track(folder)), strict=True):
        np.testing.assert_allclose(one.position, again.position, rtol=1e-9)
        np.testing.assert_allclose(one.truth_position, again.truth_position, rtol=1e-12)
    joint = stored[-1]
    good = joint.status == 0
    assert np.count_nonzero(good) >= 4
    # A centroid of 100 µrad and 1 mm makes less; a wrong frame, order of targets or instant makes far more.
    assert np.abs(joint.error[good, :3]).max() < 5e-3
    assert np.abs(joint.error[good, 3:]).max() < 5e-3


def test_the_true_outline_of_a_disc_is_seen_under_its_tilt(folder: Path) -> None:
    track = read_track(folder)
    rim = rims_of(track)
    disc = next(record for record in track.records if record.target == "node/1")
    ball = next(record for record in track.records if record.target == "ball")
    wide, tall = np.ptp(rim(disc), axis=0)
    # Turned by 20° about y, seen 3.6° from the axis: narrower by cos of about 20° to 24°.
    assert 0.90 < wide / tall < 0.95
    assert np.ptp(rim(ball), axis=0) == pytest.approx(0.12 / 7.0, rel=0.01)
    assert np.abs(rim(disc)[:-1].mean(axis=0) - disc.truth[:2]).max() < 1e-5


@pytest.mark.slow
def test_show_draws_the_run_again_and_any_pattern(drawn: Path, tmp_path: Path) -> None:
    result = invoke("show", drawn, "-o", tmp_path, "--device", "cpu")
    assert result.exit_code == 0, result.output
    names = {"pattern.png", "track.png", "field.png", "pose.png", "outline.png"}
    assert {path.name for path in tmp_path.iterdir()} == names
    # Simulated and drawn again, the field is the same to the last dot, and so are track and pattern.
    for name in ("field.png", "track.png", "pattern.png"):
        assert (tmp_path / name).read_bytes() == (drawn / name).read_bytes(), name
    result = invoke("show", drawn, "--pattern", 2, "-o", tmp_path)
    assert result.exit_code == 0, result.output
    assert "node/3" in result.output
    assert (tmp_path / "pattern_2.png").stat().st_size > 10_000


def test_what_cannot_be_shown_is_told(folder: Path, config: Path, tmp_path: Path) -> None:
    for words, told in (
        (("show", folder, "--pattern", 9999), "There is no pattern 9999"),
        (("show", folder, "--voxel", 1, 1), "holds a tracking run"),
        (("show", tmp_path, "--pattern", 0), "There is no track.parquet"),
        (("run", config, "-o", folder), "already holds a result"),
    ):
        result = invoke(*words)
        assert result.exit_code == 2
        assert told in result.output, result.output


def test_without_voxels_and_pictures_a_run_still_has_its_tables(config: Path, tmp_path: Path) -> None:
    out = tmp_path / "bare"
    settings = (
        "output.patterns=false",
        "output.pictures=false",
        "pose.methods=[joint]",
        "scan.duration=0.1 s",
    )
    words = [word for setting in settings for word in ("--set", setting)]
    assert invoke("run", config, "-o", out, "--device", "cpu", "-q", *words).exit_code == 0
    names = {"track.csv", "track.parquet", "scenario.yaml", "summary.json", "pose.csv", "pose.parquet"}
    assert {path.name for path in out.iterdir()} == names
    result = invoke("show", out, "--pattern", 1)
    assert result.exit_code == 2
    assert "were not kept: output.patterns was off" in result.output
