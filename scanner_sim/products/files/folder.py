"""Output folders: written whole or not at all, and never over something that is not ours."""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from scanner_sim.foundation.errors import InputError
from scanner_sim.products.files.exchange import (
    Writers,
    exchange,
    failure,
    held,
    recover,
    refuse_folder,
    unwritable,
)


@dataclass(frozen=True)
class ResultFolder:
    """A kind of output folder: the file that marks it, and the names of all files that may be ours.

    Attributes
    ----------
    result
        The file that marks it.
    files
        All that may be ours.
    drawn
        Pattern of the names of pictures that may have been drawn of a result since: they go with it.
    """

    result: str
    files: tuple[str, ...]
    drawn: str = ""

    def ours(self, folder: Path) -> list[str]:
        """Return the names of what goes with a result in a folder."""
        since = [path.name for path in folder.iterdir() if re.fullmatch(self.drawn, path.name)]
        return [*self.files, *sorted(since)]


def check_target(folder: str | Path, overwrite: bool, kind: ResultFolder) -> None:
    """Check before the work that its result can be written.

    Nothing is created; what a dead process began there is brought to its end.

    Raises
    ------
    InputError
        If ``folder`` holds a result and ``overwrite`` is not set, if it holds files of the user with the
        names of ours, if it is no folder, or if it cannot be written to.
    """
    folder = Path(folder)
    try:
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            os.lstat(folder)  # finds names that no system takes
        recover(folder)
        _check_content(folder, overwrite, kind)
        ground = folder
        while not ground.exists():
            ground = ground.parent
        if not ground.is_dir():
            raise InputError(f"{ground} is a file, not a folder.", remedy="Choose another folder with -o.")
        # Asking for permissions is not enough: a file system may be read-only, and root may do everything.
        with tempfile.TemporaryFile(dir=ground):
            pass
    except OSError as error:
        raise unwritable(folder, error) from None
    except ValueError as error:
        raise InputError(
            f"{folder} is no name of a folder: {error}.", remedy="Choose another with -o."
        ) from None


@contextlib.contextmanager
def claim_folder(folder: str | Path, overwrite: bool, kind: ResultFolder) -> Iterator[None]:
    """Check as :func:`check_target`, and keep other runs out of the folder while the work goes on.

    Raises
    ------
    InputError
        As there, or if another run has claimed it.
    """
    folder = Path(folder)
    check_target(folder, overwrite, kind)
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(held(folder))
        except OSError as error:
            raise unwritable(folder, error) from None
        yield


def write_folder(
    folder: str | Path, kind: ResultFolder, writers: Writers, *, overwrite: bool = False
) -> tuple[Path, ...]:
    """Write the files of an output folder.

    Whatever happens, the death of the process included, the folder holds the earlier result or the new one, as
    :mod:`scanner_sim.products.files.exchange` says. Files that are not ours are never touched; those of an earlier
    result are all replaced or removed.

    Parameters
    ----------
    folder
        Where to write; made where it is missing, with its parents.
    kind
        What kind of folder it is.
    writers
        The files, in the order of presentation.
    overwrite
        Replace an existing result.

    Returns
    -------
    tuple of Path
        The files written.

    Raises
    ------
    InputError
        As :func:`check_target`, or if another run is writing there.
    RunError
        If the disk is full or fails.
    """
    folder = Path(folder)
    check_target(folder, overwrite, kind)
    try:
        with held(folder):
            # Again: another run may have been here since.
            _check_content(folder, overwrite, kind)
            exchange(folder, writers, kind.ours(folder), mark=kind.result)
    except OSError as error:
        raise failure(folder, error) from None
    return tuple(folder / name for name in writers)


def write_text(path: Path, text: str) -> None:
    """Write a text as UTF-8, with the ends of its lines as they are."""
    path.write_bytes(text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write what is a file already, as a picture that a page holds too."""
    path.write_bytes(content)


def _check_content(folder: Path, overwrite: bool, kind: ResultFolder) -> None:
    if os.path.lexists(folder) and not folder.is_dir():
        raise InputError(f"{folder} is not a folder.", remedy="Choose another folder with -o.")
    there = folder.is_dir()
    present = [name for name in kind.ours(folder) if os.path.lexists(folder / name)] if there else []
    if kind.result in present and not overwrite:
        raise InputError(
            f"{folder} already holds a result.", remedy="Choose another folder with -o, or add --overwrite."
        )
    if present and kind.result not in present:
        raise InputError(
            f"{folder} holds {', '.join(present)} but no {kind.result}: these are not ours to replace.",
            remedy="Choose another folder with -o.",
        )
    for name in present:
        refuse_folder(folder / name)
