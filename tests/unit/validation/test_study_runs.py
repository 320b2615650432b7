"""How studies go: which instruments are made once, in what order poses and rows come, what is told of them."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from scanner_sim import load_scenario
from scanner_sim.config import load_scanner
from scanner_sim.config.calibration import calibration_text, design_of
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.pose.target_layouts import square
from scanner_sim.products.budget import BudgetRow
from scanner_sim.ranging.calibration import Calibration
from scanner_sim.ranging.coordinates import angles_and_range
from scanner_sim.validation.compare import instrument
from scanner_sim.validation.reproduce import as_built, built_instruments
from scanner_sim.validation.reproduce.item import Task
from scanner_sim.validation.studies import budget, pose_study

Array = NDArray[np.float64]
SCAN = {"type": "raster", "rows": 4, "columns": 5, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}


def scenario(**changes: Any) -> Any:
    return load_scenario({"schema": 1, "seed": 7, "scan": SCAN} | changes)


@pytest.mark.parametrize("method", ["uv", "xyz", "joint"])
def test_poses_of_a_study_are_those_of_its_readings(method: Any) -> None:
    """Claim: exact readings of a square 9 m away give its place, by angles without any ranges; σ of ranges tells depth
    by points, which count alike: σ_R/2 of four."""
    array = square(1.0)
    x, y, z = (array.points + np.array([0.0, 0.0, 9.0])).T
    R, theta, phi = angles_and_range(x, y, z, 0.05)
    readings = np.stack([theta, phi, R], axis=-1)[None]
    if method == "uv":
        readings = readings.copy()
        readings[..., 2] = math.nan
    sigma = np.broadcast_to([1e-6, 2e-6, 4e-3], readings.shape)
    found = pose_study._estimated(array, readings, sigma, method, 0.05)
    np.testing.assert_allclose(found.position, [[0.0, 0.0, 9.0]], atol=1e-9)
    np.testing.assert_allclose(found.rotation, np.eye(3)[None], atol=1e-9)
    if method == "xyz":
        assert found.sigma[0, 2] == pytest.approx(2e-3, rel=0.02)
    if method == "uv":
        # Θ alone 1 µrad, φ alone 2 µrad: R²/√(1/1 + 1/4) of a square of 1 m.
        side = float(np.ptp(array.points, axis=0).max())
        depth = 81.0 / side / math.sqrt(1.0 / 1e-12 + 1.0 / 4e-12)
        assert found.sigma[0, 2] == pytest.approx(depth, rel=0.02)


def test_a_study_goes_range_by_range(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: targets are measured once at each range, with the plan's places and patterns, then all arrays; each array
    is a step that is told of, the targets one more."""
    asked: list[Any] = []

    def measured(
        told: Any, target: Any, distance: float, *, positions: int, patterns: int, device: Any
    ) -> str:
        asked.append((distance, positions, patterns))
        return f"pool at {distance:g}"

    monkeypatch.setattr(pose_study, "measure_targets", measured)
    monkeypatch.setattr(
        pose_study, "_array_rows", lambda told, plan, array, pool: iter([f"{array} by {pool}"])
    )
    plan = pose_study.StudyPlan((5.0, 9.0), ("a", "b"), 100, 3, 2)  # type: ignore[arg-type]
    told: list[Any] = []
    pools, rows = pose_study.measure_study(
        scenario(), plan, None, progress=lambda *done: told.append(done)  # type: ignore[arg-type]
    )  # fmt: skip
    assert pools == ("pool at 5", "pool at 9")
    assert rows == tuple(f"{array} by pool at {R}" for R in (5, 9) for array in "ab")
    assert asked == [(5.0, 3, 2), (9.0, 3, 2)]
    assert told == [(2, 6), (3, 6), (5, 6), (6, 6)]


def test_targets_of_a_budget_keep_what_all_sources_need(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: the bias and the whole are measured once by each way; the whole by the instrument that was loaded, others
    by instruments that reuse it; time of flight by its own. Whatever their seeds, it is the scenario's own instrument;
    each place has its lanes, with plates of one size, that of the farthest."""
    made: list[Any] = []

    def build(told: Any, device: Any = None, reuse: Any = None) -> Any:
        made.append((told, reuse))
        return SimpleNamespace(told=told, reuse=reuse, loaded="loaded")

    monkeypatch.setattr(budget, "Instrument", build)

    class Alone(NamedTuple):
        name: str
        scene: Any
        seed: int
        serial: int

    monkeypatch.setattr(
        budget,
        "_alone",
        lambda told, name, scene: Alone(name, scene, told.seed, told.scanner.as_built.seed),
    )
    plates = {R: budget._plate(R, 1.0, 0.5) for R in (4.0, 9.0)}
    sizes: list[tuple[float, float]] = []
    monkeypatch.setattr(budget, "_size", lambda told, R: 2.0 * R)
    monkeypatch.setattr(budget, "_plate", lambda R, size, grey: sizes.append((size, grey)) or plates[R])
    lanes: list[Any] = []

    def of(runs: Any, loaded: Any, aim: Any) -> Any:
        lanes.append((runs, loaded))
        return aim.repeated(len(runs)), "seeds", "poses"

    monkeypatch.setattr(budget, "lanes_of", of)
    ranged: list[Any] = []
    for way in ("_by_line", "_by_time"):
        monkeypatch.setattr(
            budget._Targets, way, lambda _, own, way=way: ranged.append((way, own.told.name)) or object()
        )
    drawn = scenario(scanner={"as_built": {"base": {"tolerance": 1e-3}}})
    places = np.array([[4.0, 9.0]])
    targets = budget._Targets(drawn, "assumed", places, [99, 116], 0.3, "cpu")  # type: ignore[arg-type]
    (whole,) = made
    assert whole == (("all", plates[4.0], 99, drawn.seed), None)
    assert lanes == [
        ([("all", plates[4.0], 99, drawn.seed), ("all", plates[9.0], 116, drawn.seed)], "loaded")
    ]
    assert sizes == [(18.0, 0.3)] * 2
    assert targets.aim.theta.size == 2 * budget._aim(drawn).theta.size == np.unique(targets.aim.time).size
    for _ in range(2):
        for mode in ("triangulation", "tof"):
            for name in ("all", "estimator", "read"):
                targets._measured(mode, name)  # type: ignore[arg-type]
    counts = {key: ranged.count(key) for key in set(ranged)}
    for way in ("_by_line", "_by_time"):
        assert (counts[way, "all"], counts[way, "estimator"], counts[way, "read"]) == (1, 1, 2)
    # The whole is the one that was loaded; what is made besides reuses it, before its plate.
    assert all(reuse is targets.lit for _, reuse in made[1:])
    assert {told.scene for told, _ in made[1:]} == {plates[4.0]}
    assert not [told for told, _ in made[1:] if told.name == "all"]


def test_too_few_ranges_make_no_row() -> None:
    none = np.array([[1.0, math.nan, math.nan]])
    for found in (
        budget._row("read", none),
        budget._row_of_more(none, none),
        budget._row_of_more(np.ones((1, 3)), none),
    ):
        assert all(math.isnan(one) for one in found[:3])
        assert found[3] == 0


def test_closed_forms_of_a_budget_stand_beside_its_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: each row gets the number of its way, source and range, or none; the ends of speckle follow where there is
    any."""
    rows = [
        BudgetRow(mode, source, R, math.nan, 1.0, 0.9, 1.1, 9)  # type: ignore[arg-type]
        for mode, source in (("triangulation", "read"), ("tof", "clock"), ("tof", "unknown"))
        for R in (4.0, 9.0)
    ]
    monkeypatch.setattr(
        instrument, "closed_budget",
        lambda told, grey, R: {"triangulation": {"read": 10.0 * grey * R}, "tof": {"clock": R + 0.5}},
    )  # fmt: skip
    monkeypatch.setattr(instrument, "_ends_of_speckle", lambda numbers, ranges: [("ends", tuple(ranges))])
    found = instrument.with_closed_forms(rows, scenario(), 0.3)
    analytic = [row.analytic_m for row in found[:6]]
    assert analytic[:4] == pytest.approx([12.0, 27.0, 4.5, 9.5])
    assert all(math.isnan(one) for one in analytic[4:])
    assert found[6:] == (("ends", (4.0, 9.0)),)
    even = instrument.with_closed_forms(rows, scenario(scanner={"laser": {"speckle": False}}), 0.3)
    assert len(even) == 6


def known(sigma: Array) -> Calibration:
    return Calibration(np.zeros(len(NAMES)), np.diag(sigma**2), design_of(load_scanner("nrc_2000")))


def test_instruments_of_three_kinds_differ_in_what_is_built_and_believed(
    repo_root: Path, tmp_path: Path
) -> None:
    """Claim: the perfect one is built as designed and believes nothing; the others are built alike, and one of them has
    the calibration."""
    task = Task(quick=True, device="cpu", repository=repo_root)
    text = calibration_text(
        known(1e-6 * np.eye(len(NAMES))[INDEX["base"]]), load_scanner("nrc_2000"), "a field"
    )
    made: Any = SimpleNamespace(
        built=built_instruments.built_text(built_instruments.tolerances()), calibration=text
    )
    found = as_built._scenarios(task, made, as_built._PLATE, tmp_path)
    assert list(found) == ["perfect", "calibrated", "uncalibrated"]
    assert {kind: one.processing.calibration is not None for kind, one in found.items()} == {
        "perfect": False, "calibrated": True, "uncalibrated": False,
    }  # fmt: skip
    perfect, one, other = (found[kind].scanner.as_built for kind in found)
    assert perfect is None or not perfect.parameters(1).any()
    assert one is not None
    assert one.parameters(1)[INDEX["base"]] == other.parameters(1)[INDEX["base"]] != 0.0
    assert {scenario.seed for scenario in found.values()} == {task.seed}


def test_what_is_left_of_an_instrument_is_its_calibrations_covariance(
    repo_root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: nothing of the perfect one, the covariance of the adjustment, and the squares of the tolerances; the true
    parameters are those of the instrument that was drawn."""
    task = Task(quick=True, device="cpu", repository=repo_root, seed=2001)
    left = np.arange(len(NAMES)) * 1e-6
    asked: list[Any] = []

    def sighted(setup: Any, device: str) -> Any:
        asked.append(setup)
        return "sightings", None

    monkeypatch.setattr(built_instruments, "simulated_sightings", sighted)
    adjusted = known(left)
    adjusted = Calibration(left + 1.0, adjusted.covariance, adjusted.design)
    monkeypatch.setattr(
        built_instruments, "self_calibrate", lambda setup, found: SimpleNamespace(calibration=adjusted)
    )
    monkeypatch.setattr(built_instruments, "calibration_text", lambda *given: given[2])
    made = built_instruments.built_instruments(task)
    (setup,) = asked
    given = built_instruments.tolerances().given
    assert setup.plan.seed == 2001
    assert setup.plan.parameters.given == given
    for kind, sigma in (
        ("perfect", np.zeros(len(NAMES))),
        ("calibrated", left),
        ("uncalibrated", np.array([given.get(name, 0.0) for name in NAMES])),
    ):
        believed: Any = made.believed[kind]  # type: ignore[index]
        np.testing.assert_allclose(believed.covariance, np.diag(sigma**2), atol=1e-30)
        assert not believed.values.any()
    np.testing.assert_array_equal(made.true, setup.base.scanner.as_built.parameters(setup.base.seed))
    # Drawn from the tolerances: none beyond five of them.
    for name, sigma in given.items():
        assert 0.0 < abs(made.true[INDEX[name]]) < 5.0 * sigma
