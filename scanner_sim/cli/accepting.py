"""The verb ``acceptance``."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import typer

from scanner_sim.acceptance.setup import read_setup
from scanner_sim.acceptance.verdicts import Accepted, Verdict, accept
from scanner_sim.cli.call import files_of
from scanner_sim.cli.progress import progress_bar
from scanner_sim.cli.report import scenario_of, warn
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.config.reading import text_of
from scanner_sim.products.files.contents import ACCEPTANCE
from scanner_sim.products.files.exchange import Writers
from scanner_sim.products.files.folder import claim_folder, write_bytes, write_folder, write_text
from scanner_sim.products.json_text import json_text
from scanner_sim.products.page_template import drawn
from scanner_sim.render.libraries import DeviceChoice


def accept_plan(plan: Path, output: Path, *, device: DeviceChoice, overwrite: bool, quiet: bool) -> None:
    """Make the acceptance test of a plan, into a folder.

    Raises
    ------
    ScannerSimError
        If the plan has faults, an artefact cannot be measured, or a file cannot be written.
    typer.Exit
        With 1 unless the instrument passes.
    """
    from scanner_sim.acceptance.pictures import draw_deviations, draw_errors, draw_places
    from scanner_sim.acceptance.report import page, remarks, report

    setup = read_setup(plan)
    text = text_of(plan)
    with claim_folder(output, overwrite, ACCEPTANCE):
        with progress_bar("artefacts", quiet) as (advance, _), scenario_of(plan):
            found = accept(setup, device=device, progress=advance)
        for sentence in () if quiet else remarks(found):
            warn(sentence)
        draws = {"errors.png": draw_errors, "places.png": draw_places, "deviations.png": draw_deviations}
        pictures = {name: drawn(partial(draw, found)) for name, draw in draws.items()}
        texts = {
            "acceptance.json": json_text(report(found)),
            "acceptance.html": page(found, text, pictures),
            "plan.yaml": text,
        }
        writers: Writers = {
            **{name: partial(write_text, text=content) for name, content in texts.items()},
            **{name: partial(write_bytes, content=picture) for name, picture in pictures.items()},
        }
        paths = write_folder(output, ACCEPTANCE, writers, overwrite=overwrite)
    if not quiet:
        _print(found, paths)
    if found.verdict is not Verdict.PASSES:
        raise typer.Exit(1)


def _print(found: Accepted, paths: tuple[Path, ...]) -> None:
    from scanner_sim.acceptance.report import NAMES, RULES, millimetres, title

    rows = [["artefact", "test", "certified", "measured", "largest error", "σ", "U", "limit [mm]", "verdict"]]
    for one in found.tests:
        numbers = (one.reference, one.measured, one.error, one.sigma, one.uncertainty, one.limit)
        rows.append(
            [one.artefact, NAMES[one.quantity], *map(millimetres, numbers), str(found.verdict_of(one))]
        )
    print_rows(rows, left=(0, 1, 8))
    typer.echo(f"\n{title(found.verdict)}. {RULES[found.setup.plan.rule]}")
    print_table(
        {
            "repetitions": f"{found.setup.plan.repetitions}, each of which is judged; the table has the largest error",
            "not done": "two-face tests: the mirrors have no second face; what else differs stands on the page",
            **files_of(paths),
        }
    )
