"""The verb ``convert``."""

from __future__ import annotations

from pathlib import Path

from scanner_sim.cli.call import files_of
from scanner_sim.cli.progress import progress_bar
from scanner_sim.cli.tables import print_table
from scanner_sim.products.formats.convert import convert


def convert_result(
    result: Path, to: list[str], output: Path | None, *, by: str, overwrite: bool, quiet: bool
) -> None:
    """Write the points of a result in some formats, and say where.

    Raises
    ------
    ScannerSimError
        As :func:`~scanner_sim.products.formats.convert.convert`.
    """
    beside = result if result.is_dir() else result.parent
    with progress_bar("writing", quiet, "files") as (advance, _):
        paths = convert(result, output or beside, to, by=by, overwrite=overwrite, progress=advance)
    if not quiet:
        print_table(files_of(paths))
