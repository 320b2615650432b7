"""Simulated sightings: each station follows the targets that it sees, through light, detector and estimator.

The instrument as built is the truth, and the instrument believes that it is as designed. A sighting is the mean of the
patterns that followed a target. The white part of its error falls with their number but for what dwells on the same
places share, the mirrors' wobble with the time that they span, and the lasting parts stay. Two parts are told apart:
that by unlike pixels, which targets share whose images lie on the same pixels, and wobble, which neighbours in time and
angle share. Pixels and wobble are drawn anew for each station.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scanner_sim.calibration.plan import Board
from scanner_sim.calibration.setup import STATIONED, Setup
from scanner_sim.calibration.tables import SightingTable
from scanner_sim.config.built import same_instrument
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.frames import pose_matrix
from scanner_sim.foundation.streams import Stream, host_generator
from scanner_sim.instrument.closed_loop.track import track_many
from scanner_sim.ranging.coordinates import angles_and_range
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.tracking.errors import ErrorParts, common_covariance
from scanner_sim.tracking.record import Track, TrackStatus
from scanner_sim.tracking.scan import TrackScan
from scanner_sim.tracking.state import TrackMode

Array = NDArray[np.float64]

_STEEPEST = float(np.cos(np.deg2rad(65.0)))
"""Cosine of the steepest incidence under which a flat target is looked at."""
_BEFORE = 2
"""Patterns with which the tracker finds a target, before it follows it: a search, and one about what that found."""
_STILL = {"type": "twist"}
"""Motion of what stands: runs side by side may have it elsewhere."""
_BEYOND, _APART, _FAR = 2.0, 0.005, 1e3
"""Where targets are expected that a station does not see: an angle beyond all mirrors, from one to the next [rad], and
the range [m]. A thousand of them are none in another, and a saved run may hold them."""


def simulated_sightings(
    setup: Setup,
    *,
    device: DeviceChoice = "auto",
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[SightingTable, tuple[str, ...]]:
    """Simulate the sightings of all stations.

    Parameters
    ----------
    setup
        A plan without sightings of its own.
    device, threads
        Where to compute; the result does not depend on the threads.
    progress
        Called with the milliseconds that the instruments have measured, and with all of them.

    Returns
    -------
    table, warnings
        The sightings, and sentences on targets that were in view and have none.

    Raises
    ------
    InputError
        If a station has nothing in its field of view, or a scene cannot be measured.
    """
    seen = [_seen(setup, number) for number in range(len(setup.plan.stations))]
    every = {own: name for one in seen for own, name in one.items()}
    scenarios = [_scenario(setup, number, every, one) for number, one in enumerate(seen)]

    def advance(done: float, whole: float) -> None:
        if progress is not None:
            progress(round(1e3 * done), round(1e3 * whole))

    return _table(setup, seen, track_many(scenarios, device=device, threads=threads, progress=advance))


def _table(
    setup: Setup, seen: Sequence[Mapping[str, str]], tracks: Sequence[Track]
) -> tuple[SightingTable, tuple[str, ...]]:
    stations, targets, warnings = [], [], []
    positions, covariances, pixels = [], [], []
    for station, own_targets, track in zip(setup.plan.stations, seen, tracks, strict=True):
        lost = []
        for own, name in own_targets.items():
            found = _mean(track, own)
            if found is None:
                lost.append(name)
                continue
            stations.append(station.name)
            targets.append(name)
            positions.append(found[0])
            covariances.append(found[1])
            pixels.append(found[2])
        if lost:
            warnings.append(
                f"station {station.name} could not follow {', '.join(lost)}: hidden, too near or too far"
            )
    position, covariance = np.reshape(positions, (-1, 3)), np.reshape(covariances, (-1, 3, 3))
    unlike = np.reshape(pixels, (-1, 5)).T
    return SightingTable(tuple(stations), tuple(targets), position, covariance, *unlike), tuple(warnings)


def _mean(track: Track, target: str) -> tuple[Array, Array, Array] | None:
    """Return the mean (Θ, φ, R) of the patterns that followed a target, its covariance, and its shared parts."""
    found = [
        one for one in track.of(target) if one.mode is TrackMode.TRACK and one.status is TrackStatus.MEASURED
    ]
    if not found:
        return None
    position, parts = (
        np.stack([one.position for one in found]),
        ErrorParts.stack([one.errors for one in found]),
    )
    time, same = np.array([one.time for one in found]), np.zeros(len(found))
    between, steady = (
        common_covariance(own, position, time, same).mean(axis=(0, 1))
        for own in (parts, replace(parts, wobble=same))
    )
    covariance = parts.white.mean(axis=0) / len(found) + between
    wobble = np.sqrt(max(between[0, 0] - steady[0, 0], 0.0)), time.mean()
    unlike = np.sqrt(parts.pixels.mean()), parts.image.mean(), parts.image_width.mean()
    return position.mean(axis=0), covariance, np.array([*unlike, *wobble])


def _seen(setup: Setup, number: int) -> dict[str, str]:
    """Return the targets that a station has in view: their names in its scenario, and in the field."""
    station = setup.plan.stations[number]
    targets: dict[str, str] = {}
    for board in setup.plan.boards:
        seen = _in_view(board, setup, _pose(setup, number, board))
        for index, name in enumerate(setup.places[board.name], start=1):
            if seen[index - 1]:
                targets[_own_name(board, index)] = f"{board.name}/{name}"
    if not targets:
        raise InputError(
            f"Station {station.name} has no target in its field of view.",
            remedy="Turn it, or move it farther away: the scanner looks along its z.",
        )
    return targets


def _pose(setup: Setup, number: int, board: Board) -> Array:
    """Return the pose of a board before a station."""
    return np.asarray(np.linalg.inv(setup.plan.stations[number].field_from_here()) @ board.field_from_here())


def _scenario(setup: Setup, number: int, every: Iterable[str], seen: Collection[str]) -> Scenario:
    """Return the scenario of a station. All stations have the same targets, so that they go side by side.

    What a station does not see is expected beyond its mirrors' reach, where no pattern is run.
    """
    plan, base = setup.plan, setup.base
    objects = [item for board in plan.boards for item in _objects(board, setup, _pose(setup, number, board))]
    targets: list[dict[str, object]] = [
        {"target": name}
        if name in seen
        else {"target": name, "expected": (_BEYOND + _APART * index, 0.0, _FAR)}
        for index, name in enumerate(every)
    ]
    changes: dict[str, object] = {
        "seed": int(host_generator(plan.seed, Stream.SURVEY, STATIONED + number).integers(2**62)),
        "ranging": setup.rangefinder,
        "scene": {"objects": objects},
        "scan": {"type": "track", "targets": targets, "duration": _duration(setup, len(seen))},
        "lighting": {},
        "pose": {},
        "output": {},
        "processing.calibration": None,
    }
    return same_instrument(base, changes, f"the scene before station {plan.stations[number].name}")


def _duration(setup: Setup, targets: int) -> float:
    """Return the time [s] for as many patterns over each target as are wanted; targets out of view take none."""
    scan, scanner = TrackScan(type="track", targets=("any",)), setup.base.scanner
    period = scan.visiting.period(scan.pattern.points, scanner.dwell, targets, scanner.galvanometers)
    return period * targets * (_BEFORE + setup.plan.visits)


def _objects(board: Board, setup: Setup, pose: Array) -> Iterator[dict[str, object]]:
    """Yield the objects of a board whose pose in the scanner frame is given."""
    if board.array is not None:
        look = {
            "array": board.array.model_dump(),
            "disc": _plain(board.disc),
            "material": _plain(board.material),
        }
        yield {"name": board.name, **look, **_placed(pose)}
        return
    for index, place in enumerate(setup.places[board.name].values(), start=1):
        at = {"name": _own_name(board, index), **_placed(pose @ pose_matrix(np.eye(3), place))}
        if board.plate is None:
            yield {**at, "shape": "sphere", "diameter": board.diameter, "material": _plain(board.material)}
        else:
            look = {"array": {"diameter": board.diameter, "plate": board.plate}, "disc": _plain(board.disc)}
            yield {**at, **look, "material": _plain(board.material)}


def _own_name(board: Board, index: int) -> str:
    """Return the name of a target in a scenario."""
    return f"{board.name}/{index}" if board.array is not None else f"{board.name}-{index}"


def _plain(material: object) -> object:
    return material if isinstance(material, str) else material.model_dump()  # type: ignore[attr-defined]


def _placed(pose: Array) -> dict[str, object]:
    turn = Rotation.from_matrix(pose[:3, :3]).as_rotvec()
    angle = float(np.linalg.norm(turn))
    axis = tuple((turn / angle).tolist()) if angle else "z"
    return {
        "position": tuple(pose[:3, 3].tolist()),
        "rotation": {"axis": axis, "angle": angle},
        "motion": _STILL,
    }


def _in_view(board: Board, setup: Setup, pose: Array) -> NDArray[np.bool_]:
    """Return which targets of a board the mirrors reach, with the first pattern around them, and which face here."""
    local = np.array(list(setup.places[board.name].values()))
    diameter = board.diameter if board.array is None else board.array.diameter
    points = local @ pose[:3, :3].T + pose[:3, 3]
    mirrors = setup.base.scanner.mirrors
    r, theta, phi = angles_and_range(points[:, 0], points[:, 1], points[:, 2], mirrors.axis_separation)
    around = (diameter or 0.0) / np.maximum(r, 1e-9)
    seen = (points[:, 2] > 0.0) & (np.maximum(np.abs(theta), np.abs(phi)) + around < mirrors.max_deflection)
    if board.array is not None or board.plate is not None:
        seen &= points @ pose[:3, 2] > _STEEPEST * np.linalg.norm(points, axis=1)
    return np.asarray(seen)
