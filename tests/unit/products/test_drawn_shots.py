"""What pictures of shots draw, and the scales of colours of all layers."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import LogNorm, to_hex, to_rgba
from matplotlib.figure import Figure

from scanner_sim.foundation.status import Status
from scanner_sim.products.budget import crossing
from scanner_sim.products.pictures import layer, shots
from scanner_sim.products.pictures.style import RANGE_MAP, STATUS_COLOUR


class Shots(SimpleNamespace):
    """A made-up table of shots."""

    def __getitem__(self, name: str) -> Any:
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.theta)


def table(count: int = 401) -> Any:
    """Return shots along a slanted line, whose ranges grow, every tenth without one."""
    share = np.linspace(0.0, 1.0, count)
    ranges = 5.0 + share
    ranges[::10] = np.nan
    status = np.where(np.isnan(ranges), int(Status.BELOW_THRESHOLD), int(Status.VALID))
    return Shots(
        theta=-0.1 + 0.3 * share, phi=0.05 + 0.1 * share, time=2.0 * share, seed=17, valid=np.isfinite(ranges),
        objects={1: "wall"}, columns={"range_m": ranges, "status": status},
    )  # fmt: skip


def drawn(monkeypatch: pytest.MonkeyPatch, draw: Any, of: Any) -> Figure:
    kept: list[Figure] = []
    monkeypatch.setattr(shots, "save", lambda figure, path: kept.append(figure))
    monkeypatch.setattr(shots, "numbered", lambda objects: objects)
    draw(of, "")
    return kept[0]


def test_shots_are_drawn_at_their_angles_by_range(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: all faint, those with a range over them in its colour; from the half per cent that is nearest to that
    which is farthest; 3 % of the wider side beyond them, Θ and φ to one scale, φ downwards."""
    made = table()
    figure = drawn(monkeypatch, shots.draw_shots_range, made)
    axes = figure.axes[0]
    faint, coloured = axes.collections
    degrees = np.degrees(np.stack([made.theta, made.phi], axis=1))
    np.testing.assert_allclose(np.asarray(faint.get_offsets()), degrees)
    np.testing.assert_allclose(np.asarray(coloured.get_offsets()), degrees[made.valid])
    ranges = made["range_m"][made.valid]
    low, high = np.percentile(ranges, (0.5, 99.5))
    expected = matplotlib.colormaps[RANGE_MAP]((ranges - low) / (high - low))
    np.testing.assert_allclose(coloured.get_facecolor(), expected, atol=1.0 / 128.0)
    margin = 0.03 * 0.3 + 1e-4
    assert axes.get_xlim() == pytest.approx(np.degrees([-0.1 - margin, 0.2 + margin]).tolist())
    assert axes.get_ylim() == pytest.approx(np.degrees([0.15 + margin, 0.05 - margin]).tolist())
    wide, high_ = axes.get_position().size * figure.get_size_inches()
    assert wide / high_ == pytest.approx((0.3 + 2.0 * margin) / (0.1 + 2.0 * margin), rel=1e-6)
    about = f"wall  ·  401 shots in 2 s  ·  seed 17  ·  {100.0 * made.valid.mean():.1f} % valid"
    assert figure.texts[1].get_text() == about
    nothing = table()
    nothing.columns["range_m"] = np.full(401, np.nan)
    assert len(drawn(monkeypatch, shots.draw_shots_range, nothing).axes) == 1


def test_shots_are_drawn_by_status_with_its_share(monkeypatch: pytest.MonkeyPatch) -> None:
    made = table()
    figure = drawn(monkeypatch, shots.draw_shots_status, made)
    axes = figure.axes[0]
    degrees = np.degrees(np.stack([made.theta, made.phi], axis=1))
    present = [code for code in Status if code in (Status.VALID, Status.BELOW_THRESHOLD)]
    (legend,) = figure.legends
    words = [text.get_text() for text in legend.get_texts()]
    for dots, code, word in zip(axes.collections, present, words, strict=True):
        where = made["status"] == code
        np.testing.assert_allclose(np.asarray(dots.get_offsets()), degrees[where])
        colour = shots._VALID if code is Status.VALID else STATUS_COLOUR[code]
        assert to_hex(np.asarray(dots.get_facecolor())[0]) == to_hex(colour)
        assert word == f"{100.0 * where.mean():.3g} %: {code.sentence}"


def test_of_many_shots_every_second_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    made = table(200_001)
    monkeypatch.setattr(shots, "numbered", lambda objects: objects)
    figure, _, some = shots._axes(made, "t", 0)
    np.testing.assert_array_equal(some, np.arange(200_001)[::2])
    assert figure.texts[1].get_text().endswith("one in 2 drawn")


@pytest.mark.parametrize(
    ("count", "area"), [(1, 12.0), (10_000, 0.3 * 4.0 * 2.0 * 5184.0 / 10_000.0), (10**7, 0.4)]
)
def test_dots_fill_a_third_of_the_axes(count: int, area: float) -> None:
    """Claim: 0.3 of 4 × 2 inches of 72 points each, between what can be seen and what is large enough."""
    figure = Figure(figsize=(8.0, 4.0))
    assert shots._dot(count, figure, figure.add_axes((0.1, 0.1, 0.5, 0.5))) == pytest.approx(area)


def test_an_even_scale_leaves_out_half_a_per_cent_at_either_end() -> None:
    values = np.arange(1000.0).reshape(20, 50)
    values[3, 4] = np.nan
    made = layer.linear(values.astype(np.float32))
    assert (made.norm.vmin, made.norm.vmax) == pytest.approx(tuple(np.nanpercentile(values, (0.5, 99.5))))
    assert made.extend == "both"
    flat = layer.linear(np.full((3, 3), 7.0, dtype=np.float32))
    assert (flat.norm.vmin, flat.norm.vmax) == pytest.approx((7.0 - 5e-4, 7.0 + 5e-4), abs=1e-6)
    assert flat.extend == "neither"


@pytest.mark.parametrize(
    ("values", "ends"), [([1.0, 2.0, 3.0], "neither"), ([0.5, 2.0], "min"), ([2.0, 3.5], "max")]
)
def test_a_scale_tells_at_which_end_it_ends_too_early(values: list[float], ends: str) -> None:
    made = layer.Layer(np.array(values), layer.Normalize(1.0, 3.0))
    assert made.extend == ends


def test_a_logarithmic_scale_spans_the_bulk() -> None:
    """Claim: what is not above nothing is no value, unless it is said how dark is dark: then it is as dark as that, and
    does not make the scale; a factor of 1.5 to each side of a single value."""
    values = np.append(np.geomspace(1.0, 1000.0, 998), [0.0, -3.0]).astype(np.float32).reshape(20, 50)
    made = layer.logarithmic(values, None)
    assert isinstance(made.norm, LogNorm)
    assert np.isnan(made.values).sum() == 2
    positive = values[values > 0.0]
    assert (made.norm.vmin, made.norm.vmax) == pytest.approx(
        tuple(np.percentile(positive, (0.5, 99.8))), rel=1e-5
    )
    dark = layer.logarithmic(values, 10.0)
    assert float(dark.values.min()) == pytest.approx(0.01)
    bright = values[values >= 10.0]
    assert (dark.norm.vmin, dark.norm.vmax) == pytest.approx(
        tuple(np.percentile(bright, (0.5, 99.8))), rel=1e-5
    )
    one = layer.logarithmic(np.full((2, 2), 6.0, dtype=np.float32), None)
    assert (one.norm.vmin, one.norm.vmax) == pytest.approx((4.0, 9.0))


def test_causes_of_empty_voxels_are_their_statuses() -> None:
    """Claim: of empty ones alone, each status that occurs, with its share in words and its colour."""
    status = np.array(
        [[Status.VALID, Status.SATURATED], [Status.SATURATED, Status.BELOW_THRESHOLD]], dtype=np.float32
    )
    empty = np.array([[False, True], [False, True]])
    found = layer.causes_of(status, empty)
    assert {code: mask.tolist() for code, mask in found.items()} == {
        Status.SATURATED: [[False, True], [False, False]], Status.BELOW_THRESHOLD: [[False, False], [False, True]],
    }  # fmt: skip
    for patch, code in zip(layer.patches_of(found, 200), found, strict=True):
        assert patch.get_label() == f"25.0 %: {code.sentence}"
        assert patch.get_facecolor() == to_rgba(STATUS_COLOUR[code])
    (alone,) = layer.patches_of({Status.VALID: np.ones((2, 2), bool)}, 200)
    assert alone.get_label() == "100 %: no neighbour to compare with"


@pytest.mark.parametrize(
    ("count", "words"),
    [
        (9, "below 0.01 %"),
        (11, "0.011 %"),
        (5_000, "5 %"),
        (12_345, "12.3 %"),
        (99_999, "99.9 %"),
        (100_000, "100 %"),
    ],
)
def test_shares_round_neither_to_nothing_nor_to_all(count: int, words: str) -> None:
    assert layer._per_cent(np.arange(100_000) < count) == words


LAWS = {"triangulation": lambda x: 1e-4 * x**2, "tof": lambda x: 7e-4 * x}


def rows(ranges: Any, **laws: Any) -> Any:
    return [
        SimpleNamespace(mode=mode, source=source, range_m=x, simulated_m=law(x), analytic_m=2.0 * law(x))
        for mode, law in (LAWS | laws).items() for source in ("all", "shot") for x in ranges
    ]  # fmt: skip


@pytest.mark.parametrize("order", [1, -1])
def test_curves_by_powers_cross_where_they_are_equal(order: int) -> None:
    """Claim: laws by R² and R meet at 7 m exactly, for interpolation is in logarithms; in whatever order the ranges
    are; only whole errors count, and only ranges that both have."""
    ranges = [1.0, 3.0, 5.5, 11.0, 40.0][::order]
    assert crossing(rows(ranges), "simulated_m") == pytest.approx(7.0)
    assert crossing(rows(ranges), "analytic_m") == pytest.approx(7.0)
    more = rows(ranges)
    more.append(SimpleNamespace(mode="tof", source="all", range_m=6.9, simulated_m=1e-9, analytic_m=1e-9))
    assert crossing(more, "simulated_m") == pytest.approx(7.0)


@pytest.mark.parametrize(
    ("ranges", "law"),
    [([1.0, 6.9], None), ([7.1, 20.0], None), ([3.0], None), ([1.0, 40.0], lambda x: 0.0 * x)],
)
def test_curves_that_do_not_cross_have_no_meeting(ranges: list[float], law: Any) -> None:
    """Claim: neither before nor after, nor of one range, nor where one way has no error; from better to worse only."""
    made = rows(ranges) if law is None else rows(ranges, tof=law)
    assert math.isnan(crossing(made, "simulated_m"))
    turned = rows([1.0, 40.0], triangulation=LAWS["tof"], tof=LAWS["triangulation"])
    assert math.isnan(crossing(turned, "simulated_m"))
