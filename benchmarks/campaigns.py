"""What campaigns cost: time, memory and bytes by the number of scenarios and workers, and rows after random kills.

Run as ``python benchmarks/campaigns.py [--only cost …] [--quick] [--markdown]``:

``cost``
    scenarios of 64 × 64 voxels, every fourth with another power, threshold and place of a sphere, on two workers;
    ``--runs`` chooses how many
``workers``
    the same on one worker and on two, in turns: the least CPU time of a run on each, and runs by the clock
``tracks``
    tracking runs of 1 s that differ in their seeds, on two workers
``overhead``
    CPU time of a run of 2 × 2 and 64 × 64 voxels whose scene is known, with a power of its own and alike but for the
    seed, in batches of 16 in this process
``bytes``
    what goes to a worker and comes back, and what a row takes on the disk
``kills``
    a campaign on two workers, killed at random moments: a worker, or the process itself, which is then started again.
    Its rows are held against those of one process. ``--kills`` chooses how often, ``--seed`` when

CPU times are those of the command and its processes, Dask included, as ``/proc`` counts them. ``--markdown`` writes the
tables into docs/performance.md.
"""

from __future__ import annotations

import argparse
import os
import pickle
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "performance.md"
TICKS = os.sysconf("SC_CLK_TCK")
Tabulated = tuple[list[str], list[list[str]]]

SCENE = """\
schema: 1
scene:
  objects:
    - {name: wall, shape: rectangle, size: [5 m, 5 m], position: [0 m, 0 m, 10.5 m], material: grey_reference}
    - {name: ball, shape: sphere, diameter: 0.8 m, position: [0.5 m, 0 m, 9.5 m], material: grey_reference}
scan: {type: raster, rows: 64, columns: 64, horizontal: [-8 deg, 8 deg], vertical: [-8 deg, 8 deg]}
output: {pictures: false}
"""
PLAN = """\
schema: 1
base: scene.yaml
seed: 5
vary:
  - keys:
      scanner.laser.power: {uniform: [5 mW, 15 mW]}
      processing.threshold: {normal: [6, 0.3], within: [5, 7]}
      scene.objects.ball.position[2]: {uniform: [8 m, 10 m]}
    sample: latin_hypercube
    count: POINTS
repeat: 4
measure: [sigma_range, rms_range, coverage, valid_share]
"""
TRACKS = """\
schema: 1
base: BASE
set: {scan.duration: 1 s}
repeat: RUNS
measure: [lost_tracks, measured_share, rms_target_range, pose_position]
"""


def started(folder: Path, workers: int, output: str = "out") -> subprocess.Popen[bytes]:
    """Start the campaign in a folder."""
    code = "import sys; from scanner_sim.cli import main; sys.argv[0] = 'scanner-sim'; main()"
    words = ["campaign", "plan.yaml", "-o", output, "--workers", str(workers), "--quiet", "--device", "cpu"]
    return subprocess.Popen([sys.executable, "-c", code, *words], cwd=folder)


def written(folder: Path, runs: int) -> None:
    """Write the plan of so many runs of images."""
    (folder / "scene.yaml").write_text(SCENE, encoding="utf-8")
    (folder / "plan.yaml").write_text(PLAN.replace("POINTS", str(max(runs // 4, 1))), encoding="utf-8")


def written_tracks(folder: Path, runs: int) -> None:
    """Write the plan of so many tracking runs."""
    base = str(ROOT / "configs" / "track_still.yaml")
    (folder / "plan.yaml").write_text(
        TRACKS.replace("BASE", base).replace("RUNS", str(runs)), encoding="utf-8"
    )


def family(number: int) -> Iterator[int]:
    """Yield a process and its descendants."""
    yield number
    try:
        for thread in Path(f"/proc/{number}/task").iterdir():
            for child in (thread / "children").read_text(encoding="ascii").split():
                yield from family(int(child))
    except OSError:
        return


def usage(number: int) -> tuple[float, float]:
    """Return the CPU time [s] of a process, its descendants and those that ended, and the memory [B] they hold."""
    ticks = pages = 0
    for one in family(number):
        try:
            fields = Path(f"/proc/{one}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
        except OSError:
            continue
        ticks += sum(map(int, fields[11:15]))
        pages += int(fields[21])
    return ticks / TICKS, float(pages * os.sysconf("SC_PAGE_SIZE"))


def rows_done(folder: Path) -> int:
    """Return the rows in the folder of a campaign, without opening it as one."""
    import pyarrow.parquet as pq

    rows = folder / "rows.jsonl"
    count = rows.read_bytes().count(b"\n") if rows.exists() else 0
    return count + sum(pq.read_metadata(part).num_rows for part in folder.glob("parts/*.parquet"))


def followed(folder: Path, workers: int, runs: int, say: Callable[[str], None]) -> dict[str, float]:
    """Do a campaign; return its wall and CPU times, the rate without its start, and its memory early and at most."""
    begun, process = time.perf_counter(), started(folder, workers)
    marks: list[tuple[float, int, float, float]] = []
    while process.poll() is None:
        time.sleep(0.5)
        try:
            done = rows_done(folder / "out")
        except (OSError, ValueError):  # a part is just being put in its place
            continue
        if done and (not marks or done != marks[-1][1]):
            marks.append((time.perf_counter() - begun, done, *usage(process.pid)))
            say(f"{done} of {runs} runs, {marks[-1][3] / 1e6:.0f} MB")
    if process.returncode:
        raise SystemExit("the campaign failed")
    wall = time.perf_counter() - begun
    # From the first tenth on every worker has its kernels.
    early = next((mark for mark in marks if mark[1] >= runs / 10), marks[0])
    last = marks[-1]
    between = max(last[1] - early[1], 1)
    return {
        "wall": wall,
        "rate": between / max(last[0] - early[0], 1e-9),
        "cpu": (last[2] - early[2]) / between,
        "early": early[3],
        "most": max(mark[3] for mark in marks),
        "disk": float(sum(path.stat().st_size for path in (folder / "out").rglob("*") if path.is_file())),
    }


def cost(chosen: argparse.Namespace, say: Callable[[str], None]) -> Tabulated:
    """Return the table of numbers of scenarios on two workers."""
    rows = []
    for runs in chosen.runs:
        with tempfile.TemporaryDirectory() as name:
            written(Path(name), runs)
            found = followed(Path(name), 2, runs, say)
        rows.append(
            [
                f"{runs:,}",
                f"{found['wall']:.0f} s",
                f"{found['rate']:.3g}/s",
                f"{1e3 * found['cpu']:.3g} ms",
                f"{found['early'] / 1e9:.2f} GB",
                f"{found['most'] / 1e9:.2f} GB",
                f"{found['disk'] / runs:.0f} B",
            ]
        )
    head = [
        "scenarios",
        "wall",
        "by the clock",
        "CPU time of one",
        "memory at a tenth",
        "at most",
        "disk of one",
    ]
    return head, rows


def workers(chosen: argparse.Namespace, say: Callable[[str], None]) -> Tabulated:
    """Return the table of one worker and two, in turns."""
    runs, turns = (80, 1) if chosen.quick else (1600, 1)
    found: dict[int, list[dict[str, float]]] = {1: [], 2: []}
    for _ in range(turns):
        for count, own in found.items():
            with tempfile.TemporaryDirectory() as name:
                written(Path(name), runs)
                own.append(followed(Path(name), count, runs, say))
    cpu = {count: min(one["cpu"] for one in own) for count, own in found.items()}
    rate = {count: max(one["rate"] for one in own) for count, own in found.items()}
    rows = [
        [
            str(count),
            f"{rate[count]:.3g}/s",
            f"{rate[count] / (count * rate[1]):.0%}",
            f"{1e3 * cpu[count]:.3g} ms",
            f"{cpu[1] / cpu[count]:.0%}",
        ]
        for count in found
    ]
    return ["workers", "by the clock", "of one's, each", "CPU time of a run", "efficiency by CPU time"], rows


def tracks(chosen: argparse.Namespace, say: Callable[[str], None]) -> Tabulated:
    """Return the table of tracking runs."""
    runs = 16 if chosen.quick else chosen.tracks
    with tempfile.TemporaryDirectory() as name:
        written_tracks(Path(name), runs)
        begun = time.perf_counter()
        found = followed(Path(name), 2, runs, say)
    mean = (time.perf_counter() - begun) / runs
    row = [f"{runs:,}", f"{found['wall']:.0f} s", f"{found['cpu']:.3g} s", f"{found['most'] / 1e9:.2f} GB"]
    return ["tracking runs of 1 s", "wall", "CPU time of one", "memory", "1000 take"], [
        [*row, f"{1000.0 * mean / 60.0:.0f} min"]
    ]


def overhead(_: argparse.Namespace, say: Callable[[str], None]) -> Tabulated:
    """Return the table of a run's CPU time by its voxels, alone and in a batch; the scene is known."""
    from scanner_sim.campaign.reading import read_campaign
    from scanner_sim.campaign.work import Settings, task_of, work
    from scanner_sim.render.device import activate

    activate("cpu", 1)
    rows = []
    for name, vary, repeat in (("power of its own", 64, 1), ("alike but for the seed", 1, 64)):
        spent = {}
        for side in (2, 64):
            say(f"{name}, {side} × {side}")
            with tempfile.TemporaryDirectory() as place:
                (Path(place) / "scene.yaml").write_text(SCENE, encoding="utf-8")
                (Path(place) / "plan.yaml").write_text(
                    f"schema: 1\nbase: scene.yaml\nset: {{scan.rows: {side}, scan.columns: {side}}}\n"
                    f"vary: [{{keys: {{scanner.laser.power: {{uniform: [5 mW, 15 mW]}}}}, count: {vary}}}]\n"
                    f"repeat: {repeat}\nmeasure: [sigma_range, rms_range, coverage, valid_share]\n",
                    encoding="utf-8",
                )
                campaign = read_campaign(Path(place) / "plan.yaml")
                settings, base = Settings(Path(place), None, "cpu", 1), pickle.dumps(campaign.base)
                times = []
                for first in (0, 0, 16, 32, 48):
                    begun = time.process_time()
                    if any(
                        row.fault for row in work(task_of(campaign, base, range(first, first + 16), settings))
                    ):
                        raise SystemExit("a run failed")
                    times.append((time.process_time() - begun) / 16)
                spent[side] = min(times[1:])
        rows.append([name, f"{1e3 * spent[2]:.3g} ms", f"{1e3 * spent[64]:.3g} ms"])
    return ["runs", "2 × 2 voxels: what a run costs beside its voxels", "64 × 64 voxels"], rows


def traffic(*_: object) -> Tabulated:
    """Return the table of bytes: what goes to a worker and comes back for a batch, and a row on the disk."""
    from scanner_sim.campaign.batches import most_together
    from scanner_sim.campaign.reading import read_campaign
    from scanner_sim.campaign.store import Row
    from scanner_sim.campaign.work import Settings, task_of

    with tempfile.TemporaryDirectory() as place:
        written(Path(place), 4000)
        campaign = read_campaign(Path(place) / "plan.yaml")
        base, many = pickle.dumps(campaign.base), most_together(campaign.base)
        rows = []
        for count in (1, many):
            task = len(pickle.dumps(task_of(campaign, base, range(count), Settings(Path(place)))))
            values = dict.fromkeys(campaign.plan.measure, 0.1 / 3.0)
            back = len(
                pickle.dumps(tuple(Row(run, campaign.seed(run), "", 0.1, values) for run in range(count)))
            )
            rows.append([str(count), f"{task:,} B", f"{back:,} B", f"{(task + back) / count:,.0f} B"])
    return ["runs of a batch", "to the worker", "back", "of one run"], rows


def kills(chosen: argparse.Namespace, say: Callable[[str], None]) -> Tabulated:
    """Kill a campaign at random moments; return the table of how often, and of what became of its rows."""
    runs, draw = 4000, random.Random(chosen.seed)
    done = {"worker": 0, "master": 0}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        written(folder, runs)
        small = (folder / "scene.yaml").read_text(encoding="utf-8").replace("64", "16")
        (folder / "scene.yaml").write_text(small, encoding="utf-8")
        if started(folder, 0, "serial").wait():
            raise SystemExit("the campaign failed")
        process, restarts = started(folder, 2), 0
        while sum(done.values()) < chosen.kills and process.poll() != 0:
            if process.returncode is not None:
                # A worker was killed before it had begun: the command says so, and is started again.
                process = started(folder, 2)
            time.sleep(draw.uniform(0.0, 10.0))
            say(f"{done}, {rows_done(folder / 'out')} of {runs} rows")
            if draw.random() < 0.4:
                process.kill()
                process.wait()
                done["master"] += 1
                process = started(folder, 2)
                continue
            found = [one for one in family(process.pid) if b"spawn_main" in command_of(one)]
            if found:
                os.kill(draw.choice(found), signal.SIGKILL)
                done["worker"] += 1
        if process.wait() and started(folder, 2).wait():
            raise SystemExit("the campaign failed")
        same = content(folder / "out") == content(folder / "serial")
        restarts = done["master"]
    row = [
        str(done["worker"]),
        str(restarts),
        f"{runs:,}",
        "the same to the last bit" if same else "NOT THE SAME",
    ]
    return ["kills of a worker", "of the process", "rows", "rows of one process without kills"], [row]


def command_of(number: int) -> bytes:
    """Return the command line of a process; nothing of one that is gone."""
    try:
        return Path(f"/proc/{number}/cmdline").read_bytes()
    except OSError:
        return b""


def content(folder: Path) -> str:
    """Return all columns of a campaign but the time that each run took, to the last bit."""
    from scanner_sim import open_campaign

    table = open_campaign(folder).table()
    return repr({name: values.tolist() for name, values in table.items() if name != "seconds"})


PARTS: dict[str, Callable[[argparse.Namespace, Callable[[str], None]], Tabulated]] = {
    "cost": cost,
    "workers": workers,
    "tracks": tracks,
    "overhead": overhead,
    "bytes": traffic,
    "kills": kills,
}


def markdown(name: str, head: list[str], rows: list[list[str]]) -> None:
    """Write a table into the page of the documents, between its marks."""
    sys.path.append(str(ROOT / "docs"))
    from made_tables import rewrite_table

    rewrite_table(PAGE, f"benchmarks/campaigns.py --only {name}", head, rows)


def main() -> None:
    """Measure what was asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), help="parts that are run")
    parser.add_argument("--runs", nargs="+", type=int, default=[100, 1000, 10_000], help="scenarios of cost")
    parser.add_argument("--tracks", type=int, default=1000, help="tracking runs")
    parser.add_argument("--kills", type=int, default=20, help="number of kills")
    parser.add_argument("--seed", type=int, default=1, help="of the moments of the kills")
    parser.add_argument("--quick", action="store_true", help="small sizes")
    parser.add_argument("--markdown", action="store_true", help="write the tables into docs/performance.md")
    chosen, console = parser.parse_args(), Console()
    if chosen.quick:
        chosen.runs, chosen.kills = [100], 4
    for name in chosen.only:
        with Console(stderr=True).status(name) as status:
            head, rows = PARTS[name](chosen, lambda words, name=name: status.update(f"{name}: {words}"))
        table = Table(*head, title=name)
        for row in rows:
            table.add_row(*row)
        console.print(table)
        if chosen.markdown:
            markdown(name, head, rows)


if __name__ == "__main__":
    main()
