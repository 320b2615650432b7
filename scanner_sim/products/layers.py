"""What every result of shots has: named layers of one shape, with units, meanings and marks of what failed."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.channels import CHANNEL, JACOBIAN, MEASURED_BY
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.html_text import html_box, html_folded, html_rows
from scanner_sim.foundation.status import Status
from scanner_sim.products.provenance import in_order, versions
from scanner_sim.products.true_poses import TruePoses

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True, eq=False, repr=False)
class LayeredResult(ABC):
    """A result in named layers of one shape: an image of a raster, or a table of shots.

    A layer is read by its name, ``result["range_m"]``; the table in :mod:`~scanner_sim.foundation.channels` tells unit
    and meaning of each. The arrays are views that cannot be written to.

    Parameters
    ----------
    channels
        Layers by name, float32.
    objects, materials
        Names behind the numbers of ``truth.object`` and ``truth.material``: number 1 is the first name, and a number
        that nobody has is empty.
    seed
        Seed of the random numbers.
    scenario_yaml
        The resolved scenario that gives this result.
    warnings
        Sentences for the user on things that look unintended.
    made_by
        Versions of the programs that made it.
    poses
        Where the objects truly stand when the scan begins and ends; None where the scenario does not ask for it.
    calibration_yaml
        The calibration that the instrument believed, with its covariance, as a file has it; empty without one.

    Raises
    ------
    ValueError
        If names, shapes, types or the marks of what was not measured contradict each other.
    """

    channels: Mapping[str, NDArray[np.float32]]
    objects: tuple[str, ...] = field(default=(), kw_only=True)
    materials: tuple[str, ...] = field(default=(), kw_only=True)
    seed: int = field(default=0, kw_only=True)
    scenario_yaml: str = field(default="", kw_only=True)
    warnings: tuple[str, ...] = field(default=(), kw_only=True)
    made_by: Mapping[str, str] = field(default_factory=versions, kw_only=True)
    poses: TruePoses | None = field(default=None, kw_only=True)
    calibration_yaml: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        """Check the layers, put them in order and close them to writing."""
        _check_names(self.channels)
        if any("\n" in name for name in (*self.objects, *self.materials)):
            raise ValueError("names of objects and materials must stay on one line")
        for name, layer in self.channels.items():
            if layer.dtype != np.float32 or layer.shape != self.shape:
                raise ValueError(
                    f"{name} must be float32 of shape {self.shape}, not {layer.dtype} of shape {layer.shape}"
                )
        ordered = {name: closed(self.channels[name]) for name in CHANNEL if name in self.channels}
        object.__setattr__(self, "channels", MappingProxyType(ordered))
        object.__setattr__(self, "made_by", MappingProxyType(in_order(self.made_by)))
        _check_codes(self)
        _check_marks(self)

    @property
    @abstractmethod
    def shape(self) -> tuple[int, ...]:
        """Shape of each layer."""

    @abstractmethod
    def to_xarray(self) -> xarray.Dataset:
        """Return the result as an xarray dataset, with units, meanings and names of the codes."""

    @abstractmethod
    def _title(self) -> str:
        """Return a line that says what the result is of."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Say how to make the result again in another process: of its arrays, checked and closed as here."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        values |= {"channels": dict(self.channels), "made_by": dict(self.made_by)}
        return partial(type(self), **values), ()

    def __getitem__(self, name: str) -> NDArray[np.float32]:
        """Return a layer.

        Raises
        ------
        KeyError
            If there is no such layer; the message names those that there are.
        """
        if name not in self.channels:
            raise KeyError(f"no channel {name!r} in this result; it has {', '.join(self.channels)}")
        return self.channels[name]

    def __contains__(self, name: object) -> bool:
        """Tell whether there is a layer ``name``."""
        return name in self.channels

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Where a range was measured, of the shape of the layers."""
        return np.equal(self["status"], Status.VALID)

    def keeping(self, names: Sequence[str]) -> Self:
        """Return the result with some of its layers alone, and the ``status`` that tells where these hold numbers.

        Raises
        ------
        InputError
            If there is no layer of a name.
        """
        if unknown := [name for name in names if name not in self]:
            remedy = f"It has {', '.join(self.channels)}."
            if unknown[0] in CHANNEL and (asked := CHANNEL[unknown[0]].asked):
                remedy = f"Write {_asking(asked)} into the scenario."
            raise InputError(f"this result has no layer {unknown[0]!r}.", remedy=remedy)
        wanted = {
            "status",
            *names,
            *(code for code, of in MEASURED_BY.items() if not set(of).isdisjoint(names)),
        }
        return replace(self, channels={name: self[name] for name in self.channels if name in wanted})

    def points(self) -> NDArray[np.float32]:
        """Return the measured points in the scanner frame, shape (valid shots, 3) [m], in the order of the shots."""
        valid = self.valid
        return np.stack([self[name][valid] for name in ("P.X", "P.Y", "P.Z")], axis=1)

    def __repr__(self) -> str:
        """Return a few lines that say what the result holds."""
        valid = self.valid
        lines = [f"{self._title()}, seed {self.seed}"]
        lines.append(f"  {100.0 * valid.mean():.4g} % have a range" + self._ranges(valid))
        lines.append(f"  channels: {', '.join(self.channels)}")
        lines.extend(f"  warning: {warning}" for warning in self.warnings)
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the outcome, and the layers behind a click."""
        status, rows = self["status"], [("with a range", f"{100.0 * self.valid.mean():.4g} %")]
        rows.append(("ranges", self._ranges(self.valid).removeprefix(", ")))
        for code in Status:
            share = float(np.mean(status == code))
            if share and code is not Status.VALID:
                rows.append((code.name.lower().replace("_", " "), f"{100.0 * share:.3g} %: {code.sentence}"))
        rows += [("objects", ", ".join(numbered(self.objects).values())), ("seed", str(self.seed))]
        rows += [("warning", text) for text in self.warnings]
        layers = [(name, CHANNEL[name].unit, CHANNEL[name].meaning) for name in self.channels]
        return html_box(
            self._title(),
            self._html_picture(),
            html_rows([(word, phrase) for word, phrase in rows if phrase]),
            html_folded(f"{len(layers)} layers", html_rows(layers, ("name", "unit", "meaning"))),
        )

    def _html_picture(self) -> str:
        """Return a picture for a notebook, as HTML; none by default."""
        return ""

    def _ranges(self, valid: NDArray[np.bool_]) -> str:
        if "range_m" not in self or not valid.any():
            return ""
        ranges = self["range_m"][valid]
        text = f", from {ranges.min():.4g} m to {ranges.max():.4g} m"
        if "sigma_range_m" in self:
            text += f", median σ {1e3 * float(np.median(self['sigma_range_m'][valid])):.3g} mm"
        return text


def _asking(asked: str) -> str:
    """Return what a scenario says to have the layers of a channel that is asked for."""
    if asked.startswith(JACOBIAN):
        return f"output.jacobian: true, and a calibration whose {asked.removeprefix(JACOBIAN)} has an error,"
    return "processing.calibration" if asked == "calibration" else f"output.truth: [{asked}]"


def _check_codes(result: LayeredResult) -> None:
    """Raise a ValueError where a layer of codes holds something else than their whole numbers."""
    for name, names in legends(result.channels, result.objects, result.materials).items():
        layer, end = result[name], len(names) - 1
        if not ((layer >= 0) & (layer <= end) & (layer == np.rint(layer))).all():
            raise ValueError(f"{name} must hold whole numbers from 0 to {end}")


def numbered(names: Sequence[str]) -> dict[int, str]:
    """Return the names of objects or materials by their numbers, without those that nobody has."""
    return {number: name for number, name in enumerate(names, start=1) if name}


def legends(
    channels: Iterable[str], objects: Sequence[str], materials: Sequence[str]
) -> dict[str, list[str]]:
    """Return the names behind the whole numbers of channels, from 0; numbers that nobody has are empty.

    Parameters
    ----------
    channels
        Names of layers or columns, of which those of other numbers are left out.
    objects, materials
        Names behind the numbers of ``truth.object`` and ``truth.material``, from 1.
    """
    own = {"truth.object": objects, "truth.material": materials}
    return {
        name: ["nothing", *own[name]] if name in own else [status.name for status in Status]
        for name in channels
        if name in CHANNEL and CHANNEL[name].whole
    }


def _check_marks(result: LayeredResult) -> None:
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


def attributes(result: LayeredResult, title: str) -> dict[str, str]:
    """Return what a result says of itself as attributes for xarray."""
    return {
        "title": title,
        "seed": str(result.seed),
        "scenario": result.scenario_yaml,
        "warnings": "\n".join(result.warnings),
        **{f"version_{program}": number for program, number in result.made_by.items()},
    }


def layer_variables(result: LayeredResult, dimensions: tuple[str, ...]) -> dict[str, Any]:
    """Return layers as variables for xarray over some dimensions, with units, meanings and names of their codes."""
    names, variables = legends(result.channels, result.objects, result.materials), {}
    for name, layer in result.channels.items():
        about: dict[str, object] = {"units": CHANNEL[name].unit, "long_name": CHANNEL[name].meaning}
        values: NDArray[np.float32] | NDArray[np.int32] = layer
        if name in names:
            values = layer.astype(np.int32)
            about |= flags(names[name])
        if name in MEASURED_BY:
            about["comment"] = "; ".join(f"{status.name}: {status.sentence}" for status in Status)
        variables[name] = (dimensions, values, about)
    return variables


def flags(names: Sequence[str]) -> dict[str, object]:
    """Return what xarray is told of numbers from 0 with names, int32; those that nobody has are empty.

    ``flag_values`` and ``flag_meanings`` of the CF conventions, sec. 3.5: as many of the one as of the other.
    """
    known = {number: word for number, word in enumerate(names) if word}
    return {
        "flag_values": np.array(list(known), dtype=np.int32),
        "flag_meanings": " ".join(word.replace(" ", "_") for word in known.values()),
    }


def _check_names(channels: Mapping[str, NDArray[np.float32]]) -> None:
    """Raise a ValueError where channels are unknown or the status is missing."""
    if "status" not in channels:
        raise ValueError("a result needs the channel status")
    if unknown := [name for name in channels if name not in CHANNEL]:
        raise ValueError(f"unknown channels: {', '.join(unknown)}; known are {', '.join(CHANNEL)}")


def closed(array: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return a view of ``array`` that cannot be written to; nothing is copied."""
    view = array.view()
    view.flags.writeable = False
    return view
