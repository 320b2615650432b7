"""What pictures of the difference of two results draw: where, with which colours, and what is told."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from drawn import figure_of
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from scanner_sim.products.pictures import difference


@pytest.fixture
def axes() -> Axes:
    return Figure().add_subplot()


def test_differences_by_shot_are_drawn_where_the_shots_point(axes: Axes) -> None:
    """Claim: in degrees, φ downwards, colours as far below as above nothing; where one result alone has a range a
    colour of its own, with how many there are."""
    over = np.array([-1.0, 2.0, np.nan, np.nan, np.nan])
    one: Any = SimpleNamespace(
        name="u", over_sigma=over, only_first=np.array([False, False, True, True, False]),
        only_second=np.array([False, False, False, False, True]),
    )  # fmt: skip
    theta, phi = np.radians(np.arange(5.0)), np.radians(10.0 - np.arange(5.0))
    difference._draw_map(axes, one, SimpleNamespace(theta=theta, phi=phi))  # type: ignore[arg-type]
    both, first, second = axes.collections[:3]
    places = np.stack([np.arange(5.0), 10.0 - np.arange(5.0)], axis=1)
    for dots, members in ((both, [0, 1, 2, 3, 4]), (first, [2, 3]), (second, [4])):
        np.testing.assert_allclose(np.asarray(dots.get_offsets()), places[members])
    low, high = both.get_clim()
    assert low == -high < -3.0
    assert axes.yaxis_inverted()
    legend = axes.get_legend()
    assert legend is not None
    words = [text.get_text() for text in legend.get_texts()]
    assert words == ["range in the first only: 2", "range in the second only: 1"]
    shown = [to_rgb(patch.get_facecolor()) for patch in legend.get_patches()]
    np.testing.assert_allclose(shown, [np.asarray(dots.get_facecolor())[0, :3] for dots in (first, second)])


def test_differences_of_images_are_drawn_from_edge_to_edge(axes: Axes) -> None:
    """Claim: in degrees, half a voxel beyond the middles of the outer ones, φ downwards; where one result alone has a
    range its colour lies over the map, and nowhere else."""
    over = np.array([[-1.0, 2.0, np.nan], [0.5, np.nan, 3.0]])
    first, second = np.isnan(over) & [[True], [False]], np.isnan(over) & [[False], [True]]
    one: Any = SimpleNamespace(name="u", over_sigma=over, only_first=first, only_second=second)
    theta, phi = np.radians([-2.0, 0.0, 2.0]), np.radians([5.0, 8.0])
    difference._draw_map(axes, one, SimpleNamespace(theta=theta, phi=phi))  # type: ignore[arg-type]
    for image in axes.images:
        np.testing.assert_allclose(image.get_extent(), [-3.0, 3.0, 9.5, 3.5])
    both, alone, other = (np.ma.filled(image.get_array().astype(float), np.nan) for image in axes.images)
    np.testing.assert_array_equal(both, over)
    np.testing.assert_array_equal(np.isfinite(alone), first)
    np.testing.assert_array_equal(np.isfinite(other), second)


def test_each_range_that_both_have_is_drawn_beside_its_histogram(monkeypatch: pytest.MonkeyPatch) -> None:
    figure = figure_of(monkeypatch, difference)
    asked: list[Any] = []
    monkeypatch.setattr(difference, "_draw_map", lambda axes, *given: asked.append(("map", *given)))
    monkeypatch.setattr(
        difference, "_draw_histogram", lambda axes, *given: asked.append(("histogram", *given))
    )
    monkeypatch.setattr(type(figure), "get_layout_engine", lambda _: SimpleNamespace(set=lambda **_: None))
    for same in (True, False):
        asked.clear()
        found: Any = SimpleNamespace(ranges=["u", "v"], same_seed=same, seeds=(7, 7))
        difference.draw_difference(found, ("a", "b"), "")
        assert asked == [("map", "u", found), ("histogram", "u"), ("map", "v", found), ("histogram", "v")]
        title = figure.get_suptitle()
        assert title.startswith("b less a")
        assert ("both with seed 7" in title) is same


def test_what_differs_is_told_in_words() -> None:
    """Claim: how many in both, median and rms in mm, rms in σ, and shares beyond each number of σ beside normal
    ones."""
    shares = {
        f"{sigmas:g} sigma": {"found": share} for sigmas, share in ((2.0, 0.1234), (3.0, 0.01), (5.0, None))
    }
    numbers = {
        "both": 12345, "difference_m": {"median": -1.5e-3, "rms": 2.5e-3}, "over_sigma": {"rms": 1.25},
        "share_beyond": shares,
    }  # fmt: skip
    assert difference._words(SimpleNamespace(numbers=lambda: numbers)) == [  # type: ignore[arg-type]
        "12,345 in both", "median -1.5 mm, rms 2.5 mm", "rms 1.25 σ", "beyond 2 σ: 12.3 % (normal 4.6 %)",
        "beyond 3 σ: 1 % (normal 0.27 %)",
    ]  # fmt: skip
    nothing: Any = SimpleNamespace(numbers=lambda: {"both": 0})
    assert difference._words(nothing) == ["no voxel has a range in both"]
