"""Plant faults in a copy of the package, one at a time, and see which test notices.

    plant.py                        all of them, and the table that says what noticed each
    plant.py --only ranging         those of one list, or whose name holds the text
    plant.py --tenth 3              every tenth, from the third
    plant.py --minutes 3            as many as three minutes allow
    plant.py --noticed              those of which the table says what notices them
    plant.py --unasked              those of which it does not
    plant.py --table                none, but write the table of what is known: here, or from the table itself where the
                                    fault stands as it did and the test that noticed is still there

A list (``ranging.toml``) names the tests of each file, quick ones first, and the faults: a text that stands once in the
file, and what stands there instead. A fault lives if all of its tests pass. What cannot be noticed, because the result
is the same, is not in the lists. The test that the table names is asked first, then the quick ones, then the slow. What
came out is kept in ``build/planted.jsonl`` and holds as long as the file and the tests that were asked stay as they
are, so a run that was broken off goes on where it was.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import multiprocessing
import os
import re
import shutil
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

HERE = Path(__file__).resolve().parent
REPOSITORY = HERE.parents[1]
TABLE = HERE / "README.md"
RECORD = REPOSITORY / "build" / "planted.jsonl"
COPIED = ("scanner_sim", "tests", "configs", "scenes", "docs", "benchmarks", "pyproject.toml", "README.md")
SECONDS = 900.0
"""Time on the clock after which a fault counts as noticed: the right program needs far less."""
PRELOADED = [
    "importlib.metadata",
    "matplotlib.pyplot",
    "mitsuba",
    "numpy",
    "pint",
    "pydantic",
    "pytest",
    "scipy.optimize",
    "scipy.spatial.transform",
    "scipy.stats",
]
"""What the processes that run tests are born with: none of it is of the package."""


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

    def plant(self, repository: Path) -> str:
        """Change the file in a copy of the repository; return what stood there."""
        path = repository / "scanner_sim" / self.file
        text = path.read_text(encoding="utf-8")
        if text.count(self.was) != 1:
            raise ValueError(
                f"{self.file} holds {self.was!r} {text.count(self.was)} times: it must stand once"
            )
        self.write(repository, text.replace(self.was, self.now))
        return text

    def write(self, repository: Path, text: str) -> None:
        """Write the file, and forget what Python compiled of it: two faults of one second look alike to it."""
        path = repository / "scanner_sim" / self.file
        path.write_text(text, encoding="utf-8")
        for compiled in path.parent.glob(f"__pycache__/{path.stem}.*"):
            compiled.unlink()


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


class Record:
    """What came out before, on this machine and in the table."""

    def __init__(self) -> None:
        lines = RECORD.read_text(encoding="utf-8").splitlines() if RECORD.exists() else []
        self.known = {key: (killer, digest) for key, killer, digest in map(json.loads, lines)}
        self.named = dict(_killers(TABLE.read_text(encoding="utf-8"))) if TABLE.exists() else {}

    def find(self, fault: Fault, repository: Path) -> str | None:
        """Return what noticed a fault, empty for nothing, or None if that is not known or no longer holds."""
        killer, digest = self.known.get(_key(fault, repository), (None, ""))
        return killer if killer is not None and digest == _tests(fault, killer, repository) else None

    def hint(self, fault: Fault, repository: Path) -> str:
        """Return the test that most likely notices a fault, empty if none is known."""
        killer, _ = self.known.get(_key(fault, repository), ("", ""))
        killer = killer or self.named.get(_row(fault), "")
        return killer if (repository / "tests" / killer.split("::")[0]).is_file() else ""

    def stands(self, fault: Fault, repository: Path) -> str:
        """Return the test that the table names for a fault, empty if there is none, or not any more."""
        killer = self.named.get(_row(fault), "")
        file, *inside = killer.partition("[")[0].split("::")
        path = repository / "tests" / file
        known = path.is_file() and all(name in path.read_text(encoding="utf-8") for name in inside)
        return killer if known else ""

    def keep(self, fault: Fault, repository: Path, killer: str) -> None:
        """Add an outcome."""
        entry = (_key(fault, repository), killer, _tests(fault, killer, repository))
        self.known[entry[0]] = entry[1:]
        RECORD.parent.mkdir(exist_ok=True)
        with RECORD.open("a", encoding="utf-8") as file:
            file.write(json.dumps(entry) + "\n")


def _key(fault: Fault, repository: Path) -> str:
    source = (repository / "scanner_sim" / fault.file).read_text(encoding="utf-8")
    return hashlib.sha256("\0".join((fault.file, fault.was, fault.now, source)).encode()).hexdigest()


def _tests(fault: Fault, killer: str, repository: Path) -> str:
    """Return a digest of the tests that an outcome rests on: the one that noticed, or all that did not."""
    noticed = killer.split("::")[0]
    asked = [repository / "tests" / name for name in ([noticed] if noticed.endswith(".py") else fault.tests)]
    # A test that has moved since is not the one that noticed.
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in asked if path.is_file())).hexdigest()


class NoSuchTestError(Exception):
    """A test that was to be asked is not there: what it would say of a fault is not known."""


def seen(fault: Fault, repository: Path, hint: str) -> Outcome:
    """Return which test notices a fault; the likely one is asked first, if it still is there, and slow ones last."""
    before = time.monotonic()
    text = fault.plant(repository)
    killer = ""
    try:
        if hint:
            with contextlib.suppress(NoSuchTestError):
                killer = asked_of(repository, (hint,), "")
        for marked in ("not slow", "slow"):
            killer = killer or asked_of(repository, fault.tests, marked)
    finally:
        fault.write(repository, text)
    return Outcome(fault, killer, time.monotonic() - before)


def asked_of(repository: Path, tests: tuple[str, ...], marked: str) -> str:
    """Return the first of some tests that fails in a process of its own, empty if all pass."""
    log = repository / "log.txt"
    process = multiprocessing.get_context("forkserver").Process(
        target=_ask, args=(repository, tests, marked, log)
    )
    process.start()
    process.join(SECONDS)
    if process.exitcode is None:
        process.kill()
        process.join()
        return "no end"
    return noticed(tests, process.exitcode, log.read_text(encoding="utf-8", errors="replace"))


def noticed(tests: tuple[str, ...], status: int, said: str) -> str:
    """Return the first test that failed by what pytest said and the status it ended with, empty if all passed.

    Raises
    ------
    NoSuchTestError
        If one of the tests is not there.
    """
    found = re.search(r"^(?:FAILED|ERROR) tests/(.+?)(?: - |$)", said, re.MULTILINE)
    if found:
        return found[1]
    if status < 0:
        return "the process died"
    if re.search(r"^ImportError while loading conftest", said, re.MULTILINE):
        return "conftest.py"
    if status == 4:
        raise NoSuchTestError(f"{tests} cannot be asked, since one of them is not there:\n{said}")
    if status not in (0, 5):  # all passed, or none is so marked
        raise RuntimeError(f"{tests} did not run:\n{said}")
    return ""


def _ask(repository: Path, tests: tuple[str, ...], marked: str, log: Path) -> None:
    """Run tests in this process, which knows nothing of the package yet."""
    import pytest

    output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.chdir(repository)
    os.environ["PYTHONPATH"] = str(repository)
    # What is compiled once is there for the next fault, too.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    sys.dont_write_bytecode = False
    sys.path.insert(0, str(repository))
    options = ["-x", "-q", "-n", "0", "-p", "no:cacheprovider", "--tb=no", "-m", marked]
    sys.exit(pytest.main([*options, *(f"tests/{name}" for name in tests)]))


def plant(chosen: list[Fault], jobs: int, minutes: float) -> list[Outcome]:
    """Plant faults, so many at a time, each in a copy of its own, until the time is over; say what became of each."""
    copies: SimpleQueue[Path] = SimpleQueue()
    record = Record()
    end = time.monotonic() + 60.0 * minutes
    outcomes = []

    def one(fault: Fault) -> Outcome | None:
        repository = copies.get()
        try:
            killer = record.find(fault, repository)
            if killer is not None:
                return Outcome(fault, killer, 0.0)
            if time.monotonic() > end:
                return None
            outcome = seen(fault, repository, record.hint(fault, repository))
            record.keep(fault, repository, outcome.killer)
            return outcome
        finally:
            copies.put(repository)

    multiprocessing.get_context("forkserver").set_forkserver_preload(PRELOADED)
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(jobs) as pool:
        for number in range(jobs):
            copies.put(copied(Path(folder) / str(number)))
        for number, outcome in enumerate(pool.map(one, chosen), 1):
            if outcome is not None:
                outcomes.append(outcome)
                what = outcome.killer or "LIVES"
                name = outcome.fault.name
                print(f"{number}/{len(chosen)}  {outcome.seconds:4.0f} s  {name}\n      {what}", flush=True)
    return outcomes


def copied(repository: Path) -> Path:
    repository.mkdir()
    ignored = shutil.ignore_patterns("__pycache__")
    for name in COPIED:
        source = REPOSITORY / name
        if source.is_dir():
            shutil.copytree(source, repository / name, ignore=ignored)
        else:
            shutil.copyfile(source, repository / name)
    return repository


def table(chosen: list[Fault], outcomes: list[Outcome]) -> str:
    """Return the page that says what noticed each fault."""
    killers = {outcome.fault.name: _cell(outcome.killer) or "**nothing**" for outcome in outcomes}
    dead = sum(bool(outcome.killer) for outcome in outcomes)
    lines = [
        "# Planted faults, and the tests that notice them",
        "",
        f"Of {len(chosen)} faults {len(outcomes)} have a verdict, and {dead} of these were noticed. `make mutants`",
        "plants them one by one and writes this page; the lists beside it name each fault, and the tests asked.",
        "Those without a verdict were not planted yet, or not all of the tests that may notice them were asked.",
    ]
    for room in dict.fromkeys(fault.room for fault in chosen):
        lines += ["", f"## {room}", "", "| file | was | now | noticed by |", "|---|---|---|---|"]
        lines += [
            f"{_row(fault)}{killers.get(fault.name, 'no verdict yet')} |"
            for fault in chosen
            if fault.room == room
        ]
    return "\n".join(lines) + "\n"


def _row(fault: Fault) -> str:
    """Return a line of the table up to what noticed the fault."""
    was, now = (f"`{_cell(text)}`" if text.strip() else "" for text in (fault.was, fault.now))
    return f"| {fault.file} | {was} | {now} | "


def _killers(page: str) -> Iterator[tuple[str, str]]:
    """Yield the beginning of each line of the table, and the test that it names."""
    for line in page.splitlines():
        found = re.fullmatch(r"(\| .* \| )(\S+\.py(?:::.*)?) \|", line)
        if found:
            yield found[1], found[2].replace(r"\|", "|")


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
    known = arguments.add_mutually_exclusive_group()
    known.add_argument(
        "--noticed", action="store_true", help="only faults of which the table says what notices them"
    )
    known.add_argument("--unasked", action="store_true", help="only the others")
    arguments.add_argument(
        "--minutes", type=float, default=float("inf"), help="plant no more after this time"
    )
    arguments.add_argument(
        "--table", action="store_true", help="plant nothing, write the table of what is known"
    )
    arguments.add_argument("-j", "--jobs", type=int, default=1, help="faults at a time (1)")
    given = arguments.parse_args()
    chosen = [fault for fault in faults() if given.only in (fault.room, "") or given.only in fault.name]
    if given.noticed or given.unasked:
        named = Record().named
        chosen = [fault for fault in chosen if (_row(fault) in named) == given.noticed]
    if given.tenth is not None:
        chosen = chosen[given.tenth % 10 :: 10]
    outcomes = plant(chosen, given.jobs, 0.0 if given.table else given.minutes)
    alive = [outcome.fault.name for outcome in outcomes if not outcome.killer]
    if (
        given.tenth is None
        and not (given.only or given.noticed or given.unasked)
        and (given.table or len(outcomes) == len(chosen))
    ):
        record, asked = Record(), {outcome.fault for outcome in outcomes}
        earlier = [
            Outcome(fault, killer, 0.0)
            for fault in chosen
            if fault not in asked and (killer := record.stands(fault, REPOSITORY))
        ]
        TABLE.write_text(table(chosen, outcomes + earlier), encoding="utf-8")
    print(f"{len(outcomes)} of {len(chosen)} faults were asked after")
    print(f"{len(outcomes) - len(alive)} of {len(outcomes)} are noticed", *alive, sep="\n  lives: ")
    return bool(alive)


if __name__ == "__main__":
    sys.exit(main())
