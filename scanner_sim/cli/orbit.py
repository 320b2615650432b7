"""The verb ``orbit``."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from scanner_sim.cli.report import scenario_of, warn
from scanner_sim.cli.tables import print_table
from scanner_sim.config import doubts, load_scenario
from scanner_sim.products.folder import check_target
from scanner_sim.products.timeline import ORBIT, Timeline, write_orbit
from scanner_sim.render.device import DeviceChoice

FOLDER = "{}_orbit"
"""Name of the output folder for that of a scenario."""


def orbit_scenario(
    config: Path,
    folder: Path,
    overrides: Sequence[str],
    *,
    steps: int,
    device: DeviceChoice,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Sweep one orbit of a scenario into a folder.

    Raises
    ------
    ScannerSimError
        If the scenario has no orbit, it, the folder or the device cannot be used, or the disk fails.
    """
    scenario = load_scenario(config, overrides)
    if not quiet:
        for sentence in doubts(scenario):
            warn(sentence)
    check_target(folder, overwrite, ORBIT)
    from scanner_sim.sweep import sweep_orbit

    with _progress(quiet) as advance, scenario_of(config):
        timeline = sweep_orbit(scenario, steps, device=device, progress=advance)
    paths = write_orbit(timeline, folder, overwrite=overwrite)
    if quiet:
        return
    for sentence in timeline.warnings:
        warn(sentence)
    _print_shares(timeline)
    eclipse = 100.0 * (1.0 - float(timeline.sun_visible.mean()))
    print_table(
        {
            "orbit": f"{timeline.period / 60.0:.1f} min in {timeline.times.size} steps, {eclipse:.1f} % in eclipse",
            "folder": str(folder),
            "files": ", ".join(path.name for path in paths),
        }
    )


def share_rows(timeline: Timeline) -> list[list[str]]:
    """Return the table of shares: a heading, then a line for each condition with each target and the estimate.

    An estimate that covers several conditions stands beside the first one.
    """
    beside = {group.conditions[0]: f"{group.estimate} {group.name}" for group in timeline.groups}
    shares = [timeline.shares(track) for track in timeline.tracks]
    rows = [["share of the orbit", *(track.name for track in timeline.tracks), "the paper"]]
    for number, label in enumerate(timeline.labels):
        values = (f"{100.0 * share[number]:.1f} %" for share in shares)
        rows.append([label.name, *values, beside.get(number, "")])
    return rows


def _print_shares(timeline: Timeline) -> None:
    """Print the table: ruled on a terminal, plain in a pipe."""
    heading, *rows = share_rows(timeline)
    if sys.stdout.isatty():
        table = Table()
        for column, name in enumerate(heading):
            table.add_column(Text(name), justify="right" if 0 < column < len(heading) - 1 else "left")
        for row in rows:
            table.add_row(*map(Text, row))
        Console().print(table)
        return
    widths = [max(map(len, column)) for column in zip(heading, *rows, strict=True)]
    for row in (heading, *rows):
        last = len(row) - 1
        cells = (
            cell.rjust(width) if 0 < column < last else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        typer.echo("  ".join(cells).rstrip())


@contextlib.contextmanager
def _progress(quiet: bool) -> Iterator[Callable[[int, int], None]]:
    """Show a bar on a terminal; give a function that takes the moments done and the moments in all."""
    console = Console(stderr=True)
    if quiet or not console.is_terminal:
        yield lambda done, total: None
        return
    from rich.progress import Progress

    with Progress(console=console, transient=True) as bar:
        task = bar.add_task("along the orbit", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
