"""A frame of the video camera, with the dots that were found in it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scanner_sim.products.frames import ArrayDots
from scanner_sim.products.pictures.style import INK, drawing, plot_label
from scanner_sim.signals.dots.settings import DotStatus

_FOUND = "#e8552d"
_WIDTH = 6.6
"""Of the picture [inch]."""
_TURN = np.linspace(0.0, 2.0 * np.pi, 91)


def draw_frame(grey: NDArray[np.uint8], dots: Sequence[ArrayDots], title: str, path: str | Path) -> None:
    """Draw a frame, and round each dot the ellipse that was fitted to it, with the number of its target.

    Parameters
    ----------
    grey
        Grey levels of a screen, shape (rows, columns).
    dots
        Of the arrays in it; below the frame it is said why the others are missing.
    title
        What stands above.
    path
        The PNG to write.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    rows, columns = grey.shape
    lines = [_said(one) for one in dots]
    below = 0.5 + 0.17 * len(lines)
    high = 0.89 * _WIDTH * rows / columns
    whole = high + below + 0.25
    with drawing(path, (_WIDTH, whole)) as figure:
        axes = figure.add_axes((0.1, below / whole, 0.89, high / whole))
        axes.imshow(grey, cmap="gray", vmin=0, vmax=255, interpolation="antialiased")
        for one in dots:
            for number in np.flatnonzero(np.isfinite(one.shape[:, 0])):
                (u, v), (a, b, c) = one.centre[number], one.shape[number]
                ring = np.cos(_TURN), np.sin(_TURN)
                axes.plot(u + a * ring[0] + b * ring[1], v + b * ring[0] + c * ring[1], color=_FOUND, lw=1.0)
                name = one.targets[number].rpartition("/")[2]
                axes.text(u, v, name, color=_FOUND, ha="center", va="center", fontsize=7)
        axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5), xlabel="u [pixel]", ylabel="v [pixel]")
        axes.set_title(plot_label(title), loc="left", fontsize=8, color=INK)
        for row, line in enumerate(lines):
            figure.text(0.1, (0.06 + 0.17 * row) / whole, plot_label(line), fontsize=7, color=INK)


def _said(one: ArrayDots) -> str:
    """Return how many dots of an array were found, and why others were not."""
    found = np.count_nonzero(one.status == DotStatus.VALID)
    words = [f"{one.name}: {found} of {len(one.targets)} dots"]
    for code in DotStatus:
        count = np.count_nonzero(one.status == code)
        if count and code is not DotStatus.VALID:
            words.append(f"{count} {code.name.lower().replace('_', ' ')}")
    return ", ".join(words)
