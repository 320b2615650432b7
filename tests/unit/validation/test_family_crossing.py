"""The map of where both rangefinders err alike, on instruments that answer by a law."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn import line
from made_benches import Benches, quick_task, triangulated
from matplotlib.figure import Figure

from scanner_sim.config import load_scanner
from scanner_sim.validation.reproduce.family import crossing, spots
from scanner_sim.validation.reproduce.item import Task, Verdict

TASK = quick_task()
LIGHT = 299_792_458.0
UNPRINTED, DIFFERS, AGREES = Verdict.UNPRINTED, Verdict.DIFFERS, Verdict.AGREES


def test_an_unknown_of_the_map_changes_what_it_is_named_for() -> None:
    """Claim: an aperture is the lens's; aberration and diffusion share 40 µm in squares: 24 and 32."""
    size = crossing._Axis("aperture of the lens [mm]", 1e3, np.zeros(1), 0.0)
    assert size.changes(0.03) == {"receiver": {"aperture": 0.03}}
    blur = crossing._Axis("aberration of the lens [µm]", 1e6, np.zeros(1), 0.0)
    made = blur.changes(24e-6)
    assert made["receiver"] == {"aberration": 24e-6}
    assert made["position_sensor"] == {"diffusion": pytest.approx(32e-6)}
    assert blur.changes(41e-6)["position_sensor"] == {"diffusion": 0.0}


def test_a_clock_alone_makes_the_sigma_of_a_unit() -> None:
    """Claim: σ² of a unit whose clock makes 5 mm is that of one whose clock makes none, and (5 mm)², at each range."""
    scenario = crossing.bench(TASK, [], ranging="both").scenario
    distances = np.array([3.0, 12.0])
    with_clock, without = (crossing._pulses(scenario, sigma, distances) for sigma in (5e-3, 0.0))
    np.testing.assert_allclose(with_clock**2 - without**2, 25e-6, rtol=1e-9)
    assert without.max() < 5e-3


def test_a_map_holds_where_both_ways_err_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: v R² and t/100 are alike at √(t/100 v)."""
    axis = crossing._Axis("aperture", 1.0, np.array([1e-4, 2e-4]), 1e-4)
    monkeypatch.setattr(crossing, "_numbers", lambda task, axis, value: (value, value))
    monkeypatch.setattr(crossing, "_triangulation", lambda value, distances: value * distances**2)
    monkeypatch.setattr(crossing, "_pulses", lambda value, sigma, distances: sigma / 100.0 + 0.0 * distances)
    distances = np.geomspace(1.6, 60.0, 64)
    found = crossing._map(TASK, axis, np.array([0.5, 1.0, 2.0]), distances)
    wanted = np.sqrt(np.array([0.5, 1.0, 2.0])[:, None] / 100.0 / axis.values)
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


def test_a_point_of_the_map_is_simulated_about_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: five ranges from 0.7 to 1.4 of where it should be; the clock jitters by 2 σ/c; both ways from the same
    shots: 1e-4 R² and 10 mm are alike at 10 m, with 1/16 for the error of a ratio of 16² shots."""
    axis = crossing._Axis("aperture of the lens [mm]", 1e3, np.zeros(1), 0.0)

    def law(made: Any, shots: Any) -> Any:
        clock = made.scanner["lidar"]["digitiser"]
        assert clock["jitter"] == pytest.approx(2.0 * 8e-3 / LIGHT)
        assert clock["gate"] == (0.5, 80.0)
        assert made.scanner["receiver"] == {"aperture": 0.03}
        assert made.rest["ranging"] == "both"
        assert made.reflectance == 0.5
        np.testing.assert_allclose(np.diff(shots.time), 0.1)
        R = made.distance
        return triangulated(shots, R, 1e-4 * R**2) | triangulated(shots, R, 1e-2, "tof.")

    benches = Benches(monkeypatch, crossing, law)
    found, error = crossing._simulated(TASK, axis, 0.03, 8e-3, 9.0, 3)
    assert [made.distance for made in benches.asked] == pytest.approx([6.3, 7.65, 9.0, 10.62, 12.6])
    assert [made.step for made in benches.asked] == [30, 31, 32, 33, 34]
    assert found == pytest.approx(10.0)
    assert 0.0 < error == pytest.approx(spots.crossing_of(9.0 * np.array([0.7, 0.85, 1.0, 1.18, 1.4]),
        (9.0 * np.array([0.7, 0.85, 1.0, 1.18, 1.4]) / 10.0) ** 2, 1.0 / 16.0)[1])  # fmt: skip


@pytest.mark.parametrize(("off", "verdict"), [(0.99, UNPRINTED), (-1.01, DIFFERS)])
def test_the_map_is_judged_by_its_worst_point(
    monkeypatch: pytest.MonkeyPatch, repo_root: Path, off: float, verdict: Verdict
) -> None:
    """Claim: four standard errors and 2.5 % of the closed form are granted; told are σ of units that cross at 5 and 10
    m, with the shipped aberration and with none."""
    points = [crossing._Point(1.0, 0.01, 10.0, 10.1, 0.05)]
    slack = 4.0 * 0.05 + 0.025 * 8.0
    assert crossing._Point(1.0, 0.01, 8.0, 9.0, 0.05).slack == pytest.approx(slack)
    points += [crossing._Point(1.0, 0.01, 8.0, 8.0 + off * slack, 0.05)]
    monkeypatch.setattr(crossing, "_map", lambda *_: np.zeros((1, 1)))
    monkeypatch.setattr(crossing, "_points", lambda task, axis, step: tuple(points))
    asked = []

    def numbers(task: Task, axis: Any, value: float) -> tuple[float, None]:
        asked.append((axis.label, value))
        return value, None

    monkeypatch.setattr(crossing, "_numbers", numbers)
    monkeypatch.setattr(crossing, "range_budget", lambda value, R: {"all": 1e-4 * R**2 + 1e2 * value})
    task = quick_task(repo_root)
    rows = crossing.make_map(task).rows
    assert rows[0].verdict is verdict
    assert "4 points" in rows[0].what
    assert (rows[0].expected, rows[0].found) == (f"1 ± {slack / 8.0:.2f}", f"{1.0 + off * slack / 8.0:.2f}")
    aberration = load_scanner("nrc_2000").receiver.aberration
    assert rows[1].expected == f"{2.5 + 1e5 * aberration:.1f} to {10.0 + 1e5 * aberration:.1f} mm"
    assert rows[2].expected == "2.5 to 10.0 mm"
    assert {value for _, value in asked} == {aberration, 0.0}
    assert all(label.startswith("aberration") for label, _ in asked)


def test_points_of_the_map_are_those_that_may_be_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: least, shipped and largest value, where the closed forms cross between 2.3 and 24 m; each has a step
    of its own."""
    axis = crossing._Axis("aperture", 1.0, np.array([1.01, 5.0, 9.0]), 4.0)
    monkeypatch.setattr(crossing, "_numbers", lambda task, axis, value: (value, value))
    monkeypatch.setattr(crossing, "_triangulation", lambda value, R: 1e-2 * (R / (2.31 * value)) ** 2)
    monkeypatch.setattr(crossing, "_pulses", lambda value, sigma, R: sigma + 0.0 * R)
    asked: list[Any] = []

    def simulated(
        task: Task, axis: Any, value: float, sigma: float, near: float, step: int
    ) -> tuple[float, float]:
        asked.append((value, sigma, near, step))
        return near + 0.5, 0.1

    monkeypatch.setattr(crossing, "_simulated", simulated)
    found = crossing._points(TASK, axis, 100)
    assert [point.value for point in found] == [1.01, 4.0, 9.0]
    assert [one[2] for one in asked] == pytest.approx([2.31 * 1.01, 2.31 * 4.0, 2.31 * 9.0], rel=1e-6)
    assert [one[1] for one in asked] == [1e-2] * 3
    assert [one[3] for one in asked] == [101, 102, 103]
    assert [point.found - point.closed for point in found] == pytest.approx([0.5] * 3)
    for value in (2.28 / 2.31, 24.1 / 2.31):
        assert not crossing._points(TASK, crossing._Axis("aperture", 1.0, np.full(2, value), value), 0)


def test_the_map_is_drawn_in_the_units_of_its_axes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: crossings over the unknown in its unit and σ [mm]; each simulated point at its place with its range and
    three standard errors; the shipped instrument at 10 mm; ranges of equal colour are the same in both."""
    axes = Figure().subplots()
    axis = crossing._Axis("label", 1e3, np.array([0.01, 0.02, 0.04]), 0.025)
    times = np.array([2e-3, 1e-2, 4e-2])
    found = 1e3 * times[:, None] * axis.values / 0.02 + 3.0
    points = [crossing._Point(0.02, 8e-3, 9.0, 9.27, 0.06), crossing._Point(0.04, 2e-2, 9.0, 12.5, 0.1)]
    asked: list[Any] = []
    contour = axes.contour
    monkeypatch.setattr(
        axes, "contour", lambda *given, **more: (asked.append((given, more)), contour(*given, **more))[1]
    )
    crossing._draw_map(axes, axis, times, found, points)
    ((given, more),) = asked
    np.testing.assert_allclose(given[0], [10.0, 20.0, 40.0])
    np.testing.assert_allclose(given[1], [2.0, 10.0, 40.0])
    np.testing.assert_allclose(given[2], found)
    assert more["levels"] == list(crossing._LEVELS)
    dots = [one for one in axes.collections if len(one.get_offsets()) == 1 and one.get_array() is not None]
    for dot, point in zip(dots[-2:], points, strict=True):
        np.testing.assert_allclose(np.asarray(dot.get_offsets()), [[1e3 * point.value, 1e3 * point.sigma]])
        np.testing.assert_allclose(np.asarray(dot.get_array()), [point.found])
    words = [text.get_text() for text in axes.texts]
    assert {"9.3 ± 0.2", "12.5 ± 0.3"} <= set(words)
    np.testing.assert_allclose(line(axes, -1), [[25.0, 10.0]])
    assert (axes.get_xlabel(), axes.get_yscale()) == ("label", "log")
