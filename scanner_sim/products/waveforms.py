"""Waveforms in a file: NetCDF, which xarray and most other programs read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import xarray
from numpy.typing import NDArray
from scipy.io import netcdf_file

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.named_files import open_ordinary
from scanner_sim.foundation.status import Status, legend
from scanner_sim.products.provenance import software, versions

Array = NDArray[np.float64]

_CONVENTION = "scanner-sim waveforms, 1"
_LARGEST = 1 << 34
"""Bytes of a file that is read."""
_SHAPES = {
    "row": "i",
    "column": "i",
    "number": "if",
    "delay": "f",
    "sigma_delay": "f",
    "echoes": "i",
    "status": "i",
}
"""Variables of a file, and of which kinds of NumPy's they may be."""
_NUMBERS = ("start_s", "rate_hz", "step_a")


@dataclass(frozen=True, eq=False)
class WaveformSet:
    """Records of some voxels with what was found in them.

    Attributes
    ----------
    row, column
        Row and column of each voxel in the raster, shape (n,).
    number
        Digital numbers, shape (n, samples).
    start, rate
        Time of the first sample after the pulse [s], and samples per second.
    step
        Current of a digital number [A].
    delay, sigma
        Delay of the echo and its standard deviation without the clock's [s], shape (n,); NaN without one.
    echoes, status
        Number of echoes, and codes of :class:`scanner_sim.foundation.status.Status`, shape (n,).
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
        whole = bool((self.number == np.rint(self.number)).all())
        largest = float(np.abs(self.number).max(initial=0.0))
        kind: type[np.generic] = np.float32
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


def concatenate_waveforms(parts: Sequence[WaveformSet]) -> WaveformSet:
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
    with open_ordinary(Path(path), _LARGEST) as (stream, _):
        # What scipy raises on a broken header is anything: it trusts every count in it.
        try:
            found = _plain(stream)
        except MemoryError:
            raise InputError(f"{path} needs more memory than there is.") from None
        except Exception as error:
            reason = str(error) or type(error).__name__
            raise InputError(f"{path} cannot be read as NetCDF: {reason}.") from None
    if found is None:
        raise InputError(f"{path} holds no waveforms of this program.", remedy="Write them with a run.")
    try:
        return _waveforms(*found)
    except ValueError as error:
        raise InputError(f"The waveforms in {path} are damaged: {error}.", remedy="Run it again.") from None


def _plain(stream: BinaryIO) -> tuple[dict[str, NDArray[Any]], dict[str, Any]] | None:
    """Return the variables and numbers of a file; None where it has not our title."""
    # Mapped, so that a variable of any stated size takes no memory until it is looked at.
    with netcdf_file(stream, mmap=True) as data:
        if getattr(data, "title", None) != _CONVENTION.encode():
            return None
        variables = {name: np.array(data.variables[name].data) for name in _SHAPES if name in data.variables}
        numbers = {name: getattr(data, name, None) for name in _NUMBERS}
        # Nothing may point into the mapping when it is closed.
        data.variables.clear()
        return variables, numbers


def _waveforms(variables: Mapping[str, NDArray[Any]], numbers: Mapping[str, Any]) -> WaveformSet:
    if missing := [name for name in _SHAPES if name not in variables]:
        raise ValueError(f"the variable {missing[0]} is missing")
    for name, kinds in _SHAPES.items():
        values = variables[name]
        if values.dtype.kind not in kinds or values.shape[:1] != variables["row"].shape:
            raise ValueError(f"the variable {name} has the type {values.dtype} and the shape {values.shape}")
        if values.ndim != (2 if name == "number" else 1):
            raise ValueError(f"the variable {name} has {values.ndim} dimensions")
    for name in ("row", "column", "echoes", "status"):
        if (variables[name] < 0).any() or (name == "status" and (variables[name] > max(Status)).any()):
            raise ValueError(f"the variable {name} has numbers that there are not")
    for name, value in numbers.items():
        if np.ndim(value) > 0 or not isinstance(value, float | int | np.number) or not np.isfinite(value):
            raise ValueError(f"{name} is missing or no number")
    if not (numbers["rate_hz"] > 0.0 and numbers["step_a"] > 0.0):
        raise ValueError("rate and step must be positive")
    return WaveformSet(
        row=variables["row"].astype(np.int32),
        column=variables["column"].astype(np.int32),
        number=variables["number"].astype(np.float32),
        start=float(numbers["start_s"]),
        rate=float(numbers["rate_hz"]),
        step=float(numbers["step_a"]),
        delay=variables["delay"].astype(np.float64),
        sigma=variables["sigma_delay"].astype(np.float64),
        echoes=variables["echoes"].astype(np.uint32),
        status=variables["status"].astype(np.uint32),
    )
