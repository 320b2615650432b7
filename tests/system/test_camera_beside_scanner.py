"""``pose.methods: [camera, …]``: camera and scanner at once, from one scenario to tables and summary."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from scanner_sim.cli import app
from scanner_sim.pose.beside import beside_camera
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.transforms import rotation_from_vector
from scanner_sim.products.pose import read_poses

SHIPPED = Path(__file__).parents[2] / "configs" / "camera_and_scanner.yaml"
PLAN = """\
schema: 1
base: {base}
set:
  scan.duration: 60 ms
  pose.methods: [camera]
  camera.interior: {{columns: 160, rows: 120, pixel_pitch: 40 um}}
  camera.sampling: {{}}
  camera.exposure.shortest: 4 us
  scene.objects.panel.array: {{diameter: 200 mm, plate: 400 mm, rows: 2, columns: 2, spacing: [0.6 m, 0.6 m]}}
  output: {{frames: true, pictures: false}}
repeat: 2
keep: {{runs: [1]}}
measure: [camera_status, camera_t_x]
"""
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

    Set-up: the shipped scenario for half a second, three frames, of which edges have the usual number of paths, and
    twelve rounds of visits. Expected: each component of error and difference below 4.9 σ, a level of 4e-4 for the some
    400 numbers together.
    """
    printed = ran(tmp_path, "scan.duration=0.5 s", "camera.sampling={}")
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
    # Angles alone may leave a second pose possible, as chance has it: such poses are not compared.
    valid = {name: pose.time[pose.status == PoseStatus.VALID] for name, pose in poses.items()}
    assert [len(one.time) for one in between] == [
        np.isin(both.time, valid[one.scanner.method]).sum() for one in between
    ]
    assert all(len(one.time) >= 6 for one in between[1:])
    assert all((np.abs(one.difference / one.sigma) < 4.9).all() for one in between)
    said = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))["scanner_less_camera"]
    assert [one["method"] for one in said] == ["uv", "xyz", "joint"]
    assert said[2]["compared"] == len(between[2].time)
    over = np.sqrt(np.mean((between[2].difference / between[2].sigma) ** 2, axis=0))
    np.testing.assert_allclose(list(said[2]["rms_difference_over_sigma"].values()), over, rtol=1e-9)
    assert "scanner less camera" in printed
    assert {"pose.png", "outline.png"} <= {path.name for path in tmp_path.iterdir()}


@pytest.mark.slow
def test_frames_are_written_as_the_poses_were_made_of_them(tmp_path: Path) -> None:
    """Claim: OpenCV reads the frames, and from them, the dots' table and the camera as told it finds the run's pose.

    Set-up: two frames of 320 × 240 pixels. Tolerance: a tenth of a pixel at 5 m, for the centres of ellipses, which
    OpenCV takes for those of discs.
    """
    ran(
        tmp_path, "scan.duration=0.2 s", "output.frames=true", "camera.frame_rate=10 Hz",
        "camera.interior={columns: 320, rows: 240, pixel_pitch: 20 um, k1: -0.1}", "camera.exposure.longest=50 ms",
        "camera.sampling={}", "output.pictures=false",
    )  # fmt: skip
    told = json.loads((tmp_path / "frames.json").read_text(encoding="utf-8"))
    assert [one["file"] for one in told["frames"]] == ["frame_00000.png", "frame_00001.png"]
    assert all(one["poses"]["panel"]["status"] == "VALID" for one in told["frames"])
    counts = cv2.imread(str(tmp_path / "frame_00001.png"), cv2.IMREAD_UNCHANGED)
    assert counts.dtype == np.uint16
    assert counts.shape == (240, 320)
    with open(tmp_path / "dots.csv", encoding="utf-8", newline="") as file:
        lines = [line for line in csv.DictReader(file) if line["frame"] == "1"]
    assert [line["target"] for line in lines] == [f"panel/{number}" for number in (1, 2, 3, 4)]
    centres = np.array([[float(line["u_px"]), float(line["v_px"])] for line in lines])
    dark = counts[tuple(np.rint(centres).astype(int).T[::-1])]
    assert dark.max() < 0.5 * np.quantile(counts, 0.99)
    corners = 0.3 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    matrix, lens = (np.array(told["opencv"][name]) for name in ("camera_matrix", "distortion"))
    _, turn, place = cv2.solvePnP(corners, centres, matrix, lens, flags=cv2.SOLVEPNP_SQPNP)
    turn, place = cv2.solvePnPRefineLM(corners, centres, matrix, lens, turn, place)
    mount = np.array(told["scanner_from_camera"])
    found = mount[:3, :3] @ place[:, 0] + mount[:3, 3]
    pose = told["frames"][1]["poses"]["panel"]
    np.testing.assert_allclose(found, pose["position_m"], atol=0.1 * 5.0 * 20e-6 / 12e-3 * 10.0)
    there = rotation_from_vector(np.array(pose["rotation_vector_rad"]))
    np.testing.assert_allclose(mount[:3, :3] @ cv2.Rodrigues(turn)[0], there, atol=0.01)
    assert not (tmp_path / "frames.png").exists()
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


@pytest.mark.slow
def test_kept_runs_of_a_campaign_have_their_frames(tmp_path: Path) -> None:
    """Claim: with ``output.frames`` runs that are kept have their frames, and all of them the light of whole frames.

    Set-up: two runs, of which the second is kept, and is then done again by itself: the same frames to the byte, and
    the same pose; of frames in windows it would be another one.
    """
    (tmp_path / "plan.yaml").write_text(PLAN.format(base=SHIPPED), encoding="utf-8")
    folder = tmp_path / "out"

    def done(*words: str) -> str:
        result = CliRunner().invoke(app, ["campaign", *words])
        assert result.exit_code == 0, result.output
        return result.stdout

    done(str(tmp_path / "plan.yaml"), "-o", str(folder), "--workers", "0", "--device", "cpu", "-q")
    assert [path.name for path in (folder / "runs").iterdir()] == ["000001"]
    kept = folder / "runs" / "000001"
    told = json.loads((kept / "frames.json").read_text(encoding="utf-8"))
    assert [one["poses"]["panel"]["status"] for one in told["frames"]] == ["VALID"]
    assert "the same numbers" in done("rerun", str(folder), "--run", "1", "--device", "cpu")
    for name in ("frame_00000.png", "dots.csv", "frames.json", "pose.csv"):
        assert (folder / "again" / "000001" / name).read_bytes() == (kept / name).read_bytes(), name


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
