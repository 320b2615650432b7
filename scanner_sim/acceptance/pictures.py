"""Pictures of an acceptance test: errors over their limits, where artefacts stand, deviations from the surfaces."""

from __future__ import annotations

import math
from pathlib import Path
from typing import BinaryIO

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from numpy.typing import NDArray

from scanner_sim.acceptance.plan import Ball, LengthBar, Plate
from scanner_sim.acceptance.setup import Setup
from scanner_sim.acceptance.shapes import Fit
from scanner_sim.acceptance.verdicts import Accepted, Verdict, worst_of
from scanner_sim.products.pictures.style import FAINT, INK, drawing, plot_label, ruled
from scanner_sim.scene.poses import placement_matrix

Array = NDArray[np.float64]

COLOURS = {Verdict.PASSES: "#2b6f8f", Verdict.UNDECIDED: "#a8701c", Verdict.FAILS: "#b4331a"}
_MOST_FITS = 24
"""Surfaces whose deviations are drawn, those with the largest form."""
_ACROSS = 4


def draw_errors(found: Accepted, path: str | Path | BinaryIO) -> None:
    """Draw the error of each repetition over its limit, with what the test's uncertainty leaves open."""
    tests = found.tests
    with drawing(path, (7.4, 1.2 + 0.27 * len(tests)), layout="constrained") as figure:
        axes = figure.subplots()
        for row, test in enumerate(tests):
            same = [
                one for one in found.results if (one.quantity, one.artefact) == (test.quantity, test.artefact)
            ]
            guard = test.uncertainty / test.limit if found.setup.plan.rule == "guarded" else 0.0
            for side in (-1.0, 1.0):
                axes.fill_betweenx(
                    [row - 0.4, row + 0.4], side * (1.0 - guard), side * (1.0 + guard), color="#ecd9bd", lw=0
                )
            for number, one in enumerate(same):
                at = row + 0.5 * (number + 0.5) / len(same) - 0.25
                axes.plot(one.error / one.limit, at, "o", color=COLOURS[one.verdict], ms=3)
        for limit in (-1.0, 1.0):
            axes.axvline(limit, color=INK, lw=0.8)
        axes.axvline(0.0, color=FAINT, lw=0.6)
        axes.set_yticks(range(len(tests)), [f"{plot_label(one.artefact)}, {one.quantity}" for one in tests])
        axes.set_ylim(len(tests) - 0.4, -0.6)
        widest = max(1.25, *(1.08 * abs(one.error) / one.limit for one in found.results))
        axes.set_xlim(-widest, widest)
        axes.set_xlabel("error over the limit; lines: the limits, bands: open by the test's uncertainty")
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.tick_params(axis="y", length=0)
        axes.set_title("Errors of all repetitions", loc="left", weight="bold", size=10)


def draw_places(found: Accepted, path: str | Path | BinaryIO) -> None:
    """Draw the artefacts before the scanner, from above and from the side, in the colour of their verdict."""
    with drawing(path, (7.6, 4.4), layout="constrained") as figure:
        for axes, (upward, title) in zip(
            figure.subplots(1, 2, sharex=True), ((0, "from above"), (1, "from the side")), strict=True
        ):
            for number, one in enumerate(found.setup.plan.artefacts.values()):
                own = [result.verdict for result in found.results if result.artefact == one.name]
                _artefact(axes, one, float(found.setup.made[number]), upward, COLOURS[worst_of(own)])
            _view(axes, found.setup)
            axes.set(xlabel="z [m]", ylabel=f"{'xy'[upward]} [m]")
            axes.set_title(f"The volume {title}", loc="left", weight="bold", size=9.5)
            if upward == 1:
                axes.invert_yaxis()
            ruled(axes)


def _artefact(axes: Axes, one: LengthBar | Ball | Plate, made: float, upward: int, colour: str) -> None:
    if isinstance(one, Plate):
        corners = 0.5 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [-1, -1, 0]])
        pose = placement_matrix(one.position, one.rotation)
        at = corners * [*one.size, 0.0] @ pose[:3, :3].T + pose[:3, 3]
        axes.plot(at[:, 2], at[:, upward], color=colour, lw=1.6)
        return
    centres = one.ends(made) if isinstance(one, LengthBar) else np.array([one.position])
    axes.plot(centres[:, 2], centres[:, upward], color=colour, lw=0.8)
    for centre in centres:
        axes.add_patch(Circle((centre[2], centre[upward]), 0.5 * one.diameter, color=colour, lw=0))


def _view(axes: Axes, setup: Setup) -> None:
    """Draw the scanner, the edges of its field of view, and the zones of its limits."""
    reach = setup.base.scanner.mirrors.max_deflection
    ends = np.linspace(-reach, reach, 60)
    farthest = max(one.farthest for one in setup.surfaces)
    for zone in setup.plan.limits:
        radius = min(zone.up_to, 1.1 * farthest)
        axes.plot(radius * np.cos(ends), radius * np.sin(ends), color=FAINT, lw=0.7, ls="--")
    for side in (-reach, reach):
        far = 1.1 * farthest
        axes.plot([0.0, far * math.cos(side)], [0.0, far * math.sin(side)], color=FAINT, lw=0.7)
    axes.plot(0.0, 0.0, ">", ms=7, color=INK)
    axes.set_aspect("equal", adjustable="datalim")


def draw_deviations(found: Accepted, path: str | Path | BinaryIO) -> None:
    """Draw how far the points of each surface lie from what is fitted to them, as the scanner sees them."""
    chosen = sorted(found.fits, key=lambda name: -found.fits[name].form)[:_MOST_FITS]
    names = [name for name in found.fits if name in chosen]
    rows = math.ceil(len(names) / _ACROSS)
    with drawing(path, (9.0, 0.3 + 1.9 * rows), layout="constrained") as figure:
        grid = figure.subplots(rows, _ACROSS, squeeze=False).ravel()
        for axes, name in zip(grid, names, strict=False):
            _deviations(axes, name, found.fits[name])
        for axes in grid[len(names) :]:
            axes.set_axis_off()


def _deviations(axes: Axes, name: str, fit: Fit) -> None:
    used, points = fit.used, fit.points
    middle = points.mean(axis=0)
    at = 1e3 * (points - middle)
    reach = 1e3 * float(np.abs(fit.deviations[used]).max())
    axes.plot(at[~used, 0], at[~used, 1], ".", ms=1.5, color="#cfd6db")
    dots = axes.scatter(
        at[used, 0],
        at[used, 1],
        c=1e3 * fit.deviations[used],
        s=4,
        cmap="RdBu_r",
        vmin=-reach,
        vmax=reach,
        lw=0,
    )
    bar = axes.figure.colorbar(dots, ax=axes, shrink=0.75)
    bar.ax.tick_params(labelsize=6)
    bar.ax.set_title("mm", size=6)
    axes.set_aspect("equal")
    axes.invert_yaxis()
    axes.tick_params(labelsize=6)
    axes.set_title(plot_label(name), loc="left", size=6.5)
