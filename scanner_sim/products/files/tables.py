"""Tables of named columns, as CSV for people and as Parquet for programs."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import Field, asdict, fields
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol, TypeAlias, TypeVar

import numpy as np
import pyarrow
import pyarrow.compute
import pyarrow.parquet
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.named_files import read_ordinary
from scanner_sim.products.files.exchange import recover

T = TypeVar("T")

Column: TypeAlias = NDArray[Any]
"""A column of shape (rows,): float64, integers or texts (dtype object)."""
Columns: TypeAlias = Mapping[str, Column]
"""Columns by name."""
Table: TypeAlias = dict[str, Column]
"""Columns by name, of a table that is being made."""

ABOUT = b"scanner_sim"
"""Key of the metadata that hold what the table is about."""


MOST_CELLS = 1 << 28
"""Rows times columns of a table that is read: packed they may be next to nothing."""
MOST_LETTERS = 1000
"""Bytes of a text in a table."""
_LARGEST = 1 << 32
"""Bytes of a file."""
MOST = 1e30
"""Size of a number that has any sense."""

ColumnKind = Literal["any", "number", "finite", "whole", "text"]
"""What a column holds: float64 of any size, of some sense or NaN, or without NaN; integers; texts."""


class Record(Protocol):
    """Any dataclass."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]


def table_csv(columns: Columns) -> str:
    """Return a table with a heading; floats with twelve digits, nothing for NaN."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(columns)
    table.writerows(zip(*(_spell(values) for values in columns.values()), strict=True))
    return text.getvalue()


def records_csv(rows: Sequence[Record]) -> str:
    """Return dataclasses of one kind as a table, a column for each field; floats as :func:`six_digits`."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    if rows:
        table.writerow(field.name for field in fields(rows[0]))
    for row in rows:
        values = asdict(row).values()
        table.writerow([six_digits(value) if isinstance(value, float) else value for value in values])
    return text.getvalue()


def six_digits(value: float) -> str:
    """Return a number with six digits, nothing for NaN."""
    return "" if math.isnan(value) else f"{value:.6g}"


def write_parquet(path: Path, columns: Columns, about: Mapping[str, object]) -> None:
    """Write a table as Parquet; the same table gives the same bytes.

    Parameters
    ----------
    path
        The file; it is overwritten.
    columns
        The table. NaN stays NaN.
    about
        What can be said as JSON: it goes into the metadata of the schema under the key ``scanner_sim``.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    table = pyarrow.table({name: _array(values) for name, values in columns.items()})
    read_about = json.dumps(about, ensure_ascii=False, allow_nan=False)
    table = table.replace_schema_metadata({ABOUT: read_about.encode()})
    # Through memory: on a full disk the error is then the operating system's, with its code.
    stream = io.BytesIO()
    pyarrow.parquet.write_table(table, stream, compression="zstd")
    path.write_bytes(stream.getvalue())


def read_parquet(path: Path) -> tuple[Table, object]:
    """Return the columns and what was said of them, as :func:`write_parquet` took them.

    Raises
    ------
    InputError
        If the file is missing, broken, not one of ours, or would take more memory than any run's table.
    """
    content = read_ordinary(path, _LARGEST)
    try:
        # One thread reads in one order: a broken file is then refused for the same reason each time.
        file = pyarrow.parquet.ParquetFile(pyarrow.BufferReader(content))
        schema = file.schema_arrow
        about = json.loads((schema.metadata or {})[ABOUT])
        _check_size(file.metadata, schema)
        # Texts as they are packed, each once: a hundred kilobytes may stand for twenty gigabytes of them.
        words = [field.name for field in schema if pyarrow.types.is_string(field.type)]
        file = pyarrow.parquet.ParquetFile(pyarrow.BufferReader(content), read_dictionary=words)
        table = file.read(use_threads=False)
        columns = {name: _unpack(table[name], name in words) for name in schema.names}
    except KeyError:
        raise InputError(
            f"{path} was not written by this program.", remedy="Name the folder of a run."
        ) from None
    except (OSError, pyarrow.ArrowException, ValueError, TypeError, MemoryError, RecursionError) as error:
        reason = str(error).partition("\n")[0].rstrip(".")
        raise InputError(f"{path} cannot be read as Parquet: {reason}.") from None
    return columns, about


def read_result(folder: Path, name: str, kind: str) -> tuple[Table, object]:
    """Return as :func:`read_parquet` the table that makes a folder a result, once a broken-off writing is finished.

    Raises
    ------
    InputError
        As there, or if there is none: the remedy names the ``kind`` of folder.
    """
    try:
        recover(folder)
        present = (folder / name).exists()
    except (OSError, ValueError):  # a name that no system takes
        present = False
    if not present:
        raise InputError(f"There is no {name} in {folder}.", remedy=f"Name the folder of {kind}.")
    return read_parquet(folder / name)


def _check_size(metadata: pyarrow.parquet.FileMetaData, schema: pyarrow.Schema) -> None:
    """Refuse nested columns, two of one name, and more cells than a run has."""
    plain = (pyarrow.types.is_floating, pyarrow.types.is_integer, pyarrow.types.is_string)
    if len(set(schema.names)) < len(schema.names) or not all(
        any(fits(field.type) for fits in plain) for field in schema
    ):
        raise ValueError("its columns are no plain numbers and texts, each with a name of its own")
    if metadata.num_rows * max(metadata.num_columns, 1) > MOST_CELLS:
        raise ValueError(f"{metadata.num_rows} rows of {metadata.num_columns} columns are too many")


def _unpack(column: pyarrow.ChunkedArray, text: bool) -> Column:
    """Return a column, its texts in full where none is longer than any of ours."""
    if not text:
        return np.asarray(column.to_numpy())
    for part in column.chunks:
        longest = pyarrow.compute.max(pyarrow.compute.binary_length(part.dictionary)).as_py()
        if longest is not None and longest > MOST_LETTERS:
            raise ValueError(f"a text has {longest} bytes")
    return np.asarray(column.cast(pyarrow.string()).to_numpy())


def check_columns(columns: Columns, kinds: Mapping[str, ColumnKind]) -> Table:
    """Return the columns of a table that are wanted, each of its kind.

    Raises
    ------
    ValueError
        If one is missing or of another kind, or has numbers that no run has.
    """
    for name, kind in kinds.items():
        values = columns.get(name)
        if values is None:
            raise ValueError(f"the column {name} is missing")
        if kind == "text":
            good = values.dtype == object and all(isinstance(value, str) for value in values)
        elif kind == "whole":
            good = values.dtype.kind in "iu"
        else:
            good = values.dtype == np.float64
            good = good and (kind == "any" or not (np.abs(values) > MOST).any())
            good = good and (kind != "finite" or not np.isnan(values).any())
        if not good:
            raise ValueError(f"the column {name} holds something else than {_MEANT[kind]}")
    return {name: columns[name] for name in kinds}


def read_about(about: object, form: type[T]) -> T:
    """Return what is said of a table as a dataclass.

    Raises
    ------
    ValueError
        If something is missing or of another type; the message names the first.
    """
    try:
        return TypeAdapter(form).validate_python(about)
    except ValidationError as error:
        first = error.errors()[0]
        location = ".".join(str(step) for step in first["loc"])
        raise ValueError(f"{location or 'what is said of it'}: {first['msg']}") from None


_MEANT: Mapping[ColumnKind, str] = {
    "any": "numbers",
    "number": "numbers of any sense",
    "finite": "finite numbers",
    "whole": "whole numbers",
    "text": "texts",
}


def _spell(values: Column) -> list[str]:
    if values.dtype.kind == "f":
        return ["" if value != value else f"{value:.12g}" for value in values.tolist()]
    return [str(value) for value in values.tolist()]


def _array(values: Column) -> pyarrow.Array:
    if values.dtype == object:
        return pyarrow.array(values.tolist(), pyarrow.string())
    if values.dtype.kind == "f":
        # One NaN for all: its sign depends on the processor.
        values = np.where(np.isnan(values), np.asarray(np.nan, dtype=values.dtype), values)
    return pyarrow.array(np.ascontiguousarray(values))


def texts(values: list[str]) -> Column:
    """Return texts as a column."""
    return np.array(values, dtype=object)
