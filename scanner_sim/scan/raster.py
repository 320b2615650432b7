"""Raster scans: rows of φ, columns of Θ, one voxel after the other."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from scanner_sim.foundation.channels import layer_bytes
from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Count, Part
from scanner_sim.foundation.units import Angle
from scanner_sim.scan.protocol import Aim, ScanSetup, Sweep, beyond_mirrors

MOST_SHOTS = 2**26
"""Largest raster: its layers alone take 7 GB."""


class RasterScan(Part):
    """A raster of ``rows`` × ``columns`` voxels over a rectangle of angles, ends included."""

    layout: ClassVar[Literal["image"]] = "image"

    type: Literal["raster"] = "raster"
    """Kind of scan."""
    rows: Count = Field(ge=1, le=16384, examples=[256])
    """Number of rows: steps of φ, top to bottom."""
    columns: Count = Field(ge=1, le=16384, examples=[256])
    """Number of columns: steps of Θ, left to right."""
    horizontal: tuple[Angle, Angle] = Field(examples=[["-15 deg", "15 deg"]])
    """First and last Θ of a row."""
    vertical: tuple[Angle, Angle] = Field(examples=[["-15 deg", "15 deg"]])
    """First and last φ of the image."""
    motion: Literal["continuous", "stepped"] = "continuous"
    """``continuous``: Θ sweeps along the row at an even rate, and the spot moves by a column while it is measured;
    ``stepped``: the mirrors rest at every voxel."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield ends in the wrong order and rasters that no memory holds."""
        for name, (first, last), count in (
            ("horizontal", self.horizontal, self.columns),
            ("vertical", self.vertical, self.rows),
        ):
            if last < first:
                yield Fault(name, "the ends must ascend.", "Write the smaller angle first.")
            elif last == first and count > 1:
                yield Fault(name, f"both ends are equal, yet there are {count} steps.", "Write two angles.")
        if self.shots > MOST_SHOTS:
            size = self.shots * layer_bytes(["triangulation"])
            yield Fault(
                "rows",
                f"{self.rows} × {self.columns} are {self.shots / 1e6:.0f} million voxels, whose layers take "
                f"{size / 1e9:.0f} GB; at most {MOST_SHOTS / 1e6:.0f} million are possible.",
                "Scan in several runs of fewer rows.",
            )

    @property
    def shots(self) -> int:
        """Number of voxels."""
        return self.rows * self.columns

    def angles(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return Θ of the columns, shape (columns,), and φ of the rows, shape (rows,) [rad]."""
        return _steps(self.horizontal, self.columns), _steps(self.vertical, self.rows)

    def not_voxels(self, voxels: NDArray[Any]) -> tuple[str, str] | None:
        """Return what is wrong with a list of voxels and its remedy; None where nothing is.

        Parameters
        ----------
        voxels
            Rows and columns, shape (n, 2).
        """
        if not len(voxels):
            return "no voxel was named.", "Name some as [row, column]."
        outside = ((voxels < 0) | (voxels >= (self.rows, self.columns))).any(axis=1)
        if outside.any():
            row, column = voxels[np.argmax(outside)]
            problem = f"voxel ({row}, {column}) lies outside of the {self.rows} × {self.columns} raster."
            return problem, "Rows and columns count from 0."
        number, times = np.unique(voxels[:, 0] * self.columns + voxels[:, 1], return_counts=True)
        if (times > 1).any():
            row, column = divmod(int(number[np.argmax(times)]), self.columns)
            problem = f"voxel ({row}, {column}) is named more than once."
            return problem, "Name each once; other noise of the same light has another seed."
        return None

    def row_times(self, dwell: float) -> NDArray[np.float64]:
        """Return the middle of each row since the start [s], shape (rows,), for a dwell [s] on every voxel."""
        return (np.arange(self.rows, dtype=np.float64) + 0.5) * self.columns * dwell

    @property
    def travel(self) -> float:
        """Deflection Θ [rad] by which the mirrors sweep from one voxel to the next, in one dwell."""
        if self.motion == "stepped" or self.columns == 1:
            return 0.0
        return (self.horizontal[1] - self.horizontal[0]) / (self.columns - 1)

    @property
    def shots_per_row(self) -> int:
        """Number of columns."""
        return self.columns

    @property
    def even_travel(self) -> float:
        """The same as ``travel``: all voxels move alike."""
        return self.travel

    @property
    def summary(self) -> str:
        """Its voxels in a phrase."""
        return f"{self.rows} rows × {self.columns} columns = {self.shots:,}"

    def scan_time(self, setup: ScanSetup) -> float:
        """Return how long it takes on the instrument [s]: the flyback takes no time."""
        return self.shots * setup.dwell

    def aims(self, setup: ScanSetup, batch: int) -> Iterator[Aim]:
        """Yield the aims of all voxels in small tiles, at most ``batch`` together."""
        order = tiled_order(self)
        for start in range(0, self.shots, batch):
            yield raster_aim(self, order[start : start + batch], setup.dwell)

    def sweep(self, setup: ScanSetup) -> Sweep:  # noqa: ARG002 (other scans need it)
        """Return by how much the beam moves along the row while a voxel is measured."""
        return Sweep(self.travel, "scan.columns", "use more columns, or motion: stepped")

    def faults(self, setup: ScanSetup) -> Iterator[Fault]:
        """Yield angles that the mirrors do not reach."""
        for name, ends in (("horizontal", self.horizontal), ("vertical", self.vertical)):
            yield from beyond_mirrors(f"scan.{name}", ends, setup.mirrors)

    def warnings(self, setup: ScanSetup) -> Iterator[str]:  # noqa: ARG002 (other scans need it)
        """Yield nothing: its mirrors reach every voxel."""
        return iter(())


def raster_aim(scan: RasterScan, shots: NDArray[np.uint32], dwell: float) -> Aim:
    """Return the aim of the given shots (shape (n,)) of a raster with a dwell [s] on every voxel.

    Rows run from left to right at an even rate, one after the other, and the flyback takes no time.
    """
    theta, phi = scan.angles()
    column, row = shots % scan.columns, shots // scan.columns
    return Aim(
        shot=shots,
        theta=theta[column],
        phi=phi[row],
        time=(shots.astype(np.float64) + 0.5) * dwell,
        travel_theta=np.full(shots.shape, scan.travel),
        travel_phi=np.zeros(shots.shape),
    )


def tiled_order(scan: RasterScan, tile: int = 8) -> NDArray[np.uint32]:
    """Return all shots of a raster, shape (shots,), ordered in small square tiles.

    Neighbours in the order are neighbours in the image, which keeps the rays of a batch coherent.
    """
    down, right = math.ceil(scan.rows / tile), math.ceil(scan.columns / tile)
    image = np.full((down * tile, right * tile), scan.shots, dtype=np.uint32)
    image[: scan.rows, : scan.columns] = np.arange(scan.shots).reshape(scan.rows, scan.columns)
    order = image.reshape(down, tile, right, tile).swapaxes(1, 2).ravel()
    return order[order < scan.shots]


def _steps(ends: tuple[float, float], count: int) -> NDArray[np.float64]:
    """Return ``count`` angles between both ends, or the middle where there is only one."""
    return np.linspace(*ends, count) if count > 1 else np.array([0.5 * (ends[0] + ends[1])])
