"""What pictures of orbits, studies and approaches draw: which number stands where, in which unit."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from drawn import bars, figure_of, line
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgba
from matplotlib.figure import Figure

from scanner_sim.products.budget import BudgetRow, Mode
from scanner_sim.products.pictures import approach, bias, budget, pose_study, timeline
from scanner_sim.products.pose_study import COMPONENTS
from scanner_sim.products.timeline import Label, TargetTimeline, Timeline


def orbit(targets: int) -> Timeline:
    """Return an orbit of 500 s in five moments, whose targets have numbers of their own."""
    tracks = [
        TargetTimeline(
            name="a name that is much too long" if number == 0 else f"t{number}",
            condition=np.array([0, 2, 1, 0, (number + 1) % 3], dtype=np.uint8),
            lit=np.array([0.1, 0.2, 0.3, 0.4, 0.5]) + 0.05 * number,
            earth=np.zeros(5), background=np.array([0.5, 20.0, 30.0, 40.0, 50.0]) + number, sun_behind=np.zeros(5),
        )
        for number in range(targets)
    ]  # fmt: skip
    return Timeline(
        times=np.array([0.0, 100.0, 200.0, 300.0, 400.0]), period=500.0, sun_direction=np.zeros((5, 3)),
        sun_visible=np.array([1.0, 0.75, 0.0, 0.0, 0.5]), sun_in_view=np.array([0.0, 0.25, 0.125, 0.0, 0.0]),
        brightest=np.array([0.9, 200.0, 300.0, 4000.0, 500.0]), full_well=3e3, tracks=tuple(tracks),
        labels=tuple(Label(name, "") for name in ("sunny", "shady", "dark")), groups=(), scenario_yaml="",
    )  # fmt: skip


@pytest.mark.parametrize("targets", [2, 7])
def test_an_orbit_is_drawn_moment_by_moment(monkeypatch: pytest.MonkeyPatch, targets: int) -> None:
    """Claim: each moment holds from its minute to the next one's, the last to the end of the period; conditions by
    colour, a row for each target from above, with its share of the first condition; the Sun's disc, light and charge of
    the first five, charges below one electron left out; all below one another, within the picture."""
    figure = figure_of(monkeypatch, timeline)
    made = orbit(targets)
    timeline.draw_timeline(made, "")
    panels = figure.axes
    assert len(panels) == 4
    edges = np.arange(6.0) * 100.0 / 60.0
    for axes in panels:
        assert axes.get_xlim() == pytest.approx((0.0, 500.0 / 60.0))
    for above, below in pairwise(panels):
        assert 0.0 < below.get_position().y0 < below.get_position().y1 < above.get_position().y0 < 1.0
    band, shares, lit, charge = panels
    mesh: Any = band.collections[0]
    corners = mesh.get_coordinates()
    np.testing.assert_allclose(corners[0, :, 0], edges)
    np.testing.assert_allclose(corners[:, 0, 1], np.arange(targets + 1) - 0.5)
    codes = np.array([[0, 2, 1, 0, (number + 1) % 3] for number in range(targets)])
    colours = [to_rgba(timeline.CONDITION_COLOURS[code]) for code in codes.ravel()]
    np.testing.assert_allclose(mesh.to_rgba(mesh.get_array()).reshape(-1, 4), colours)
    assert band.get_ylim() == (targets - 0.5, -0.5)
    names = [label.get_text() for label in band.get_yticklabels()]
    assert names == ["a name that is mu…", *(f"t{number}" for number in range(1, targets))]
    percent = [f"{100 * (codes[number] == 0).mean():.0f} %" for number in range(targets)]
    assert [(text.get_position()[1], text.get_text()) for text in band.texts] == list(enumerate(percent))

    def curves(axes: Axes) -> list[np.ndarray]:
        for patch in axes.patches:
            np.testing.assert_allclose(patch.get_data().edges, edges)  # type: ignore[attr-defined]
        return [np.asarray(patch.get_data().values) for patch in axes.patches]  # type: ignore[attr-defined]

    np.testing.assert_array_equal(curves(shares), [made.sun_visible, made.sun_in_view])
    words = [str(patch.get_label()) for patch in shares.patches]
    assert ("Earth" in words[0], "pixel" in words[1]) == (True, True)
    np.testing.assert_array_equal(curves(lit), [track.lit for track in made.tracks[:5]])
    *own, brightest = curves(charge)
    expected = [
        [np.nan if number == 0 else 0.5 + number, *(np.arange(20.0, 60.0, 10.0) + number)]
        for number in range(5)
    ]
    np.testing.assert_array_equal(own, expected[:targets])
    np.testing.assert_array_equal(brightest, [np.nan, 200.0, 300.0, 4000.0, 500.0])
    assert list(line(charge, 0)[:, 1]) == [3e3, 3e3]
    assert charge.get_yscale() == "log"
    assert charge.get_ylim() == (10.0, 20.0 * 4000.0)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["sunny", "shady", "dark"]
    shown = [to_hex(patch.get_facecolor()) for patch in legend.get_patches()]
    assert shown == list(timeline.CONDITION_COLOURS[:3])
    about = figure.texts[1].get_text()
    assert about.startswith("period 8.3 min  ·  5 moments  ·  eclipse 55.0 % of the time")


def poses(arrays: list[tuple[str, float]], ranges: list[float]) -> list[Any]:
    """Return rows of a study of poses; each number tells its array, its range, its method and its component."""
    return [
        SimpleNamespace(
            array=array, size_m=size, targets=3 + place, range_m=away, mode=mode, component=component,
            simulated=value, low=0.7 * value, high=1.4 * value, analytic=1.1 * value,
        )
        for place, (array, size) in enumerate(arrays) for away in ranges for column, mode in enumerate(pose_study.MODES)
        for turn, component in enumerate(COMPONENTS)
        for value in ((1.0 + place) * (1.0 + 0.1 * column) * (1.0 + 0.01 * turn) * 1e-4 * away,)
    ]  # fmt: skip


def test_figure_15_is_drawn_by_component_and_method(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the base array of its own size alone, a panel for each component in their order; marks with bars from low
    to high, lines of closed forms, in mm and mrad; plain ticks of range."""
    figure = figure_of(monkeypatch, pose_study)
    ranges = [3.0, 9.0, 25.0]
    rows = poses([("b", 1.0), ("b", 2.0), ("c", 1.0)], ranges)
    study: Any = SimpleNamespace(rows=rows, base="b", base_size=1.0)
    pose_study.draw_figure_15(study, "")
    assert len(figure.axes) == 6
    for turn, axes in enumerate(figure.axes):
        assert axes.get_ylabel() == ("error [mm]" if turn < 3 else "error [mrad]")
        assert axes.get_title(loc="left") == pose_study._TITLES[COMPONENTS[turn]]
        for column, (name, marks, ends) in enumerate(bars(axes)):
            y = 0.1 * (1.0 + 0.1 * column) * (1.0 + 0.01 * turn) * np.array(ranges)
            assert name == list(pose_study.MODES.values())[column][0]
            np.testing.assert_allclose(marks, np.stack([ranges, y], axis=1))
            np.testing.assert_allclose(ends, y[:, None] * [0.7, 1.4])
            np.testing.assert_allclose(line(axes, 4 * column), np.stack([ranges, 1.1 * y], axis=1))
        assert len(bars(axes)) == 5
        ticks = [5, 7, 10, 14, 20]
        assert [tick for tick in axes.get_xticks() if 3.0 < tick < 25.0] == ticks
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert [axes.get_xlabel() for axes in figure.axes] == [*3 * [""], *3 * ["range [m]"]]


def test_figure_15_of_targets_that_are_never_found_is_drawn(tmp_path: Path) -> None:
    """Claim: without an error that is known the panels have their axes, in decades."""
    rows = poses([("b", 1.0)], [3.0, 9.0])
    for row in rows:
        row.simulated = row.low = row.high = row.analytic = np.nan
    study: Any = SimpleNamespace(rows=rows, base="b", base_size=1.0)
    pose_study.draw_figure_15(study, tmp_path / "none.png")
    assert (tmp_path / "none.png").stat().st_size > 1000


def test_methods_that_were_not_studied_are_not_in_the_legends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of an instrument that triangulates alone the pictures name the three methods that it has."""
    rows = [row for row in poses([("b", 1.0)], [3.0, 9.0]) if "tof" not in row.mode]
    study: Any = SimpleNamespace(rows=rows, base="b", base_size=1.0)
    for draw in (pose_study.draw_figure_15, pose_study.draw_arrays):
        figure = figure_of(monkeypatch, pose_study)
        draw(study, "")
        (legend,) = figure.legends
        named = [text.get_text() for text in legend.get_texts()]
        assert named == [name for (_, way), (name, *_) in pose_study.MODES.items() if way != "tof"]


def test_arrays_are_drawn_at_the_range_nearest_to_ten_metres(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: nearest by ratio: of 4, 7 and 15 m it is 7 m; an array a row, from above; errors by closed form and by
    simulation of three shifts and tilts and of the roll."""
    figure = figure_of(monkeypatch, pose_study)
    rows = poses([("b", 1.0), ("b", 2.5), ("c", 1.0)], [4.0, 15.0, 7.0])
    pose_study.draw_arrays(SimpleNamespace(rows=rows), "")  # type: ignore[arg-type]
    shown = [0, 2, 4, 5]
    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        pose_study._TITLES[COMPONENTS[turn]] for turn in shown
    ]
    for turn, axes in zip(shown, figure.axes, strict=True):
        assert axes.get_xlabel() == ("error [mm]" if turn < 3 else "error [mrad]")
        for column in range(5):
            x = 0.7 * (1.0 + 0.1 * column) * (1.0 + 0.01 * turn) * np.array([1.0, 2.0, 3.0])
            np.testing.assert_allclose(line(axes, 2 * column), np.stack([1.1 * x, [0, 1, 2]], axis=1))
            np.testing.assert_allclose(line(axes, 2 * column + 1), np.stack([x, [0, 1, 2]], axis=1))
    names = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert names == ["b, 1 m (3)", "b, 2.5 m (4)", "c, 1 m (5)"]
    low, high = figure.axes[0].get_ylim()
    assert low > high
    assert figure.get_suptitle().startswith("Arrays at 7 m")


@pytest.mark.parametrize(("span", "shown"), [(59.0, [1, 2, 5, 10, 20, 50]), (61.0, [1, 10])])
def test_decades_have_more_ticks_where_there_are_few(span: float, shown: list[int]) -> None:
    axes = Figure().add_subplot()
    axes.set(yscale="log", ylim=(1.0, span))
    pose_study._plain_ticks(axes.yaxis, axes.get_ylim())
    ticks = [tick for tick in axes.yaxis.get_major_locator()() if 1.0 <= tick <= span]
    np.testing.assert_allclose(ticks, shown)


EPOCHS = (8.0, 2.0, 4.0)
"""Ranges of an approach [m], not in their order."""


def approached() -> Any:
    """Return an approach under two lights by two methods, whose numbers tell epoch, method and component."""
    methods = {"uv": "angles", "joint": "both"}
    epochs = [
        SimpleNamespace(orbit=light, range_m=away * (1.0 + 9.0 * light), condition=condition)
        for light in (0, 1) for away, condition in zip(EPOCHS, (1, -1, 2), strict=True)
    ]  # fmt: skip
    rows = [
        SimpleNamespace(
            orbit=light, method=name, component=component, range_m=away, error=error, error_low=0.8 * error,
            error_high=1.3 * error, sigma=0.9 * error, availability=0.1 * away, availability_low=0.06 * away,
            availability_high=0.12 * away,
        )
        for light in (0, 1) for column, name in enumerate(methods) for turn, component in enumerate(COMPONENTS)
        for away in EPOCHS for error in (1e-3 * away * (1.0 + column) * (1.0 + 0.1 * turn) * (1.0 + light),)
    ]  # fmt: skip
    conditions = [
        SimpleNamespace(
            method=name, condition=condition, tries=tries, epochs=epochs_of, availability=0.5 + 0.1 * column,
            availability_low=0.3, availability_high=0.95, position_m=2e-3 * (1 + condition),
            position_sigma_m=1e-3 * (1 + condition), attitude_rad=0.02, attitude_sigma_rad=0.03 * (1 + column),
        )
        for column, name in enumerate(methods) for condition, tries, epochs_of in ((0, 7, 1), (1, 5, 3), (2, 0, 0))
    ]  # fmt: skip
    labels = [Label(name, "") for name in ("sunny", "shady in the cold", "dark")]
    return SimpleNamespace(
        name="way", methods=methods, labels=labels, epochs=epochs, rows=rows, conditions=conditions, orbits=2
    )


def test_an_approach_is_drawn_over_range(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of one light; a panel for each component with rms errors, their bars and the stated σ, mm and thousandths
    of a degree; marks aside by 1 % between methods; below them the light at each epoch and the share with a pose."""
    figure = figure_of(monkeypatch, approach)
    approach.draw_approach(approached(), "", orbit=0)
    *panels, band, share = figure.axes
    away = np.sort(EPOCHS)
    for turn, axes in enumerate(panels):
        unit = 1.0 if turn < 3 else 180.0 / np.pi
        assert axes.get_title(loc="left") == approach._TITLES[turn]
        assert axes.get_ylabel() == ("error [mm]" if turn < 3 else "error [m°]")
        for column, (_, marks, ends) in enumerate(bars(axes)):
            y = unit * away * (1.0 + column) * (1.0 + 0.1 * turn)
            np.testing.assert_allclose(marks, np.stack([away * (0.995 + 0.01 * column), y], axis=1))
            np.testing.assert_allclose(ends, y[:, None] * [0.8, 1.3])
            np.testing.assert_allclose(line(axes, 4 * column), np.stack([away, 0.9 * y], axis=1))
            strokes: Any = axes.collections[2 * column]
            for stroke, x, level in zip(strokes.get_segments(), away, 0.9 * y, strict=True):
                np.testing.assert_allclose(stroke[:, 1], level)
                assert stroke[0, 0] * stroke[1, 0] == pytest.approx(x**2)
                assert stroke[0, 0] < x
        assert len(bars(axes)) == 2
        assert axes.get_xlim() == pytest.approx((0.98 * np.sqrt(2.0), 1.02 * 8.0 * np.sqrt(2.0)))
    ends = np.sqrt(2.0) * np.array([1.0, 2.0, 4.0, 8.0])
    patches: list[Any] = list(band.patches)
    np.testing.assert_allclose([patch.get_x() for patch in patches], ends[:-1])
    np.testing.assert_allclose([patch.get_x() + patch.get_width() for patch in patches], ends[1:])
    colours = [approach._UNSEEN, *(timeline.CONDITION_COLOURS[number] for number in (2, 1))]
    assert [to_hex(patch.get_facecolor()) for patch in patches] == colours
    for column, (_, marks, ends) in enumerate(bars(share)):
        np.testing.assert_allclose(marks, np.stack([away * (0.995 + 0.01 * column), 0.1 * away], axis=1))
        np.testing.assert_allclose(ends, away[:, None] * [0.06, 0.12])
    assert share.get_ylim() == (-0.05, 1.05)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["angles", "both", "shady in the cold", "dark"]
    assert figure.get_suptitle() == "Pose on the way: way, light 1 of 2"


def test_a_single_epoch_has_a_band_of_a_tenth_to_each_side() -> None:
    np.testing.assert_allclose(approach._ends(np.array([5.0])), [4.5, 5.5])


def test_conditions_are_drawn_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a place for each condition, methods 0.11 apart about it; the share with its interval; errors of place [mm]
    and attitude [thousandths of a degree] beside their σ; nothing where there was no try, and how many epochs."""
    figure = figure_of(monkeypatch, approach)
    approach.draw_conditions(approached(), "")
    share, place, attitude = figure.axes
    for column, (_, marks, ends) in enumerate(bars(share)):
        x = np.arange(2.0) + 0.11 * (column - 0.5)
        np.testing.assert_allclose(marks, np.stack([x, np.full(2, 0.5 + 0.1 * column)], axis=1))
        np.testing.assert_allclose(ends, [[0.3, 0.95]] * 2)
        tilt = 1e3 * np.degrees([0.02, 0.02])
        stated = 1e3 * np.degrees([0.03, 0.03]) * (1 + column)
        for axes, y, sigma in ((place, [2.0, 4.0], [1.0, 2.0]), (attitude, tilt, stated)):
            np.testing.assert_allclose(line(axes, column), np.stack([x, y], axis=1))
            strokes: Any = axes.collections[column]
            for stroke, middle, level in zip(strokes.get_segments(), x, sigma, strict=True):
                np.testing.assert_allclose(stroke[:, 1], level)
                assert stroke[:, 0].mean() == pytest.approx(middle)
    words = [label.get_text() for label in attitude.get_xticklabels()]
    assert words == ["sunny\n1 epoch", "shady\nin the cold\n3 epochs", "dark\ndid not occur"]
    assert attitude.get_xlim() == (-0.5, 2.5)
    walls = [
        line(share, number)[0, 0]
        for number in range(len(share.lines))
        if len(set(line(share, number)[:, 0])) == 1
    ]
    assert {0.5, 1.5} <= set(walls)


def test_conditions_without_any_pose_are_drawn(tmp_path: Path) -> None:
    """Claim: where no try of any method gives a pose there are shares to be seen, and errors in decades without one."""
    study = approached()
    for row in study.conditions:
        for name in ("position_m", "position_sigma_m", "attitude_rad", "attitude_sigma_rad"):
            setattr(row, name, np.nan)
    approach.draw_conditions(study, tmp_path / "none.png")
    assert (tmp_path / "none.png").stat().st_size > 1000


def test_a_budget_of_ranges_that_nothing_tells_is_drawn(tmp_path: Path) -> None:
    """Claim: without a σ that is known the curves have their axes, in decades."""
    row: Any = {"mode": "tof", "source": "all", "range_m": 5.0, "freedom": 3}
    row |= dict.fromkeys(("analytic_m", "simulated_m", "low_m", "high_m"), np.nan)
    budget.draw_curves([BudgetRow(**row)], 0.25, tmp_path / "none.png")
    assert (tmp_path / "none.png").stat().st_size > 1000


@pytest.mark.parametrize("analytic", [True, False])
def test_where_curves_cross_is_marked(monkeypatch: pytest.MonkeyPatch, analytic: bool) -> None:
    """Claim: σ by R² of one way and by R of the other meet where both laws are equal, at 4 m by closed forms and at 5 m
    simulated, which is marked where closed forms are not known; both ways and their combination, in mm."""
    figure = figure_of(monkeypatch, budget)
    ranges = np.array([1.0, 2.0, 8.0, 30.0])
    rows: Any = [
        SimpleNamespace(mode=mode, source=source, range_m=x, simulated_m=y, low_m=0.9 * y, high_m=1.2 * y,
                        analytic_m=z if analytic else np.nan)
        for mode, simulated, closed in (
            ("triangulation", lambda x: 1e-4 * x**2, lambda x: 1e-4 * x**2),
            ("tof", lambda x: 5e-4 * x, lambda x: 4e-4 * x),
            ("fused", lambda x: 3e-5 * x, lambda x: 2e-5 * x))
        for source in ("all", "shot") for x in ranges for y, z in ((simulated(x), closed(x)),)
    ]  # fmt: skip
    budget.draw_curves(rows, 0.25, "", light="sunlit")
    (axes,) = figure.axes
    found = {name: (marks, ends) for name, marks, ends in bars(axes)}
    laws = {"triangulation": 0.1 * ranges**2, "tof": 0.5 * ranges, "fused": 0.03 * ranges}
    assert list(found) == [label for _, label in budget.CURVES.values()]
    for mode, (_, label) in budget.CURVES.items():
        marks, ends = found[label]
        np.testing.assert_allclose(marks, np.stack([ranges, laws[mode]], axis=1))
        np.testing.assert_allclose(ends, laws[mode][:, None] * [0.9, 1.2])
    meeting = 4.0 if analytic else 5.0
    np.testing.assert_allclose(line(axes, -1)[:, 0], meeting)
    words = [text.get_text() for text in axes.texts]
    assert f" equal at {meeting:g} m" in words
    assert any(text.startswith("facing target of reflectance 0.25, sunlit") for text in words)


@pytest.mark.parametrize(("mode", "words"), [("triangulation", "triangulation"), ("tof", "time of flight")])
def test_sources_of_an_image_are_coloured_by_the_largest(
    monkeypatch: pytest.MonkeyPatch, mode: Mode, words: str
) -> None:
    """Claim: each voxel has the colour of its largest source, grey without a range; the image from edge to edge in
    degrees, φ downwards; shares in per cent, the largest first; the heading names the way of ranging."""
    figure = figure_of(monkeypatch, budget)
    sources = ("shot", "read", "speckle")
    variances = np.array(
        [[[1, 1, 1], [9, 5, np.nan]], [[0, 2, 2], [1, 1, np.nan]], [[0, 0, 0], [1, 1, np.nan]]], float
    )
    theta, phi = np.radians([-3.0, -1.0, 1.0]), np.radians([4.0, 7.0])
    budget.draw_dominance(budget.Dominance(sources, variances, theta, phi, mode), "")
    (axes,) = figure.axes
    assert axes.get_title(loc="left").endswith(f": {words}")
    (image,) = axes.images
    colours = [["shot", "read", "read"], ["shot", "shot", None]]
    expected = [
        [to_rgba(budget._NOWHERE if name is None else budget.COLOURS[name])[:3] for name in row]
        for row in colours
    ]
    np.testing.assert_allclose(image.get_array(), expected)
    np.testing.assert_allclose(image.get_extent(), [-4.0, 2.0, 8.5, 2.5])
    legend = axes.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["shot 60 %", "read 40 %", "no range"]
    shown = [to_hex(patch.get_facecolor()) for patch in legend.get_patches()]
    assert shown == [
        to_hex(colour) for colour in (budget.COLOURS["shot"], budget.COLOURS["read"], budget._NOWHERE)
    ]


def test_errors_over_a_pixel_are_drawn_in_thousandths(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of ten passages the first, the last and two evenly between; above what an estimator errs, below what a
    table leaves."""
    figure = figure_of(monkeypatch, bias)
    phase = np.array([-0.4, 0.1, 0.3])
    curves = [bias.BiasCurve(f"w{n}", phase, 1e-3 * (phase + n), 2e-3 * (phase - n)) for n in range(10)]
    bias.draw_bias("a_b", curves, "")
    upper, lower = figure.axes
    assert [str(one.get_label()) for one in upper.lines[:4]] == ["w0", "w3", "w6", "w9"]
    for place, number in enumerate((0, 3, 6, 9)):
        np.testing.assert_allclose(line(upper, place), np.stack([phase, phase + number], axis=1))
        np.testing.assert_allclose(line(lower, place), np.stack([phase, 2.0 * (phase - number)], axis=1))
    assert upper.get_title(loc="left").endswith("a b")
