"""False alarms of ``scanner-sim compare`` over many seeds, and what its laws would find.

Run as ``python benchmarks/compare.py [--seeds N] [--level P] [--quick] [--config FILE]``. A right program breaks a law
in at most the stated share of the seeds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from scanner_sim import load_scenario
from scanner_sim.validation.compare.comparison_setup import ComparisonSetup
from scanner_sim.validation.compare.run import judge_laws

PRESET = Path(__file__).parents[1] / "configs" / "tof_both.yaml"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--level", type=float, default=0.05)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--config", type=Path, default=PRESET)
    given = parser.parse_args()
    console = Console()
    least: dict[str, float] = {}
    power: dict[str, float] = {}
    broken: dict[str, int] = {}
    accused = 0
    for number in range(given.seeds):
        scenario = load_scenario(given.config, [f"seed={1000 * (given.first + number) + 7}"])
        found = judge_laws(
            ComparisonSetup(scenario, quick=given.quick, device=given.device), level=given.level
        )
        accused += bool(found.broken)
        for finding in found.findings:
            if not finding.checks:
                continue
            worst = min(check.p for check in finding.checks)
            least[finding.name] = min(least.get(finding.name, 1.0), worst)
            most = max(check.detects_99 for check in finding.checks)
            power[finding.name] = max(power.get(finding.name, 0.0), most)
            broken[finding.name] = broken.get(finding.name, 0) + (finding.verdict == "broken")
        console.print(
            f"seed {scenario.seed}: " + (", ".join(f.name for f in found.broken) or "all laws hold"),
            highlight=False,
        )
    table = Table("law", "broken", "least p of a check", "found with 99 %", title=f"level {given.level:g}")
    for name, p in least.items():
        table.add_row(name, str(broken[name]), f"{p:.2g}", f"{100.0 * power[name]:.2g} %")
    console.print(table)
    share = accused / given.seeds
    error = np.sqrt(given.level * (1.0 - given.level) / given.seeds)
    console.print(
        f"{accused} of {given.seeds} seeds with a broken law: {share:.3f}, at most {given.level:g} ± {error:.3f}"
    )


if __name__ == "__main__":
    main()
