"""Tables of named columns, as CSV for people and as Parquet for programs."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.errors import InputError

Columns = Mapping[str, NDArray[Any]]
"""Columns by name, each of shape (rows,): float64, integers or texts (dtype object)."""

_ABOUT = b"scanner_sim"
"""Key of the metadata that hold what the table is about."""


def table_csv(columns: Columns) -> str:
    """Return a table with a heading; floats with twelve digits, nothing for NaN."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(columns)
    table.writerows(zip(*(_spelt(values) for values in columns.values()), strict=True))
    return text.getvalue()


def records_csv(rows: Sequence[Any]) -> str:
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


def write_parquet(path: Path, columns: Columns, about: Mapping[str, Any]) -> None:
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
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.table({name: _array(values) for name, values in columns.items()})
    stated = json.dumps(about, ensure_ascii=False, allow_nan=False)
    table = table.replace_schema_metadata({_ABOUT: stated.encode()})
    # Through memory: on a full disk the error is then the operating system's, with its code.
    stream = io.BytesIO()
    pyarrow.parquet.write_table(table, stream, compression="zstd")
    path.write_bytes(stream.getvalue())


def read_parquet(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return the columns and what was said of them, as :func:`write_parquet` took them.

    Raises
    ------
    InputError
        If the file is missing, broken or not one of ours.
    """
    import pyarrow
    import pyarrow.parquet

    try:
        table = pyarrow.parquet.read_table(path)
        about = json.loads((table.schema.metadata or {})[_ABOUT])
    except (OSError, pyarrow.ArrowException, ValueError) as error:
        raise InputError(f"{path} cannot be read as Parquet: {error}.") from None
    except KeyError:
        raise InputError(
            f"{path} was not written by this program.", remedy="Name the folder of a run."
        ) from None
    return {name: table[name].to_numpy() for name in table.column_names}, about


def _spelt(values: NDArray[Any]) -> list[str]:
    if values.dtype.kind == "f":
        return ["" if value != value else f"{value:.12g}" for value in values.tolist()]
    return [str(value) for value in values.tolist()]


def _array(values: NDArray[Any]) -> Any:
    import pyarrow

    if values.dtype == object:
        return pyarrow.array(values.tolist(), pyarrow.string())
    if values.dtype.kind == "f":
        # One NaN for all: its sign depends on the processor.
        values = np.where(np.isnan(values), np.asarray(np.nan, dtype=values.dtype), values)
    return pyarrow.array(np.ascontiguousarray(values))


def texts(values: list[str]) -> NDArray[Any]:
    """Return texts as a column."""
    return np.array(values, dtype=object)
