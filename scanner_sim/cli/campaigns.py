"""The family of verbs ``campaign``, with their options."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from scanner_sim.cli.options import (
    Device,
    DeviceName,
    NamedPeak,
    NamedPulse,
    Overwrite,
    Quiet,
    beside,
    output_option,
    own_estimators,
)
from scanner_sim.cli.report import reported


class PlanFirst(TyperGroup):
    """A group whose verb ``run`` may be left out: ``campaign PLAN.yaml``."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the verb that is meant."""
        if self.get_command(ctx, args[0]) is None and Path(args[0]).suffix:
            args = ["run", *args]
        return super().resolve_command(ctx, args)


campaign = typer.Typer(
    cls=PlanFirst,
    no_args_is_help=True,
    help="Run many scenarios as one question: `scanner-sim campaign PLAN.yaml`.",
    epilog="What a killed campaign has done stays; the same command goes on.",
)

Folder = Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a campaign.", show_default=False)]
Run = Annotated[int, typer.Option("--run", metavar="N", help="Number of the run.", show_default=False)]


@campaign.command("run")
def run(
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="Plan, a YAML file.", show_default=False)],
    output: Annotated[
        Path | None,
        output_option("Folder of the campaign.", "output/ and PLAN's name"),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=0,
            max=1024,
            help="Processes on this machine; 0 runs in this one, without Dask.",
            show_default="one per core, or one per GPU",
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="tcp://HOST:PORT",
            help="Dask scheduler of a cluster.",
            show_default="workers on this machine",
        ),
    ] = None,
    measure: Annotated[
        str | None,
        typer.Option(
            metavar="MODULE:FUNCTION",
            help="A measure of your own: a Python function of a result.",
            show_default=False,
        ),
    ] = None,
    peak: NamedPeak = None,
    pulse: NamedPulse = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Check the plan, print its runs and what they take, and stop.")
    ] = False,
    device: Device = DeviceName.auto,
    quiet: Quiet = False,
) -> None:
    """Check a plan as a whole, and do its runs, or those that are left.

    Example: `scanner-sim campaign configs/campaigns/power.yaml -o output/power --workers 2`

    Each run is a row of numbers in DIR; one that fails is a row with its fault. The rows are the same for any number of
    workers. The word `run` may be left out.
    """
    with reported():
        from scanner_sim.cli.campaign import run_campaign

        name = plan.name.removesuffix(plan.suffix).removesuffix(".campaign")
        run_campaign(
            plan,
            output or Path("output", name),
            workers=workers,
            scheduler=scheduler,
            measure=measure,
            peak=peak,
            pulse=pulse,
            dry_run=dry_run,
            device=device.value,
            quiet=quiet,
        )


@campaign.command("status")
def status(folder: Folder) -> None:
    """Say how many runs are done and failed, and what they measured so far.

    Example: `scanner-sim campaign status output/power`
    """
    with reported():
        from scanner_sim.cli.campaign import print_status

        print_status(folder)


@campaign.command("show")
def show(
    folder: Folder,
    run: Run,
    scenario: Annotated[bool, typer.Option("--scenario", help="Print its whole scenario instead.")] = False,
    peak: NamedPeak = None,
    pulse: NamedPulse = None,
) -> None:
    """Say what a run had and what it gave.

    Example: `scanner-sim campaign show output/power --run 3`
    """
    with reported():
        from scanner_sim.cli.campaign import show_run

        own_estimators(peak, pulse)
        show_run(folder, run, scenario=scenario)


@campaign.command("rerun")
def rerun(
    folder: Folder,
    run: Run,
    output: Annotated[
        Path | None,
        output_option("Folder of the result.", "again/ and the number, in the campaign's"),
    ] = None,
    peak: NamedPeak = None,
    pulse: NamedPulse = None,
    device: Device = DeviceName.auto,
    overwrite: Overwrite = False,
) -> None:
    """Do a run again with its whole result in files, and hold its measures against the row.

    Example: `scanner-sim campaign rerun output/power --run 3`
    """
    with reported():
        from scanner_sim.cli.campaign import rerun

        own_estimators(peak, pulse)
        rerun(folder, run, output, device=device.value, overwrite=overwrite)


@campaign.command("dataset")
def dataset(
    folder: Folder,
    output: Annotated[
        Path | None,
        output_option("Folder of the data set.", "DIR with _dataset"),
    ] = None,
    shares: Annotated[
        tuple[float, float, float],
        typer.Option(metavar="TRAIN VALIDATION TEST", help="Shares of the three splits; 0 for none."),
    ] = (80.0, 10.0, 10.0),
    apart: Annotated[
        list[str] | None,
        typer.Option(
            metavar="WORD",
            help="What no two splits share: object, pose. May be repeated.",
            show_default="both",
        ),
    ] = None,
    layer: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Layer of the images that is kept, beside status and truth.object. May be repeated.",
            show_default="all",
        ),
    ] = None,
    licence: Annotated[
        str,
        typer.Option(
            "--licence",
            "--license",
            metavar="SPDX",
            help="Licence of the data set, as CC-BY-4.0, or its address.",
            show_default=False,
        ),
    ] = "",
    name: Annotated[
        str, typer.Option(metavar="NAME", help="Name of the data set.", show_default="its folder's")
    ] = "",
    shard_size: Annotated[
        int, typer.Option(metavar="MB", min=1, help="Size of a shard's layers before compression.")
    ] = 256,
    peak: NamedPeak = None,
    pulse: NamedPulse = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an existing data set.")] = False,
    quiet: Quiet = False,
) -> None:
    """Make a data set for learning of the runs that a campaign has kept.

    Example: `scanner-sim campaign dataset output/views -o output/views_set --licence CC-BY-4.0`

    The plan needs `keep: {runs: all}`. DIR gets Parquet shards of train, validation and test, which share no object and
    no pose; croissant.json, which describes them to loaders; and README.md, with the licences of the meshes as
    FILE.license beside each says (REUSE).
    """
    with reported():
        from scanner_sim.cli.dataset import make_dataset

        own_estimators(peak, pulse)
        make_dataset(
            folder,
            output or beside(folder, "_dataset"),
            shares=shares,
            apart=tuple(apart or ("object", "pose")),
            layers=tuple(layer or ()),
            licence=licence,
            name=name,
            shard_bytes=shard_size << 20,
            overwrite=overwrite,
            quiet=quiet,
        )


@campaign.command("report")
def report(folder: Folder) -> None:
    """Write one page about a campaign: distributions, what each key does, the worst runs, and what failed.

    Example: `scanner-sim campaign report output/power`

    The page is report.html in DIR, with its pictures in it. It may be written while the campaign runs.
    """
    with reported():
        from scanner_sim.cli.campaign import write_report

        write_report(folder)
