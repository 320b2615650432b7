"""The verb ``budget``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from scanner_sim.cli.progress import progress_bar
from scanner_sim.cli.report import scenario_of
from scanner_sim.cli.scenarios import load_and_warn
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.config import resolved_yaml
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.units import FROM_FILE, Angle
from scanner_sim.products.budget import BudgetRow, crossing
from scanner_sim.products.files.contents import BUDGET
from scanner_sim.products.files.folder import claim_folder
from scanner_sim.render.libraries import DeviceChoice


def budget_scenario(
    config: Path,
    folder: Path,
    overrides: Sequence[str],
    *,
    count: int,
    reflectance: float,
    sweep: str | None,
    image: bool,
    device: DeviceChoice,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Measure and compute the error budget of a scenario's instrument into a folder.

    Raises
    ------
    ScannerSimError
        If the scenario, the folder or the device cannot be used, or the disk fails.
    """
    from scanner_sim.products.files.budget_folder import write_budget

    scenario = load_and_warn(config, overrides, quiet)
    chosen = None if sweep is None else _angle(sweep)
    with claim_folder(folder, overwrite, BUDGET):
        from scanner_sim.validation.compare.instrument import closed_crossing, with_closed_forms
        from scanner_sim.validation.studies.budget import distances_of, measure_budget, with_sweep
        from scanner_sim.validation.studies.dominance import dominating

        own, scenario = scenario, with_sweep(scenario, chosen)
        turn = scenario.raster.travel

        distances = distances_of(scenario, count)
        dominance = None
        with progress_bar("source by source", quiet) as (advance, say), scenario_of(config):
            rows = measure_budget(scenario, distances, reflectance, device=device, progress=advance)
            if image:
                say("over the image")
                dominance = dominating(own, device=device, progress=advance)
        rows = with_closed_forms(rows, scenario, reflectance)
        ends = float(distances[0]), float(distances[-1])
        at_rest = math.nan
        if "tof" in scenario.rangefinders:
            at_rest = closed_crossing(with_sweep(scenario, 0.0), reflectance, *ends)
        paths = write_budget(
            rows,
            folder,
            reflectance=reflectance,
            scenario_yaml=resolved_yaml(own),
            light=("dark" if scenario.lighting.sky().dark else "lit as the scenario says")
            + f", {_turn(turn)}",
            sweep=turn,
            at_rest=at_rest,
            dominance=dominance,
            overwrite=overwrite,
        )
    if quiet:
        return
    print_rows(budget_rows(rows))
    closing = {"the beam in a dwell": _turn(turn) + (" (as the scan's columns)" if chosen is None else "")}
    closing |= _meeting(rows, turn, at_rest)
    closing |= {"folder": str(folder), "files": ", ".join(path.name for path in paths)}
    if dominance is not None:
        shares = sorted(dominance.shares().items(), key=lambda share: -share[1])
        closing["most of σ"] = ", ".join(f"{name} {100.0 * share:.3g} %" for name, share in shares if share)
    print_table(closing)


def _angle(text: str) -> float:
    """Return the angle [rad] that an option names.

    Raises
    ------
    InputError
        If it names none.
    """
    try:
        return float(TypeAdapter(Angle).validate_python(text, context=FROM_FILE))
    except ValidationError as error:
        raise InputError(
            f"--sweep: {error.errors()[0]['msg']}.", remedy="Write for example --sweep '2 mrad'."
        ) from None


def _turn(sweep: float) -> str:
    """Return in words by how much the beam turns during a dwell."""
    return "beam at rest" if sweep == 0.0 else f"beam turns by {1e3 * sweep:.3g} mrad"


def _meeting(rows: Sequence[BudgetRow], sweep: float, at_rest: float) -> dict[str, str]:
    """Return where both ways of ranging are equally precise, in words; nothing where they are nowhere."""
    found, closed = crossing(rows, "simulated_m"), crossing(rows, "analytic_m")
    if math.isnan(found):
        return {}
    words = f"{found:.3g} m" + ("" if math.isnan(closed) else f" (closed forms {closed:.3g} m)")
    if sweep > 0.0 and not math.isnan(at_rest):
        words += f"; with the beam at rest {at_rest:.3g} m, for a sweep averages speckle"
    return {"equally precise at": words}


def budget_rows(rows: Sequence[BudgetRow]) -> list[list[str]]:
    """Return the table of a budget [mm]: a heading, then for each source simulated and analytic at each range."""
    ranges = list(dict.fromkeys(row.range_m for row in rows))
    chosen = [ranges[round(index * (len(ranges) - 1) / 4)] for index in range(5)]
    chosen = list(dict.fromkeys(chosen))
    table = [["σ of the range [mm]: simulated (analytic)", *(f"{distance:.3g} m" for distance in chosen)]]
    several = len({row.mode for row in rows}) > 1
    for mode, name in dict.fromkeys((row.mode, row.source) for row in rows):
        own = {row.range_m: row for row in rows if (row.mode, row.source) == (mode, name)}
        cells = (f"{_mm(own[x].simulated_m)} ({_mm(own[x].analytic_m)})" for x in chosen)
        table.append([f"{mode}: {name}" if several else name, *cells])
    return table


def _mm(metres: float) -> str:
    return "–" if math.isnan(metres) else f"{1e3 * metres:.3g}"
