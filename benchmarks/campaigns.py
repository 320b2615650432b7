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
    CPU time of a run of 2 × 2 and 64 × 64 voxels whose scene is known, in batches and alone, in this process
``bytes``
    what goes to a worker and comes back, and what a row takes on the disk
``kills``
    a campaign on two workers, killed at random moments: a worker, or the process itself, which is then started again.
    Its rows are held against those of one process. ``--kills`` chooses how often, ``--seed`` when

CPU times are those of the workers, their children and Dask included, as ``/proc`` counts them. ``--markdown`` writes the
tables into docs/performance.md, with what they come to on a cluster.
"""

from __future__ import annotations

import argparse
import json
import math
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
from typing import Any

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
    - {name: ball, shape: sphere, radius: 0.4 m, position: [0.5 m, 0 m, 9.5 m], material: grey_reference}
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
