"""The verb ``difference``."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import typer

from scanner_sim.cli.call import files_of
from scanner_sim.cli.report import warn
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.config import scenario_from_text
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.reprocess import changed_keys
from scanner_sim.products.difference import BEYOND, Difference, difference_json, difference_of, normal_beyond
from scanner_sim.products.files.contents import DIFFERENCE
from scanner_sim.products.files.folder import claim_folder, write_folder, write_text
from scanner_sim.products.formats.convert import result_in
from scanner_sim.products.image import RangeImage
from scanner_sim.products.shots import ShotTable

_SHOWN = 12
"""Changes of status and keys of scenarios that are printed."""


def compare_results(first: Path, second: Path, output: Path | None, *, overwrite: bool, quiet: bool) -> None:
    """Compare two results of one scan, into a folder.

    Raises
    ------
    InputError
        If either is no result of a scan, they are of different scans, or the folder cannot be written to.
    """
    from scanner_sim.products.pictures.difference import draw_difference

    results = [_scan(place) for place in (first, second)]
    names = (_name(first), _name(second))
    folder = output or Path("output", f"{names[1]}_less_{names[0]}")
    found = difference_of(*results)
    keys = _changed(results, names)
    if found.same_seed and not quiet:
        warn(
            f"both have seed {found.seeds[0]}: noise that they share cancels, and σ of both together is too large for "
            "their difference. Run one with another seed to compare what chance makes of it."
        )
    about = {"first": str(first), "second": str(second), "changed_keys": keys}
    writers: dict[str, Callable[[Path], None]] = {
        DIFFERENCE.result: lambda path: write_text(path, difference_json(found, about)),
        "difference.png": partial(draw_difference, found, names),
    }
    with claim_folder(folder, overwrite, DIFFERENCE):
        paths = write_folder(folder, DIFFERENCE, writers, overwrite=overwrite)
    if not quiet:
        _print(found, names, keys)
        print_table(files_of(paths))


def _scan(place: Path) -> RangeImage | ShotTable:
    value, _ = result_in(place)
    if not isinstance(value, RangeImage | ShotTable):
        raise InputError(
            f"{place} is a tracking run, and a difference is that of two scans.",
            remedy="Name folders of rasters or of shots.",
        )
    return value


def _name(place: Path) -> str:
    """Return the name of a result: of its folder, also where its range.exr is named."""
    place = place.resolve()
    return place.name if place.is_dir() else place.parent.name


def _changed(results: list[RangeImage | ShotTable], names: tuple[str, str]) -> list[str]:
    """Return the keys in which the scenarios of two results differ."""
    scenarios = [
        scenario_from_text(result.scenario_yaml, name=name, stored=True)
        for result, name in zip(results, names, strict=True)
    ]
    return changed_keys(*scenarios)


def _print(found: Difference, names: tuple[str, str], keys: list[str]) -> None:
    """Print the numbers of each range, what became of the statuses, and which keys differ."""
    rows = [["", "both", f"only {names[0]}", f"only {names[1]}", "median", "rms", "rms/σ"]]
    rows[0] += [f"beyond {sigmas:g} σ" for sigmas in BEYOND]
    for one in found.ranges:
        numbers = one.numbers()
        counts = [f"{numbers[name]:,}" for name in ("both", "only_first", "only_second")]
        metres, pull, beyond = (numbers[name] for name in ("difference_m", "over_sigma", "share_beyond"))
        rows.append(
            [one.name, *counts, *(_said(metres[name], 1e3, " mm") for name in ("median", "rms"))]
            + [_said(pull["rms"])]
            + [_said(beyond[f"{sigmas:g} sigma"]["found"], 100.0, " %") for sigmas in BEYOND]
        )
    normal = [f"{100.0 * normal_beyond(sigmas):.2g} %" for sigmas in BEYOND]
    rows.append(["normal errors", *[""] * 5, "1", *normal])
    print_rows(rows, left=(0,))
    typer.echo()
    changes = sorted(found.statuses.items(), key=lambda pair: -pair[1])
    table = {
        f"{before.name.lower()} to {after.name.lower()}".replace("_", " "): f"{number:,}"
        for (before, after), number in changes[:_SHOWN]
    }
    print_table(table or {"status": "the same everywhere"})
    more = f", … and {len(keys) - _SHOWN} more" if len(keys) > _SHOWN else ""
    print_table({"scenarios differ in": ", ".join(keys[:_SHOWN]) + more if keys else "nothing"})


def _said(value: float | None, factor: float = 1.0, unit: str = "") -> str:
    return "–" if value is None else f"{factor * value:.3g}{unit}"
