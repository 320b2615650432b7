"""Self-calibrations by the whole chain: where the truth lies, what they are worth on held-out boards, what they cost.

Run as ``python benchmarks/selfcal.py --draws 200 --processes 2``, or ``make calibrate``; a draw takes some five
seconds of processor time. Each has an instrument of its own, drawn from the tolerances of the plan's scanner, and a
survey and noise of its own: light, detector, estimator and tracker make the sightings, and the adjustment sees nothing
else. Printed are the share of draws whose true parameters lie within the 95 % ellipsoid, with the bounds that the
binomial leaves a right program at the level of 10⁻⁴; means and scatter of the errors over σ; misfit of held-out boards
over pure noise; and how much of the misfit the calibration takes off boards that it was fitted to, and off the others.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import multiprocessing
import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom, chi2

from scanner_sim.calibration.selfcal import self_calibrate
from scanner_sim.calibration.setup import read_setup
from scanner_sim.calibration.simulated import simulated_sightings
from scanner_sim.foundation.parameters import INDEX

Array = NDArray[np.float64]

PLAN = Path(__file__).parents[1] / "configs" / "calibration" / "two_boards.yaml"
LEVEL = 1e-4


@dataclass(frozen=True)
class Draw:
    """A calibration: errors of the parameters over σ, eᵀC⁻¹e, unit weight, misfits, processor time [s]."""

    names: tuple[str, ...]
    z: Array
    square: float
    unit_weight: float
    fitted: tuple[float, float]
    held_out: tuple[float, float, int]
    doubted: int
    cost: tuple[float, float]


def calibrated(plan: Path, seed: int) -> Draw:
    """Return what one drawn instrument is calibrated to."""
    setup = read_setup(plan)
    setup = replace(
        setup,
        base=setup.base.replace({"scanner.as_built.seed": seed}),
        plan=setup.plan.model_copy(update={"seed": seed}),
    )
    begin = time.process_time()
    table, _ = simulated_sightings(setup, device="cpu", threads=1)
    seen = time.process_time()
    found = self_calibrate(setup, table)
    cost = seen - begin, time.process_time() - seen
    truth, held = setup.base.scanner.as_built, found.held_out
    assert truth is not None
    assert held is not None
    error = found.values - truth.parameters(0)[[INDEX[name] for name in found.field.sought]]
    return Draw(
        found.field.sought,
        error / found.sigma,
        float(error @ np.linalg.solve(found.adjusted.covariance, error)),
        found.adjusted.unit_weight,
        (found.fitted.designed, found.fitted.calibrated),
        (held.designed, held.calibrated, 3 * held.targets - 6 * held.views),
        len(found.doubted),
        cost,
    )


def report(draws: list[Draw]) -> None:
    """Print what draws have in common."""
    count, freedom = len(draws), len(draws[0].names)
    square = np.array([one.square for one in draws])
    inside = int((square < chi2.ppf(0.95, freedom)).sum())
    low, high = binom.ppf(0.5 * LEVEL, count, 0.95), binom.isf(0.5 * LEVEL, count, 0.95)
    print(
        f"within the 95 % ellipsoid: {inside} of {count}, {inside / count:.1%}; bounds {low:.0f} to {high:.0f}"
    )
    spread = np.sqrt(2.0 / (count * freedom))
    print(
        f"mean of the squared error over its {freedom} degrees: {square.mean() / freedom:.3f} ± {spread:.3f}"
    )
    z = np.stack([one.z for one in draws])
    for name, mean, scatter in zip(draws[0].names, z.mean(axis=0), z.std(axis=0, ddof=1), strict=True):
        print(f"  {name:14} mean {mean:+.2f} ± {count**-0.5:.2f} σ, scatter {scatter:.2f} σ")
    print(f"unit weight: {np.mean([one.unit_weight for one in draws]):.3f}")
    print(f"doubted sightings: {np.mean([one.doubted for one in draws]):.2f} of a calibration")
    for name, pairs in (
        ("fitted", [one.fitted for one in draws]),
        ("held-out", [one.held_out[:2] for one in draws]),
    ):
        designed, left = (float(np.sqrt(np.mean(np.square(column)))) for column in zip(*pairs, strict=True))
        gain = float(np.mean([1.0 - after / before for before, after in pairs]))
        told = f"{designed:.2f} as designed, {left:.3f} calibrated; gain {gain:.1%}"
        print(f"misfit of {name} boards over pure noise: {told}")
    sightings, adjustment = (sum(one.cost[part] for one in draws) / count for part in (0, 1))
    print(f"processor time of a calibration: {sightings:.2f} s sightings, {adjustment:.2f} s adjustment")


def main() -> None:
    """Draw, calibrate, report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--plan", type=Path, default=PLAN, help="a plan whose sightings are simulated")
    parser.add_argument("--draws", type=int, default=200, help="instruments to be drawn")
    parser.add_argument("--first", type=int, default=1, help="seed of the first one")
    parser.add_argument("--processes", type=int, default=2, help="processes side by side, of one thread each")
    chosen = parser.parse_args()
    begin, draws = time.perf_counter(), []
    with multiprocessing.get_context("spawn").Pool(chosen.processes) as pool:
        seeds = range(chosen.first, chosen.first + chosen.draws)
        for draw in pool.imap(partial(calibrated, chosen.plan), seeds):
            draws.append(draw)
            print(f"\r{len(draws)} of {chosen.draws}", end="", flush=True)
    print(f"\r{chosen.draws} draws, seeds from {chosen.first}, in {time.perf_counter() - begin:.0f} s")
    report(draws)


if __name__ == "__main__":
    main()
