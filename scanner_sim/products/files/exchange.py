"""Files that come together or not at all, whenever the process dies; and nobody else's files are touched.

An exchange takes place in a folder, under a name. What it leaves on the disk before its end is hidden there:

==================  ============================================================================================
``.NAME.lock``      held through the operating system, which frees it when the process is dead
``.NAME.partial``   new files that are being written; of a dead process: deleted at the next start
``.NAME.complete``  the same folder when all of it is on the disk, with a list of the files that it replaces
``.NAME.early``     files that are made before the others, by :func:`early_files`; of a dead process: as the second
==================  ============================================================================================

The rename from the second to the third is the one step by which the new files count. Then the old files go, first the
one that marks a result, and the new ones come, that one last: nothing ever shows some of each, or passes for a result
before it is one. If the process dies in between, the next one that holds the lock goes on.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from filelock import FileLock, Timeout

from scanner_sim.foundation.errors import InputError, RunError
from scanner_sim.foundation.named_files import read_ordinary

Writers = Mapping[str, Callable[[Path], None]]
"""For each file its name, and what writes it to a path."""

RESULT_NAME = "scanner-sim"
"""Name of the exchanges of whole results: one at a time in a folder, of whatever kind."""

PLAN = "plan.json"
"""The list of a finished exchange: names of new files in their order, and which old files it may delete."""

_LARGEST_PLAN = 1 << 20
"""Bytes of it."""

_NO_SPACE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_REFUSED = {errno.EACCES, errno.EPERM, errno.EROFS, errno.EEXIST, errno.ENOTDIR, errno.ELOOP}
"""What the system says of a place that is none for files, as against a disk that fails."""

_PATIENCE = 10.0
"""How long the writer of a single file waits for another one [s]."""


class BusyError(InputError):
    """Another process, which is alive, is writing there."""


@contextlib.contextmanager
def held(folder: Path, name: str = RESULT_NAME, *, wait: float = 0.0) -> Iterator[None]:
    """Let nobody else write under a name, and first end what a dead process began there.

    The folder is made where it is missing; what was made and has stayed empty is removed. May be nested.

    Raises
    ------
    BusyError
        If a living process writes there and has not ended after ``wait`` seconds.
    InputError
        If what a dead process began cannot be ended.
    """
    made: list[Path] = []
    try:
        _make_folders(folder, made)
        lock = FileLock(str(folder.resolve() / f".{name}.lock"), is_singleton=True)
        try:
            lock.acquire(timeout=wait)
        except Timeout:
            raise BusyError(
                f"another run is writing to {folder}.", remedy="Wait for its end, or choose another folder."
            ) from None
        try:
            if lock.lock_counter == 1:
                _settle(folder, name)
            yield
        finally:
            try:
                if lock.lock_counter == 1:
                    # While it is held: who has it open already sees that it has lost its name, and begins anew.
                    with contextlib.suppress(OSError):
                        os.unlink(lock.lock_file)
            finally:
                lock.release()
    finally:
        for parent in reversed(made):
            with contextlib.suppress(OSError):
                parent.rmdir()


def recover(folder: Path, name: str = RESULT_NAME) -> None:
    """End what a dead process began in a folder; nothing is written where there is none of it.

    Raises
    ------
    InputError
        If that is not possible.
    """
    if any(os.path.lexists(folder / f".{name}.{state}") for state in ("partial", "complete", "early")):
        with contextlib.suppress(BusyError), held(folder, name):
            pass


def exchange(
    folder: Path, writers: Writers, old: Sequence[str] = (), *, mark: str = "", name: str = RESULT_NAME
) -> None:
    """Write new files in the place of old ones, as the heading of this module says.

    Parameters
    ----------
    folder
        Where; :func:`held` holds it.
    writers
        The new files.
    old
        Names of files that are ours and go; those that are not there are left out.
    mark
        Name of the file by which a result is known.
    name
        Of the exchange.

    Raises
    ------
    OSError
        If the new files cannot be written: everything is as before.
    RunError
        If they are whole but cannot be put in their place.
    InputError
        If there is a file of the same name that is not among the old ones.
    """
    _clear(folder, name)
    partial, complete = folder / f".{name}.partial", folder / f".{name}.complete"
    plan = {
        "new": sorted(writers, key=lambda file: file == mark),
        "old": {
            file: _identity(folder / file)
            for file in sorted(old, key=lambda file: file != mark)
            if os.path.lexists(folder / file)
        },
    }
    try:
        # Not tempfile.mkdtemp: folder and files get the permissions that any new ones get.
        partial.mkdir()
        for file, write in writers.items():
            write(partial / file)
            _flush(partial / file)
        (partial / PLAN).write_text(json.dumps(plan), encoding="utf-8")
        _flush(partial / PLAN)
        _flush_folder(partial)
        partial.rename(complete)
        _place(folder, complete)
    except BaseException as error:
        if not complete.exists():
            _discard(partial)
            raise
        # The new files count already. An interrupt shall not leave them half-way; a disk that fails may.
        _place(folder, complete)
        if not isinstance(error, RunError):
            raise


@contextlib.contextmanager
def early_files(folder: Path, name: str = RESULT_NAME) -> Iterator[Path]:
    """Give a hidden folder for files that are made before an exchange, whose writers move them; :func:`held` holds it.

    It is on the disk of the folder, and what is left in it goes at the end, or at the next start.
    """
    early = folder / f".{name}.early"
    try:
        _discard(early)
        early.mkdir()
    except OSError as error:
        raise failure(folder, error) from None
    try:
        yield early
    finally:
        _discard(early)


def write_file(path: Path, write: Callable[[Path], None], *, overwrite: bool = False) -> Path:
    """Write a single file, whole or not at all; arguments and faults as :func:`write_files`."""
    return write_files(path.parent, {path.name: write}, overwrite=overwrite)[0]


def write_files(folder: Path, writers: Writers, *, overwrite: bool = False) -> tuple[Path, ...]:
    """Write files into a folder that is not ours, together or not at all; return their paths.

    Raises
    ------
    InputError
        If one is there already and ``overwrite`` is not set, or the folder cannot be written to.
    RunError
        If the disk fails.
    """
    first = next(iter(writers))
    try:
        with held(folder, first, wait=_PATIENCE):
            check_files([folder / name for name in writers], overwrite)
            exchange(folder, writers, tuple(writers), name=first)
    except OSError as error:
        raise (unwritable if error.errno in _REFUSED else failure)(folder, error) from None
    return tuple(folder / name for name in writers)


def check_files(paths: Iterable[Path], overwrite: bool) -> None:
    """Raise an InputError if a file is there already and may not be replaced, or a folder stands in its place."""
    for path in paths:
        refuse_folder(path)
        recover(path.parent, path.name)
        if os.path.lexists(path) and not overwrite:
            raise InputError(f"{path} exists already.", remedy="Name another file, or add --overwrite.")


def unwritable(folder: Path, error: OSError) -> InputError | RunError:
    """Return the fault of a folder that cannot be written to."""
    if error.errno in _NO_SPACE:
        return failure(folder, error)
    return InputError(
        f"{folder} cannot be written to: {error.strerror}.", remedy="Choose another folder with -o."
    )


def failure(folder: Path, error: OSError) -> RunError:
    """Return the fault of a disk that failed while new files were written."""
    if error.errno == errno.EFBIG:
        return RunError(
            f"{folder.absolute()} may not hold files that large; nothing was changed.",
            remedy="Raise the limit (ulimit -f), or choose another disk with -o.",
        )
    if error.errno in _NO_SPACE:
        return RunError(
            f"The disk that holds {folder.absolute()} is full; nothing was changed.",
            remedy="Make room, or choose another disk with -o.",
        )
    return RunError(f"{folder} could not be written: {error.strerror or error}; nothing was changed.")


def refuse_folder(path: Path) -> None:
    """Raise an InputError if a folder stands where a file shall be."""
    if path.is_dir():
        raise InputError(f"{path} is a folder.", remedy="Choose another folder with -o.")


def _settle(folder: Path, name: str) -> None:
    """End what a dead process began; the lock is held for the first time."""
    _discard(folder / f".{name}.early")
    _clear(folder, name)


def _clear(folder: Path, name: str) -> None:
    """Put finished files into their place, and discard unfinished ones."""
    _discard(folder / f".{name}.partial")
    complete = folder / f".{name}.complete"
    if os.path.lexists(complete):
        _place(folder, complete)


def _place(folder: Path, complete: Path) -> None:
    """Delete the old files and put the new ones in their place, from wherever that was left off.

    The list may come from anybody, in a folder that was sent: it can name files of this folder only, deletes only those
    that are the very same as when it was written, and overwrites nothing.
    """
    try:
        if complete.is_symlink() or not (complete / PLAN).is_file():
            _discard(complete)
            return
        new, old = _read_plan(complete / PLAN)
        for file, known in old.items():
            replaced = file in new and not os.path.lexists(complete / file)
            if not replaced and os.path.lexists(folder / file) and _identity(folder / file) == known:
                os.unlink(folder / file)
        for file in new:
            if not os.path.lexists(complete / file):
                continue
            if os.path.lexists(folder / file):
                raise InputError(
                    f"{folder / file} is in the way of a new file that waits in {complete}.",
                    remedy="Move it away, and start again.",
                )
            os.rename(complete / file, folder / file)
        _flush_folder(folder)
        _discard(complete)
    except OSError as error:
        raise RunError(
            f"the files of a run are whole in {complete}, but cannot be put in their place: "
            f"{error.strerror or error}.",
            remedy="The next start tries again.",
        ) from error


def _read_plan(path: Path) -> tuple[list[str], dict[str, list[int]]]:
    try:
        plan = json.loads(read_ordinary(path, _LARGEST_PLAN))
        new, old = list(plan["new"]), dict(plan["old"])
        if not all(isinstance(file, str) and Path(file).name == file for file in (*new, *old)):
            raise ValueError("it names other folders")
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
        raise InputError(
            f"{path} is damaged: {error}.", remedy=f"Look at the files in {path.parent}, and move them away."
        ) from None
    return new, old


def _identity(path: Path) -> list[int]:
    """Return what tells a file from a later one of the same name; not its number, which some network disks change."""
    found = path.lstat()
    return [found.st_size, found.st_mtime_ns]


def _discard(folder: Path) -> None:
    """Delete a hidden folder; of a link the link alone, and whatever else was put there, such as a pipe."""
    if folder.is_symlink() or not folder.is_dir():
        folder.unlink(missing_ok=True)
    else:
        shutil.rmtree(folder, ignore_errors=True)


def _make_folders(folder: Path, made: list[Path]) -> None:
    """Make ``folder`` and its missing parents; add those that were made to a list, outermost first."""
    if not folder.exists():
        _make_folders(folder.parent, made)
        folder.mkdir(exist_ok=True)
        made.append(folder)
        _flush_folder(folder.parent)


def _flush(path: Path) -> None:
    with open(path, "rb+") as stream:
        os.fsync(stream.fileno())


def _flush_folder(folder: Path) -> None:
    """See the names of ``folder`` onto the disk, where the system can do that."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
