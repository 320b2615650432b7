"""The verb ``budget``."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from scanner_sim.cli.call import Call, files_of
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.config import resolved_yaml
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.units import FROM_FILE, Angle
from scanner_sim.products.budget import BudgetRow, budget_json, crossing
from scanner_sim.products.files.contents import BUDGET


def budget_scenario(call: Call, *, count: int, reflectance: float, sweep: str | None, image: bool) -> None:
    """Measure and compute the error budget of a scenario's instrument into a folder.

    Raises
    ------
    ScannerSimError
        If the scenario, the folder or the device cannot be used, or the disk fails.
    """
    from scanner_sim.products.files.tables import records_csv
    from scanner_sim.products.pictures.budget import draw_budget, draw_curves, draw_dominance

    scenario = call.scenario()
    chosen = None if sweep is None else _angle(sweep)
    with call.claimed(BUDGET):
        from scanner_sim.validation.compare.instrument import closed_crossing, with_closed_forms
        from scanner_sim.validation.studies.budget import distances_of, measure_budget, with_sweep
        from scanner_sim.validation.studies.dominance import dominating

        own, scenario = scenario, with_sweep(scenario, chosen)
        turn = scenario.raster.travel

        distances = distances_of(scenario, count)
        dominance = None
        with call.work("source by source") as (advance, say):
            rows = measure_budget(scenario, distances, reflectance, device=call.device, progress=advance)
            if image:
                say("over the image")
                dominance = dominating(own, device=call.device, progress=advance)
        rows = with_closed_forms(rows, scenario, reflectance)
        ends = float(distances[0]), float(distances[-1])
        at_rest = math.nan
        if "tof" in scenario.rangefinders:
            at_rest = closed_crossing(with_sweep(scenario, 0.0), reflectance, *ends)
        light = "dark" if scenario.lighting.sky().dark else "lit as the scenario says"
        light += f", {_turn(turn)}"
        contents: dict[str, str | Callable[[Path], None]] = {
            "budget.json": budget_json(rows, reflectance, dominance, turn, at_rest),
            "budget.csv": records_csv(rows),
            "budget.png": partial(draw_budget, rows, reflectance, mode=rows[0].mode, light=light),
            "scenario.yaml": resolved_yaml(own),
        }
        if any(row.mode == "fused" for row in rows):
            contents["budget_tof.png"] = partial(draw_budget, rows, reflectance, mode="tof", light=light)
            contents["curves.png"] = partial(draw_curves, rows, reflectance, light=light)
        if dominance is not None:
            contents["dominance.png"] = partial(draw_dominance, dominance)
        paths = call.write(BUDGET, contents)
    if call.quiet:
        return
    print_rows(budget_rows(rows))
    closing = {"the beam in a dwell": _turn(turn) + (" (as the scan's columns)" if chosen is None else "")}
    closing |= _meeting(rows, turn, at_rest)
    closing |= files_of(paths)
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
