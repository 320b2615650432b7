"""Reading orbit and attitude files of the CCSDS: OEM (CCSDS 502.0-B) and AEM (CCSDS 504.0-B), as keywords and values.

Read are versions 1 to 3 of OEM and 1 and 2 of AEM in KVN (text); XML is not. Of an OEM: metadata, epochs, positions
[km] and velocities [km/s]; accelerations and covariances are passed over. Of an AEM: quaternions, with or without their
derivatives, which are passed over. Epochs are calendar dates or days of the year; seconds of UTC are counted through
leap seconds.
"""

from __future__ import annotations

import datetime
import math
import re
import warnings
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import erfa
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.named_files import read_text_file

Array = NDArray[np.float64]

MOST_ROWS = 1_000_000
"""Epochs of a file."""
_LARGEST = 1 << 28
"""Bytes of a file."""
FARTHEST_KM = 1e7
"""Largest coordinate in an orbit file [km]: beyond a million kilometres doubles lose the micrometre."""
FIRST_YEAR, LAST_YEAR = 1972, 2100
"""Years of epochs: UTC has counted leap seconds since 1972."""
TIME_SYSTEMS = ("UTC", "TAI", "TT", "GPS", "TDB", "TCB", "UT1")
_EPOCH = re.compile(r"(\d{4})-(?:(\d{2})-(\d{2})|(\d{3}))T(\d{2}):(\d{2}):(\d{2}(?:\.\d{0,15})?)Z?")
_ORBIT_KEYS = ("CENTER_NAME", "REF_FRAME", "TIME_SYSTEM")
_ATTITUDE_KEYS = ("REF_FRAME_A", "REF_FRAME_B", "TIME_SYSTEM", "ATTITUDE_TYPE")


class Epoch(NamedTuple):
    """An instant: day by its ordinal in the calendar, and seconds of that day, of UTC those of TAI."""

    day: int
    second: float

    def since(self, other: Epoch) -> float:
        """Return the time since another epoch [s]."""
        return 86400.0 * (self.day - other.day) + (self.second - other.second)


class Segment(NamedTuple):
    """A block of a file: its metadata, its epochs [s] since the file's first, shape (n,), and its rows, shape (n, k).

    Rows hold position [m] and velocity [m/s] of an orbit, or quaternions (x, y, z, w) of an attitude.
    """

    meta: dict[str, str]
    time: Array
    rows: Array


class CcsdsFile(NamedTuple):
    """What a file holds: segments in the order of time, the first epoch, and the time system."""

    segments: tuple[Segment, ...]
    start: Epoch
    time_system: str


def read_orbit(file: Path) -> CcsdsFile:
    """Return an orbit ephemeris message.

    Raises
    ------
    InputError
        With the line of the first fault.
    """
    return _read(file, "CCSDS_OEM_VERS", _ORBIT_KEYS, _orbit_row)


def read_attitude(file: Path) -> CcsdsFile:
    """Return an attitude ephemeris message; its quaternions turn vectors of REF_FRAME_B into those of REF_FRAME_A.

    Raises
    ------
    InputError
        With the line of the first fault.
    """
    return _read(file, "CCSDS_AEM_VERS", _ATTITUDE_KEYS, _attitude_row)


def parse_epoch(text: str, time_system: str) -> Epoch:
    """Return an epoch, as ``2026-03-20T12:00:00.5`` or ``2026-079T12:00:00.5``.

    Raises
    ------
    ValueError
        If it is none.
    """
    match = _EPOCH.fullmatch(text)
    if match is None:
        raise ValueError("no epoch")
    year, month, day, day_of_year, hour, minute, second = match.groups()
    if not FIRST_YEAR <= int(year) <= LAST_YEAR:
        raise ValueError("no epoch")
    if day_of_year is None:
        date = datetime.date(int(year), int(month), int(day))
    else:
        date = datetime.date(int(year), 1, 1) + datetime.timedelta(int(day_of_year) - 1)
        if date.year != int(year):
            raise ValueError("no epoch")
    # A leap second is the 61st of its minute.
    if int(hour) > 23 or int(minute) > 59 or float(second) >= 61.0:
        raise ValueError("no epoch")
    seconds = 3600.0 * int(hour) + 60.0 * int(minute) + float(second)
    return Epoch(date.toordinal(), seconds + (_leap_seconds(date) if time_system == "UTC" else 0.0))


@lru_cache(maxsize=4096)
def _leap_seconds(date: datetime.date) -> float:
    """Return TAI − UTC on a day [s] (IERS, as the ERFA library has it): of the years to come the last that is known."""
    with warnings.catch_warnings():
        # Some years beyond its table of leap seconds ERFA warns.
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        return float(erfa.dat(date.year, date.month, date.day, 0.0))


class _Lines:
    """The lines of a file with their numbers, comments and empty ones left out."""

    def __init__(self, file: Path) -> None:
        self.file, self._number = file, 0
        self._lines = read_text_file(file, _LARGEST).splitlines()

    def __iter__(self) -> Iterator[list[str]]:
        for number, line in enumerate(self._lines, start=1):
            self._number, words = number, line.split()
            if words and words[0] != "COMMENT":
                yield words

    def fault(self, problem: str, remedy: str = "") -> InputError:
        """Return the fault of the present line."""
        return InputError(f"line {self._number} of {self.file.name}: {problem}", remedy=remedy)


_RowReader = Callable[[_Lines, list[float], dict[str, str]], list[float]]
"""What makes a row of the numbers of a line, by the metadata."""
_Open = tuple[dict[str, str], list[Epoch], list[list[float]]]
"""A segment while it is read: metadata, epochs, rows."""


def _keyword(words: list[str]) -> tuple[str, str] | None:
    """Return keyword and value of ``KEY = VALUE``."""
    key, equals, value = " ".join(words).partition("=")
    return (key.strip(), value.strip()) if equals else None


def _read(file: Path, version: str, needed: tuple[str, ...], row_of: _RowReader) -> CcsdsFile:
    lines = _Lines(file)
    meta: dict[str, str] | None = None
    known: dict[str, str] = {}
    segments: list[_Open] = []
    skipped = ""
    for count, words in enumerate(lines):
        if count == 0:
            first = _keyword(words)
            if first is None or first[0] != version:
                raise lines.fault(
                    f"the file does not begin with {version}.",
                    "Files in KVN (text) are read; convert one in XML.",
                )
            continue
        if skipped:
            skipped = "" if words[0] == skipped else skipped
        elif words[0] == "META_START":
            meta = {}
        elif words[0] == "META_STOP":
            if meta is None:
                raise lines.fault("META_STOP stands without META_START.")
            missing = [key for key in needed if not meta.get(key)]
            if missing:
                raise lines.fault(f"the metadata lack {', '.join(missing)}.")
            if meta["TIME_SYSTEM"] not in TIME_SYSTEMS:
                raise lines.fault(
                    f"the time system {meta['TIME_SYSTEM'][:20]!r} is not known.",
                    f"Possible: {', '.join(TIME_SYSTEMS)}.",
                )
            segments.append((meta, [], []))
            known, meta = meta, None
        elif words[0] == "COVARIANCE_START":
            skipped = "COVARIANCE_STOP"
        elif words[0] in ("DATA_START", "DATA_STOP"):
            continue
        elif (pair := _keyword(words)) is not None:
            if meta is not None:
                meta[pair[0]] = pair[1]
        elif not segments:
            raise lines.fault("data stand before any metadata.")
        else:
            _take(lines, words, known, segments[-1], row_of)
    return _checked(file, segments)


def _take(lines: _Lines, words: list[str], meta: dict[str, str], segment: _Open, row_of: _RowReader) -> None:
    """Take a line of data into a segment."""
    _, epochs, rows = segment
    try:
        epoch = parse_epoch(words[0], meta["TIME_SYSTEM"])
    except ValueError:
        raise lines.fault(
            f"{words[0][:40]!r} is no epoch.", "Write for example 2026-03-20T12:00:00.000."
        ) from None
    try:
        numbers = [float(word) for word in words[1:]]
    except ValueError:
        raise lines.fault("it holds something that is not a number.") from None
    if not all(map(math.isfinite, numbers)):
        raise lines.fault("it holds a number that is not finite.")
    if epochs and epoch.since(epochs[-1]) <= 0.0:
        raise lines.fault("its epoch is not after the one before.", "Sort the epochs, each once.")
    if len(epochs) >= MOST_ROWS:
        raise lines.fault(f"there are more than {MOST_ROWS} epochs.", "Keep fewer of them.")
    epochs.append(epoch)
    rows.append(row_of(lines, numbers, meta))


def _orbit_row(lines: _Lines, numbers: list[float], _: dict[str, str]) -> list[float]:
    if len(numbers) not in (6, 9):
        raise lines.fault(
            f"it has {len(numbers)} numbers; an orbit has three of position and three of velocity."
        )
    if max(map(abs, numbers[:3])) > FARTHEST_KM:
        raise lines.fault(f"a coordinate is beyond {FARTHEST_KM:g} km.")
    return [1e3 * value for value in numbers[:6]]


def _attitude_row(lines: _Lines, numbers: list[float], meta: dict[str, str]) -> list[float]:
    kind = meta["ATTITUDE_TYPE"].upper()
    if not kind.startswith("QUATERNION"):
        raise lines.fault(f"attitudes of the type {kind[:30]!r} are not read.", "Write quaternions.")
    if len(numbers) < 4:
        raise lines.fault("it has fewer than the four numbers of a quaternion.")
    quaternion = numbers[:4]
    if meta.get("QUATERNION_TYPE", "LAST").upper() == "FIRST":
        quaternion = [*quaternion[1:], quaternion[0]]
    if abs(math.hypot(*quaternion) - 1.0) > 1e-3:
        raise lines.fault(f"its quaternion is {math.hypot(*quaternion):.4g} long, not 1.")
    # A quaternion of frame A to frame B turns the axes: it takes components in B to those in A (504.0-B-1, annex A).
    if meta.get("ATTITUDE_DIR", "A2B").upper() == "B2A":
        return [*(-value for value in quaternion[:3]), quaternion[3]]
    return quaternion


def _checked(file: Path, segments: list[_Open]) -> CcsdsFile:
    """Return segments that follow one another, of one frame and one time system."""
    if not segments:
        raise InputError(f"{file.name} holds no segment.", remedy="It needs META_START, META_STOP and data.")
    start = next((epochs[0] for _, epochs, _ in segments if epochs), None)
    found: list[Segment] = []
    for number, (meta, epochs, rows) in enumerate(segments, start=1):
        if len(epochs) < 2 or start is None:
            raise InputError(f"segment {number} of {file.name} holds fewer than two epochs.")
        time = np.array([epoch.since(start) for epoch in epochs])
        for key in ("REF_FRAME", "CENTER_NAME", "TIME_SYSTEM", "REF_FRAME_A", "REF_FRAME_B"):
            if found and meta.get(key) != found[0].meta.get(key):
                raise InputError(f"segment {number} of {file.name} has another {key} than the first.")
        if found and not -1e-6 <= time[0] - found[-1].time[-1] <= 1e-6:
            raise InputError(
                f"segment {number} of {file.name} does not begin where the one before ends.",
                remedy="Give one segment for each file, or segments that touch.",
            )
        found.append(Segment(meta, time, np.array(rows)))
    assert start is not None  # every segment has epochs
    return CcsdsFile(tuple(found), start, segments[0][0]["TIME_SYSTEM"])
