"""The verb ``compare``."""

from __future__ import annotations

from collections.abc import Collection
from functools import partial
from pathlib import Path

import typer

from scanner_sim.cli.call import Call, files_of
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.config import resolved_yaml
from scanner_sim.products.comparison import Comparison, comparison_json
from scanner_sim.products.files.contents import COMPARISON


def compare_scenario(
    call: Call,
    *,
    target: str | None,
    only: Collection[str],
    seeds: int,
    level: float,
    quick: bool,
    baseline: Path | None,
) -> None:
    """Compare a scenario's simulation with the closed forms, into a folder.

    Raises
    ------
    ScannerSimError
        If the scenario, an option, the folder or the device cannot be used, or the disk fails.
    typer.Exit
        With 1 where a law is broken, or anything differs from the baseline.
    """
    from scanner_sim.products.comparison_page import comparison_page
    from scanner_sim.products.pictures.comparison import draw_comparison

    scenario = call.scenario()
    from scanner_sim.validation.compare.baseline import against, read_baseline
    from scanner_sim.validation.compare.comparison_setup import ComparisonSetup, FlatTarget
    from scanner_sim.validation.compare.run import judge_laws

    earlier = None if baseline is None else read_baseline(baseline)
    flat = None if target is None else FlatTarget.parse(target)
    setting = ComparisonSetup(scenario, flat, seeds, quick, call.device)
    with call.claimed(COMPARISON):
        with call.work("law by law", "laws") as (advance, _):
            found = judge_laws(setting, only=only, level=level, progress=advance)
        if earlier is not None:
            found = against(found, earlier)
        paths = call.write(
            COMPARISON,
            {
                COMPARISON.result: comparison_json(found),
                "compare.html": comparison_page(found, resolved_yaml(scenario)),
                "compare.png": partial(draw_comparison, found),
                "scenario.yaml": resolved_yaml(scenario),
            },
        )
    if not call.quiet:
        _print(found)
        print_table(files_of(paths))
    if not found.passed:
        raise typer.Exit(1)


def _print(found: Comparison) -> None:
    """Print the verdict on each law with its worst check, and what differs from the baseline."""
    from scanner_sim.products.comparison_page import percent, power_of, power_words, share, short, worst_check

    rows = [
        ["law", "verdict", "checks", "worst case", "predicted", "simulated", "deviation", "p", "90 %", "99 %"]
    ]
    for finding in found.findings:
        if not finding.checks:
            continue
        check = worst_check(finding)
        least, most = power_of(finding)
        rows.append(
            [
                finding.name,
                finding.verdict,
                str(len(finding.checks)),
                check.case,
                f"{short(check.predicted)} {check.unit}".strip(),
                short(check.simulated),
                percent(check),
                short(check.adjusted_p, 2),
                share(least),
                share(most),
            ]
        )
    print_rows(rows, left=(0, 1, 3))
    silent = {finding.name: finding.reason for finding in found.findings if not finding.checks}
    if silent and not found.unjudging:
        typer.echo("\nDoes not apply:")
        print_table(silent)
    if found.unjudging:
        typer.echo(f"\nSay nothing about {' and '.join(found.own_estimators)}:")
        print_table(found.unjudging)
    if found.baseline:
        typer.echo("\nDifferent from the baseline:")
        rows = [["law", "case", "what", "before", "now", "p"]]
        for change in found.baseline:
            numbers = (short(change.before), short(change.now), short(change.adjusted_p, 2))
            rows.append([change.law, change.case, change.what, *numbers])
        print_rows(rows, left=(0, 1, 2))
    elif found.baseline is not None:
        typer.echo("\nNothing differs from the baseline.")
    verdict = "All laws that apply hold" if not found.broken else f"{len(found.broken)} of the laws broken"
    typer.echo(
        f"\n{verdict} (family-wise level {found.level:g}; the last columns say which deviation of any of a law's "
        "checks would have been found with that probability)."
    )
    if words := power_words(found):
        typer.echo(words)
