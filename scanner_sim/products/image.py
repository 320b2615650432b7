"""A range image: the result of a run, as named layers over rows of φ and columns of Θ."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
import xarray
from numpy.typing import NDArray

from scanner_sim.foundation.channels import CHANNEL, MEASURED_BY
from scanner_sim.foundation.status import Status
from scanner_sim.products.provenance import in_order, versions


class Layered(Protocol):
    """A result in named layers of one shape: an image of a raster, or a table of shots."""

    @property
    def channels(self) -> Mapping[str, NDArray[np.float32]]:
        """Layers by name, in the order of :data:`CHANNELS`."""

    @property
    def objects(self) -> tuple[str, ...]:
        """Names behind the numbers of ``truth.object``."""

    @property
    def materials(self) -> tuple[str, ...]:
        """Names behind the numbers of ``truth.material``."""

    @property
    def seed(self) -> int:
        """Seed of the random numbers."""

    @property
    def scenario_yaml(self) -> str:
        """The resolved scenario."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on things that look unintended."""

    @property
    def made_by(self) -> Mapping[str, str]:
        """Versions of the programs that made it."""

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Where a range was measured."""

    def __getitem__(self, name: str) -> NDArray[np.float32]:
        """Return a layer."""

    def __contains__(self, name: object) -> bool:
        """Tell whether there is such a layer."""


@dataclass(frozen=True, eq=False, repr=False)
class RangeImage:
    """Measurements of a raster and the truth behind them, layer by layer.

    A layer is read by its name, ``image["range_m"]``; the table in :mod:`~scanner_sim.foundation.channels` tells
    unit and meaning of each. The arrays are views that cannot be written to.

    Parameters
    ----------
    channels
        Layers by name, each of shape (rows, columns), float32.
    theta, phi
        Deflections of the columns, shape (columns,), and of the rows, shape (rows,) [rad]: ascending and
        evenly spaced.
    objects, materials
        Names behind the numbers of ``truth.object`` and ``truth.material``; number 1 is the first name.
    seed
        Seed of the random numbers.
    scenario_yaml
        The resolved scenario that gives this image.
    warnings
        Sentences for the user on things that look unintended.
    made_by
        Versions of the programs that made the image.

    Raises
    ------
    ValueError
        If names, shapes, types, angles or the marks of invalid voxels contradict each other.
    """

    channels: Mapping[str, NDArray[np.float32]]
    theta: NDArray[np.float64]
    phi: NDArray[np.float64]
    objects: tuple[str, ...] = ()
    materials: tuple[str, ...] = ()
    seed: int = 0
    scenario_yaml: str = ""
    warnings: tuple[str, ...] = ()
    made_by: Mapping[str, str] = field(default_factory=versions)

    def __post_init__(self) -> None:
        """Check the image and close its arrays to writing."""
        object.__setattr__(self, "theta", closed(_angles("theta", self.theta)))
        object.__setattr__(self, "phi", closed(_angles("phi", self.phi)))
        seal(self, self.shape)

    def __getitem__(self, name: str) -> NDArray[np.float32]:
        """Return a layer, shape (rows, columns).

        Raises
        ------
        KeyError
            If the image has no such layer; the message names those that it has.
        """
        if name not in self.channels:
            raise KeyError(f"no channel {name!r} in this image; it has {', '.join(self.channels)}")
        return self.channels[name]

    def __contains__(self, name: object) -> bool:
        """Tell whether the image has the layer ``name``."""
        return name in self.channels

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return len(self.phi), len(self.theta)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Where a range was measured, shape (rows, columns)."""
        return np.equal(self["status"], Status.VALID)

    def points(self) -> NDArray[np.float32]:
        """Return the measured points in the scanner frame, shape (valid voxels, 3) [m], row by row."""
        valid = self.valid
        return np.stack([self[name][valid] for name in ("P.X", "P.Y", "P.Z")], axis=1)

    def to_xarray(self) -> xarray.Dataset:
        """Return the image as an xarray dataset.

        Returns
        -------
        xarray.Dataset
            Variables by channel name over ``phi`` and ``theta`` [rad], with ``units`` and ``long_name``;
            status and truth numbers are int32 with CF ``flag_values`` and ``flag_meanings``. Seed,
            scenario, versions and warnings are attributes of the dataset.
        """
        variables = layer_variables(self, ("phi", "theta"))
        coordinates = {
            "phi": ("phi", self.phi, {"units": "rad", "long_name": "deflection downwards, per row"}),
            "theta": (
                "theta",
                self.theta,
                {"units": "rad", "long_name": "deflection to the right, per column"},
            ),
        }
        return xarray.Dataset(variables, coordinates, attributes(self, "range image"))

    def __repr__(self) -> str:
        """Return a few lines that say what the image holds."""
        rows, columns = self.shape
        spans = [
            f"{name} {np.degrees(angle[0]):.4g}° to {np.degrees(angle[-1]):.4g}°"
            for name, angle in (("Θ", self.theta), ("φ", self.phi))
        ]
        lines = [f"RangeImage of {rows} rows × {columns} columns, {spans[0]}, {spans[1]}, seed {self.seed}"]
        valid = self.valid
        lines.append(f"  {100.0 * valid.mean():.4g} % of the voxels have a range" + self._ranges(valid))
        lines.append(f"  channels: {', '.join(self.channels)}")
        lines.extend(f"  warning: {warning}" for warning in self.warnings)
        return "\n".join(lines)

    def _ranges(self, valid: NDArray[np.bool_]) -> str:
        if "range_m" not in self or not valid.any():
            return ""
        ranges = self["range_m"][valid]
        text = f", from {ranges.min():.4g} m to {ranges.max():.4g} m"
        if "sigma_range_m" in self:
            text += f", median σ {1e3 * float(np.median(self['sigma_range_m'][valid])):.3g} mm"
        return text


def seal(result: Layered, shape: tuple[int, ...]) -> None:
    """Check the layers of a result of some shape, put them in order and close them to writing.

    Raises
    ------
    ValueError
        If names, shapes, types or the marks of what was not measured contradict each other.
    """
    _check_names(result.channels)
    if any("\n" in name for name in (*result.objects, *result.materials)):
        raise ValueError("names of objects and materials must stay on one line")
    for name, layer in result.channels.items():
        if layer.dtype != np.float32 or layer.shape != shape:
            raise ValueError(
                f"{name} must be float32 of shape {shape}, not {layer.dtype} of shape {layer.shape}"
            )
    ordered = {name: closed(result.channels[name]) for name in CHANNEL if name in result.channels}
    object.__setattr__(result, "channels", MappingProxyType(ordered))
    object.__setattr__(result, "made_by", MappingProxyType(in_order(result.made_by)))
    _check_codes(result)
    _check_marks(result)


def _check_codes(result: Layered) -> None:
    """Raise a ValueError where a layer of codes holds something else than their whole numbers."""
    for name, names in _legends(result).items():
        layer, end = result[name], len(names) - 1
        if not ((layer >= 0) & (layer <= end) & (layer == np.rint(layer))).all():
            raise ValueError(f"{name} must hold whole numbers from 0 to {end}")


def _legends(result: Layered) -> dict[str, list[str]]:
    """Return the names behind the numbers of each layer of whole numbers."""
    own = {"truth.object": result.objects, "truth.material": result.materials}
    return {
        name: ["nothing", *own[name]] if name in own else [status.name for status in Status]
        for name in result.channels
        if CHANNEL[name].whole
    }


def _check_marks(result: Layered) -> None:
    """Raise a ValueError where what was not measured is no NaN, or what was is no number."""
    for status, layers in MEASURED_BY.items():
        if status not in result:
            if present := [name for name in layers if name in result]:
                raise ValueError(f"{present[0]} needs the channel {status}")
            continue
        valid = np.equal(result[status], Status.VALID)
        for name in layers:
            if name in result and not np.isnan(result[name][~valid]).all():
                raise ValueError(f"{name} must be NaN wherever {status} is not 0")
            finite = name in result and CHANNEL[name].kind == "point"
            if finite and not np.isfinite(result[name][valid]).all():
                raise ValueError(f"{name} must be a finite number wherever {status} is 0")


def attributes(result: Layered, title: str) -> dict[str, str]:
    """Return what a result says of itself as attributes for xarray."""
    return {
        "title": title,
        "seed": str(result.seed),
        "scenario": result.scenario_yaml,
        "warnings": "\n".join(result.warnings),
        **{f"version_{program}": number for program, number in result.made_by.items()},
    }


def layer_variables(result: Layered, dimensions: tuple[str, ...]) -> dict[str, Any]:
    """Return layers as variables for xarray over some dimensions, with units, meanings and names of their codes."""
    names, variables = _legends(result), {}
    for name, layer in result.channels.items():
        about: dict[str, object] = {"units": CHANNEL[name].unit, "long_name": CHANNEL[name].meaning}
        values: NDArray[np.float32] | NDArray[np.int32] = layer
        if name in names:
            values = layer.astype(np.int32)
            about["flag_values"] = np.arange(len(names[name]), dtype=np.int32)
            about["flag_meanings"] = " ".join(word.replace(" ", "_") for word in names[name])
        if name in MEASURED_BY:
            about["comment"] = "; ".join(f"{status.name}: {status.sentence}" for status in Status)
        variables[name] = (dimensions, values, about)
    return variables


def _check_names(channels: Mapping[str, NDArray[np.float32]]) -> None:
    """Raise a ValueError where channels are unknown or the status is missing."""
    if "status" not in channels:
        raise ValueError("a result needs the channel status")
    if unknown := [name for name in channels if name not in CHANNEL]:
        raise ValueError(f"unknown channels: {', '.join(unknown)}; known are {', '.join(CHANNEL)}")


def _angles(name: str, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``values`` (shape (n,)) if they are finite, ascending and evenly spaced float64."""
    if values.ndim != 1 or not values.size or values.dtype != np.float64 or not np.isfinite(values).all():
        raise ValueError(f"{name} must be a list of finite float64 angles")
    even = np.linspace(values[0], values[-1], values.size)
    step = (values[-1] - values[0]) / max(values.size - 1, 1)
    if values.size > 1 and (step <= 0.0 or np.abs(values - even).max() > 1e-6 * step):
        raise ValueError(f"{name} must ascend in even steps")
    return values


def closed(array: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return a view of ``array`` that cannot be written to; nothing is copied."""
    view = array.view()
    view.flags.writeable = False
    return view
