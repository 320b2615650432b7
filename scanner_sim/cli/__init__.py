"""The command line ``scanner-sim``: its verbs, their options, and nothing that takes long to load."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from scanner_sim.cli.report import reported

app = typer.Typer(
    name="scanner-sim",
    help="Simulate an auto-synchronised 3-D laser scanner, from a YAML scenario to a range image.",
    epilog="Exit status: 0 done, 1 the run failed, 2 bad input. Begin with: scanner-sim run configs/quickstart.yaml",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
)


class DeviceName(StrEnum):
    """Where to compute."""

    auto = "auto"
    cpu = "cpu"
    cuda = "cuda"


def _complete_key(incomplete: str) -> list[str]:
    from scanner_sim.cli.plan import keys

    return [f"{key}=" for key in keys() if key.startswith(incomplete)]


Config = Annotated[Path, typer.Argument(metavar="CONFIG", help="Scenario, a YAML file.", show_default=False)]
Override = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Replace a value of the scenario, as `scan.rows=64`, `scanner.laser.power='20 mW'` or "
        "`scene.objects.wall.position='[0 m, 0 m, 8 m]'`. May be repeated.",
        autocompletion=_complete_key,
    ),
]
Seed = Annotated[
    int | None, typer.Option(metavar="N", help="Seed of the random numbers.", show_default="the scenario's")
]
Device = Annotated[
    DeviceName, typer.Option(help="Compute on the processor or on an NVIDIA GPU; auto takes the GPU if any.")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace an existing result.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]


@app.command()
def run(
    config: Config,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Folder of the result.",
            show_default="output/ and CONFIG's name",
        ),
    ] = None,
    override: Override = [],  # noqa: B006 (typer reads the default, nothing changes it)
    seed: Seed = None,
    device: Device = DeviceName.auto,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be done, and stop.")] = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Simulate a scenario and write its range image, pictures and point cloud.

    Example: `scanner-sim run configs/quickstart.yaml -o output/first --set scan.rows=64`

    The files appear whole or not at all. The same scenario and seed give the same bytes.
    """
    with reported():
        from scanner_sim.cli.running import run_scenario

        run_scenario(
            config,
            output or Path("output", config.stem),
            _overrides(override, seed),
            device=device.value,
            dry_run=dry_run,
            overwrite=overwrite,
            quiet=quiet,
        )


@app.command()
def check(config: Config, override: Override = [], seed: Seed = None) -> None:  # noqa: B006 (as above)
    """Check a scenario: print all of its faults, or the scenario with every default written out.

    Example: `scanner-sim check configs/quickstart.yaml > resolved.yaml`

    The files of the scene are opened too. Warnings go to the standard error stream.
    """
    with reported():
        from scanner_sim.cli.checking import check_scenario

        check_scenario(config, _overrides(override, seed))


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
        typer.Option(
            "--output", "-o", metavar="DIR", help="Folder of the pictures.", show_default="beside the result"
        ),
    ] = None,
    device: Device = DeviceName.auto,
) -> None:
    """Draw the pictures of a result, or explain one of its voxels or patterns.

    Examples: `scanner-sim show output/quickstart --voxel 128 128`, `scanner-sim show output/track_static --pattern 40`

    A voxel is simulated again from the scenario in the file: the light on the sensor's line, the digitised
    signal, the detected peak and the truth. A pattern is drawn from the voxels that the run has kept.
    """
    with reported():
        from scanner_sim.cli.showing import show_result, show_voxel
        from scanner_sim.cli.tracking import show_pattern, show_track

        if pattern is not None:
            show_pattern(result, pattern, output)
        elif voxel is None and (result / "track.csv").exists():
            show_track(result, output, device=device.value)
        elif voxel is None:
            show_result(result, output)
        else:
            show_voxel(result, voxel, output, device=device.value)


@app.command()
def orbit(
    config: Config,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Folder of the result.",
            show_default="output/ and CONFIG's name with _orbit",
        ),
    ] = None,
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
        from scanner_sim.cli.orbit import FOLDER, orbit_scenario

        orbit_scenario(
            config,
            output or Path("output", FOLDER.format(config.stem)),
            _overrides(override, seed),
            steps=steps,
            device=device.value,
            overwrite=overwrite,
            quiet=quiet,
        )


@app.command()
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
            _overrides(override, seed),
            device=device.value,
            overwrite=overwrite,
            quiet=quiet,
        )


@app.command()
def budget(
    config: Config,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Folder of the result.",
            show_default="output/ and CONFIG's name with _budget",
        ),
    ] = None,
    distances: Annotated[
        int, typer.Option(metavar="N", min=2, max=200, help="Distances of the target, up to 30 m.")
    ] = 12,
    reflectance: Annotated[
        float, typer.Option(metavar="RHO", min=1e-3, max=1.0, help="Reflectance of the facing target.")
    ] = 0.5,
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
        from scanner_sim.cli.budgeting import FOLDER, budget_scenario

        budget_scenario(
            config,
            output or Path("output", FOLDER.format(config.stem)),
            _overrides(override, seed),
            count=distances,
            reflectance=reflectance,
            image=image,
            device=device.value,
            overwrite=overwrite,
            quiet=quiet,
        )


@app.command()
def reproduce(
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ITEM", help="Make only this item, as `fig12`; may be repeated.", show_default="all"
        ),
    ] = None,
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
    """Make the paper's equations, tables and figures again from simulated data.

    Example: `scanner-sim reproduce --only fig12 --only table1 -o output/paper`

    For each: its picture, what the paper says, what was found, and where they differ and why, on one page. What is
    finished is kept: an interrupted run goes on where it was.
    """
    with reported():
        from scanner_sim.cli.reproducing import reproduce_paper

        reproduce_paper(
            output, only or (), quick=quick, seed=seed, device=device.value, overwrite=overwrite, quiet=quiet
        )


@app.command(name="pose-study")
def pose_study(
    config: Config,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Folder of the result.",
            show_default="output/ and CONFIG's name with _pose_study",
        ),
    ] = None,
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
    angles (uv), points (xyz) and both (joint), with triangulation and time of flight, stand beside closed forms: tables,
    JSON, and Figure 15 as a picture.
    """
    with reported():
        from scanner_sim.cli.pose_study import FOLDER, study_scenario

        study_scenario(
            config,
            output or Path("output", FOLDER.format(config.stem)),
            _overrides(override, seed),
            diameter=diameter,
            quick=quick,
            device=device.value,
            overwrite=overwrite,
            quiet=quiet,
        )


@app.command()
def compare(
    config: Config,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Folder of the result.",
            show_default="output/ and CONFIG's name with _compare",
        ),
    ] = None,
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
    ] = [],  # noqa: B006 (as above)
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
    override: Override = [],  # noqa: B006 (as above)
    seed: Seed = None,
    device: Device = DeviceName.auto,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an existing result.")] = False,
    quiet: Quiet = False,
) -> None:
    """Compare the simulation with closed forms, law by law; the exit status is 1 where one is broken.

    Example: `scanner-sim compare configs/plane.yaml --target '50 % at 3 m, 8 m, 20 m'`

    Each law that applies to the instrument is measured and judged: predicted and simulated numbers, deviation,
    probability at a family-wise level, and what the test would have found. A table, JSON and a page with pictures.
    With `--baseline` the same seed must give the same numbers, another seed the same statistics.
    """
    with reported():
        from scanner_sim.cli.comparing import FOLDER, compare_scenario

        compare_scenario(
            config,
            output or Path("output", FOLDER.format(config.stem)),
            _overrides(override, seed),
            target=target,
            only=only,
            seeds=seeds,
            level=level,
            quick=quick,
            baseline=baseline,
            device=device.value,
            overwrite=overwrite,
            quiet=quiet,
        )


@app.command()
def info() -> None:
    """Print versions, the LLVM library, the GPU and the number of threads."""
    with reported():
        from scanner_sim.cli.checking import print_info

        print_info()


@app.command()
def schema() -> None:
    """Print the JSON schema of scenarios, by which editors complete and check them.

    Example: `scanner-sim schema > scenario.schema.json`, and as the first line of a scenario
    `# yaml-language-server: $schema=scenario.schema.json`
    """
    with reported():
        import json

        from scanner_sim.config import json_schema

        typer.echo(json.dumps(json_schema(), indent=2, ensure_ascii=False))


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


def _overrides(override: list[str], seed: int | None) -> list[str]:
    return override if seed is None else [*override, f"seed={seed}"]


def main() -> None:
    """Run the command line."""
    app()
