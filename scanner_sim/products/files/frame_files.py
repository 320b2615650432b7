"""Frames of the video camera as files: each a PNG of 16 bits with its digital numbers, and documents beside them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.foundation.errors import RunError
from scanner_sim.pose.series import PoseSeries
from scanner_sim.pose.status import PoseStatus
from scanner_sim.pose.transforms import vector_from_rotation
from scanner_sim.products.files.contents import DOTS, FRAME_PICTURE, FRAMES, frame_name
from scanner_sim.products.files.exchange import Writers, early_files, failure, held
from scanner_sim.products.files.folder import write_text
from scanner_sim.products.files.tables import table_csv, texts
from scanner_sim.products.frames import ArrayDots, Frames, shown
from scanner_sim.products.pictures.frame import draw_frame
from scanner_sim.signals.dots.settings import DotStatus


def write_frames(frames: Frames, camera: VideoCamera, folder: Path) -> tuple[Path, ...]:
    """Write frames into a folder, which is made if need be; files of the same names are replaced.

    Parameters
    ----------
    frames
        The frames. Their truth is not written: what is here is what an estimator may see.
    camera
        The camera that took them; what it is as built is left out.
    folder
        Where to.

    Returns
    -------
    tuple
        The files: ``frames.json``, and ``frame_00000.png`` and so on, numbers as they were read, row 0 the top.

    Raises
    ------
    RunError
        If the disk fails.
    """
    rows = [_row(frames, number, frame_name(number)) for number in range(len(frames))]
    names = [row["file"] for row in rows]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, counts in zip(names, frames.counts, strict=True):
            Image.fromarray(counts).save(folder / name)
        (folder / FRAMES).write_text(_document(camera, rows, frames.notes), encoding="utf-8")
    except OSError as error:
        raise RunError(
            f"frames cannot be written to {folder}: {error.strerror or error}.",
            remedy="Make room on the disk, or choose another folder.",
        ) from None
    return (folder / FRAMES, *(folder / name for name in names))


class KeptFrames:
    """Frames of a run, written one after the other as they come; what their tables say is all that stays in memory.

    Parameters
    ----------
    camera
        The camera that takes them.
    folder
        Where they wait until the run's other files are written.
    """

    def __init__(self, camera: VideoCamera, folder: Path) -> None:
        self._camera, self._folder = camera, folder
        self._rows: list[dict[str, Any]] = []
        self._dots: list[tuple[ArrayDots, ...]] = []
        self._notes: tuple[str, ...] = ()
        self._best: tuple[int, Frames] | None = None

    def keep(self, frame: Frames, dots: Sequence[ArrayDots]) -> None:
        """Write one frame, with the dots that were found in it.

        Raises
        ------
        RunError
            If the disk fails.
        """
        number = len(self._rows)
        row = _row(frame, 0, frame_name(number))
        try:
            Image.fromarray(frame.counts[0]).save(self._folder / row["file"])
        except OSError as error:
            raise failure(self._folder.parent, error) from None
        self._rows.append(row)
        self._dots.append(tuple(dots))
        self._notes = frame.notes
        if self._best is None or self._found(number) > self._found(self._best[0]):
            self._best = number, frame

    def _found(self, number: int) -> int:
        """Return how many dots of a frame are valid."""
        return sum(int(np.count_nonzero(one.status == DotStatus.VALID)) for one in self._dots[number])

    def writers(self, poses: Sequence[PoseSeries], *, pictures: bool) -> Writers:
        """Return what writes the files, with the camera's poses among those of a run."""
        seen = [one for one in poses if one.method == "camera" and not one.relative_to]
        for number, row in enumerate(self._rows):
            row["poses"] = {one.name: _pose(one, number) for one in seen}
        made: dict[str, Callable[[Path], None]] = {
            row["file"]: partial(_moved, self._folder / row["file"]) for row in self._rows
        }
        made[FRAMES] = lambda path: write_text(path, _document(self._camera, self._rows, self._notes))
        made[DOTS] = lambda path: write_text(path, _dot_table(self._rows, self._dots))
        if pictures and self._best is not None:
            made[FRAME_PICTURE] = partial(self._draw, *self._best)
        return made

    def _draw(self, number: int, frame: Frames, path: Path) -> None:
        grey = shown(frame.counts[0], self._camera.sensor)
        draw_frame(grey, self._dots[number], f"{frame_name(number)}, at {frame.time_s[0]:.4f} s", path)


@contextmanager
def kept_frames(camera: VideoCamera, folder: Path) -> Iterator[KeptFrames]:
    """Give what keeps the frames of a run until its folder is written, and hold the folder so long."""
    with held(folder), early_files(folder) as waiting:
        yield KeptFrames(camera, waiting)


def _row(frames: Frames, number: int, name: str) -> dict[str, Any]:
    """Return what the document says of a frame."""
    return {
        "file": name,
        "time_s": float(frames.time_s[number]),
        "exposure_s": float(frames.exposure_s[number]),
        "available_s": float(frames.available_s[number]),
        "saturated_pixels": int(np.count_nonzero(frames.saturated[number])),
        "noise_share": float(frames.noise_share[number]),
    }


def _pose(series: PoseSeries, number: int) -> dict[str, Any]:
    """Return what the document says of a pose; nothing but its status where there is none."""
    status = PoseStatus(int(series.status[number]))
    if not np.isfinite(series.position[number]).all():
        return {"status": status.name}
    return {
        "status": status.name,
        "position_m": series.position[number].tolist(),
        "rotation_vector_rad": vector_from_rotation(series.rotation[number]).tolist(),
    }


def _document(camera: VideoCamera, rows: Sequence[dict[str, Any]], notes: Sequence[str]) -> str:
    """Return the camera as it is believed, in a scenario's words and in OpenCV's, with what is said of its frames."""
    interior = camera.interior
    u, v = interior.centre
    document = {
        "camera": camera.model_dump(mode="json", exclude={"as_built"}),
        "opencv": {
            "camera_matrix": [[interior.scale, 0.0, u], [0.0, interior.scale, v], [0.0, 0.0, 1.0]],
            "distortion": [interior.k1, interior.k2, interior.p1, interior.p2, interior.k3],
        },
        "scanner_from_camera": camera.scanner_from_camera.tolist(),
        "frames": list(rows),
        "notes": list(notes),
    }
    return json.dumps(document, indent=1) + "\n"


def _dot_table(rows: Sequence[dict[str, Any]], dots: Sequence[Sequence[ArrayDots]]) -> str:
    """Return a line for each target of each frame."""
    lines = [
        (number, row["time_s"], one, target)
        for number, (row, seen) in enumerate(zip(rows, dots, strict=True))
        for one in seen
        for target in range(len(one.targets))
    ]
    centre = np.array([one.centre[target] for _, _, one, target in lines]).reshape(-1, 2)
    covariance = np.array([one.covariance[target] for _, _, one, target in lines]).reshape(-1, 2, 2)
    return table_csv(
        {
            "frame": np.array([number for number, *_ in lines], dtype=np.int64),
            "time_s": np.array([time for _, time, *_ in lines], dtype=np.float64),
            "target": texts([one.targets[target] for *_, one, target in lines]),
            "status": texts([DotStatus(int(one.status[target])).name for *_, one, target in lines]),
            "u_px": centre[:, 0],
            "v_px": centre[:, 1],
            "cov_u_u_px2": covariance[:, 0, 0],
            "cov_u_v_px2": covariance[:, 0, 1],
            "cov_v_v_px2": covariance[:, 1, 1],
        }
    )


def _moved(source: Path, path: Path) -> None:
    source.replace(path)
