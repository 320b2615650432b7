"""Whether a GPU finds what the processor finds, and how much faster: statistics of test boards, not bytes.

Run as ``python benchmarks/device.py [--seeds N] [--level P]`` where there is an NVIDIA GPU; without one it says so and
ends with 2. ``--cpu`` puts the processor on both sides, and ``--set KEY=VALUE`` changes the second side: together they
show what the comparison would notice.

Each side images the boards with seeds of its own. What is compared are means over an image, of which each seed gives
one that is independent of the others: the pull (range − truth)/σ, its square, log σ, the signal, and the share of each
status, by each way of ranging. Welch's t test tells whether the sides differ; all tests together call equal sides
different with the chance ``--level`` at most (Bonferroni). Then both sides image with one seed: here only rounding
differs, and the share of voxels with the same status and the largest difference of 99 % of the ranges, in σ, are told
without a verdict.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.stats import ttest_ind_from_stats

from scanner_sim import InputError, RangeImage, Status, load_scenario, simulate
from scanner_sim.render.libraries import DeviceChoice, gpu_name

BOARDS = Path(__file__).resolve().parents[1] / "configs" / "tof_both.yaml"
WAYS = ("", "tof.", "fused.")
RARE = 3
"""Seeds of both sides in which a status must have occurred for its share to be tested."""


def image(device: DeviceChoice, seed: int, size: int, changes: list[str]) -> tuple[RangeImage, float]:
    """Return an image of the boards and the seconds that it took."""
    scenario = load_scenario(BOARDS, [f"seed={seed}", f"scan.rows={size}", f"scan.columns={size}", *changes])
    begun = time.perf_counter()
    made = simulate(scenario, device=device)
    return made, time.perf_counter() - begun


def figures(made: RangeImage) -> dict[str, float]:
    """Return means over an image."""
    truth, found = made["truth.range_m"], {}
    for way in WAYS:
        status, sigma = made[f"{way}status"], made[f"{way}sigma_range_m"]
        valid = (status == Status.VALID) & (truth > 0.0)
        pull = (made[f"{way}range_m"] - truth)[valid].astype(np.float64) / sigma[valid]
        pull = pull[np.abs(pull) < 10.0]  # at edges a range between two boards belongs to neither
        found[f"{way}range: pull"] = float(pull.mean())
        found[f"{way}range: pull²"] = float((pull**2).mean())
        found[f"{way}range: log σ"] = float(np.log(sigma[valid]).mean())
        if way != "fused.":
            found[f"{way}signal"] = float(made[f"{way}Y"].mean(dtype=np.float64))
        for code in Status:
            found[f"{way}status {code.name}"] = float((status == code).mean())
    return found


def compared(
    first: list[dict[str, float]], second: list[dict[str, float]]
) -> list[tuple[str, float, float, float]]:
    """Return name, the two means and p of each figure that can be tested.

    p is 0 where two sides without scatter differ.
    """
    rows = []
    for name in first[0]:
        a, b = (np.array([one[name] for one in side]) for side in (first, second))
        if "status" in name and np.count_nonzero([*a, *b]) < RARE:
            continue
        if np.ptp([*a, *b]) == 0.0:
            continue
        told = [number for side in (a, b) for number in (side.mean(), side.std(ddof=1), len(side))]
        scatter = max(np.ptp(a), np.ptp(b)) > 0.0
        p = float(ttest_ind_from_stats(*told, equal_var=False).pvalue) if scatter else 0.0
        rows.append((name, told[0], told[3], p))
    return rows


def alike(first: RangeImage, second: RangeImage) -> tuple[float, float]:
    """Return the share of voxels with the same status, and what 99 % of ranges differ by at most, in σ."""
    same = first["status"] == second["status"]
    both = same & (first["status"] == Status.VALID)
    apart = np.abs(first["range_m"] - second["range_m"])[both] / first["sigma_range_m"][both]
    return float(same.mean()), float(np.quantile(apart, 0.99))


def main() -> int:
    """Compare the sides; return 1 where they differ and 2 where there is no second one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=12, help="of each side")
    parser.add_argument("--size", type=int, default=96, help="rows and columns")
    parser.add_argument("--level", type=float, default=1e-3, help="chance of calling equal sides different")
    parser.add_argument("--cpu", action="store_true", help="the processor on both sides")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="of the second side")
    given, console = parser.parse_args(), Console()
    if not given.cpu and gpu_name() is None:
        console.print("No usable NVIDIA GPU is at hand: nothing was compared. --cpu compares two processors.")
        return 2
    sides: list[tuple[str, DeviceChoice, list[str]]] = [
        ("processor", "cpu", []),
        ("processor again" if given.cpu else str(gpu_name()), "cpu" if given.cpu else "cuda", given.set),
    ]
    found: list[list[dict[str, float]]] = []
    fastest: list[float] = []
    for number, (name, device, changes) in enumerate(sides):
        runs: list[Any] = []
        for seed in track(range(given.seeds + 1), name, console=Console(stderr=True), transient=True):
            runs.append(image(device, 1 + seed + 1000 * number, given.size, changes))
        found.append([figures(made) for made, _ in runs[1:]])
        fastest.append(min(seconds for _, seconds in runs[1:]))
    rows = compared(*found)
    table = Table("mean over an image", *(name for name, _, _ in sides), "p")
    for name, a, b, p in rows:
        wrong = p < given.level / len(rows)
        table.add_row(name, f"{a:.5g}", f"{b:.5g}", f"{p:.2g}", style="bold red" if wrong else "")
    console.print(table)
    broken = [name for name, _, _, p in rows if p < given.level / len(rows)]
    same, apart = alike(*(image(device, 1, given.size, changes)[0] for _, device, changes in sides))
    console.print(
        f"with one seed: {100.0 * same:.2f} % of the statuses are the same, 99 % of the ranges within {apart:.2g} σ"
    )
    console.print(
        f"speed: {fastest[0] / fastest[1]:.2f} times the processor's (best of {given.seeds} images)"
    )
    console.print(f"differ: {', '.join(broken)}" if broken else f"no difference at the level {given.level:g}")
    return 1 if broken else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as fault:
        print(fault, file=sys.stderr)
        sys.exit(2)
