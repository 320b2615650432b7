"""A table of shots: the result of a scan without rows, as named columns with units, one line for each shot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.channels import CHANNEL, Channel
from scanner_sim.products.layers import LayeredResult, attributes, closed, layer_variables

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]

AIMED = (
    Channel("shot", "1", "number of the shot, counted from 0 in the order of the scan", "aim"),
    Channel("time_s", "s", "middle of the shot's dwell since the start of the scan", "aim"),
    Channel(
        "theta_rad",
        "rad",
        "deflection to the right in the middle of the dwell: as commanded, or of mirrors whose servos follow that",
        "aim",
    ),
    Channel(
        "phi_rad", "rad", "deflection downwards, likewise; both without the mirrors' random errors", "aim"
    ),
)
"""Columns that every table of shots begins with; the others are layers that an image has, too."""

COLUMN: Mapping[str, Channel] = MappingProxyType({channel.name: channel for channel in AIMED} | dict(CHANNEL))
"""Unit and meaning of each column, by name."""

_WIDEST = 2.0
"""Angle [rad] beyond which there is no deflection: the commands end at a right angle."""


@dataclass(frozen=True, eq=False, repr=False)
class ShotTable(LayeredResult):
    """Measurements of a scan without rows and the truth behind them, column by column.

    :data:`COLUMN` tells unit and meaning of each column.

    Parameters
    ----------
    channels, objects, materials, seed, scenario_yaml, warnings, made_by, poses, calibration_yaml
        As of :class:`~scanner_sim.products.layers.LayeredResult`; each layer has the shape (shots,).
    time
        Middle of each dwell since the start [s], shape (shots,), ascending.
    theta, phi
        Deflections of each shot [rad], shape (shots,).

    Raises
    ------
    ValueError
        If names, shapes, types, times or the marks of invalid shots contradict each other.
    """

    time: Array
    theta: Array
    phi: Array

    def __post_init__(self) -> None:
        """Check the table and close its arrays to writing."""
        for name in ("time", "theta", "phi"):
            values = getattr(self, name)
            if values.dtype != np.float64 or values.shape != (len(self),) or not np.isfinite(values).all():
                raise ValueError(f"{name} must be {len(self)} finite float64 numbers")
            object.__setattr__(self, name, closed(values))
        if not len(self) or (np.diff(self.time) <= 0.0).any() or self.time[0] < 0.0:
            raise ValueError("time must ascend from 0, and there must be a shot")
        if max(np.abs(self.theta).max(), np.abs(self.phi).max()) > _WIDEST:
            raise ValueError("theta and phi must be deflections")
        super().__post_init__()

    def __len__(self) -> int:
        """Return the number of shots."""
        return len(self.time)

    @property
    def shape(self) -> tuple[int]:
        """Number of shots."""
        return (len(self),)

    @property
    def columns(self) -> dict[str, NDArray[Any]]:
        """All columns by name: those of :data:`AIMED`, then the layers."""
        number = np.arange(len(self), dtype=np.uint32)
        aimed: tuple[NDArray[Any], ...] = (number, self.time, self.theta, self.phi)
        names = (channel.name for channel in AIMED)
        return {**dict(zip(names, aimed, strict=True)), **self.channels}

    def to_xarray(self) -> xarray.Dataset:
        """Return the table as an xarray dataset over ``shot``, with units, meanings and names of the codes."""
        import xarray

        coordinates = {
            channel.name: ("shot", values, {"units": channel.unit, "long_name": channel.meaning})
            for channel, values in zip(AIMED, list(self.columns.values())[: len(AIMED)], strict=True)
        }
        return xarray.Dataset(layer_variables(self, ("shot",)), coordinates, attributes(self, "shots"))

    def _title(self) -> str:
        return f"ShotTable of {len(self):,} shots in {self.time[-1]:.4g} s"
