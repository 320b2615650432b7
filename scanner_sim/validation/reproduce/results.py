"""Results on the disk: one file and one picture for each item, whole or not there."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
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


@dataclass(frozen=True)
class Result:
    """A finished item: its comparisons, and what they were made with."""

    key: str
    rows: tuple[Row, ...]
    quick: bool
    seed: int
    date: str
    made_by: dict[str, str]
    drawn: bool = True

    def count(self, verdict: Verdict) -> int:
        """Return the number of rows with a verdict."""
        return sum(row.verdict is verdict for row in self.rows)


@dataclass(frozen=True)
class Book:
    """Items that stand on one page.

    Attributes
    ----------
    page
        The file that holds all of it.
    heading
        How it begins: by this it is known.
    items
        In the order of the page.
    text
        Makes the page of items and of those results that are there.
    """

    page: str
    heading: str
    items: tuple[Item, ...]
    text: Callable[[Sequence[Item], Mapping[str, Result]], str]


def picture_of(item: Item) -> str:
    """Return the name of an item's picture."""
    return f"{item.key}.png"


def file_of(item: Item) -> str:
    """Return the name of an item's result."""
    return f"{item.key}.json"


def read_result(folder: Path, item: Item) -> Result | None:
    """Return the result of an item; None where it is not there, is broken, or lacks its picture."""
    path = folder / file_of(item)
    if not path.is_file():
        return None
    try:
        result = TypeAdapter(Result).validate_json(read_ordinary(path, LARGEST_TEXT))
    except (ValueError, InputError):
        return None
    if result.key != item.key or (result.drawn and not (folder / picture_of(item)).is_file()):
        return None
    return result


def serves(result: Result | None, item: Item, task: Task) -> bool:
    """Return whether a result is what a task asks for: whole where a whole one is wanted, same seed and inputs."""
    if result is None or item.copied or result.seed != task.seed or result.made_by != _made_by(item):
        return False
    return task.quick or not result.quick


def result_of(item: Item, task: Task, outcome: Outcome) -> Result:
    """Return the result of an item that was made today."""
    date = datetime.now(UTC).strftime("%Y-%m-%d")
    drawn = outcome.draw is not None
    return Result(item.key, outcome.rows, task.quick, task.seed, date, _made_by(item), drawn)


def _made_by(item: Item) -> dict[str, str]:
    return {**versions(), **item.inputs}


def writers_of(result: Result, item: Item, outcome: Outcome) -> Writers:
    """Return what writes an item's picture and its result."""
    text = json.dumps(asdict(result), indent=1, ensure_ascii=False) + "\n"
    picture = {} if outcome.draw is None else {picture_of(item): outcome.draw}
    return {**picture, file_of(item): lambda path: write_text(path, text)}


def refuse_strangers(folder: Path, book: Book, items: Sequence[Item]) -> None:
    """Check that where there are files with the names of ours, the page is ours too, and so all of them.

    Raises
    ------
    InputError
        If it was not.
    """
    heading = book.heading.encode()
    with contextlib.suppress(InputError), open_ordinary(folder / book.page, LARGEST_TEXT) as (stream, _):
        if stream.read(len(heading)) == heading:
            return
    names = (book.page, *(name for item in items for name in (picture_of(item), file_of(item))))
    strangers = [name for name in names if os.path.lexists(folder / name)]
    if strangers:
        raise InputError(
            f"{folder} holds {', '.join(strangers)} but no page of this program: these are not ours to replace.",
            remedy="Move them away, or name another folder with -o.",
        )
