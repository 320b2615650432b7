"""A result, in memory or in a folder, written for other programs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from scanner_sim.foundation.errors import InputError, printable
from scanner_sim.foundation.status import Status
from scanner_sim.pose.series import PoseSeries
from scanner_sim.products.files.contents import (
    FORMAT_FILES,
    POSES,
    RELATIVE_POSES,
    RUN,
    SHOTS,
    SIGNALS,
    TRACK,
)
from scanner_sim.products.files.exchange import recover, write_files
from scanner_sim.products.files.exr import read_range_image
from scanner_sim.products.files.shots_folder import read_shots
from scanner_sim.products.formats.cloud import RANGEFINDERS
from scanner_sim.products.formats.scale import check_scale
from scanner_sim.products.formats.writers import Result, Source, check_formats, write_format
from scanner_sim.products.pose import read_poses
from scanner_sim.products.track import read_track
from scanner_sim.tracking.record import Track, TrackStatus

_SUFFIXES = {f".{word}": word for word in FORMAT_FILES if FORMAT_FILES[word] == (f"points.{word}",)}


def convert(
    result: Result | str | Path,
    path: str | Path,
    to: str | Sequence[str] = (),
    *,
    by: str = "",
    poses: Sequence[PoseSeries] = (),
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Path, ...]:
    """Write the points of a result for other programs.

    ``convert(image, "scan.laz")`` writes one file, whose suffix tells the format. ``convert(image, "out", ["laz",
    "rosbag2"])`` writes ``points.laz`` and the files of a bag into a folder.

    Parameters
    ----------
    result
        An image, a table of shots, a track, or the folder of one; also the file ``range.exr`` of an image.
    path
        The file or, with formats, the folder.
    to
        Formats: ``laz``, ``las``, ``e57``, ``pcd``, ``pcd_ascii``, ``rosbag2``.
    by
        Whose points of a scan: ``tof`` or ``fused``, where both rangefinders measured; by default those that every
        result has.
    poses
        Of a track in memory: what :func:`~scanner_sim.instrument.closed_loop.poses.poses_of` made of it, for a bag. A
        folder has its own.
    overwrite
        Replace files that are there.
    progress
        Called with the files written and those in all.

    Returns
    -------
    tuple of Path
        The files.

    Raises
    ------
    InputError
        If there is no such format or result, a library is missing, there is no point to write, coordinates do not fit
        into the format, or a file is there already.
    RunError
        If the disk fails.
    """
    folder, files = _targets(Path(path), [to] if isinstance(to, str) and to else list(to))
    words = {word for word, _ in files.values()}
    if by not in RANGEFINDERS:
        known = ", ".join(word for word in RANGEFINDERS if word)
        raise InputError(f"'{printable(by)}' is no rangefinder.", remedy=f"Possible: {known}.")
    if isinstance(result, str | Path):
        result, poses = result_in(Path(result))
    if by and isinstance(result, Track):
        raise InputError(
            f"a track has one range of each voxel, and none apart by {by}.", remedy="Leave --by out."
        )
    source = Source(result, tuple(poses), by)
    _check(source, words)
    written = 0

    def write(word: str, file: str, to: Path) -> None:
        nonlocal written
        write_format(source, word, file, to)
        written += 1
        if progress is not None:
            progress(written, len(files))

    writers = {name: partial(write, word, file) for name, (word, file) in files.items()}
    return write_files(folder, writers, overwrite=overwrite)


def _targets(path: Path, words: Sequence[str]) -> tuple[Path, dict[str, tuple[str, str]]]:
    """Return the folder, and by the names of the files to write the format of each and its usual name."""
    check_formats(words)
    if words:
        return path, {name: (word, name) for word in words for name in FORMAT_FILES[word]}
    word = path.suffix.lower().removeprefix(".")
    if path.suffix.lower() not in _SUFFIXES:
        raise InputError(
            f"the name of {path} tells no format.",
            remedy=f"End it with {', '.join(_SUFFIXES)}, or name a folder and formats.",
        )
    check_formats([word])
    return path.parent, {path.name: (word, FORMAT_FILES[word][0])}


def result_in(path: Path) -> tuple[Result, tuple[PoseSeries, ...]]:
    """Return the image, table of shots or track of a folder, and the poses beside it.

    Raises
    ------
    InputError
        If there is none, or it is damaged.
    """
    if path.suffix == ".exr":
        return read_range_image(path), ()
    if not path.is_dir():
        problem = f"{path} is no folder." if path.exists() else f"There is no folder {path}."
        raise InputError(problem, remedy="Name the folder of a run, or its range.exr.")
    recover(path)
    if (path / RUN.result).exists():
        return read_range_image(path / RUN.result), ()
    if (path / SHOTS.result).exists():
        return read_shots(path), ()
    if (path / TRACK.result).exists():
        tables = [path / name for name in (POSES[1], RELATIVE_POSES[1]) if (path / name).exists()]
        return read_track(path), tuple(series for table in tables for series in read_poses(table))
    if (path / "campaign.json").exists():
        raise InputError(
            f"{path} holds a campaign.", remedy="Name the folder of one of its runs that were kept, in runs."
        )
    if any((path / name).exists() for name in SIGNALS.files[1:]):
        raise InputError(
            f"{path} holds lines or waveforms of some voxels, which are no points.",
            remedy="Process all voxels again: output.lines: all, with time of flight output.waveforms: all.",
        )
    raise InputError(
        f"{path} holds no result with points.", remedy="Name the folder of a run, or its range.exr."
    )


def _check(source: Source, words: set[str]) -> None:
    """Refuse a result without a point, and coordinates that do not fit."""
    track = source.result if isinstance(source.result, Track) else None
    only_bag = words == {"rosbag2"} and track is not None
    measured = track is not None and any(one.status is TrackStatus.MEASURED for one in track.records)
    lost = track is not None and any(
        not one.samples.time.shape[1] for one in track.records if one.status is not TrackStatus.OUT_OF_VIEW
    )
    if not source.cloud.valid.any() and not (only_bag and measured):
        if others := _elsewhere(source):
            raise InputError(
                f"this result has no point by {source.by or 'triangulation'}: no shot has such a range.",
                remedy=f"Other ranges there are: --by {' or '.join(others)}.",
            )
        raise InputError(
            "this result has no point: "
            + ("no voxel of its patterns was kept or has a range." if track else "no shot has a range."),
            remedy="Keep voxels with output.patterns: true."
            if lost
            else "Its summary.json counts what stood in the way.",
        )
    if words & {"laz", "las"}:
        check_scale(source.cloud)


def _elsewhere(source: Source) -> tuple[str, ...]:
    """Return the words of the rangefinders by which a scan has ranges; none for a track."""
    if isinstance(source.result, Track):
        return ()
    found = {
        word: source.result[f"{prefix}status"]
        for word, prefix in RANGEFINDERS.items()
        if word and f"{prefix}status" in source.result
    }
    return tuple(word for word, status in found.items() if (status == Status.VALID).any())
