"""The result that a verb is given: an image, a table of shots, or a tracking run with its poses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from scanner_sim.foundation.errors import InputError
from scanner_sim.pose.series import PoseSeries
from scanner_sim.products.files.contents import POSES, RELATIVE_POSES, RUN, SHOTS, TRACK
from scanner_sim.products.files.exchange import recover
from scanner_sim.products.image import RangeImage
from scanner_sim.products.shots import ShotTable
from scanner_sim.tracking.record import Track


@dataclass(frozen=True)
class FoundResult:
    """A result on the disk: its folder, what it holds, and the poses beside a track."""

    folder: Path
    value: RangeImage | ShotTable | Track
    poses: tuple[PoseSeries, ...] | None = None


def read_result_of(place: Path) -> FoundResult:
    """Return the result in a folder, or of a ``range.exr``.

    Raises
    ------
    InputError
        If there is none, or its files are damaged.
    """
    folder = place if place.is_dir() else place.parent
    recover(folder)
    if place.is_dir() and (place / TRACK.result).exists():
        return _track(place)
    if place.is_dir() and (place / SHOTS.result).exists():
        from scanner_sim.products.files.shots_folder import read_shots

        return FoundResult(folder, read_shots(place))
    from scanner_sim.products.files.exr import read_range_image

    path = place / RUN.result if place.is_dir() else place
    if not path.exists():
        raise InputError(
            f"There is no result {path}.",
            remedy="Name the folder of a run (of a raster, of shots, or of a tracking run), or its range.exr.",
        )
    return FoundResult(folder, read_range_image(path))


def _track(folder: Path) -> FoundResult:
    from scanner_sim.products.pose import read_poses
    from scanner_sim.products.track import read_track

    tables = (folder / name for name in (POSES[1], RELATIVE_POSES[1]))
    poses = tuple(one for path in tables if path.exists() for one in read_poses(path))
    return FoundResult(folder, read_track(folder), poses)
