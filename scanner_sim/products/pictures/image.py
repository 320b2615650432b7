"""Pictures of a range image, as the table of channels asks for them."""

from __future__ import annotations

import re
from pathlib import Path
from textwrap import shorten

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import FuncNorm, to_rgba
from matplotlib.ticker import MaxNLocator, ScalarFormatter
from numpy.typing import NDArray

from scanner_sim.foundation.channels import CHANNELS, Channel, Picture
from scanner_sim.foundation.status import Status
from scanner_sim.products.grey import grey_levels
from scanner_sim.products.image import RangeImage
from scanner_sim.products.layers import numbered
from scanner_sim.products.pictures.layer import (
    Layer,
    causes_of,
    label_bar,
    linear,
    logarithmic,
    patches_of,
    step_of,
)
from scanner_sim.products.pictures.style import (
    FAINT,
    STATUS_COLOUR,
    Canvas,
    canvas,
    house_style,
    lay,
    plot_label,
    save,
    save_grey,
)

_PICTURES = {picture.file: (channel, picture) for channel in CHANNELS for picture in channel.pictures}
_SMALLEST, _LARGEST = 960, 2048
"""Dots of the longer side of an image."""
_PRESET = re.compile(r"^scanner:\n(?:  .*\n)*?  preset: (?:.*/)?(.+?)(?:\.ya?ml)?$", re.MULTILINE)
"""Name of the scanner's preset in a resolved scenario."""
_SLENDEREST = 8.0
"""Longer over shorter side at which an image is stretched to stay readable."""


def pictures_of(image: RangeImage) -> tuple[str, ...]:
    """Return the names of the pictures that an image has; of the Sun's light only where there is any."""
    drawn = [
        picture
        for channel, picture in _PICTURES.values()
        if channel.name in image and (not picture.sunlit or (image[channel.name] > 0.0).any())
    ]
    return tuple(picture.file for picture in sorted(drawn, key=lambda picture: picture.sunlit))


def draw_picture(image: RangeImage, file: str, path: str | Path) -> None:
    """Draw the picture of a name; voxels without a value have the colour of their cause."""
    channel, picture = _PICTURES[file]
    if picture.scale == "grey":
        save_grey(grey_levels(image[channel.name]), path)
        return
    if picture.scale == "slope":
        layer = _slopes(image, channel.name)
    elif picture.scale == "logarithmic":
        layer = logarithmic(image[channel.name], picture.dark)
    else:
        layer = linear(image[channel.name])
    _draw(image, layer, channel, picture, path)


def _slopes(image: RangeImage, name: str) -> Layer:
    """Return the derivative of a range, which brings out the fine structure (paper, Figure 2a).

    The grey level is the angle of :func:`slope`, magnified about zero and compressed towards grazing surfaces by an
    arc tangent, with the scale taken from the image: surfaces that face the upper left are bright, as if lit from
    there.
    """
    angle = np.degrees(np.arctan(slope(image, name)))
    size = np.abs(angle[np.isfinite(angle)])
    knee = max(1.5 * float(np.quantile(size, 0.6)), 0.5) if size.size else 45.0
    forward, back = (lambda x: np.arctan(x / knee), lambda y: knee * np.tan(y))
    return Layer(angle, FuncNorm((forward, back), -90.0, 90.0))


def slope(image: RangeImage, name: str = "range_m") -> NDArray[np.float64]:
    """Return the derivative of the range along the diagonal to the lower right, shape (rows, columns).

    dR / (R dθ) along the row and dR / (R dφ) along the column, summed over √2: the tangent of the angle between the
    surface and one that faces the scanner. Differences are central where both neighbours have a range and one-sided
    where one has; a direction without neighbours counts as flat. NaN where the voxel has no range or stands alone.
    """
    ranges = image[name].astype(np.float64)
    along = _difference(ranges, axis=1) / step_of(image.theta)
    down = _difference(ranges, axis=0) / step_of(image.phi)
    known = np.isfinite(along) | np.isfinite(down)
    both = (np.nan_to_num(along) + np.nan_to_num(down)) / (np.sqrt(2.0) * ranges)
    return np.where(known, both, np.nan)


def _difference(values: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """Return the mean difference to the neighbours along an axis, of those that are there."""
    step = np.diff(values, axis=axis, append=np.nan)
    before = np.roll(step, 1, axis=axis)
    return np.where(np.isnan(step), before, np.where(np.isnan(before), step, 0.5 * (step + before)))


def _draw(image: RangeImage, layer: Layer, channel: Channel, picture: Picture, path: str | Path) -> None:
    """Draw a layer with axes in degrees, colour bar, heading, and a legend of the voxels without a range."""
    rows, columns = _voxels_of_dots(image)
    causes = causes_of(image[f"{channel.prefix}status"], np.isnan(layer.values))
    with house_style():
        scale = ScalarMappable(layer.norm, matplotlib.colormaps[picture.colours])
        dots = scale.to_rgba(np.nan_to_num(layer.values[np.ix_(rows, columns)]), bytes=True)
        # Colours are laid on dot by dot: a dots made smaller must not blend voxels with and without a range.
        for status, where in causes.items():
            colour = np.rint(255.0 * np.array(to_rgba(STATUS_COLOUR.get(status, FAINT)))).astype(np.uint8)
            dots[where[np.ix_(rows, columns)]] = colour
        sheet = canvas(columns.size, rows.size, legend_lines=len(causes))
        _axes(sheet, image)
        if np.isfinite(layer.values).any():
            _colour_bar(sheet, layer, picture.label, scale)
        else:
            sheet.bar.set_visible(False)
        _heading(sheet, image, picture.title)
        _legend(sheet, causes)
        save(lay(sheet, dots), path)


def _voxels_of_dots(image: RangeImage) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the row of each line of dots and the column of each dot of a line.

    Voxels become whole numbers of dots where the picture is larger than the image, and are left out evenly where it
    is smaller. Angles keep their proportions, as far as whole numbers and very slender rasters allow.
    """
    high, wide = (
        count * step_of(angles) for count, angles in zip(image.shape, (image.phi, image.theta), strict=True)
    )
    high, wide = max(high, wide / _SLENDEREST), max(wide, high / _SLENDEREST)
    finest = max(image.shape[0] * max(high, wide) / high, image.shape[1] * max(high, wide) / wide)
    long = min(max(finest, _SMALLEST), _LARGEST)
    dots = (round(long * high / max(high, wide)), round(long * wide / max(high, wide)))
    row, column = (_indices(number, count) for number, count in zip(dots, image.shape, strict=True))
    return row, column


def _indices(dots: int, voxels: int) -> NDArray[np.intp]:
    """Return the voxel of each dot: repeated whole, or decimated."""
    if dots >= voxels:
        return np.repeat(np.arange(voxels), max(round(dots / voxels), 1))
    return ((np.arange(dots) + 0.5) * (voxels / dots)).astype(np.intp)


def _axes(sheet: Canvas, image: RangeImage) -> None:
    """Scale the axes in degrees, from the outer edges of the first voxels to those of the last."""
    across, down = np.degrees(image.theta), np.degrees(image.phi)
    half_x, half_y = np.degrees(step_of(image.theta)) / 2.0, np.degrees(step_of(image.phi)) / 2.0
    sheet.axes.set_xlim(across[0] - half_x, across[-1] + half_x)
    sheet.axes.set_ylim(down[-1] + half_y, down[0] - half_y)
    wide, high = sheet.axes.get_position().size * sheet.figure.get_size_inches()
    for axis, angles, room, name, long_name in (
        (sheet.axes.xaxis, across, wide, "Θ [°]", "Θ to the right [°]"),
        (sheet.axes.yaxis, down, high, "φ [°]", "φ downwards [°]"),
    ):
        axis.set_label_text(long_name if room > 1.4 else name)
        axis.set_major_formatter(ScalarFormatter(useOffset=False))
        if angles.size == 1:
            axis.set_ticks([angles[0]], [f"{angles[0]:.4g}"])
        elif room < 1.4:
            axis.set_major_locator(MaxNLocator(nbins=2))


def _colour_bar(sheet: Canvas, layer: Layer, label: str, scale: ScalarMappable) -> None:
    bar = sheet.figure.colorbar(scale, cax=sheet.bar, extend=layer.extend, extendfrac=0.025)
    label_bar(bar, layer.norm, label)


def _heading(sheet: Canvas, image: RangeImage, title: str) -> None:
    """Write the title and, below it, which instrument saw what."""
    figure = sheet.figure
    wide, high = figure.get_size_inches()
    left, top = sheet.axes.get_position().x0, sheet.axes.get_position().y1
    figure.text(left, top + 0.27 / high, title, size=10.5, weight="bold", va="baseline")
    room = int((1.0 - left) * wide / 0.062)
    figure.text(
        left, top + 0.10 / high, shorten(about(image), room, placeholder=" …"), color=FAINT, va="baseline"
    )


def about(image: RangeImage) -> str:
    """Return one line on instrument, scene, raster and outcome."""
    # The line itself: a scenario from somebody else's file is no text to be read as YAML for a heading.
    preset = _PRESET.search(image.scenario_yaml)
    names = list(numbered(image.objects).values())
    shown = [*names[:3], "…"] if len(names) > 3 else names
    rows, columns = image.shape
    parts = [
        plot_label(preset[1]) if preset else "",
        ", ".join(map(plot_label, shown)),
        f"{rows} × {columns} voxels",
        f"seed {image.seed}",
    ]
    return "  ·  ".join(part for part in [*parts, f"{100.0 * image.valid.mean():.1f} % valid"] if part)


def _legend(sheet: Canvas, causes: dict[Status, NDArray[np.bool_]]) -> None:
    """Explain the colours of the voxels without a value, at the foot of the figure."""
    if not causes:
        return
    figure, left = sheet.figure, sheet.axes.get_position().x0
    wide, high = figure.get_size_inches()
    figure.legend(
        handles=patches_of(causes, int(wide / 0.064)),
        loc="lower left",
        bbox_to_anchor=(left, 0.06 / high),
        borderaxespad=0.0,
        borderpad=0.0,
        handlelength=1.2,
        handleheight=1.0,
        labelspacing=0.45,
        fontsize=7.5,
    )
