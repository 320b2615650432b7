"""Verbs that study an instrument: over an orbit, its estimators, its errors, its poses."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from scanner_sim.cli.options import (
    Config,
    Device,
    DeviceName,
    Override,
    Overwrite,
    Quiet,
    Seed,
    folder_of,
    folder_option,
    overrides_of,
)
from scanner_sim.cli.report import reported


def orbit(
    config: Config,
    output: Annotated[Path | None, folder_option("orbit")] = None,
    steps: Annotated[
        int, typer.Option(metavar="N", min=1, max=100_000, help="Moments, evenly spaced over one orbit.")
    ] = 90,
    override: Override = [],  # noqa: B006 (as above)
    seed: Seed = None,
    device: Device = DeviceName.auto,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Sweep one orbit: for each target the share of time in each condition of illumination.

    Example: `scanner-sim orbit configs/lighting_orbit.yaml --steps 180`

    The scenario's lighting needs an `orbit` or a `tle`. Targets are its target arrays, or else all objects. A table,
    a timeline, CSV and JSON say when each is lit, in shadow, in the dark, or seen against the Sun.
    """
    with reported():
        from scanner_sim.cli.orbit import orbit_scenario

        orbit_scenario(
            config,
            output or folder_of(config, "orbit"),
            overrides_of(override, seed),
            steps=steps,
            device=device.value,
            overwrite=overwrite,
            quiet=quiet,
        )


def calibrate(
    config: Config,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Table of the errors, a CSV file.",
            show_default="CONFIG's name with _bias.csv",
        ),
    ] = None,
    override: Override = [],  # noqa: B006 (as above)
    seed: Seed = None,
    device: Device = DeviceName.auto,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Measure the systematic error of the peak estimator, and write the table that corrects it.

    Example: `scanner-sim calibrate configs/quickstart.yaml -o bias.csv --set processing.peak=parabola`

    A flat white target is moved through the range without noise. The table, with a picture beside it, is used by
    `processing.bias_correction: bias.csv`.
    """
    with reported():
        from scanner_sim.cli.calibrating import calibrate_scenario

        calibrate_scenario(
            config,
            output or Path(f"{config.stem}_bias.csv"),
            overrides_of(override, seed),
            device=device.value,
            overwrite=overwrite,
            quiet=quiet,
        )


def budget(
    config: Config,
    output: Annotated[Path | None, folder_option("budget")] = None,
    distances: Annotated[
        int, typer.Option(metavar="N", min=2, max=200, help="Distances of the target, up to 30 m.")
    ] = 12,
    reflectance: Annotated[
        float, typer.Option(metavar="RHO", min=1e-3, max=1.0, help="Reflectance of the facing target.")
    ] = 0.5,
    sweep: Annotated[
        str | None,
        typer.Option(
            metavar="ANGLE",
            help="Angle by which the beam turns during a dwell, as '2 mrad'; '0 rad' for mirrors at rest.",
            show_default="that of the scenario's scan",
        ),
    ] = None,
    image: Annotated[
        bool, typer.Option("--image", help="Draw also which source dominates in the scenario's own scan.")
    ] = False,
    override: Override = [],  # noqa: B006 (as above)
    seed: Seed = None,
    device: Device = DeviceName.auto,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Tell where the range error comes from: each source alone and all together, against range.

    Example: `scanner-sim budget configs/plane.yaml --image --set processing.peak=maximum_likelihood`

    A facing flat target stands in the dark at log-spaced distances. A table, CSV, JSON and a picture hold simulated
    standard deviations with 95 % intervals beside those of closed forms.
    """
    with reported():
        from scanner_sim.cli.budgeting import budget_scenario

        budget_scenario(
            config,
            output or folder_of(config, "budget"),
            overrides_of(override, seed),
            count=distances,
            reflectance=reflectance,
            sweep=sweep,
            image=image,
            device=device.value,
            overwrite=overwrite,
            quiet=quiet,
        )


def pose_study(
    config: Config,
    output: Annotated[Path | None, folder_option("pose_study")] = None,
    diameter: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            min=1e-3,
            max=10.0,
            help="Diameter of the targets [m].",
            show_default="that of the scenario's first target array, or 0.1",
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Three ranges, fewer arrays, patterns and poses.")
    ] = False,
    override: Override = [],  # noqa: B006 (as above)
    seed: Seed = None,
    device: Device = DeviceName.auto,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Compare arrays of targets: the error of each component of their pose against range, size, number and method.

    Example: `scanner-sim pose-study configs/target_board.yaml --quick`

    Targets are measured from simulated pixels at several ranges, by the scenario's instrument in the dark. Poses by
    angles (uv), points (xyz) and both (joint), with triangulation and time of flight, stand beside closed forms:
    tables, JSON, and Figure 15 as a picture.
    """
    with reported():
        from scanner_sim.cli.pose_study import study_scenario

        study_scenario(
            config,
            output or folder_of(config, "pose_study"),
            overrides_of(override, seed),
            diameter=diameter,
            quick=quick,
            device=device.value,
            overwrite=overwrite,
            quiet=quiet,
        )
