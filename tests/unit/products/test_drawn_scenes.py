"""What pictures of scenes, comparisons and heads draw: where things stand, to scale, and what is found."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from drawn import figure_of, line
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from scanner_sim.products.comparison import Check, Comparison, Finding
from scanner_sim.products.pictures import comparison, instrument, scene
from scanner_sim.products.scene_view import Field, SceneView, ViewedObject


@pytest.fixture
def axes() -> Axes:
    return Figure().add_subplot()


def view(count: int = 2, far: float = math.inf) -> SceneView:
    """Return a picture of 80 rows and 200 columns; the first thing is 10 × 100 dots large, the second 6 × 4."""
    number = np.zeros((80, 200), dtype=np.int64)
    number[20:30, 40:140], number[50:56, 150:154] = 1, 2
    things = [
        ViewedObject(f"u{n}", "box", (), 9, np.array([[0.0, 1.0, 4.0 + n], [2.0, 3.5, 5.0 + n]]), 0.1, False)
        for n in range(count)
    ]
    field = Field((-0.2, 0.3), (-0.1, 0.15), 1.5, far)
    window = ((-0.25, 0.35), (-0.12, 0.17))
    return SceneView(tuple(things), field, window, number, np.full((80, 200), 0.5), np.ones((80, 200)))


def test_a_scene_is_drawn_as_it_is_seen(axes: Axes) -> None:
    """Claim: each thing in its colour, by 0.35 and 0.65 of the cosine, white beside them; from edge to edge of the
    window in degrees; the scan's frame; names in the middle of things that are wide enough, else above them."""
    shown = view()
    colours = scene._colours(2)
    scene._draw_seen(axes, shown, colours)
    (image,) = axes.images
    picture = np.asarray(image.get_array())
    assert image.get_extent() == pytest.approx(np.degrees([-0.25, 0.35, 0.17, -0.12]).tolist())
    for place, colour in (((25, 60), colours[0]), ((52, 151), colours[1])):
        np.testing.assert_allclose(picture[place], (0.35 + 0.65 * 0.5) * np.array(colour))
    np.testing.assert_allclose(picture[0, 0], 1.0)
    frame = np.radians(line(axes, 0))
    assert {tuple(np.round(corner, 6)) for corner in frame} == {
        (x, y) for x in (-0.2, 0.3) for y in (-0.1, 0.15)
    }
    names = {text.get_text(): np.radians(text.get_position()) for text in axes.texts[1:]}
    across, down = 0.6 / 200.0, 0.29 / 80.0
    # Next to the middle of 40 to 139 and of 20 to 29 is 89 or 90, 24 or 25.
    assert names["u0"] == pytest.approx([-0.25 + 90.0 * across, -0.12 + 25.0 * down], abs=0.51 * down)
    assert names["u1"] == pytest.approx([-0.25 + 152.0 * across, -0.12 + 50.0 * down], abs=0.51 * across)
    crowded = Figure().add_subplot()
    scene._draw_seen(crowded, view(count=26), scene._colours(26))
    assert len(crowded.texts) == 1


@pytest.mark.parametrize("axis", [0, 1])
def test_a_plan_is_drawn_to_scale(axes: Axes, axis: int) -> None:
    """Claim: z against x from above, against y from the side, what is nearer to the eye over what is behind it; rays of
    the field, and its nearest range; drawn to 1.1 of the farthest thing."""
    shown = view()
    # The first lies higher and farther left than the second.
    moved = replace(shown.objects[0], points=shown.objects[0].points - [9.0, 9.0, 0.0])
    shown = replace(shown, objects=(moved, shown.objects[1]))
    scene._draw_plan(axes, shown, scene._colours(2), axis, "label")
    order = [shown.objects[number].points for number in ((1, 0) if axis == 0 else (0, 1))]
    for number, points in enumerate(order):
        np.testing.assert_allclose(line(axes, number), points[:, [2, axis]])
    ends = (shown.field.horizontal, shown.field.vertical)[axis]
    reach = 1.1 * 6.0
    for number, angle in enumerate(ends, 2):
        np.testing.assert_allclose(
            line(axes, number), [[0.0, 0.0], [reach * math.cos(angle), reach * math.sin(angle)]]
        )
    near = line(axes, 4)
    np.testing.assert_allclose(np.hypot(*near.T), 1.5)
    np.testing.assert_allclose(np.arctan2(near[[0, -1], 1], near[[0, -1], 0]), ends)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("z [m], away from the scanner", "label")
    assert axes.get_aspect() == 1.0


@pytest.mark.parametrize(
    ("far", "words"), [(math.inf, "on to infinity"), (9.5, "on to 9.5 m"), (6.0, "farthest 6 m")]
)
def test_the_far_end_of_the_field_is_drawn_or_told(axes: Axes, far: float, words: str) -> None:
    scene._draw_field(axes, view(far=far).field, 6.6, (-0.2, 0.3))
    assert [text.get_text() for text in axes.texts] == ["nearest 1.5 m", words]
    assert len(axes.lines) == (4 if far < 6.6 else 3)
    if far < 6.6:
        np.testing.assert_allclose(np.hypot(*line(axes, 3).T), far)


def test_sizes_are_listed_of_the_nearest_things() -> None:
    """Claim: twelve at most, those whose points are nearest, in the order of the scene; how many are left out."""
    shown = view(count=14)
    asked: list[Any] = []
    figure: Any = SimpleNamespace(legend=lambda marks, texts, **_: asked.append((marks, texts)))
    turned = replace(shown, objects=shown.objects[::-1])
    scene._list_sizes(figure, turned, scene._colours(14))
    ((marks, texts),) = asked
    names = [f"u{n}" for n in range(11, -1, -1)]
    assert [text.split(":")[0] for text in texts[:-1]] == names
    away = turned.objects[-1].distance
    assert texts[-2] == f"u0: 2 × 2.5 × 1 m (x, y, z), {away:.3g} m away"
    assert texts[-1] == "and 2 that are farther away"
    colours = [to_hex(mark.get_color()) for mark in marks[:-1]]
    assert colours == [to_hex(colour) for colour in scene._colours(14)[2:]]


@pytest.mark.parametrize(("count", "reach"), [(2, 6.6), (0, 3.0)])
def test_a_plan_reaches_behind_its_things(count: int, reach: float) -> None:
    """Claim: 1.1 of the farthest point, but twice the nearest range at least."""
    assert scene._reach(view(count)) == pytest.approx(reach)


CHECK = Check(
    case="8 m", quantity="σ", unit="mm", form="mean", predicted=8.0, accuracy=0.04, simulated=8.1, error=1e-3,
    freedom=20.0, low=8.05, high=8.2, effect=0.0125, scale=4.0, relative_to="prediction", p=0.3, adjusted_p=0.6,
    detects_90=0.05, detects_99=0.07, broken=False,
)  # fmt: skip


def finding(name: str, *checks: Check) -> Finding:
    return Finding(name, f"title of {name}", "s", "st", "wall", "" if checks else "why", checks)


def test_checks_are_drawn_over_what_would_have_been_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: one is the deviation that is found in nine of ten runs, here 0.05 of a scale of 4, 0.2 mm; no farther than
    two; laws from above, their checks side by side within half of a line; broken ones in their colour."""
    figure = figure_of(monkeypatch, comparison)
    far = replace(CHECK, simulated=9.0, low=8.9, high=9.1, broken=True)
    exact = replace(CHECK, detects_90=0.0, broken=True)
    made = Comparison(
        seed=1, seeds=1, level=0.02, quick=False, target="wall", versions={},
        findings=(finding("u", CHECK, far), finding("none"), finding("v", exact)),
    )  # fmt: skip
    comparison.draw_comparison(made, "")
    (axes,) = figure.axes
    bars = [one for one in axes.lines if one.get_marker() in ("None", None, "")][1:]
    dots = [one for one in axes.lines if one.get_marker() == "o"]
    np.testing.assert_allclose(
        [dot.get_xydata()[0] for dot in dots], [[0.5, -0.125], [2.0, 0.125], [2.0, 1.0]]
    )
    np.testing.assert_allclose(bars[0].get_xydata(), [[0.25, -0.125], [1.0, -0.125]])
    assert [dot.get_color() for dot in dots] == [comparison.HOLDS, comparison.BROKEN, comparison.BROKEN]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["title of u", "title of v"]
    assert axes.get_ylim() == (1.6, -0.6)
    assert axes.get_title(loc="left") == "Simulation against closed forms: 2 broken"
    assert axes.texts[0].get_text().startswith("2 laws, 3 checks, family-wise level 0.02")


def test_laws_that_do_not_judge_an_own_estimator_are_grey(monkeypatch: pytest.MonkeyPatch) -> None:
    figure = figure_of(monkeypatch, comparison)
    made = Comparison(
        seed=1, seeds=1, level=0.02, quick=False, target="wall", versions={}, own={"peak": "mine"},
        findings=(finding("u", CHECK), replace(finding("v", CHECK), exercises="peak")),
    )  # fmt: skip
    comparison.draw_comparison(made, "")
    (axes,) = figure.axes
    colours = [one.get_color() for one in axes.lines if one.get_marker() == "o"]
    assert colours == [comparison._OTHERS, comparison.HOLDS]
    assert axes.get_xlabel().endswith("grey: laws that say nothing about mine")


@pytest.mark.parametrize(("scale", "times", "factor"), [(4.0, 100.0, 25.0), (0.0, 100.0, 100.0)])
def test_a_check_is_drawn_over_its_scale(axes: Axes, scale: float, times: float, factor: float) -> None:
    """Claim: in per cent of its scale, where there is one: light what would be found, dark how far the closed form may
    be off, both to either side; the interval and the deviation."""
    comparison._draw_check(axes, 3, replace(CHECK, scale=scale), times)
    found, dark = (patch.get_bbox() for patch in axes.patches)  # type: ignore[attr-defined]
    assert (found.x0, found.x1) == pytest.approx((-5.0, 5.0))
    assert (dark.x0, dark.x1) == pytest.approx((-0.04 * factor, 0.04 * factor))
    assert 0.5 * (found.y0 + found.y1) == 3.0
    np.testing.assert_allclose(line(axes, 0), [[0.05 * factor, 3.0], [0.2 * factor, 3.0]])
    np.testing.assert_allclose(line(axes, 1), [[0.1 * factor, 3.0]])


def test_numbers_over_range_are_drawn_beside_their_predictions(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: where three or more cases are ranges alone; simulated ones with their ends, the line of predictions."""
    figure = figure_of(monkeypatch, comparison)
    monkeypatch.setattr(comparison, "png_address", lambda _: "png")
    checks = [
        replace(CHECK, case=f"{R} m", predicted=2.0 * R, simulated=2.1 * R, low=1.9 * R, high=2.3 * R)
        for R in (2.0, 5.0, 12.0)
    ]
    others = [
        replace(CHECK, case="8 m, Θ +0.1"),
        replace(CHECK, case="slope"),
        replace(CHECK, case="9 m", predicted=0.0),
    ]
    assert comparison.finding_picture(finding("u", *checks, *others)) == "png"
    left, right = figure.axes
    np.testing.assert_allclose(line(left, 0), [[2.0, 4.0], [5.0, 10.0], [12.0, 24.0]])
    for number, R in enumerate((2.0, 5.0, 12.0)):
        np.testing.assert_allclose(line(left, 1 + 2 * number), [[R, 1.9 * R], [R, 2.3 * R]])
        np.testing.assert_allclose(line(left, 2 + 2 * number), [[R, 2.1 * R]])
    assert left.get_ylabel() == "σ [mm]"
    assert [tick for tick in left.get_xticks() if 2.0 <= tick <= 12.0] == [2, 3, 5, 10]
    assert [label.get_text() for label in right.get_yticklabels()] == [one.case for one in (*checks, *others)]
    assert right.get_ylim() == (5.6, -0.6)
    assert comparison._ranged(finding("u", *checks[:2], *others)) == []


@pytest.mark.parametrize(
    ("effect", "found", "unit"),
    [(9e-5, 9e-5, ("millionths", 1e6)), (-1.1e-4, 9e-5, ("%", 100.0)), (9e-5, 1.1e-4, ("%", 100.0))],
)
def test_tiny_deviations_are_drawn_in_millionths(
    effect: float, found: float, unit: tuple[str, float]
) -> None:
    tiny = replace(CHECK, effect=1e-9, detects_90=1e-9)
    assert comparison._unit(finding("u", tiny, replace(CHECK, effect=effect, detects_90=found))) == unit


@pytest.mark.parametrize(
    ("relative", "words"),
    [
        (("prediction",), "relative deviation [%]"),
        (("prediction", "one"), "relative deviation [%]; of exponents and shares: the deviation itself"),
        (("range", "pixel"), "deviation over the pixel or range [%]"),
    ],
)
def test_an_axis_says_what_deviations_are_over(relative: tuple[str, ...], words: str) -> None:
    assert (
        comparison._axis(finding("u", *(replace(CHECK, relative_to=one) for one in relative)), "%") == words
    )


def head(**more: Any) -> Any:
    told: dict[str, Any] = {
        "focal_length": 0.1, "aperture": 0.04, "diode_field": 0.06, "spot_m": np.array([0.01, 0.5]), "baseline": 0.2,
        "theta": np.linspace(-0.3, 0.3, 7), "half_field": 0.3, "range_m": np.array([1.0, 20.0]), "line": None,
        "depth": (2.0, 15.0),
    }  # fmt: skip
    return SimpleNamespace(**told | more)


@pytest.mark.parametrize("field", [0.06, None])
def test_a_coaxial_head_is_drawn_to_scale(axes: Axes, field: float | None) -> None:
    """Claim: in mm, rays of infinity from the rim of the lens of 40 mm to its focus 100 mm behind it, the diode as wide
    as its field there, and the edges of the field through the middle of the lens; the beam as wide as at first."""
    instrument._draw_coaxial_head(axes, head(diode_field=field))
    angle = 0.0 if field is None else 0.03
    edge = 100.0 * math.tan(angle)
    _, ray, dashed, other, _, lens, diode = (line(axes, number) for number in range(7))
    np.testing.assert_allclose(ray, [[-20.0, 120.0], [-20.0, 0.0], [0.0, -100.0]])
    np.testing.assert_allclose(other[:, 0], [20.0, 20.0, 0.0])
    np.testing.assert_allclose(dashed, [[-120.0 * math.tan(angle), 120.0], [edge, -100.0]])
    np.testing.assert_allclose(lens, [[-20.0, 0.0], [20.0, 0.0]])
    np.testing.assert_allclose(diode, [[-edge, -100.0], [edge, -100.0]], atol=1e-12)
    beam: Any = axes.collections[0]
    corners = beam.get_paths()[0].vertices
    assert (corners[:, 0].min(), corners[:, 0].max()) == (-5.0, 5.0)
    assert (corners[:, 1].min(), corners[:, 1].max()) == (-60.0, 120.0)
    assert f"{2e3 * angle:.3g} mrad" in axes.texts[-1].get_text()


@pytest.mark.parametrize(("lined", "far"), [(True, math.inf), (False, 15.0)])
def test_what_is_seen_is_drawn_over_the_field(axes: Axes, lined: bool, far: float) -> None:
    """Claim: nearest and farthest ranges at each deflection, by the array or at even depths, no farther than the last
    range; the edges of the field; told on the axis."""
    theta = np.linspace(-0.3, 0.3, 7)
    seen = SimpleNamespace(nearest=1.0 + 0.1 * theta, farthest=np.full(7, math.inf)) if lined else None
    instrument._draw_field(axes, head(line=seen, depth=(2.0, far)))
    near = 1.0 + 0.1 * theta if lined else np.full(7, 2.0)
    end = np.full(7, 20.0 if lined else 15.0)
    np.testing.assert_allclose(line(axes, 0), np.stack([near * np.sin(theta), near * np.cos(theta)], axis=1))
    np.testing.assert_allclose(line(axes, 1), np.stack([end * np.sin(theta), end * np.cos(theta)], axis=1))
    for number, side in ((2, -1.0), (3, 1.0)):
        np.testing.assert_allclose(line(axes, number)[1], [20.0 * side * math.sin(0.3), 20.0 * math.cos(0.3)])
    labels = [str(one.get_label()) for one in axes.lines[:2]]
    assert labels[0] == "nearest: 2 m on the axis"
    assert labels[1] == ("farthest: infinity; drawn to 20 m" if lined else "farthest: 15 m on the axis")
    assert f"±{math.degrees(0.3):.3g}°" in axes.texts[-1].get_text()
