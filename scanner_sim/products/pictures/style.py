"""One look for all pictures: colours, sizes, and files that are the same bytes for the same numbers."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Literal

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray
from PIL import Image

from scanner_sim.foundation.channels import CHANNEL
from scanner_sim.foundation.errors import printable
from scanner_sim.foundation.status import Status

INK = "#22262b"
"""Colour of text and axes."""
FAINT = "#6b737c"
"""Colour of what is said aside."""

STATUS_COLOUR: dict[Status, str] = {
    Status.BELOW_THRESHOLD: "#d9dce0",
    Status.SATURATED: "#c7806f",
    Status.AMBIGUOUS: "#d8b26e",
    Status.OUT_OF_ARRAY: "#a58fb5",
    Status.OUT_OF_GATE: "#8aa3b5",
    Status.BAD_SHAPE: "#9a6279",
    Status.BAD_AMPLITUDE: "#c9c28b",
    Status.ISOLATED: "#6f8f74",
    Status.INCONSISTENT: "#5d6a8c",
    Status.MIXED: "#b9a7a0",
    Status.OVERLAP: "#7f8f6a",
}
"""Muted colours of voxels without a range. They differ in lightness too, and none lies on a colour map in use."""

RANGE_MAP, SIGNAL_MAP = (CHANNEL[name].pictures[0].colours for name in ("range_m", "Y"))
"""Colour maps of ranges and signals, for the pictures of patterns."""

_LINE_WIDTH = 0.6

_SETTINGS = {
    "font.family": ["DejaVu Sans"],
    "font.size": 8.0,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": _LINE_WIDTH,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.direction": "out",
    "ytick.direction": "out",
    "legend.frameon": False,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


def plot_label(name: str) -> str:
    """Return a name of the user as a picture shows it: no control characters, no mathematics between dollar signs."""
    return printable(name).replace("$", r"\$")


@contextlib.contextmanager
def house_style() -> Iterator[None]:
    """Draw in the house style, whatever the user's own matplotlib settings are."""
    # The back end is no matter of style, and naming it here would make matplotlib look for a display.
    settings: dict[Any, Any] = {k: v for k, v in matplotlib.rcParamsDefault.items() if "backend" not in k}
    settings.update(_SETTINGS)
    with matplotlib.rc_context(settings):
        yield


@contextlib.contextmanager
def drawing(
    path: str | Path | BinaryIO,
    size: tuple[float, float],
    dpi: float = 150,
    layout: Literal["constrained"] | None = None,
) -> Iterator[Figure]:
    """Give an empty figure of a size [inch] to draw into, in the house style; then write it as :func:`save` does."""
    with house_style():
        figure = Figure(figsize=size, dpi=dpi, layout=layout)
        yield figure
        save(figure, path)


def ruled(axes: Axes) -> None:
    """Give axes a faint grid behind what is drawn, and no line above and at the right."""
    axes.grid(which="major", color="#e3e6e9", lw=0.5)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def over_range(axes: Axes, label: str) -> None:
    """Give axes of lengths over range [m], drawn already, logarithmic scales, ticks that can be read, and a grid."""
    axes.set(xscale="log", xlabel="range [m]", ylabel=label)
    count_in_decades(axes)
    low, high = axes.get_xlim()
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ticks = [step * 10.0**decade for decade in decades for step in (1, 2, 3, 5)]
    ticks = [tick for tick in ticks if low < tick < high]
    axes.set_xticks(ticks, [f"{tick:.3g}" for tick in ticks])
    axes.set_xticks([], minor=True)
    ruled(axes)


def count_in_decades(axes: Axes) -> None:
    """Let axes that are drawn count upwards in decades: in one, where nothing is drawn that is above 0."""
    if not math.isfinite(axes.dataLim.minposy):
        axes.set_ylim(0.1, 1.0)
    axes.set_yscale("log")


def plain_decades(axes: Axes) -> None:
    """Let axes that are drawn count upwards in decades: plain numbers at 1, 2 and 5 of each, of many at 1 alone."""
    count_in_decades(axes)
    low, high = axes.get_ylim()
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 1e3 * low else (1.0,)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_locator(NullLocator())


@dataclass(frozen=True)
class Canvas:
    """A figure with axes of a whole number of dots, so that every voxel is a sharp rectangle.

    Attributes
    ----------
    figure
        The figure.
    axes
        The axes of the image.
    bar
        The axes of the colour bar, to the right.
    left, top
        Dots to the left of and above the image.
    """

    figure: Figure
    axes: Axes
    bar: Axes
    left: int
    top: int


_LEFT, _GAP, _BAR, _RIGHT, _TOP, _BOTTOM, _LINE = 0.62, 0.14, 0.14, 0.78, 0.60, 0.52, 0.165
_NARROWEST, _LONG_SIDE = 4.4, 6.6


def canvas(width: int, height: int, legend_lines: int) -> Canvas:
    """Return an empty figure around an image of ``width`` × ``height`` dots.

    Type keeps its size relative to the longer side, so that large and small pictures look alike. ``legend_lines``
    lines are left free at the foot.
    """
    dpi = max(width, height) / _LONG_SIDE
    left, top = round(_LEFT * dpi), round(_TOP * dpi)
    below = round((_BOTTOM + legend_lines * _LINE) * dpi)
    across = max(left + width + round((_GAP + _BAR + _RIGHT) * dpi), round(_NARROWEST * dpi))
    down = top + height + below
    # The figure's size is cut to whole dots: a hundredth more keeps the last one.
    figure = Figure(figsize=((across + 0.01) / dpi, (down + 0.01) / dpi), dpi=dpi)
    axes = figure.add_axes((left / across, below / down, width / across, height / down))
    bar_left = left + width + round(_GAP * dpi)
    # A colour bar beside a low strip would be too short to read: it may reach below the image.
    tall = max(height, round(0.9 * dpi))
    bar = figure.add_axes(
        (bar_left / across, (below + height - tall) / down, round(_BAR * dpi) / across, tall / down)
    )
    return Canvas(figure, axes, bar, left, top)


def lay(sheet: Canvas, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the drawn figure with ``picture`` (dots down, dots across, 4) laid into its axes, dot on dot.

    Matplotlib would resample the picture, which takes most of the time of a large one.
    """
    dots = _drawn(sheet.figure)
    rim = math.ceil(_LINE_WIDTH / 2.0 * sheet.figure.dpi / 72.0)
    high, wide = picture.shape[0] - rim, picture.shape[1] - rim
    target = dots[sheet.top + rim : sheet.top + high, sheet.left + rim : sheet.left + wide]
    target[...] = picture[rim:high, rim:wide]
    return dots


def save(drawing: Figure | NDArray[np.uint8], path: str | Path | BinaryIO) -> None:
    """Write a figure, or its dots, as PNG to a file without date or program name: same drawing, same bytes."""
    dots = _drawn(drawing) if isinstance(drawing, Figure) else drawing
    nameless: Any = {"Software": None}
    imsave(path, dots, format="png", metadata=nameless, pil_kwargs={"compress_level": 3})


def save_grey(levels: NDArray[np.uint8], path: str | Path) -> None:
    """Write grey levels, shape (rows, columns), as PNG without date or program name, dot by dot."""
    Image.fromarray(levels).save(path, format="png", compress_level=6)


def _drawn(figure: Figure) -> NDArray[np.uint8]:
    """Return the dots of a figure, shape (dots down, dots across, 4)."""
    drawing: Any = FigureCanvasAgg(figure)
    drawing.draw()
    return np.array(drawing.buffer_rgba())
