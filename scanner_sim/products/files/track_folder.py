"""The folder of a tracking run: tables, summary and pictures, written whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scanner_sim.pose.series import PoseSeries
from scanner_sim.products.files.contents import TABLE, TRACK, VOXELS
from scanner_sim.products.files.folder import write_folder, write_text
from scanner_sim.products.files.frame_files import KeptFrames
from scanner_sim.products.files.tables import table_csv, write_parquet
from scanner_sim.products.formats.writers import format_writers
from scanner_sim.products.image import RangeImage
from scanner_sim.products.pictures.pattern import draw_pattern, telling_visit
from scanner_sim.products.pictures.pose import draw_outlines, draw_poses
from scanner_sim.products.pictures.track import draw_field, draw_track
from scanner_sim.products.pose import about_poses, pose_columns
from scanner_sim.products.settings import Output
from scanner_sim.products.track import about_track, track_columns, voxel_columns
from scanner_sim.products.track_summary import track_json
from scanner_sim.tracking.record import PatternRecord, Track


def write_track(
    track: Track,
    folder: str | Path,
    output: Output | None = None,
    *,
    poses: Sequence[PoseSeries] = (),
    backdrop: RangeImage | None = None,
    rim: Callable[[PatternRecord], NDArray[np.float64]] | None = None,
    frames: KeptFrames | None = None,
    overwrite: bool = False,
) -> tuple[Path, ...]:
    """Write all files of a tracking run, as :func:`scanner_sim.products.files.folder.write_folder` does.

    Parameters
    ----------
    track
        The run.
    folder
        Where to write; made where it is missing, with its parents.
    output
        Which files; by default all.
    poses
        What :func:`scanner_sim.instrument.closed_loop.poses.poses_of` made of it; tables and pictures of poses only
        where there are some.
    backdrop
        A range image of the scene to be drawn behind the targets.
    rim
        Gives the true outline of a visit's target: :func:`scanner_sim.instrument.closed_loop.poses.rims_of`. None draws
        a circle.
    frames
        What the video camera saw; None writes none.
    overwrite
        Replace an existing result.

    Returns
    -------
    tuple of Path
        The files written.

    Raises
    ------
    InputError, RunError
        As there.
    """
    output = output or Output()
    columns, about = track_columns(track), about_track(track)
    writers: dict[str, Callable[[Path], None]] = {
        "track.csv": lambda path: write_text(path, table_csv(columns)),
        TABLE: lambda path: write_parquet(path, columns, about),
    }
    if output.patterns:
        writers[VOXELS] = lambda path: write_parquet(
            path, voxel_columns(track), {"software": track.made_by, "seed": track.seed}
        )
    writers["scenario.yaml"] = lambda path: write_text(path, track.scenario_yaml)
    writers["summary.json"] = lambda path: write_text(path, track_json(track, poses))
    for name, chosen in _kinds_of_poses(poses).items():
        _add_poses(writers, name, chosen, track.made_by)
    if output.pictures:
        writers |= pictures_of(track, poses, backdrop, rim)
    if frames is not None:
        writers |= frames.writers(poses, pictures=output.pictures)
    writers |= format_writers(track, output.formats, poses)
    return write_folder(folder, TRACK, writers, overwrite=overwrite)


def pictures_of(
    track: Track,
    poses: Sequence[PoseSeries] = (),
    backdrop: RangeImage | None = None,
    rim: Callable[[PatternRecord], NDArray[np.float64]] | None = None,
) -> dict[str, Callable[[Path], None]]:
    """Return for each picture of a run its name, and what draws it to a path; arguments as :func:`write_track`."""
    # Matplotlib takes long to load: only where pictures are wanted.
    pictures: dict[str, Callable[[Path], None]] = {}
    visit = telling_visit(track)
    if visit is not None:
        pictures["pattern.png"] = lambda path: draw_pattern(track, visit, path, rim)
    pictures["track.png"] = lambda path: draw_track(track, path)
    pictures["field.png"] = lambda path: draw_field(track, path, backdrop)
    if poses:
        pictures["pose.png"] = lambda path: draw_poses(poses, path)
        pictures["outline.png"] = lambda path: draw_outlines(track, poses, path)
    return pictures


def _kinds_of_poses(poses: Sequence[PoseSeries]) -> dict[str, list[PoseSeries]]:
    """Return the poses before the scanner and those of one object seen from another, where there are some."""
    kinds = {
        "pose": [one for one in poses if not one.relative_to],
        "relative_pose": [one for one in poses if one.relative_to],
    }
    return {name: chosen for name, chosen in kinds.items() if chosen}


def _add_poses(
    writers: dict[str, Callable[[Path], None]], name: str, chosen: Sequence[PoseSeries], software: str
) -> None:
    columns, about = pose_columns(chosen), about_poses(chosen, software)
    writers[f"{name}.csv"] = lambda path: write_text(path, table_csv(columns))
    writers[f"{name}.parquet"] = lambda path: write_parquet(path, columns, about)
