"""The command line ``scanner-sim``: its verbs, their options, and nothing that takes long to load."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scanner_sim.cli.campaigns import campaign
from scanner_sim.cli.controllers import serve
from scanner_sim.cli.judging import compare, reproduce
from scanner_sim.cli.looking import difference, view
from scanner_sim.cli.options import (
    Config,
    Device,
    DeviceName,
    Override,
    Overwrite,
    Peak,
    PlanKind,
    Pulse,
    Quiet,
    Seed,
    output_option,
    overrides_of,
    own_estimators,
    scenario_verb,
)
from scanner_sim.cli.report import open_streams, reported
from scanner_sim.cli.studies import acceptance, approach, budget, calibrate, orbit, pose_study, selfcal
from scanner_sim.foundation.errors import InputError

if TYPE_CHECKING:
    from scanner_sim.cli.call import Call

app = typer.Typer(
    name="scanner-sim",
    help="Simulate an auto-synchronised 3-D laser scanner, from a YAML scenario to a range image.",
    epilog="Exit status: 0 done, 1 the run failed, 2 bad input, 130 interrupted. "
    "Begin with: scanner-sim run configs/quickstart.yaml",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
)


@app.command()
@scenario_verb(before="overwrite")
def run(
    call: Call,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be done, and stop.")] = False,
) -> None:
    """Simulate a scenario and write its range image, pictures and point cloud.

    Example: `scanner-sim run configs/quickstart.yaml -o output/first --set scan.rows=64`

    The files appear whole or not at all. The same scenario and seed give the same bytes.
    """
    from scanner_sim.cli.running import run_scenario

    run_scenario(call, dry_run=dry_run)


@app.command()
def check(
    config: Config,
    override: Override = [],  # noqa: B006 (typer reads the default, nothing changes it)
    seed: Seed = None,
    peak: Peak = None,
    pulse: Pulse = None,
) -> None:
    """Check a scenario: print all of its faults, or the scenario with every default written out.

    Example: `scanner-sim check configs/quickstart.yaml > resolved.yaml`

    The files of the scene are opened too. Warnings go to the standard error stream.
    """
    with reported():
        from scanner_sim.cli.checking import check_scenario

        check_scenario(config, overrides_of(override, seed, peak, pulse))


@app.command()
@scenario_verb(
    output=output_option("The picture.", "output/ and CONFIG's name with _scene.png", metavar="PNG"),
    place=lambda config: Path("output", f"{config.stem}_scene.png"),
)
def scene(call: Call) -> None:
    """Show what stands before the scanner: a table of the objects, and a picture with sizes, names and field of view.

    Example: `scanner-sim scene configs/quickstart.yaml -o scene.png`

    Nothing is simulated: it takes seconds, whatever the scan. What moves stands where it does when the scan begins.
    """
    from scanner_sim.cli.viewing_scene import show_scene

    show_scene(call)


@app.command()
def show(
    result: Annotated[
        Path,
        typer.Argument(
            metavar="DIR_OR_EXR", help="Folder of a result, or its range.exr.", show_default=False
        ),
    ],
    voxel: Annotated[
        tuple[int, int] | None,
        typer.Option(
            metavar="ROW COL",
            help="Draw the line or waveform of one voxel, counted from 0.",
            show_default=False,
        ),
    ] = None,
    pattern: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=0,
            help="Draw one pattern of a tracking run, counted from 0.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        output_option("Folder of the pictures.", "beside the result"),
    ] = None,
    peak: Peak = None,
    pulse: Pulse = None,
    device: Device = DeviceName.auto,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace pictures that are there already in DIR.")
    ] = False,
) -> None:
    """Draw the pictures of a result, or explain one of its voxels or patterns.

    Examples: `scanner-sim show output/quickstart --voxel 128 128`, `scanner-sim show output/track_still --pattern 40`

    A voxel is simulated again from the scenario in the file: the light on the sensor's line, the digitised
    signal, the detected peak and the truth. A pattern is drawn from the voxels that the run has kept. A voxel that a
    function of your own measured needs `--peak` or `--pulse` again.
    """
    with reported():
        own_estimators(peak, pulse)
        from scanner_sim.cli.showing import show_result, show_shots, show_voxel
        from scanner_sim.cli.tracking import show_pattern, show_track
        from scanner_sim.products.files.exchange import recover

        recover(result if result.is_dir() else result.parent)
        if pattern is not None:
            show_pattern(result, pattern, output, overwrite=overwrite)
        elif voxel is None and (result / "track.csv").exists():
            show_track(result, output, device=device.value, overwrite=overwrite)
        elif voxel is None and (result / "shots.parquet").exists():
            show_shots(result, output, overwrite=overwrite)
        elif voxel is None:
            show_result(result, output, overwrite=overwrite)
        else:
            show_voxel(result, voxel, output, device=device.value, overwrite=overwrite)


@app.command()
def convert(
    result: Annotated[
        Path,
        typer.Argument(metavar="RESULT", help="Folder of a run, or its range.exr.", show_default=False),
    ],
    to: Annotated[
        list[str],
        typer.Option(
            "--to",
            metavar="FORMAT",
            help="laz, las, e57, pcd, pcd_ascii or rosbag2. May be repeated.",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path | None,
        output_option("Folder of the files.", "beside the result"),
    ] = None,
    by: Annotated[
        str,
        typer.Option(
            metavar="RANGEFINDER",
            help="Whose points, where both measured: triangulation, tof or fused.",
            show_default="triangulation, or tof where it is alone",
        ),
    ] = "",
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace files that are there.")] = False,
    quiet: Quiet = False,
) -> None:
    """Write the points of a result for other programs: LAS 1.4, E57, PCD, a bag of ROS 2.

    Example: `scanner-sim convert output/quickstart --to laz --to e57 -o output/exchange`

    The files are points.laz, points.las, points.e57, points.pcd, points_ascii.pcd; with rosbag2 DIR becomes a bag
    (metadata.yaml, points.mcap), with targets and poses of a track. The guide *Results in other programs* says what
    each keeps. `output.formats` makes runs write the same.
    """
    with reported():
        from scanner_sim.cli.converting import convert_result

        convert_result(result, to, output, by=by, overwrite=overwrite, quiet=quiet)


@app.command()
def reprocess(
    result: Annotated[
        Path,
        typer.Argument(
            metavar="DIR",
            help="Folder of a run with output.lines or output.waveforms.",
            show_default=False,
        ),
    ],
    override: Override = [],  # noqa: B006 (typer reads the default, nothing changes it)
    seed: Seed = None,
    peak: Peak = None,
    pulse: Pulse = None,
    output: Annotated[
        Path | None,
        output_option("Folder of the result.", "DIR with _again"),
    ] = None,
    device: Device = DeviceName.auto,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Draw other noise on the light of a run, or process it otherwise, without rendering it again.

    Example: `scanner-sim reprocess output/quickstart --set processing.peak=gaussian --seed 2 -o output/gaussian`

    The run must have kept its lines (`output.lines: all`) or waveforms. `--set` takes keys of detector and processing;
    what changes the light is refused. The result is, byte for byte, that of a whole run with the scenario that is
    written: with another seed that has `transport.light_seed`, since the errors of the mirrors move the light. There
    is no `camera.png`.
    """
    with reported():
        from scanner_sim.cli.reprocessing import reprocess_signals

        reprocess_signals(
            result,
            overrides_of(override, seed, peak, pulse),
            output,
            device=device.value,
            overwrite=overwrite,
            quiet=quiet,
        )


for verb in (
    view,
    difference,
    orbit,
    calibrate,
    selfcal,
    acceptance,
    budget,
    pose_study,
    approach,
    compare,
    reproduce,
    serve,
):
    app.command()(verb)
app.add_typer(campaign, name="campaign")


@app.command()
def info() -> None:
    """Print versions, the LLVM library, the GPU and the number of threads."""
    with reported():
        from scanner_sim.cli.checking import print_info

        print_info()


@app.command()
def instruments(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME_OR_FILE", help="Shipped instrument, or a file of your own.", show_default=False
        ),
    ] = None,
    yaml: Annotated[bool, typer.Option("--yaml", help="Print the file itself, to copy and change.")] = False,
    diff: Annotated[
        str | None,
        typer.Option(
            metavar="OTHER", help="Print what another instrument has unlike it.", show_default=False
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="PNG", help="Draw it to scale, with spot and σ over range.", show_default=False),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a picture that is there.")] = False,
) -> None:
    """List the shipped instruments, or explain one: ranges, field of view, σ, each value with its mark and source.

    Examples: `scanner-sim instruments nrc_2000 --picture nrc_2000.png`,
    `scanner-sim instruments nrc_2000 --yaml > my_scanner.yaml`

    With `scanner: {preset: my_scanner.yaml}` a scenario takes a file of your own. Here all of its faults are printed.
    """
    with reported():
        from scanner_sim.cli import explaining

        if name is None:
            if yaml or diff is not None or picture is not None:
                raise InputError(
                    "no instrument is named.", remedy="Write for example: instruments nrc_2000 --yaml"
                )
            explaining.list_instruments()
        elif diff is not None:
            explaining.print_differences(name, diff)
        elif yaml:
            explaining.print_instrument_file(name)
        else:
            explaining.print_instrument(name, picture, overwrite=overwrite)


@app.command()
def schema(
    messages: Annotated[
        bool, typer.Option("--messages", help="That of the messages which `serve` understands.")
    ] = False,
    plan: Annotated[
        PlanKind | None,
        typer.Option("--plan", help="That of the plan of a self-calibration or an acceptance test."),
    ] = None,
) -> None:
    """Print the JSON schema of scenarios, by which editors complete and check them.

    Example: `scanner-sim schema > scenario.schema.json`, and as the first line of a scenario
    `# yaml-language-server: $schema=scenario.schema.json`
    """
    with reported():
        import json

        from scanner_sim.acceptance.plan import AcceptancePlan
        from scanner_sim.calibration.plan import SelfCalibration
        from scanner_sim.config import json_schema
        from scanner_sim.serve.messages import messages_schema

        if plan is PlanKind.SELFCAL:
            printed = json_schema(SelfCalibration, f"plan for {plan}")
        elif plan is PlanKind.ACCEPTANCE:
            printed = json_schema(AcceptancePlan, f"plan for {plan}")
        else:
            printed = messages_schema() if messages else json_schema()
        typer.echo(json.dumps(printed, indent=2, ensure_ascii=False))


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"scanner-sim {version('scanner-sim')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Simulate an auto-synchronised 3-D laser scanner, from a YAML scenario to a range image."""


def main() -> None:
    """Run the command line."""
    open_streams()
    try:
        with reported():
            app()
    except typer.Exit as end:
        sys.exit(end.exit_code)
