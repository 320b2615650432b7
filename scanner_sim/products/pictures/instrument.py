"""The picture of an instrument: its head and what it sees, to scale, and how its spot and σ grow with range."""

from __future__ import annotations

import math
from pathlib import Path
from typing import BinaryIO

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from scanner_sim.products.instrument_sheet import InstrumentSheet, LineSheet
from scanner_sim.products.pictures.budget import CURVES
from scanner_sim.products.pictures.style import FAINT, INK, drawing, over_range, plot_label

_LASER, _LENS, _SEEN = "#b4331a", "#0b4f8a", "#dfe9f1"


def draw_instrument(sheet: InstrumentSheet, name: str, path: str | Path | BinaryIO) -> None:
    """Draw an instrument's sheet as PNG; ``name`` stands above it."""
    with drawing(path, (9.0, 7.8), layout="constrained") as figure:
        head, field, spot, sigma = figure.subplots(2, 2, gridspec_kw={"hspace": 0.06, "wspace": 0.05}).ravel()
        if sheet.line is None:
            _draw_coaxial_head(head, sheet)
        else:
            _draw_head(head, sheet, sheet.line)
        _draw_field(field, sheet)
        _draw_lateral(spot, sheet)
        _draw_sigma(sigma, sheet)
        figure.suptitle(plot_label(name), x=0.01, ha="left", weight="bold", size=11)


def _draw_head(axes: Axes, sheet: InstrumentSheet, line: LineSheet) -> None:
    """Draw laser, lens and array in the plane of triangulation at Θ = 0, to scale [mm]."""
    base, f = 1e3 * sheet.baseline, 1e3 * sheet.focal_length
    half, ends = 0.5e3 * sheet.aperture, [(1e3 * x, 1e3 * z) for x, z in line.ends]
    top = 0.9 * max(f, base)
    _draw_beam(axes, sheet, 0.0, top)
    for x, z in ends:
        # The ray through the middle of the lens that falls on this end of the array.
        axes.plot([base + x * top / z, base + x], [top, z], color=_LENS, lw=0.7)
    axes.plot([base, base], [min(-f, *(z for _, z in ends)), top], color=FAINT, lw=0.6, ls="--")
    axes.plot([base - half, base + half], [0.0, 0.0], color=_LENS, lw=3.5, solid_capstyle="butt")
    axes.plot([base + x for x, _ in ends], [z for _, z in ends], color=INK, lw=3.5, solid_capstyle="butt")
    axes.plot(0.0, 0.0, "o", ms=4, color=_LASER)
    axes.annotate(" laser", (0.0, 0.0), color=_LASER, va="top")
    axes.annotate("lens  ", (base - half, 0.0), color=_LENS, ha="right", va="center")
    axes.annotate("array  ", (base + ends[0][0], ends[0][1]), color=INK, ha="right", va="center")
    _scaled(axes)
    _heading(axes, "The head, to scale", "rays through the lens to both ends of the array")


def _draw_coaxial_head(axes: Axes, sheet: InstrumentSheet) -> None:
    """Draw beam, lens and photodiode of a head that does not triangulate, to scale [mm]."""
    f, half = 1e3 * sheet.focal_length, 0.5e3 * sheet.aperture
    angle = 0.0 if sheet.diode_field is None else 0.5 * sheet.diode_field
    top, edge = 1.2 * f, f * math.tan(angle)
    _draw_beam(axes, sheet, -0.6 * f, top)
    for side in (-1.0, 1.0):
        # Through the rim of the lens to the middle of the diode, from infinity; and the edge of the field.
        axes.plot([side * half, side * half, 0.0], [top, 0.0, -f], color=_LENS, lw=0.7)
        axes.plot([side * top * math.tan(angle), -side * edge], [top, -f], color=FAINT, lw=0.6, ls="--")
    axes.plot([-half, half], [0.0, 0.0], color=_LENS, lw=3.5, solid_capstyle="butt")
    axes.plot([-edge, edge], [-f, -f], color=INK, lw=3.5, solid_capstyle="butt")
    axes.annotate("lens  ", (-half, 0.0), color=_LENS, ha="right", va="center")
    axes.annotate("photodiode  ", (-edge, -f), color=INK, ha="right", va="center")
    axes.annotate("  laser, on the lens's axis", (0.0, 0.9 * top), color=_LASER, va="center")
    _scaled(axes)
    _heading(axes, "The head, to scale", f"the diode sees {2e3 * angle:.3g} mrad through the lens (dashed)")


def _draw_beam(axes: Axes, sheet: InstrumentSheet, bottom: float, top: float) -> None:
    beam = 0.5e3 * float(sheet.spot_m[0])
    axes.fill_betweenx([bottom, top], -beam, beam, color=_LASER, alpha=0.35, lw=0)
    axes.plot([0.0, 0.0], [bottom, top], color=_LASER, lw=0.8)


def _scaled(axes: Axes) -> None:
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x [mm]", ylabel="z [mm]")


def _draw_field(axes: Axes, sheet: InstrumentSheet) -> None:
    """Draw the ranges that are seen over Θ, to scale [m]: by an array eq 1, by time of flight an even depth."""
    farthest = float(sheet.range_m[-1])
    line, even = sheet.line, np.ones_like(sheet.theta)

    def border(seen: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        seen = np.minimum(seen, farthest)
        return seen * np.sin(sheet.theta), seen * np.cos(sheet.theta)

    near = border(even * sheet.depth[0] if line is None else line.nearest)
    far = border(even * sheet.depth[1] if line is None else line.farthest)
    outline = [np.concatenate([one, other[::-1]]) for one, other in zip(far, near, strict=True)]
    axes.fill(*outline, color=_SEEN, lw=0)
    axes.plot(*near, color=_LENS, lw=1.0, label=f"nearest: {sheet.depth[0]:.3g} m on the axis")
    ends = (
        f"{sheet.depth[1]:.3g} m on the axis"
        if math.isfinite(sheet.depth[1])
        else f"infinity; drawn to {farthest:.3g} m"
    )
    axes.plot(*far, color=INK, lw=1.0, label=f"farthest: {ends}")
    for side in (-1.0, 1.0):
        end = farthest * np.array([math.sin(side * sheet.half_field), math.cos(sheet.half_field)])
        axes.plot([0.0, end[0]], [0.0, end[1]], color=FAINT, lw=0.6, ls="--")
    axes.plot(0.0, 0.0, "o", ms=3, color=_LASER)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="x [m]", ylabel="z [m]")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.17))
    what = "the digitiser records" if line is None else "the array sees"
    _heading(axes, f"What {what}, to scale", f"deflections of ±{math.degrees(sheet.half_field):.3g}°")


def _draw_lateral(axes: Axes, sheet: InstrumentSheet) -> None:
    axes.plot(sheet.range_m, 1e3 * sheet.spot_m, color=_LASER, label="diameter of the beam (1/e²)")
    if sheet.lateral_m.any():
        axes.plot(sheet.range_m, 1e3 * sheet.lateral_m, color=INK, label="σ across, by the angles")
    over_range(axes, "[mm]")
    lines = axes.get_lines()
    if sheet.line is not None:
        pixels, label = axes.twinx(), "its image on the array, σ (right)"
        pixels.plot(sheet.range_m, sheet.line.image_px, color=_LENS, ls="--", label=label)
        pixels.set(ylabel="[pixel]", ylim=(0.0, None))
        pixels.grid(visible=False)
        lines = [*lines, *pixels.get_lines()]
    labels = [str(line.get_label()) for line in lines]
    axes.legend(lines, labels, loc="upper center", bbox_to_anchor=(0.5, -0.17))
    _heading(axes, "Across the beam", "")


def _draw_sigma(axes: Axes, sheet: InstrumentSheet) -> None:
    for mode, values in sheet.sigma_m.items():
        colour, label = CURVES[mode]
        axes.plot(sheet.range_m, 1e3 * values, color=colour, label=label, lw=2.4 if mode == "fused" else 1.2)
    if sheet.line is not None:
        pixel = 1e3 * sheet.line.pixel_m
        axes.plot(sheet.range_m, pixel, color=FAINT, lw=0.9, ls=":", label="one pixel of the array")
    over_range(axes, "[mm]")
    axes.legend(loc="upper left")
    _heading(
        axes,
        "σ of the range, by closed forms",
        f"facing target of reflectance {sheet.reflectance:g}, dark, beam at rest",
    )


def _heading(axes: Axes, title: str, about: str) -> None:
    axes.set_title(title, loc="left", weight="bold", size=9.5, pad=18)
    axes.text(0.0, 1.02, about, transform=axes.transAxes, color=FAINT)
