"""How fast patterns are measured and followed: in the dark, under the Sun, and under the Sun with a moving target.

Run as ``python benchmarks/patterns.py [--visits N]``. A black disc of 100 mm at 10 m, patterns of 128 points, the whole
instrument. The instrument itself makes 151 patterns a second. "measure" is light, sensor, peaks and ranges alone;
"visit" is a turn of the closed loop: mirrors, measurement, centroid, tracker and record. "Best" is the quickest 2 %:
what a machine does that has nothing else to do; the mean holds all that happened, the rendering of windows of the
background included.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from scanner_sim.config import load_scenario
from scanner_sim.instrument.closed_loop.frozen_instrument import FrozenInstrument
from scanner_sim.instrument.closed_loop.tracker import Tracker
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.render.device import activate
from scanner_sim.scan.protocol import Aim

Array = NDArray[np.float64]

AMPLITUDE, DWELL, PERIOD = 8e-3, 50e-6, 6.6e-3
BEST = 0.02
"""Share of the calls that are as quick as the best, or quicker."""
SUN = {"sun": {"direction": [-0.35, -0.45, -0.8]}, "earth": {"direction": [0.0, 1.0, 0.0]}}
CASES: dict[str, tuple[dict[str, Any], float]] = {
    "dark": ({}, 0.0),
    "Sun and Earth": ({"lighting": SUN}, 0.0),
    "Sun and Earth, 10 mm/s": ({"lighting": SUN}, 0.01),
}


def scenario(changes: dict[str, Any], speed: float) -> Any:
    wall = {"name": "wall", "shape": "rectangle", "position": [0.0, 0.0, 10.0], "size": [8.0, 8.0]}
    disc = {"name": "disc", "shape": "disc", "position": [0.0, 0.0, 9.999], "diameter": 0.1}
    if speed:
        disc["motion"] = {"type": "twist", "velocity": [speed, 0.0, 0.0]}
    return load_scenario(
        {
            "schema": 1,
            "seed": 3,
            "scanner": {"preset": "nrc_2000"},
            "scene": {
                "objects": [
                    wall | {"material": {"reflectance": 0.8}},
                    disc | {"material": {"reflectance": 0.05}},
                ]
            },
            "scan": {
                "type": "track",
                "duration": 3600.0,
                "targets": [{"target": "disc", "kind": "black"}],
            },
            "processing": {"range_gate": [9.5, 10.5]},
            **changes,
        }
    )


def pattern(number: int, points: int = 128) -> Aim:
    """A 3:2 pattern of 8 mrad about the target."""
    phase, first = 2.0 * np.pi * (np.arange(points) + 0.5) / points, number * points
    return Aim(
        shot=np.arange(first, first + points, dtype=np.uint32),
        theta=AMPLITUDE * np.sin(3.0 * phase),
        phi=AMPLITUDE * np.sin(2.0 * phase),
        time=number * PERIOD + np.arange(points) * DWELL,
        travel_theta=AMPLITUDE * 6.0 * np.pi / points * np.cos(3.0 * phase),
        travel_phi=AMPLITUDE * 4.0 * np.pi / points * np.cos(2.0 * phase),
    )


def seconds(call: Callable[[int], object], count: int) -> Array:
    """Return how long each of the last calls took, after a tenth as many."""
    taken = []
    for number in range(count + count // 10):
        begun = time.perf_counter()
        call(number)
        taken.append(time.perf_counter() - begun)
    return np.array(taken[count // 10 :])


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--visits", type=int, default=1000, help="patterns that are timed")
    visits = arguments.parse_args().visits
    activate("cpu")
    columns = (
        "measure, best [ms]",
        "visit, best [ms]",
        "visits, best [1/s]",
        "visits, mean [1/s]",
        "windows [1/s]",
    )
    table = Table("patterns of 128 points", *columns)
    for name, (changes, speed) in CASES.items():
        known = scenario(changes, speed)
        bench = FrozenInstrument(Instrument(known, device="cpu"))
        measured = seconds(lambda number, bench=bench: bench.measure(pattern(number)), visits)
        windows = f"{bench.windows[0].rendered / (1.1 * visits * PERIOD):.1f}" if bench.windows else "–"
        tracker = Tracker(known, device="cpu")
        taken = seconds(lambda _, tracker=tracker: next(tracker), visits)
        table.add_row(
            name,
            f"{1e3 * np.quantile(measured, BEST):.2f}",
            f"{1e3 * np.quantile(taken, BEST):.2f}",
            f"{1.0 / np.quantile(taken, BEST):.0f}",
            f"{1.0 / taken.mean():.0f}",
            windows,
        )
    Console().print(table)


if __name__ == "__main__":
    main()
