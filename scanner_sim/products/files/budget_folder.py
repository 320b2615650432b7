"""The folder of an error budget."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from scanner_sim.products.budget import BudgetRow, Dominance, budget_json
from scanner_sim.products.files.contents import BUDGET
from scanner_sim.products.files.folder import write_folder, write_text
from scanner_sim.products.files.tables import records_csv
from scanner_sim.products.pictures.budget import draw_budget, draw_curves, draw_dominance


def write_budget(
    rows: Sequence[BudgetRow],
    folder: str | Path,
    *,
    reflectance: float,
    scenario_yaml: str,
    light: str = "dark",
    sweep: float = math.nan,
    at_rest: float = math.nan,
    dominance: Dominance | None = None,
    overwrite: bool = False,
) -> tuple[Path, ...]:
    """Write JSON, CSV, pictures and scenario, as :func:`scanner_sim.products.files.folder.write_folder` does.

    ``light`` says in a word or two what shines on the target, ``sweep`` by which angle [rad] the beam turns during a
    dwell, ``at_rest`` from which range [m] time of flight were the more precise if it did not. With time of flight its
    sources have a picture of their own, and ``curves.png`` shows both ways and their fusion.

    Raises
    ------
    InputError, RunError
        As there.
    """
    writers: dict[str, Callable[[Path], None]] = {
        "budget.json": lambda path: write_text(
            path, budget_json(rows, reflectance, dominance, sweep, at_rest)
        ),
        "budget.csv": lambda path: write_text(path, records_csv(rows)),
        "budget.png": lambda path: draw_budget(rows, reflectance, path, light=light),
        "scenario.yaml": lambda path: write_text(path, scenario_yaml),
    }
    if any(row.mode == "tof" for row in rows):
        writers["budget_tof.png"] = lambda path: draw_budget(rows, reflectance, path, mode="tof", light=light)
        writers["curves.png"] = lambda path: draw_curves(rows, reflectance, path, light=light)
    if dominance is not None:
        writers["dominance.png"] = lambda path: draw_dominance(dominance, path)
    return write_folder(folder, BUDGET, writers, overwrite=overwrite)
