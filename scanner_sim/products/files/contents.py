"""The files of each kind of result, by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from scanner_sim.foundation.channels import CHANNELS
from scanner_sim.products.files.folder import ResultFolder
from scanner_sim.products.settings import Output

FORMAT_FILES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "laz": ("points.laz",),
        "las": ("points.las",),
        "e57": ("points.e57",),
        "pcd": ("points.pcd",),
        "pcd_ascii": ("points_ascii.pcd",),
        "rosbag2": ("metadata.yaml", "points.mcap"),
    }
)
"""Formats of other programs by the words of ``output.formats``, and the files of each; a folder with those of rosbag2
is a bag."""

_CONVERTED = tuple(name for files in FORMAT_FILES.values() for name in files)

_DRAWN = tuple((channel, picture) for channel in CHANNELS for picture in channel.pictures)

PICTURES = tuple(
    picture.file for channel, picture in _DRAWN if not channel.rangefinders and not picture.sunlit
)

FILES = ("range.exr", "scenario.yaml", "summary.json", *PICTURES, "points.ply")
"""Every file that a run in the dark may write, whatever its rangefinders."""

TIMED_PICTURES = tuple(
    picture.file for _, picture in _DRAWN if picture.file not in PICTURES and not picture.sunlit
)
"""Pictures that a run adds by its rangefinders."""

LIT_PICTURES = (*(picture.file for _, picture in _DRAWN if picture.sunlit), "camera.png")
"""Pictures that a run adds where the Sun shines."""

LINES, WAVEFORMS = "lines.parquet", "waveforms.parquet"
"""Lines of the position sensor and waveforms of time of flight, where the scenario asks for some."""

CALIBRATION = "believed.yaml"
"""The calibration that the instrument believed, where the scenario gives one."""

PAGE = "view.html"
"""The page of a result, which `view` writes beside it."""

_MADE = (*FILES, CALIBRATION, *TIMED_PICTURES, *LIT_PICTURES, *_CONVERTED, LINES, WAVEFORMS)

RUN = ResultFolder("range.exr", (*_MADE, PAGE), drawn=r"(voxel|waveform)_\d+_\d+\.png")
"""The folder of a run."""

SIGNALS = ResultFolder("scenario.yaml", ("scenario.yaml", LINES, WAVEFORMS))
"""The folder of some lines and waveforms that were processed again."""

SHOT_TABLE = "shots.parquet"

SHOT_FILES = (
    SHOT_TABLE,
    "shots.csv",
    "scenario.yaml",
    "summary.json",
    "range.png",
    "status.png",
    "points.ply",
)
"""Files that a scan without rows may write, in the dark."""

SHOTS = ResultFolder(SHOT_TABLE, (*SHOT_FILES, CALIBRATION, "camera.png", *_CONVERTED, PAGE))
"""The folder of a scan without rows."""

TABLE, VOXELS = "track.parquet", "patterns.parquet"

TABLES = ("track.csv", TABLE, VOXELS, "scenario.yaml", "summary.json")
"""Files of every tracking run."""

TRACK_PICTURES = ("pattern.png", "track.png", "field.png")
"""Pictures of a tracking run."""

POSES = ("pose.csv", "pose.parquet")
"""Tables where an object has targets enough for a pose."""

RELATIVE_POSES = ("relative_pose.csv", "relative_pose.parquet")
"""Tables where there are two such objects."""

POSE_PICTURES = ("pose.png", "outline.png")
"""Pictures of poses."""

FRAMES, DOTS, FRAME_PICTURE = "frames.json", "dots.csv", "frames.png"
"""The camera as it is believed with times and exposures; dots of the frames; one frame with them as a picture."""

TRACK = ResultFolder(
    "track.csv",
    (
        *TABLES,
        *POSES,
        *RELATIVE_POSES,
        *TRACK_PICTURES,
        *POSE_PICTURES,
        FRAMES,
        DOTS,
        FRAME_PICTURE,
        *_CONVERTED,
        PAGE,
    ),
    drawn=r"(pattern_\d+|frame_\d{5,})\.png",
)
"""The folder of a tracking run."""

BUDGET = ResultFolder(
    "budget.json",
    (
        "budget.json",
        "budget.csv",
        "budget.png",
        "budget_tof.png",
        "curves.png",
        "dominance.png",
        "scenario.yaml",
    ),
)
"""The folder of an error budget."""

ORBIT = ResultFolder("orbit.json", ("orbit.json", "orbit.csv", "orbit.png", "scenario.yaml"))
"""The folder of an orbit."""

COMPARISON = ResultFolder("compare.json", ("compare.json", "compare.html", "compare.png", "scenario.yaml"))
"""The folder of a comparison."""

ACCEPTANCE = ResultFolder(
    "acceptance.json",
    ("acceptance.json", "acceptance.html", "errors.png", "places.png", "deviations.png", "plan.yaml"),
)
"""The folder of an acceptance test."""

DIFFERENCE = ResultFolder("difference.json", ("difference.json", "difference.png"))
"""The folder of two results compared."""

POSE_STUDY = ResultFolder(
    "pose_study.json",
    (
        "pose_study.json",
        "pose_study.csv",
        "exponents.csv",
        "gains.csv",
        "targets.csv",
        "figure_15.png",
        "arrays.png",
        "scenario.yaml",
    ),
)
"""The folder of a pose study."""


def converted_files(formats: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the files of some formats, in the order of the formats."""
    return tuple(name for word in FORMAT_FILES if word in formats for name in FORMAT_FILES[word])


def planned_files(
    output: Output,
    *,
    lit: bool = False,
    rangefinders: Sequence[str] = ("triangulation",),
    calibrated: bool = False,
) -> tuple[str, ...]:
    """Return the names of the files that a run writes, in order; ``lit`` under the Sun, ``calibrated`` by a file."""
    drawn = {
        picture.file
        for channel, picture in _DRAWN
        if set(channel.rangefinders) <= set(rangefinders) and (lit or not picture.sunlit)
    }
    drawn |= {"camera.png"} if lit else set()
    left_out = {*PICTURES, *TIMED_PICTURES, *LIT_PICTURES} - (drawn if output.pictures else set())
    left_out |= set() if output.points else {"points.ply"}
    left_out |= set() if calibrated else {CALIBRATION}
    left_out |= {*_CONVERTED} - {*converted_files(output.formats)}
    kept = {LINES: output.lines, WAVEFORMS: output.waveforms}
    left_out |= {name for name, chosen in kept.items() if chosen == "none"}
    return tuple(name for name in _MADE if name not in left_out)


def planned_shot_files(output: Output, *, lit: bool = False, calibrated: bool = False) -> tuple[str, ...]:
    """Return the names of the files that a scan without rows writes, in the order of presentation."""
    left_out = (() if output.pictures else ("range.png", "status.png")) + (
        () if output.points else ("points.ply",)
    )
    added: tuple[str, ...] = (CALIBRATION,) if calibrated else ()
    added += ("camera.png",) if output.pictures and lit else ()
    added += converted_files(output.formats)
    return tuple(name for name in (*SHOT_FILES, *added) if name not in left_out)


def frame_name(number: int) -> str:
    """Return the name of a frame's file."""
    return f"frame_{number:05d}.png"


def planned_track_files(output: Output, carriers: int, frames: int = 0) -> tuple[str, ...]:
    """Return the names of the files that a tracking run writes, in the order of presentation.

    Parameters
    ----------
    output
        Which files are wanted.
    carriers
        Number of objects that will have poses.
    frames
        Number of frames that the video camera takes.
    """
    tables = (*TABLES, *(POSES if carriers else ()), *(RELATIVE_POSES if carriers > 1 else ()))
    pictures = (*TRACK_PICTURES, *(POSE_PICTURES if carriers else ())) if output.pictures else ()
    kept = (*map(frame_name, range(frames)), FRAMES, DOTS) if output.frames and frames else ()
    kept += (FRAME_PICTURE,) if kept and output.pictures else ()
    named = (*tables, *pictures, *kept, *converted_files(output.formats))
    return tuple(name for name in named if output.patterns or name != VOXELS)
