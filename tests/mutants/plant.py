"""Plant faults in a copy of the package, one at a time, and see which test notices.

    plant.py                        all of them, and the table that says what noticed each
    plant.py --only ranging         those of one list, or whose name holds the text
    plant.py --tenth 3              every tenth, from the third

A list (``ranging.toml``) names the tests of each file, quick ones first, and the faults: a text that stands once in the
file, and what stands there instead. A fault lives if all of its tests pass. What cannot be noticed, because the result
is the same, is not in the lists.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

HERE = Path(__file__).resolve().parent
REPOSITORY = HERE.parents[1]
TABLE = HERE / "README.md"
COPIED = ("scanner_sim", "tests", "configs", "scenes", "docs", "benchmarks", "pyproject.toml", "README.md")
SECONDS = 1800.0
"""Time on the clock after which a fault counts as noticed: the right program needs far less."""


@dataclass(frozen=True)
class Fault:
    """One planted fault.

    ``room`` the list it stands in; ``file`` relative to the package; ``was`` and ``now`` the text in the file before
    and after; ``tests`` files, relative to ``tests``, of which one at least notices it.
    """

    room: str
    file: str
    was: str
    now: str
    tests: tuple[str, ...]

    @property
    def name(self) -> str:
        """What stands in the table, on one line."""
        return " ".join(f"{self.file}: {self.was} → {self.now or 'nothing'}".split())

    def plant(self, repository: Path) -> None:
        """Change the file in a copy of the repository."""
        path = repository / "scanner_sim" / self.file
        text = path.read_text(encoding="utf-8")
        if text.count(self.was) != 1:
            raise ValueError(
                f"{self.file} holds {self.was!r} {text.count(self.was)} times: it must stand once"
            )
        path.write_text(text.replace(self.was, self.now), encoding="utf-8")

    def remove(self, repository: Path) -> None:
        """Put the file back as it was."""
        shutil.copyfile(REPOSITORY / "scanner_sim" / self.file, repository / "scanner_sim" / self.file)


@dataclass(frozen=True)
class Outcome:
    """What became of a fault: ``killer`` the test that noticed it, empty if it lives, and the time [s] that took."""

    fault: Fault
    killer: str
    seconds: float


def faults() -> list[Fault]:
    """Return the faults of all lists, in the order of their names."""
    found = []
    for path in sorted(HERE.glob("*.toml")):
        for file, entry in tomllib.loads(path.read_text(encoding="utf-8")).items():
            found += [
                Fault(path.stem, file, was, now, tuple(more or entry["tests"]))
                for was, now, *more in entry["faults"]
            ]
    return found


def seen(fault: Fault, repository: Path) -> Outcome:
    """Return which test notices a fault."""
    fault.plant(repository)
    before = time.monotonic()
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-m", "", "-p", "no:cacheprovider", "--tb=no"]
    environment = os.environ | {"PYTHONPATH": str(repository), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            [*command, *(f"tests/{name}" for name in fault.tests)],
            cwd=repository,
            env=environment,
            capture_output=True,
            text=True,
            timeout=SECONDS,
            check=False,
        )
        if done.returncode > 2:  # pytest's own: wrong use, or no test
            raise RuntimeError(f"the tests of {fault.name} did not run:\n{done.stdout}{done.stderr}")
        killer = "" if done.returncode == 0 else _killer(done.stdout)
    except subprocess.TimeoutExpired:
        killer = "no end"
    finally:
        fault.remove(repository)
    return Outcome(fault, killer, time.monotonic() - before)


def _killer(output: str) -> str:
    """Return the name of the first test that failed."""
    found = re.search(r"^(?:FAILED|ERROR) tests/(\S+)", output, re.MULTILINE)
    return found[1] if found else "the process died"


def plant(chosen: list[Fault], jobs: int) -> list[Outcome]:
    """Plant faults, so many at a time, each in a copy of its own; say what became of each."""
    copies: SimpleQueue[Path] = SimpleQueue()
    outcomes = []

    def one(fault: Fault) -> Outcome:
        repository = copies.get()
        try:
            return seen(fault, repository)
        finally:
            copies.put(repository)

    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(jobs) as pool:
        for number in range(jobs):
            copies.put(_copy(Path(folder) / str(number)))
        for number, outcome in enumerate(pool.map(one, chosen), 1):
            outcomes.append(outcome)
            what = outcome.killer or "LIVES"
            print(
                f"{number}/{len(chosen)}  {outcome.seconds:4.0f} s  {outcome.fault.name}\n      {what}",
                flush=True,
            )
    return outcomes


def _copy(repository: Path) -> Path:
    repository.mkdir()
    ignored = shutil.ignore_patterns("__pycache__")
    for name in COPIED:
        source = REPOSITORY / name
        if source.is_dir():
            shutil.copytree(source, repository / name, ignore=ignored)
        else:
            shutil.copyfile(source, repository / name)
    return repository


def table(outcomes: list[Outcome]) -> str:
    """Return the page that says what noticed each fault."""
    dead = sum(bool(outcome.killer) for outcome in outcomes)
    lines = [
        "# Planted faults, and the tests that notice them",
        "",
        f"{dead} of {len(outcomes)} are noticed. `make mutants` plants them one by one and writes this page; the lists",
        "beside it name each fault, and the tests that are asked.",
    ]
    for room in dict.fromkeys(outcome.fault.room for outcome in outcomes):
        lines += ["", f"## {room}", "", "| file | was | now | noticed by |", "|---|---|---|---|"]
        for outcome in outcomes:
            fault = outcome.fault
            if fault.room == room:
                was, now = (f"`{_cell(text)}`" if text.strip() else "" for text in (fault.was, fault.now))
                lines.append(f"| {fault.file} | {was} | {now} | {_cell(outcome.killer) or '**nothing**'} |")
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", r"\|")


def main() -> int:
    """Run as the module says; the exit status is 1 if a fault lives."""
    arguments = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    arguments.add_argument("--only", default="", help="one list, or a part of a fault's name")
    arguments.add_argument(
        "--tenth", type=int, help="every tenth fault, from this number on (0 to 9; larger ones wrap)"
    )
    arguments.add_argument("-j", "--jobs", type=int, default=1, help="faults at a time (1)")
    given = arguments.parse_args()
    chosen = [fault for fault in faults() if given.only in (fault.room, "") or given.only in fault.name]
    if given.tenth is not None:
        chosen = chosen[given.tenth % 10 :: 10]
    outcomes = plant(chosen, given.jobs)
    alive = [outcome.fault.name for outcome in outcomes if not outcome.killer]
    if given.tenth is None and not given.only:
        TABLE.write_text(table(outcomes), encoding="utf-8")
    print(f"{len(chosen) - len(alive)} of {len(chosen)} faults are noticed", *alive, sep="\n  lives: ")
    return bool(alive)


if __name__ == "__main__":
    sys.exit(main())
