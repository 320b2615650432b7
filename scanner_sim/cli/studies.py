"""Verbs that study an instrument: over an orbit, its estimators, its errors, its poses."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scanner_sim.cli.options import (
    Device,
    DeviceName,
    NamedPeak,
    NamedPulse,
    Overwrite,
    Quiet,
    output_option,
    own_estimators,
    scenario_verb,
)
from scanner_sim.cli.report import reported

if TYPE_CHECKING:
    from scanner_sim.cli.call import Call


@scenario_verb("orbit")
def orbit(
    call: Call,
    steps: Annotated[
        int, typer.Option(metavar="N", min=1, max=100_000, help="Moments, evenly spaced over one orbit.")
    ] = 90,
) -> None:
    """Sweep one orbit: for each target the share of time in each condition of illumination.

    Example: `scanner-sim orbit configs/lighting_orbit.yaml --steps 180`

    The scenario's lighting needs an `orbit` or a `tle`. Targets are its target arrays, or else all objects. A table,
    a timeline, CSV and JSON say when each is lit, in shadow, in the dark, or seen against the Sun.
    """
    from scanner_sim.cli.orbit import orbit_scenario

    orbit_scenario(call, steps=steps)


@scenario_verb(
    output=output_option("Table of the errors, a CSV file.", "CONFIG's name with _bias.csv", metavar="FILE"),
    place=lambda config: Path(f"{config.stem}_bias.csv"),
)
def calibrate(call: Call) -> None:
    """Measure the systematic error of the peak estimator, and write the table that corrects it.

    Example: `scanner-sim calibrate configs/quickstart.yaml -o bias.csv --set processing.peak=parabola`

    A flat white target is moved through the range without noise. The table, with a picture beside it, is used by
    `processing.bias_correction: bias.csv`. What base, lens and array depart from `processing.calibration` goes into it;
    errors above a pixel are refused.
    """
    from scanner_sim.cli.calibrating import calibrate_scenario

    calibrate_scenario(call)


@scenario_verb("budget")
def budget(
    call: Call,
    distances: Annotated[
        int,
        typer.Option(
            metavar="N", min=2, max=200, help="Distances of the target, up to 30 m or the gate's end."
        ),
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
) -> None:
    """Tell where the range error comes from: each source alone and all together, against range.

    Example: `scanner-sim budget configs/plane.yaml --image --set processing.peak=maximum_likelihood`

    A facing flat target stands at log-spaced distances in the scenario's light. A table, CSV, JSON and a picture hold
    simulated standard deviations with 95 % intervals beside those of closed forms.
    """
    from scanner_sim.cli.budgeting import budget_scenario

    budget_scenario(call, count=distances, reflectance=reflectance, sweep=sweep, image=image)


@scenario_verb("pose_study")
def pose_study(
    call: Call,
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
) -> None:
    """Compare arrays of targets: the error of each component of their pose against range, size, number and method.

    Example: `scanner-sim pose-study configs/target_board.yaml --quick`

    Targets are measured from simulated pixels at several ranges, by the scenario's instrument in the dark. Poses by
    angles (uv), points (xyz) and both (joint), with each rangefinder that the instrument has, stand beside closed
    forms: tables, JSON, and Figure 15 as a picture. Targets are told by their light on a line sensor: without one there
    is no study.
    """
    from scanner_sim.cli.pose_study import study_scenario

    study_scenario(call, diameter=diameter, quick=quick)


def approach(
    file: Annotated[
        Path, typer.Argument(metavar="APPROACH", help="The approach, a YAML file.", show_default=False)
    ],
    output: Annotated[
        Path | None,
        output_option("Folder of the result.", "output/ and APPROACH's name"),
    ] = None,
    workers: Annotated[
        int,
        typer.Option(metavar="N", min=0, max=1024, help="Processes of Dask; 0 works in this one."),
    ] = 0,
    peak: NamedPeak = None,
    pulse: NamedPulse = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Check it, print its epochs, and stop.")] = False,
    device: Device = DeviceName.auto,
    quiet: Quiet = False,
) -> None:
    """Fly an approach under the light of its orbit: which method has a pose where, how good, and how good it says.

    Example: `scanner-sim approach configs/approach/v_bar.yaml`

    At epochs along a path (waypoints, a file, CCSDS, or Clohessy and Wiltshire's equations) the targets are tracked a
    few times by angles, points, both and time of flight. DIR gets a picture over range, a table over the conditions of
    Table 1, and all tries. It is the folder of a campaign: what a killed one has done stays, the same command goes on.
    """
    with reported():
        from scanner_sim.cli.approaching import fly_approach

        fly_approach(
            file,
            output or Path("output", file.stem),
            workers=workers,
            peak=peak,
            pulse=pulse,
            dry_run=dry_run,
            device=device.value,
            quiet=quiet,
        )


def selfcal(
    plan: Annotated[
        Path,
        typer.Argument(metavar="BOARDS", help="Plan of the calibration, a YAML file.", show_default=False),
    ],
    output: Annotated[
        Path | None,
        output_option(
            "The calibration, a YAML file; report, tables and pictures stand beside it.",
            "BOARDS' name with _calib.yaml",
            metavar="FILE",
        ),
    ] = None,
    peak: NamedPeak = None,
    pulse: NamedPulse = None,
    device: Device = DeviceName.auto,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Calibrate an instrument from sightings of boards, and say what they do not tell.

    Example: `scanner-sim selfcal configs/calibration/two_boards.yaml -o calib.yaml`

    Targets on boards or spheres are measured from several stations, simulated with the instrument as built or read from
    a table of your own. A network adjustment finds the instrument's parameters with their covariance, stations and
    boards together; what was held out tells how well they hold. The file is used by
    `processing.calibration: calib.yaml`.
    """
    with reported():
        own_estimators(peak, pulse)
        from scanner_sim.cli.self_calibrating import self_calibrate_plan

        self_calibrate_plan(
            plan,
            output or Path(f"{plan.stem}_calib.yaml"),
            device=device.value,
            overwrite=overwrite,
            quiet=quiet,
        )


def acceptance(
    plan: Annotated[
        Path,
        typer.Argument(metavar="PLAN", help="Plan of the test, a YAML file.", show_default=False),
    ],
    output: Annotated[
        Path | None,
        output_option("Folder of the report and its pictures.", "output/PLAN's name"),
    ] = None,
    peak: NamedPeak = None,
    pulse: NamedPulse = None,
    device: Device = DeviceName.auto,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Test an instrument against its maker's limits; the exit status is 1 unless it passes.

    Example: `scanner-sim acceptance configs/acceptance/prototype.yaml -o output/acceptance`

    Bars, spheres and plates over the working volume are scanned through light and detector, in the manner of ASTM E3125
    and VDI/VDE 2634. Errors of lengths, diameters, form and flatness stand beside certified values, limits and the
    test's own uncertainty, each with a verdict: a table, JSON and a page with pictures.
    """
    with reported():
        own_estimators(peak, pulse)
        from scanner_sim.cli.accepting import accept_plan

        accept_plan(
            plan,
            output or Path("output", plan.stem),
            device=device.value,
            overwrite=overwrite,
            quiet=quiet,
        )
