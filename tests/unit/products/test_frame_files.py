"""Frames as files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.foundation.errors import InputError, RunError
from scanner_sim.products.files.contents import TRACK
from scanner_sim.products.files.exchange import early_files, held
from scanner_sim.products.files.folder import write_folder, write_text
from scanner_sim.products.files.frame_files import KeptFrames, write_frames
from scanner_sim.products.frames import ArrayDots, Frames, FrameTruth, shown
from scanner_sim.signals.dots.settings import DotStatus


def frames() -> Frames:
    counts = np.random.default_rng(1).integers(0, 4096, (2, 6, 8)).astype(np.uint16)
    numbers = np.array([0.1, 0.2])
    zeros = np.zeros(counts.shape, dtype=np.float32)
    truth = FrameTruth(zeros, np.tile(np.eye(4), (2, 1, 1)))
    return Frames(counts, counts == 4095, numbers, numbers, numbers, zeros, numbers, truth, ("a note",))


def test_numbers_come_back_and_nothing_true_is_written(tmp_path: Path) -> None:
    made = frames()
    document, *pictures = write_frames(made, VideoCamera(as_built={"k1": 0.01}), tmp_path / "new")
    for path, counts in zip(pictures, made.counts, strict=True):
        with Image.open(path) as picture:
            np.testing.assert_array_equal(np.asarray(picture), counts)
    told = json.loads(document.read_text(encoding="utf-8"))
    assert [one["file"] for one in told["frames"]] == [path.name for path in pictures]
    assert told["frames"][1]["exposure_s"] == 0.2
    assert told["camera"]["interior"]["focal_length"] == "12 mm"
    assert "as_built" not in told["camera"]
    assert told["notes"] == ["a note"]


def one_by_one(made: Frames) -> list[Frames]:
    """Return frames as a run gives them, one after the other."""
    kept = ("counts", "saturated", "exposure_s", "time_s", "available_s", "sample_sigma", "noise_share")
    parts = []
    for number in range(len(made)):
        values = {name: getattr(made, name)[number : number + 1] for name in kept}
        parts.append(Frames(**values, truth=made.truth, notes=made.notes))
    return parts


def two_dots(status: DotStatus) -> ArrayDots:
    """Return an array of two dots, one of which was found."""
    centre, covariance, shape = np.full((2, 2), np.nan), np.full((2, 2, 2), np.nan), np.full((2, 3), np.nan)
    centre[0], covariance[0], shape[0] = (3.5, 2.25), 1e-4 * np.eye(2), (1.5, 0.0, 1.0)
    codes = np.array([DotStatus.VALID, status], dtype=np.int8)
    return ArrayDots("panel", ("panel/1", "panel/2"), centre, covariance, shape, codes)


def test_frames_of_a_run_come_with_its_other_files_and_leave_nothing_hidden(tmp_path: Path) -> None:
    """Claim: kept frames come into the run's folder with its other files, and go when a later result replaces it."""
    made, folder = frames(), tmp_path / "out"
    with held(folder), early_files(folder) as early:
        kept = KeptFrames(VideoCamera(), early)
        for frame, status in zip(one_by_one(made), (DotStatus.SATURATED, DotStatus.NOT_FOUND), strict=True):
            kept.keep(frame, [two_dots(status)])
        assert not [path for path in folder.iterdir() if not path.name.startswith(".")]
        table = {"track.csv": lambda path: write_text(path, "x\n")}
        write_folder(folder, TRACK, table | kept.writers((), pictures=True))
    names = {path.name for path in folder.iterdir()}
    assert names == {
        "track.csv",
        "frame_00000.png",
        "frame_00001.png",
        "frames.json",
        "dots.csv",
        "frames.png",
    }
    with Image.open(folder / "frame_00001.png") as picture:
        np.testing.assert_array_equal(np.asarray(picture), made.counts[1])
    told = json.loads((folder / "frames.json").read_text(encoding="utf-8"))
    interior = VideoCamera().interior
    assert told["opencv"]["camera_matrix"][0] == [interior.scale, 0.0, interior.centre[0]]
    assert [one["time_s"] for one in told["frames"]] == made.time_s.tolist()
    lines = (folder / "dots.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == "frame,time_s,target,status,u_px,v_px,cov_u_u_px2,cov_u_v_px2,cov_v_v_px2"
    assert lines[2:4] == ["0,0.1,panel/2,SATURATED,,,,,", "1,0.2,panel/1,VALID,3.5,2.25,0.0001,0,0.0001"]
    write_folder(folder, TRACK, table, overwrite=True)
    assert [path.name for path in folder.iterdir()] == ["track.csv"]


def test_a_dead_run_s_frames_go_at_the_next_start(tmp_path: Path) -> None:
    hidden = tmp_path / ".scanner-sim.early"
    hidden.mkdir()
    (hidden / "frame_00000.png").write_bytes(b"")
    with held(tmp_path):
        assert not hidden.exists()


def test_somebody_s_own_frames_are_not_taken_for_a_run_s(tmp_path: Path) -> None:
    (tmp_path / "frame_00000.png").write_bytes(b"mine")
    with pytest.raises(InputError, match="not ours to replace"):
        write_folder(tmp_path, TRACK, {"track.csv": lambda path: write_text(path, "x\n")})
    assert (tmp_path / "frame_00000.png").read_bytes() == b"mine"


def test_a_folder_that_cannot_be_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RunError, match="cannot be written"):
        write_frames(frames(), VideoCamera(), tmp_path / "file")


def test_grey_levels_begin_at_black_and_end_at_the_largest_number() -> None:
    sensor = VideoCamera(sensor={"bits": 8, "black_level": 10}).sensor
    grey = shown(np.array([[0, 10, 255]], dtype=np.uint16), sensor)
    assert grey.tolist() == [[0, 0, 255]]
    middle = shown(np.array([[132]], dtype=np.uint16), sensor)[0, 0]
    assert middle == round(255 * (122 / 245) ** (1 / 2.2))
