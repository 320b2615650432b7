"""What the pictures of a campaign draw: distributions, dependences with their intervals, and Sobol's indices."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray
from drawn import bars, figure_of, line
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from scanner_sim.campaign import report, report_pictures
from scanner_sim.products.pictures.style import plot_label


@pytest.fixture
def axes() -> Axes:
    return Figure().add_subplot()


def dependence(key: str, dead: bool = False, **more: Any) -> Any:
    told: dict[str, Any] = {
        "key": key, "dead": dead, "at": np.array([1.0, 2.0, 4.0]), "mean": np.array([5.0, 7.0, 6.0]),
        "error": np.array([0.1, 0.2, 0.4]), "points": np.array([[1.5, 3.5], [5.5, 6.5]]),
    }  # fmt: skip
    return SimpleNamespace(**told | more)


@pytest.mark.parametrize("dead", [True, False])
def test_means_are_drawn_with_their_intervals_over_their_key(axes: Axes, dead: bool) -> None:
    """Claim: single runs behind means with 1.96 standard errors, each axis with its own unit; what does nothing is
    grey."""
    report_pictures._means(axes, "σ [m]", "m", dependence("a.b", dead), {"a.b": "W", "other": "s"})
    ((_, marks, ends),) = bars(axes)
    np.testing.assert_allclose(marks, [[1.0, 5.0], [2.0, 7.0], [4.0, 6.0]])
    np.testing.assert_allclose(ends - marks[:, 1:], 1.96 * np.array([[0.1], [0.2], [0.4]]) * [-1.0, 1.0])
    np.testing.assert_allclose(line(axes, 0), [[1.5, 5.5], [3.5, 6.5]])
    assert axes.get_xlabel() == plot_label("a.b [W]")
    assert axes.get_ylabel() == plot_label("σ [m]")
    assert axes.get_title(loc="right") == ("dead" if dead else "")
    colour = axes.containers[0].lines[0].get_color()  # type: ignore[attr-defined]
    assert colour == (report_pictures.DEAD if dead else report_pictures.ALIVE)


@pytest.mark.parametrize(("count", "bins"), [(9, 5), (100, 10), (400, 20), (2500, 40)])
def test_a_measure_has_its_histogram_and_its_median(axes: Axes, count: int, bins: int) -> None:
    """Claim: the root of the number of runs as bins, five to forty."""
    values = np.arange(float(count)) ** 2
    report_pictures._histogram(axes, "u [m]", "m", values)
    heights = [patch.get_height() for patch in axes.patches]  # type: ignore[attr-defined]
    assert len(heights) == bins
    assert sum(heights) == count
    np.testing.assert_allclose(line(axes, 0)[:, 0], np.median(values))


@pytest.mark.parametrize(
    ("end", "prefixed"), [(9.9e-3, True), (0.0101, False), (9990.0, False), (10_001.0, True)]
)
@pytest.mark.parametrize("unit", ["m", "1"])
def test_very_small_and_large_numbers_have_a_prefix(
    axes: Axes, end: float, prefixed: bool, unit: str
) -> None:
    """Claim: below a hundredth and from ten thousand on, by the larger end of either sign, with the unit where one
    is."""
    axes.set_xlim(-end, 0.5 * end)
    axes.set_ylim(0.0, 1.0)
    report_pictures._prefixed(axes, unit, "1")
    found = axes.xaxis.get_major_formatter()
    assert isinstance(found, EngFormatter) is prefixed
    if isinstance(found, EngFormatter):
        assert found.unit == unit.removesuffix("1")
    assert not isinstance(axes.yaxis.get_major_formatter(), EngFormatter)


def test_a_panel_is_drawn_for_each_key_that_has_values(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the histogram first, then keys in their order, four panels beside one another; keys without means and
    single runs have none."""
    figure = figure_of(monkeypatch, report_pictures)
    asked: list[Any] = []
    monkeypatch.setattr(report_pictures, "_histogram", lambda axes, *given: asked.append(given))
    monkeypatch.setattr(report_pictures, "_means", lambda axes, *given: asked.append(given))
    empty = dependence("none", at=np.zeros(0), points=np.zeros((2, 0)))
    single = dependence("single", at=np.zeros(0))
    keys = [dependence("u"), empty, single, *(dependence(f"v{number}") for number in range(3))]
    values = np.arange(3.0)
    report_pictures.draw_measure("", "m", "s", values, keys, {"u": "W"})  # type: ignore[arg-type]
    assert asked[0] == ("m [s]", "s", values)
    assert [given[2].key for given in asked[1:]] == ["u", "single", "v0", "v1", "v2"]
    assert all((given[0], given[1], given[3]) == ("m [s]", "s", {"u": "W"}) for given in asked[1:])
    assert [axes.get_visible() for axes in figure.axes] == [True] * 6 + [False] * 2
    assert {axes.get_subplotspec().get_gridspec().ncols for axes in figure.axes} == {4}  # type: ignore[union-attr]


def sensitivity(places: int) -> xarray.Dataset:
    shape = (places, 2)
    first, total = 0.1 + np.arange(2.0 * places).reshape(shape), 0.2 + np.arange(2.0 * places).reshape(shape)

    def interval(values: np.ndarray) -> Any:
        return (("place", "key", "end"), np.stack([values - 0.05, values + 0.07], axis=-1))

    return xarray.Dataset(
        {
            "first_order": (("place", "key"), first), "total_order": (("place", "key"), total),
            "first_order_interval": interval(first), "total_order_interval": interval(total),
            "rows": (("place",), np.ones(places)),
        },
        {"key": ["a.b", "c.d"], "power": ("place", 0.5 + np.arange(places), {"units": "W"})},
    )  # fmt: skip


@pytest.mark.parametrize(("places", "panels"), [(2, 2), (9, 6)])
def test_indices_are_drawn_place_by_place(places: int, panels: int) -> None:
    """Claim: both orders of each key with their intervals beside one another, the first above; at most six places, each
    named by the values of the other axes."""
    figure = Figure()
    given = sensitivity(places)
    report_pictures.panel_sensitivity(figure, given)
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert len(shown) == panels
    for place, axes in enumerate(shown):
        for number, (name, shift) in enumerate((("first_order", -0.13), ("total_order", 0.13))):
            values = given[name].values[place]
            np.testing.assert_allclose(line(axes, number), np.stack([values, np.arange(2.0) + shift], axis=1))
            strokes: Any = axes.collections[number]
            for stroke, value, level in zip(
                strokes.get_segments(), values, np.arange(2.0) + shift, strict=True
            ):
                np.testing.assert_allclose(stroke, [[value - 0.05, level], [value + 0.07, level]])
        assert axes.get_title() == plot_label(f"power {0.5 + place:.4g} W")
    assert [label.get_text() for label in shown[0].get_yticklabels()] == [
        plot_label("a.b"),
        plot_label("c.d"),
    ]
    assert shown[0].yaxis_inverted()
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["first order", "total order"]
    wide, high = report_pictures.sensitivity_size(given)
    assert wide == pytest.approx(2.3 * min(panels, 3) + 2.3)
    assert high == pytest.approx((0.28 * 2 + 0.7) * (2 if panels > 3 else 1) + 0.3)


@pytest.mark.parametrize(("name", "short"), [("a" * 34, "a" * 34), ("b" + "a" * 34, "…" + "a" * 33)])
def test_long_keys_lose_their_beginning(name: str, short: str) -> None:
    assert report_pictures._short(name) == short


def test_a_measure_of_a_campaign_is_told_by_its_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of runs that have it: how many, its quantiles, the worst of them, which are those farthest from the best,
    and its picture; a measure that is the same everywhere has numbers alone."""
    asked: list[Any] = []
    values = np.array([3.0, np.nan, 9.0, 1.0, 4.0])
    monkeypatch.setattr(report, "units_of", lambda *_: {"m": "W", "k": "s"})
    monkeypatch.setattr(report, "MEASURES", {"m": SimpleNamespace(meaning="how bright", best=1.5)})
    monkeypatch.setattr(report, "dependences", lambda store, name: [f"of {name}"])
    monkeypatch.setattr(report, "_verdict", lambda one, unit, median: (one, unit, median))
    monkeypatch.setattr(report, "_said", lambda store, run: f"run {run}")
    monkeypatch.setattr(report, "picture_address", lambda draw: draw("to") or "picture")
    monkeypatch.setattr(report, "draw_measure", lambda *given: asked.append(given))
    monkeypatch.setattr(report, "WORST", 2)
    plan = SimpleNamespace(vary=[SimpleNamespace(sample="random")])
    store: Any = SimpleNamespace(campaign=SimpleNamespace(plan=plan), measures=("m",))
    table: Any = {"m": values, "run": np.array([10, 11, 12, 13, 14]), "same": np.full(5, 2.0)}
    part = report._part(store, table, "m")
    assert (part.name, part.unit, part.meaning) == ("m", "W", "how bright")
    assert part.runs == 4
    good = values[np.isfinite(values)]
    np.testing.assert_allclose(part.quantiles, np.quantile(good, [0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0]))
    assert part.worst == ((12, 9.0, "run 12"), (14, 4.0, "run 14"))
    ((to, name, unit, shown, found, units),) = asked
    assert (to, name, unit, found, units) == ("to", "m", "W", ["of m"], {"m": "W", "k": "s"})
    np.testing.assert_array_equal(shown, good)
    same = report._part(store, table, "same")
    assert (same.unit, same.meaning, same.worst) == ("1", "a measure of your own", ())
    assert len(asked) == 1
    # Indices are drawn where at least one is known.
    plan.vary.append(SimpleNamespace(sample="saltelli"))
    indices: list[Any] = []
    monkeypatch.setattr(report, "draw_sensitivity", lambda to, found: indices.append(found))
    for totals in ([np.nan, 0.4], [np.nan, np.nan]):
        known = {"total_order": xarray.DataArray(totals)}
        result = SimpleNamespace(sensitivity={"m": known}.get)
        monkeypatch.setattr(report, "CampaignResult", lambda _, result=result: result)
        part = report._part(store, table, "m")
        assert part.sensitivity == ("picture" if np.isfinite(totals).any() else "")
    (drawn,) = indices
    assert drawn["total_order"][1] == 0.4
