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
from scanner_sim.config.scanner import RangefinderName, Scanner
from scanner_sim.config.wording import inline_yaml
from scanner_sim.optics.pulse import FWHM

if TYPE_CHECKING:
    from scanner_sim.products.instrument_sheet import InstrumentSheet

_LINES = 8
"""Ranges of the table."""
_WAYS = {"triangulation": "triangulation", "tof": "time of flight", "fused": "both"}


def list_instruments() -> None:
    """Print the shipped instruments: ranges, field of view and rate, and what each is."""
    names = shipped_presets()
    rows = []
    for name in names:
        scanner = load_scanner(name)
        seen = ", ".join(_seen(scanner, way) for way in scanner.seeing)
        field = f"±{math.degrees(scanner.mirrors.max_deflection):.3g}°"
        rows.append((name, seen, field, f"{scanner.rate:.6g} /s"))
    print_rows([("instrument", "ranges", "field", "rate"), *rows], left=(0, 1, 2, 3))
    typer.echo("")
    print_table({name: read_preset(name).about for name in names})


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
    table = {"instrument": preset.about, **instrument_properties(scanner, sheet)}
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
    sheets = [instrument_properties(scanner, instrument_sheet(scanner)) for scanner in scanners]
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


def instrument_properties(scanner: Scanner, sheet: InstrumentSheet) -> dict[str, str]:
    """Return what follows from an instrument's values, as pairs of a word and a phrase."""
    laser = scanner.laser
    base = "" if sheet.line is None else f"base {1e3 * sheet.baseline:.4g} mm, "
    return {
        "ranges on the axis": "; ".join(_seen(scanner, name) for name in scanner.seeing),
        "field of view": f"±{math.degrees(sheet.half_field):.3g}° on both axes",
        "rate": f"{sheet.rate:.6g} voxels/s",
        "beam": f"{_light(scanner)} at {1e6 * laser.wavelength:.4g} µm, "
        f"waist of {2e3 * laser.waist_radius:.4g} mm (1/e²) at {laser.waist_distance:.4g} m, "
        f"full divergence {2e3 * laser.divergence:.3g} mrad",
        "receiver": f"{base}f = {1e3 * sheet.focal_length:.4g} mm, "
        f"f/{sheet.focal_length / sheet.aperture:.3g}"
        + ("" if sheet.line is None else f"; {_array(scanner)}"),
    }


def _seen(scanner: Scanner, rangefinder: RangefinderName) -> str:
    """Return the ranges of a rangefinder in words."""
    near, far = scanner.seen_by(rangefinder)
    beyond = f"{far:.4g} m" if math.isfinite(far) else "infinity"
    return f"{near:.4g} m to {beyond} " + ("by time of flight" if rangefinder == "tof" else "on the array")


def _light(scanner: Scanner) -> str:
    """Return the laser's power in words, or the energy of its pulses without an array."""
    if "triangulation" in scanner.rangefinders:
        power = scanner.laser.power
        return f"{1e3 * power:.4g} mW" if power >= 1e-5 else f"{1e6 * power:.4g} µW"
    pulse = scanner.lidar.pulse
    return f"pulses of {1e6 * pulse.pulse_energy:.4g} µJ and {1e9 * FWHM * pulse.sigma:.4g} ns"


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
    columns = {"beam [mm]": 1e3 * sheet.spot_m}
    if sheet.line is not None:
        columns["pixel [mm]"] = 1e3 * sheet.line.pixel_m
    if sheet.lateral_m.any():
        columns["σ across [mm]"] = 1e3 * sheet.lateral_m
    if sheet.line is not None:
        columns["spot σ [pixel]"] = sheet.line.image_px
        columns["% of full well"] = 100.0 * sheet.line.filled
    columns |= {f"σ {_WAYS[way]} [mm]": 1e3 * values for way, values in sheet.sigma_m.items()}
    yield ("range [m]", *columns)
    last = len(sheet.range_m) - 1
    for line in range(_LINES):
        at = round(line * last / (_LINES - 1))
        cells = (rounded(float(values[at])) for values in columns.values())
        yield (f"{sheet.range_m[at]:.3g}", *cells)


def rounded(number: float) -> str:
    """Return three digits of a number, without an exponent where that is no longer."""
    return f"{float(f'{number:.3g}'):g}" if math.isfinite(number) else "–"
