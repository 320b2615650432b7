"""Show the shipped instruments side by side: ``python docs/instruments.py`` rewrites ``instruments.md``."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from made_tables import marked, rewrite

from scanner_sim import load_scanner
from scanner_sim.cli.explaining import instrument_properties, rounded
from scanner_sim.config.preset import MARKS, read_preset, shipped_presets
from scanner_sim.products.instrument_sheet import InstrumentSheet
from scanner_sim.products.pictures.instrument import draw_instrument
from scanner_sim.validation.compare.instrument_sheet import instrument_sheet

DOCS = Path(__file__).parent
PAGE, PICTURES = DOCS / "instruments.md", DOCS / "pictures"
MAKER = "docs/instruments.py"


def sheets() -> dict[str, InstrumentSheet]:
    """Return what each shipped instrument can do, by its name."""
    return {name: instrument_sheet(load_scanner(name)) for name in shipped_presets()}


def made(own: dict[str, InstrumentSheet]) -> str:
    """Return the part of the page that is made: a table of all, then each with its drawing."""
    columns = {
        name: {**instrument_properties(load_scanner(name), sheet), **_more(name, sheet)}
        for name, sheet in own.items()
    }
    words = list(next(iter(columns.values())))
    lines = ["| | " + " | ".join(f"`{name}`" for name in own) + " |", "|---" * (len(own) + 1) + "|"]
    lines += [
        f"| {word} | " + " | ".join(column[word] for column in columns.values()) + " |" for word in words
    ]
    parts = ["\n".join(lines)]
    for name in own:
        parts += [
            f"## {name}",
            read_preset(name).about + ".",
            f"![{name}: the head, what it sees, and its errors](pictures/{picture(name)})",
        ]
    return marked(MAKER, parts)


def picture(name: str) -> str:
    """Return the name of an instrument's picture."""
    return f"instrument_{name}.png"


def _more(name: str, sheet: InstrumentSheet) -> dict[str, str]:
    """Return σ of the range at both ends and in the middle, and how sure the values are."""
    errors = []
    for way, values in sheet.sigma_m.items():
        if way != "fused":
            at = (0, len(values) // 2, len(values) - 1)
            own = (f"{rounded(1e3 * float(values[i]))} mm at {sheet.range_m[i]:.3g} m" for i in at)
            errors.append(", ".join(own) + (" by time of flight" if way == "tof" else ""))
    marks = Counter(stated.mark for stated in read_preset(name).stated.values())
    return {
        f"σ of the range, {100.0 * sheet.reflectance:g} % target": "; ".join(errors),
        "values": ", ".join(f"{marks[mark]} {mark}" for mark in MARKS if marks[mark]),
    }


if __name__ == "__main__":
    found = sheets()
    for name, sheet in found.items():
        draw_instrument(sheet, f"{name}, the instrument", PICTURES / picture(name))
    rewrite(PAGE, made(found))
