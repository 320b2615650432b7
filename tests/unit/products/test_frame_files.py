"""Frames as files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.foundation.errors import RunError
from scanner_sim.products.files.frame_files import write_frames
from scanner_sim.products.frames import Frames, FrameTruth, shown


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
