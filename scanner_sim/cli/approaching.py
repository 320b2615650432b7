"""The verb ``approach``."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from scanner_sim.cli.campaign import do_runs, need_dask
from scanner_sim.cli.progress import progress_bar
from scanner_sim.cli.report import scenario_of, warn
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.config import scenario_warnings
from scanner_sim.products.approach import ApproachStudy, ConditionRow
from scanner_sim.render.libraries import DeviceChoice

MOST_PICTURES = 20
"""Lights that are drawn; the tables have all."""


def fly_approach(
    file: Path,
    folder: Path,
    *,
    workers: int,
    peak: str | None,
    pulse: str | None,
    dry_run: bool,
    device: DeviceChoice,
    quiet: bool,
) -> None:
    """Try poses along an approach, or go on with it, and write its tables and pictures.

    Raises
    ------
    ScannerSimError
        If the file has faults, the folder holds something else, there is nothing to run on, or the disk fails.
    """
    from scanner_sim.campaign.approach.reading import read_approach
    from scanner_sim.signals.named import NamedEstimators

    estimators = NamedEstimators.of(peak, pulse)
    estimators.register()
    planned = read_approach(file)
    for sentence in () if quiet else scenario_warnings(planned.campaign.base):
        warn(sentence)
    if dry_run:
        rows = [["time", "range", "array"]]
        first = planned.points[: len(planned.points) // max(len(planned.approach.orbits), 1)]
        rows += [[f"{one.epoch.time:.1f} s", f"{one.epoch.distance:.3f} m", one.array] for one in first]
        print_rows(rows, left=(2,))
        print_table({"runs": f"{len(planned.campaign):,}", "folder": str(folder)})
        return
    need_dask(workers, None)
    # Loads the renderer: only after everything that can be refused without it.
    from scanner_sim.campaign.approach.light import epoch_rows
    from scanner_sim.campaign.approach.results import study_of
    from scanner_sim.campaign.result import CampaignResult
    from scanner_sim.campaign.store import reopened
    from scanner_sim.campaign.work import Settings

    settings = Settings(folder, device=device, estimators=estimators)
    do_runs(planned.campaign, settings, workers, None, quiet)
    with progress_bar("light", quiet) as (advance, _), scenario_of(planned.approach.base):
        epochs = epoch_rows(planned, device=device, progress=advance)
    study = study_of(file.stem, planned, CampaignResult(reopened(folder)).table(), epochs)
    paths = write_study(study, folder)
    if quiet:
        return
    print_rows(condition_table(study), left=(0,))
    for fault in study.faults:
        warn(f"runs failed: {fault}")
    print_table({"folder": str(folder), "files": ", ".join(path.name for path in paths)})


def write_study(study: ApproachStudy, folder: Path) -> tuple[Path, ...]:
    """Write the tables and pictures of an approach into the folder of its campaign; return the files.

    Raises
    ------
    RunError
        If the disk is full or fails.
    """
    from scanner_sim.campaign.approach.page import approach_page
    from scanner_sim.products.approach import approach_json
    from scanner_sim.products.files.exchange import Writers, write_files
    from scanner_sim.products.files.folder import write_bytes, write_text
    from scanner_sim.products.files.tables import records_csv, write_parquet
    from scanner_sim.products.page_template import drawn
    from scanner_sim.products.pictures.approach import draw_approach, draw_conditions

    about = {"title": "approach", "versions": dict(study.made_by)}
    pictures = {
        f"approach{f'_{orbit + 1}' if study.orbits > 1 else ''}.png": drawn(
            partial(draw_approach, study, orbit=orbit)
        )
        for orbit in range(min(study.orbits, MOST_PICTURES))
    }
    conditions = drawn(partial(draw_conditions, study))
    texts = {
        "approach.html": approach_page(study, condition_table(study), conditions, list(pictures.values())),
        "approach.json": approach_json(study),
        "epochs.csv": records_csv(study.epochs),
        "approach.csv": records_csv(study.rows),
        "conditions.csv": records_csv(study.conditions),
    }
    writers: Writers = {
        **{name: partial(write_text, text=text) for name, text in texts.items()},
        "tries.parquet": lambda path: write_parquet(path, study.tries, about),
        **{
            name: partial(write_bytes, content=picture)
            for name, picture in {**pictures, "conditions.png": conditions}.items()
        },
    }
    return write_files(folder, writers, overwrite=True)


def condition_table(study: ApproachStudy) -> list[list[str]]:
    """Return the table of methods over the conditions of Table 1: share with a pose, errors of place and attitude."""
    rows = [["method", *(label.name for label in study.labels)]]
    for name, words in study.methods.items():
        own = [row for row in study.conditions if row.method == name]
        rows.append([words, *map(_cell, own)])
    counts = [row for row in study.conditions if row.method == next(iter(study.methods))]
    rows.append(["epochs", *(str(row.epochs) for row in counts)])
    return rows


def _cell(row: ConditionRow) -> str:
    if not row.tries:
        return "–"
    share = f"{100.0 * row.availability:.0f} %"
    if not row.valid:
        return share
    place, stated = 1e3 * row.position_m, 1e3 * row.position_sigma_m
    turn, said = (57.29577951308232 * value for value in (row.attitude_rad, row.attitude_sigma_rad))
    return f"{share}, {place:.2g} ({stated:.2g}) mm, {turn:.2g} ({said:.2g})°"
