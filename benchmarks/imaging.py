"""How fast a range image is made, and how much memory that takes.

Run as ``make bench`` or ``python benchmarks/imaging.py [--size N] [--quick]``. Figures are medians of warm runs on
the machine at hand; ratios travel better than seconds. The chain is the whole of it but for the pictures: rays,
light, noise, peaks, ranges and the EXR file. "Bare rays" are the same numbers of primary and shadow rays through the
same scene with nothing computed from them.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).resolve().parents[1]
NODE = ROOT / "configs" / "node_512.yaml"
LIT = "lighting={sun: {direction: [-0.5, -0.6, -0.6]}, earth: {direction: [0, 1, 0.3]}}"
COMMAND = shutil.which("scanner-sim", path=str(Path(sys.executable).parent)) or "scanner-sim"


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--size", type=int, default=512, help="rows and columns of the warm image")
    arguments.add_argument(
        "--quick", action="store_true", help="leave out the cold starts and the large image"
    )
    chosen = arguments.parse_args()
    table = Table("figure", "measured", "wanted", title="Imaging on this machine")
    warm(table, chosen.size)
    if not chosen.quick:
        cold(table)
        large(table)
    Console().print(table)


def warm(table: Table, size: int) -> None:
    """Whole chain against bare rays, kernels warm."""
    from scanner_sim import Instrument, load_scenario, simulate, simulate_many
    from scanner_sim.products.files.exr import write_exr

    scenario = load_scenario(NODE, [f"scan.rows={size}", f"scan.columns={size}"])
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "range.exr"
        image = simulate(scenario)
        whole = median(lambda: write_exr(target, simulate(scenario), scenario.output.compression))
        writing = median(lambda: write_exr(target, image, scenario.output.compression))
    lit = [
        load_scenario(
            NODE, [f"scan.rows={size}", f"scan.columns={size}", LIT, f"transport.background_seed={seed}"]
        )
        for seed in range(5)
    ]
    dark = median(lambda: simulate(scenario), 3, clock=time.process_time)
    known = median(lambda: simulate(lit[0]), 3, clock=time.process_time) / dark
    unseen = iter(lit[1:])
    first = median(lambda: simulate(next(unseen)), 3, clock=time.process_time) / dark
    small = [
        load_scenario(NODE, ["scan.rows=64", "scan.columns=64", f"seed={seed}"]) for seed in range(1, 17)
    ]
    again = median(lambda: simulate(small[0]), clock=time.process_time)
    together = median(lambda: list(simulate_many(small)), clock=time.process_time) / len(small)
    voxels = size * size
    bench = Rays(Instrument(scenario))
    chain = median(bench.chain)
    bare = median(bench.bare)
    table.add_row("whole chain with EXR", f"{voxels / whole:,.0f} voxels/s", "≥ 200,000 (aim 500,000)")
    table.add_row("without loading and EXR", f"{voxels / chain:,.0f} voxels/s", "")
    table.add_row("64 × 64 voxels of a known scene", f"{1e3 * again:.0f} ms of CPU", "")
    table.add_row(
        "one of sixteen such, which differ in their seeds", f"{1e3 * together:.0f} ms of CPU", "≤ 40 ms"
    )
    table.add_row("writing the EXR", f"{1e3 * writing:.0f} ms", "")
    table.add_row("whole lines over lines as exposed, in processor time", f"{bench.lines():.2f}", "")
    table.add_row("shots on edges", f"{100.0 * bench.edge_share:.1f} %", "")
    table.add_row(
        "bare rays", f"{bench.rays / bare / 1e6:.1f} M rays/s, {bench.rays / voxels:.0f} per voxel", ""
    )
    table.add_row("whole chain over its bare rays", f"{whole / bare:.2f}", "")
    table.add_row("with Sun, Earth and four bounces over dark, in processor time", f"{known:.2f}", "≤ 1.5")
    table.add_row("the same where the light is not known yet", f"{first:.2f}", "≤ 4")


class Rays:
    """The rays of an instrument's scenario: in the chain, and bare."""

    def __init__(self, instrument: Any) -> None:
        import drjit as dr
        import mitsuba as mi

        from scanner_sim.instrument.simulate import BATCH
        from scanner_sim.render.beam import splitter
        from scanner_sim.render.beam.line_projection import LineProjection
        from scanner_sim.render.transport import frame_at, lanes, launch
        from scanner_sim.scan.raster import raster_aim, tiled_order

        self.instrument, scenario = instrument, instrument.scenario
        scan, optics = scenario.scan, instrument.optics
        order = tiled_order(scan)
        dwell = scenario.scanner.dwell
        self.aims = [
            raster_aim(scan, order[start : start + BATCH], dwell) for start in range(0, scan.shots, BATCH)
        ]
        self.scene, self.batches, self.rays, finer = instrument.loaded.mitsuba, [], 0, 0
        trace = splitter.trace_returns

        def traced(loaded: Any, projection: Any, beamlets: Any, shots: Any) -> Any:
            lane = lanes(beamlets, shots)
            frame = frame_at(optics, lane.own, lane.time)
            beam, lens = launch(optics, frame, lane.node), mi.Point3f(frame.lens)
            dr.eval(beam, lens)
            self.batches.append((beam, lens))
            self.rays += 2 * dr.width(lane.shot)
            return trace(loaded, projection, beamlets, shots)

        splitter.trace_returns = traced
        for aim in self.aims:
            shots = instrument.fire(aim)[0]
            lights = splitter.render_light(
                instrument.loaded, LineProjection(optics), scenario.transport, shots, scenario.seed
            )[1]
            finer += sum(light.shots for light in lights if light.count > 1)
        splitter.trace_returns = trace
        self.edge_share = finer / scan.shots

    def chain(self) -> None:
        for aim in self.aims:
            self.instrument.measure(aim)

    def lines(self) -> float:
        """Processor time of exposing all lines as a whole and reading them, over that of their windows."""
        import drjit as dr

        from scanner_sim.render.beam.line_projection import LineProjection
        from scanner_sim.render.beam.splitter import render_light

        line, scenario, aim = self.instrument.triangulation, self.instrument.scenario, self.aims[0]
        shots = self.instrument.fire(aim)[0]
        truth, lights = render_light(
            self.instrument.loaded,
            LineProjection(self.instrument.optics),
            scenario.transport,
            shots,
            scenario.seed,
        )
        groups = [
            (
                light,
                shots.take(light.index),
                truth.take(light.index),
                aim.theta[light.index.numpy()].astype("f4"),
                None,
            )
            for light in lights
        ]
        spent: dict[bool, list[float]] = {True: [], False: []}
        for _ in range(5):
            for whole, times in spent.items():
                start = time.process_time()
                for group in groups:
                    line.sense(*group, whole=whole)
                dr.sync_thread()
                times.append(time.process_time() - start)
        return min(spent[True]) / min(spent[False])

    def bare(self) -> None:
        import drjit as dr
        import mitsuba as mi

        for beam, lens in self.batches:
            ray = mi.Ray3f(beam.origin, beam.direction)
            met = self.scene.ray_intersect_preliminary(ray, coherent=True)
            back = mi.Ray3f(ray(met.t * 0.9999), lens - ray(met.t))
            back.maxt = 1.0
            dr.eval(self.scene.ray_test(back, coherent=True, active=met.is_valid()))
        dr.sync_thread()


def cold(table: Table) -> None:
    """Cold starts of the command line, with an empty kernel cache."""
    with tempfile.TemporaryDirectory() as home:
        environment = {**os.environ, "HOME": home, "XDG_CACHE_HOME": home}
        run = [COMMAND, "run", str(ROOT / "configs" / "quickstart.yaml"), "-o", f"{home}/result"]
        table.add_row("quickstart, cold, with pictures", f"{seconds(run, environment):.1f} s", "< 30 s")
    helped = statistics.median(seconds([COMMAND, "--help"], dict(os.environ)) for _ in range(5))
    table.add_row("scanner-sim --help", f"{helped:.2f} s", "< 0.7 s")


def large(table: Table) -> None:
    """Peak memory of a 2048 × 2048 image."""
    with tempfile.TemporaryDirectory() as folder:
        run = [COMMAND, "run", str(NODE), "-o", f"{folder}/result"]
        run += ["--set", "scan.rows=2048", "--set", "scan.columns=2048"]
        code = (
            "import resource, subprocess, sys, time; start = time.perf_counter();"
            "subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL);"
            "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, time.perf_counter() - start)"
        )
        printed = subprocess.run(
            [sys.executable, "-c", code, *run], check=True, capture_output=True, text=True
        )
    kilobytes, took = printed.stdout.split()
    table.add_row("2048 × 2048, all files: memory", f"{float(kilobytes) / 2**20:.2f} GB", "< 3 GB")
    table.add_row("2048 × 2048, all files: time", f"{float(took):.1f} s", "")


def seconds(command: list[str], environment: dict[str, str]) -> float:
    start = time.perf_counter()
    subprocess.run(command, check=True, env=environment, capture_output=True)
    return time.perf_counter() - start


def median(
    work: Callable[[], object], times: int = 7, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Median seconds of a few runs after one to warm up."""
    work()
    spent = []
    for _ in range(times):
        start = clock()
        work()
        spent.append(clock() - start)
    return statistics.median(spent)


if __name__ == "__main__":
    main()
