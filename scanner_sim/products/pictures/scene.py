"""A picture of what stands before a scanner: as it is seen, and to scale from the side and from above."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, BinaryIO

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import SubFigure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from scanner_sim.products.pictures.style import FAINT, INK, drawing, plot_label
from scanner_sim.products.scene_view import Field, SceneView, ViewedObject

_MOST_NAMED = 25
"""Objects whose names are written; more would cover the picture."""
_WIDE_ENOUGH = 60
"""Dots of an object on which its name finds room."""
_MOST_LISTED = 12
"""Objects whose sizes are written."""
_VIEW_COLOUR = "#2f6f9f"


def draw_scene(view: SceneView, title: str, path: str | Path | BinaryIO) -> None:
    """Draw a scene from the scanner's place, from the side and from above."""
    colours = _colours(len(view.objects))
    with drawing(path, (11.0, 7.2), layout="constrained") as figure:
        figure.suptitle(plot_label(title), fontsize=10)
        halves: Any = figure.subfigures(1, 2, width_ratios=(1.0, 1.15))
        left, right = halves
        _draw_seen(left.subplots(), view, colours)
        _list_sizes(left, view, colours)
        side, top = right.subplots(2, 1)
        _draw_plan(side, view, colours, 1, "side view: y [m], down")
        _draw_plan(top, view, colours, 0, "view from above: x [m], right")
        side.invert_yaxis()
        top.invert_yaxis()


def _colours(count: int) -> list[tuple[float, float, float]]:
    table = matplotlib.colormaps["tab20"].colors if count > 10 else matplotlib.colormaps["tab10"].colors  # type: ignore[attr-defined]
    return [to_rgb(table[number % len(table)]) for number in range(count)]


def _draw_seen(axes: Axes, view: SceneView, colours: list[tuple[float, float, float]]) -> None:
    """Draw what the scanner sees, each object in its colour, and the frame of the scan."""
    palette = np.array([(1.0, 1.0, 1.0), *colours])
    shade = np.where(view.number > 0, 0.35 + 0.65 * view.shade, 1.0)
    picture = palette[view.number] * shade[..., None]
    (left, right), (top, bottom) = (np.degrees(ends) for ends in view.window)
    axes.imshow(picture, extent=(left, right, bottom, top), interpolation="nearest", aspect="equal")
    (first, last), (upper, lower) = (
        np.degrees(ends) for ends in (view.field.horizontal, view.field.vertical)
    )
    axes.plot(
        [first, last, last, first, first], [upper, upper, lower, lower, upper], color=_VIEW_COLOUR, lw=1.0
    )
    axes.text(first, upper, "field of view ", color=_VIEW_COLOUR, fontsize=7, va="bottom")
    axes.set(xlabel="Θ [°], right", ylabel="φ [°], down", title="as the scanner sees it")
    axes.title.set_fontsize(8)
    if len(view.objects) <= _MOST_NAMED:
        for number, one in enumerate(view.objects, 1):
            rows, columns = np.nonzero(view.number == number)
            if len(rows):
                at = _middle_of(rows, columns)
                x = left + (right - left) * (columns[at] + 0.5) / view.number.shape[1]
                y = top + (bottom - top) * (rows[at] + 0.5) / view.number.shape[0]
                wide = np.ptp(columns) > _WIDE_ENOUGH
                y_top = top + (bottom - top) * rows.min() / view.number.shape[0]
                _name(axes, x, y if wide else y_top, one, inside=bool(wide))


def _list_sizes(figure: SubFigure, view: SceneView, colours: list[tuple[float, float, float]]) -> None:
    """Write colour, name, size and distance of the objects beneath the picture, the nearest ones if they are many."""
    order = sorted(range(len(view.objects)), key=lambda number: view.objects[number].distance)[:_MOST_LISTED]
    marks = [Line2D([], [], marker="s", ls="", ms=5, color=colours[number]) for number in sorted(order)]
    texts = []
    for number in sorted(order):
        one = view.objects[number]
        size = " × ".join(f"{extent:.3g}" for extent in one.size)
        texts.append(f"{plot_label(one.name)}: {size} m (x, y, z), {one.distance:.3g} m away")
    if len(order) < len(view.objects):
        marks.append(Line2D([], [], ls=""))
        texts.append(f"and {len(view.objects) - len(order)} that are farther away")
    if marks:
        figure.legend(marks, texts, loc="outside lower left", fontsize=7, handletextpad=0.3)


def _middle_of(rows: NDArray[np.intp], columns: NDArray[np.intp]) -> int:
    """Return the index of a dot of an object next to the middle of all of its dots."""
    return int(np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2))


def _name(axes: Axes, x: float, y: float, one: ViewedObject, *, inside: bool) -> None:
    axes.text(
        x,
        y,
        plot_label(one.name),
        ha="center",
        va="center" if inside else "bottom",
        fontsize=7,
        clip_on=True,
        bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.75},
    )


def _draw_plan(
    axes: Axes, view: SceneView, colours: list[tuple[float, float, float]], axis: int, label: str
) -> None:
    """Draw a projection along an axis, to scale: objects, field of view, nearest and farthest range."""
    reach = _reach(view)
    # From the side one looks along −x, from above along y: what lies nearer is drawn over what lies behind it.
    other, sign = (1, -1.0) if axis == 0 else (0, 1.0)
    means = [sign * float(one.points[:, other].mean()) for one in view.objects]
    for number in np.argsort(means, kind="stable"):
        points = view.objects[number].points
        axes.plot(points[:, 2], points[:, axis], ".", ms=1.2, color=colours[number], alpha=0.5)
    _draw_field(axes, view.field, reach, (view.field.vertical, view.field.horizontal)[1 - axis])
    axes.plot(0.0, 0.0, marker="s", color=INK, ms=5)
    axes.annotate("scanner", (0.0, 0.0), (-3, 6), textcoords="offset points", fontsize=7)
    axes.set(xlabel="z [m], away from the scanner", ylabel=label, aspect="equal")
    axes.set_adjustable("datalim")
    axes.grid(color="#e3e6e9", lw=0.5)
    axes.set_axisbelow(True)


def _draw_field(axes: Axes, field: Field, reach: float, ends: tuple[float, float]) -> None:
    for angle in ends:
        axes.plot([0.0, reach * math.cos(angle)], [0.0, reach * math.sin(angle)], color=_VIEW_COLOUR, lw=0.8)
    turn = np.linspace(*ends, 64)
    for distance, name in ((field.near, "nearest"), (field.far, "farthest")):
        if distance <= reach:
            axes.plot(distance * np.cos(turn), distance * np.sin(turn), color=_VIEW_COLOUR, lw=0.8, ls="--")
            axes.annotate(
                f"{name} {distance:.3g} m", (distance * math.cos(ends[1]), distance * math.sin(ends[1])), (-2, -6),
                textcoords="offset points", fontsize=6, color=_VIEW_COLOUR, va="top",
                ha="left" if distance == field.near else "right",
            )  # fmt: skip
    if field.far > reach:
        far = "infinity" if math.isinf(field.far) else f"{field.far:.3g} m"
        axes.annotate(
            f"on to {far}",
            (reach * math.cos(ends[1]), reach * math.sin(ends[1])),
            (0, -6),
            textcoords="offset points",
            fontsize=6,
            color=FAINT,
            ha="right",
            va="top",
        )


def _reach(view: SceneView) -> float:
    """Return how far the field of view is drawn [m]."""
    farthest = max((float(one.points[:, 2].max()) for one in view.objects), default=0.0)
    least = 2.0 * view.field.near
    return max(1.1 * farthest, least if math.isfinite(least) else 1.0)
