"""What the report of an acceptance test says, and what its pictures show."""

from __future__ import annotations

import html
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from drawn import figure_of, line
from html_cells import cells
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scanner_sim.acceptance import pictures, report
from scanner_sim.acceptance.plan import Ball, LengthBar
from scanner_sim.acceptance.verdicts import COVERAGE, Verdict
from scanner_sim.config import load_scanner
from scanner_sim.foundation.html_text import png_address


@pytest.fixture
def axes() -> Axes:
    return Figure().add_subplot()


def result(artefact: str, repetition: int, **more: Any) -> Any:
    told: dict[str, Any] = {
        "quantity": "length", "artefact": artefact, "repetition": repetition, "measured": 1.01, "reference": 1.02,
        "error": -0.01, "sigma": 0.003, "sigma_noise": 0.004, "sigma_common": 0.005, "expected": 0.006, "limit": 0.02,
        "uncertainty": 0.005, "verdict": Verdict.PASSES,
    }  # fmt: skip
    return SimpleNamespace(**told | more)


def test_a_report_holds_every_number_once() -> None:
    """Claim: in SI, each under its name; null where there is none; of each fit the points that are valid and those that
    are used; the worst of each quantity and artefact with its own verdict."""
    scanner = load_scanner("nrc_2000")
    tests = [result("bar", 0, error=0.015), result("ball", 1, quantity="form", error=0.001)]
    found: Any = SimpleNamespace(
        setup=SimpleNamespace(
            base=SimpleNamespace(scanner=scanner), rangefinder="tof",
            plan=SimpleNamespace(seed=17, rule="simple", discarded=0.003),
        ),
        verdict=Verdict.UNDECIDED, tests=tests, verdict_of=lambda one: f"of {one.artefact}",
        results=[result("bar", 0), result("ball", 3, sigma_noise=math.nan)],
        fits={"bar/1": SimpleNamespace(points=np.zeros((7, 3)), used=np.arange(7) < 5)},
    )  # fmt: skip
    made = report.report(found)
    assert made["tests"] == [
        {
            "quantity": "length",
            "artefact": "bar",
            "verdict": "of bar",
            "largest_error_m": 0.015,
            "limit_m": 0.02,
        },
        {
            "quantity": "form",
            "artefact": "ball",
            "verdict": "of ball",
            "largest_error_m": 0.001,
            "limit_m": 0.02,
        },
    ]
    numbers = {
        "measured_m": 1.01, "reference_m": 1.02, "error_m": -0.01, "sigma_m": 0.003, "sigma_noise_m": 0.004,
        "sigma_common_m": 0.005, "expected_by_noise_m": 0.006, "limit_m": 0.02, "uncertainty_m": 0.005,
    }  # fmt: skip
    words = {"quantity": "length", "verdict": str(Verdict.PASSES)}
    assert made["results"] == [
        words | {"artefact": "bar", "repetition": 0} | numbers,
        words | {"artefact": "ball", "repetition": 3} | numbers | {"sigma_noise_m": None},
    ]
    assert made["points"] == {"bar/1": {"valid": 7, "used": 5}}
    assert (made["seed"], made["ranging"], made["discarded_share"]) == (17, "tof", 0.003)
    assert (made["coverage_factor"], made["verdict"]) == (COVERAGE, str(Verdict.UNDECIDED))
    assert "left out of account" in str(made["rule"])
    assert made["remarks"] == []


@pytest.mark.parametrize("rule", ["guarded", "simple"])
def test_the_page_says_what_was_tested_and_by_which_rule(rule: str) -> None:
    """Claim: verdict, rangefinder, seed, repetitions and the plan's rule, and no other one; the worst of each test with
    its verdict, and all repetitions with theirs; pictures under their captions, and the plan as it was read."""
    results = [result("bar", 0, error=0.0125), result("bar", 1, verdict=Verdict.FAILS, uncertainty=0.006)]
    found: Any = SimpleNamespace(
        setup=SimpleNamespace(rangefinder="tof", plan=SimpleNamespace(seed=17, rule=rule, repetitions=23)),
        verdict=Verdict.UNDECIDED, tests=results[:1], verdict_of=lambda _: Verdict.UNDECIDED, results=results,
    )  # fmt: skip
    plan = "rule: <mine> & 'yours'"
    page = report.page(found, plan, {name: name.encode() for name in report.CAPTIONS})
    text = html.unescape(page)
    assert [words in text for words in report.RULES.values()] == [name == rule for name in report.RULES]
    verdict = report.title(Verdict.UNDECIDED)
    for words in (verdict, "ranging by tof; seed 17;", "23 repetitions", "of bar has", plan):
        assert words in text
    assert "<mine>" not in page
    rows = [row for row in cells(page.replace("\n", "")) if row[0] == "bar"]
    told = [(row[0], row[1], row[2], row[5], row[-1]) for row in rows]
    assert told == [
        ("bar", "length", "0", "12.500", str(Verdict.UNDECIDED)), ("bar", "length", "0", "12.500", str(Verdict.PASSES)),
        ("bar", "length", "1", "-10.000", str(Verdict.FAILS)),
    ]  # fmt: skip
    for name, caption in report.CAPTIONS.items():
        assert f'alt="{caption}" src="{png_address(name.encode())}"' in text


@pytest.mark.parametrize(("share", "told"), [(0.251, True), (0.249, False)])
def test_certificates_that_are_coarse_are_remarked(share: float, told: bool) -> None:
    """Claim: more than a quarter of the limit; each artefact once, by name."""
    results = [result(name, number, uncertainty=share * 0.02) for name in ("v", "u") for number in range(2)]
    found = report.remarks(SimpleNamespace(results=[*results, result("fine", 0, uncertainty=0.0)]))  # type: ignore[arg-type]
    assert [sentence.startswith("the certificate of u, v has more than a quarter") for sentence in found] == [
        True
    ] * told


@pytest.mark.parametrize(("metres", "words"), [(0.0123456, "12.346"), (-2e-7, "-0.000"), (math.nan, "–")])
def test_lengths_are_told_in_millimetres(metres: float, words: str) -> None:
    assert report.millimetres(metres) == words


def test_a_verdict_is_told_in_words() -> None:
    assert [report.title(one).split()[0:3] for one in (Verdict.PASSES, Verdict.FAILS)] == [
        ["The", "instrument", "passes"], ["The", "instrument", "fails"],
    ]  # fmt: skip
    assert report.title(Verdict.UNDECIDED).startswith("Neither passed nor failed")


def test_errors_are_drawn_test_by_test(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: a line for each test, repetitions side by side in it, each by its own limit and in the colour of its
    verdict; the axis holds the limits by a quarter, or 8 % more than the largest error."""
    figure = figure_of(monkeypatch, pictures)
    results = [
        result("bar", 0, error=0.01, verdict=Verdict.PASSES), result("bar", 1, error=-0.03, verdict=Verdict.FAILS),
        result("ball", 0, quantity="form", error=0.021, verdict=Verdict.UNDECIDED),
    ]  # fmt: skip
    found: Any = SimpleNamespace(
        tests=[results[0], results[2]],
        results=results,
        setup=SimpleNamespace(plan=SimpleNamespace(rule="simple")),
    )
    pictures.draw_errors(found, "")
    (axes,) = figure.axes
    dots = [one for one in axes.lines if one.get_marker() == "o"]
    np.testing.assert_allclose(
        [dot.get_xydata()[0] for dot in dots], [[0.5, -0.125], [-1.5, 0.125], [1.05, 1.0]]
    )
    order = (Verdict.PASSES, Verdict.FAILS, Verdict.UNDECIDED)
    assert [dot.get_color() for dot in dots] == [pictures.COLOURS[one] for one in order]
    assert axes.get_xlim() == pytest.approx((-1.08 * 1.5, 1.08 * 1.5))
    assert axes.get_ylim() == (1.6, -0.6)
    assert [label.get_text() for label in axes.get_yticklabels()] == ["bar, length", "ball, form"]
    np.testing.assert_allclose(
        [one.get_xdata()[0] for one in axes.lines if one.get_marker() != "o"], [-1.0, 1.0, 0.0]
    )


def test_each_artefact_and_quantity_has_a_line_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of two bars and of size and form of a ball each repetition is drawn once, in the line of its own."""
    figure = figure_of(monkeypatch, pictures)
    pairs = (("length", "bar"), ("length", "rod"), ("size", "ball"), ("form", "ball"))
    results = [
        result(artefact, repetition, quantity=quantity, error=1e-3 * (10 * number + repetition), limit=0.1)
        for number, (quantity, artefact) in enumerate(pairs)
        for repetition in range(2)
    ]
    found: Any = SimpleNamespace(
        tests=results[::2], results=results, setup=SimpleNamespace(plan=SimpleNamespace(rule="simple"))
    )
    pictures.draw_errors(found, "")
    dots = [one.get_xydata()[0] for one in figure.axes[0].lines if one.get_marker() == "o"]
    wanted = [[0.1 * number + 0.01 * n, number - 0.125 + 0.25 * n] for number in range(4) for n in range(2)]
    np.testing.assert_allclose(dots, wanted)


@pytest.mark.parametrize("upward", [0, 1])
def test_bars_and_balls_are_drawn_where_they_are(axes: Axes, upward: int) -> None:
    """Claim: a bar from ball to ball as long as it was made, each ball with its diameter, z against x or y."""
    bar = LengthBar.model_validate({
        "name": "bar", "position": (0.1, -0.3, 5.0), "length": 0.5, "diameter": 0.04,
        "direction": (1.0, 2.0, -2.0),
    })  # fmt: skip
    ball = Ball.model_validate({"name": "ball", "position": (0.2, 0.4, 3.0), "diameter": 0.06})
    pictures._artefact(axes, bar, 0.501, upward, "black")
    pictures._artefact(axes, ball, 0.0, upward, "black")
    ends = bar.ends(0.501)
    np.testing.assert_allclose(np.abs(ends[1] - ends[0]), 0.501 * np.array([1.0, 2.0, 2.0]) / 3.0)
    np.testing.assert_allclose(line(axes, 0), ends[:, [2, upward]])
    np.testing.assert_allclose(line(axes, 1), [[3.0, (0.2, 0.4)[upward]]])
    circles: list[Any] = list(axes.patches)
    np.testing.assert_allclose([one.get_center() for one in circles[:2]], ends[:, [2, upward]])
    assert [one.get_radius() for one in circles] == pytest.approx([0.02, 0.02, 0.03])


def test_the_volume_has_zones_within_the_field_of_view(axes: Axes) -> None:
    """Claim: arcs over the field at the end of each zone, and at 1.1 of the farthest artefact where a zone goes on; the
    edges of the field as far."""
    setup: Any = SimpleNamespace(
        base=SimpleNamespace(scanner=SimpleNamespace(mirrors=SimpleNamespace(max_deflection=0.4))),
        surfaces=[SimpleNamespace(farthest=far) for far in (3.0, 7.0)],
        plan=SimpleNamespace(limits=[SimpleNamespace(up_to=4.0), SimpleNamespace(up_to=math.inf)]),
    )  # fmt: skip
    pictures._view(axes, setup)
    for number, radius in enumerate((4.0, 7.7)):
        arc = line(axes, number)
        np.testing.assert_allclose(np.hypot(*arc.T), radius)
        np.testing.assert_allclose(np.arctan2(arc[[0, -1], 1], arc[[0, -1], 0]), [-0.4, 0.4])
    for number, side in ((2, -0.4), (3, 0.4)):
        np.testing.assert_allclose(
            line(axes, number), [[0.0, 0.0], [7.7 * math.cos(side), 7.7 * math.sin(side)]]
        )


def test_places_are_drawn_in_the_colour_of_the_worst_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    figure = figure_of(monkeypatch, pictures)
    asked: list[Any] = []
    monkeypatch.setattr(pictures, "_artefact", lambda _, *given: asked.append(given))
    monkeypatch.setattr(pictures, "_view", lambda *_: None)
    artefacts = {name: SimpleNamespace(name=name) for name in ("u", "v")}
    results = [
        result("u", 0), result("u", 1, verdict=Verdict.FAILS), result("u", 2, verdict=Verdict.UNDECIDED), result("v", 0)
    ]  # fmt: skip
    plan = SimpleNamespace(artefacts=artefacts)
    found: Any = SimpleNamespace(results=results, setup=SimpleNamespace(plan=plan, made=np.array([0.1, 0.2])))
    pictures.draw_places(found, "")
    bad, good = pictures.COLOURS[Verdict.FAILS], pictures.COLOURS[Verdict.PASSES]
    assert asked == [
        (artefacts["u"], 0.1, 0, bad), (artefacts["v"], 0.2, 0, good), (artefacts["u"], 0.1, 1, bad),
        (artefacts["v"], 0.2, 1, good),
    ]  # fmt: skip
    above, beside = figure.axes
    assert (above.get_ylabel(), beside.get_ylabel()) == ("x [m]", "y [m]")
    assert (above.yaxis_inverted(), beside.yaxis_inverted()) == (False, True)


def test_deviations_are_drawn_of_the_worst_surfaces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: 24 at most, those with the largest form, in the order of the test."""
    figure_of(monkeypatch, pictures)
    asked: list[str] = []
    monkeypatch.setattr(pictures, "_deviations", lambda _, name, fit: asked.append(name))
    fits = {f"s{number}": SimpleNamespace(form=float((7 * number) % 30)) for number in range(30)}
    pictures.draw_deviations(SimpleNamespace(fits=fits), "")  # type: ignore[arg-type]
    assert asked == [name for name, fit in fits.items() if fit.form >= 6.0]


def test_deviations_are_drawn_about_the_middle_in_millimetres(axes: Axes) -> None:
    """Claim: x and y of each point less the mean of all; colours as far to either side as the largest that is used."""
    points = np.array([[1.0, 2.0, 5.0], [1.002, 2.004, 5.0], [1.004, 1.994, 5.0], [0.994, 2.002, 5.0]])
    used = np.array([True, True, True, False])
    fit: Any = SimpleNamespace(points=points, used=used, deviations=1e-3 * np.array([0.5, -2.0, 1.0, 9.0]))
    pictures._deviations(axes, "u", fit)
    at = 1e3 * (points - points.mean(axis=0))[:, :2]
    np.testing.assert_allclose(line(axes, 0), at[~used])
    dots: Any = axes.collections[0]
    np.testing.assert_allclose(dots.get_offsets(), at[used])
    np.testing.assert_allclose(dots.get_array(), [0.5, -2.0, 1.0])
    assert dots.get_clim() == pytest.approx((-2.0, 2.0))
    assert axes.yaxis_inverted()
