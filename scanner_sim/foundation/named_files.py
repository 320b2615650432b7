"""Files that a scene names: ordinary ones only, of bounded size, and for an XML file only those beside it.

A scenario is the user's own and may name any file. A scene in XML is mostly somebody else's: what it names must lie in
its folder, so that opening it reads nothing of the user's. Messages never quote what is in a file.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
from collections.abc import Iterator, Mapping
from contextvars import ContextVar
from pathlib import Path
from typing import BinaryIO

from scanner_sim.foundation.errors import InputError

LARGEST_MESH = 1 << 30
"""Bytes of a mesh file: some thirty million triangles."""
LARGEST_XML = 1 << 26
"""Bytes of an XML scene."""
LARGEST_TEXT = 1 << 26
"""Bytes of a table or a result as text."""


@contextlib.contextmanager
def open_ordinary(path: Path, most: int) -> Iterator[tuple[BinaryIO, int]]:
    """Open an ordinary file for reading, and tell its size [B].

    Parameters
    ----------
    path
        The file; symbolic links are followed.
    most
        Largest size [B].

    Raises
    ------
    InputError
        If it does not exist, may not be read, is too large, or is no ordinary file: a device never ends, and a pipe
        waits for its writer.
    """
    shown = repr(str(path))
    try:
        # A pipe without a writer would block already when it is opened.
        number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"the file {shown} cannot be opened: {reason}.", remedy="Check its name and permissions."
        ) from None
    try:
        status = os.fstat(number)
        if not stat.S_ISREG(status.st_mode):
            raise InputError(
                f"{shown} is not an ordinary file but a folder, a device or a pipe.", remedy="Name a file."
            )
        if status.st_size > most:
            raise InputError(
                f"the file {shown} has {status.st_size / 1e6:.0f} MB; at most {most / 1e6:.0f} MB are read.",
                remedy="Simplify it, or split it into several.",
            )
        with os.fdopen(number, "rb", closefd=False) as stream:
            yield stream, status.st_size
    except OSError as error:
        raise InputError(f"the file {shown} cannot be read: {error.strerror}.") from None
    finally:
        os.close(number)


def read_ordinary(path: Path, most: int) -> bytes:
    """Return the bytes of an ordinary file of at most so many; faults as :func:`open_ordinary`."""
    with open_ordinary(path, most) as (stream, size):
        # No more than its size: a file of the kernel calls itself empty and may never end.
        content = stream.read(size)
    if (noted := _noted.get()) is not None:
        noted[path] = digest_of(content)
    return content


def digest_of(content: bytes) -> bytes:
    """Return what tells the content of a file from any other."""
    return hashlib.sha256(content).digest()


_noted: ContextVar[dict[Path, bytes] | None] = ContextVar("noted", default=None)


@contextlib.contextmanager
def noted_files() -> Iterator[Mapping[Path, bytes]]:
    """Note every file that :func:`read_ordinary` reads within, with the digest of what was read."""
    noted: dict[Path, bytes] = {}
    token = _noted.set(noted)
    try:
        yield noted
    finally:
        _noted.reset(token)


def are_as_noted(noted: Mapping[Path, bytes], most: int) -> bool:
    """Return whether files, of at most so many bytes, hold what they held when they were noted."""
    try:
        return all(digest_of(read_ordinary(path, most)) == digest for path, digest in noted.items())
    except InputError:
        return False


def read_text_file(path: Path, most: int = LARGEST_TEXT) -> str:
    """Return an ordinary file as text, ends of lines as they are; faults as :func:`open_ordinary`.

    Raises
    ------
    InputError
        If it is not UTF-8; a byte order mark is left out.
    """
    try:
        return read_ordinary(path, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"the file {str(path)!r} is no text in UTF-8: byte {error.start} begins no character.",
            remedy="Save it as UTF-8 text.",
        ) from None


def file_beside(name: str, folder: Path) -> Path:
    """Return the path of a file that an XML scene names, relative to the scene's folder, which is resolved itself.

    Raises
    ------
    InputError
        If it lies outside of the folder: by an absolute path, by ``..`` or through a symbolic link.
    """
    remedy = "Put the file beside the scene, or name the mesh in the scenario, which may lie anywhere."
    if not name or not name.isprintable():
        raise InputError(f"{name!r} is no name of a file.", remedy="Give its path from the scene's folder.")
    if os.path.isabs(name):
        raise InputError(f"the scene names {name!r} by an absolute path.", remedy=remedy)
    try:
        path = Path(os.path.realpath(folder / name))
    except (OSError, ValueError):
        raise InputError(f"{name!r} is no name of a file.", remedy=remedy) from None
    if not path.is_relative_to(folder):
        raise InputError(f"the scene names {name!r}, which leads out of its folder.", remedy=remedy)
    return path
