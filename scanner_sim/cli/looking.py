"""Verbs that look at results: a page for a browser, and two results compared."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scanner_sim.cli.options import (
    Device,
    DeviceName,
    Overwrite,
    Peak,
    Pulse,
    Quiet,
    output_option,
    own_estimators,
)
from scanner_sim.cli.report import reported


def view(
    result: Annotated[
        Path,
        typer.Argument(
            metavar="DIR_OR_EXR", help="Folder of a result, or its range.exr.", show_default=False
        ),
    ],
    output: Annotated[
        Path | None,
        output_option("The page.", "view.html beside the result", metavar="HTML"),
    ] = None,
    lines: Annotated[
        bool,
        typer.Option("--lines/--no-lines", help="Keep the line and the waveform of each voxel in the page."),
    ] = True,
    size: Annotated[
        float,
        typer.Option(
            metavar="MB", min=2.0, help="Size of the page beyond which lines, then voxels are thinned out."
        ),
    ] = 60.0,
    peak: Peak = None,
    pulse: Pulse = None,
    device: Device = DeviceName.auto,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a page that is there.")] = False,
    quiet: Quiet = False,
) -> None:
    """Write a result as one page for a browser: turn the points, colour them, click at a voxel and see its line.

    Examples: `scanner-sim view output/quickstart`, `scanner-sim view output/track_still -o track.html`

    The page holds everything: it opens from the disk, without a server and without a network. Lines and waveforms are
    those that the run has kept, or are simulated again from the scenario in the result. Of a tracking run it shows
    targets, patterns and poses over time.
    """
    with reported():
        own_estimators(peak, pulse)
        from scanner_sim.cli.viewing import view_result

        view_result(
            result,
            output,
            lines=lines,
            largest_mb=size,
            device=device.value,
            overwrite=overwrite,
            quiet=quiet,
        )


def difference(
    first: Annotated[
        Path,
        typer.Argument(metavar="FIRST", help="Folder of a result, or its range.exr.", show_default=False),
    ],
    second: Annotated[
        Path, typer.Argument(metavar="SECOND", help="Another result of the same scan.", show_default=False)
    ],
    output: Annotated[
        Path | None,
        output_option("Folder of the comparison.", "output/ and SECOND_less_FIRST"),
    ] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Compare two results of one scan: difference in range over σ as a map and a histogram, and changes of status.

    Example: `scanner-sim difference output/quickstart output/quickstart_gaussian`

    The rasters, or the shots, must point alike; scanner, scene, processing and seed may differ. σ is that of both
    together, as of independent errors: compare runs with different seeds.
    """
    with reported():
        from scanner_sim.cli.differing import compare_results

        compare_results(first, second, output, overwrite=overwrite, quiet=quiet)
