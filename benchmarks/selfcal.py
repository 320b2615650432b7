"""Self-calibrations by the whole chain: where the truth lies, what they are worth on held-out boards, what they cost.

Run as ``python benchmarks/selfcal.py --draws 200 --processes 2``, or ``make calibrate``; a draw takes some five
seconds of processor time. Each has an instrument of its own, drawn from the tolerances of the plan's scanner, and a
survey and noise of its own: light, detector, estimator and tracker make the sightings, and the adjustment sees nothing
else. Printed are the share of draws whose true parameters lie within the 95 % ellipsoid, with the bounds that the
binomial leaves a right program at the level of 10⁻⁴; means and scatter of the errors over σ; misfit of held-out boards
over pure noise; and how much of the misfit the calibration takes off boards that it was fitted to, and off the others.
Two more figures tell the adjustment's faults from those of the sightings' σ: the sightings' own errors over what is
stated of them, and the same adjustment of the same field, whose errors are drawn exactly as stated.
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
from scipy.linalg import block_diag
from scipy.stats import binom, chi2

from scanner_sim.calibration.adjustment import Adjusted, adjust
from scanner_sim.calibration.network import Field, Sightings
from scanner_sim.calibration.selfcal import SelfCalibrated, self_calibrate
from scanner_sim.calibration.setup import Setup, field_of, read_setup
from scanner_sim.calibration.simulated import simulated_sightings
from scanner_sim.calibration.starts import start_of
from scanner_sim.foundation.parameters import INDEX
from scanner_sim.ranging.believed import VoxelReadings, believed_points

Array = NDArray[np.float64]

PLAN = Path(__file__).parents[1] / "configs" / "calibration" / "two_boards.yaml"
LEVEL = 1e-4
_STEPS = 6
"""Newton's, from readings that are good to a thousandth."""


@dataclass(frozen=True)
class Draw:
    """A calibration: errors of the parameters over σ, eᵀC⁻¹e, unit weight, misfits, mean square of the sightings'
    errors over what is stated of them (all at once, and by reading over σ), eᵀC⁻¹e with errors as stated, processor
    time [s]."""

    names: tuple[str, ...]
    z: Array
    square: float
    unit_weight: float
    fitted: tuple[float, float]
    held_out: tuple[float, float, int]
    doubted: int
    sightings: tuple[float, Array]
    as_stated: float
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
    parameters = truth.parameters(0)
    sought = [INDEX[name] for name in found.field.sought]
    error = found.values - parameters[sought]
    field = field_of(setup, table)
    exact = true_readings(setup, field, parameters)
    stated = replace(field.sightings, readings=_readings(exact + _drawn(field.sightings, seed), field))
    again = self_adjusted(found, replace(field, sightings=stated))
    other = again.unknowns.parameters[sought] - parameters[sought]
    return Draw(
        found.field.sought,
        error / found.sigma,
        float(error @ np.linalg.solve(found.adjusted.covariance, error)),
        found.adjusted.unit_weight,
        (found.fitted.designed, found.fitted.calibrated),
        (held.designed, held.calibrated, 3 * held.targets - 6 * held.views),
        len(found.doubted),
        misfit_of_sightings(field.sightings, exact),
        float(other @ np.linalg.solve(again.covariance, other)),
        cost,
    )


def true_readings(setup: Setup, field: Field, parameters: Array) -> Array:
    """Return (ϑ, φ, measured) that sightings without error have, shape (N, 3): the observation equation solved."""
    seen, targets = field.sightings, field.targets
    board, station = (
        np.stack([one.field_from_here() for one in several])
        for several in (setup.plan.boards, setup.plan.stations)
    )
    local = np.concatenate([np.array(list(places.values())) for places in setup.places.values()])
    before = np.linalg.inv(station)[seen.station] @ board[targets.board[seen.target]]
    point = np.einsum("nij,nj->ni", before[:, :3, :3], local[seen.target]) + before[:, :3, 3]
    readings = np.stack([seen.readings.theta, seen.readings.phi, seen.readings.measured], axis=1)
    for _ in range(_STEPS):
        found = believed_points(_readings(readings, field), field.design, parameters, field.encoder_period)
        readings = readings - np.linalg.solve(found.by_readings, (found.point - point)[..., None])[..., 0]
    return readings


def _readings(numbers: Array, field: Field) -> VoxelReadings:
    return VoxelReadings(*numbers.T, field.sightings.readings.by)


def _drawn(seen: Sightings, seed: int) -> Array:
    """Return errors of readings as they are stated, (N, 3)."""
    generator = np.random.default_rng(seed)
    shared = generator.normal(size=(seen.station.max() + 1, seen.common.shape[2]))
    own = np.einsum("nij,nj->ni", seen.root, generator.normal(size=(len(seen), 3)))
    return np.asarray(own + np.einsum("nik,nk->ni", seen.common, shared[seen.station]))


def self_adjusted(found: SelfCalibrated, field: Field) -> Adjusted:
    """Return the adjustment of a field without the boards and stations that a calibration had held out."""
    boards = np.isin(field.targets.boards, found.field.targets.boards)[
        field.targets.board[field.sightings.target]
    ]
    stations = np.isin(field.stations, found.field.stations)[field.sightings.station]
    kept = field.seeing(boards & stations)
    return adjust(kept, start_of(kept))


def misfit_of_sightings(seen: Sightings, exact: Array) -> tuple[float, Array]:
    """Return the mean square of errors over the root of their whole covariance, and of each reading's over its σ."""
    error = np.stack([seen.readings.theta, seen.readings.phi, seen.readings.measured], axis=1) - exact
    squares = 0.0
    for station in range(int(seen.station.max()) + 1):
        own = seen.station == station
        parts = list(seen.root[own])
        shared = seen.common[own].reshape(3 * len(parts), -1)
        whole = block_diag(*(part @ part.T for part in parts)) + shared @ shared.T
        squares += float(error[own].ravel() @ np.linalg.solve(whole, error[own].ravel()))
    return squares / error.size, ((error / seen.sigma) ** 2).mean(axis=0)


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
    square_as_stated = np.mean([one.as_stated for one in draws]) / freedom
    print(
        f"the same of an adjustment whose errors are drawn as stated: {square_as_stated:.3f} ± {spread:.3f}"
    )
    whole = np.array([one.sightings[0] for one in draws])
    by_reading = np.mean([one.sightings[1] for one in draws], axis=0)
    told = " ".join(f"{one:.3f}" for one in by_reading)
    print(
        f"mean square of the sightings' errors over what is stated: {whole.mean():.3f}, of ϑ, φ, measured: {told}"
    )
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
