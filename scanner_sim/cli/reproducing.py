"""The verb ``reproduce``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from scanner_sim.cli.progress import progress_bar
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.render.libraries import DeviceChoice


def reproduce_paper(
    folder: Path,
    only: Sequence[str],
    *,
    quick: bool,
    seed: int,
    device: DeviceChoice,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Make the paper's items into a folder, and print how each stands to the paper.

    Raises
    ------
    ScannerSimError
        If an item is unknown, the repository is not there, the folder or the device cannot be used, or the disk fails.
    """
    from scanner_sim.render.device import activate
    from scanner_sim.validation.reproduce import Task, Verdict, all_items, reproduce
    from scanner_sim.validation.reproduce.results import PAGE

    activate(device)
    task = Task(quick=quick, device=device, repository=repository(), seed=seed)
    with progress_bar("", quiet) as (advance, say):

        def step(done: int, total: int, title: str) -> None:
            say(title)
            advance(done, total)

        results = reproduce(folder, task, only=only, anew=overwrite, progress=step)
    if quiet:
        return
    titles = {item.key: item.title for item in all_items()}
    rows = [["item", "", *(str(verdict) for verdict in Verdict)]]
    rows += [
        [key, titles[key], *(str(result.count(verdict) or "–") for verdict in Verdict)]
        for key, result in results.items()
    ]
    print_rows(rows, left=(0, 1))
    print_table({"folder": str(folder), "page": PAGE})


def repository() -> Path:
    """Return the folder that holds the shipped scenarios: the working folder, or that of the package."""
    here = Path.cwd()
    return here if (here / "configs").is_dir() else Path(__file__).resolve().parents[2]
