"""How a command ends: one message and an exit status, never a traceback for what a user can mend."""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import NoReturn, TextIO

import typer

from scanner_sim.foundation.errors import InputError, ScannerSimError, ScenarioError, printable

DEBUG = "SCANNER_SIM_DEBUG"
"""Environment variable that shows the traceback of an unexpected error."""

_WORDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
"""The signals that end a command, and what is said of it; its status is 128 and the signal's number."""


@contextlib.contextmanager
def reported() -> Iterator[None]:
    """Turn exceptions and signals into a message on the standard error stream and an exit status."""
    with _signals() as came:
        try:
            yield
            sys.stdout.flush()
            if came:  # and what it raised was lost, in a destructor for instance
                raise KeyboardInterrupt
        except BaseException as error:
            # What a signal raises inside a kernel's loop or a plugin comes out as an error of the renderer.
            number = came[0] if came else signal.SIGINT
            if came or isinstance(error, KeyboardInterrupt):
                remedy = "The same command starts again."
                _end(128 + number, f"{_WORDS[number]}; nothing is half-written.", remedy, word="stopped")
            _report(error)


def _missing_library() -> InputError | None:
    """Return the fault if a library of the system is missing: without it imports fail in ways of their own."""
    from scanner_sim.render.libraries import need_system_libraries

    try:
        need_system_libraries()
    except InputError as fault:
        return fault
    return None


def _report(error: BaseException) -> NoReturn:
    """End with the message and the status of an exception."""
    # The libraries that print help make an exit of a pipe that is closed.
    lost = error.__context__ if isinstance(error, SystemExit) else error
    if isinstance(lost, BrokenPipeError):
        # The reader of our output has gone, as `| head` does: there is nothing left to say. It may have read both.
        _silence(sys.stdout)
        _silence(sys.stderr)
        raise typer.Exit(_unsaid(lost, 0)) from None
    if isinstance(error, typer.Exit | SystemExit):
        raise error
    if isinstance(error, ImportError | NameError):
        error = _missing_library() or error
    if isinstance(error, ScannerSimError):
        several = isinstance(error, ScenarioError)
        _end(error.exit_status, error.message if several else printable(error.message), error.remedy)
    if isinstance(error, MemoryError):
        _end(1, "the memory is exhausted.", "Reduce scan.rows or scan.columns.")
    if os.environ.get(DEBUG):
        raise error
    if isinstance(error, OSError):
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        about = f"{error.filename}: " if error.filename else ""
        _end(
            # A name that no system takes is the user's; all else is the disk's.
            _unsaid(error, 2 if error.errno == errno.ENAMETOOLONG else 1),
            f"{about}{error.strerror or error}.",
            "Make room on the disk." if full else "",
        )
    _end(
        1,
        f"unexpected {type(error).__name__}: {error}",
        f"This is a fault of the program. Set {DEBUG}=1 to see where it happened, and report it.",
    )


def _unsaid(lost: BaseException, otherwise: int) -> int:
    """Return the status of the fault of a command line whose message was lost, or another where there was none."""
    status: int = getattr(lost.__context__, "exit_code", otherwise)
    return status


@contextlib.contextmanager
def _signals() -> Iterator[list[signal.Signals]]:
    """Let the signals that end a command raise KeyboardInterrupt; yields a list of those that came."""
    came: list[signal.Signals] = []

    def stop(number: int, frame: FrameType | None) -> NoReturn:  # noqa: ARG001 (the signal's signature)
        came.append(signal.Signals(number))
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield came
        return
    before = {number: signal.signal(number, stop) for number in _WORDS}
    try:
        yield came
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def open_streams() -> None:
    """See that the standard streams are there: the first file that is opened would take the place of a closed one."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            handle = os.open(os.devnull, os.O_RDWR)
            if handle != number:
                os.dup2(handle, number)
                os.close(handle)
            setattr(sys, name, open(number, "w" if number else "r", encoding="utf-8"))  # noqa: SIM115 (stays open)


def _silence(stream: TextIO) -> None:
    """Let nothing more reach a stream that cannot take it, the rest of its buffer at the program's end included."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


@contextlib.contextmanager
def scenario_of(config: Path) -> Iterator[None]:
    """Name the file of the scenario in faults that are found later, when the files of its scene are opened."""
    try:
        yield
    except ScenarioError as error:
        raise ScenarioError(error.faults, source=str(config)) from None


def warn(sentence: str) -> None:
    """Print a warning on the standard error stream."""
    typer.echo(f"{_coloured('warning:', typer.colors.YELLOW)} {printable(sentence)}", err=True)


def _end(status: int, message: str, remedy: str = "", word: str = "error") -> NoReturn:
    lines = [f"{_coloured(f'{word}:', typer.colors.RED)} {printable(message, lines=True)}"]
    lines += [printable(remedy, lines=True)] if remedy else []
    try:
        typer.echo("\n".join(lines), err=True)
    except OSError:
        _silence(sys.stderr)
    try:
        sys.stdout.flush()
    except OSError:
        _silence(sys.stdout)
    raise typer.Exit(status) from None


def _coloured(word: str, colour: str) -> str:
    return typer.style(word, fg=colour, bold=True) if sys.stderr.isatty() else word
