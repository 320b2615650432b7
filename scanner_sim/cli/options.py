"""Options that several verbs of the command line share, and what makes a verb for a scenario."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from functools import partial, wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from scanner_sim.cli.report import reported


class PlanKind(StrEnum):
    """Plans whose form is printed."""

    SELFCAL = "selfcal"
    ACCEPTANCE = "acceptance"


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
_own = partial(typer.Option, metavar="MODULE:FUNCTION", show_default=False)
Peak = Annotated[
    str | None, _own("--peak", help="Find peaks by a function of your own: it becomes `processing.peak`.")
]
Pulse = Annotated[
    str | None,
    _own("--pulse", help="Time echoes by a function of your own: it becomes `processing.pulse.timing`."),
]
NamedPeak = Annotated[
    str | None,
    _own(
        "--peak", help="A function of your own that finds peaks, which the files name in `processing.peak`."
    ),
]
NamedPulse = Annotated[
    str | None,
    _own(
        "--pulse",
        help="A function of your own that times echoes, which the files name in `processing.pulse.timing`.",
    ),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")]


def output_option(meaning: str, default: str, metavar: str = "DIR") -> Any:
    """Return the option ``--output`` of a verb: what it writes there, and where it does so by default, in words."""
    return typer.Option("--output", "-o", metavar=metavar, help=meaning, show_default=default)


def beside(folder: Path, ending: str) -> Path:
    """Return the place next to a folder that has its name and an ending, where the folder is ``.`` or ``..``, too."""
    named = folder.resolve() if folder.name in ("", "..") else folder
    return named.parent / f"{named.name}{ending}"


def scenario_verb(
    ending: str = "",
    *,
    output: Any = None,
    place: Callable[[Path], Path] | None = None,
    before: str = "override",
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return what makes a verb of a function of a :class:`~scanner_sim.cli.call.Call` and of options of its own.

    The verb has besides what every verb for a scenario has: CONFIG, -o, --set, --seed, --peak, --pulse, --device,
    --overwrite and --quiet. Its faults become messages.

    Parameters
    ----------
    ending
        Of the name of its folder, where none is given: output/ and the scenario's name.
    output, place
        Another option for what it writes, and where that is by default, for a scenario's file.
    before
        Before which of the shared options its own stand.
    """
    usual = f"output/ and CONFIG's name{f' with _{ending}' if ending else ''}"

    def default(config: Path) -> Path:
        return Path("output", f"{config.stem}_{ending}" if ending else config.stem)

    shared: dict[str, tuple[Any, Any]] = {
        "config": (Config, Parameter.empty),
        "output": (Annotated[Path | None, output or output_option("Folder of the result.", usual)], None),
        "override": (Override, []),
        "seed": (Seed, None),
        "peak": (Peak, None),
        "pulse": (Pulse, None),
        "device": (Device, DeviceName.auto),
        "overwrite": (Overwrite, False),
        "quiet": (Quiet, False),
    }

    def made(work: Callable[..., None]) -> Callable[..., None]:
        kinds = get_type_hints(work, localns={"Call": object}, include_extras=True)
        own = [
            option.replace(kind=Parameter.KEYWORD_ONLY, annotation=kinds[name])
            for name, option in list(signature(work).parameters.items())[1:]
        ]
        every = [
            Parameter(name, Parameter.KEYWORD_ONLY, default=value, annotation=kind)
            for name, (kind, value) in shared.items()
        ]
        at = list(shared).index(before)
        every[at:at] = own

        @wraps(work)
        def verb(**given: Any) -> None:
            with reported():
                from scanner_sim.cli.call import Call

                work(
                    Call(
                        given["config"],
                        given["output"] or (place or default)(given["config"]),
                        overrides_of(given["override"], given["seed"], given["peak"], given["pulse"]),
                        given["device"].value,
                        given["overwrite"],
                        given["quiet"],
                    ),
                    **{option.name: given[option.name] for option in own},
                )

        verb.__signature__ = Signature(every)  # type: ignore[attr-defined]
        verb.__annotations__ = {option.name: option.annotation for option in every}
        return verb

    return made


def overrides_of(
    override: list[str], seed: int | None, peak: str | None = None, pulse: str | None = None
) -> list[str]:
    """Return the replaced values with that of the seed, where one is given; register the estimators that are named.

    Raises
    ------
    InputError
        If there is no such function, or its name is taken.
    """
    taken = own_estimators(peak, pulse)
    return [*taken, *override] if seed is None else [*taken, *override, f"seed={seed}"]


def own_estimators(peak: str | None, pulse: str | None) -> list[str]:
    """Register the estimators that the command line names; return the overrides by which a scenario takes them."""
    if peak is None and pulse is None:
        return []
    from scanner_sim.signals.named import NamedEstimators

    return NamedEstimators.of(peak, pulse).register()
