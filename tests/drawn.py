"""Pictures as they are drawn, read from a figure that is not written."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure


def figure_of(monkeypatch: pytest.MonkeyPatch, module: ModuleType) -> Figure:
    """Return the figure that a module's next picture is drawn into; it is not written."""
    figure = Figure()

    @contextmanager
    def kept(*_: Any, **__: Any) -> Iterator[Figure]:
        yield figure

    monkeypatch.setattr(module, "drawing", kept)
    return figure


def line(axes: Axes, number: int) -> np.ndarray:
    """Return the points of a line, shape (n, 2)."""
    return np.asarray(axes.lines[number].get_xydata())


def bars(axes: Axes) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return of all marks with error bars the name, the marks (n, 2) and both ends of each bar (n, 2)."""
    found = []
    for container in axes.containers:
        marks, _, (strokes,) = container.lines  # type: ignore[attr-defined]
        ends = np.array([stroke[:, 1] for stroke in strokes.get_segments()])
        found.append((str(container.get_label()), np.asarray(marks.get_xydata()), ends))
    return found
