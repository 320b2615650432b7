"""Small tables of a word and a phrase: coloured on a terminal, plain in a pipe."""

from __future__ import annotations

import sys
from collections.abc import Mapping

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text


def print_table(rows: Mapping[str, str]) -> None:
    """Print pairs of a word and a phrase on the standard output stream."""
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
