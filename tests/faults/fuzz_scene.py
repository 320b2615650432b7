"""A fuzzer of meshes and of scenes in XML, and the process that opens what it makes.

    fuzz_scene.py mesh -n 1000 --seed 7     a run, with a table of what became of the mutants
    fuzz_scene.py --one mesh/7/123          one of them again

A mutant may give an image, or be refused with one message. Anything else is a finding: another exception, a signal,
no end, a message with control characters or of no end.
"""

from __future__ import annotations

import argparse
import select
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from mutate_scene import WRITERS, mutant

PATIENCE = 120.0
"""Seconds for a mutant: with cold caches a kernel takes some on a busy machine."""
LONGEST = 2000
"""Characters of a message, beside the path of the folder."""


def main() -> int:
    """Run, and return 1 if there was a finding."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("kinds", nargs="*", default=list(WRITERS), metavar="mesh|xml")
    options.add_argument("-n", type=int, default=1000, help="mutants of each kind")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--one", help="the address of a mutant")
    options.add_argument(
        "--worker", action="store_true", help="open the scenarios that are named line by line"
    )
    chosen = options.parse_args()
    if chosen.worker:
        return work()
    addresses = [f"{kind}/{chosen.seed}/{number}" for number in range(chosen.n) for kind in chosen.kinds]
    outcomes, findings = fuzz([chosen.one] if chosen.one else addresses)
    for outcome, times in outcomes.most_common():
        print(f"{times:7d}  {outcome}")
    print("\n".join(f"FINDING {finding}" for finding in findings))
    return 1 if findings else 0


def fuzz(addresses: list[str]) -> tuple[Counter[str], list[str]]:
    """Open mutants in a process of their own; return how often they ended in what way, and the findings."""
    outcomes: Counter[str] = Counter()
    findings: list[str] = []
    worker: subprocess.Popen[str] | None = None
    for address in addresses:
        with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
            scenario = mutant(address)(Path(folder))
            worker = worker or start()
            outcome, _, message = ask(worker, scenario).partition("\t")
        outcomes[address.split("/")[0] + " " + outcome] += 1
        if outcome not in ("image", "refused") or not message.isprintable() or len(message) > LONGEST:
            findings.append(f"{address}: {outcome} {message[:500]!r}")
        if outcome in ("signal", "no end"):
            worker.kill()
            worker.wait()
            worker = None
    if worker is not None:
        worker.communicate()
    return outcomes, findings


def start() -> subprocess.Popen[str]:
    """Start a process that opens scenarios."""
    return subprocess.Popen(
        [sys.executable, __file__, "--worker"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )


def ask(worker: subprocess.Popen[str], scenario: Path) -> str:
    """Return what became of a scenario, or how its process ended."""
    assert worker.stdin is not None
    assert worker.stdout is not None
    worker.stdin.write(f"{scenario}\n")
    worker.stdin.flush()
    end = time.monotonic() + PATIENCE
    while not select.select([worker.stdout], [], [], max(0.0, end - time.monotonic()))[0]:
        if time.monotonic() >= end:
            return "no end\t"
    answer = worker.stdout.readline().rstrip("\n")
    return answer or f"signal\t{worker.wait()}"


def work() -> int:
    """Open the scenarios that the standard input names, and say in a line what became of each."""
    from scanner_sim import load_scenario, simulate
    from scanner_sim.errors import InputError

    for line in sys.stdin:
        scenario = line.rstrip("\n")
        folder = str(Path(scenario).parent)
        try:
            simulate(load_scenario(scenario), device="cpu")
            answer = "image\t"
        except InputError as error:
            # A message has a line for each fault, and no other character that is not to be printed.
            answer = "refused\t" + " ".join(str(error).replace(folder, "").split("\n"))
        except BaseException as error:  # the finding itself
            answer = f"raw\t{type(error).__name__}: {ascii(str(error))[:500]}"
        print(answer.replace("\n", "␊"), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
