"""The folder of a campaign: what it is of, and a row for each run that is done.

================  ==================================================================================================
``campaign.json``  the plan, its axes and measures, versions, digests of the files that scenarios name, their commits
``base.yaml``      the base scenario, resolved
``rows.jsonl``     rows as they come, one to a line
``parts/``         the same rows as Parquet, so many to a part; what is in a part leaves ``rows.jsonl``
``runs/``          whole results of the runs that are kept
================  ==================================================================================================

A row counts once its line is written: who kills the program loses the runs in flight and nothing else. A line that was
cut off is not read, and a run that stands in a part and in ``rows.jsonl`` too is one run.
"""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from scanner_sim.campaign.inputs import commits_of, digests_of
from scanner_sim.campaign.measures import MEASURES
from scanner_sim.campaign.plan import Plan
from scanner_sim.campaign.runs import Campaign, dimension_of
from scanner_sim.config import resolved_yaml
from scanner_sim.config.document import Value
from scanner_sim.config.load import load_stored
from scanner_sim.config.scenario import Scenario
from scanner_sim.config.wording import inline_yaml
from scanner_sim.foundation.errors import InputError, RunError
from scanner_sim.foundation.named_files import read_ordinary
from scanner_sim.foundation.units import FROM_FILE, Dimension
from scanner_sim.products.files.exchange import failure, held, unwritable, write_files
from scanner_sim.products.files.folder import write_text
from scanner_sim.products.files.tables import Table, read_parquet, texts, write_parquet
from scanner_sim.products.json_text import json_text
from scanner_sim.products.provenance import versions

MANIFEST, BASE, ROWS, PARTS, KEPT = "campaign.json", "base.yaml", "rows.jsonl", "parts", "runs"
PART_ROWS = 1000
"""Rows of a part."""
_LARGEST_ROWS = 1 << 30
"""Bytes of a file of rows."""
_SAME = {
    "plan": "plan",
    "measures": "list of measures",
    "versions": "version of the program",
    "inputs": "content of its files",
}
"""Entries of the manifest in which rows of one folder must agree, and the word for each."""


@dataclass(frozen=True)
class Row:
    """What is kept of a run.

    Attributes
    ----------
    run, seed
        Its number, and the seed of its random numbers.
    fault
        Why there is no result; empty where there is one.
    seconds
        Time that it took [s].
    measures
        What was measured, by name; NaN where there was nothing to measure.
    """

    run: int
    seed: int
    fault: str
    seconds: float
    measures: Mapping[str, float]


class Store:
    """The folder of a campaign; see the heading of this module.

    Parameters
    ----------
    folder
        The folder; it exists and holds ``campaign.json``.
    campaign
        What it is of.
    measures
        Names of the measures, in the order of the columns.
    """

    def __init__(self, folder: Path, campaign: Campaign, measures: Sequence[str]) -> None:
        self.folder, self.campaign, self.measures = folder, campaign, tuple(measures)
        self.done: NDArray[np.bool_] = np.zeros(len(campaign), dtype=np.bool_)
        """Whether each run has a row."""
        self.failed = 0
        """Number of runs whose row has a fault."""
        self._waiting: list[Row] = []
        self._parts = 0
        self._stream: BinaryIO | None = None
        self._read()

    def rows(self) -> Iterator[Table]:
        """Yield the rows as tables, part by part."""
        for path in _part_files(self.folder):
            yield read_parquet(path)[0]
        if self._waiting:
            yield self._table(self._waiting)

    def add(self, row: Row) -> None:
        """Write a row.

        Raises
        ------
        RunError
            If the disk is full or fails; the rows before stay.
        """
        if self.done[row.run]:
            return
        line = json.dumps(
            {
                "run": row.run,
                "seed": row.seed,
                "fault": row.fault,
                "seconds": row.seconds,
                "measures": {name: _finite(value) for name, value in row.measures.items()},
            }
        )
        try:
            if self._stream is None:
                self._stream = self._journal()
            self._stream.write(line.encode() + b"\n")
            self._stream.flush()
        except OSError as error:
            raise disk_fault(self.folder, error) from None
        self._keep(row)
        if len(self._waiting) >= PART_ROWS:
            self.pack()

    def pack(self) -> None:
        """Write the rows that are in no part yet as one; faults as of :meth:`add`."""
        if not self._waiting:
            return
        try:
            (self.folder / PARTS).mkdir(exist_ok=True)
            path = self.folder / PARTS / f"part-{self._parts:06d}.parquet"
            rows = sorted(self._waiting, key=lambda row: row.run)
            partial = path.with_suffix(".partial")
            write_parquet(partial, self._table(rows), self._about())
            with partial.open("rb") as written:
                os.fsync(written.fileno())
            partial.replace(path)
            self._parts += 1
            self._waiting = []
            self.close()
            with (self.folder / ROWS).open("wb"):
                pass
        except OSError as error:
            raise disk_fault(self.folder, error) from None

    def close(self) -> None:
        """Close the file of rows."""
        if self._stream is not None:
            with contextlib.suppress(OSError):
                self._stream.close()
            self._stream = None

    def _journal(self) -> BinaryIO:
        """Return the file of rows, open at the end of its last whole line."""
        path = self.folder / ROWS
        stream = path.open("r+b" if path.exists() else "w+b")
        stream.seek(0)
        content = stream.read()
        stream.seek(content.rfind(b"\n") + 1)
        stream.truncate()
        return stream

    def _read(self) -> None:
        """Take in what there is: parts first, then rows that are in none."""
        for path in _part_files(self.folder):
            table, _ = read_parquet(path)
            runs = table["run"]
            if not ((runs >= 0) & (runs < len(self.done))).all():
                raise InputError(f"{path} has runs that this campaign has not.", remedy="Remove that file.")
            self.done[runs] = True
            self.failed += int(np.count_nonzero(table["fault"] != ""))
            self._parts = int(path.stem.rpartition("-")[2]) + 1
        path = self.folder / ROWS
        if path.exists():
            for line in read_ordinary(path, _LARGEST_ROWS).split(b"\n")[:-1]:
                row = _row(line, self.measures)
                if row is not None and 0 <= row.run < len(self.done) and not self.done[row.run]:
                    self._keep(row)

    def _keep(self, row: Row) -> None:
        self.done[row.run] = True
        self.failed += bool(row.fault)
        self._waiting.append(row)

    def _table(self, rows: Sequence[Row]) -> Table:
        """Return rows as columns: number, place on each axis, values of the keys, outcome, measures."""
        campaign = self.campaign
        places = np.array([campaign.place(row.run) for row in rows], dtype=np.int64)
        values = [campaign.values(row.run) for row in rows]
        table: Table = {"run": np.array([row.run for row in rows], dtype=np.int64)}
        table |= {f"axis_{number}": places[:, number] for number in range(places.shape[1] - 1)}
        table["repeat"] = places[:, -1]
        for key in keys_of(campaign):
            table[key] = column_of(campaign, key, [one[key] for one in values])
        table["seed"] = np.array([row.seed for row in rows], dtype=np.int64)
        table["fault"] = texts([row.fault for row in rows])
        table["seconds"] = np.array([row.seconds for row in rows])
        for name in self.measures:
            table[name] = np.array([row.measures.get(name, math.nan) for row in rows], dtype=np.float64)
        return table

    def _about(self) -> dict[str, object]:
        return {"title": "campaign", "units": units_of(self.campaign, self.measures), "versions": versions()}


def keys_of(campaign: Campaign) -> tuple[str, ...]:
    """Return the keys that vary, in the order of the plan."""
    return tuple(key for group in campaign.plan.vary for key in group.keys)


def columns_of_runs(campaign: Campaign) -> tuple[str, ...]:
    """Return the names of the columns that stand beside the measures."""
    axes = (f"axis_{number}" for number in range(len(campaign.plan.vary)))
    return ("run", *axes, "repeat", *keys_of(campaign), "seed", "fault", "seconds")


def is_number(campaign: Campaign, key: str) -> bool:
    """Tell whether all values of a key are numbers, so that its column is one of numbers."""
    values = next(group.keys[key] for group in campaign.plan.vary if key in group.keys)
    dimension = dimension_of(campaign.base, key)
    return values.list is None or all(_is_quantity(value, dimension) for value in values.list)


def _is_quantity(value: Value, dimension: Dimension | None) -> bool:
    """Tell whether a value is a number, or spells one: ``infinity`` and ``ideal`` stand where lengths and angles do."""
    if isinstance(value, str) and dimension is not None:
        with contextlib.suppress(ValueError):
            dimension.parse(value)
            return True
    return isinstance(value, int | float) and not isinstance(value, bool)


def column_of(campaign: Campaign, key: str, values: Sequence[Value]) -> NDArray[Any]:
    """Return values of a key as a column: numbers in SI units, or all as texts."""
    if not is_number(campaign, key):
        return texts([inline_yaml(value) for value in values])
    dimension = dimension_of(campaign.base, key)
    return np.array(
        [dimension.parse(value) if isinstance(value, str) and dimension else value for value in values],
        dtype=np.float64,
    )


def units_of(campaign: Campaign, measures: Sequence[str]) -> dict[str, str]:
    """Return the unit of each column that has one."""
    units = {"seconds": "s"} | {name: MEASURES[name].unit for name in measures if name in MEASURES}
    for key in keys_of(campaign):
        dimension = dimension_of(campaign.base, key)
        units |= {key: dimension.unit} if dimension is not None and is_number(campaign, key) else {}
    return units


@contextlib.contextmanager
def opened(folder: Path, campaign: Campaign, measures: Sequence[str]) -> Iterator[Store]:
    """Give the folder of a campaign, made or found as it was left, and let nobody else write to it.

    Raises
    ------
    InputError
        If it holds something else, another campaign, or one that somebody works on; if it cannot be written to.
    RunError
        If the disk fails.
    """
    wanted = _manifest(campaign, measures)
    try:
        with held(folder):
            if (folder / MANIFEST).exists():
                _check_same(folder, wanted, campaign.base)
            elif any(not path.name.startswith(".") for path in folder.iterdir()):
                raise InputError(f"{folder} holds other files.", remedy="Choose another folder with -o.")
            else:
                base = resolved_yaml(campaign.base)
                write_files(
                    folder,
                    {
                        BASE: lambda path: write_text(path, base),
                        MANIFEST: lambda path: write_text(path, json_text(wanted)),
                    },
                )
            store = Store(folder, campaign, measures)
            try:
                yield store
            finally:
                store.close()
    except OSError as error:
        raise unwritable(folder, error) from None


def reopened(folder: Path) -> Store:
    """Return the campaign in a folder, to look at.

    Raises
    ------
    InputError
        If there is none, or its files are broken.
    """
    if not (folder / MANIFEST).exists():
        raise InputError(f"There is no {MANIFEST} in {folder}.", remedy="Name the folder of a campaign.")
    try:
        said = json.loads(read_ordinary(folder / MANIFEST, _LARGEST_ROWS))
        measures = tuple(str(name) for name in said["measures"])
        plan = Plan.model_validate(said["plan"], context={**FROM_FILE, "folder": folder.absolute()})
        plan_folder = Path(str(said["folder"]))
    except (ValueError, KeyError, TypeError, ValidationError) as error:
        raise _damaged(folder, error) from None
    return Store(folder, Campaign(plan, load_stored(folder / BASE), plan_folder), measures)


def _damaged(folder: Path, error: Exception) -> InputError:
    reason = str(error).partition("\n")[0]
    return InputError(f"{folder / MANIFEST} is damaged: {reason}.")


def disk_fault(folder: Path, error: OSError) -> RunError:
    """Return the fault of a disk that failed while rows came."""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return RunError(
            f"The disk that holds {folder.absolute()} is full; every row before stays.",
            remedy="Make room; the same command goes on.",
        )
    return failure(folder, error)


def _manifest(campaign: Campaign, measures: Sequence[str]) -> dict[str, object]:
    """Return what ``campaign.json`` holds."""
    plan = campaign.plan.model_dump(mode="json", by_alias=True, exclude_defaults=True)
    inputs = digests_of(campaign)
    return {
        "schema": 1,
        "plan": {"schema": 1, **plan, "base": BASE, "set": {}},
        "folder": str(campaign.folder),
        "runs": len(campaign),
        "shape": list(campaign.plan.shape),
        "axes": [*axis_names(campaign.plan), "repeat"],
        "measures": list(measures),
        "units": units_of(campaign, measures),
        "versions": versions(),
        "inputs": inputs,
        "commits": commits_of(campaign, inputs),
    }


def axis_names(plan: Plan) -> list[str]:
    """Return the names of the groups' axes: of a single key its own, of several ``group_0`` and so on."""
    return [
        next(iter(group.keys)) if len(group.keys) == 1 else f"group_{number}"
        for number, group in enumerate(plan.vary)
    ]


def _check_same(folder: Path, wanted: Mapping[str, object], base: Scenario) -> None:
    """Raise an InputError if a folder holds another campaign than the one that is wanted."""
    try:
        found = dict(json.loads(read_ordinary(folder / MANIFEST, _LARGEST_ROWS)))
    except (ValueError, TypeError) as error:
        raise _damaged(folder, error) from None
    wanted = json.loads(json_text(wanted))
    for key, word in _SAME.items():
        if found.get(key) != wanted[key]:
            raise InputError(
                f"{folder} holds a campaign with another {word}.", remedy="Choose another folder with -o."
            )
    if load_stored(folder / BASE) != base:
        raise InputError(
            f"{folder} holds a campaign of another base scenario.", remedy="Choose another folder with -o."
        )


def _part_files(folder: Path) -> list[Path]:
    return sorted((folder / PARTS).glob("part-*.parquet"))


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _row(line: bytes, measures: Sequence[str]) -> Row | None:
    """Return the row of a line; None where it is none, because a disk was full or a machine lost its power."""
    try:
        said = json.loads(line)
        found = said["measures"]
        values = {name: math.nan if found.get(name) is None else float(found[name]) for name in measures}
        return Row(int(said["run"]), int(said["seed"]), str(said["fault"]), float(said["seconds"]), values)
    except (ValueError, KeyError, TypeError, AttributeError):
        return None
