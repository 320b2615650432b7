"""Which formats of other programs there are, what each needs, and what writes it; its library is loaded then."""

from __future__ import annotations

import difflib
import importlib.util
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from types import MappingProxyType

from scanner_sim.foundation.errors import InputError, printable
from scanner_sim.pose.series import PoseSeries
from scanner_sim.products.files.contents import FORMAT_FILES
from scanner_sim.products.files.exchange import Writers
from scanner_sim.products.formats.cloud import Cloud, cloud_of_scan, cloud_of_track
from scanner_sim.products.image import RangeImage
from scanner_sim.products.shots import ShotTable
from scanner_sim.tracking.record import Track

Result = RangeImage | ShotTable | Track
"""What holds points."""


@dataclass(frozen=True)
class _Extra:
    """An optional part of the installation: its name, and the modules that it brings."""

    name: str
    modules: tuple[str, ...]


_LAS, _E57, _ROS = _Extra("las", ("laspy", "lazrs")), _Extra("e57", ("pye57",)), _Extra("ros", ("rosbags",))
_EXTRAS: Mapping[str, _Extra] = MappingProxyType(
    {"laz": _LAS, "las": _LAS, "e57": _E57, "rosbag2": _ROS},
)


def check_formats(words: Iterable[str]) -> None:
    """Refuse formats that there are not, and those whose library is not installed.

    Raises
    ------
    InputError
        With the format that was probably meant, or with what installs the library.
    """
    for word in words:
        if word not in FORMAT_FILES:
            near = difflib.get_close_matches(word.lower(), list(FORMAT_FILES), n=1, cutoff=0.4)
            meant = f"Did you mean '{near[0]}'? " if near else ""
            raise InputError(
                f"'{printable(word)}' is no format.", remedy=f"{meant}Possible: {', '.join(FORMAT_FILES)}."
            )
        extra = _EXTRAS.get(word)
        if extra is not None and any(importlib.util.find_spec(name) is None for name in extra.modules):
            names = " and ".join(extra.modules)
            are = "which is" if len(extra.modules) == 1 else "which are"
            raise InputError(
                f"{word} needs {names}, {are} not installed.",
                remedy=f"pip install 'scanner-sim[{extra.name}]'",
            )


def format_writers(
    result: Result, words: Sequence[str], poses: Sequence[PoseSeries] = (), *, by: str = ""
) -> Writers:
    """Return what writes a result in some formats, by the names of the files.

    Parameters
    ----------
    result
        The result.
    words
        The formats.
    poses
        Of a track: what its targets said of its objects. Only bags hold them.
    by
        Whose points: as of :func:`~scanner_sim.products.formats.cloud.cloud_of_scan`.

    Raises
    ------
    InputError
        As :func:`check_formats`.
    """
    check_formats(words)
    source = Source(result, tuple(poses), by)
    writers: dict[str, Callable[[Path], None]] = {}
    for word in dict.fromkeys(words):
        writers |= {name: partial(write_format, source, word, name) for name in FORMAT_FILES[word]}
    return writers


@dataclass(frozen=True, eq=False)
class Source:
    """A result whose points are made once for all formats."""

    result: Result
    poses: tuple[PoseSeries, ...]
    by: str

    @cached_property
    def cloud(self) -> Cloud:
        """Its points; faults as of :func:`~scanner_sim.products.formats.cloud.cloud_of_scan`."""
        if isinstance(self.result, Track):
            return cloud_of_track(self.result)
        return cloud_of_scan(self.result, self.by)

    @cached_property
    def bag(self) -> Mapping[str, bytes]:
        """The files of a bag by their names."""
        from scanner_sim.products.formats.rosbag import bag_files

        if isinstance(self.result, Track):
            return bag_files(self.cloud, self.result, self.poses)
        return bag_files(self.cloud, truth=self.result.poses)


def write_format(source: Source, word: str, name: str, path: Path) -> None:
    """Write a file of a format, by its usual name, to a path; faults as of the format's own function."""
    if word in ("laz", "las"):
        from scanner_sim.products.formats.las import write_las

        write_las(path, source.cloud, compressed=word == "laz")
    elif word == "e57":
        from scanner_sim.products.formats.e57 import write_e57

        write_e57(path, source.cloud)
    elif word == "rosbag2":
        path.write_bytes(source.bag[name])
    else:
        from scanner_sim.products.formats.pcd import write_pcd

        write_pcd(path, source.cloud, ascii_numbers=word == "pcd_ascii")
