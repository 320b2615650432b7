"""Run the tests with other seeds, and judge how often they fail by the levels that they state.

    seeds.py -n 20                          all of them but those marked ``pinned``, twenty times
    seeds.py -n 5 --first 21                the next five shifts
    seeds.py -n 20 tests/statistical        some of the tests
    seeds.py -n 20 --quick                  those that are not slow

A test that fails in several runs, or more failures altogether than the levels allow, is a finding: its level, its claim
or the program is wrong. A run of all of them adds a row to the table of docs/tested.md.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path

from claims import LEVEL
from scipy import stats

REPOSITORY = Path(__file__).resolve().parents[1]
PAGE = REPOSITORY / "docs" / "tested.md"
END = "\n<!-- end of tests/seeds.py -->"
FOLDERS = ["tests"]
SURE = 1e-3
"""Chance with which true levels are called wrong, for all tests together."""


def failures(shift: int, places: list[str], marked: str) -> tuple[list[str], int]:
    """Return the names of the tests that fail with shifted seeds, and how many ran, of those marked so, not pinned."""
    command = [sys.executable, "-m", "pytest", "-q", "-m", f"not pinned{marked}"]
    command += ["-p", "no:cacheprovider", "--tb=no", f"--hypothesis-seed={shift}", *places]
    done = subprocess.run(
        command,
        cwd=REPOSITORY,
        env=os.environ | {"SCANNER_SIM_SEED_SHIFT": str(shift)},
        capture_output=True,
        text=True,
        check=False,
    )
    counted = re.findall(r"(\d+) (?:passed|failed|error)", done.stdout)
    return re.findall(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", done.stdout, re.MULTILINE), sum(map(int, counted))


def main() -> int:
    """Run as the module says; the exit status is 1 if a level is not true."""
    arguments = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    arguments.add_argument("-n", type=int, default=20, help="shifts of the seeds (20)")
    arguments.add_argument("--first", type=int, default=1, help="the first of them (1)")
    arguments.add_argument("--quick", action="store_true", help="leave out slow tests")
    arguments.add_argument("places", nargs="*", default=FOLDERS, help="folders or tests")
    given = arguments.parse_args()
    found: Counter[str] = Counter()
    ran = 0
    for shift in range(given.first, given.first + given.n):
        names, ran = failures(shift, given.places, " and not slow" if given.quick else "")
        found.update(names)
        print(f"shift {shift}: {len(names)} of {ran} fail", *names, sep="\n    ", flush=True)
    most = int(stats.binom.isf(SURE / max(ran, 1), given.n, LEVEL))
    allowed = int(stats.binom.isf(SURE, given.n * ran, LEVEL))
    wrong = {name: count for name, count in found.items() if count > most}
    total = sum(found.values())
    print(f"{total} failures in {given.n} runs of {ran} tests; {allowed} are allowed, {most} of one test")
    for name, count in sorted(wrong.items()):
        print(f"  not at its level: {name}, {count} of {given.n}")
    if given.places == FOLDERS:
        last = given.first + given.n - 1
        functions: Counter[str] = Counter()
        for name, count in found.items():
            functions[name.rpartition("::")[2].partition("[")[0]] += count
        names = ", ".join(
            f"`{name}` ({count})" if count > 1 else f"`{name}`" for name, count in sorted(functions.items())
        )
        today = datetime.now(UTC).date().isoformat()
        shifts = f"{given.first} to {last}" if given.n > 1 else f"{given.first}"
        which = f"all {ran} quick ones" if given.quick else f"all {ran}"
        row = f"| {today} | {shifts} | {which} | {total} | {allowed} | {names or 'none'} |\n"
        PAGE.write_text(PAGE.read_text(encoding="utf-8").replace(END, row + END), encoding="utf-8")
    return bool(wrong) or total > allowed


if __name__ == "__main__":
    sys.exit(main())
