"""How a command ends: one message and an exit status, never a traceback for what a user can mend."""

from __future__ import annotations

import contextlib
import errno
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import NoReturn

import typer

from scanner_sim.errors import ScannerSimError, ScenarioError

DEBUG = "SCANNER_SIM_DEBUG"
"""Environment variable that shows the traceback of an unexpected error."""

INTERRUPTED = 130
TERMINATED = 143


@contextlib.contextmanager
def reported() -> Iterator[None]:
    """Turn exceptions into a message on the standard error stream and an exit status."""
    before = signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
        sys.stdout.flush()
    except (typer.Exit, SystemExit):
        raise
    except ScannerSimError as error:
        _end(error.exit_status, error.message, error.remedy)
    except KeyboardInterrupt:
        _end(
            INTERRUPTED, "interrupted; nothing was written.", "The same command starts again.", word="stopped"
        )
    except BrokenPipeError:
        # The reader of our output has gone, as `| head` does: there is nothing left to say.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit(0) from None
    except MemoryError:
        _end(1, "the memory is exhausted.", "Reduce scan.rows or scan.columns.")
    except OSError as error:
        if os.environ.get(DEBUG):
            raise
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        about = f"{error.filename}: " if error.filename else ""
        _end(1, f"{about}{error.strerror or error}.", "Make room on the disk." if full else "")
    except Exception as error:
        if os.environ.get(DEBUG):
            raise
        _end(
            1,
            f"unexpected {type(error).__name__}: {error}",
            f"This is a fault of the program. Set {DEBUG}=1 to see where it happened, and report it.",
        )
    finally:
        signal.signal(signal.SIGTERM, before)


@contextlib.contextmanager
def scenario_of(config: Path) -> Iterator[None]:
    """Name the file of the scenario in faults that are found later, when the files of its scene are opened."""
    try:
        yield
    except ScenarioError as error:
        raise ScenarioError(error.faults, source=str(config)) from None


def warn(sentence: str) -> None:
    """Print a warning on the standard error stream."""
    typer.echo(f"{_coloured('warning:', typer.colors.YELLOW)} {sentence}", err=True)


def _end(status: int, message: str, remedy: str = "", word: str = "error") -> NoReturn:
    typer.echo(f"{_coloured(f'{word}:', typer.colors.RED)} {message}", err=True)
    if remedy:
        typer.echo(remedy, err=True)
    raise typer.Exit(status) from None


def _coloured(word: str, colour: str) -> str:
    return typer.style(word, fg=colour, bold=True) if sys.stderr.isatty() else word


def _terminate(number: int, frame: FrameType | None) -> NoReturn:  # noqa: ARG001 (the signal's signature)
    # An exception, so that half-written files are cleaned away.
    raise SystemExit(TERMINATED)
