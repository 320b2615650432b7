"""What the rest of the program asks of a scan, whatever its kind; a scan is one file that answers it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.errors import Fault
from scanner_sim.optics.deflection import Mirrors
from scanner_sim.optics.galvanometer import Galvanometers
from scanner_sim.scene.objects import Scene

Layout: TypeAlias = Literal["image", "shots", "visits"]
"""How results are laid out: rows and columns of a raster, one shot after the other, or visits to targets."""

Ends: TypeAlias = tuple[float, float]
"""Least and largest of an angle [rad]."""


MOST_LISTED = 2**22
"""Shots of a scan that is no raster: a table of them is read again up to 64 columns."""


@dataclass(frozen=True)
class Aim:
    """Where the mirrors are commanded to point, one entry per shot.

    Attributes
    ----------
    shot
        Number of each shot, shape (n,), uint32; in a raster row · columns + column. It addresses the random numbers.
    theta, phi
        Optical deflections in the middle of the dwell [rad], shape (n,), float64: as commanded, or where a servo is
        modelled those of the shafts that follow the command.
    time
        Middle of the dwell since the start of the scan [s], shape (n,), float64.
    travel_theta, travel_phi
        By how much the deflections change during the dwell [rad], shape (n,), float64; 0 for mirrors at rest.
    """

    shot: NDArray[np.uint32]
    theta: NDArray[np.float64]
    phi: NDArray[np.float64]
    time: NDArray[np.float64]
    travel_theta: NDArray[np.float64]
    travel_phi: NDArray[np.float64]

    def part(self, which: slice | NDArray[np.intp]) -> Aim:
        """Return some of the shots."""
        return Aim(
            self.shot[which],
            self.theta[which],
            self.phi[which],
            self.time[which],
            self.travel_theta[which],
            self.travel_phi[which],
        )

    def repeated(self, times: int) -> Aim:
        """Return the shots so many times, one time after the other."""
        return self.part(np.tile(np.arange(len(self.shot)), times))

    def batches(self, size: int) -> Iterator[Aim]:
        """Yield the shots in their order, at most ``size`` together."""
        for start in range(0, len(self.shot), size):
            yield self.part(slice(start, start + size))


class ScanSetup(NamedTuple):
    """What a scan is run with: the scene, both mirrors and their servos, and the time of a shot [s]."""

    scene: Scene
    mirrors: Mirrors
    galvanometers: Galvanometers
    dwell: float


class Sweep(NamedTuple):
    """The largest ``angle`` [rad] by which a beam moves in a dwell, the key that decides on it, and a remedy."""

    angle: float
    key: str
    remedy: str


class Scan(Protocol):
    """What every scan tells, the closed loop's included."""

    @property
    def type(self) -> str:
        """Its name in scenarios."""

    @property
    def layout(self) -> Layout:
        """How its results are laid out."""

    @property
    def shots_per_row(self) -> int:
        """Shots of a row, by which a shot's number tells its row; 1 where there are no rows."""

    @property
    def even_travel(self) -> float | None:
        """By how much Θ changes in a dwell, φ at rest, where it is the same for all shots [rad]; else None."""

    def scan_time(self, setup: ScanSetup) -> float:
        """Return how long it takes on the instrument [s]."""

    def faults(self, setup: ScanSetup) -> Iterator[Fault]:
        """Yield what is impossible with a setup, with locations relative to the scenario."""


class OpenScan(Scan, Protocol):
    """A scan whose aims are known before anything is measured."""

    @property
    def shots(self) -> int:
        """Number of shots."""

    @property
    def horizontal(self) -> Ends:
        """First and last Θ of the field of view [rad]."""

    @property
    def vertical(self) -> Ends:
        """First and last φ of the field of view [rad]."""

    @property
    def summary(self) -> str:
        """Its shots in a phrase."""

    def aims(self, setup: ScanSetup, batch: int) -> Iterator[Aim]:
        """Yield all aims, at most ``batch`` shots together, in an order that keeps neighbours together."""

    def sweep(self, setup: ScanSetup) -> Sweep:
        """Return by how much the beam moves while a shot is measured."""

    def warnings(self, setup: ScanSetup) -> Iterator[str]:
        """Yield what is possible with a setup but probably not meant."""


def beyond_mirrors(
    key: str, ends: Ends, mirrors: Mirrors, remedy: str = "Narrow the scan"
) -> Iterator[Fault]:
    """Yield the fault of angles [rad] that the mirrors do not reach; ``key`` relative to the scenario."""
    limit = mirrors.max_deflection
    if max(abs(end) for end in ends) > limit:
        widest = math.degrees(max(ends, key=abs))
        yield Fault(
            key,
            f"{widest:.6g} deg lies beyond the mirrors, which deflect by up to {math.degrees(limit):.6g} deg "
            f"({limit:g} rad) to both sides.",
            f"{remedy}, or raise scanner.mirrors.max_deflection.",
        )


def too_many(key: str, shots: int) -> Iterator[Fault]:
    """Yield the fault of a scan with more shots than a table of them holds; ``key`` relative to the scenario."""
    if shots > MOST_LISTED:
        yield Fault(
            key,
            f"{shots:,} shots are too many for a table; {MOST_LISTED:,} are possible.",
            "Scan in several runs.",
        )
