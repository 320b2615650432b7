"""A calibration field: boards with surveyed targets, stations of the scanner, and what was read of which from where."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.parameters import NAMES
from scanner_sim.pose.transforms import rotation_from_vector
from scanner_sim.ranging.believed import Design, VoxelReadings

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Flags = NDArray[np.bool_]

FEWEST = 4
"""Targets that a station must see of a board to be tied to it: three fix its place, and one is to spare."""


@dataclass(frozen=True)
class Targets:
    """Targets of all boards, T of them.

    Attributes
    ----------
    names
        ``board/target``, shape (T,).
    board
        Number of the board of each, shape (T,).
    places
        Along the axes of its own board, by survey [m], shape (T, 3).
    sigma
        Standard deviation of the survey, each axis [m]; 0 where it is exact.
    boards
        Names of the boards.
    """

    names: tuple[str, ...]
    board: Indices
    places: Array
    sigma: float
    boards: tuple[str, ...]


@dataclass(frozen=True)
class Sightings:
    """N sightings of targets.

    Attributes
    ----------
    station, target
        Numbers of the station and of the target of each, shape (N,).
    readings
        What was read, each of shape (N,).
    root
        L with L Lᵀ the covariance of what (ϑ, φ, measured) have for themselves [rad, rad, m], shape (N, 3, 3).
    common
        What k errors of unit variance make of them, which all sightings of one station have in common and no other
        station has, shape (N, 3, k).
    """

    station: Indices
    target: Indices
    readings: VoxelReadings
    root: Array
    common: Array

    @property
    def sigma(self) -> Array:
        """Standard deviations of (ϑ, φ, measured) [rad, rad, m], shape (N, 3)."""
        own = np.einsum("nij,nij->ni", self.root, self.root)
        return np.asarray(np.sqrt(own + np.einsum("nij,nij->ni", self.common, self.common)))

    def __len__(self) -> int:
        return len(self.station)

    def take(self, chosen: Flags | Indices) -> Sightings:
        """Return some of them."""
        one = self.readings
        readings = VoxelReadings(one.theta[chosen], one.phi[chosen], one.measured[chosen], one.by)
        root, common = self.root[chosen], self.common[chosen]
        return Sightings(self.station[chosen], self.target[chosen], readings, root, common)


@dataclass(frozen=True)
class ScaleBars:
    """Distances between targets that are known from elsewhere: numbers of two targets, length and its σ [m], (B,)."""

    first: Indices
    second: Indices
    length: Array
    sigma: Array

    @classmethod
    def none(cls) -> ScaleBars:
        """Return no bars."""
        return cls(np.empty(0, np.intp), np.empty(0, np.intp), np.empty(0), np.empty(0))


@dataclass(frozen=True)
class Poses:
    """Rotations (n, 3, 3) and positions [m] (n, 3) of stations or boards: axes and origin of each in the field."""

    rotation: Array
    position: Array

    def turned(self, step: Array) -> Poses:
        """Return poses moved by (δc, δω) along the axes of the field, shape (n, 6)."""
        return Poses(rotation_from_vector(step[:, 3:]) @ self.rotation, self.position + step[:, :3])


@dataclass(frozen=True)
class Field:
    """Everything that a calibration goes by.

    Attributes
    ----------
    design
        The instrument as designed.
    tolerance
        Standard deviation to which each parameter was built [SI], by name: those that are looked for. All others stay
        as designed.
    encoder_period
        Period of the encoders' periodic error [rad].
    targets, sightings, bars, stations
        Targets, sightings, scale bars, and names of the stations.
    """

    design: Design
    tolerance: Mapping[str, float]
    encoder_period: float
    targets: Targets
    sightings: Sightings
    stations: tuple[str, ...]
    bars: ScaleBars = field(default_factory=ScaleBars.none)

    @property
    def sought(self) -> tuple[str, ...]:
        """Names of the parameters that are looked for, in the order of all parameters."""
        return tuple(name for name in NAMES if name in self.tolerance)

    @property
    def tolerances(self) -> Array:
        """Tolerances of :attr:`sought`."""
        return np.array([self.tolerance[name] for name in self.sought])

    def views(self) -> Iterator[tuple[int, int, Flags]]:
        """Yield station, board and the sightings of each board from each station that saw enough of it."""
        seen, board = self.sightings, self.targets.board[self.sightings.target]
        for station, number in sorted(set(zip(seen.station.tolist(), board.tolist(), strict=True))):
            chosen = (seen.station == station) & (board == number)
            if chosen.sum() >= FEWEST:
                yield station, number, chosen

    def seeing(self, chosen: Flags | Indices) -> Field:
        """Return the field of some of its sightings alone: what none of them saw is not in it."""
        seen, targets = self.sightings.take(chosen), self.targets
        board = targets.board[seen.target]
        standing, target = np.isin(targets.board, board), _renumbered(np.isin(targets.board, board))
        stations = np.isin(np.arange(len(self.stations)), seen.station)
        boards = np.isin(np.arange(len(targets.boards)), board)
        bars = standing[self.bars.first] & standing[self.bars.second]
        return replace(
            self,
            targets=Targets(
                tuple(name for name, kept in zip(targets.names, standing, strict=True) if kept),
                _renumbered(boards)[targets.board[standing]],
                targets.places[standing],
                targets.sigma,
                tuple(name for name, kept in zip(targets.boards, boards, strict=True) if kept),
            ),
            sightings=replace(seen, station=_renumbered(stations)[seen.station], target=target[seen.target]),
            stations=tuple(name for name, kept in zip(self.stations, stations, strict=True) if kept),
            bars=ScaleBars(
                target[self.bars.first[bars]],
                target[self.bars.second[bars]],
                self.bars.length[bars],
                self.bars.sigma[bars],
            ),
        )


def _renumbered(kept: Flags) -> Indices:
    """Return the new number of each of the things that are kept, by its old one."""
    return np.cumsum(kept) - 1
