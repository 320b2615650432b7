"""Verbs that hold the simulator against the closed forms and against the paper."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scanner_sim.cli.options import Device, DeviceName, Quiet, scenario_verb
from scanner_sim.cli.report import reported

if TYPE_CHECKING:
    from scanner_sim.cli.call import Call


@scenario_verb("compare")
def compare(
    call: Call,
    target: Annotated[
        str | None,
        typer.Option(
            metavar="TEXT",
            help="Flat targets instead of the scene, as '50 % at 3 m, 10 m, 20 m'.",
            show_default="50 % at five ranges; laws of a scene are judged on the scenario's",
        ),
    ] = None,
    only: Annotated[
        list[str], typer.Option(metavar="LAW", help="Judge this law only. May be repeated.")
    ] = [],  # noqa: B006 (typer reads the default, nothing changes it)
    seeds: Annotated[
        int, typer.Option(metavar="N", min=1, max=1000, help="Consecutive seeds whose samples are pooled.")
    ] = 1,
    level: Annotated[
        float, typer.Option(metavar="P", help="Probability with which a right program breaks any law.")
    ] = 1e-3,
    quick: Annotated[bool, typer.Option("--quick", help="Take a quarter of the shots.")] = False,
    baseline: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="compare.json of an earlier run to compare with.", show_default=False
        ),
    ] = None,
) -> None:
    """Compare the simulation with closed forms, law by law; the exit status is 1 where one is broken.

    Example: `scanner-sim compare configs/plane.yaml --target '50 % at 3 m, 8 m, 20 m'`

    Each law that applies to the instrument is measured and judged: predicted and simulated numbers, deviation,
    probability at a family-wise level, and what the test would have found. A table, JSON and a page with pictures.
    With `--baseline` the same seed must give the same numbers, another seed the same statistics.
    """
    from scanner_sim.cli.comparing import compare_scenario

    compare_scenario(call, target=target, only=only, seeds=seeds, level=level, quick=quick, baseline=baseline)


def reproduce(
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ITEM", help="Make only this item, as `fig12`; may be repeated.", show_default="all"
        ),
    ] = None,
    family: Annotated[
        bool,
        typer.Option(
            "--family",
            help="Make the ledger of published facts instead: each instrument against what is printed of it.",
        ),
    ] = False,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder of results, pictures and page.")
    ] = Path("output", "paper"),
    quick: Annotated[bool, typer.Option("--quick", help="Fewer and smaller, for a first look.")] = False,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Seed of the random numbers.")] = 2000,
    device: Device = DeviceName.auto,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Make items anew that are there already.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Make the paper's equations, tables and figures again from simulated data, or the ledger of published facts.

    Examples: `scanner-sim reproduce --only fig12 --only table1 -o output/paper`,
    `scanner-sim reproduce --family --only crack`

    For each: its picture, what the paper says, what was found, and where they differ and why, on one page. What is
    finished is kept: an interrupted run goes on where it was.
    """
    with reported():
        from scanner_sim.cli.reproducing import reproduce_book

        reproduce_book(
            output,
            only or (),
            family=family,
            quick=quick,
            seed=seed,
            device=device.value,
            overwrite=overwrite,
            quiet=quiet,
        )
