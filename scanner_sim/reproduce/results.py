"""Results on the disk: one file and one picture for each item, whole or not there."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from scanner_sim.errors import InputError, RunError
from scanner_sim.products.provenance import versions
from scanner_sim.reproduce.item import Item, Outcome, Row, Task, Verdict

PAGE = "index.md"
"""The page that holds all of it."""


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


def read_result(folder: Path, item: Item) -> Result | None:
    """Return the result of an item; None where it is not there, is broken, or lacks its picture."""
    path = folder / f"{item.key}.json"
    if not path.is_file() or not (folder / picture_of(item)).is_file():
        return None
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        rows = tuple(Row(**{**row, "verdict": Verdict(row["verdict"])}) for row in found.pop("rows"))
        return Result(rows=rows, **found)
    except (ValueError, TypeError, KeyError, AttributeError):
        return None


def serves(result: Result | None, task: Task) -> bool:
    """Return whether a result is what a task asks for: whole where a whole one is wanted, same seed and versions."""
    if result is None or result.seed != task.seed or result.made_by != dict(versions()):
        return False
    return task.quick or not result.quick


def write_result(folder: Path, item: Item, task: Task, outcome: Outcome) -> Result:
    """Write an item's picture and, when that is in place, its result.

    Raises
    ------
    RunError
        If the disk fails.
    """
    date = datetime.now(UTC).strftime("%Y-%m-%d")
    result = Result(item.key, outcome.rows, task.quick, task.seed, date, dict(versions()))
    text = json.dumps(asdict(result), indent=1, ensure_ascii=False) + "\n"
    try:
        half = folder / f".{picture_of(item)}"
        outcome.draw(half.with_suffix(".half.png"))
        os.replace(half.with_suffix(".half.png"), folder / picture_of(item))
        write_whole(folder / f"{item.key}.json", text)
    except OSError as error:
        raise RunError(f"{folder} cannot be written to: {error.strerror}.") from error
    return result


def write_whole(path: Path, text: str) -> None:
    """Write a text so that the file is there whole or not at all."""
    half = path.with_name(f".{path.name}.half")
    half.write_text(text, encoding="utf-8")
    os.replace(half, path)


def make_folder(folder: Path) -> None:
    """Make the folder of the results.

    Raises
    ------
    InputError
        If it cannot be.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder} cannot be made: {error.strerror}.", remedy="Name another folder with -o."
        ) from error
