"""The verbs ``campaign``: a plan checked and run, and the folder of a campaign looked at."""

from __future__ import annotations

import importlib.util
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from scanner_sim.cli.call import Call
from scanner_sim.cli.plan import run_seconds
from scanner_sim.cli.progress import progress_bar
from scanner_sim.cli.report import warn
from scanner_sim.cli.running import run_into_folder
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.config import resolved_yaml, scenario_warnings
from scanner_sim.config.document import Value
from scanner_sim.config.wording import inline_yaml, shorten
from scanner_sim.foundation.channels import layer_bytes
from scanner_sim.foundation.errors import InputError, RunError
from scanner_sim.render.libraries import DeviceChoice

if TYPE_CHECKING:
    from scanner_sim.campaign.runs import Campaign
    from scanner_sim.campaign.store import Store
    from scanner_sim.campaign.work import Settings

SHOWN = 20
"""Runs of a table."""
OVERHEAD_SECONDS = 0.02
"""Time of a run beside its voxels."""
ROW_BYTES = 400.0
"""Bytes of a row on the disk, with room for its measures."""


def run_campaign(
    plan: Path,
    folder: Path,
    *,
    workers: int | None,
    scheduler: str | None,
    measure: str | None,
    peak: str | None,
    pulse: str | None,
    dry_run: bool,
    device: DeviceChoice,
    quiet: bool,
) -> None:
    """Check a plan and do its runs, or go on with them.

    Raises
    ------
    ScannerSimError
        If the plan has faults, the folder holds something else, there is nothing to run on, or the disk fails.
    """
    from scanner_sim.campaign.own_measure import OwnMeasure
    from scanner_sim.campaign.reading import impossible_runs, read_campaign
    from scanner_sim.campaign.store import columns_of_runs
    from scanner_sim.foundation.own_function import OwnFunction
    from scanner_sim.signals.named import NamedEstimators

    estimators = NamedEstimators.of(peak, pulse)
    estimators.register()
    campaign = read_campaign(plan)
    own = None if measure is None else OwnMeasure(OwnFunction(measure, os.getcwd()))
    if own is not None:
        own.load()
        own.check(columns_of_runs(campaign))
    for sentence in (*scenario_warnings(campaign.base), *impossible_runs(campaign)):
        if not quiet:
            warn(sentence)
    if dry_run:
        _print_plan(campaign, folder, max(_cores() if workers is None else workers, 1))
        return
    need_dask(workers, scheduler)
    # Loads the renderer: only after everything that can be refused without it.
    from scanner_sim.campaign.work import Settings

    do_runs(campaign, Settings(folder, own, device, estimators=estimators), workers, scheduler, quiet)
    if not quiet:
        print_status(folder)


def _cores() -> int:
    return os.cpu_count() or 1


def need_dask(workers: int | None, scheduler: str | None) -> None:
    """Raise an InputError if workers are wanted and Dask is not installed."""
    if (workers != 0 or scheduler) and importlib.util.find_spec("distributed") is None:
        raise InputError(
            "several workers need Dask, which is not installed.",
            remedy="pip install 'scanner-sim[campaign]', or run in this process with --workers 0.",
        )


def do_runs(
    campaign: Campaign, settings: Settings, workers: int | None, scheduler: str | None, quiet: bool
) -> None:
    """Do the runs of a campaign that are left, in this process, on workers or on a cluster, with a bar.

    Raises
    ------
    ScannerSimError
        As :func:`run_campaign`.
    """
    from scanner_sim.campaign.serial import run_serially
    from scanner_sim.campaign.store import opened
    from scanner_sim.render.device import activate
    from scanner_sim.render.libraries import visible_gpus

    gpus: tuple[str, ...] = ()
    if scheduler is None and activate(settings.device).gpu is not None:
        # A machine on which nothing can compute is one fault, not that of every row.
        gpus = visible_gpus()
        if workers is not None and workers > len(gpus):
            raise InputError(
                f"{workers} workers need a GPU each, and {len(gpus)} can be seen.",
                remedy=f"Write --workers {len(gpus)}, or --device cpu.",
            )
    workers = (len(gpus) or _cores()) if workers is None else workers
    measures = (*campaign.plan.measure, *([settings.own.column] if settings.own else []))
    with opened(settings.folder, campaign, measures) as store:
        left = int((~store.done).sum())
        with progress_bar(f"{left:,} runs", quiet, "runs") as (advance, say):
            failed = store.failed

            def progress(done: int, runs: int, failures: int) -> None:
                nonlocal failed
                if failures > failed:
                    failed = failures
                    say(f"{left:,} runs, {failures:,} failed")
                advance(done, runs)

            if left and not workers and scheduler is None:
                run_serially(store, settings, progress)
            elif left:
                from scanner_sim.campaign.cluster import client_of, run_on

                with client_of(min(workers, left), scheduler, gpus) as client:
                    run_on(client, store, settings, progress)
        store.pack()


def print_status(folder: Path) -> None:
    """Print how far a campaign is, and what it measured so far; faults as :func:`run_campaign`."""
    from scanner_sim.campaign.store import reopened

    store = reopened(folder)
    done, runs = int(store.done.sum()), len(store.done)
    rows = {"runs": f"{done:,} of {runs:,} done", "failed": f"{store.failed:,}", "folder": str(store.folder)}
    print_table(rows | _medians(store))


def show_run(folder: Path, run: int, *, scenario: bool) -> None:
    """Print what a run had and gave, or its scenario; faults as :func:`run_campaign`."""
    from scanner_sim.campaign.store import reopened

    store = reopened(folder)
    _check_run(store, run)
    if scenario:
        typer.echo(resolved_yaml(store.campaign.scenario(run)), nl=False)
        return
    print_table(_about_run(store, run))


def rerun(folder: Path, run: int, output: Path | None, *, device: DeviceChoice, overwrite: bool) -> None:
    """Do a run again as ``run`` does, and say whether its measures are the same.

    Raises
    ------
    ScannerSimError
        If there is no such run, its scenario is impossible, the folder cannot be written to, or the measures differ.
    """
    from scanner_sim.campaign.measures import MEASURES, measured
    from scanner_sim.campaign.store import BASE, reopened
    from scanner_sim.campaign.work import outcome_of

    store = reopened(folder)
    _check_run(store, run)
    target = output or folder / "again" / f"{run:06d}"
    call = Call(folder / BASE, target, (), device, overwrite, quiet=False)
    made = run_into_folder(store.campaign.scenario(run), call)
    names = tuple(name for name in store.measures if name in MEASURES)
    again, row = measured(names, outcome_of(made, device)), _row_of(store, run)
    rows = {"run": str(run), **_spelled(store, again)}
    compared = row is not None and not row["fault"]
    moved = [name for name in names if compared and row and not _same(float(str(row[name])), again[name])]
    if compared and not moved:
        rows["row"] = "the same numbers"
    print_table(rows)
    if moved:
        raise RunError(
            f"run {run} gives other numbers than before: {', '.join(moved)}.",
            remedy="Its inputs or the program have changed since.",
        )


def write_report(folder: Path) -> None:
    """Write the page of a campaign into its folder; faults as :func:`run_campaign`."""
    from scanner_sim.campaign.report import report_page
    from scanner_sim.campaign.store import reopened
    from scanner_sim.products.files.exchange import write_file
    from scanner_sim.products.files.folder import write_text

    page = report_page(reopened(folder))
    path = write_file(folder / "report.html", lambda to: write_text(to, page), overwrite=True)
    print_table({"page": str(path)})


def _same(one: float, other: float) -> bool:
    return one == other or (math.isnan(one) and math.isnan(other))


def _check_run(store: Store, run: int) -> None:
    if not 0 <= run < len(store.campaign):
        raise InputError(f"there is no run {run}.", remedy=f"They go from 0 to {len(store.campaign) - 1}.")


def _print_plan(campaign: Campaign, folder: Path, workers: int) -> None:
    """Print the axes, what the campaign will take, and a table of its first runs."""
    from scanner_sim.campaign.store import axis_names

    seconds = run_seconds(campaign.base) + OVERHEAD_SECONDS
    whole = seconds * len(campaign) / min(workers, 2)
    keep = campaign.plan.keep.runs
    kept = len(campaign) if keep == "all" else 0 if isinstance(keep, str) else len(keep)
    disk = ROW_BYTES * len(campaign) + kept * _result_bytes(campaign)
    axes = [
        f"{name if len(group.keys) == 1 else f'{len(group.keys)} keys'} × {group.length}"
        for name, group in zip(axis_names(campaign.plan), campaign.plan.vary, strict=True)
    ]
    print_table(
        {
            "runs": f"{len(campaign):,}",
            "axes": "; ".join([*axes, f"repeat × {campaign.plan.repeat}"]),
            "measures": ", ".join(campaign.plan.measure),
            "a run takes": f"about {seconds:.2g} s on two processor cores",
            "all take": f"about {_duration(whole)} with {workers} workers on two cores",
            "disk": f"about {disk / 1e6:.2g} MB, {kept:,} whole results among it",
            "folder": str(folder),
        }
    )
    runs = range(min(len(campaign), SHOWN))
    changes = [campaign.changes(run) for run in runs]
    rows: list[Sequence[str]] = [("run", *changes[0])]
    rows += [(str(run), *map(_cell, one.values())) for run, one in zip(runs, changes, strict=True)]
    typer.echo()
    print_rows(rows, left=())
    if len(campaign) > SHOWN:
        typer.echo(f"… and {len(campaign) - SHOWN:,} more")


def _result_bytes(campaign: Campaign) -> float:
    base = campaign.base
    if base.scan.layout == "visits":
        return 2e6
    return float(layer_bytes(base.rangefinders)) * base.open_scan.shots


def _medians(store: Store) -> dict[str, str]:
    import numpy as np

    from scanner_sim.campaign.result import CampaignResult
    from scanner_sim.campaign.store import units_of

    table, units = CampaignResult(store).table(), units_of(store.campaign, store.measures)
    found = {}
    for name in store.measures:
        values = table[name][np.isfinite(table[name])] if table else np.zeros(0)
        if values.size:
            low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
            unit = units.get(name, "1").removesuffix("1")
            found[name] = f"{middle:.4g} {unit} median, {low:.4g} to {high:.4g} in nine of ten runs".replace(
                "  ", " "
            )
    if store.failed:
        faults, counts = np.unique(table["fault"][table["fault"] != ""].astype(str), return_counts=True)
        for fault, count in sorted(zip(faults, counts, strict=True), key=lambda pair: -pair[1])[:5]:
            word = f"{count} ×"
            found[word] = f"{found[word]}; {fault}" if word in found else str(fault)
    return found


def _row_of(store: Store, run: int) -> dict[str, object] | None:
    import numpy as np

    for table in store.rows():
        (found,) = np.nonzero(table["run"] == run)
        if len(found):
            return {name: values[found[0]] for name, values in table.items()}
    return None


def _about_run(store: Store, run: int) -> dict[str, str]:
    row, campaign = _row_of(store, run), store.campaign
    rows = {"run": str(run), **{key: _cell(value) for key, value in campaign.changes(run).items()}}
    if row is None:
        return rows | {"outcome": "not done yet"}
    if row["fault"]:
        rows["fault"] = str(row["fault"])
    else:
        rows |= _spelled(store, {name: float(str(row[name])) for name in store.measures})
    return rows | {
        "took": f"{float(str(row['seconds'])):.3g} s",
        "again": f"scanner-sim campaign rerun {store.folder} --run {run}",
    }


def _spelled(store: Store, values: dict[str, float]) -> dict[str, str]:
    from scanner_sim.campaign.store import units_of

    units = units_of(store.campaign, store.measures)
    return {
        name: f"{value:.6g} {units.get(name, '')}".removesuffix(" 1").strip()
        for name, value in values.items()
    }


def _cell(value: Value) -> str:
    return shorten(value if isinstance(value, str) else inline_yaml(value))


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"
