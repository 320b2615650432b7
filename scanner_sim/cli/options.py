"""Options that several verbs of the command line share."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer


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


def folder_option(ending: str = "") -> Any:
    """Return the option of the folder that a verb writes, by default :func:`folder_of` its scenario."""
    usual = f"output/ and CONFIG's name{f' with _{ending}' if ending else ''}"
    return typer.Option("--output", "-o", metavar="DIR", help="Folder of the result.", show_default=usual)


def folder_of(config: Path, ending: str = "") -> Path:
    """Return the folder in which the result of a verb for a scenario goes where none is named."""
    return Path("output", f"{config.stem}_{ending}" if ending else config.stem)


def overrides_of(override: list[str], seed: int | None) -> list[str]:
    """Return the replaced values with that of the seed, where one is given."""
    return override if seed is None else [*override, f"seed={seed}"]
