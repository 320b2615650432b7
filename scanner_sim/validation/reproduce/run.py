"""All items, one after the other, each kept when it is done."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from scanner_sim.foundation.errors import InputError
from scanner_sim.products.files.exchange import Writers, exchange, failure
from scanner_sim.products.files.folder import ResultFolder, claim_folder, write_text
from scanner_sim.validation.reproduce import (
    as_built,
    errors,
    images,
    poses,
    ranging,
    sunlight,
    tables,
    tracking,
)
from scanner_sim.validation.reproduce.item import Item, Task
from scanner_sim.validation.reproduce.page import HEADING, PAGE, page
from scanner_sim.validation.reproduce.results import (
    Book,
    Result,
    file_of,
    picture_of,
    read_result,
    refuse_strangers,
    result_of,
    serves,
    writers_of,
)

Progress = Callable[[int, int, str], None]
"""Called with the items done, the items in all, and the title of the next."""


def all_items() -> tuple[Item, ...]:
    """Return every item in the order of the paper's parts; their modules are loaded here."""
    items = (
        *ranging.ITEMS,
        *tables.ITEMS,
        *images.ITEMS,
        *tracking.ITEMS,
        *errors.ITEMS,
        *poses.ITEMS,
        *as_built.ITEMS,
        *sunlight.ITEMS,
    )
    return tuple(sorted(items, key=_place))


_KINDS = ("eq", "table", "fig")


def _place(item: Item) -> tuple[int, int, str]:
    """Return where an item stands on the page: equations, tables, figures, each by its number."""
    kind = next(kind for kind in _KINDS if item.key.startswith(kind))
    number = item.key.removeprefix(kind)
    return _KINDS.index(kind), int(number.rstrip("ab")), number


def paper() -> Book:
    """Return the paper's items and their page."""
    return Book(PAGE, HEADING, all_items(), page)


def chosen_items(items: Sequence[Item], only: Sequence[str]) -> tuple[Item, ...]:
    """Return the items with the given keys; all where none is given.

    Raises
    ------
    InputError
        If there is no such item.
    """
    named = {key: item for item in items for key in (item.key, *item.aliases)}
    for key in only:
        if key not in named:
            near = difflib.get_close_matches(key, named, n=1)
            raise InputError(
                f"there is no item {key!r}.",
                remedy=f"Did you mean {near[0]}?" if near else f"There are {', '.join(named)}.",
            )
    wanted = {named[key].key for key in only}
    return tuple(item for item in items if not only or item.key in wanted)


def reproduce(
    folder: Path,
    task: Task,
    *,
    only: Sequence[str] = (),
    anew: bool = False,
    progress: Progress | None = None,
    book: Book | None = None,
) -> dict[str, Result]:
    """Make items into a folder, and the page of all that is there.

    An item that is there already, from a run with the same seed and versions, is not made again; a run that was
    interrupted hence goes on where it was.

    Parameters
    ----------
    folder
        Where results, pictures and page go.
    task
        How the items are to be made.
    only
        Keys of the items; empty for all.
    anew
        Make them again even if they are there.
    progress
        Called before each item, and after the last.
    book
        The items and their page; the paper's by default.

    Returns
    -------
    dict
        The results of the chosen items by key.

    Raises
    ------
    InputError
        If a key is unknown, or the folder or the device cannot be used.
    RunError
        If the disk fails.
    """
    book = paper() if book is None else book
    chosen = chosen_items(book.items, only)
    with claim_folder(folder, True, ResultFolder(book.page, ())):
        refuse_strangers(folder, book, chosen)
        results = {item.key: found for item in book.items if (found := read_result(folder, item)) is not None}
        for number, item in enumerate(chosen):
            if progress is not None:
                progress(number, len(chosen), item.title)
            if anew or not serves(results.get(item.key), item, task):
                outcome = item.make(task)
                results[item.key] = result_of(item, task, outcome)
                _write(folder, book, results, item, writers_of(results[item.key], item, outcome))
        if progress is not None:
            progress(len(chosen), len(chosen), "")
        _write(folder, book, results)
    return {item.key: results[item.key] for item in chosen}


def _write(
    folder: Path,
    book: Book,
    results: Mapping[str, Result],
    item: Item | None = None,
    writers: Writers | None = None,
) -> None:
    """Write the files of an item, if any, together with the page that shows them."""
    text = book.text(book.items, results)
    mine = () if item is None else (picture_of(item), file_of(item))
    try:
        exchange(
            folder,
            {**(writers or {}), book.page: lambda path: write_text(path, text)},
            (*mine, book.page),
        )
    except OSError as error:
        raise failure(folder, error) from None
