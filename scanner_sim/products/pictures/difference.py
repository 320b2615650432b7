"""The picture of two results compared: where they differ, in σ, and how often by how much."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from scanner_sim.products.difference import BEYOND, Difference, RangeDifference, normal_beyond
from scanner_sim.products.pictures.layer import step_of
from scanner_sim.products.pictures.style import FAINT, INK, drawing, plot_label, ruled

_WIDEST = 5.0
"""Differences at the ends of colours and histogram [σ]."""
_BINS = 80
_ONLY_FIRST, _ONLY_SECOND, _BAR = "#8aa3b5", "#d8b26e", "#9fb3c8"
_NORMAL = "#b4531a"


def draw_difference(found: Difference, names: tuple[str, str], path: str | Path) -> None:
    """Draw a map and a histogram for each range that both results have; ``names`` are those of the results."""
    rows = len(found.ranges)
    with drawing(path, (9.6, 0.5 + 4.4 * rows), layout="constrained") as figure:
        figure.get_layout_engine().set(rect=(0.0, 0.05 / rows, 1.0, 1.0 - 0.05 / rows))  # type: ignore[call-arg, union-attr]
        sheet = figure.subplots(rows, 2, squeeze=False, gridspec_kw={"width_ratios": (1.15, 1.0)})
        for (where, how_often), one in zip(sheet, found.ranges, strict=True):
            _draw_map(where, one, found)
            _draw_histogram(how_often, one)
        title = f"{names[1]} less {names[0]}"
        if found.same_seed:
            title += f"   (both with seed {found.seeds[0]}: what they share cancels)"
        figure.suptitle(plot_label(title), x=0.01, ha="left", weight="bold", size=11)


def _draw_map(axes: Axes, one: RangeDifference, found: Difference) -> None:
    """Draw differences over σ by place, and in colours of their own where one result alone has a range."""
    theta, phi = np.degrees(found.theta), np.degrees(found.phi)
    kinds = (
        (one.only_first, _ONLY_FIRST, "range in the first only"),
        (one.only_second, _ONLY_SECOND, "range in the second only"),
    )
    over = one.over_sigma
    if over.ndim == 2:
        half = 0.5 * np.array([step_of(theta), step_of(phi)])
        extent = (theta[0] - half[0], theta[-1] + half[0], phi[-1] + half[1], phi[0] - half[1])
        shown: ScalarMappable = axes.imshow(
            over, cmap="RdBu_r", vmin=-_WIDEST, vmax=_WIDEST, extent=extent, interpolation="nearest"
        )
        for mask, colour, _ in kinds:
            layer = np.where(mask, 1.0, np.nan)
            axes.imshow(layer, cmap=ListedColormap([colour]), extent=extent, interpolation="nearest")
    else:
        shown = axes.scatter(theta, phi, c=over, s=2.0, cmap="RdBu_r", vmin=-_WIDEST, vmax=_WIDEST, lw=0)
        for mask, colour, _ in kinds:
            axes.scatter(theta[mask], phi[mask], color=colour, s=2.0, lw=0)
        axes.invert_yaxis()
    axes.set_facecolor("#f2f4f5")
    axes.set_aspect("equal", adjustable="box")
    axes.set(xlabel="Θ to the right [°]", ylabel="φ downwards [°]")
    axes.set_title(f"Difference of the {one.name}", loc="left", weight="bold", size=9.5)
    bar = axes.figure.colorbar(shown, ax=axes, extend="both", extendfrac=0.025, pad=0.02, shrink=0.9)
    bar.set_label("difference over σ of both")
    patches = [
        Patch(facecolor=colour, label=f"{label}: {int(mask.sum()):,}")
        for mask, colour, label in kinds
        if mask.any()
    ]
    if patches:
        axes.legend(
            handles=patches,
            loc="upper left",
            bbox_to_anchor=(0.0, -0.125),
            ncols=2,
            borderaxespad=0.0,
            fontsize=7.0,
        )


def _draw_histogram(axes: Axes, one: RangeDifference) -> None:
    """Draw how often differences over σ have each size, with the normal curve, and what the numbers say."""
    over = one.over_sigma[np.isfinite(one.over_sigma)]
    edges = np.linspace(-_WIDEST, _WIDEST, _BINS + 1)
    counts, _ = np.histogram(over, edges)
    at, width = np.linspace(-_WIDEST, _WIDEST, 401), edges[1] - edges[0]
    normal = over.size * width * np.exp(-0.5 * at**2) / np.sqrt(2.0 * np.pi)
    axes.stairs(counts, edges, fill=True, color=_BAR, label="voxels")
    axes.plot(at, normal, color=_NORMAL, lw=1.2, label="normal, σ as stated")
    axes.set_yscale("log" if over.size else "linear")
    # Room for the words: on this axis a factor is a height.
    axes.set_ylim(0.5, max(float(counts.max(initial=1)), float(normal.max(initial=1.0)), 2.0) ** 1.75)
    axes.set(xlabel="difference over σ of both", ylabel="number")
    ruled(axes)
    axes.legend(loc="upper right")
    axes.set_title("How often", loc="left", weight="bold", size=9.5)
    for line, text in enumerate(_words(one)):
        colour = INK if line == 0 else FAINT
        axes.text(0.02, 0.975 - 0.05 * line, text, transform=axes.transAxes, va="top", color=colour, size=7.5)


def _words(one: RangeDifference) -> list[str]:
    numbers = one.numbers()
    if not numbers["both"]:
        return ["no voxel has a range in both"]
    pull, metres = numbers["over_sigma"], numbers["difference_m"]
    words = [
        f"{numbers['both']:,} in both",
        f"median {1e3 * metres['median']:+.3g} mm, rms {1e3 * metres['rms']:.3g} mm",
    ]
    if pull["rms"] is not None:
        words.append(f"rms {pull['rms']:.3g} σ")
    for sigmas in BEYOND:
        share = numbers["share_beyond"][f"{sigmas:g} sigma"]["found"]
        if share is not None:
            words.append(
                f"beyond {sigmas:g} σ: {100.0 * share:.3g} % (normal {100.0 * normal_beyond(sigmas):.2g} %)"
            )
    return words
