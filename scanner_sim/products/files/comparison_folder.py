"""The folder of a comparison."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from scanner_sim.products.comparison import Comparison, comparison_json
from scanner_sim.products.comparison_page import comparison_page
from scanner_sim.products.files.contents import COMPARISON
from scanner_sim.products.files.folder import write_folder, write_text
from scanner_sim.products.pictures.comparison import draw_comparison


def write_comparison(
    comparison: Comparison, folder: str | Path, *, scenario_yaml: str, overwrite: bool = False
) -> tuple[Path, ...]:
    """Write JSON, page, picture and scenario, as :func:`scanner_sim.products.files.folder.write_folder` does.

    Raises
    ------
    InputError, RunError
        As there.
    """
    writers: dict[str, Callable[[Path], None]] = {
        COMPARISON.result: lambda path: write_text(path, comparison_json(comparison)),
        "compare.html": lambda path: write_text(path, comparison_page(comparison, scenario_yaml)),
        "compare.png": lambda path: draw_comparison(comparison, path),
        "scenario.yaml": lambda path: write_text(path, scenario_yaml),
    }
    return write_folder(folder, COMPARISON, writers, overwrite=overwrite)
