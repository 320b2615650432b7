"""Results on the disk: one file and one picture for each item, whole or not there."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from pydantic import TypeAdapter

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.named_files import LARGEST_TEXT, open_ordinary, read_ordinary
from scanner_sim.products.files.exchange import Writers
from scanner_sim.products.files.folder import write_text
from scanner_sim.products.provenance import versions
from scanner_sim.validation.reproduce.item import Item, Outcome, Row, Task, Verdict

PAGE = "index.md"
"""The page that holds all of it."""

HEADING = "# Validation: the paper, made again\n\nWritten by `scanner-sim reproduce` from simulated data."
"""How it begins: by this it is known."""


@dataclass(frozen=True)
class Result:
    """A finished item: its comparisons, and what they were made with."""

    key: str
    rows: tuple[Row, ...]
    quick: bool
    seed: int
    date: str
    made_by: dict[str, str]

    def count(self, verdict: Verdict) -> int:
        """Return the number of rows with a verdict."""
        return sum(row.verdict is verdict for row in self.rows)


def picture_of(item: Item) -> str:
    """Return the name of an item's picture."""
    return f"{item.key}.png"


def file_of(item: Item) -> str:
    """Return the name of an item's result."""
    return f"{item.key}.json"


def read_result(folder: Path, item: Item) -> Result | None:
    """Return the result of an item; None where it is not there, is broken, or lacks its picture."""
    path = folder / file_of(item)
    if not path.is_file() or not (folder / picture_of(item)).is_file():
        return None
    try:
        result = TypeAdapter(Result).validate_json(read_ordinary(path, LARGEST_TEXT))
    except (ValueError, InputError):
        return None
    return result if result.key == item.key else None


def serves(result: Result | None, task: Task) -> bool:
    """Return whether a result is what a task asks for: whole where a whole one is wanted, same seed and versions."""
    if result is None or result.seed != task.seed or result.made_by != dict(versions()):
        return False
    return task.quick or not result.quick


def result_of(item: Item, task: Task, outcome: Outcome) -> Result:
    """Return the result of an item that was made today."""
    date = datetime.now(UTC).strftime("%Y-%m-%d")
    return Result(item.key, outcome.rows, task.quick, task.seed, date, dict(versions()))


def writers_of(result: Result, item: Item, outcome: Outcome) -> Writers:
    """Return what writes an item's picture and its result."""
    text = json.dumps(asdict(result), indent=1, ensure_ascii=False) + "\n"
    return {picture_of(item): outcome.draw, file_of(item): lambda path: write_text(path, text)}


def refuse_strangers(folder: Path, items: Iterable[Item]) -> None:
    """Check that where there are files with the names of ours, the page is ours too, and so all of them.

    Raises
    ------
    InputError
        If it was not.
    """
    heading = HEADING.encode()
    with contextlib.suppress(InputError), open_ordinary(folder / PAGE, LARGEST_TEXT) as (stream, _):
        if stream.read(len(heading)) == heading:
            return
    names = (PAGE, *(name for item in items for name in (picture_of(item), file_of(item))))
    strangers = [name for name in names if os.path.lexists(folder / name)]
    if strangers:
        raise InputError(
            f"{folder} holds {', '.join(strangers)} but no page of this program: these are not ours to replace.",
            remedy="Move them away, or name another folder with -o.",
        )
