"""The verb ``instruments``."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from scanner_sim.cli.checking import print_yaml
from scanner_sim.cli.report import warn
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.config import load_scanner, scenario_warnings
from scanner_sim.config.document import Location, spell, value_at
from scanner_sim.config.preset import Preset, preset_text, read_preset, shipped_presets
from scanner_sim.config.scanner import Scanner
from scanner_sim.config.wording import inline_yaml

if TYPE_CHECKING:
    from scanner_sim.products.instrument_sheet import InstrumentSheet

_LINES = 8
"""Ranges of the table."""
_WAYS = {"triangulation": "triangulation", "tof": "time of flight", "fused": "both"}


def list_instruments() -> None:
    """Print the names of the shipped instruments, and what each is."""
    print_table({one: read_preset(one).about for one in shipped_presets()})


def print_instrument_file(name: str) -> None:
    """Print the file of an instrument.

    Raises
    ------
    ScannerSimError
        If there is no such instrument, or its file has faults.
    """
    load_scanner(name)
    print_yaml(preset_text(name))


def print_instrument(name: str, picture: Path | None, *, overwrite: bool) -> None:
    """Print what an instrument can do and each of its values with mark and source; draw it if a file is named.

    Raises
    ------
    ScannerSimError
        If there is no such instrument, its file has faults, or the picture cannot be written.
    """
    from scanner_sim.products.files.exchange import write_file
    from scanner_sim.products.pictures.instrument import draw_instrument
    from scanner_sim.validation.compare.instrument_sheet import alone, instrument_sheet

    scanner, preset = load_scanner(name), read_preset(name)
    for sentence in scenario_warnings(alone(scanner)):
        if sentence.startswith("scanner."):
            warn(sentence)
    sheet = instrument_sheet(scanner)
    table = {"instrument": preset.about, **_properties(scanner, sheet)}
    if picture is not None:
        write = partial(draw_instrument, sheet, f"{name}, the instrument")
        table["picture"] = str(write_file(picture, write, overwrite=overwrite))
    print_table(table)
    typer.echo("")
    print_rows(list(_table(sheet)))
    typer.echo("")
    rows = [
        (spell(at[1:]), inline_yaml(stated.value), stated.mark, stated.source)
        for at, stated in preset.stated.items()
    ]
    print_rows([("key", "value", "mark", "source"), *rows], left=(0, 1, 2, 3))


def print_differences(name: str, other: str) -> None:
    """Print what two instruments have unlike one another.

    Raises
    ------
    ScannerSimError
        If there is no such instrument, or its file has faults.
    """
    from scanner_sim.validation.compare.instrument_sheet import instrument_sheet

    pair = (name, other)
    scanners, presets = [load_scanner(one) for one in pair], [read_preset(one) for one in pair]
    sheets = [_properties(scanner, instrument_sheet(scanner)) for scanner in scanners]
    unlike = [
        (word, sheets[0][word], sheets[1][word]) for word in sheets[0] if sheets[0][word] != sheets[1][word]
    ]
    values = [scanner.model_dump(mode="json", by_alias=True) for scanner in scanners]
    for at in dict.fromkeys((*presets[0].stated, *presets[1].stated)):
        one, two = (value_at(whole, at[1:]) for whole in values)
        if one != two:
            unlike.append((spell(at[1:]), _stated(presets[0], at, one), _stated(presets[1], at, two)))
    if unlike:
        print_rows([("", *pair), *unlike], left=(0, 1, 2))
    else:
        typer.echo(f"{name} and {other} have the same values.")


def _stated(preset: Preset, at: Location, value: object) -> str:
    """Return a value with the mark that its preset gives it."""
    return f"{inline_yaml(value)} ({preset.stated[at].mark})" if at in preset.stated else "–"


def _properties(scanner: Scanner, sheet: InstrumentSheet) -> dict[str, str]:
    """Return what follows from an instrument's values, as pairs of a word and a phrase."""
    laser = scanner.laser
    beyond = f"{sheet.far:.4g} m" if math.isfinite(sheet.far) else "infinity"
    recorded = (
        f"; {sheet.gate[0]:.4g} m to {sheet.gate[1]:.4g} m by time of flight"
        if "tof" in sheet.sigma_m
        else ""
    )
    divergence = 2.0 * laser.waist_radius / laser.rayleigh_length
    return {
        "ranges on the axis": f"{sheet.near:.4g} m to {beyond} on the array" + recorded,
        "field of view": f"±{math.degrees(sheet.half_field):.3g}° on both axes",
        "rate": f"{sheet.rate:.6g} voxels/s",
        "beam": f"{1e3 * laser.power:.4g} mW at {1e6 * laser.wavelength:.4g} µm, "
        f"waist of {2e3 * laser.waist_radius:.4g} mm (1/e²) at {laser.waist_distance:.4g} m, "
        f"full divergence {1e3 * divergence:.3g} mrad",
        "receiver": f"base {1e3 * sheet.baseline:.4g} mm, f = {1e3 * sheet.focal_length:.4g} mm, "
        f"f/{sheet.focal_length / sheet.aperture:.3g}; {_array(scanner)}",
    }


def _array(scanner: Scanner) -> str:
    """Return a phrase for the array's tilt and focus."""
    receiver = scanner.receiver
    if receiver.array_tilt == "ideal":
        return "array sharp at every range"
    tilt = math.degrees(math.atan(receiver.line_image.slope))
    if receiver.array_tilt == "scheimpflug":
        return f"array tilted by {tilt:.3g}°, Scheimpflug's condition"
    focus = "infinity" if receiver.focus_distance == "infinity" else f"{receiver.focus_distance:.4g} m"
    return f"array tilted by {tilt:.3g}°, in focus at {focus}"


def _table(sheet: InstrumentSheet) -> Iterator[tuple[str, ...]]:
    """Yield the lines of a table of lengths [mm] over range."""
    ways = list(sheet.sigma_m)
    named = (f"σ {_WAYS[way]} [mm]" for way in ways)
    head = ("range [m]", "beam [mm]", "pixel [mm]", "σ across [mm]", "spot σ [pixel]", "of full well")
    yield (*head, *named)
    last = len(sheet.range_m) - 1
    for line in range(_LINES):
        at = round(line * last / (_LINES - 1))
        lengths = (sheet.spot_m, sheet.pixel_m, sheet.lateral_m, *(sheet.sigma_m[way] for way in ways))
        cells = [_rounded(1e3 * float(values[at])) for values in lengths]
        yield (
            f"{sheet.range_m[at]:.3g}",
            *cells[:3],
            _rounded(float(sheet.image_px[at])),
            f"{_rounded(100.0 * float(sheet.filled[at]))} %",
            *cells[3:],
        )


def _rounded(number: float) -> str:
    """Return three digits of a number, without an exponent where that is no longer."""
    return f"{float(f'{number:.3g}'):g}" if math.isfinite(number) else "–"
