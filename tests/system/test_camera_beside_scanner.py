"""``pose.methods: [camera, …]``: camera and scanner at once, from one scenario to tables and summary."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from scanner_sim.cli import app
from scanner_sim.pose.beside import beside_camera
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.pose import read_poses

SHIPPED = Path(__file__).parents[2] / "configs" / "camera_and_scanner.yaml"
pytestmark = pytest.mark.usefixtures("device")


def ran(folder: Path, *changes: str) -> str:
    """Run the shipped scenario with changes; return what was printed."""
    options = [word for change in changes for word in ("--set", change)]
    result = CliRunner().invoke(app, ["run", str(SHIPPED), "-o", str(folder), "--device", "cpu", *options])
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.mark.slow
def test_both_pose_series_agree_with_the_truth_and_with_each_other(tmp_path: Path) -> None:
    """Claim: all frames and all but the first rounds have a pose; errors and differences are within their σ.

    Set-up: the shipped scenario for half a second, three frames and twelve rounds of visits. Expected: each component
    of error and difference below 4.9 σ, a level of 4e-4 for the some 400 numbers together.
    """
    printed = ran(tmp_path, "scan.duration=0.5 s")
    poses = {one.method: one for one in read_poses(tmp_path / "pose.parquet")}
    assert list(poses) == ["camera", "uv", "xyz", "joint", "combined"]
    camera = poses["camera"]
    assert len(camera.time) == 3
    assert (camera.status == PoseStatus.VALID).all()
    assert (camera.targets == 4).all()
    assert np.abs(camera.error / camera.sigma).max() < 4.9
    both = poses["combined"]
    assert len(both.time) >= 6
    assert np.abs(both.error / both.sigma).max() < 4.9
    alone = poses["joint"].sigma[np.isin(poses["joint"].time, both.time)]
    assert (both.sigma < alone).all()
    between = list(beside_camera(tuple(poses.values())))
    assert [one.scanner.method for one in between] == ["uv", "xyz", "joint"]
    assert all(len(one.time) >= 6 for one in between)
    assert all(np.abs(one.difference / one.sigma).max() < 4.9 for one in between)
    said = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))["scanner_less_camera"]
    assert [one["method"] for one in said] == ["uv", "xyz", "joint"]
    assert said[2]["compared"] == len(between[2].time)
    over = np.sqrt(np.mean((between[2].difference / between[2].sigma) ** 2, axis=0))
    np.testing.assert_allclose(list(said[2]["rms_difference_over_sigma"].values()), over, rtol=1e-9)
    assert "scanner less camera" in printed
    assert {"pose.png", "outline.png"} <= {path.name for path in tmp_path.iterdir()}


@pytest.mark.slow
def test_where_no_dots_are_found_frames_have_their_status(tmp_path: Path) -> None:
    """Claim: with the Sun behind the panel the camera has no pose, and the scanner has all of its own."""
    ran(tmp_path, "scan.duration=0.25 s", "lighting.sun.direction=[0.3, -0.2, 0.9]", "output.pictures=false",
        "camera.sampling={}")  # fmt: skip
    poses = {one.method: one for one in read_poses(tmp_path / "pose.parquet")}
    assert (poses["camera"].status == PoseStatus.HIDDEN).all()
    assert np.isnan(poses["camera"].position).all()
    assert (poses["joint"].status == PoseStatus.VALID).any()
    summary = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert {one["compared"] for one in summary["scanner_less_camera"]} == {0}
