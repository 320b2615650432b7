"""Sobol's indices of simulated campaigns: against the closed form of the error budget, and against OpenTURNS."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import openturns
import pytest
from scipy import stats

from scanner_sim import open_campaign
from scanner_sim.analytic.budget import range_budget
from scanner_sim.campaign.reading import read_campaign
from scanner_sim.campaign.sensitivity import design_of, indices_of
from scanner_sim.campaign.serial import run_serially
from scanner_sim.campaign.store import opened
from scanner_sim.campaign.work import Settings
from scanner_sim.config.scenario import Scenario
from scanner_sim.validation.compare.instrument import instrument_of

Array = np.ndarray

ROWS = 64
PLAN = """\
schema: 1
base: CONFIGS/plane.yaml
set:
  scan: {type: raster, rows: 8, columns: 8, horizontal: [-1 deg, 1 deg], vertical: [-1 deg, 1 deg], motion: stepped}
  scanner.laser.speckle: false
  processing.speckle_contrast: 0
  output.pictures: false
seed: 1
vary:
  - keys:
      scanner.laser.power: {uniform: [5 mW, 15 mW]}
      scanner.receiver.aperture: {uniform: [15 mm, 25 mm]}
      scene.objects.plane.position[2]: {uniform: [5 m, 9 m]}
    sample: saltelli
    count: 64
measure: [sigma_range]
"""
MIDDLE, HALF = np.array([0.01, 0.02, 7.0]), np.array([0.005, 0.005, 2.0])
LEVEL = 1e-4


def closed_sigma(base: Scenario, points: Array) -> Array:
    """Return σ of the range by the closed form at powers, apertures and distances, shape (points, 3) -> (points,)."""
    numbers = instrument_of(base, 0.5, math.radians(1.0))
    return np.array(
        [range_budget(replace(numbers, power=p, aperture=a), r)["all"] for p, a, r in points.tolist()]
    )


def exact_indices(base: Scenario) -> tuple[Array, Array]:
    """Return first and total order of the closed form, by Gauss's quadrature in six points of each key."""
    nodes, weights = np.polynomial.legendre.leggauss(6)
    weights = 0.5 * weights
    grid = np.stack(np.meshgrid(nodes, nodes, nodes, indexing="ij"), axis=-1).reshape(-1, 3)
    sigma = closed_sigma(base, MIDDLE + HALF * grid).reshape(6, 6, 6)
    mean = np.einsum("ijk,i,j,k", sigma, weights, weights, weights)
    whole = np.einsum("ijk,i,j,k", (sigma - mean) ** 2, weights, weights, weights)
    first, total = [], []
    for key in range(3):
        ordered = np.moveaxis(sigma, key, 0)
        alone = np.einsum("ijk,j,k->i", ordered, weights, weights)
        others = np.einsum("ijk,i->jk", ordered, weights)
        first.append(weights @ (alone - mean) ** 2 / whole)
        total.append(1.0 - weights @ (others - mean) ** 2 @ weights / whole)
    return np.array(first), np.array(total)


@pytest.mark.slow
@pytest.mark.usefixtures("device")
def test_the_indices_of_sigma_are_those_of_the_error_budget(repo_root: Path, tmp_path: Path) -> None:
    """Claim: what power, aperture and distance make of the scatter of σ is what the closed form says.

    Set-up: 64 rows of 6 runs of 64 voxels before a plane, without speckle, whose grain σ is told and not measured.
    Two comparisons. Within the intervals of the bootstrap, taken as normal, all six indices are those of the closed
    form by quadrature (at a level of 1e-4 for all; Sobol's points err less). And by the same estimator at the same
    points, where the sample cancels, they are those of the closed form within 0.03: the closed form is within 3 % of
    σ (`compare`), and an index within as much of the whole. The seed makes less than a hundredth.
    """
    (tmp_path / "plan.yaml").write_text(PLAN.replace("CONFIGS", str(repo_root / "configs")), encoding="utf-8")
    campaign = read_campaign(tmp_path / "plan.yaml")
    with opened(tmp_path / "out", campaign, campaign.plan.measure) as store:
        run_serially(store, Settings(tmp_path / "out", device="cpu"), lambda *_: None)
    result = open_campaign(tmp_path / "out")
    found, table = result.sensitivity("sigma_range"), result.table()
    bound = stats.norm.isf(0.5 * LEVEL / 6)
    exact = exact_indices(campaign.base)
    keys = list(campaign.plan.vary[0].keys)
    closed = closed_sigma(campaign.base, np.stack([table[key] for key in keys], axis=1)).reshape(ROWS, -1)
    same_points = indices_of(closed, 0)
    for name, expected, beside in zip(
        ("first_order", "total_order"), exact, (same_points.first, same_points.total), strict=True
    ):
        sigma = np.ptp(found[f"{name}_interval"].values, axis=1)[:3] / (2.0 * stats.norm.ppf(0.975))
        assert (np.abs(found[name].values[:3] - expected) <= bound * sigma).all(), name
        assert found[name].values[:3] == pytest.approx(beside[:3], abs=0.03), name
    assert found["total_order"].values[3] < 0.01
    assert int(found["rows"]) == ROWS


def ishigami_pages(rows: int, seed: int) -> Array:
    """Return Ishigami's function at a design of random points, shape (rows, 5): A, B, and each angle."""
    angles = math.pi * (2.0 * design_of(*np.random.default_rng(seed).random((2, rows, 3))) - 1.0)
    return ishigami(angles).reshape(rows, 6)[:, :-1]


def ishigami(angles: Array) -> Array:
    x, y, z = np.moveaxis(angles, -1, 0)
    return np.sin(x) + 7.0 * np.sin(y) ** 2 + 0.1 * z**4 * np.sin(x)


@pytest.mark.slow
def test_openturns_finds_the_same() -> None:
    """Claim: for one table of runs OpenTURNS gives the same indices, within 2/n.

    Its estimators of Mauntz and Kucherenko for the first order and of Jansen for the total have our sums, but divide by
    n − 1, and by the variance of A alone, where ours is that of A and B: by that ratio its indices are brought to ours.
    Its intervals, which scatter with that variance too, hold ours.
    """
    rows = 512
    values = ishigami_pages(rows, 4)
    ours = indices_of(np.concatenate([values, values[:, :1]], axis=1), 0)
    angles = math.pi * (2.0 * design_of(*np.random.default_rng(4).random((2, rows, 3))) - 1.0)
    pages = angles.reshape(rows, 6, 3)[:, :-1].transpose(1, 0, 2)
    points = openturns.Sample(np.ascontiguousarray(pages.reshape(-1, 3)))
    answers = openturns.Sample(np.ascontiguousarray(values.T.reshape(-1, 1)))
    openturns.RandomGenerator.SetSeed(1)
    first = openturns.MauntzKucherenkoSensitivityAlgorithm(points, answers, rows)
    total = openturns.JansenSensitivityAlgorithm(points, answers, rows)
    ratio = values[:, 0].var() / values[:, :2].var()
    assert ours.first[:3] == pytest.approx(ratio * np.array(first.getFirstOrderIndices()), abs=2.0 / rows)
    assert ours.total[:3] == pytest.approx(ratio * np.array(total.getTotalOrderIndices()), abs=2.0 / rows)
    for interval, found in (
        (first.getFirstOrderIndicesInterval(), ours.first[:3]),
        (total.getTotalOrderIndicesInterval(), ours.total[:3]),
    ):
        assert (np.array(interval.getLowerBound()) <= found).all()
        assert (found <= np.array(interval.getUpperBound())).all()


@pytest.mark.slow
def test_intervals_hold_the_indices_in_19_of_20_tables() -> None:
    """Claim: of 150 tables of independent points, the intervals of each index hold it in 95 %, the seed's too.

    Ends that are quantiles of resamples are known to hold a little less often than they say; down to 93 % is called
    right. The bound is the binomial distribution's at that share and a level of 1e-4 for all eight: intervals that hold
    in fewer than 78 % are found with 90 %.
    """
    tables, noise = 150, 1.0
    alone = np.array([0.5 * (1.0 + 0.1 * math.pi**4 / 5.0) ** 2, 49.0 / 8.0, 0.0, noise])
    together = 0.01 * math.pi**8 * (1.0 / 18.0 - 1.0 / 50.0) * np.array([1.0, 0.0, 1.0, 0.0])
    whole = alone.sum() + together[0]
    held = np.zeros((2, 4))
    for table in range(tables):
        values = ishigami_pages(256, table)
        seeds = np.random.default_rng([table, 1]).normal(0.0, math.sqrt(noise), (256, 2))
        values = np.concatenate([values, values[:, :1]], axis=1) + seeds[:, [0, 1, 0, 0, 0, 1]]
        found = indices_of(values, table)
        for order, (ends, expected) in enumerate(
            ((found.first_interval, alone), (found.total_interval, alone + together))
        ):
            held[order] += (ends[:, 0] <= expected / whole) & (expected / whole <= ends[:, 1])
    assert (held >= stats.binom.ppf(LEVEL / 8, tables, 0.93)).all(), held / tables
