"""The verb ``selfcal``."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from scanner_sim.calibration.selfcal import SelfCalibrated, self_calibrate
from scanner_sim.calibration.setup import Setup, read_setup
from scanner_sim.calibration.tables import points_text, read_sightings, sightings_text
from scanner_sim.cli.progress import progress_bar
from scanner_sim.cli.report import scenario_of, warn
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.config.calibration import calibration_text
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.parameters import INDEX, PARAMETERS
from scanner_sim.products.files.exchange import Writers, check_files, write_files
from scanner_sim.products.files.folder import write_text
from scanner_sim.products.json_text import json_text
from scanner_sim.render.libraries import DeviceChoice

_MOST_DOUBTED = 5
"""Doubtful sightings that are named on the terminal; the report names all."""


def self_calibrate_plan(
    plan: Path, output: Path, *, device: DeviceChoice, overwrite: bool, quiet: bool
) -> None:
    """Calibrate the instrument of a plan; write calibration, report, tables and pictures.

    Raises
    ------
    ScannerSimError
        If the plan has faults, the field does not determine a calibration, or a file cannot be written.
    """
    from scanner_sim.calibration.pictures import draw_field, draw_parameters, draw_residuals
    from scanner_sim.calibration.report import about, report
    from scanner_sim.calibration.simulated import simulated_sightings

    if output.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(
            f"{output.name} is no name of a calibration.", remedy="Write one that ends in .yaml."
        )
    if not output.parent.is_dir():
        raise InputError(f"there is no folder {output.parent}.", remedy="Make it, or name another.")
    endings = (".json", "_sightings.csv", "_targets.csv", "_field.png", "_residuals.png", "_parameters.png")
    names = (output.name, *(f"{output.stem}{ending}" for ending in endings))
    check_files([output.parent / name for name in names], overwrite)
    setup = read_setup(plan)
    warnings: tuple[str, ...] = ()
    with progress_bar("sightings", quiet) as (advance, say):
        if setup.plan.sightings is None:
            with scenario_of(plan):
                table, warnings = simulated_sightings(setup, device=device, progress=advance)
        else:
            table = read_sightings(setup.plan.sightings, setup.digest, setup.names)
        say("adjusting")
        result = self_calibrate(setup, table)
    for sentence in () if quiet else warnings:
        warn(sentence)
    targets = setup.surveyed()
    places = zip(targets.names, targets.places.tolist(), strict=True)
    boards: dict[str, dict[str, list[float]]] = {board: {} for board in targets.boards}
    for name, place in places:
        board, _, target = name.partition("/")
        boards[board][target] = place
    texts = (
        calibration_text(result.calibration, setup.base.scanner, about(result)),
        json_text(report(setup, result, warnings)),
        sightings_text(table, setup.digest),
        points_text(boards),
    )
    writers: Writers = {
        **{name: partial(write_text, text=text) for name, text in zip(names[:4], texts, strict=True)},
        **{
            name: partial(draw, result)
            for name, draw in zip(names[4:], (draw_field, draw_residuals, draw_parameters), strict=True)
        },
    }
    write_files(output.parent, writers, overwrite=overwrite)
    if not quiet:
        _print(setup, result, output, names)


def _print(setup: Setup, result: SelfCalibrated, output: Path, names: tuple[str, ...]) -> None:
    rows = [["parameter", "value", "σ", "tolerance", "σ/tolerance"]]
    sought = zip(result.field.sought, result.values.tolist(), result.sigma.tolist(), strict=True)
    for name, value, sigma in sought:
        spell, tolerance = PARAMETERS[INDEX[name]].dimension.format, result.field.tolerance[name]
        cells = (str(spell(float(f"{one:.3g}"))) for one in (value, sigma, tolerance))
        rows.append([name, *cells, f"{sigma / tolerance:.3g}"])
    print_rows(rows)
    field, adjusted = result.field, result.adjusted
    misfits = {"misfit of the fitted boards": result.fitted, "of what was held out": result.held_out}
    table = {
        "sightings": f"{len(field.sightings)} of {len(field.targets.names)} targets from {len(field.stations)} stations"
        f", {'simulated' if setup.plan.sightings is None else 'measured'}",
        "unit weight": f"{adjusted.unit_weight:.3f} with {adjusted.freedom} degrees of freedom",
        "not observed": "; ".join(f"{one.words} (its tolerance stays)" for one in result.unobserved)
        or "nothing: the sightings know every combination better than its tolerance",
    }
    if result.doubted:
        said = [f"{target} from {station} ({weight:.2f})" for station, target, weight in result.doubted]
        more = f" and {len(said) - _MOST_DOUBTED} more" if len(said) > _MOST_DOUBTED else ""
        table["doubted (weight)"] = ", ".join(said[:_MOST_DOUBTED]) + more
    for name, one in misfits.items():
        if one is not None:
            table[name] = (
                f"{one.designed:.3g} as designed, {one.calibrated:.3g} calibrated, over noise "
                f"({100.0 * one.improvement:.0f} % less)"
            )
    table |= {
        "files": ", ".join(str(output.parent / name) for name in names),
        "use": f"processing.calibration: {output.absolute()}",
    }
    print_table(table)
