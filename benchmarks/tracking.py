"""What the closed loop can do: sixty seconds of four moving targets, the fastest target that is held, and how well.

Run as ``python benchmarks/tracking.py [--only minute|speed|accuracy|cost|runs] [--against CHECKOUT]``.

"minute": four targets of an object that moves by 10 mm/s and turns by 1 deg/s, for 60 s of its time: losses and
errors. "speed": a disc of 100 mm at 10 m accelerates over the field, until it is lost: at what speed, for one target,
for one of four, and for one with larger patterns. "accuracy": error of a single pattern against diameter, range and the
pattern's amplitude. "cost": processor time of a visit in one thread, with and without the Sun, and of its parts;
"runs": that of a visit where 1, 8 and 64 runs go side by side, and how many patterns that makes a second by the clock.
With another checkout of the program both in turns, and the ratios.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from scanner_sim import Scenario, Tracker, load_scenario
from scanner_sim.instrument.closed_loop import target_sensor as sensor_module
from scanner_sim.instrument.closed_loop import tracker as tracker_module
from scanner_sim.instrument.closed_loop.frozen_instrument import FrozenInstrument
from scanner_sim.instrument.closed_loop.records import Recorder
from scanner_sim.products.pictures.style import FAINT, house_style, save
from scanner_sim.render.frozen import Frozen
from scanner_sim.tracking.record import PatternRecord, TrackStatus
from scanner_sim.tracking.state import TrackMode

Array = NDArray[np.float64]

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "pictures" / "loss_of_track.png"
COLOURS = ("#0b4f8a", "#b4331a", "#d08a1d")
TURNS = Path(__file__).with_name("turns.py")
SUN = {"sun": {"direction": [-0.35, -0.45, -0.8]}, "earth": {"direction": [0.0, 1.0, 0.0]}}


def scenario(node: dict[str, Any], *overrides: str, seed: int = 4, **more: Any) -> Scenario:
    """Return a scenario that follows the array ``node``, whose other entries are given."""
    array = {"diameter": 0.1, "plate": 0.4} | node.pop("array", {})
    scan = {"type": "track", "targets": ["node"], "duration": 3600.0} | more.pop("scan", {})
    scene = {"objects": [{"name": "node", "array": array} | node]}
    return load_scenario({"schema": 1, "seed": seed, "scene": scene, "scan": scan} | more, overrides)


def errors(records: list[PatternRecord]) -> Array:
    """Return the errors of measured places, (records, 3)."""
    return np.array([r.position - r.truth for r in records if r.status == TrackStatus.MEASURED])


def minute(console: Console) -> None:
    """Follow four targets for a minute."""
    motion = {"type": "twist", "velocity": [0.01, 0.0, 0.0], "turn_rate": [0.0, 0.0, np.radians(1.0)]}
    square = {"rows": 2, "columns": 2, "spacing": [0.8, 0.8]}
    node = {"array": square, "position": [-0.3, 0.1, 9.0], "motion": motion}
    begun = time.perf_counter()
    records = list(Tracker(scenario(node, scan={"duration": 60.0})))
    took = time.perf_counter() - begun
    late = [record for record in records if record.time > 0.2]
    lost = sum(record.mode is not TrackMode.TRACK for record in late)
    refused = sum(record.status != TrackStatus.MEASURED for record in late)
    rms = np.sqrt((errors(late) ** 2).mean(axis=0))
    console.print(
        f"60 s, {len(records)} patterns in {took:.0f} s: {lost} outside of the mode track, {refused} not measured; "
        f"rms {1e6 * rms[0]:.1f} and {1e6 * rms[1]:.1f} µrad, {1e3 * rms[2]:.2f} mm"
    )


def loss_speed(acceleration: float, columns: int, *overrides: str, seed: int = 4) -> float:
    """Return the speed [rad/s] at which a target that accelerates evenly across the field is lost for good.

    The disc of 100 mm at 10 m starts at rest at Θ = −0.3 rad and crosses the field. Lost for good: five visits in a row
    without a measurement, the first of which counts; infinite where it leaves the field before.

    Parameters
    ----------
    acceleration
        Of the target [m/s²].
    columns
        Targets side by side on the object, which are visited in turn.
    overrides
        Of the scenario.
    seed
        Its seed.
    """
    times = np.linspace(0.0, (5.0 / acceleration) ** 0.5, 60)
    points = [
        {"time": float(t), "position": [-2.5 + 0.5 * acceleration * float(t) ** 2, 0.0, 10.0]} for t in times
    ]
    motion = {"type": "waypoints", "interpolation": "smooth", "points": points}
    array = {"columns": columns, "spacing": [0.45, 0.45]}
    tracker = Tracker(scenario({"array": array, "motion": motion}, *overrides, seed=seed))
    missed: list[float] = []
    for record in tracker:
        if record.target != "node/1":
            continue
        missed = [] if record.status == TrackStatus.MEASURED else [*missed, record.time]
        if len(missed) == 5:
            return acceleration * missed[0] / 10.0
        if record.time > times[-1]:
            break
    return float("inf")


def speed(console: Console) -> None:
    """Find the speeds at which targets are lost, and draw them to docs/pictures/loss_of_track.png."""
    accelerations = np.array([1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0])
    ways: dict[str, tuple[int, tuple[str, ...]]] = {
        "one target": (1, ()),
        "one of four": (4, ()),
        "one, pattern of 2.5 radii": (1, ("scan.tracker.track_amplitude=2.5",)),
    }
    found = {
        name: np.array([loss_speed(float(a), columns, *overrides) for a in accelerations])
        for name, (columns, overrides) in ways.items()
    }
    table = Table("acceleration", *ways)
    for row, acceleration in enumerate(accelerations):
        speeds = (f"{1e3 * values[row]:.0f} mrad/s" for values in found.values())
        table.add_row(f"{acceleration:g} m/s²", *speeds)
    console.print(table)
    draw_speeds(accelerations, found)


def draw_speeds(accelerations: Array, found: dict[str, Array]) -> None:
    """Draw the speed of loss against the acceleration; an arrow where the target left the field unlost."""
    with house_style():
        figure = Figure(figsize=(6.0, 3.6), dpi=150, layout="constrained")
        axes = figure.subplots()
        reached = np.sqrt(2.0 * accelerations * 5.0) / 10.0
        axes.loglog(accelerations, 1e3 * reached, color=FAINT, lw=0.8, ls="--", label="at the field's end")
        for (name, speeds), colour in zip(found.items(), COLOURS, strict=True):
            lost = np.isfinite(speeds)
            axes.loglog(
                accelerations[lost], 1e3 * speeds[lost], "-o", ms=3.0, lw=1.1, color=colour, label=name
            )
            axes.loglog(accelerations[~lost], 1e3 * reached[~lost], "^", ms=4.5, color=colour, mfc="none")
        axes.set(
            xlabel="acceleration of the target at 10 m [m/s²]", ylabel="angular speed at its loss [mrad/s]"
        )
        axes.set_xticks([1, 2, 3, 5, 8, 12, 20], ["1", "2", "3", "5", "8", "12", "20"])
        axes.set_yticks(marks := [50, 100, 200, 300, 400, 600, 800, 1200], [f"{mark}" for mark in marks])
        axes.minorticks_off()
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(which="major", color="#e3e6e9", lw=0.5)
        axes.set_axisbelow(True)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        axes.set_title("When a disc of 100 mm at 10 m is lost", loc="left", weight="bold", size=10.5)
        save(figure, PICTURE)


def accuracy(console: Console) -> None:
    """Measure single patterns against diameter, range and amplitude."""
    table = Table(
        "diameter", "range", "amplitude/radius", "σ stated Θ, φ", "rms error Θ, φ", "over the radius"
    )
    cases = [(d, 10.0, 1.22) for d in (0.05, 0.1, 0.2)] + [(0.1, r, 1.22) for r in (5.0, 15.0)]
    cases += [(0.1, 10.0, a) for a in (1.05, 1.15, 1.3, 1.6, 2.0, 3.0)]
    for diameter, distance, amplitude in cases:
        grid = {
            "rows": 4,
            "columns": 4,
            "spacing": [0.075 * distance] * 2,
            "diameter": diameter,
            "plate": 4 * diameter,
        }
        grid["plate"] = min(4.0 * diameter, 0.07 * distance)
        node = {"array": grid, "position": [0.0, 0.0, distance]}
        tracker = Tracker(scenario(node, f"scan.tracker.track_amplitude={amplitude}"))
        records = [next(tracker) for _ in range(96)][32:]
        good = [record for record in records if record.status == TrackStatus.MEASURED]
        rms = np.sqrt((errors(good) ** 2).mean(axis=0))[:2]
        sigma = np.sqrt(np.mean([np.diagonal(record.covariance)[:2] for record in good], axis=0))
        share = float(np.hypot(*rms)) / (0.5 * diameter / distance)
        table.add_row(
            f"{1e3 * diameter:g} mm",
            f"{distance:g} m",
            f"{amplitude:g}",
            ", ".join(f"{1e6 * value:.1f}" for value in sigma) + " µrad",
            ", ".join(f"{1e6 * value:.1f}" for value in rms) + " µrad",
            f"{100 * share:.2f} %",
        )
    console.print(table)


def parts_of_a_visit(lit: bool, visits: int = 150) -> dict[str, float]:
    """Return the processor time [ms] of a visit in one thread and of its parts, of which a tenth is quicker."""
    dr.set_thread_count(1)
    taken: dict[str, list[float]] = {}

    def timed(owner: Any, name: str, part: str) -> None:
        plain = getattr(owner, name)

        def call(*arguments: Any, **named: Any) -> Any:
            begun = time.process_time()
            result = plain(*arguments, **named)
            taken.setdefault(part, []).append(time.process_time() - begun)
            return result

        setattr(owner, name, call)

    timed(Frozen, "__call__", "kernels")
    timed(FrozenInstrument, "measure", "kernels, copies and ranges")
    try:
        steps: Any = importlib.import_module("scanner_sim.instrument.closed_loop.visits")
    except ModuleNotFoundError:
        steps = tracker_module  # of a checkout whose runs are one at a time
    timed(steps, "run_visits" if hasattr(steps, "run_visits") else "run_visit", "mirrors")
    timed(sensor_module, "measure_target", "measuring the target")
    timed(sensor_module, "error_parts", "parts of its error")
    timed(steps, "advance_all" if hasattr(steps, "advance_all") else "advance", "filter and modes")
    timed(Recorder, "record", "record")
    timed(Tracker, "visit", "visit")
    run = Tracker(scenario({"position": [0.0, 0.0, 10.0]}, **({"lighting": SUN} if lit else {})))
    for _ in range(40):
        next(run)
    taken.clear()
    for _ in range(visits):
        next(run)
    return {part: 1e3 * float(np.quantile(values, 0.1)) for part, values in taken.items()}


def cost(console: Console, against: Path | None = None) -> None:
    """Time visits and their parts, here and in another checkout in turns: the least of three."""
    for lit in (False, True):
        sides = [Path(__file__).resolve().parents[1], *([] if against is None else [against.resolve()])]
        runs: list[list[dict[str, float]]] = [[] for _ in sides]
        for _ in range(3):
            for side, found in zip(sides, runs, strict=True):
                script = [sys.executable, __file__, "--parts", "lit" if lit else "dark"]
                environment = os.environ | {"PYTHONPATH": str(side)}
                done = subprocess.run(script, env=environment, capture_output=True, text=True, check=True)
                found.append(json.loads(done.stdout))
        least = [{part: min(run[part] for run in found) for part in found[0]} for found in runs]
        table = Table(
            "Sun and Earth" if lit else "dark", "ms", *([] if against is None else ["before", "ratio"])
        )
        for part, here in least[0].items():
            others = [other[part] for other in least[1:]]
            table.add_row(
                part, f"{here:.2f}", *(f"{v:.2f}" for v in others), *(f"{v / here:.2f}" for v in others)
            )
        console.print(table)


def turn_of(side: Path, count: int, lit: bool, threads: int) -> dict[str, float]:
    """Return times of a visit [ms] in a checkout where so many runs go side by side."""
    script = [sys.executable, str(TURNS), str(count), f"--threads={threads}", *(["--lit"] if lit else [])]
    environment = os.environ | {"PYTHONPATH": str(side)}
    done = subprocess.run(script, env=environment, capture_output=True, text=True, check=True)
    return dict(json.loads(done.stdout))


def runs_together(console: Console, against: Path | None = None) -> None:
    """Time visits of runs side by side, and those of one run in another checkout, in turns: the least of three."""
    here = Path(__file__).resolve().parents[1]
    cases = [(here, count) for count in (1, 8, 64)] + ([] if against is None else [(against.resolve(), 1)])
    for lit in (False, True):
        least = np.full((len(cases), 2), np.inf)
        for _ in range(3):
            for place, (side, count) in enumerate(cases):
                taken = turn_of(side, count, lit, 1)["cpu"], turn_of(side, count, lit, 2)["clock"]
                least[place] = np.minimum(least[place], taken)
        table = Table(
            "Sun and Earth" if lit else "dark", "CPU of a visit", "ratio", "patterns/s, two threads", "ratio"
        )
        ratios = least[-1] / least
        for (side, count), taken, ratio in zip(cases, least, ratios, strict=True):
            name = f"{count} together" if side == here else "before, one alone"
            cells = f"{taken[0]:.2f} ms", f"{ratio[0]:.2f}", f"{1e3 / taken[1]:.0f}", f"{ratio[1]:.2f}"
            table.add_row(name, *cells)
        console.print(table)


def main() -> None:
    """Run what was asked for."""
    parts = {"minute": minute, "speed": speed, "accuracy": accuracy}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=[*parts, "cost", "runs"])
    parser.add_argument(
        "--against", type=Path, help="another checkout of the program, to which costs are compared"
    )
    parser.add_argument("--parts", choices=["dark", "lit"], help="print the cost of a visit's parts as JSON")
    chosen = parser.parse_args()
    if chosen.parts:
        print(json.dumps(parts_of_a_visit(chosen.parts == "lit")))
        return
    console = Console()
    for name, part in parts.items():
        if chosen.only in (None, name):
            part(console)
    if chosen.only in (None, "cost"):
        cost(console, chosen.against)
    if chosen.only in (None, "runs"):
        runs_together(console, chosen.against)


if __name__ == "__main__":
    main()
