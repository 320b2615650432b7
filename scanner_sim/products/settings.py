"""Which files a run writes."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from scanner_sim.foundation.parts import Count, Part, Switch

VoxelChoice = Annotated[
    Annotated[Literal["none", "all"], Tag("(word)")]
    | Annotated[tuple[tuple[Count, Count], ...], Tag("(list)")],
    Discriminator(lambda value: "(word)" if isinstance(value, str) else "(list)"),
    Field(examples=["all"]),
]
"""Voxels whose signals are kept: none, all, or a list of [row, column]."""


class Output(Part):
    """The files of the output folder."""

    pictures: Switch = True
    """Write range.png, shaded.png and signal.png, with time of flight tof.png, and under the Sun background.png and
    camera.png. Of a scan without rows range.png, status.png and camera.png. Of a tracking scan pattern.png, track.png
    and field.png, with poses pose.png and outline.png, with frames frames.png."""
    points: Switch = True
    """Write points.ply."""
    formats: tuple[Literal["laz", "las", "e57", "pcd", "pcd_ascii", "rosbag2"], ...] = Field(
        default=(), examples=[["laz", "e57"]]
    )
    """Write the points for other programs, too: ``laz`` and ``las`` (points.laz, points.las), ``e57`` (points.e57),
    ``pcd`` and ``pcd_ascii`` (points.pcd, points_ascii.pcd), and ``rosbag2``, which makes the folder a bag of ROS 2
    (metadata.yaml, points.mcap). ``scanner-sim convert`` writes the same files of a result that is there."""
    compression: Literal["none", "rle", "zips", "zip", "piz"] = "rle"
    """Lossless compression of range.exr: ``rle`` is written four times as fast as ``zip``, whose files have two thirds
    of the size."""
    truth: tuple[Literal["point", "normal", "incidence", "pose"], ...] = Field(
        default=(), examples=[["normal", "incidence"]]
    )
    """Truth beside that which every image or table of shots has: the ``point`` that the beam meets, ``normal`` of the
    surface there and ``incidence`` of the beam as layers, ``pose`` of every object at the begin and at the end of the
    scan."""
    jacobian: Switch = False
    """Write how each point and range goes by every parameter whose calibration has an error, as layers or columns
    ``J.base.X`` and so on: with the covariance in ``believed.yaml`` they give that of any two voxels."""
    lines: VoxelChoice = "none"
    """Voxels, as [row, column], whose lines of the position sensor go into lines.parquet, with the light before noise:
    ``scanner-sim reprocess`` makes other noise and ranges of it."""
    waveforms: VoxelChoice = "none"
    """The same for waveforms of time of flight: waveforms.parquet."""
    frames: Switch = False
    """With pose.methods: [camera, …], write the video camera's frames, as PNG of 16 bits (frame_00000.png …), with
    their dots (dots.csv) and the camera as it is believed (frames.json), and as a picture frames.png. Light is then
    followed to all of each frame, not to windows about the dots alone: that takes two to five times as long."""
    patterns: Switch = True
    """Of a tracking scan, write every voxel of every pattern into patterns.parquet: some 7 kB for a pattern of 128."""
