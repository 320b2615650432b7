"""What visits of closed dockings err by: single visits over their σ, what lasts of it, and where it errs to one side.

Run as ``python benchmarks/docking_errors.py --seeds 12`` on the runs of ``docs/docking.py``: 30 s of a processor each.

Of tracked visits by range, means over the runs with their standard errors:

- z² of Θ, φ and R: 1 where σ is true;
- z outward, of errors away from the middle of the four discs along Θ and φ: 0;
- of angles, what the visits of a round have in common with those of later rounds, in the four ways in which errors of
  four discs are no shift: over the surfaces' part, by the steps of range over ``approach`` (and of roll over ``turn``)
  between them. A filter takes it for exp(−steps), which is printed below;
- beyond 19 m, eᵀC⁻¹e/3 by how many radii of the beam the pattern's middle lay from the target: 1.
"""

from __future__ import annotations

import argparse
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scanner_sim.tracking.record import PatternRecord, TrackStatus
from scanner_sim.tracking.state import TrackMode

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "docs"))
import docking

Array = NDArray[np.float64]

EDGES = np.array([24.0, 17.0, 11.0, 8.9, 6.0, 4.0, 2.5, 1.3])
STEPS = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0])
BESIDE = np.array([0.0, 0.1, 0.2, 0.4, 0.8, 1.5, 2.5, 4.0])
CORNER = {"1": (-1, -1), "2": (1, -1), "3": (-1, 1), "4": (1, 1)}


def main() -> None:
    """Fly, and print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--first", type=int, default=1)
    given = parser.parse_args()
    lights = list(docking.LIGHT)
    runs = []
    for seed in range(given.first, given.first + given.seeds):
        approach = docking.Approach(seed, lights[(seed - 1) % 3])
        approach.fly()
        runs.append([one for one in approach.records if tracked(one)])
        print(f"seed {seed}: {len(approach.records)} visits, {len(runs[-1])} tracked", flush=True)
    report(runs)


def tracked(record: PatternRecord) -> bool:
    """Return whether a visit measured a target that is followed."""
    return record.status is TrackStatus.MEASURED and record.after is TrackMode.TRACK


def report(runs: list[list[PatternRecord]]) -> None:
    """Print the tables of runs."""
    for number, (far, near) in enumerate(pairwise(EDGES.tolist())):
        some = [[one for one in run if near < one.truth[2] <= far] for run in runs]
        single = said([single_visits(one) for one in some if len(one) > 8])
        print(f"{far:5.1f} to {near:4.1f} m: z² {single[:3]}, outward {single[3:]}")
        rounds = [rounds_of(one) for one in some]
        shared = said([lasting(one) for one in rounds if len(one) > 3])
        print(f"{'':17}shared {shared}")
        if number == len(EDGES) - 2:
            print(f"{'':17}stated {np.round(np.exp(-0.5 * (STEPS[1:] + STEPS[:-1])), 2).tolist()}")
    far_off = [one for run in runs for one in run if one.truth[2] > 19.0]
    for (near, far), values in zip(pairwise(BESIDE.tolist()), beside(far_off), strict=True):
        print(f"{near} to {far} radii beside: {said([np.array([one]) for one in values])} of {len(values)}")


def said(values: list[Array]) -> list[str]:
    """Return means over runs with their standard errors, as text; nothing where there is no run."""
    if not values:
        return []
    known = [column[np.isfinite(column)] for column in np.array(values).T]
    return [
        f"{some.mean():.2f} ± {some.std() / np.sqrt(len(some)):.2f}" if len(some) else "none"
        for some in known
    ]


def beside(records: list[PatternRecord]) -> list[list[float]]:
    """Return eᵀC⁻¹e/3 of visits whose patterns lay so far beside their targets, a list for each two of ``BESIDE``."""
    found: list[list[float]] = [[] for _ in BESIDE[1:]]
    for one in records:
        error = one.position - one.truth
        place = int(np.searchsorted(BESIDE, np.hypot(*one.errors.offset), side="right")) - 1
        if place < len(found):
            found[place].append(float(error @ np.linalg.solve(one.covariance, error)) / 3.0)
    return found


def single_visits(records: list[PatternRecord]) -> Array:
    """Return mean z² of Θ, φ and R, and mean z outward along Θ and φ, shape (5,)."""
    z = np.array([(one.position - one.truth) / np.sqrt(np.diagonal(one.covariance)) for one in records])
    corner = np.array([CORNER[one.target.split("/")[1]] for one in records])
    return np.concatenate([(z**2).mean(axis=0), (z[:, :2] * corner).mean(axis=0)])


def rounds_of(records: list[PatternRecord]) -> list[list[PatternRecord]]:
    """Return visits to four targets one after another."""
    found, row = [], 0
    while row + 4 <= len(records):
        four = records[row : row + 4]
        whole = len({one.target for one in four}) == 4 and four[3].time - four[0].time < 0.3
        if whole:
            found.append(four)
        row += 4 if whole else 1
    return found


def lasting(rounds: list[list[PatternRecord]]) -> Array:
    """Return what rounds have in common of the angles' errors, over the surfaces' part, by steps between them."""
    values, parts, way = [], [], [0.0]
    for before, four in zip([rounds[0], *rounds[:-1]], rounds, strict=True):
        x, y = np.array([CORNER[one.target.split("/")[1]] for one in four]).T
        none = 0.0 * x
        modes = np.stack([np.stack(pair, axis=1) for pair in ((-y, x), (y, x), (x, none), (none, y))])
        error = np.array([(one.position - one.truth)[:2] for one in four])
        surface = np.array([one.errors.surface[:2, :2] for one in four])
        values.append((modes * error).sum(axis=(1, 2)))
        parts.append(np.einsum("kia,iab,kib->k", modes, surface, modes))
        nearer = abs(before[0].truth[2] - four[0].truth[2])
        way.append(
            way[-1]
            + nearer / float(four[0].errors.approach)
            + rolled(before, four) / float(four[0].errors.turn)
        )
    value, size, at = np.array(values), np.sqrt(parts), np.array(way[1:])
    one, other = np.triu_indices(len(at), 1)
    product = (value[one] * value[other] / (size[one] * size[other])).mean(axis=1)
    apart = at[other] - at[one]
    inside = [(apart >= low) & (apart < high) for low, high in pairwise(STEPS)]
    return np.array([product[some].mean() if some.any() else np.nan for some in inside])


def rolled(before: list[PatternRecord], four: list[PatternRecord]) -> float:
    """Return by how much the targets turned about the line of sight between two rounds [rad]."""

    def diagonal(some: list[PatternRecord]) -> float:
        where = {one.target.split("/")[1]: one.truth for one in some}
        across = where["4"] - where["1"]
        return float(np.arctan2(across[1], across[0]))

    return abs(diagonal(four) - diagonal(before))


if __name__ == "__main__":
    main()
