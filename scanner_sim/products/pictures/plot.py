"""A layer of an image in axes of matplotlib, for notebooks and for figures of one's own."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm, to_hex, to_rgba
from matplotlib.patches import Patch
from numpy.typing import NDArray

from scanner_sim.foundation.channels import CHANNEL, Channel
from scanner_sim.foundation.status import Status
from scanner_sim.products.layers import LayeredResult, legends
from scanner_sim.products.pictures.layer import (
    causes_of,
    label_bar,
    linear,
    logarithmic,
    patches_of,
    step_of,
)
from scanner_sim.products.pictures.style import FAINT, STATUS_COLOUR, plot_label

_LONGEST = 72
"""Letters of a line of the legend."""
_MOST_NAMES = 12
"""Names of a legend of objects."""


def plot_layer(
    image: LayeredResult, theta: NDArray[np.float64], phi: NDArray[np.float64], name: str, axes: Axes | None
) -> Axes:
    """Draw a layer over Θ and φ [°]; arguments as of :meth:`~scanner_sim.products.image.RangeImage.plot`.

    ``theta`` and ``phi`` [rad] are those of the columns and rows, shapes (columns,) and (rows,).
    """
    values, channel = image[name], CHANNEL[name]
    if axes is None:
        _, axes = plt.subplots(figsize=(6.4, 5.2), layout="constrained")
    half = np.degrees([step_of(theta), step_of(phi)]) / 2.0
    left, right, top, bottom = np.degrees([theta[0], theta[-1], phi[0], phi[-1]])
    extent = (left - half[0], right + half[0], bottom + half[1], top - half[1])
    draw = _draw_names if channel.whole else _draw_numbers
    patches = draw(axes, image, values, channel, extent)
    axes.set(xlabel="Θ to the right [°]", ylabel="φ downwards [°]", title=_title(channel))
    axes.set_aspect("equal" if 0.125 < (right - left + half[0]) / (bottom - top + half[1]) < 8.0 else "auto")
    if patches:
        axes.legend(
            handles=patches,
            loc="upper left",
            bbox_to_anchor=(0.0, -0.14),
            borderaxespad=0.0,
            fontsize="small",
            frameon=False,
        )
    return axes


def _title(channel: Channel) -> str:
    title = next((picture.title for picture in channel.pictures if picture.title), "")
    return title or channel.name


def _draw_numbers(
    axes: Axes,
    image: LayeredResult,
    values: NDArray[np.float32],
    channel: Channel,
    extent: tuple[float, ...],
) -> list[Patch]:
    """Draw numbers with a colour bar, and voxels without one in the colour of their status; return the patches."""
    picture = next((one for one in channel.pictures if one.scale in ("linear", "logarithmic")), None)
    if picture is not None and picture.scale == "logarithmic":
        layer = logarithmic(values, picture.dark)
    else:
        # Standard deviations span decades between a near plate and a grazing edge.
        layer = logarithmic(values, None) if "sigma_" in channel.name else linear(values)
    colours = "viridis" if picture is None else picture.colours
    causes = causes_of(image[f"{channel.prefix}status"], np.isnan(layer.values))
    shown = axes.imshow(layer.values, cmap=colours, norm=layer.norm, extent=extent, interpolation="nearest")  # type: ignore[arg-type]
    if np.isfinite(layer.values).any():
        bar = axes.figure.colorbar(shown, ax=axes, extend=layer.extend, extendfrac=0.025, pad=0.02)
        label_bar(bar, layer.norm, picture.label if picture else f"{channel.name} [{channel.unit}]")
    above = np.zeros((*values.shape, 4))
    for status, where in causes.items():
        above[where] = to_rgba(STATUS_COLOUR.get(status, FAINT))
    axes.imshow(above, extent=extent, interpolation="nearest")  # type: ignore[arg-type]
    none = "0, which has no place on this scale" if isinstance(layer.norm, LogNorm) else "no value"
    return patches_of(causes, _LONGEST, none)


def _draw_names(
    axes: Axes,
    image: LayeredResult,
    values: NDArray[np.float32],
    channel: Channel,
    extent: tuple[float, ...],
) -> list[Patch]:
    """Draw whole numbers that stand for names, each in a colour of its own; return the patches."""
    names = legends([channel.name], image.objects, image.materials)[channel.name]
    found = np.unique(values).astype(int)
    by_status = channel.kind == "status"
    if by_status:
        colours = ["#3b7a57", *STATUS_COLOUR.values()]
    else:
        tab = [to_hex(plt.get_cmap("tab20")(number % 20)) for number in range(len(names) - 1)]
        colours = ["#eceef0", *tab]
    norm = BoundaryNorm(np.arange(len(names) + 1) - 0.5, len(names))
    axes.imshow(values, cmap=ListedColormap(colours), norm=norm, extent=extent, interpolation="nearest")  # type: ignore[arg-type]
    return [
        Patch(
            facecolor=colours[number],
            edgecolor=FAINT,
            linewidth=0.3,
            label=_share(values == number)
            + (Status(number).sentence if by_status else plot_label(names[number])),
        )
        for number in found[:_MOST_NAMES]
    ]


def _share(where: NDArray[np.bool_]) -> str:
    return f"{100.0 * float(where.mean()):.3g} %: "
