"""Small tables of campaigns: best values, faults by frequency, tries by method, windows over targets."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from scanner_sim.campaign import store
from scanner_sim.campaign.approach import light, results
from scanner_sim.campaign.batches import FEWEST_RUNS, Batches
from scanner_sim.campaign.dataset.shards import row_bytes
from scanner_sim.campaign.measures import MEASURES
from scanner_sim.campaign.report import _faults, _verdict
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.approach import EpochRow


def test_the_best_value_of_a_measure_is_that_of_a_perfect_instrument() -> None:
    """Claim: no errors, σ, losses or false returns; errors that are one σ; 95 % covered; χ² of six; all of a share."""
    kinds = {"pull": 1.0, "coverage": 0.95, "share": 1.0, "mahalanobis": 6.0}
    for name, measure in MEASURES.items():
        wanted = next((best for kind, best in kinds.items() if kind in name.split("_")), 0.0)
        assert measure.best == wanted, name


def test_faults_are_counted_and_told_with_their_first_run() -> None:
    """Claim: the most frequent first; of equal ones by name, last first; runs without a fault do not count."""
    fault = np.array(["", "b", "a", "b", "c", "", "b", "a"])
    assert _faults({"fault": fault, "run": np.arange(10, 18)}) == [(3, "b", 11), (2, "a", 12), (1, "c", 14)]
    assert _faults({}) == []
    many = {"fault": np.array([f"fault {n}" for n in range(40)]), "run": np.arange(40)}
    assert len(_faults(many)) < 40


@pytest.mark.parametrize(
    ("change", "median", "said"),
    [
        (1.24, 10.0, ""),
        (0.49, 10.0, "slight: 0.49 mm (4.9 % of the median)"),
        (0.51, 10.0, ""),
        (5.0, 0.0, ""),
    ],
)
def test_a_change_is_slight_below_a_twentieth_of_the_median(change: float, median: float, said: str) -> None:
    one: Any = SimpleNamespace(interval=1.0, dead=False, change=change, seen=0.5)
    assert _verdict(one, "mm", median) == said


def test_what_would_have_been_seen_is_told_as_a_share_of_the_median() -> None:
    one: Any = SimpleNamespace(interval=1.0, dead=True, change=0.0, seen=0.5)
    assert "0.5 mm (5.0 % of the median) would" in _verdict(one, "mm", -10.0)
    assert "0.5 mm (20 % of the median) would" in _verdict(one, "mm", 2.5)
    assert "one of 0.5 would" in _verdict(one, "1", 0.0)
    one.interval = math.nan
    assert _verdict(one, "mm", 1.0) == "too few runs to tell"


@pytest.mark.parametrize("methods", [("joint",), ("uv", "joint_tof")])
def test_tries_are_listed_method_by_method(methods: tuple[str, ...]) -> None:
    """Claim: each method has the runs of its ranging, at the epoch of their point, with the columns of its poses; no
    status is the status of no result."""
    epochs = [
        EpochRow(n // 2, n % 2, 0.5 * n, 10.0 - n, f"array {n}", 0, "normal", 1.0, 1.0, 0.0) for n in range(4)
    ]
    rangings = ("triangulation", "tof")[: len(methods)]
    planned: Any = SimpleNamespace(approach=SimpleNamespace(methods=methods), rangings=rangings)
    runs = np.arange(8)
    table: dict[str, Any] = {
        "axis_0": runs % 4, "axis_1": runs // 4 % len(rangings), "repeat": runs // 4, "run": runs, "seed": 100 + runs,
    }  # fmt: skip
    for pose, base in (("uv", 1000.0), ("joint", 2000.0)):
        table[f"{pose}_status"] = np.where(runs == 5, math.nan, 0.0)
        for number, component in enumerate(("t_x", "t_y", "t_z", "omega_x", "omega_y", "omega_z")):
            table[f"{pose}_{component}"] = base + 10.0 * number + runs
            table[f"{pose}_{component}_sigma"] = -(base + 10.0 * number + runs)
    found = results._tries(planned, table, epochs)
    if methods == ("joint",):
        assert found["run"].tolist() == list(range(8))
        assert set(found["method"].tolist()) == {"joint"}
        np.testing.assert_allclose(found["t_y_error_m"], 2010.0 + runs)
        np.testing.assert_allclose(found["omega_z_sigma_rad"], -2050.0 - runs)
        assert found["status"][5] == results.NO_RESULT
        assert found["range_m"].tolist() == [10.0, 9.0, 8.0, 7.0] * 2
        assert found["orbit"].tolist() == [0, 0, 1, 1] * 2
    else:
        assert found["run"].tolist() == list(range(8))
        assert found["method"].tolist() == ["uv"] * 4 + ["joint_tof"] * 4
        np.testing.assert_allclose(found["t_x_error_m"], [1000, 1001, 1002, 1003, 2004, 2005, 2006, 2007])
        assert found["try"].tolist() == [0] * 4 + [1] * 4
        assert found["epoch"].tolist() == [0, 1] * 4


def test_errors_of_tries_are_those_of_valid_poses() -> None:
    """Claim: in the order of the components; (3, 4) mm are 5 mm, and 1.95 of 1.96 σ are covered."""
    names = ("t_x", "t_y", "t_z", "omega_x", "omega_y", "omega_z")
    status = np.array([PoseStatus.VALID, PoseStatus.VALID, PoseStatus.AMBIGUOUS, results.NO_RESULT])
    tries: dict[str, Any] = {
        "status": status,
        "method": np.array(["uv"] * 4),
        "condition": np.array([0, 0, 0, 0]),
    }
    sizes = (3e-3, 4e-3, 0.0, 1e-3, 2e-3, 2e-3)
    for name, size in zip(names, sizes, strict=True):
        unit = "m" if name.startswith("t") else "rad"
        tries[f"{name}_error_{unit}"] = size * np.array([1.0, -1.0, 99.0, 99.0])
        tries[f"{name}_sigma_{unit}"] = np.full(4, (size or 1.0) / 1.95)
    error, sigma = results.errors_of(tries, np.ones(4, dtype=bool))
    np.testing.assert_allclose(error, [sizes, -np.array(sizes)], atol=1e-15)
    assert sigma.shape == (2, 6)
    method: Any = SimpleNamespace(name="uv")
    row = results._by_condition(method, results.Condition(0), tries, [])  # type: ignore[arg-type]
    numbers = [value for value in vars(row).values() if isinstance(value, float)]
    assert any(value == pytest.approx(5e-3) for value in numbers)
    assert any(value == pytest.approx(3e-3) for value in numbers)
    assert numbers[-1] == 1.0
    assert results.share_interval(2, 4)[0] == 0.5
    # Clopper and Pearson's of none of ten: 1 − 0.025^(1/10).
    assert results.share_interval(0, 10) == pytest.approx((0.0, 0.0, 1.0 - 0.025**0.1))
    assert results.share_interval(10, 10) == pytest.approx((1.0, 0.025**0.1, 1.0))
    assert all(math.isnan(one) for one in results.share_interval(0, 0))


def test_the_light_is_that_over_the_patterns_on_the_targets() -> None:
    """Claim: from the outermost target to each side as far as a pattern goes: amplitude times the disc's radius, as an
    angle, times the aspect down."""

    def target(theta: float, phi: float, distance: float, diameter: float) -> Any:
        return SimpleNamespace(
            expected=np.array([theta, phi, distance]), appearance=SimpleNamespace(diameter=diameter)
        )

    following = SimpleNamespace(
        pattern=SimpleNamespace(aspect=0.5), tracker=SimpleNamespace(track_amplitude=1.6)
    )
    targets = [target(-0.1, 0.05, 10.0, 0.1), target(0.2, -0.03, 5.0, 0.2)]
    made = light._around(SimpleNamespace(following=following, targets=targets))  # type: ignore[arg-type]
    # 1.6 times 50 mm at 10 m and 100 mm at 5 m: 8 and 32 mrad.
    assert made.horizontal == pytest.approx((-0.108, 0.232))
    assert made.vertical == pytest.approx((-0.046, 0.054))
    assert (made.rows, made.columns) == (2, 2)


def test_the_light_on_an_array_is_that_of_its_track(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: condition, share in sunlight, the Sun's and the background of the array that is asked for, at the first
    moment; an array that is not there is not seen."""
    tracks = [
        SimpleNamespace(name="other", lit=[9.0], condition=[9], background=[9.0]),
        SimpleNamespace(name="near", lit=[0.25, 9.0], condition=[3, 9], background=[70.0, 9.0]),
    ]
    timeline = SimpleNamespace(tracks=tracks, sun_visible=[0.5, 9.0])
    monkeypatch.setattr(light, "_around", lambda _: None)
    monkeypatch.setattr(light, "sweep_orbit", lambda still, count, device: timeline if count == 1 else None)
    scenario: Any = SimpleNamespace(model_copy=lambda update: update)
    assert light._light_on(scenario, SimpleNamespace(array="near"), "cpu") == (3, 0.25, 0.5, 70.0)  # type: ignore[arg-type]
    assert light._light_on(scenario, SimpleNamespace(array="far"), "cpu")[0] == light.UNSEEN  # type: ignore[arg-type]


def test_epochs_are_rows_of_their_orbit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: points are listed orbit by orbit; an epoch is counted within its orbit."""
    points = [
        SimpleNamespace(orbit=orbit, epoch=SimpleNamespace(time=2.0 * n, distance=20.0 - n), array="near")
        for orbit in range(2)
        for n in range(3)
    ]
    planned: Any = SimpleNamespace(
        points=points,
        approach=SimpleNamespace(orbits=("a", "b")),
        rangings=("tof",),
        run=lambda number, ranging: (number, ranging),
        campaign=SimpleNamespace(scenario=lambda run: run),
    )
    asked: list[Any] = []

    def light_on(scenario: Any, point: Any, device: str) -> Any:
        asked.append(scenario)
        return light.UNSEEN if scenario[0] == 4 else 0, 0.5, 1.0, 7.0

    monkeypatch.setattr(light, "_light_on", light_on)
    told: list[Any] = []
    rows = light.epoch_rows(planned, device="cpu", progress=lambda *done: told.append(done))
    assert [(row.orbit, row.epoch, row.time_s, row.range_m) for row in rows] == [
        (orbit, n, 2.0 * n, 20.0 - n) for orbit in range(2) for n in range(3)
    ]
    assert rows[4].condition_name == "not seen"
    # In files this stands beside the numbers of the conditions.
    assert rows[4].condition == light.UNSEEN
    assert light.UNSEEN not in {int(one) for one in light.Condition}
    assert rows[0].condition_name != "not seen"
    assert asked == [(number, "tof") for number in range(6)]
    assert told == [(number + 1, 6) for number in range(6)]


class Scan(dict[str, Any]):
    """Layers of a scan; it counts as one even where it has none."""

    def __init__(self, pulls: Any, valid: Any = None) -> None:
        pulls = np.asarray(pulls, dtype=np.float64)
        sigma = np.linspace(1.0, 2.0, pulls.size)
        super().__init__(
            {
                "range_m": 1000.0 + pulls * sigma,
                "truth.range_m": np.full(pulls.size, 1000.0),
                "sigma_range_m": sigma,
            }
        )
        self.valid = np.ones(pulls.size, dtype=bool) if valid is None else np.asarray(valid)


def test_ranges_are_covered_within_ninety_five_per_cent_and_false_beyond_five_sigma() -> None:
    """Claim: what is within 1.96 σ is covered, by SciPy's quantile; what is beyond 5 σ, or of nothing, is no range of
    the surface: of all shots, but an invalid one tells nothing."""
    edge = norm.isf(0.025)
    covered, false = MEASURES["coverage"].value, MEASURES["false_returns"].value
    scan = Scan([0.0, 0.999 * edge, -0.999 * edge, 1.001 * edge, -1.001 * edge])
    assert covered(scan) == pytest.approx(0.6)
    scan = Scan([4.99, -4.99, 5.01, -5.01, 9.0, 0.0], np.array([1, 1, 1, 1, 0, 1], dtype=bool))
    assert false(scan) == pytest.approx(2.0 / 6.0)
    scan["truth.range_m"][5] = math.nan
    assert false(scan) == pytest.approx(3.0 / 6.0)
    assert covered(scan) == 0.0
    assert MEASURES["pull_range"].value(scan) == pytest.approx(math.sqrt((2 * 4.99**2 + 2 * 5.01**2) / 4.0))
    assert MEASURES["sigma_range"].value(scan) == pytest.approx(
        np.median(np.array([1.0, 1.2, 1.4, 1.6, 2.0]))
    )


@pytest.mark.parametrize(
    ("left", "workers", "most", "size"),
    [
        (1000, 4, 512, 125),
        (1001, 4, 512, 126),
        (1000, 4, 100, 100),
        (4 * 2 * FEWEST_RUNS, 4, 512, FEWEST_RUNS),
        (4 * 2 * FEWEST_RUNS - 8, 4, 512, FEWEST_RUNS),
        (4 * FEWEST_RUNS - 4, 4, 512, FEWEST_RUNS - 1),
        (3, 4, 512, 1),
        (10, 0, 512, max(5, min(10, FEWEST_RUNS))),
    ],
)
def test_a_batch_is_half_of_an_even_share_and_not_too_small(
    left: int, workers: int, most: int, size: int
) -> None:
    """Claim: half of what each worker would get, no more than go together, and the fewest that are worth it while there
    are as many for each."""
    batches = object.__new__(Batches)
    batches._left, batches._most = left, most
    assert batches._size(workers) == size


def test_layers_of_a_view_take_four_bytes_for_each_number() -> None:
    """Claim: of one row of 3 × 5 as much as of one of 15, and nothing of what has no length, or any."""
    fields: Any = [SimpleNamespace(shape=shape) for shape in ((3, 5), (15,), (1, 2), (), (-1, 9))]
    assert row_bytes(fields) == 4 * (15 + 15 + 2)


def test_axes_of_a_plan_are_named_by_their_key_or_their_number() -> None:
    plan: Any = SimpleNamespace(
        vary=[SimpleNamespace(keys=dict.fromkeys(keys)) for keys in ("a", "bc", "d", "ef")]
    )
    assert store.axis_names(plan) == ["a", "group_1", "d", "group_3"]
