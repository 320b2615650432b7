"""Figures 12, 13 and 15 as they are reproduced with built instruments, from poses made by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from drawn import line
from made_benches import AGREES, DIFFERS, UNPRINTED, drawn
from made_poses import SIGMA, pool_of, series
from scipy.stats import norm

from scanner_sim.config import load_scanner
from scanner_sim.config.calibration import design_of
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.ranging.calibration import Calibration
from scanner_sim.tracking.record import TrackStatus
from scanner_sim.validation.reproduce import as_built
from scanner_sim.validation.reproduce.built_instruments import KINDS, Kind, tolerances
from scanner_sim.validation.reproduce.item import Task, Verdict


def only(name: str, sigma: float) -> Calibration:
    """Return what is believed of an instrument of which one parameter is uncertain."""
    covariance = np.zeros((len(NAMES), len(NAMES)))
    covariance[INDEX[name], INDEX[name]] = sigma**2
    return Calibration(np.zeros(len(NAMES)), covariance, design_of(load_scanner("nrc_2000")))


@pytest.mark.parametrize("name", ["base", "array_offset"])
def test_the_range_errs_by_a_parameter_as_the_judge_says(name: str) -> None:
    """Claim: the product's derivative and the judge's agree to 2 % on the axis, 10 m away, of one parameter alone."""
    believed: Any = only(name, tolerances().given[name])
    instrument: Any = SimpleNamespace(believed={"calibrated": believed})
    (found,) = as_built._range_error(instrument, "calibrated", np.array([10.0]))
    assert found > 1e-4
    assert found == pytest.approx(as_built._closed_range(instrument, "calibrated", 10.0), rel=0.02)


@pytest.mark.parametrize(
    ("power", "off", "expected"),
    [
        (2.149, 0.059, [UNPRINTED, UNPRINTED, AGREES, AGREES, AGREES]),
        (2.151, 0.059, [UNPRINTED, UNPRINTED, AGREES, DIFFERS, DIFFERS]),
        (1.851, -0.059, [UNPRINTED, UNPRINTED, AGREES, AGREES, AGREES]),
        (1.849, -0.061, [DIFFERS, DIFFERS, AGREES, DIFFERS, DIFFERS]),
    ],
)
def test_figure_12_adds_the_instrument_to_the_noise(
    task: Task, monkeypatch: pytest.MonkeyPatch, power: float, off: float, expected: list[Verdict]
) -> None:
    """Claim: noise and the instrument's error add in squares: 3 and 4 mm at 10 m are 5. Exponents may be 0.15 off two;
    the judge's error 6 %; a pixel is worth 0.25 m at 10 m. Drawn in mm, beside it the instrument's error alone."""
    size: dict[str, float] = {"perfect": 0.0, "calibrated": 4e2, "uncalibrated": 5e2}
    monkeypatch.setattr(as_built, "built_instruments", lambda task: None)
    monkeypatch.setattr(
        as_built, "closed_budget",
        lambda _, grey, R: {"triangulation": {"all": 3e-3 * 2.0 * grey * (R / 10.0) ** 2}},
    )  # fmt: skip
    monkeypatch.setattr(as_built, "_range_error", lambda _, kind, R: size[kind] * (R / 10.0) ** power)
    monkeypatch.setattr(
        as_built, "_closed_range", lambda _, kind, R: size[kind] * (R / 10.0) ** power * (1.0 + off)
    )
    monkeypatch.setattr(as_built, "_walls", lambda *_: [])
    outcome = as_built.figure_12_built(task)
    (axes,) = drawn(monkeypatch, as_built, outcome)
    lines = {str(line.get_label()): line.get_xydata() for line in axes.lines}
    R, bare = lines["uncalibrated"].T
    np.testing.assert_allclose(lines["R²"][:, 1], 0.4 * bare[-1] * (R / 30.0) ** 2)
    np.testing.assert_allclose(lines["perfect"][:, 1], 3.0 * (R / 10.0) ** 2)
    left = lines["calibrated, the part that no mean takes away"]
    np.testing.assert_allclose(left, np.stack([R, 4e5 * (R / 10.0) ** power], axis=1))
    rows = outcome.rows
    assert [row.verdict for row in rows] == expected
    assert "calibrated: σ_R at 10 m by the instrument alone, 1.6e+03 pixel" in rows[0].what
    assert (rows[0].found, rows[0].expected) == ("4e+05 mm", f"{4e5 * (1.0 + off):.3g} mm")
    assert [row.found for row in rows[2:]] == ["2.00", f"{power:.2f}", f"{power:.2f}"]
    # Where both are alike they add in squares: the exponent lies between, by a fit through the hypotenuse.
    size["calibrated"] = 3e-3
    distances = np.geomspace(2.0, 30.0, 25)
    both = 3e-3 * np.sqrt((distances / 10.0) ** 4 + (distances / 10.0) ** (2.0 * power))
    fitted = np.polyfit(np.log(distances), np.log(both), 1)[0]
    assert as_built.figure_12_built(task).rows[3].found == f"{fitted:.2f}"


@pytest.mark.parametrize(
    ("depth", "share", "expected"),
    [
        (1.119, 3.28, [UNPRINTED, UNPRINTED]),
        (0.879, 3.30, [DIFFERS, DIFFERS]),
        (0.881, -3.28, [UNPRINTED, UNPRINTED]),
        (1.14, -3.30, [DIFFERS, DIFFERS]),
    ],
)
def test_walls_are_judged_by_the_instrument_that_was_drawn(
    task: Task, monkeypatch: pytest.MonkeyPatch, depth: float, share: float, expected: list[Verdict]
) -> None:
    """Claim: the depth moves as the judge has it, to 12 %; calibrated, by less than 3.29 of the σ in common, beyond
    which a normal number lies once in a thousand. Its closed form is that of the offset alone, R²/(f d) of it."""
    offset = 0.2e-3
    true = np.zeros(len(NAMES))
    true[INDEX["array_offset"]] = offset
    expected_depth = as_built.closed_effects(np.zeros((1, 3)), 10.0)[0, 2, INDEX["array_offset"]] * offset
    assert abs(expected_depth) == pytest.approx(offset * 100.0 / (0.1 * 0.2), rel=0.01)
    instrument: Any = SimpleNamespace(true=true)
    monkeypatch.setattr(as_built, "_scenarios", lambda *_: {kind: kind for kind in KINDS})
    common = np.linspace(1e-3, 3e-3, 5)

    def simulate(kind: Kind, device: str) -> Any:
        moved = {"perfect": 9.0, "calibrated": share * 2e-3, "uncalibrated": depth * expected_depth}[kind]
        scatter = np.array([-1.0, 1.0, 0.0, math.nan, 0.0]) * 1e-3
        truth = np.full(5, 10.0)
        return SimpleNamespace(
            channels={"P.Z": truth + moved + scatter, "truth.P.Z": truth, "sigma_common_m": common}
        )

    monkeypatch.setattr(as_built, "simulate", simulate)
    rows = as_built._walls(task, instrument)
    assert [row.verdict for row in rows] == expected
    assert (rows[0].expected, rows[0].found) == (
        f"{1e3 * expected_depth:.0f} mm",
        f"{1e3 * depth * expected_depth:.0f} mm",
    )
    assert rows[1].what.endswith("over its σ in common of 2 mm")
    assert rows[1].expected == f"within ±{norm.isf(5e-4):.1f}"
    assert rows[1].found == f"{2.0 * share:.2f} mm, {share:.1f} σ"


@pytest.mark.parametrize("component", range(6))
def test_a_run_of_an_instrument_is_judged_by_its_worst_mean(component: int) -> None:
    """Claim: means over a run, over the root mean square of σ; the worst of six may be what is exceeded once in a
    thousand by any of six normal numbers."""
    bound = norm.isf(5e-4 / 6.0)
    sigma = SIGMA * np.array([[0.6], [1.28062484749]])
    for share, verdict in ((0.999, UNPRINTED), (-1.001, DIFFERS)):
        mean = 0.5 * SIGMA
        mean[component] = share * bound * SIGMA[component]
        moved = mean + np.array([[0.1], [-0.1]]) * SIGMA
        made = series(moved, sigma)
        row = as_built._loop_row("calibrated", made)
        assert row.verdict is verdict
        assert row.expected == f"σ 1.00, 2.00, 3.00; at most {bound:.1f}"
        assert row.found == f"{', '.join(f'{1e3 * one:.2f}' for one in mean[:3])}; {abs(share) * bound:.1f}"


@pytest.mark.parametrize(
    ("gain", "verdict"), [(7.01, AGREES), (12.99, AGREES), (6.99, DIFFERS), (13.01, DIFFERS)]
)
def test_a_gain_is_the_depth_of_points_over_the_other(gain: float, verdict: Verdict) -> None:
    points, better = np.ones(6), np.full(6, 0.5)
    points[2], better[2] = 2.0 * gain, 2.0
    row = as_built._gain_row("perfect", "joint", points, better)
    assert (row.found, row.verdict) == (f"{gain:.2f}", verdict)


@pytest.mark.parametrize(
    ("off", "verdict"), [(1.059, UNPRINTED), (0.941, UNPRINTED), (1.065, DIFFERS), (0.939, DIFFERS)]
)
def test_the_depth_of_a_built_instrument_is_judged_by_its_closed_form(off: float, verdict: Verdict) -> None:
    """Claim: by points the mean of four ranges halves their noise; the zero of ranges is in all of them. Here the
    offset of the array, worth ε R²/(f d) at 10 m."""
    believed = only("array_offset", 0.1e-6)
    instrument: Any = SimpleNamespace(believed={"calibrated": believed})
    pool = pool_of()
    wanted = math.hypot(0.5e-3, 0.1e-6 * 100.0 / 0.02)
    errors = np.zeros(6)
    errors[2] = off * wanted
    row = as_built._depth_row(instrument, "xyz", "calibrated", pool, errors)
    assert float(row.expected.removesuffix(" mm")) == pytest.approx(1e3 * wanted, rel=0.01)
    errors[2] = off * 1e-3 * float(row.expected.removesuffix(" mm"))
    assert as_built._depth_row(instrument, "xyz", "calibrated", pool, errors).verdict is verdict


@pytest.mark.parametrize(("found", "verdict"), [(0, UNPRINTED), (1, DIFFERS)])
def test_closed_loops_are_judged_instrument_by_instrument(
    task: Task, monkeypatch: pytest.MonkeyPatch, found: int, verdict: Verdict
) -> None:
    """Claim: three methods of the perfect and of the calibrated instrument, and no target at all without calibration,
    where the offset of the array moves ranges by 1 m at 10 m."""
    true = np.zeros(len(NAMES))
    true[INDEX["array_offset"]], true[INDEX["base"]] = -0.2e-3, 1e-3
    instrument: Any = SimpleNamespace(true=true)
    monkeypatch.setattr(as_built, "_scenarios", lambda *_: {kind: kind for kind in KINDS})
    records = [SimpleNamespace(status=TrackStatus.MEASURED)] * found
    records += [SimpleNamespace(status=TrackStatus.NOT_FOUND)] * (7 - found)
    monkeypatch.setattr(as_built, "track", lambda kind, device: SimpleNamespace(kind=kind, records=records))
    small, large = np.tile(0.1 * SIGMA, (2, 1)), np.tile(9.0 * SIGMA, (2, 1))
    monkeypatch.setattr(
        as_built, "poses_of",
        lambda run: [
            series(large if (run.kind, method) == ("calibrated", "uv") else small, SIGMA, method)
            for method in ("joint", "xyz", "uv")
        ],
    )  # fmt: skip
    rows = as_built._loops(task, instrument)
    names = [row.what.split(",")[:2] for row in rows[:6]]
    assert names == [
        [kind, f" {way}"] for kind in ("perfect", "calibrated") for way in ("xyz", "uv", "joint")
    ]
    assert [row.verdict for row in rows] == [*[UNPRINTED] * 4, DIFFERS, UNPRINTED, verdict]
    assert rows[-1].found == f"{found} of 7"
    assert rows[-1].expected.endswith("range by 1 m")


def test_poses_of_built_instruments_are_those_of_their_pools(
    task: Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: at 10 m the depth of each kind by points and angles, and gains of angles and both over points; on the axis
    of residuals the angle is the root mean square of both, 3.5355 µrad, and the noise that of the range."""
    instrument: Any = SimpleNamespace(
        believed={
            "perfect": only("base", 0.0),
            "calibrated": only("base", 1e-5),
            "uncalibrated": only("base", 1e-3),
        }
    )
    asked: list[Any] = []

    def measured(
        scenario: Any, target: Any, distance: float, positions: int, patterns: int, device: str
    ) -> Any:
        asked.append((target.diameter, distance, positions, patterns))
        pool = pool_of()
        pool.distance = distance
        return pool

    class Axis:
        @staticmethod
        def at(distance: float, angle: float, noise: float) -> Any:
            asked.append((distance, angle, noise))
            return SimpleNamespace(rows=list, draw=lambda axes: axes.set_title("residuals"))

    monkeypatch.setattr(as_built, "built_instruments", lambda task: instrument)
    monkeypatch.setattr(as_built, "measure_targets", measured)
    monkeypatch.setattr(as_built, "ResidualAxis", Axis)
    monkeypatch.setattr(as_built, "_loops", lambda *_: [])
    made = as_built.figure_15_built(task)
    rows = made.rows
    assert asked[:2] == [(0.1, 5.0, 4, 1), (0.1, 10.0, 4, 1)]
    assert asked[2] == (10.0, pytest.approx(math.sqrt(12.5) * 1e-6), 1e-3)
    what = [f"{kind}, {way}: σ of the depth at 10 m" for kind in KINDS for way in ("xyz", "uv")]
    what += [f"{kind}: xyz over {way} at 10 m, depth" for kind in KINDS for way in ("uv", "joint")]
    assert [row.what for row in rows] == what
    assert [row.verdict for row in rows[:6]] == [UNPRINTED] * 6
    # Perfect: σ_R/2 by points; by angles (3, 4 µrad) R²/√(2 w_x + 2 w_y...), the closed form of a square.
    depth = {row.what: float(row.found.removesuffix(" mm")) for row in rows[:6]}
    assert depth[what[0]] == pytest.approx(0.5, rel=0.01)
    angles = 1e3 * 100.0 / math.sqrt(1.0 / (4e-6) ** 2 + 1.0 / (3e-6) ** 2)
    assert depth[what[1]] == pytest.approx(angles, rel=0.02)
    assert float(rows[6].found) == pytest.approx(depth[what[0]] / depth[what[1]], rel=0.01)
    # A base that is 1 mm of 0.2 m too long makes all ranges 0.5 % too long.
    assert depth[what[4]] == pytest.approx(math.hypot(0.5, 50.0), rel=0.01)
    # Drawn over range is the depth [mm] of each method and kind, here at 5 and 10 m; and the axis of residuals, with
    # what the calibration leaves.
    left, right = drawn(monkeypatch, as_built, made)
    curves = [line(left, number) for number in range(9)]
    assert [curve[:, 0].tolist() for curve in curves] == [[5.0, 10.0]] * 9
    at_ten = {(way, kind): curve[1, 1] for (way, kind), curve in zip(
        ((way, kind) for way in ("xyz", "uv", "joint") for kind in KINDS), curves, strict=True)}  # fmt: skip
    for kind in KINDS:
        for way in ("xyz", "uv"):
            assert at_ten[way, kind] == pytest.approx(
                depth[f"{kind}, {way}: σ of the depth at 10 m"], rel=5e-3
            )
        gain = next(row for row in rows if row.what == f"{kind}: xyz over joint at 10 m, depth")
        assert at_ten["xyz", kind] / at_ten["joint", kind] == pytest.approx(float(gain.found), rel=5e-3)
    assert right.get_title() == "residuals"
    # A base that is 10 µm of 0.2 m too long makes ranges of 10 m 0.5 mm too long, where a pixel makes 250 mm.
    np.testing.assert_allclose(line(right, -1)[:, 0], 0.5e-3 / 0.25, rtol=0.01)
