"""What sunlight costs: each lit scenario against the same scene in the dark.

Run as ``python benchmarks/lighting.py [--size N]``. Each scenario is measured with a laser that always shines, as the
paper's does, and with one that is off for half of the dwell, when the line sees the background alone, to be subtracted.
*Kept* is the share of the voxels measured in the dark by the same instrument that are still measured; *moved* the share
of those whose range differs from the dark one by more than 6 σ; *error* the background's Monte-Carlo error over its
shot noise, in the window of 200 µm: its median, two percentiles, and the share of the voxels where it is below 1.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from scanner_sim import load_scenario, simulate

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
NAMES = (
    "lighting_normal",
    "lighting_partial_shadow",
    "lighting_full_shadow",
    "lighting_saturation",
    "lighting_back",
    "lighting_worst_case",
    "lighting_worst_case_no_filter",
)
BANDWIDTHS = ("10 nm", "3 nm")
LASER_OFF = (0.0, 0.5)


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--size", type=int, default=192, help="rows and columns")
    size = arguments.parse_args().size
    table = Table("scenario", "laser off", "kept", "moved", "error: median", "90 %", "99 %", "below 1")
    runs: list[tuple[str, str, list[str]]] = [(name, name, []) for name in NAMES]
    for bandwidth in BANDWIDTHS:
        narrow = f"scanner.filter={{bandwidth: {bandwidth}, effective_index: 3.5}}"
        runs.append((f"lighting_normal, {bandwidth}", "lighting_normal", [narrow]))
    for title, name, changes in runs:
        for share in LASER_OFF:
            found = figures(name, size, f"scanner.laser_off={share}", *changes)
            table.add_row(title, f"{share:g}", *found)
    Console().print(table)


def figures(name: str, size: int, *changes: str) -> tuple[str, ...]:
    raster = [f"scan.rows={size}", f"scan.columns={size}", *changes]
    lit = simulate(load_scenario(CONFIGS / f"{name}.yaml", raster))
    dark = simulate(load_scenario(CONFIGS / f"{name}.yaml", [*raster, "lighting={}"]))
    both = lit.valid & dark.valid
    sigma = np.hypot(lit["sigma_range_m"], dark["sigma_range_m"])[both]
    moved = np.abs(lit["range_m"] - dark["range_m"])[both] > 6.0 * sigma
    shining = lit["background"] > 1.0
    error = lit["background_error"][shining] / np.sqrt(lit["background"][shining])
    middle, high, highest = np.percentile(error, [50, 90, 99]) if shining.any() else (np.nan,) * 3
    below = np.mean(error < 1.0) if shining.any() else np.nan
    kept = both.sum() / dark.valid.sum()
    shares = f"{100.0 * kept:.2f} %", f"{moved.mean():.1e}"
    return *shares, f"{middle:.2f}", f"{high:.1f}", f"{highest:.1f}", f"{100.0 * below:.0f} %"


if __name__ == "__main__":
    main()
