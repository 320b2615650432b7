"""Views as rows of Parquet files: a row for each, with its layers, objects, poses and scenario."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet
from numpy.typing import NDArray

from scanner_sim.campaign.dataset.views import View, ViewedObject
from scanner_sim.foundation.channels import CHANNEL
from scanner_sim.foundation.errors import InputError
from scanner_sim.products.files.contents import RUN
from scanner_sim.products.files.exr import read_range_image
from scanner_sim.products.files.shots_folder import read_shots
from scanner_sim.products.image import RangeImage
from scanner_sim.products.shots import COLUMN, ShotTable
from scanner_sim.scene.labels import is_label_of_part

GROUP_BYTES = 8 << 20
"""Bytes of layers that are read together: a row group."""


@dataclass(frozen=True)
class Field:
    """A column of the shards.

    Attributes
    ----------
    name, unit, meaning
        Of the column; a unit of 1 for none.
    kind
        Of its numbers, as Arrow calls it.
    shape
        Empty for one of a view; -1 where the length differs from view to view.
    """

    name: str
    unit: str
    meaning: str
    kind: str
    shape: tuple[int, ...] = ()

    @property
    def arrow(self) -> pyarrow.DataType:
        """The type of the column: lists hold an array row by row."""
        one = pyarrow.string() if self.kind == "string" else getattr(pyarrow, self.kind)()
        return pyarrow.list_(one) if self.shape else one


def fields_of(views: Sequence[View], layers: Sequence[str]) -> tuple[Field, ...]:
    """Return the columns of shards of some views.

    Raises
    ------
    InputError
        If their results differ in size or in layers, or there is no layer of a name.
    """
    first = _result(views[0])
    for name in layers:
        if name not in first:
            raise InputError(
                f"the kept runs have no layer {name!r}.", remedy=f"They have {', '.join(first.channels)}."
            )
    names = [name for name in first.channels if not layers or name in (*layers, "status", "truth.object")]
    shape = first.shape
    return (
        Field("run", "1", "number of the run in its campaign", "int64"),
        Field("seed", "1", "seed of its random numbers", "int64"),
        Field("split", "1", "train, validation or test", "string"),
        Field("scenario", "1", "the resolved scenario, YAML", "string"),
        *(
            Field(name, COLUMN[name].unit, meaning, "float64", aims.shape)
            for name, (meaning, aims) in _aims(first).items()
        ),
        Field(
            "object_names",
            "1",
            "objects of the scene, each with its labelled parts that are seen, in the order of the following columns",
            "string",
            (-1,),
        ),
        Field(
            "object_numbers", "1", "number of each in truth.object; 0 where it is not seen", "int32", (-1,)
        ),
        Field("object_shapes", "1", "what tells shapes apart, whatever they are made of", "string", (-1,)),
        Field(
            "object_files", "1", "file of each shape; empty where the scenario describes it", "string", (-1,)
        ),
        Field(
            "object_poses",
            "1",
            "scanner_from_object, 4 × 4, in metres, when the scan begins and when it ends",
            "float64",
            (-1, 2, 4, 4),
        ),
        *(Field(name, CHANNEL[name].unit, CHANNEL[name].meaning, _kind(name), shape) for name in names),
    )


def _kind(name: str) -> str:
    if CHANNEL[name].kind == "status":
        return "uint8"
    return "uint16" if CHANNEL[name].whole else "float32"


def shard_bytes(views: Sequence[View], split: str, fields: Sequence[Field]) -> bytes:
    """Return the views of a shard as Parquet; the same views give the same bytes.

    Raises
    ------
    InputError
        If a result is damaged, or differs in size or layers from the fields.
    """
    schema = pyarrow.schema(
        [
            pyarrow.field(
                one.name,
                one.arrow,
                metadata={"unit": one.unit, "meaning": one.meaning, "shape": ",".join(map(str, one.shape))},
            )
            for one in fields
        ]
    )
    stream = io.BytesIO()
    with pyarrow.parquet.ParquetWriter(stream, schema, compression="zstd") as writer:
        for group in _groups(views, split, fields):
            columns = [pyarrow.array([row[one.name] for row in group], one.arrow) for one in fields]
            writer.write_table(pyarrow.Table.from_arrays(columns, schema=schema))
    return stream.getvalue()


def _groups(views: Sequence[View], split: str, fields: Sequence[Field]) -> Iterator[list[dict[str, Any]]]:
    """Yield the rows of views, so many together as a reader takes at once."""
    waiting: list[dict[str, Any]] = []
    for view in views:
        waiting.append(_row(view, split, fields))
        if len(waiting) * row_bytes(fields) >= GROUP_BYTES:
            yield waiting
            waiting = []
    if waiting:
        yield waiting


def row_bytes(fields: Sequence[Field]) -> int:
    """Return about how many bytes the layers of a view take, not compressed."""
    return sum(4 * int(np.prod(one.shape)) for one in fields if one.shape and one.shape[0] > 0)


def _row(view: View, split: str, fields: Sequence[Field]) -> dict[str, Any]:
    result = _result(view)
    numbers = {name: number for number, name in enumerate(result.objects, start=1)}
    named = list(_named(view, result))
    row: dict[str, Any] = {
        "run": view.run,
        "seed": result.seed,
        "split": split,
        "scenario": result.scenario_yaml,
        **{name: aims for name, (_, aims) in _aims(result).items()},
        "object_names": [name for name, _ in named],
        "object_numbers": [numbers.get(name, 0) for name, _ in named],
        "object_shapes": [one.shape for _, one in named],
        "object_files": ["" if one.file is None else one.file.name for _, one in named],
        "object_poses": np.array([one.poses for _, one in named]).ravel(),
    }
    for one in fields:
        if one.name in row:
            continue
        if one.name not in result or result.shape != one.shape:
            raise InputError(
                f"run {view.run} differs from the first in its size or has no layer {one.name!r}.",
                remedy="Give all runs one scan and one output, or make a data set of each kind.",
            )
        row[one.name] = _plain(result[one.name].ravel(), one.kind)
    return row


def _named(view: View, result: RangeImage | ShotTable) -> Iterator[tuple[str, ViewedObject]]:
    """Yield the objects of a view by name, each with those of its parts that have numbers of their own in the mask."""
    numbers = np.unique(result["truth.object"]) if any(one.in_parts for one in view.objects) else np.zeros(0)
    seen = [result.objects[int(number) - 1] for number in numbers if number > 0]
    for one in view.objects:
        yield one.name, one
        yield from ((name, one) for name in seen if one.in_parts and is_label_of_part(name, one.name))


def _plain(values: NDArray[np.float32], kind: str) -> NDArray[Any]:
    # One NaN for all: its sign depends on the processor.
    return (
        np.where(np.isnan(values), np.float32(np.nan), values) if kind == "float32" else values.astype(kind)
    )


def _result(view: View) -> RangeImage | ShotTable:
    if view.scenario.scan.layout == "image":
        return read_range_image(view.folder / RUN.result)
    return read_shots(view.folder)


def _aims(result: RangeImage | ShotTable) -> dict[str, tuple[str, NDArray[np.float64]]]:
    """Return where the beam goes by the names of columns, with what each means."""
    if isinstance(result, ShotTable):
        times = {"time_s": result.time, "theta_rad": result.theta, "phi_rad": result.phi}
        return {name: (COLUMN[name].meaning, values) for name, values in times.items()}
    return {
        "theta_rad": ("deflection to the right of each column", result.theta),
        "phi_rad": ("deflection downwards of each row", result.phi),
    }
