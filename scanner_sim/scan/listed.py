"""A list of angles in a file: any way that the beam shall go, one line for each shot."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from scanner_sim.foundation.errors import Fault, InputError
from scanner_sim.foundation.named_files import read_text_file
from scanner_sim.foundation.parts import InputFile, Part
from scanner_sim.scan.protocol import MOST_LISTED, Aim, Ends, ScanSetup, Sweep, beyond_mirrors

Array = NDArray[np.float64]

_COLUMNS = {
    "theta_rad": ("theta", 1.0),
    "theta_mrad": ("theta", 1e-3),
    "theta_deg": ("theta", math.pi / 180.0),
    "phi_rad": ("phi", 1.0),
    "phi_mrad": ("phi", 1e-3),
    "phi_deg": ("phi", math.pi / 180.0),
    "time_s": ("time", 1.0),
    "time_ms": ("time", 1e-3),
    "time_us": ("time", 1e-6),
}
"""For each heading of a column what it holds, and its unit in radians or seconds."""
_LARGEST_FILE = 1 << 27
"""Bytes of a file: thirty a line."""
_LONGEST_LINE = 1000
_LATEST = 1e6
"""Latest time of a shot [s]."""
_EARLY = 1e-6
"""Share of a dwell by which rounded times may be too close."""
_MOST_FAULTS = 5
"""Faults of a file that are told at once."""

AngleFile = Annotated[Path, InputFile((".csv",)), Field(examples=["angles.csv"])]


@dataclass(frozen=True, eq=False)
class Angles:
    """What a file holds, each of shape (shots,): ``theta`` and ``phi`` [rad], and ``time`` [s] or None."""

    theta: Array
    phi: Array
    time: Array | None


class ListedScan(Part):
    """Shots at the angles of a file, in its order."""

    layout: ClassVar[Literal["shots"]] = "shots"
    shots_per_row: ClassVar[int] = 1
    even_travel: ClassVar[None] = None

    type: Literal["listed"]
    """Kind of scan."""
    file: AngleFile
    """A CSV file whose first line names its columns: ``theta_deg`` (or ``_rad``, ``_mrad``), ``phi_deg`` likewise, and
    if need be ``time_s`` (or ``_ms``, ``_us``), the middle of each dwell since the start. Without times one shot
    follows the other."""
    motion: Literal["stepped", "continuous"] = "stepped"
    """``stepped``: the mirrors rest at every angle; ``continuous``: they pass through it at the rate that its
    neighbours and their times tell."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield what is wrong with the file."""
        try:
            _ = self.angles
        except InputError as error:
            yield Fault("file", str(error))

    @cached_property
    def angles(self) -> Angles:
        """What the file holds, read once."""
        return read_angles(self.file)

    @property
    def shots(self) -> int:
        """Number of shots."""
        return len(self.angles.theta)

    @property
    def horizontal(self) -> Ends:
        """Least and largest Θ [rad]."""
        return float(self.angles.theta.min()), float(self.angles.theta.max())

    @property
    def vertical(self) -> Ends:
        """Least and largest φ [rad]."""
        return float(self.angles.phi.min()), float(self.angles.phi.max())

    @property
    def summary(self) -> str:
        """Its shots in a phrase."""
        return f"{self.shots:,} from {self.file.name}"

    def scan_time(self, setup: ScanSetup) -> float:
        """Return how long it takes on the instrument [s]."""
        return float(self._times(setup)[-1]) + 0.5 * setup.dwell

    def aims(self, setup: ScanSetup, batch: int) -> Iterator[Aim]:
        """Yield the shots in the order of the file."""
        theta, phi = self.angles.theta, self.angles.phi
        shot = np.arange(len(theta), dtype=np.uint32)
        return Aim(shot, theta, phi, self._times(setup), *self._travels(setup)).batches(batch)

    def sweep(self, setup: ScanSetup) -> Sweep:
        """Return by how much the beam moves where it is fastest while a shot is measured."""
        travel = self._travels(setup)
        return Sweep(
            float(np.hypot(*travel).max()), "scan.file", "use more angles between these, or motion: stepped"
        )

    def faults(self, setup: ScanSetup) -> Iterator[Fault]:
        """Yield angles that the mirrors do not reach, and shots that begin before the one before has ended."""
        for ends in (self.horizontal, self.vertical):
            yield from beyond_mirrors("scan.file", ends, setup.mirrors, "Leave these lines out")
        time = self._times(setup)
        early = np.flatnonzero(np.diff(time, prepend=-0.5 * setup.dwell) < (1.0 - _EARLY) * setup.dwell)
        if early.size:
            yield Fault(
                "scan.file",
                f"line {early[0] + 2}: {time[early[0]]:.6g} s is less than a dwell, {setup.dwell:.4g} s, after the "
                f"shot before, or less than half of one after the start ({early.size:,} such lines).",
                "Write the middle of each dwell, and raise scanner.rate for shorter ones.",
            )

    def warnings(self, setup: ScanSetup) -> Iterator[str]:
        """Yield angles that change faster than the mirrors' servos could follow, which this scan leaves out."""
        if self.motion == "stepped":
            return
        rate = float(np.abs(self._travels(setup)).max()) / setup.dwell
        if rate > setup.galvanometers.slew:
            yield (
                f"scan.file: the angles change by up to {rate:.3g} rad/s, more than the mirrors' "
                f"{setup.galvanometers.slew:.3g} rad/s (scanner.galvanometers.slew); they are taken as they are"
            )

    def _times(self, setup: ScanSetup) -> Array:
        """Return the middle of each dwell [s]."""
        if self.angles.time is not None:
            return self.angles.time
        return (np.arange(self.shots, dtype=np.float64) + 0.5) * setup.dwell

    def _travels(self, setup: ScanSetup) -> tuple[Array, Array]:
        """Return by how much Θ and φ change in each dwell [rad]: second-order differences over uneven times."""
        theta, phi = self.angles.theta, self.angles.phi
        if self.motion == "stepped" or len(theta) < 2:
            return np.zeros(len(theta)), np.zeros(len(theta))
        time = self._times(setup)
        return np.gradient(theta, time) * setup.dwell, np.gradient(phi, time) * setup.dwell


def read_angles(path: Path) -> Angles:
    """Read a list of angles.

    Raises
    ------
    InputError
        With the first faults of the file, each with its line and column.
    """
    lines = read_text_file(path, _LARGEST_FILE).splitlines()
    while lines and not lines[-1].strip():
        lines.pop()
    if len(lines) < 2:
        raise InputError(
            f"{path.name} has no angles: a line of headings and one line for each shot are needed."
        )
    if len(lines) - 1 > MOST_LISTED:
        raise InputError(f"{path.name} has {len(lines) - 1:,} lines of angles; {MOST_LISTED:,} are read.")
    if (
        long := next((number for number, line in enumerate(lines) if len(line) > _LONGEST_LINE), None)
    ) is not None:
        raise InputError(f"{path.name}, line {long + 1}: it is longer than {_LONGEST_LINE} letters.")
    names = [word.strip().strip('"') for word in lines[0].split(",")]
    _check_names(path, names)
    values = np.full((len(names), len(lines) - 1), np.nan)
    faults: list[str] = []
    for row, line in enumerate(lines[1:]):
        faults += _read_line(line, row, names, values)
        if len(faults) >= _MOST_FAULTS:
            break
    found = {_COLUMNS[name][0]: _COLUMNS[name][1] * values[column] for column, name in enumerate(names)}
    time = found.get("time")
    if time is not None and not faults:
        falls = np.flatnonzero(np.diff(time) <= 0.0)
        faults += [f"line {index + 3}, column time: the time does not ascend" for index in falls[:1].tolist()]
    if faults:
        more = ", and more" if len(faults) > _MOST_FAULTS else ""
        raise InputError(f"{path.name}: {'; '.join(faults[:_MOST_FAULTS])}{more}.")
    return Angles(found["theta"], found["phi"], time)


def _check_names(path: Path, names: Sequence[str]) -> None:
    """Refuse headings that are unknown, or do not name Θ and φ once each and a time once at most."""
    known = ", ".join(_COLUMNS)
    if unknown := [name for name in names if name not in _COLUMNS]:
        raise InputError(
            f"{path.name}, line 1: {unknown[0][:40]!r} is no column that is read; known are {known}, between commas."
        )
    kinds = [_COLUMNS[name][0] for name in names]
    for kind in ("theta", "phi", "time"):
        if (count := kinds.count(kind)) > 1 or (count == 0 and kind != "time"):
            problem = "no column" if count == 0 else "several columns"
            raise InputError(
                f"{path.name}, line 1: there is {problem} of {kind}; write for example theta_deg,phi_deg."
            )


def _read_line(line: str, row: int, names: Sequence[str], values: Array) -> list[str]:
    """Fill in the numbers of a line; return its faults."""
    words, faults = line.split(","), []
    if len(words) != len(names):
        return [f"line {row + 2} has {len(words)} entries instead of {len(names)}"]
    for column, (word, name) in enumerate(zip(words, names, strict=True)):
        try:
            # Python reads 1_000 as a number, no other program does.
            value = float(word.replace("_", "?"))
        except ValueError:
            faults.append(f"line {row + 2}, column {name}: {word.strip()[:40]!r} is no number")
            continue
        kind, unit = _COLUMNS[name]
        most = _LATEST if kind == "time" else 0.5 * math.pi
        if not abs(value * unit) <= most:
            what = "no time of a run" if kind == "time" else "no deflection: at most 90 degrees are"
            faults.append(f"line {row + 2}, column {name}: {value:g} is {what}")
        values[column, row] = value
    return faults
