"""Lines and waveforms in files: Parquet, a row for each voxel, written and read in parts of bounded memory."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pyarrow
import pyarrow.parquet
from numpy.typing import NDArray

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.named_files import open_ordinary
from scanner_sim.products.files.tables import ABOUT, read_about
from scanner_sim.products.signal_set import CLUSTERS, SignalAbout, SignalColumn, SignalSet, checked_columns

AnySet = TypeVar("AnySet", bound=SignalSet)

SAMPLES_TOGETHER = 1 << 22
"""Samples or pixels that are written or read together: bounds the memory."""
_ROWS = 2048
"""Voxels of a group of rows in a file."""
_MOST_CLUSTERS = 128
"""Clusters of a voxel: more than the light of any has."""
_MOST_SAMPLES = 1 << 16
_LARGEST = 1 << 40
"""Bytes of a file; it is never read as a whole."""


def voxels_together(samples: int) -> int:
    """Return how many voxels of so many samples or pixels are written or read together, whole groups of rows."""
    return _ROWS * max(SAMPLES_TOGETHER // (_ROWS * samples), 1)


def write_signals(path: Path, parts: Iterable[SignalSet]) -> None:
    """Write lines or waveforms part by part, each as it comes; the same parts give the same bytes.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    writer = None
    with path.open("wb") as stream:
        try:
            for part in parts:
                schema = _schema(part)
                if writer is None:
                    writer = pyarrow.parquet.ParquetWriter(
                        stream, schema, compression="zstd", use_dictionary=False, write_statistics=False
                    )
                arrays = [_packed(column, part) for column in _columns(part)]
                writer.write_table(pyarrow.table(arrays, schema=schema), row_group_size=_ROWS)
        finally:
            if writer is not None:
                writer.close()


def read_signals(path: str | Path, kind: type[AnySet]) -> AnySet:
    """Read all of a file of lines or waveforms.

    Parameters
    ----------
    path
        The file.
    kind
        :class:`~scanner_sim.products.lines.LineSet` or :class:`~scanner_sim.products.waveforms.WaveformSet`.

    Raises
    ------
    InputError
        If it is none, is damaged, or is of another version.
    """
    path, about = Path(path), read_signals_about(path, kind)
    parts = list(read_columns(path, kind, [column.name for column in kind.COLUMNS]))
    found: AnySet = _guarded(path, lambda: kind.joined([kind(part, about) for part in parts]))
    return found


def read_columns(
    path: Path, kind: type[SignalSet], names: Collection[str], together: int = _ROWS
) -> Iterator[dict[str, NDArray[Any]]]:
    """Yield some columns of a file of lines or waveforms, so many voxels together: whole groups of rows.

    Columns that no set needs to have may be missing. Faults as of :func:`read_signals`.
    """
    wanted = [column for column in kind.COLUMNS if column.name in names]
    with open_ordinary(path, _LARGEST) as (stream, _):
        file, _ = _open(path, stream, kind)
        groups, step = list(range(file.num_row_groups)), max(together // _ROWS, 1)
        for start in range(0, len(groups), step):
            some = groups[start : start + step]
            yield _guarded(path, partial(_part, file, some, wanted))


def read_signals_about(path: str | Path, kind: type[SignalSet]) -> SignalAbout:
    """Return what is said of a file of lines or waveforms; arguments and faults as of :func:`read_signals`."""
    with open_ordinary(Path(path), _LARGEST) as (stream, _):
        return _open(Path(path), stream, kind)[1]


def _open(path: Path, stream: Any, kind: type[SignalSet]) -> tuple[pyarrow.parquet.ParquetFile, SignalAbout]:
    file = _guarded(path, lambda: pyarrow.parquet.ParquetFile(stream))
    said = (file.schema_arrow.metadata or {}).get(ABOUT)
    what = kind.FORM.rpartition(",")[0]
    remedy = "Run its scenario again."
    if said is None:
        raise InputError(f"{path} was not written by this program.", remedy="Name the folder of a run.")
    about = _guarded(path, lambda: read_about(json.loads(said), SignalAbout))
    name, _, version = about.form.rpartition(",")
    if name != what:
        raise InputError(f"{path} holds no {what.split()[-1]}.", remedy="Name the folder of a run.")
    if about.form != kind.FORM:
        raise InputError(
            f"{path} has version {version.strip()} of its columns, and this program reads "
            f"{kind.FORM.rpartition(',')[2].strip()}.",
            remedy=remedy,
        )
    if not file.metadata.num_rows:
        raise InputError(f"{path} holds no voxels.", remedy=remedy)
    return file, about


def _guarded(path: Path, read: Callable[[], Any]) -> Any:
    """Return what is read; what a damaged file raises becomes one fault."""
    try:
        return read()
    except MemoryError:
        raise InputError(f"{path} needs more memory than there is.") from None
    except (OSError, pyarrow.ArrowException, ValueError, TypeError, KeyError, RecursionError) as error:
        reason = str(error).partition("\n")[0].rstrip(".")
        raise InputError(f"{path} is damaged: {reason}.", remedy="Run its scenario again.") from None


def _columns(part: SignalSet) -> list[SignalColumn]:
    return [column for column in part.COLUMNS if column.name in part]


def _schema(part: SignalSet) -> pyarrow.Schema:
    """Return names, types, units and meanings of the columns."""
    fields = []
    for column in _columns(part):
        one = pyarrow.from_numpy_dtype(part[column.name].dtype)
        sort = {
            "one": one,
            "vector": pyarrow.list_(one, 3),
            "samples": pyarrow.list_(one, part.samples),
            "clusters": pyarrow.list_(one),
        }[column.form]
        said = {"unit": column.unit, "meaning": column.meaning}
        fields.append(pyarrow.field(column.name, sort, nullable=False, metadata=said))
    about = json.dumps(asdict(part.about), ensure_ascii=False, allow_nan=False)
    return pyarrow.schema(fields, metadata={ABOUT: about.encode()})


def _packed(column: SignalColumn, part: SignalSet) -> pyarrow.Array:
    values = part[column.name]
    flat = np.ascontiguousarray(values.ravel())
    if flat.dtype.kind == "f":
        # One NaN for all: its sign depends on the processor.
        flat = np.where(np.isnan(flat), np.asarray(np.nan, dtype=flat.dtype), flat)
    items = pyarrow.array(flat)
    if column.form == "one":
        return items
    if column.form == "clusters":
        return pyarrow.ListArray.from_arrays(pyarrow.array(part.first_cluster.astype(np.int32)), items)
    return pyarrow.FixedSizeListArray.from_arrays(items, values.shape[1])


def _part(
    file: pyarrow.parquet.ParquetFile, groups: list[int], wanted: list[SignalColumn]
) -> dict[str, NDArray[Any]]:
    """Return columns of groups of rows, once it is sure that these are no larger than any of ours."""
    schema = file.schema_arrow
    if len(set(schema.names)) < len(schema.names):
        raise ValueError("two of its columns have one name")
    for group in groups:
        packed = file.metadata.row_group(group)
        if packed.num_rows > _ROWS:
            raise ValueError(f"{packed.num_rows} voxels stand together")
        numbers = max(packed.column(index).num_values for index in range(packed.num_columns))
        if numbers > packed.num_rows * _MOST_SAMPLES:
            raise ValueError("a voxel has more numbers than any of ours")
    columns = [column for column in wanted if column.name in schema.names]
    for column in columns:
        sort = schema.field(column.name).type
        if pyarrow.types.is_fixed_size_list(sort) and not 0 < sort.list_size <= _MOST_SAMPLES:
            raise ValueError(f"{sort.list_size} numbers stand in a row of the column {column.name}")
    table = file.read_row_groups(groups, columns=[column.name for column in columns], use_threads=False)
    found = {column.name: _unpacked(column, table[column.name]) for column in columns}
    return checked_columns(wanted, found)


def _unpacked(column: SignalColumn, found: pyarrow.ChunkedArray) -> NDArray[Any]:
    """Return the numbers of a column."""
    array, sort = found.combine_chunks(), found.type
    array = array.chunk(0) if isinstance(array, pyarrow.ChunkedArray) else array
    fits = {
        "one": lambda sort: not pyarrow.types.is_nested(sort),
        "clusters": pyarrow.types.is_list,
        "vector": pyarrow.types.is_fixed_size_list,
        "samples": pyarrow.types.is_fixed_size_list,
    }[column.form]
    if not fits(sort) or array.null_count:
        raise ValueError(f"the column {column.name} holds something else than its numbers")
    if column.form == "one":
        return _numbers(column, array)
    values = _numbers(column, array.flatten())
    return values if column.form == "clusters" else values.reshape(len(array), sort.list_size)


def _numbers(column: SignalColumn, array: pyarrow.Array) -> NDArray[Any]:
    if array.null_count or not (
        pyarrow.types.is_integer(array.type) or pyarrow.types.is_floating(array.type)
    ):
        raise ValueError(f"the column {column.name} holds something else than its numbers")
    values = np.asarray(array.to_numpy(zero_copy_only=False))
    if column.name == CLUSTERS and ((values < 0) | (values > _MOST_CLUSTERS)).any():
        raise ValueError("a voxel has more clusters than any of ours")
    return values
