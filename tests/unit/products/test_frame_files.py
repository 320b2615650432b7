"""Frames as files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.foundation.errors import InputError, RunError
from scanner_sim.pose.series import PoseSeries
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.files import frame_files
from scanner_sim.products.files.contents import FRAMES, TRACK
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
    u, v = interior.centre
    assert told["opencv"]["camera_matrix"] == [
        [interior.scale, 0.0, u],
        [0.0, interior.scale, v],
        [0.0, 0.0, 1.0],
    ]
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
    with pytest.raises(RunError, match="file: File exists"):
        write_frames(frames(), VideoCamera(), tmp_path / "file")


def test_a_picture_that_cannot_be_written_is_told_in_the_words_of_its_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(picture: Image.Image, path: Path) -> None:
        raise OSError("encoder error -2 when writing image file")

    monkeypatch.setattr(Image.Image, "save", failing)
    with pytest.raises(RunError, match=r"cannot be written to .*: encoder error -2 when writing image file"):
        write_frames(frames(), VideoCamera(), tmp_path / "new")


def test_grey_levels_begin_at_black_and_end_at_the_largest_number() -> None:
    sensor = VideoCamera(sensor={"bits": 8, "black_level": 10}).sensor
    grey = shown(np.array([[0, 10, 255]], dtype=np.uint16), sensor)
    assert grey.tolist() == [[0, 0, 255]]
    middle = shown(np.array([[132]], dtype=np.uint16), sensor)[0, 0]
    assert middle == round(255 * (122 / 245) ** (1 / 2.2))


def test_the_document_says_what_another_program_needs(tmp_path: Path) -> None:
    """Claim: pixels of points before the camera by its matrix and distortion are OpenCV's, and the interior's; each
    frame has its own begin, exposure and delay, saturated pixels and noise; poses are a place and a turn about an axis,
    or a status alone; dots have all of their covariance; the mount stands as it is believed.
    """
    made = frames()
    made = replace(
        made,
        time_s=np.array([0.5, 0.75]),
        exposure_s=np.array([2e-3, 3e-3]),
        available_s=np.array([0.6, 0.85]),
        noise_share=np.array([0.25, 0.125]),
        saturated=np.arange(96).reshape(2, 6, 8) < 7,
    )
    camera = VideoCamera(
        interior={
            "k1": -0.1,
            "k2": 0.05,
            "k3": 0.01,
            "p1": 2e-3,
            "p2": -1e-3,
            "principal_point": [300.5, 250.25],
        },
        mount={"position": [0.1, -0.2, 0.3]},
    )
    turn = Rotation.from_rotvec([0.1, -0.2, 0.3])
    series = PoseSeries(
        "panel", "", "camera", made.time_s, np.array([[1.0, 2.0, 5.0], [np.nan] * 3]),
        np.stack([turn.as_matrix(), np.full((3, 3), np.nan)]), np.zeros((2, 6, 6)), np.zeros(2),
        np.zeros(2, np.int64), np.zeros(2, np.int64),
        np.array([PoseStatus.VALID, PoseStatus.HIDDEN], dtype=np.int8), np.zeros((2, 3)), np.zeros((2, 3, 3)),
        *np.zeros((2, 2, 6, 6)),
    )  # fmt: skip
    kept = KeptFrames(camera, tmp_path)
    for frame in one_by_one(made):
        dots = two_dots(DotStatus.SATURATED)
        dots.covariance[0] = [[4e-4, 1e-4], [1e-4, 9e-4]]
        kept.keep(frame, [dots])
    beside = replace(series, relative_to="other")
    writers = kept.writers([beside, replace(series, method="joint"), series], pictures=False)
    for name in ("frames.json", "dots.csv"):
        writers[name](tmp_path / name)
    told = json.loads((tmp_path / "frames.json").read_text(encoding="utf-8"))
    points = np.array([[0.3, -0.2, 2.0], [-0.4, 0.1, 3.0]])
    matrix, lens = (np.array(told["opencv"][name]) for name in ("camera_matrix", "distortion"))
    pixels, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, lens)
    np.testing.assert_allclose(camera.interior.project(points), pixels[:, 0], atol=1e-9)
    assert matrix[:2, 2].tolist() == [300.5, 250.25]
    np.testing.assert_allclose(np.array(told["scanner_from_camera"])[:3, 3], [0.1, -0.2, 0.3])
    wanted = (
        ("time_s", [0.5, 0.75]), ("exposure_s", [2e-3, 3e-3]), ("available_s", [0.6, 0.85]),
        ("noise_share", [0.25, 0.125]), ("saturated_pixels", [7, 0]),
    )  # fmt: skip
    for name, values in wanted:
        assert [one[name] for one in told["frames"]] == values
    first, second = (one["poses"]["panel"] for one in told["frames"])
    assert (first["status"], first["position_m"]) == ("VALID", [1.0, 2.0, 5.0])
    assert first["rotation_vector_rad"] == pytest.approx([0.1, -0.2, 0.3])
    assert second == {"status": "HIDDEN"}
    lines = (tmp_path / "dots.csv").read_text(encoding="utf-8").splitlines()
    assert lines[1] == "0,0.5,panel/1,VALID,3.5,2.25,0.0004,0.0001,0.0009"


@pytest.mark.parametrize(("found", "best"), [((1, 2, 2, 0), 1), ((2, 1, 2, 1), 0), ((0, 1, 2, 3), 3)])
def test_the_frame_with_most_dots_is_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, found: tuple[int, ...], best: int
) -> None:
    """Claim: the first of those in which most dots were found, with its own dots and time; none without pictures. Poses
    are the camera's before the scanner, one for each object, frame by frame."""
    made = frames()
    one = np.ones(4)
    four = replace(
        made, counts=np.repeat(made.counts, 2, axis=0), time_s=0.1 * np.arange(4.0),
        saturated=np.zeros((4, 6, 8), bool), exposure_s=one, available_s=one, noise_share=one,
    )  # fmt: skip
    kept = KeptFrames(VideoCamera(), tmp_path)
    dots = []
    for frame, count in zip(one_by_one(four), found, strict=True):
        codes = np.where(np.arange(3) < count, DotStatus.VALID, DotStatus.NOT_FOUND).astype(np.int8)
        dots.append((SimpleNamespace(status=codes),))
        kept.keep(frame, dots[-1])  # type: ignore[arg-type]
    told: list[Any] = []
    monkeypatch.setattr(frame_files, "shown", lambda counts, sensor: counts)
    monkeypatch.setattr(frame_files, "draw_frame", lambda *given: told.append(given))
    monkeypatch.setattr(frame_files, "_pose", lambda one, number: f"{one.name} {number}")
    monkeypatch.setattr(frame_files, "write_text", lambda path, text: told.append(text))
    monkeypatch.setattr(frame_files, "_document", lambda camera, rows, notes: [row["poses"] for row in rows])
    poses: list[Any] = [
        SimpleNamespace(name=name, method=method, relative_to=other)
        for name, method, other in (
            ("u", "camera", ""),
            ("v", "joint", ""),
            ("w", "camera", "u"),
            ("x", "camera", ""),
        )
    ]
    writers = kept.writers(poses, pictures=True)
    writers["frames.png"](tmp_path / "to")
    ((counts, own, words, path),) = told
    np.testing.assert_array_equal(counts, four.counts[best])
    assert own is not None
    assert own == dots[best]
    assert (words, path) == (f"frame_{best:05d}.png, at {0.1 * best:.4f} s", tmp_path / "to")
    writers[FRAMES](tmp_path / "document")
    assert told[1] == [{"u": f"u {number}", "x": f"x {number}"} for number in range(4)]
    assert "frames.png" not in kept.writers(poses, pictures=False)
