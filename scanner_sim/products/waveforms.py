"""Waveforms in a file: NetCDF, which xarray and most other programs read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.errors import InputError
from scanner_sim.products.provenance import software, versions
from scanner_sim.status import legend

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]

_CONVENTION = "scanner-sim waveforms, 1"


@dataclass(frozen=True, eq=False)
class WaveformSet:
    """Records of some voxels with what was found in them.

    Attributes
    ----------
    row, column
        Place of each voxel in the raster, shape (n,).
    number
        Digital numbers, shape (n, samples).
    start, rate
        Time of the first sample after the pulse [s], and samples per second.
    step
        Current of a digital number [A].
    delay, sigma
        Delay of the echo and its standard deviation without the clock's [s], shape (n,); NaN without one.
    echoes, status
        Number of echoes, and codes of :class:`scanner_sim.status.Status`, shape (n,).
    """

    row: NDArray[np.int32]
    column: NDArray[np.int32]
    number: NDArray[np.float32]
    start: float
    rate: float
    step: float
    delay: Array
    sigma: Array
    echoes: NDArray[np.uint32]
    status: NDArray[np.uint32]

    @property
    def time(self) -> Array:
        """Time of each sample after the pulse [s]."""
        return np.asarray(self.start + np.arange(self.number.shape[1]) / self.rate)

    def dataset(self) -> xarray.Dataset:
        """Return all of it with names, dimensions and units."""
        import xarray

        whole = bool((self.number == np.rint(self.number)).all())
        largest = float(np.abs(self.number).max(initial=0.0))
        kind: Any = np.float32
        if whole:
            kind = np.int16 if largest < 2**15 else np.int32
        seconds = {"units": "s"}
        return xarray.Dataset(
            {
                "number": (
                    ("voxel", "sample"),
                    self.number.astype(kind),
                    {"long_name": "digital number; times step_a is the current", "units": "1"},
                ),
                "delay": (("voxel",), self.delay, {"long_name": "delay of the echo", **seconds}),
                "sigma_delay": (
                    ("voxel",),
                    self.sigma,
                    {"long_name": "standard deviation of the delay, clock apart", **seconds},
                ),
                "echoes": (("voxel",), self.echoes.astype(np.int32), {"long_name": "number of echoes"}),
                "status": (
                    ("voxel",),
                    self.status.astype(np.int32),
                    {"long_name": "; ".join(f"{code} {text}" for code, text in legend().items())},
                ),
            },
            coords={
                "time": (("sample",), self.time, {"long_name": "time after the pulse", **seconds}),
                "row": (("voxel",), self.row.astype(np.int32)),
                "column": (("voxel",), self.column.astype(np.int32)),
            },
            attrs={
                "title": _CONVENTION,
                "source": software(versions()),
                "start_s": self.start,
                "rate_hz": self.rate,
                "step_a": self.step,
            },
        )


def joined(parts: Sequence[WaveformSet]) -> WaveformSet:
    """Return the records of one instrument, in parts, as one."""

    def whole(name: str) -> Any:
        return np.concatenate([getattr(part, name) for part in parts])

    return replace(
        parts[0],
        row=whole("row"),
        column=whole("column"),
        number=whole("number"),
        delay=whole("delay"),
        sigma=whole("sigma"),
        echoes=whole("echoes"),
        status=whole("status"),
    )


def write_waveforms(path: str | Path, waveforms: WaveformSet) -> None:
    """Write records as NetCDF (64-bit offset); the same records give the same bytes.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    waveforms.dataset().to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")


def read_waveforms(path: str | Path) -> WaveformSet:
    """Read what :func:`write_waveforms` wrote.

    Raises
    ------
    InputError
        If the file is none of these.
    """
    import xarray

    try:
        data = xarray.load_dataset(path, engine="scipy")
    except (OSError, ValueError, TypeError, IndexError) as error:
        raise InputError(f"{path} cannot be read as NetCDF: {error}.") from None
    if data.attrs.get("title") != _CONVENTION:
        raise InputError(f"{path} holds no waveforms of this program.", remedy="Write them with a run.")
    return WaveformSet(
        row=data["row"].values,
        column=data["column"].values,
        number=data["number"].values.astype(np.float32),
        start=float(data.attrs["start_s"]),
        rate=float(data.attrs["rate_hz"]),
        step=float(data.attrs["step_a"]),
        delay=data["delay"].values,
        sigma=data["sigma_delay"].values,
        echoes=data["echoes"].values.astype(np.uint32),
        status=data["status"].values.astype(np.uint32),
    )
