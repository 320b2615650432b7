"""How honest the covariances of visits are whose patterns lie beside a far disc.

Run as ``python benchmarks/beside.py [--runs N] [--radii D ...] [--lean YAW PITCH] [--set KEY=VALUE]``. Each run has 36
black discs of 240 mm at 24 m, each visited once by a pattern of tracking that is put so many radii of the beam aside,
in a direction by lot. Mean squares of errors over σ, 1 where σ is true, with standard errors over the visits; those of
R have unlike pixels in common. The laser is off for half of each dwell.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim import Scenario, load_scenario, track_many
from scanner_sim.tracking.record import TrackStatus

SIDE, DISTANCE = 6, 24.0


def scenario(
    seed: int, aside: NDArray[np.float64], lean: tuple[float, float], changes: list[str]
) -> Scenario:
    """Return a run whose patterns begin aside of their discs by some angles (discs, 2) [rad]."""
    yaw, pitch = lean
    array = {"diameter": 0.24, "rows": SIDE, "columns": SIDE, "spacing": (0.8, 0.8), "plate": 0.7}
    turns = [{"axis": "y", "angle": yaw}, {"axis": "x", "angle": pitch}]
    far = {"name": "far", "array": array, "position": (0.0, 0.0, DISTANCE), "rotation": turns}
    targets = [
        {"target": f"far/{number}", "offset": (float(theta), float(phi), 0.0)}
        for number, (theta, phi) in enumerate(aside, 1)
    ]
    scan = {"type": "track", "targets": targets, "duration": 0.37, "tracker": {"search_amplitude": 1.22}}
    whole: dict[str, Any] = {"schema": 1, "seed": seed, "scene": {"objects": [far]}, "scan": scan}
    return load_scenario(whole | {"scanner": {"laser_off": 0.5}}, tuple(changes))


def main() -> None:
    """Print a row for each distance."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--runs", type=int, default=32)
    asked.add_argument("--radii", type=float, nargs="+", default=[0.0, 1.0, 2.0, 3.0])
    asked.add_argument("--lean", type=float, nargs=2, default=(0.08, -0.06), help="about y, then x [rad]")
    asked.add_argument("--set", action="append", default=[])
    given = asked.parse_args()
    random = np.random.default_rng(23)
    laser = scenario(1, np.zeros((SIDE**2, 2)), (0.0, 0.0), []).scanner.laser
    for radii in given.radii:
        turn = random.uniform(0.0, 2.0 * np.pi, SIDE**2)
        away = radii * laser.radius(DISTANCE) / DISTANCE
        aside = away * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        runs = [scenario(seed, aside, tuple(given.lean), given.set) for seed in range(1, given.runs + 1)]
        records = [record for made in track_many(runs, device="cpu") for record in made.records[: SIDE**2]]
        seen = [record for record in records if record.status is TrackStatus.MEASURED]
        square = np.array(
            [(record.position - record.truth) ** 2 / np.diagonal(record.covariance) for record in seen]
        )
        error = square.std(axis=0) / np.sqrt(len(square))
        cells = " | ".join(f"{a:.2f} ± {b:.2f}" for a, b in zip(square.mean(axis=0), error, strict=True))
        print(f"| {radii:g} radii | {len(seen)} of {len(records)} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
