"""A fuzzer that knows the form of its inputs: mutants of shipped scenarios and plans, saved tracking runs and results.

    fuzz.py -n 10000 --states 500 --seed 7      a run, with a table of what became of the mutants
    fuzz.py --one 7/1234                        one of them again, with its traceback
    fuzz.py --corpus                            all that was once found
    fuzz.py --originals                         what the mutants are made from, which must open

An input may give a result, or be refused with one message. Anything else is a finding: another exception, a signal, a
kernel that does not end, memory without bound, a message that is endless or holds control characters. Findings are made
as small as they stay findings, and saved in ``corpus/``.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import json
import os
import re
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mutate import CONFIGS, PLANS, REPOSITORY, Mutant, plan_mutant, scenario_mutant, state_mutant
from mutate_results import result_mutant, sound_results

CORPUS = Path(__file__).with_name("corpus")
LARGEST = 8_000
"""Bytes of a file of the corpus: what stays larger is named by its address alone."""
SECONDS = 90.0
"""Processor time of an input: with cold caches the kernels of a sunlit scene take fifteen."""
PATIENCE = 15.0
"""Time on the clock over processor time after which a process that does nothing counts as hanging."""
PROGRESS = 250
"""Every so many inputs a line says how far it is."""
LIFETIME = 300
"""Inputs of a process: what one leaves behind reaches the next ones, but not all."""
PICTURED = 25
"""Every so many mutants the pictures are drawn too, which take longer than all else."""
SHOWN = 5
"""The same for results, for which there is little else to do."""


@dataclass
class Worker:
    """One process that opens inputs; a dead one is replaced."""

    process: subprocess.Popen[bytes] | None = None
    done: int = 0

    def ask(self, job: dict[str, Any]) -> dict[str, str]:
        """Return what became of an input."""
        process = self._living()
        assert process.stdin is not None
        assert process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            process.stdin.write(json.dumps(job).encode() + b"\n")
            process.stdin.flush()
        ready, _, _ = select.select([process.stdout], [], [], job["seconds"] * PATIENCE)
        line = process.stdout.readline() if ready else b""
        if line:
            self.done += 1
            found: dict[str, str] = json.loads(line)
            return found
        if not ready:
            process.kill()
        code = process.wait()
        self.process = None
        if not ready or -code == signal.SIGXCPU:
            return {"outcome": "finding", "what": f"no end after {job['seconds']:.0f} s of processor time"}
        name = signal.Signals(-code).name if code < 0 else f"exit status {code}"
        return {"outcome": "finding", "what": f"the process died: {name}"}

    def close(self) -> None:
        """End the process."""
        if self.process is not None:
            assert self.process.stdin is not None
            self.process.stdin.close()
            self.process.wait()
            self.process = None

    def _living(self) -> subprocess.Popen[bytes]:
        if self.process is not None and self.done >= LIFETIME:
            self.close()
        if self.process is None:
            self.done = 0
            self.process = subprocess.Popen(
                [sys.executable, str(Path(__file__).with_name("worker.py"))],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
        return self.process


@dataclass
class Fuzzer:
    """A run: where it works, and what was found."""

    folder: Path
    every: int = 1
    counts: Counter[str] = field(default_factory=Counter)
    findings: dict[str, str] = field(default_factory=dict)
    lock: threading.Lock = field(default_factory=threading.Lock)
    _state: str = ""
    _results: Path | None = None

    def state(self) -> str:
        """Return a saved tracking run, from which those of the fuzzer are made."""
        with self.lock:
            if not self._state:
                path = self.folder / "original.json"
                subprocess.run([sys.executable, "-c", _SAVE, str(path)], check=True)
                self._state = path.read_text(encoding="utf-8")
        return self._state

    def results(self) -> Path:
        """Return a folder with a small result of each kind."""
        with self.lock:
            if self._results is None:
                folder = self._empty("originals")
                maker = Path(__file__).with_name("mutate_results.py")
                subprocess.run([sys.executable, str(maker), str(folder)], check=True)
                self._results = folder
        return self._results

    def mutant(self, address: str, keep: frozenset[int] | None = None) -> Mutant | Path:
        """Return the mutant of an address: ``7/12``, ``state/7/12``; of meshes, scenes and results the path."""
        *kind, seed, number = address.split("/")
        if kind == ["state"]:
            return state_mutant(int(seed), int(number), self.state(), keep)
        if kind == ["plan"]:
            return plan_mutant(int(seed), int(number), keep)
        if kind == ["result"]:
            originals = self.results()
            return result_mutant(int(seed), int(number), originals, self._empty(str(threading.get_ident())))
        if kind in (["mesh"], ["xml"]):
            import mutate_scene

            path: Path = mutate_scene.mutant(address)(self._empty(str(threading.get_ident())))
            return path
        return scenario_mutant(int(seed), int(number), keep)

    def open(self, worker: Worker, address: str, mutant: Mutant | Path) -> dict[str, str]:
        """Return what became of a mutant."""
        number = int(address.rpartition("/")[2]) if "/" in address else 1
        job: dict[str, Any] = {
            "kind": next(
                (kind for kind in ("state", "result", "plan") if address.startswith(f"{kind}/")), "scenario"
            ),
            # Of scenes all that is to be looked at comes with the simulation.
            "thorough": address.startswith(("mesh", "xml")) or number % self.every == 0,
            "pictures": number % (SHOWN if address.startswith("result") else PICTURED) == 0,
            "seconds": SECONDS,
            "overrides": [],
        }
        if isinstance(mutant, Path):
            return worker.ask(job | {"path": str(mutant)})
        folder = self._empty(str(threading.get_ident()))
        (folder / "configs").mkdir()
        for name in ("configs/meshes", "configs/angles.csv", "scenes"):
            (folder / name).symlink_to(REPOSITORY / name)
        path = folder / "configs" / ("state.json" if job["kind"] == "state" else "scenario.yaml")
        if job["kind"] == "plan":
            for config in CONFIGS:
                (folder / "configs" / config.name).symlink_to(config)
            path = folder / "configs" / "campaigns" / "plan.yaml"
            path.parent.mkdir()
        path.write_bytes(mutant.text)
        return worker.ask(job | {"path": str(path), "overrides": list(mutant.overrides)})

    def one(self, worker: Worker, address: str) -> None:
        """Open a mutant, count what became of it, and save a finding that is new."""
        mutant = self.mutant(address)
        found = self.open(worker, address, mutant)
        kind = address.rpartition("/")[0].rpartition("/")[0] or "scenario"
        key = re.sub(r"[0-9]+(?!.*\.py)|'.*'", "#", found["what"])[:120]
        with self.lock:
            self.counts[f"{kind}: {found['outcome']}"] += 1
            if (done := self.counts.total()) % PROGRESS == 0:
                print(f"{done} opened, {len(self.findings)} different findings", file=sys.stderr, flush=True)
            if found["outcome"] != "finding":
                return
            new = key not in self.findings
            self.findings.setdefault(key, address)
        print(f"{address}: {found['what']}", flush=True)
        if new and isinstance(mutant, Mutant):
            self._save(address, self._smallest(worker, address, mutant))

    def _smallest(self, worker: Worker, address: str, mutant: Mutant) -> Mutant:
        """Return the mutant without the changes that are not needed for its finding."""
        kept = set(range(4))
        for index in range(4):
            fewer = self.mutant(address, frozenset(kept - {index}))
            assert isinstance(fewer, Mutant)
            if self.open(worker, address, fewer)["outcome"] == "finding":
                kept.discard(index)
                mutant = fewer
        print(f"  {mutant.seed_file}: {', '.join(mutant.edits)}", flush=True)
        return mutant

    def _save(self, address: str, mutant: Mutant) -> None:
        if len(mutant.text) > LARGEST:
            return
        CORPUS.mkdir(exist_ok=True)
        suffix = "json" if address.startswith("state") else "yaml"
        path = CORPUS / f"{address.replace('/', '-')}.{suffix}"
        path.write_bytes(mutant.text)
        if mutant.overrides:
            path.with_suffix(".set").write_text("\n".join(mutant.overrides), encoding="utf-8")

    def _empty(self, name: str) -> Path:
        folder = self.folder / name
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        return folder


_SAVE = f"""
import sys
from scanner_sim.instrument.closed_loop.tracker import Tracker
from scanner_sim.config import load_scenario
config = {str(REPOSITORY / "configs/track_still.yaml")!r}
tracker = Tracker(load_scenario(config, ["scan.pattern.points=32"]), device="cpu")
for _ in range(5):
    next(tracker)
tracker.save(sys.argv[1])
"""


def corpus() -> Iterator[tuple[str, Mutant]]:
    """Yield everything that was once found, by its file's name."""
    for path in sorted(CORPUS.glob("*.yaml")) + sorted(CORPUS.glob("*.json")):
        beside = path.with_suffix(".set")
        overrides = tuple(beside.read_text(encoding="utf-8").split("\n")) if beside.exists() else ()
        yield path.name, Mutant(path.name, path.read_bytes(), overrides, ())


def replay(fuzzer: Fuzzer, worker: Worker) -> None:
    """Open all of the corpus in one process."""
    for name, mutant in corpus():
        kind = next((kind for kind in ("state", "plan") if name.startswith(f"{kind}-")), "")
        found = fuzzer.open(worker, f"{kind}/0/1" if kind else name, mutant)
        fuzzer.counts[f"corpus: {found['outcome']}"] += 1
        if found["outcome"] == "finding":
            fuzzer.findings[name] = name
            print(f"{name}: {found['what']}", flush=True)


def open_originals(fuzzer: Fuzzer, worker: Worker) -> None:
    """Open what the mutants are made from: were it refused, nothing but refusals would be looked at."""
    from mutate_scene import sound_scenes

    folder = fuzzer.folder / "sound"
    folder.mkdir()
    originals: list[tuple[str, Mutant | Path]] = [
        (config.name, Mutant(config.name, config.read_bytes(), (), ())) for config in CONFIGS
    ]
    originals.append(("state/0", Mutant("state", fuzzer.state().encode(), (), ())))
    originals += [(f"plan/{plan.name}/0", Mutant(plan.name, plan.read_bytes(), (), ())) for plan in PLANS]
    results = list(sound_results(fuzzer.results(), folder))
    # Numbers by which each kind of result is drawn once: images that are packed in four ways hold the same.
    packed = [path for path in results if path.name == "range.exr"]
    originals += [
        (f"result/{path.parent.name}/{path.name}/{int(path in packed[1:])}", path) for path in results
    ]
    originals += [(f"scene {path.parent.name}", path) for path in sound_scenes(folder)]
    for name, original in originals:
        found = fuzzer.open(worker, name, original)
        fuzzer.counts[f"originals: {found['outcome']}"] += 1
        if found["outcome"] != "result":
            fuzzer.findings[name] = name
            print(f"{name}: {found['what']}", flush=True)


def run(fuzzer: Fuzzer, addresses: list[str], workers: int) -> None:
    """Open mutants in several processes at once."""
    left = iter(addresses)
    taking = threading.Lock()

    def work() -> None:
        worker = Worker()
        while True:
            with taking:
                address = next(left, None)
            if address is None:
                break
            fuzzer.one(worker, address)
        worker.close()

    threads = [threading.Thread(target=work) for _ in range(workers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def main() -> int:
    """Run what the command line asks for; the exit status is 1 where something was found."""
    parser = argparse.ArgumentParser(description="Fuzz scenarios and saved tracking runs.")
    parser.add_argument("-n", type=int, default=0, help="mutants of shipped scenarios")
    parser.add_argument("--states", type=int, default=0, help="mutants of a saved tracking run")
    parser.add_argument(
        "--scenes", type=int, default=0, help="mutants of meshes and Mitsuba files, if there are any"
    )
    parser.add_argument("--results", type=int, default=0, help="mutants of results")
    parser.add_argument("--plans", type=int, default=0, help="mutants of shipped plans of campaigns")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first mutant")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument(
        "--every", type=int, default=1, help="simulate every so many mutants that are accepted"
    )
    parser.add_argument("--corpus", action="store_true", help="replay what was once found")
    parser.add_argument("--originals", action="store_true", help="open what the mutants are made from")
    parser.add_argument("--one", metavar="ADDRESS", help="one mutant again: SEED/NUMBER, state/SEED/NUMBER")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        fuzzer = Fuzzer(Path(folder), every=asked.every)
        if asked.one:
            return _again(fuzzer, asked.one)
        worker = Worker()
        if asked.corpus:
            replay(fuzzer, worker)
        if asked.originals:
            open_originals(fuzzer, worker)
        worker.close()
        scenes = asked.scenes if importlib.util.find_spec("mutate_scene") else 0
        numbers = {
            "": asked.n,
            "state/": asked.states,
            "mesh/": scenes,
            "xml/": scenes,
            "result/": asked.results,
            "plan/": asked.plans,
        }
        run(
            fuzzer,
            [
                f"{kind}{asked.seed}/{asked.first + i}"
                for kind, count in numbers.items()
                for i in range(count)
            ],
            asked.workers,
        )
        for kind, count in sorted(fuzzer.counts.items()):
            print(f"{kind:24} {count:7}")
        print(f"{'different findings':24} {len(fuzzer.findings):7}")
        return 1 if fuzzer.findings else 0


def _again(fuzzer: Fuzzer, address: str) -> int:
    """Print a mutant and what becomes of it."""
    mutant, worker = fuzzer.mutant(address), Worker()
    if isinstance(mutant, Mutant):
        print(mutant.text[:LARGEST].decode("utf-8", "backslashreplace"))
        print(f"# {mutant.seed_file}: {', '.join(mutant.edits)}", *mutant.overrides, sep="\n# --set ")
    found = fuzzer.open(worker, address, mutant)
    print(found["outcome"], found["what"], found.get("trace", ""), sep="\n")
    worker.close()
    return 1 if found["outcome"] == "finding" else 0


if __name__ == "__main__":
    sys.exit(main())
