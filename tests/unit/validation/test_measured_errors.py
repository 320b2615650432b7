"""Errors of points and their σ as laws measure them: which planes and plates, which shots, and what is made of them."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import claims
import numpy as np
import pytest
from made_settings import GREY, MIDDLE, RANGES, Array, setting
from scipy.stats import kstest

from scanner_sim.analytic import geometry
from scanner_sim.foundation.status import Status
from scanner_sim.validation.compare import coverage, point_errors, test_bench
from scanner_sim.validation.compare.shape import FieldPosition

COVARIANCE = np.array([[4.0, 1.0, -0.5], [1.0, 3.0, 0.7], [-0.5, 0.7, 2.0]]) * 1e-8
"""Of a point [m²], no two of its numbers alike."""


def seen(count: int, rng: np.random.Generator) -> dict[str, Array]:
    """Return layers of voxels whose points and ranges err as they say."""
    R, theta, phi = rng.uniform(3.0, 9.0, count), rng.uniform(-0.1, 0.1, count), rng.uniform(-0.1, 0.1, count)
    separation = setting().closed.D
    point = geometry.point_from_shot(R, theta, phi, separation) + rng.multivariate_normal(
        np.zeros(3), COVARIANCE, count
    )
    layers = {"truth.range_m": R, "truth.theta_rad": theta, "truth.phi_rad": phi, "status": np.zeros(count)}
    layers |= {f"P.{axis}": point[:, number] for number, axis in enumerate("XYZ")}
    layers["sigma_range_m"] = rng.uniform(1e-4, 2e-4, count)
    layers["range_m"] = R + layers["sigma_range_m"] * rng.normal(size=count)
    for row, one in enumerate("xyz"):
        layers[f"sigma_{one}_m"] = np.full(count, math.sqrt(COVARIANCE[row, row]))
        for column in range(row):
            layers[f"cov_{'xyz'[column]}{one}_m2"] = np.full(count, COVARIANCE[row, column])
    return layers


@pytest.mark.parametrize("planes", [True, False])
def test_errors_over_sigma_are_those_of_the_whole_covariance(
    monkeypatch: pytest.MonkeyPatch, planes: bool
) -> None:
    """Claim: points that err by a full covariance have χ² of three, and ranges by their σ a mean square of one; what is
    not valid, or of which σ does not speak, does not count; seeds 17 apart for as many runs as are asked for; scenes of
    fewer than 40 voxels are left out. Flat targets that were asked for stand on planes."""
    told = setting(seeds=2)
    told = told if planes else dataclasses.replace(told, target=None)
    asked: list[Any] = []
    rng = np.random.default_rng(4)

    def measured(of: Any, seeds: Any, ranging: str) -> Any:
        asked.append((seeds, ranging))
        for number in range(3):
            layers = seen(3000 if number < 2 else coverage._FEWEST - 1, rng)
            good = np.ones(len(layers["status"]), dtype=bool)
            if number < 2:
                layers["status"][:500], good[500:1000] = Status.SATURATED, False
                layers["range_m"][:1000] = layers["P.X"][:1000] = 1e9
            yield layers, good

    monkeypatch.setattr(coverage, "_on_planes" if planes else "_on_scene", measured)
    found = list(coverage._pulls(told, "triangulation"))
    assert [len(pull) for pull, _ in found] == [2000, 2000]
    ((seeds, ranging),) = asked
    assert ranging == "triangulation"
    assert len(seeds) == told.count * 2
    assert np.diff(seeds).tolist() == [17] * (len(seeds) - 1)
    for pull, squares in found:
        assert claims.mean_square(pull)
        assert kstest(squares, "chi2", args=(3,)).pvalue > claims.LEVEL
    timed = list(coverage._pulls(told, "tof"))
    assert len(timed) == 2
    assert asked[1][0][0] != seeds[0]


def test_runs_are_told_by_their_means(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: of each run the mean of errors over σ, of their squares, the share within 1.96 and χ² over three; nothing
    of fewer runs than tell a scatter; without errors of the angles nothing of points."""
    pulls = [np.array([1.0, -2.0, 0.5 + number, 1.95]) for number in range(8)]
    squares = [np.array([3.0, 6.0, 9.0 + number, 12.0]) for number in range(8)]
    monkeypatch.setattr(coverage, "_pulls", lambda *_, **__: zip(pulls, squares, strict=True))
    monkeypatch.setattr(coverage, "mean_of", lambda values: list(values))
    told = setting()
    found: Any = coverage._measure(told, ranging="triangulation")
    names = list(coverage._predict(told))
    assert list(found) == names
    np.testing.assert_allclose(found[names[0]], [pull.mean() for pull in pulls])
    np.testing.assert_allclose(found[names[1]], [(pull**2).mean() for pull in pulls])
    np.testing.assert_allclose(found[names[2]], [0.75 if pull[2] < 1.96 else 0.5 for pull in pulls])
    np.testing.assert_allclose(found[names[3]], [square.mean() / 3.0 for square in squares])
    still = dataclasses.replace(
        told, scenario=told.scenario.changed(scanner={"mirrors": told.scenario.scanner.mirrors.still()})
    )
    assert list(coverage._measure(still, ranging="triangulation")) == names[:3]
    monkeypatch.setattr(
        coverage, "_pulls", lambda *_, **__: zip(pulls[: coverage._FEWEST_RUNS - 1], squares, strict=False)
    )
    assert coverage._measure(told, ranging="triangulation") == {}
    wanted = [one.value for one in coverage._predict(told).values()]
    assert wanted == [0.0, 1.0, 0.95, 1.0]


def test_planes_are_drawn_within_the_field(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: ranges evenly in logarithms between the first and the last target; tilts to 50°, by turns about x and y;
    middles to 0.3 rad aside, where a raster of 0.03 rad to each side lies, which the plane fills; the seed is the
    run's."""
    asked: list[Any] = []
    told = setting()
    reach = told.scenario.scanner.mirrors.max_deflection
    assert reach > 0.33

    plane = test_bench.plate

    def plate(distance: float, grey: float, **more: Any) -> Any:
        asked.append((distance, grey, more))
        return plane(distance, grey)

    class Made:
        def __init__(self, scenario: Any, **_: Any) -> None:
            self.scenario = scenario

        def measure(self, aim: Any) -> Any:
            return {"aim": aim, "of": self.scenario}

    monkeypatch.setattr(coverage.test_bench, "plate", plate)
    monkeypatch.setattr(coverage, "Instrument", Made)
    monkeypatch.setattr(coverage, "_numbers", lambda layers: layers)
    monkeypatch.setattr(coverage, "_unclipped", lambda instrument, layers: "unclipped")
    seeds = tuple(range(300))
    monkeypatch.setattr(type(told.scenario), "changed", lambda self, **changes: SimpleNamespace(
        **changes | {"scanner": self.scanner}))  # fmt: skip
    found = list(coverage._on_planes(told, seeds, "tof"))
    assert len(found) == 300
    distances = np.array([one[0] for one in asked])
    share = np.log(distances / RANGES[0]) / math.log(RANGES[-1] / RANGES[0])
    tilts, thetas, phis = (np.array([one[2][name] for one in asked]) for name in ("tilt", "theta", "phi"))
    for values, most in ((share - 0.5, 0.5), (tilts, math.radians(50.0)), (thetas, 0.3), (phis, 0.3)):
        assert np.abs(values).max() <= most
        assert kstest(0.5 * (values / most + 1.0), "uniform").pvalue > claims.LEVEL
    for seed, (distance, grey, more), (layers, good) in zip(seeds, asked, found, strict=True):
        assert (grey, more["axis"], more["separation"]) == (GREY, "xy"[seed % 2], told.closed.D)
        assert good == "unclipped"
        scan, of = layers["of"].scan, layers["of"]
        assert np.mean(scan.horizontal) == pytest.approx(more["theta"])
        assert np.mean(scan.vertical) == pytest.approx(more["phi"])
        assert np.ptp(scan.horizontal) == pytest.approx(0.06)
        assert scan.rows == scan.columns == math.isqrt(coverage._VOXELS)
        assert (of.seed, of.ranging, of.processing) == (seed, "tof", {"range_gate": None})
        # Its half side, turned away, still reaches beyond the raster.
        assert 0.5 * more["size"] * math.cos(abs(more["tilt"]) + 0.03) > distance * math.tan(0.03)
        assert len(layers["aim"].shot) == scan.rows**2


def test_points_are_measured_where_they_are_predicted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: ranges on the axis, all coordinates over the field at the middle range; errors in mm of each coordinate,
    of all seeds together, each place with seeds of its own; mirrors with their errors, and no noise but that of
    electrons."""
    told = setting(seeds=2)
    asked: list[Any] = []

    def scenario(of: Any, position: Any, *, seed: int, noise: Any = None, mirrors: Any) -> Any:
        asked.append((position.name, seed, noise, mirrors))
        return (position, seed)

    def errors(of: Any, made: Any, position: FieldPosition, shots: int) -> Array:
        assert made[0] == position
        size = 1e-3 * (1.0 + position.theta + 2.0 * position.phi + position.distance)
        sign = np.where(np.arange(shots) % 2 == 0, 1.0, -1.0)[:, None]
        return size * np.array([1.0, 2.0, 3.0, 4.0]) * (10.0 + sign)

    monkeypatch.setattr(point_errors, "plate_scenario", scenario)
    monkeypatch.setattr(point_errors, "_errors_at", errors)
    monkeypatch.setattr(test_bench, "mirrors_with_errors", lambda of: "errors")
    for measure, predict, factor, noise in (
        (
            point_errors._measure_points,
            point_errors._predict_points,
            10.0,
            ("shot", "read", "dark", "quantisation"),
        ),
        (point_errors._measure_covariance, point_errors._predict_covariance, 1.0, None),
    ):
        asked.clear()
        found: Any = measure(told)
        assert list(found) == list(predict(told))
        assert {one[2:] for one in asked} == {(noise, "errors")}
        assert len({one[1] for one in asked}) == len(asked) == 2 * len({one[0] for one in asked})
        places = {position.name: position for position, _, _ in point_errors._point_positions(told)}
        for case, one in found.items():
            name, _, place = case.partition(" at ")
            position = places[place]
            size = 1.0 + position.theta + 2.0 * position.phi + position.distance
            number = ("x", "y", "z", "R").index(name) + 1
            assert one.value == pytest.approx(size * number * factor, rel=0.04 if factor == 1.0 else 1e-9)
            if position.distance != MIDDLE:
                assert (name, position.theta, position.phi) == ("R", 0.0, 0.0)
    assert sum(case.startswith("x") for case in found) == 5


def test_a_plate_faces_its_beam_and_holds_its_spot(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: two hundredths of its range and sixteen radii of the beam to a side."""
    told, asked = setting(), []
    monkeypatch.setattr(test_bench, "plate", lambda *given, **more: asked.append((given, more)) or "plate")
    monkeypatch.setattr(test_bench, "on_test_bench", lambda *given, **more: (given, more))
    position = FieldPosition("p", 7.0, 0.1, -0.2)
    made = point_errors.plate_scenario(told, position, seed=3)
    size = 0.02 * 7.0 + 16.0 * told.scenario.scanner.laser.radius(7.0)
    assert asked == [
        ((7.0, GREY), {"theta": 0.1, "phi": -0.2, "separation": told.closed.D, "size": pytest.approx(size)})
    ]
    assert made == ((told, "plate"), {"seed": 3})
