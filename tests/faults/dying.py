"""A process that is killed at each of its touches of the disk in turn; run by ``test_kill.py``.

``python dying.py FOLDER`` exits with 0 where after every death, and after deaths while it was being mended, nothing is
lost and nothing is mixed. It forks, so it has no threads and loads no renderer.
"""

from __future__ import annotations

import itertools
import os
import resource
import shutil
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from scanner_sim.products.files.contents import RUN
from scanner_sim.products.files.exchange import check_files, write_files
from scanner_sim.products.files.folder import check_target
from scanner_sim.products.files.run_folder import write_run
from scanner_sim.products.image import RangeImage
from scanner_sim.products.settings import Output

TOUCHES = {"open", "os.rename", "os.remove", "os.mkdir", "os.rmdir"}
Content = dict[str, bytes]


def dying_at(step: int, work: Callable[[], object], *, at_byte: int | None = None) -> bool:
    """Do some work in a child that dies just before one touch of the disk; return whether it died."""
    child = os.fork()
    if child == 0:
        if at_byte is None:
            count, fsync = itertools.count(), os.fsync

            def touch() -> None:
                if next(count) == step:
                    os.kill(os.getpid(), signal.SIGKILL)

            def touched(event: str, _: object) -> None:
                if event in TOUCHES:
                    touch()

            def flushed(handle: int) -> None:
                touch()
                fsync(handle)
                touch()

            os.fsync = flushed
            sys.addaudithook(touched)
        else:
            # Dies in the middle of the write that crosses this byte of any file.
            signal.signal(signal.SIGXFSZ, signal.SIG_DFL)
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            sys.dont_write_bytecode = True  # else Python cuts off the bytecode that it keeps
            resource.setrlimit(resource.RLIMIT_FSIZE, (at_byte, at_byte))
        work()
        os._exit(0)
    status = os.waitpid(child, 0)[1]
    assert os.WIFSIGNALED(status) or os.waitstatus_to_exitcode(status) == 0, status
    return os.WIFSIGNALED(status)


def seen(folder: Path) -> Content:
    """Return what a user sees in a folder."""
    shown = [path for path in folder.glob("*") if not path.name.startswith(".")]
    return {path.name: path.read_bytes() for path in shown}


def everything(folder: Path) -> frozenset[tuple[str, bytes]]:
    """Return all that lies in a folder, hidden files too: what comes of it depends on nothing else."""
    paths = ((path, str(path.relative_to(folder))) for path in folder.rglob("*"))
    return frozenset((name, path.read_bytes() if path.is_file() else b"folder") for path, name in paths)


def image(seed: int) -> RangeImage:
    ranges = np.full((3, 4), 9.0 + seed, np.float32)
    layers = dict.fromkeys(("range_m", "P.X", "P.Y", "P.Z", "Y", "truth.range_m"), ranges)
    return RangeImage(
        channels={**layers, "status": np.zeros((3, 4), np.float32)},
        theta=np.linspace(-0.1, 0.1, 4),
        phi=np.linspace(-0.1, 0.1, 3),
        seed=seed,
        scenario_yaml=f"schema: 1\nseed: {seed}\n",
    )


def write_result(folder: Path, seed: int) -> None:
    write_run(image(seed), folder, Output(pictures=False), overwrite=True)


def write_pair(folder: Path, seed: int) -> None:
    writers = {
        name: lambda path, name=name: path.write_text(f"{name} {seed}" * 99) for name in ("a.csv", "a.png")
    }
    write_files(folder, writers, overwrite=True)


def mend_result(folder: Path) -> None:
    check_target(folder, True, RUN)


def mend_pair(folder: Path) -> None:
    check_files([folder / "a.csv"], True)


def judge(found: Content, old: Content, new: Content, mark: str, mine: Content) -> None:
    """Nothing of the user's is missing, nothing is mixed, and nothing passes for a result that is not one."""
    assert mine.items() <= found.items(), "a file of the user is gone"
    ours = {name: data for name, data in found.items() if name not in mine}
    assert ours.items() <= old.items() or ours.items() <= new.items(), "a mixture"
    if mark in ours:
        assert ours in (old, new), "it passes for a result and is none"


def main(ground: Path) -> None:
    mine = {"notes.txt": b"mine"}
    deaths = 0
    for write, mend, mark, extra, starts in (
        (
            write_result,
            mend_result,
            RUN.result,
            {"range.png": b"of the old one"},
            ("missing", "empty", "old"),
        ),
        (write_pair, mend_pair, "", {}, ("missing", "old")),
    ):
        reference = ground / write.__name__
        write(reference, 2)
        new = seen(reference)
        for start in starts:
            outcomes, known = [], dict[frozenset[tuple[str, bytes]], bool]()
            bytes_of_new = max(map(len, new.values()))
            steps = [(step, None) for step in range(400)]
            writes = [(0, byte) for byte in range(0, bytes_of_new, max(bytes_of_new // 4, 1))]
            for step, at_byte in (*writes, *steps):
                shutil.rmtree(ground / "deep", ignore_errors=True)
                folder = ground / "deep" / "out"
                if start != "missing":
                    folder.mkdir(parents=True)
                if start == "old":
                    write(folder, 1)
                old = seen(folder)
                if start == "old":
                    old |= extra
                    for name, data in extra.items():
                        (folder / name).write_bytes(data)
                users = mine if start == "old" else {}
                for name, data in users.items():
                    (folder / name).write_bytes(data)
                died = dying_at(step, lambda: write(folder, 2), at_byte=at_byte)  # noqa: B023
                if not died:
                    assert seen(folder) == {**new, **users}, (start, step, at_byte, list(seen(folder)))
                    if at_byte is None:
                        break
                    continue
                deaths += 1
                judge(seen(folder), old, new, mark, users)
                left = everything(folder.parent)
                if left in known:
                    outcomes.append(known[left])
                    continue
                for again in itertools.count():
                    if not dying_at(again, lambda: mend(folder)):  # noqa: B023
                        break
                    deaths += 1
                    judge(seen(folder), old, new, mark, users)
                after = seen(folder)
                assert after in ({**old, **users}, {**new, **users}), "neither the old result nor the new one"
                known[left] = after != {**old, **users}
                outcomes.append(known[left])
                write(folder, 3)  # and the next run is not refused
                assert not list(folder.glob(".*")), "leftovers"
                assert sorted(path.name for path in folder.parent.iterdir()) == ["out"], "leftovers"
            else:
                raise AssertionError("it never came to its end")
            steps_of_it = outcomes[-(step):]
            assert steps_of_it == sorted(steps_of_it), "what counts once, counts for good"
            assert set(steps_of_it) == {False, True}, "both must occur"
    sys.stdout.write(f"{deaths} deaths\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
