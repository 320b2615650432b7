"""Small tables: ruled and coloured on a terminal, plain in a pipe."""

from __future__ import annotations

import re
import sys
from collections.abc import Collection, Mapping, Sequence

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from scanner_sim.foundation.errors import printable


def named_files(names: Sequence[str]) -> str:
    """Return names of files in a line; of those that are numbered, the first and the last."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(re.sub(r"\d{3,}", "#", name), []).append(name)
    return ", ".join(" … ".join(dict.fromkeys((group[0], group[-1]))) for group in groups.values())


def print_table(rows: Mapping[str, str]) -> None:
    """Print pairs of a word and a phrase on the standard output stream."""
    rows = {printable(word): printable(phrase) for word, phrase in rows.items()}
    table = Table.grid(padding=(0, 2))
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for word, phrase in rows.items():
        # As Text: a path may hold brackets, which rich takes for its markup.
        table.add_row(Text(word), Text(phrase))
    if sys.stdout.isatty():
        Console().print(table)
        return
    width = max(map(len, rows), default=0)
    for word, phrase in rows.items():
        typer.echo(f"{word:<{width}}  {phrase}")


def print_rows(rows: Sequence[Sequence[str]], left: Collection[int] = (0,)) -> None:
    """Print a table on the standard output stream.

    Parameters
    ----------
    rows
        The heading and then the lines, all of one length.
    left
        Columns that are aligned to the left; the others stand to the right.
    """
    rows = [[printable(cell) for cell in row] for row in rows]
    if sys.stdout.isatty():
        heading, *body = rows
        table = Table()
        for column, name in enumerate(heading):
            table.add_column(Text(name), justify="left" if column in left else "right")
        for row in body:
            table.add_row(*map(Text, row))
        Console().print(table)
        return
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (
            cell.ljust(width) if column in left else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        typer.echo("  ".join(cells).rstrip())
