"""The look of a reproduced figure: its words, its panels, and ticks of axes with logarithms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scanner_sim.validation.reproduce import drawing


@pytest.mark.parametrize("panels", [1, 3])
def test_a_sheet_has_a_heading_and_what_is_said_aside(monkeypatch: pytest.MonkeyPatch, panels: int) -> None:
    """Claim: the heading is above, the rest below, both begin at the left; panels stand side by side, with a grid
    but where a picture or nothing but words is in them."""
    written: list[tuple[Figure, Path]] = []
    monkeypatch.setattr(drawing, "save", lambda figure, path: written.append((figure, path)))
    drawn: list[Axes] = []

    def draw(axes: Sequence[Axes]) -> None:
        drawn.extend(axes)
        axes[0].plot([1.0, 2.0], [3.0, 4.0])
        if panels > 1:
            axes[1].imshow(np.eye(3))
            axes[2].set_axis_off()

    drawing.sheet(Path("a.png"), "Range error (Figure 12)", "what each curve is", draw, panels, 4.2)
    ((figure, path),) = written
    assert path == Path("a.png")
    assert figure.get_suptitle() == "Range error (Figure 12)"
    assert figure.get_supxlabel() == "what each curve is"
    figure.canvas.draw()
    above, below = (
        text.get_window_extent()
        for words in (figure.get_suptitle(), figure.get_supxlabel())
        for text in figure.texts
        if text.get_text() == words
    )
    assert above.y0 > max(one.bbox.y1 for one in drawn)
    assert below.y1 < min(one.bbox.y0 for one in drawn)
    assert above.x0 == pytest.approx(below.x0, abs=2.0)
    assert above.x0 < 0.05 * figure.bbox.width
    assert figure.axes == drawn
    assert [one.bbox.x0 for one in drawn] == sorted(one.bbox.x0 for one in drawn)
    assert figure.get_figheight() == 4.2
    lined = [any(line.get_visible() for line in one.get_xgridlines()) for one in drawn]
    assert lined == [True, False, False][:panels]


@pytest.mark.parametrize(
    ("ends", "ticks"),
    [
        ((2.0, 30.0), "2 3 5 10 20 30"),
        ((1.9, 31.0), "2 3 5 10 20 30"),
        ((2.1, 29.0), "3 5 10 20"),
        ((0.3, 400.0), "0.5 1 2 3 5 10 20 30 50 100 200"),
    ],
)
@pytest.mark.parametrize("axis", ["x", "y"])
def test_ranges_are_ticked_where_they_are_and_not_beyond(
    axis: str, ends: tuple[float, float], ticks: str
) -> None:
    """Claim: round ranges from the axis's beginning to its end and no others, so that it stays as long as it was; the
    other axis is let alone."""
    axes = Figure().subplots()
    axes.set(xlim=ends, ylim=ends)
    drawing.ranges(axes, axis)
    own, other = (axes.xaxis, axes.yaxis) if axis == "x" else (axes.yaxis, axes.xaxis)
    assert (own.get_scale(), other.get_scale()) == ("log", "linear")
    assert [label.get_text() for label in own.get_ticklabels()] == ticks.split()
    np.testing.assert_allclose(own.get_ticklocs(), [float(tick) for tick in ticks.split()])
    assert len(own.get_ticklocs(minor=True)) == 0
    assert (axes.get_xlim(), axes.get_ylim()) == (ends, ends)
    assert (own.get_label_text(), other.get_label_text()) == ("range [m]", "")


def test_logarithms_are_ticked_at_one_two_and_five() -> None:
    """Claim: of each power of ten, as far as the axis goes: either axis by its own ends, or the one that is asked for;
    what is drawn fills them as it did."""
    axes, alone = Figure().subplots(1, 2)
    axes.set(xlim=(0.04, 3.0), ylim=(1e-4, 2e-3))
    drawing.logarithms(axes)
    assert [label.get_text() for label in axes.get_xticklabels()] == ["0.05", "0.1", "0.2", "0.5", "1", "2"]
    np.testing.assert_allclose(axes.get_yticks(), [1e-4, 2e-4, 5e-4, 1e-3, 2e-3])
    assert (axes.get_xlim(), axes.get_ylim()) == ((0.04, 3.0), (1e-4, 2e-3))
    alone.plot([1.0, 2.0], [0.3, 60.0])
    drawing.logarithms(alone, "y")
    assert (alone.get_xscale(), alone.get_yscale()) == ("linear", "log")
    low, high = alone.get_ylim()
    assert 0.2 < low < 0.3
    assert 60.0 < high < 90.0
