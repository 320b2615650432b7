"""Sobol's indices of a campaign: against a function whose indices are known, and where runs are missing."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray
from scipy import stats

from scanner_sim import open_campaign
from scanner_sim.campaign import result as result_module
from scanner_sim.campaign.reading import read_campaign
from scanner_sim.campaign.result import CampaignResult
from scanner_sim.campaign.runs import Campaign
from scanner_sim.campaign.sensitivity import Indices, design_of, indices_of, pages_of, seeded_as
from scanner_sim.campaign.store import Row, column_of, opened
from scanner_sim.foundation.errors import InputError

KEYS = ("scanner.laser.power", "processing.threshold", "scanner.receiver.focal_length")
PLAN = """\
schema: 1
base: small.yaml
seed: 5
vary:
  - keys: {scan.rows: [4, 6]}
  - keys:
      scanner.laser.power: {uniform: [5 mW, 15 mW]}
      processing.threshold: {uniform: [5, 7]}
      scanner.receiver.focal_length: {uniform: [90 mm, 110 mm]}
    sample: saltelli
    count: 256
measure: [sigma_range, coverage]
"""
ENDS = np.array([[5e-3, 15e-3], [5.0, 7.0], [0.09, 0.11]])
LEVEL = 1e-4


def ishigami(angles: np.ndarray) -> np.ndarray:
    """Return the function of Ishigami and Homma (1990) of angles from −π to π, shape (…, 3)."""
    x, y, z = np.moveaxis(angles, -1, 0)
    return np.sin(x) + 7.0 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)


def ishigami_indices(noise: float) -> tuple[np.ndarray, np.ndarray]:
    """Return first and total order of the three angles and of a noise of a variance, in closed form."""
    alone = np.array([0.5 * (1.0 + 0.1 * math.pi**4 / 5.0) ** 2, 49.0 / 8.0, 0.0, noise])
    together = 0.01 * math.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    whole = alone.sum() + together
    return alone / whole, (alone + np.array([together, 0.0, together, 0.0])) / whole


def angles_of(campaign: Campaign) -> np.ndarray:
    """Return the three keys at each point of the design as angles from −π to π, shape (points, 3)."""
    points = [campaign.points(1).at(point) for point in range(campaign.plan.shape[1])]
    values = np.array([column_of(campaign, key, [point[key] for point in points]) for key in KEYS]).T
    return math.pi * (2.0 * (values - ENDS[:, 0]) / np.ptp(ENDS, axis=1) - 1.0)


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory, small_scenario: str) -> Campaign:
    folder = tmp_path_factory.mktemp("campaign")
    (folder / "small.yaml").write_text(small_scenario, encoding="utf-8")
    (folder / "plan.yaml").write_text(PLAN, encoding="utf-8")
    return read_campaign(folder / "plan.yaml")


def test_indices_of_a_campaign_are_those_of_its_function(campaign: Campaign, tmp_path: Path) -> None:
    """Claim: rows whose measure is Ishigami's function, with a noise of the run's seed, have its indices.

    Set-up: 256 rows for each of two values of another axis; with the second there is no noise. The intervals are those
    of the bootstrap, taken as normal; Sobol's points err less, so that the bound at a level of 1e-4 for all 16 figures
    is on the safe side. Widest, it is ±0.4, for the total order of the first angle; for the seed's ±0.1.
    """
    noise = 3.0
    known = ishigami(angles_of(campaign))
    with opened(tmp_path / "out", campaign, campaign.plan.measure) as store:
        for run in range(len(campaign)):
            scatter = np.random.default_rng(campaign.seed(run)).normal(0.0, math.sqrt(noise))
            value = known[campaign.place(run)[1]]
            value += scatter if campaign.place(run)[0] == 0 else 0.0
            store.add(Row(run, campaign.seed(run), "", 0.1, {"sigma_range": value, "coverage": 0.95}))
        store.pack()
    result = open_campaign(tmp_path / "out")
    found = result.sensitivity("sigma_range")
    assert found["key"].values.tolist() == [*KEYS, "seed"]
    assert found["scan.rows"].values.tolist() == [4.0, 6.0]
    bound = stats.norm.isf(0.5 * LEVEL / 16)
    for place, variance in enumerate((noise, 0.0)):
        for name, expected in zip(("first_order", "total_order"), ishigami_indices(variance), strict=True):
            ends = found[f"{name}_interval"].values[place]
            error = found[name].values[place] - expected
            sigma = np.ptp(ends, axis=1) / (2.0 * stats.norm.ppf(0.975))
            assert (np.abs(error) <= bound * sigma + 1e-12).all(), (name, place, error, sigma)
            assert bound * sigma.max() < 0.4
    assert found["total_order"].values[1, 3] == 0.0, "without noise the seed does nothing"
    constant = result.sensitivity("coverage")
    assert np.isnan(constant["total_order"]).all(), "nothing scatters, so there are no shares"
    array = result.to_xarray()
    assert array["sigma_range"].shape == (2, 1536, 1)
    assert array["design"].values[:6].tolist() == list(pages_of(KEYS))
    assert array["design_row"].values[[0, 5, 6, 1535]].tolist() == [0, 0, 1, 255]
    figure = result.plot_sensitivity("sigma_range")
    assert len(figure.axes) == 2


def test_a_row_shares_its_seed_and_all_values_but_one(campaign: Campaign) -> None:
    first, second = (np.random.default_rng(seed).random((4, 3)) for seed in (1, 2))
    rows = design_of(first, second).reshape(4, 6, 3)
    assert (rows[:, [0, 5]] == first[:, None]).all()
    assert (rows[:, 1] == second).all()
    for key in range(3):
        others = [one for one in range(3) if one != key]
        assert (rows[:, 2 + key, key] == second[:, key]).all()
        assert (rows[:, 2 + key, others] == first[:, others]).all()
    assert [seeded_as(point, 3) for point in range(6, 12)] == [6, 7, 6, 6, 6, 7]
    seeds = [campaign.seed(run) for run in range(12)]
    assert seeds[0] == seeds[2] == seeds[4]
    assert seeds[1] == seeds[5]
    assert len(set(seeds)) == 4


def test_rows_with_a_failed_run_are_left_out_together() -> None:
    """Claim: the indices are those of the whole rows alone, by the estimators' own formulas, to the last digits."""
    rng = np.random.default_rng(3)
    angles = math.pi * (2.0 * design_of(*rng.random((2, 64, 3))) - 1.0)
    values = ishigami(angles).reshape(64, 6) + 100.0
    gaps = values.copy()
    gaps[[3, 9, 60], [0, 4, 5]] = np.nan
    found = indices_of(gaps, 1)
    whole = np.delete(values, [3, 9, 60], axis=0)
    centred = whole - whole[:, :2].mean()
    a, b, others = centred[:, 0], centred[:, 1], centred[:, 2:].T
    variance = centred[:, :2].var()
    assert (found.rows, found.left_out) == (61, 3)
    assert found.first == pytest.approx((b * (others - a)).mean(axis=1) / variance, abs=1e-12)
    assert found.total == pytest.approx(0.5 * ((others - a) ** 2).mean(axis=1) / variance, abs=1e-12)
    few = indices_of(np.where(np.arange(64)[:, None] < 15, values, np.nan), 1)
    assert (few.rows, few.left_out, bool(np.isnan(few.total).all())) == (15, 49, True)


def test_a_plan_without_the_design_has_no_indices(
    campaign: Campaign, small_scenario: str, tmp_path: Path
) -> None:
    (tmp_path / "small.yaml").write_text(small_scenario, encoding="utf-8")
    (tmp_path / "plan.yaml").write_text("schema: 1\nbase: small.yaml\nrepeat: 2\n", encoding="utf-8")
    with opened(tmp_path / "plain", read_campaign(tmp_path / "plan.yaml"), ["sigma_range"]):
        pass
    with pytest.raises(InputError, match="need Saltelli's design"):
        open_campaign(tmp_path / "plain").sensitivity("sigma_range")
    with opened(tmp_path / "design", campaign, campaign.plan.measure):
        pass
    with pytest.raises(KeyError, match="there are sigma_range, coverage"):
        open_campaign(tmp_path / "design").sensitivity("sigma")
    assert np.isnan(open_campaign(tmp_path / "design").sensitivity("coverage")["first_order"]).all()


def test_indices_stand_under_their_names_and_repetitions_are_averaged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Claim: of a design behind another axis the estimator is asked of the mean over the repetitions, place by place of
    that axis, a row of the design in a row; first and total orders have each their own interval."""
    keys = {"a": None, "b": None}
    vary = [
        SimpleNamespace(sample="random", keys={"c": None}, count=None),
        SimpleNamespace(sample="saltelli", keys=keys, count=2),
    ]
    plan = SimpleNamespace(vary=vary, seed=3)
    made: Any = object.__new__(CampaignResult)
    made._store = SimpleNamespace(campaign=SimpleNamespace(plan=plan))
    pages = len(pages_of(("a", "b")))
    values = np.random.default_rng(1).normal(size=(3, 2 * pages, 4))
    asked: list[np.ndarray] = []

    def indices(given: np.ndarray, seed: int) -> Indices:
        asked.append(given)
        base, n = 100.0 * len(asked), np.arange(3.0)
        ends = np.stack([n, n + 10.0], axis=1)
        return Indices(base + n, base + 20.0 + n, base + 30.0 + ends, base + 50.0 + ends, len(asked), 7)

    monkeypatch.setattr(result_module, "indices_of", indices)
    monkeypatch.setattr(CampaignResult, "measured", lambda self, name: values)
    monkeypatch.setattr(
        CampaignResult, "to_xarray", lambda self: xarray.Dataset(coords={"c": [4.0, 5.0, 6.0]})
    )
    found = made.sensitivity("m")
    np.testing.assert_allclose(np.array(asked), values.mean(axis=2).reshape(3, 2, pages))
    place, n = 100.0 * np.arange(1.0, 4.0)[:, None], np.arange(3.0)
    ends = np.stack([n, n + 10.0], axis=1)
    np.testing.assert_array_equal(found["first_order"], place + n)
    np.testing.assert_array_equal(found["total_order"], place + 20.0 + n)
    np.testing.assert_array_equal(found["first_order_interval"], place[..., None] + 30.0 + ends)
    np.testing.assert_array_equal(found["total_order_interval"], place[..., None] + 50.0 + ends)
    assert found["first_order_interval"].dims == ("c", "key", "end")
    assert (found["rows"].values.tolist(), found["rows_left_out"].values.tolist()) == ([1, 2, 3], [7, 7, 7])
    assert (found["key"].values.tolist(), found["c"].values.tolist()) == (["a", "b", "seed"], [4.0, 5.0, 6.0])
