"""The time of a visit where so many runs go side by side: the part of benchmarks/tracking.py that any checkout can run.

Run as ``python benchmarks/turns.py RUNS [--lit] [--threads N]`` with the checkout first on ``PYTHONPATH``. Prints
processor time and time by the clock of a visit [ms], the least of some turns, as JSON.
"""

from __future__ import annotations

import argparse
import importlib
import json
import time
from collections.abc import Callable
from typing import Any

import drjit as dr

from scanner_sim import Tracker, load_scenario

SUN = {"sun": {"direction": [-0.35, -0.45, -0.8]}, "earth": {"direction": [0.0, 1.0, 0.0]}}
_WARM, _VISITS, _FEWEST = 6, 160, 8


def scenario(seed: int, lit: bool) -> Any:
    """Return a run after a disc of 100 mm at 10 m that rests."""
    node = {"name": "node", "array": {"diameter": 0.1, "plate": 0.4}, "position": [0.0, 0.0, 10.0]}
    scan = {"type": "track", "targets": ["node"], "duration": 3600.0}
    whole = {"schema": 1, "seed": seed, "scene": {"objects": [node]}, "scan": scan}
    return load_scenario(whole | ({"lighting": SUN} if lit else {}))


def turns(count: int, lit: bool) -> Callable[[], Any]:
    """Return what makes the next visit of each of so many runs."""
    known = [scenario(seed, lit) for seed in range(count)]
    if count == 1:
        return Tracker(known[0]).__next__
    loop = "scanner_sim.instrument.closed_loop"
    visits = importlib.import_module(f"{loop}.visits").Visits(known)
    first = importlib.import_module(f"{loop}.saved_state").first_state
    states = [first(run.targets, run.following.tracker) for run in known]

    def turn() -> None:
        states[:] = [state for _, state in visits.after(states, range(count))]

    return turn


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("runs", type=int)
    asked.add_argument("--lit", action="store_true", help="under the Sun")
    asked.add_argument("--threads", type=int, default=1)
    given = asked.parse_args()
    turn = turns(given.runs, given.lit)
    dr.set_thread_count(given.threads)
    taken = []
    for _ in range(_WARM + max(_FEWEST, _VISITS // given.runs)):
        begun = time.process_time(), time.perf_counter()
        turn()
        taken.append((time.process_time() - begun[0], time.perf_counter() - begun[1]))
    cpu, clock = (1e3 * min(column) / given.runs for column in zip(*taken[_WARM:], strict=True))
    print(json.dumps({"cpu": cpu, "clock": clock}))


if __name__ == "__main__":
    main()
