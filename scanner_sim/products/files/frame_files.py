"""Frames of the video camera as files: each a PNG of 16 bits with its digital numbers, and one document beside them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from PIL import Image

from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.foundation.errors import RunError
from scanner_sim.products.frames import Frames

FRAMES = "frames.json"
"""The document: times, exposures, and the camera as it is believed."""


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
    names = [f"frame_{number:05d}.png" for number in range(len(frames))]
    document = {
        "camera": camera.model_dump(mode="json", exclude={"as_built"}),
        "frames": [
            {
                "file": name,
                "time_s": float(frames.time_s[number]),
                "exposure_s": float(frames.exposure_s[number]),
                "available_s": float(frames.available_s[number]),
                "saturated_pixels": int(np.count_nonzero(frames.saturated[number])),
                "noise_share": float(frames.noise_share[number]),
            }
            for number, name in enumerate(names)
        ],
        "notes": list(frames.notes),
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, counts in zip(names, frames.counts, strict=True):
            Image.fromarray(counts).save(folder / name)
        (folder / FRAMES).write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise RunError(
            f"frames cannot be written to {folder}: {error.strerror}.",
            remedy="Make room on the disk, or choose another folder.",
        ) from None
    return (folder / FRAMES, *(folder / name for name in names))
