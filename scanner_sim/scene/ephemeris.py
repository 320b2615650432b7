"""Motion by files of flight dynamics: orbits and attitudes of an object and of the spacecraft with the scanner."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field
from scipy.interpolate import KroghInterpolator
from scipy.spatial.transform import Rotation as Turning
from scipy.spatial.transform import Slerp

from scanner_sim.foundation.arithmetic import applied, product
from scanner_sim.foundation.errors import Fault, InputError
from scanner_sim.foundation.parts import InputFile, Part
from scanner_sim.scene.ccsds import CcsdsFile, Segment, parse_epoch, read_attitude, read_orbit
from scanner_sim.scene.poses import FARTHEST, Position, Turns, placement_matrix

Array = NDArray[np.float64]

OrbitFile = Annotated[Path, InputFile((".oem", ".kvn", ".txt")), Field(examples=["orbits/target.oem"])]
AttitudeFile = Annotated[Path, InputFile((".aem", ".kvn", ".txt")), Field(examples=["orbits/target.aem"])]

BODIES = (
    "EARTH", "SUN", "MOON", "MARS", "VENUS", "MERCURY", "JUPITER", "SATURN", "URANUS", "NEPTUNE", "EARTH BARYCENTER",
    "SOLAR SYSTEM BARYCENTER", "EARTH-MOON BARYCENTER",
)  # fmt: skip
"""Centres about which only spacecraft move, not what stands before a scanner."""
DEFAULT_DEGREE = 7
"""Of Hermite's interpolation where an orbit file names none: positions and velocities of four epochs."""
HIGHEST_DEGREE = 15


class Carrier(Part):
    """The spacecraft that carries the scanner, and where the scanner stands on it."""

    orbit: OrbitFile
    """Its orbit: an OEM of the same frame, centre and time system as the object's."""
    attitude: AttitudeFile
    """Its attitude: an AEM between that frame and the spacecraft's body."""
    position: Position = (0.0, 0.0, 0.0)
    """Position of the scanner in the frame of the body."""
    rotation: Turns = ()
    """Turns of the scanner from the axes of the body, the first one first."""


class EphemerisMotion(Part):
    """An object on an orbit: CCSDS files of its orbit and attitude, seen from a spacecraft on another one.

    Its pose is scanner_from_object = (reference_from_body · body_from_scanner)⁻¹ · reference_from_object. Without
    ``scanner`` the orbit's frame is the scanner's own, for files of relative motion.
    """

    type: Literal["ccsds"]
    """Kind of motion."""
    orbit: OrbitFile
    """Orbit of the object: an OEM in KVN."""
    attitude: AttitudeFile | None = None
    """Attitude of the object: an AEM in KVN; by default its axes are those of the orbit's frame."""
    scanner: Carrier | None = None
    """The spacecraft with the scanner."""
    start: str | None = Field(default=None, max_length=40, examples=["2026-03-20T12:00:00"])
    """Epoch at which the scan begins, in the time system of the files; by default the first that all of them hold."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield what is wrong with the files, one by one and together."""
        for key, reader, file in self._files():
            try:
                _read(reader, file)
            except InputError as error:
                yield Fault(key, error.message, error.remedy)
                return
        try:
            self._path()
        except InputError as error:
            yield Fault("start" if "start" in error.message else "orbit", error.message, error.remedy)

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s] since the start that all files hold; before and after them the object rests."""
        return self._path().span

    def _files(self) -> Iterator[tuple[str, str, Path]]:
        yield "orbit", "orbit", self.orbit
        if self.attitude is not None:
            yield "attitude", "attitude", self.attitude
        if self.scanner is not None:
            yield "scanner.orbit", "orbit", self.scanner.orbit
            yield "scanner.attitude", "attitude", self.scanner.attitude

    def _path(self) -> _RelativePath:
        stamps = tuple((file.stat().st_mtime_ns, file.stat().st_size) for _, _, file in self._files())
        return _path_of(_Key(self, stamps))

    def scanner_from_object(self, time: ArrayLike, start: Array) -> Array:
        """Return the poses at times [s], shape (n, 4, 4); the files say all, and ``start`` nothing."""
        del start
        return self._path()(np.atleast_1d(np.asarray(time, dtype=np.float64)))


class _Key(NamedTuple):
    motion: EphemerisMotion
    stamps: tuple[tuple[int, int], ...]


def _read(reader: str, file: Path) -> CcsdsFile:
    changed = file.stat()
    return _cached(reader, file, changed.st_mtime_ns, changed.st_size)


@lru_cache(maxsize=16)
def _cached(reader: str, file: Path, changed: int, size: int) -> CcsdsFile:
    del changed, size
    return read_orbit(file) if reader == "orbit" else read_attitude(file)


@lru_cache(maxsize=16)
def _path_of(key: _Key) -> _RelativePath:
    return _RelativePath(key.motion)


class _RelativePath:
    """The pose of an object before a scanner, from their files."""

    def __init__(self, motion: EphemerisMotion) -> None:
        files = {key: _read(reader, file) for key, reader, file in motion._files()}
        orbit = files["orbit"]
        frame, centre = (orbit.segments[0].meta[key] for key in ("REF_FRAME", "CENTER_NAME"))
        _check_together(files, frame, centre)
        begin = self._begin(motion, files)
        offset = {key: begin - file.start.since(orbit.start) for key, file in files.items()}
        self._object = _Orbit(orbit, offset["orbit"])
        self._attitude = (
            None if motion.attitude is None else _Attitude(files["attitude"], frame, offset["attitude"])
        )
        self.span = self._common(files, orbit, begin)
        self._carrier = None
        if motion.scanner is not None:
            place = motion.scanner.position, motion.scanner.rotation
            self._carrier = (
                _Orbit(files["scanner.orbit"], offset["scanner.orbit"]),
                _Attitude(files["scanner.attitude"], frame, offset["scanner.attitude"]),
                placement_matrix(*place),
            )
        elif centre.upper() in BODIES:
            raise InputError(
                f"the orbit is about {centre}, and nothing says where the scanner is.",
                remedy="Give scanner: {orbit: …, attitude: …}, or an OEM of the relative motion.",
            )
        near = float(np.abs(self(np.array([0.0]))[0, :3, 3]).max())
        if near > FARTHEST:
            raise InputError(
                f"the object is {near:.3g} m from the scanner at the start; it may be {FARTHEST:g} m.",
                remedy="Choose another start, or look whether the files belong together.",
            )

    @staticmethod
    def _common(files: dict[str, CcsdsFile], orbit: CcsdsFile, begin: float) -> tuple[float, float]:
        """Return the first and the last time [s] since the scan's start that all files hold."""
        starts = [file.start.since(orbit.start) for file in files.values()]
        ends = [at + file.segments[-1].time[-1] for at, file in zip(starts, files.values(), strict=True)]
        return max(starts) - begin, min(ends) - begin

    def _begin(self, motion: EphemerisMotion, files: dict[str, CcsdsFile]) -> float:
        """Return the start of the scan [s] since the first epoch of the object's orbit."""
        orbit = files["orbit"]
        first, last = self._common(files, orbit, 0.0)
        if first >= last:
            raise InputError("the files have no time in common.", remedy="Give files of the same hours.")
        if motion.start is None:
            return first
        try:
            begin = parse_epoch(motion.start, orbit.time_system).since(orbit.start)
        except ValueError:
            raise InputError(
                f"the start {motion.start!r} is no epoch.", remedy="Write for example 2026-03-20T12:00:00."
            ) from None
        if not first <= begin < last:
            raise InputError(
                f"the start is {begin - first:.6g} s after the first epoch that all files hold, and they end "
                f"{last - first:.6g} s after it.",
                remedy="Choose a start between.",
            )
        return begin

    def __call__(self, time: Array) -> Array:
        """Return the poses at times [s], shape (n, 4, 4); before and after what all files hold they are held."""
        t = np.clip(time, *self.span)
        turn = np.tile(np.eye(3), (len(t), 1, 1)) if self._attitude is None else self._attitude(t)
        if self._carrier is None:
            return _matrices(turn, self._object(t))
        orbit, attitude, mount = self._carrier
        body = attitude(t)
        apart = applied(np.swapaxes(body, 1, 2), self._object(t) - orbit(t)) - mount[:3, 3]
        back = mount[:3, :3].T
        return _matrices(product(back, np.swapaxes(body, 1, 2), turn), applied(back, apart))


def _check_together(files: dict[str, CcsdsFile], frame: str, centre: str) -> None:
    """Find files of other time systems, frames or centres than the orbit's."""
    system = files["orbit"].time_system
    for key, file in files.items():
        if file.time_system != system:
            raise InputError(
                f"{key} counts time in {file.time_system}, and orbit in {system}.",
                remedy="Write all files in one time system.",
            )
        meta = file.segments[0].meta
        if key == "scanner.orbit" and (meta["REF_FRAME"], meta["CENTER_NAME"]) != (frame, centre):
            raise InputError(
                f"{key} is in {meta['REF_FRAME'][:30]} about {meta['CENTER_NAME'][:30]}, and orbit in {frame[:30]} "
                f"about {centre[:30]}.",
                remedy="Write both orbits in one frame about one centre.",
            )


def _matrices(rotation: Array, position: Array) -> Array:
    matrices = np.zeros((len(position), 4, 4))
    matrices[:, :3, :3], matrices[:, :3, 3], matrices[:, 3, 3] = rotation, position, 1.0
    return matrices


class _Windows:
    """Which epochs of which segment serve a time: neighbours, as many as a degree needs."""

    def __init__(self, file: CcsdsFile, offset: float) -> None:
        self.segments, self._offset = file.segments, offset
        self._starts = np.array([segment.time[0] for segment in file.segments])

    def of(self, time: Array, count: int) -> Iterator[tuple[NDArray[np.intp], Array, Segment, slice]]:
        """Yield which times are served by some epochs, the same times since the file's first, and those epochs."""
        t = time + self._offset
        number = np.clip(np.searchsorted(self._starts, t, side="right") - 1, 0, len(self.segments) - 1)
        for index in np.unique(number):
            segment = self.segments[index]
            size = min(count, len(segment.time))
            after = np.searchsorted(segment.time, t, side="right")
            first = np.clip(after - size // 2, 0, len(segment.time) - size)
            for begin in np.unique(first[number == index]):
                which = np.flatnonzero((number == index) & (first == begin))
                yield which, t[which], segment, slice(int(begin), int(begin) + size)


class _Orbit:
    """Positions on an orbit, by the interpolation that its file names."""

    def __init__(self, file: CcsdsFile, offset: float) -> None:
        meta = file.segments[0].meta
        method, degree = _interpolation(meta, "INTERPOLATION", "HERMITE", DEFAULT_DEGREE)
        self._hermite = method == "HERMITE"
        self._points = (degree + 1) // 2 if self._hermite else degree + 1
        self._windows = _Windows(file, offset)

    def __call__(self, time: Array) -> Array:
        """Return the positions at times [s], shape (n, 3)."""
        position = np.empty((len(time), 3))
        for which, t, segment, part in self._windows.of(time, self._points):
            epochs, rows = segment.time[part], segment.rows[part]
            middle, span = 0.5 * (epochs[0] + epochs[-1]), 0.5 * (epochs[-1] - epochs[0])
            at, values = (epochs - middle) / span, rows[:, :3] - rows[0, :3]
            if self._hermite:
                at, values = np.repeat(at, 2), np.stack([values, span * rows[:, 3:]], axis=1).reshape(-1, 3)
            position[which] = KroghInterpolator(at, values)((t - middle) / span) + rows[0, :3]
        return position


class _Attitude:
    """Attitudes of a body before the orbit's frame, by the interpolation that the file names."""

    def __init__(self, file: CcsdsFile, frame: str, offset: float) -> None:
        meta = file.segments[0].meta
        ends = meta["REF_FRAME_A"], meta["REF_FRAME_B"]
        if frame not in ends or ends[0] == ends[1]:
            raise InputError(
                f"the attitude is between {ends[0][:30]} and {ends[1][:30]}, and the orbit in {frame[:30]}.",
                remedy="Write both in one reference frame.",
            )
        # The quaternions take B to A; wanted is the body to the frame.
        self._inverse = ends[1] == frame
        method, degree = _interpolation(meta, "INTERPOLATION_METHOD", "LINEAR", 1)
        self._points = 2 if method == "LINEAR" else degree + 1
        self._windows = _Windows(file, offset)

    def __call__(self, time: Array) -> Array:
        """Return the rotations at times [s], shape (n, 3, 3)."""
        found = np.empty((len(time), 4))
        for which, t, segment, part in self._windows.of(time, self._points):
            epochs, quaternions = segment.time[part], _same_signs(segment.rows[part])
            inside = np.clip(t, epochs[0], epochs[-1])
            if self._points == 2:
                found[which] = Slerp(epochs, Turning.from_quat(quaternions))(inside).as_quat()
            else:
                middle, span = 0.5 * (epochs[0] + epochs[-1]), 0.5 * (epochs[-1] - epochs[0])
                found[which] = KroghInterpolator((epochs - middle) / span, quaternions)(
                    (inside - middle) / span
                )
        turns = Turning.from_quat(found)
        matrices: Array = (turns.inv() if self._inverse else turns).as_matrix()
        return matrices


def _same_signs(quaternions: Array) -> Array:
    """Return quaternions without jumps of sign from one to the next."""
    turned = np.cumprod(np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0.0, -1.0, 1.0))
    even: Array = quaternions * np.concatenate([[1.0], turned])[:, None]
    return even


def _interpolation(meta: dict[str, str], key: str, default: str, degree: int) -> tuple[str, int]:
    method = meta.get(key, default).upper()
    if method not in ("HERMITE", "LAGRANGE", "LINEAR") or (
        key == "INTERPOLATION_METHOD" and method == "HERMITE"
    ):
        raise InputError(
            f"the interpolation {method[:30]!r} is not known.", remedy="Use LAGRANGE, LINEAR or HERMITE."
        )
    if method == "LINEAR":
        return "LINEAR", 1
    try:
        chosen = int(meta.get("INTERPOLATION_DEGREE", degree))
    except ValueError:
        chosen = 0
    if not 1 <= chosen <= HIGHEST_DEGREE:
        raise InputError(f"the degree of the interpolation is not from 1 to {HIGHEST_DEGREE}.")
    return method, chosen
