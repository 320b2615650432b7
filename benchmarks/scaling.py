"""How the cost of a run grows with its size: CPU time, wall time and peak memory, and the exponents fitted to them.

Run as ``python benchmarks/scaling.py [--only raster …] [--quick] [--markdown]``. Each size runs in a process of its
own, with one thread, in scenes that are made here. *Set-up* is loading the scenario and building its scene, *run* the
rest; both are CPU times, that of *run* the least of a few (of one where it takes more than 2 s). *Bare rays* are the
same numbers of primary and shadow rays through the same scene with nothing computed from them. Exponents k of
cost ~ nᵏ are fitted over the largest two decades. ``--markdown`` writes the tables into docs/performance.md. Wall times
are disturbed by whatever else the machine does; CPU times less.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from scipy.stats import linregress

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "performance.md"
MANY_RAYS = 1 << 18
"""Voxels beyond which the bare rays of a raster no longer fit the memory of a small machine."""
GREY = {"reflectance": 0.5}
WALL = {
    "name": "wall",
    "shape": "rectangle",
    "size": [5.0, 5.0],
    "position": [0.0, 0.0, 10.5],
    "material": GREY,
}
Figures = dict[str, float]


def scenario(side: int, objects: list[dict[str, Any]]) -> Any:
    """Return a raster of side² voxels over ±8°."""
    from scanner_sim import load_scenario

    field = [-math.radians(8.0), math.radians(8.0)]
    scan = {"type": "raster", "rows": side, "columns": side, "horizontal": field, "vertical": field}
    return load_scenario({"schema": 1, "seed": 1, "scene": {"objects": objects}, "scan": scan})


def grid(count: int) -> Iterator[tuple[int, float, float, float]]:
    """Yield number, x, y and the distance between neighbours of so many places over the field at 10 m."""
    side = math.ceil(math.sqrt(count))
    step = 2.6 / side
    for number in range(count):
        row, column = divmod(number, side)
        yield number, (column + 0.5) * step - 1.3, (row + 0.5) * step - 1.3, step


def plane(triangles: int, folder: Path) -> dict[str, Any]:
    """Return a square of 4 m at 10 m, tessellated into about so many triangles in a PLY file."""
    side = max(1, round(math.sqrt(triangles / 2)))
    edge = np.linspace(-2.0, 2.0, side + 1, dtype=np.float32)
    corner = np.arange(side)[:, None] * (side + 1) + np.arange(side)
    faces = np.empty((side, side, 2), dtype=[("corners", "u1"), ("corner", "<i4", 3)])
    faces["corners"] = 3
    faces["corner"][..., 0, :] = np.stack([corner, corner + side + 1, corner + 1], axis=-1)
    faces["corner"][..., 1, :] = np.stack([corner + 1, corner + side + 1, corner + side + 2], axis=-1)
    points = np.stack([*np.meshgrid(edge, edge), np.zeros((side + 1, side + 1), np.float32)], axis=-1)
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {(side + 1) ** 2}\nproperty float x\nproperty float y\n"
        f"property float z\nelement face {2 * side * side}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    file = folder / f"plane_{triangles}.ply"
    file.write_bytes(head.encode() + points.astype("<f4").tobytes() + faces.tobytes())
    return {"name": "plane", "mesh": str(file), "position": [0.0, 0.0, 10.0], "material": GREY}


def cpu(work: Callable[[], object], times: int = 4) -> tuple[float, float]:
    """Return least CPU and wall seconds of a few runs after one to warm up, which alone counts if it takes long."""
    spent = []
    for _ in range(times):
        wall, begun = time.perf_counter(), time.process_time()
        work()
        spent.append((time.process_time() - begun, time.perf_counter() - wall))
        if spent[0][0] > 2.0:
            break
    return min(own for own, _ in spent), min(wall for _, wall in spent)


def peak() -> float:
    """Return the most memory that this process has held [byte]."""
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def measured(make: Callable[[], Any], *, bare: bool = True) -> Figures:
    """Return the cost of setting a raster scenario up and of measuring it, and that of its bare rays."""
    from imaging import Rays

    from scanner_sim import Instrument
    from scanner_sim.instrument.lit_aims import lit_aims
    from scanner_sim.instrument.memory import BATCH

    Instrument(
        scenario(8, [WALL]), device="cpu", threads=1
    )  # the renderer is loaded by this, and not in the set-up
    begun = time.process_time()
    loaded = make()
    instrument = Instrument(loaded, device="cpu", threads=1)
    setup = time.process_time() - begun

    def measure() -> None:
        for aim, seen in lit_aims(instrument, BATCH):
            instrument.measure(aim, backgrounds=seen)

    run, wall = cpu(measure)
    figures = {"set-up": setup, "run": run, "wall": wall, "memory": peak()}
    if bare:
        figures["bare rays"] = cpu(Rays(instrument).bare)[0]
    return figures


def raster(side: int) -> Figures:
    """Cost of a raster of side² voxels of a sphere, a box and a wall, whole, and of writing it."""
    from imaging import Rays

    from scanner_sim import Instrument, simulate
    from scanner_sim.instrument.memory import memory
    from scanner_sim.products.files.exr import write_exr

    ball = {"name": "ball", "shape": "sphere", "diameter": 1.0, "position": [-0.5, 0, 9.5], "material": GREY}
    box = {"name": "box", "shape": "box", "size": [0.6, 0.9, 0.5], "position": [0.6, 0, 9], "material": GREY}
    box["rotation"] = {"axis": "y", "angle": 0.5}
    given = scenario(side, [ball, box, WALL])
    kept: list[Any] = []

    def run() -> None:
        kept[:] = [simulate(given, device="cpu", threads=1)]

    own, wall = cpu(run)
    with tempfile.TemporaryDirectory() as folder:
        written, _ = cpu(
            lambda: write_exr(Path(folder, "range.exr"), kept[0], given.output.compression), times=2
        )
    figures = {"run": own, "wall": wall, "EXR": written, "memory": peak(), "memory stated": memory(given)}
    if side * side <= MANY_RAYS:
        figures["bare rays"] = cpu(Rays(Instrument(given, device="cpu", threads=1)).bare)[0]
    return figures


def triangles(count: int) -> Figures:
    """Cost of 128² voxels of a plane of so many triangles: set-up reads the file and builds the tree."""
    with tempfile.TemporaryDirectory() as folder:
        item = plane(count, Path(folder))
        return measured(lambda: scenario(128, [item]))


def objects(count: int) -> Figures:
    """Cost of 128² voxels of so many boxes before a wall."""
    items = [
        {"name": f"b{number}", "shape": "box", "size": [0.6 * step] * 3, "position": [x, y, 10.0], "material": GREY}
        for number, x, y, step in grid(count)
    ]  # fmt: skip
    return measured(lambda: scenario(128, [*items, WALL]))


def moving(count: int) -> Figures:
    """Cost of 64² voxels of so many boxes that drift by 10 mm/s; the first run compiles, in an empty cache."""
    motion = {"type": "twist", "velocity": [0.01, 0.0, 0.0]}
    items = [
        {"name": f"b{number}", "shape": "box", "size": [0.6 * step] * 3, "position": [x, y, 10.0], "material": GREY,
         "motion": motion}
        for number, x, y, step in grid(count)
    ]  # fmt: skip
    from scanner_sim import simulate

    given = scenario(64, [*items, WALL])
    begun = time.process_time()
    simulate(given, device="cpu", threads=1)
    compiled = time.process_time() - begun
    return {"first run": compiled} | measured(lambda: given, bare=False)


def target_array(count: int) -> dict[str, Any]:
    """Return an array of about so many targets, as many as ±8° hold at 10 m."""
    side = max(1, round(math.sqrt(count)))
    step = 2.6 / side
    size = {
        "diameter": 0.4 * step,
        "plate": 0.9 * step,
        "rows": side,
        "columns": side,
        "spacing": [step, step],
    }
    return {"name": "node", "array": size, "position": [0.0, 0.0, 10.0]}


def targets(count: int) -> Figures:
    """Cost of 128² voxels of an array of so many targets."""
    return measured(lambda: scenario(128, [target_array(count)]))


def tracked(count: int, duration: float = 3600.0, seed: int = 1) -> Any:
    """Return a scenario that follows so many targets of 25 mm."""
    from scanner_sim import load_scenario

    side = math.ceil(math.sqrt(count))
    array = {"diameter": 0.025, "plate": 0.07, "rows": side, "columns": side, "spacing": [0.08, 0.08]}
    scene = {"objects": [{"name": "node", "array": array, "position": [0.0, 0.0, 10.0]}]}
    names = [f"node/{number + 1}" for number in range(count)]
    scan = {"type": "track", "targets": names, "duration": duration}
    return load_scenario({"schema": 1, "seed": seed, "scene": scene, "scan": scan})


def followed(count: int) -> Figures:
    """Cost of 100 visits while so many targets are followed in turn."""
    from scanner_sim import Tracker

    Tracker(tracked(1), device="cpu", threads=1)  # the renderer is loaded by this, and not in the set-up
    begun = time.process_time()
    tracker = Tracker(tracked(count), device="cpu", threads=1)
    setup = time.process_time() - begun

    def visits() -> None:
        for _ in range(100):
            next(tracker)

    run, wall = cpu(visits, times=2)
    return {"set-up": setup, "run": run, "wall": wall, "memory": peak()}


def runs(count: int) -> Figures:
    """Cost of so many tracking runs of 0.2 s, other seeds, one after the other in one process."""
    from scanner_sim import Tracker

    def follow(seed: int) -> None:
        list(Tracker(tracked(4, 0.2, seed), device="cpu", threads=1))

    follow(0)
    wall, begun = time.perf_counter(), time.process_time()
    for seed in range(1, count + 1):
        follow(seed)
    return {
        "run": time.process_time() - begun,
        "wall": time.perf_counter() - wall,
        "memory": peak(),
    }


@dataclass(frozen=True)
class Part:
    """What a table holds: the cost against one number."""

    measure: Callable[[int], Figures]
    what: str
    sizes: tuple[int, ...]
    quick: tuple[int, ...]
    power: int = 1
    """Of the number behind the cost: 2 for the side of a raster, whose voxels count."""
    cold: bool = False


PARTS = {
    "raster": Part(raster, "voxels", (64, 128, 256, 512, 1024, 2048, 4096), (64, 128, 256), power=2),
    "triangles": Part(
        triangles, "triangles", (1000, 10_000, 100_000, 1_000_000, 10_000_000), (1000, 10_000, 100_000)
    ),
    "objects": Part(objects, "boxes", (1, 10, 100, 1000, 3000, 10_000), (10, 100, 300)),
    "moving": Part(moving, "boxes that move", (1, 2, 4, 8, 16), (1, 2, 4), cold=True),
    "targets": Part(targets, "targets seen", (1, 100, 1000, 3000, 10_000), (10, 100, 300)),
    "followed": Part(followed, "targets followed", (1, 10, 100, 300, 1000), (1, 10, 100)),
    "runs": Part(runs, "tracking runs", (1, 4, 16, 32), (1, 2, 4)),
}


def alone(measure: Callable[..., Any], *given: Any, cold: bool = False) -> Any:
    """Return what a function finds in a process of its own, with an empty cache of kernels if ``cold``."""
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as home:
        start = 1, home if cold else None
        with ProcessPoolExecutor(1, context, initializer=begin, initargs=start) as pool:
            return pool.submit(measure, *given).result()


def begin(threads: int, home: str | None = None) -> None:
    """Let a process compute with so many threads throughout, and begin its cache of kernels empty if told where.

    A tracker that is given another number than the process has changes it twice a visit, which takes milliseconds.
    """
    if home is not None:
        os.environ |= {"HOME": home, "XDG_CACHE_HOME": home}
    from scanner_sim.render.device import activate

    activate("cpu", threads)


def grown(name: str, quick: bool, most: float, progress: Progress) -> tuple[list[str], list[list[str]]]:
    """Return head and rows of the table of a part, the exponents last."""
    part = PARTS[name]
    sizes = [size for size in (part.quick if quick else part.sizes) if size <= most]
    bar = progress.add_task(name, total=len(sizes))
    found: dict[int, Figures | str] = {}
    for size in sizes:
        progress.update(bar, description=f"{name} {size:,}")
        try:
            found[size] = alone(part.measure, size, cold=part.cold)
        except BrokenProcessPool:
            found[size] = "the process ended"
        except Exception as fault:
            found[size] = f"{type(fault).__name__}: {fault}"
        progress.advance(bar)
    good = {size**part.power: own for size, own in found.items() if isinstance(own, dict)}
    columns = list(dict.fromkeys(column for own in good.values() for column in own))
    ratio = ["run over bare rays"] if "bare rays" in columns else []
    rows = []
    for size, own in found.items():
        told = f"{size:,}²" if part.power == 2 else f"{size:,}"
        if isinstance(own, str):
            rows.append([told, own[:300], *[""] * (len(columns) + len(ratio) - 1)])
            continue
        cells = [spelt(column, own.get(column, math.nan)) for column in columns]
        rows.append([told, *cells, *(number(own["run"] / own.get("bare rays", math.nan)) for _ in ratio)])
    fitted = [exponent({n: own[c] for n, own in good.items() if c in own}) for c in columns]
    rows.append(["exponent", *fitted, *("" for _ in ratio)])
    return [part.what, *columns, *ratio], rows


def exponent(cost: dict[int, float]) -> str:
    """Return k of cost ~ nᵏ with its standard error, over the largest two decades of n."""
    upper = {n: value for n, value in cost.items() if n >= max(cost) / 100}
    if len(upper) < 3:
        return "–"
    fit = linregress(np.log(list(upper)), np.log(list(upper.values())))
    return f"{fit.slope:.2f} ± {fit.stderr:.2f}"


def number(value: float) -> str:
    """Return a ratio in words."""
    return "–" if math.isnan(value) else f"{value:.2g}" if value < 100 else f"{value:,.0f}"


def spelt(column: str, value: float) -> str:
    """Return a figure with its unit."""
    if math.isnan(value):
        return "–"
    if column.startswith("memory"):
        return f"{value / 1e9:.2f} GB"
    return f"{1e3 * value:.3g} ms" if value < 1.0 else f"{value:.3g} s"


def image_often(count: int, first: int, threads: int) -> float:
    """Make so many images of 64² voxels, each with a seed of its own; return the CPU time."""
    from scanner_sim import simulate

    begun = time.process_time()
    for seed in range(first, first + count):
        given = scenario(64, [WALL]).model_copy(update={"seed": seed})
        simulate(given, device="cpu", threads=threads)
    return time.process_time() - begun


def follow_often(count: int, first: int, threads: int) -> float:
    """Make so many tracking runs of 0.2 s, each with a seed of its own; return the CPU time."""
    from scanner_sim import Tracker

    begun = time.process_time()
    for seed in range(first, first + count):
        list(Tracker(tracked(4, 0.2, seed), device="cpu", threads=threads))
    return time.process_time() - begun


def campaign(quick: bool, progress: Progress) -> tuple[list[str], list[list[str]]]:
    """Return the table of processes and threads: scenarios per second of the clock and of the processor."""
    ways = [(1, 1), (1, 2), (2, 1), (2, 2)]
    kinds = {
        "images of 64²": (image_often, 8 if quick else 16),
        "tracking runs of 0.2 s": (follow_often, 4 if quick else 8),
    }
    bar = progress.add_task("processes", total=len(kinds) * len(ways))
    rows = []
    for name, (work, count) in kinds.items():
        for processes, threads in ways:
            context = multiprocessing.get_context("spawn")
            with ProcessPoolExecutor(processes, context, initializer=begin, initargs=(threads,)) as pool:
                for warm in [pool.submit(work, 2, -9 * place, threads) for place in range(-processes, 0)]:
                    warm.result()
                begun, share = time.perf_counter(), count // processes
                jobs = [pool.submit(work, share, share * place, threads) for place in range(processes)]
                spent = sum(job.result() for job in jobs)
                wall = time.perf_counter() - begun
            cells = f"{count / wall:.2g}/s", f"{1e3 * spent / count:.0f} ms"
            rows.append([name, str(processes), str(threads), *cells])
            progress.advance(bar)
    return ["what", "processes", "threads of each", "by the clock", "CPU time of one"], rows


def sampled(side: int) -> Figures:
    """CPU time per shot of the whole chain, its bare rays, and the same beams in plain Dr.Jit and Mitsuba."""
    import drjit as dr
    import mitsuba as mi
    from imaging import Rays

    from scanner_sim import Instrument
    from scanner_sim.instrument.lit_aims import lit_aims
    from scanner_sim.instrument.memory import BATCH

    with tempfile.TemporaryDirectory() as folder:
        given = scenario(side, [plane(100_000, Path(folder))])
        instrument = Instrument(given, device="cpu", threads=1)
    rays, subrays = Rays(instrument), SUBRAYS

    def chain() -> None:
        for aim, seen in lit_aims(instrument, BATCH):
            instrument.measure(aim, backgrounds=seen)

    def plain(bins: int) -> None:
        """Trace :data:`SUBRAYS` for each shot: power by the radar equation, summed, or in bins of time."""
        lane = dr.arange(mi.UInt32, side * side * subrays)
        pulse, own = lane // subrays, lane % subrays
        turn, out = mi.Float(own) * 2.4, 1e-4 * dr.sqrt(mi.Float(own))
        theta = (mi.Float(pulse % side) / side - 0.5) * 0.28 + out * dr.cos(turn)
        phi = (mi.Float(pulse // side) / side - 0.5) * 0.28 + out * dr.sin(turn)
        ray = mi.Ray3f(mi.Point3f(0.0), dr.normalize(mi.Vector3f(theta, phi, 1.0)))
        met = instrument.loaded.mitsuba.ray_intersect(ray, mi.RayFlags.All, coherent=True)
        back = mi.Ray3f(ray(met.t * 0.9999), mi.Point3f(0.1, 0.0, 0.0) - met.p)
        back.maxt = 1.0
        seen = met.is_valid() & ~instrument.loaded.mitsuba.ray_test(back, coherent=True)
        power = dr.select(seen, dr.abs(dr.dot(met.n, ray.d)) / dr.square(met.t), 0.0)
        if bins:
            waveform = dr.zeros(mi.Float, bins * side * side)
            at = dr.minimum(mi.UInt32(dr.maximum(met.t - 9.0, 0.0) * 20.0), bins - 1)
            dr.scatter_add(waveform, power, pulse * bins + at, active=seen)
            dr.eval(waveform)
        else:
            dr.eval(dr.block_sum(power, subrays), dr.block_sum(power * met.t, subrays))
        dr.sync_thread()

    shots = float(side * side)
    ways = {
        "the whole chain": chain,
        "its bare rays": rays.bare,
        f"{subrays} subrays in plain Dr.Jit, summed": lambda: plain(0),
        f"{subrays} subrays in plain Dr.Jit, in 64 bins of time": lambda: plain(64),
        "one bare ray": lambda: one_ray(instrument.loaded.mitsuba, side),
    }
    return {name: cpu(work)[0] / shots for name, work in ways.items()}


def one_ray(scene: Any, side: int) -> None:
    """Trace one ray for each pulse, nearest hit alone."""
    import drjit as dr
    import mitsuba as mi

    pulse = dr.arange(mi.UInt32, side * side)
    across, down = mi.Float(pulse % side) / side - 0.5, mi.Float(pulse // side) / side - 0.5
    ray = mi.Ray3f(mi.Point3f(0.0), dr.normalize(mi.Vector3f(across * 0.28, down * 0.28, 1.0)))
    dr.eval(scene.ray_intersect_preliminary(ray, coherent=True))
    dr.sync_thread()


SUBRAYS = 19
"""Of a beam in plain Dr.Jit: as many as HELIOS++ takes."""
LITERATURE = {
    "HELIOS++ 2.x, 19 subrays": 2.0 / 144_000,
    "HELIOS++ 2.x, 19 subrays, with waveforms": 2.0 / 62_000,
    "HELIOS++ 2.x, one ray": 2.0 / 615_000,
}
"""Thread-seconds per pulse, 512² pulses on 100 000 triangles with two threads, LAS written: medians that were measured
on another machine of two cores, and not by this program."""


def sampling(quick: bool, progress: Progress) -> tuple[list[str], list[list[str]]]:
    """Return the table of what sampling a beam costs, here and elsewhere."""
    bar = progress.add_task("sampling", total=1)
    found = alone(sampled, 128 if quick else 512)
    progress.advance(bar)
    whole = found["the whole chain"]
    told = [(name, cost, "here") for name, cost in found.items()]
    told += [(name, cost, "elsewhere, two threads") for name, cost in LITERATURE.items()]
    rows = [[name, f"{1e6 * cost:.3g} µs", f"{whole / cost:.2g}", where] for name, cost, where in told]
    return ["what", "CPU time of a shot", "the whole chain takes … times that", "measured"], rows


def markdown(name: str, head: list[str], rows: list[list[str]]) -> None:
    """Write a table into the page of the documents, between its marks."""
    sys.path.append(str(ROOT / "docs"))
    from made_tables import rewrite_table

    rewrite_table(PAGE, f"benchmarks/scaling.py --only {name}", head, rows)


def main() -> None:
    """Measure what was asked for."""
    whole = {**dict.fromkeys(PARTS), "processes": campaign, "sampling": sampling}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", choices=whole, default=list(whole), help="parts that are run")
    parser.add_argument("--quick", action="store_true", help="small sizes: about two minutes in all")
    parser.add_argument(
        "--most", type=float, default=math.inf, help="largest size; 4096 voxels across take minutes"
    )
    parser.add_argument("--markdown", action="store_true", help="write the tables into docs/performance.md")
    chosen, console = parser.parse_args(), Console()
    for name in chosen.only:
        with Progress(console=Console(stderr=True), transient=True) as progress:
            counted = whole[name]
            head, rows = (
                counted(chosen.quick, progress)
                if counted
                else grown(name, chosen.quick, chosen.most, progress)
            )
        table = Table(*head, title=name)
        for row in rows:
            table.add_row(*row)
        console.print(table)
        if chosen.markdown:
            markdown(name, head, rows)


if __name__ == "__main__":
    main()
