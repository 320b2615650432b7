"""The verb ``reproduce``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from scanner_sim.cli.progress import progress_bar
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.render.libraries import DeviceChoice


def reproduce_book(
    folder: Path,
    only: Sequence[str],
    *,
    family: bool,
    quick: bool,
    seed: int,
    device: DeviceChoice,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Make the paper's items, or the ledger's, into a folder, and print how each stands to what is published.

    Raises
    ------
    ScannerSimError
        If an item is unknown, the repository is not there, the folder or the device cannot be used, or the disk fails.
    """
    from scanner_sim.render.device import activate
    from scanner_sim.validation.reproduce import Task, Verdict, reproduce
    from scanner_sim.validation.reproduce.family import book as ledger
    from scanner_sim.validation.reproduce.run import paper

    activate(device)
    book = ledger.family() if family else paper()
    task = Task(quick=quick, device=device, repository=repository(), seed=seed)
    with progress_bar("", quiet) as (advance, say):

        def step(done: int, total: int, title: str) -> None:
            say(title)
            advance(done, total)

        results = reproduce(folder, task, only=only, anew=overwrite, progress=step, book=book)
    if quiet:
        return
    titles = {item.key: item.title for item in book.items}
    shown = [verdict for verdict in Verdict if any(result.count(verdict) for result in results.values())]
    rows = [["item", "", *map(str, shown)]]
    rows += [
        [key, titles[key], *(str(result.count(verdict) or "–") for verdict in shown)]
        for key, result in results.items()
    ]
    print_rows(rows, left=(0, 1))
    print_table({"folder": str(folder), "page": book.page})


def repository() -> Path:
    """Return the folder that holds the shipped scenarios: the working folder, or that of the package."""
    here = Path.cwd()
    return here if (here / "configs").is_dir() else Path(__file__).resolve().parents[2]
