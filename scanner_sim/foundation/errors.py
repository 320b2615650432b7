"""The exceptions of the program, and which one is raised when.

========================  =======================================  ===========
exception                 raised when                              exit status
========================  =======================================  ===========
:class:`InputError`       what the user gave cannot be used        2
:class:`ScenarioError`    a scenario has faults: all of them       2
:class:`RunError`         the work itself failed (disk, device)    1
========================  =======================================  ===========

Single shots never raise: they carry a :class:`scanner_sim.foundation.status.Status`.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from functools import partial
from typing import Any

MOST_FAULTS = 50
"""Faults that a message lists; the error holds them all."""
LONGEST_LINE = 1000
"""Characters of a line of a message: what the user wrote may be a book."""
LONGEST_MESSAGE = 12_000
"""Characters of a message."""

_STEERING = {"Cc", "Cf", "Cs", "Zl", "Zp"}
"""Categories of Unicode: controls, formats, surrogates, separators of lines and paragraphs."""
_ROUNDED = 1e-12
"""Share of a limit that is rounding: 20.000000000000004 is 20."""


def at_most(limit: float, digits: int = 3) -> str:
    """Return a positive number in so many digits that is no larger, but for rounding: what a remedy says is taken."""
    return _digits(limit * (1.0 + _ROUNDED), Context(digits, ROUND_FLOOR))


def at_least(limit: float, digits: int = 3) -> str:
    """Return a positive number in so many digits that is no smaller, but for rounding."""
    return _digits(limit * (1.0 - _ROUNDED), Context(digits, ROUND_CEILING))


def _digits(limit: float, how: Context) -> str:
    return f"{float(how.create_decimal_from_float(limit)):.{how.prec}g}"


def printable(text: str, *, lines: bool = False) -> str:
    r"""Return a text as a terminal, a picture or a line of a file may show it: nothing in it steers the reader.

    Control characters, escape sequences, marks that turn the direction of writing and bytes that are no text become
    their escapes, as ``\x1b``; with ``lines`` ends of lines stay.
    """
    return "".join(
        letter
        if (lines and letter == "\n") or unicodedata.category(letter) not in _STEERING
        else letter.encode("unicode_escape").decode("ascii")
        for letter in text
    )


def _shorten(text: str) -> str:
    """Return a text of bounded length, long lines cut in their middle."""
    lines = [line if len(line) <= LONGEST_LINE else _cut(line) for line in text.split("\n")]
    whole = "\n".join(lines)
    return whole if len(whole) <= LONGEST_MESSAGE else whole[: LONGEST_MESSAGE - 1] + "…"


def _to_printable(text: str) -> str:
    # Cut before it is looked at letter by letter, and again: an escape is longer than what it stands for.
    return _shorten(printable(_shorten(text), lines=True))


def _cut(line: str) -> str:
    half = LONGEST_LINE // 2
    return f"{line[:half]} … {line[-half:]}"


class ScannerSimError(Exception):
    """Any error that is reported to the user in one message, without a traceback.

    Parameters
    ----------
    message
        What is wrong, in one sentence; it may quote anything (see :func:`printable`).
    remedy
        What the user can do about it; empty where nothing sensible can be said.
    """

    exit_status = 1

    def __init__(self, message: str, *, remedy: str = "") -> None:
        self.message, self.remedy = _to_printable(message), _to_printable(remedy)
        super().__init__(self.message)

    def __reduce__(self) -> tuple[Any, ...]:
        """Say how to make the error again in another process."""
        return partial(type(self), remedy=self.remedy), (self.message,)

    def __str__(self) -> str:
        return f"{self.message} {self.remedy}".strip()


class InputError(ScannerSimError):
    """What the user gave (a file, an option, a device) cannot be used."""

    exit_status = 2


class RunError(ScannerSimError):
    """The work itself failed although its input was good: a full disk, a lost device."""

    exit_status = 1


@dataclass(frozen=True)
class Fault:
    """One fault of a scenario.

    Attributes
    ----------
    location
        Path in the file, ``scanner.laser.power``; empty for the file as a whole.
    problem
        What came and what was wanted.
    remedy
        What to write instead; may be empty.
    line
        Line in the file, counted from 1; None where the scenario did not come from a file.
    """

    location: str
    problem: str
    remedy: str = ""
    line: int | None = None

    def __str__(self) -> str:
        where = self.location or "scenario"
        if self.line is not None:
            where = f"line {self.line}, {where}"
        return f"{where}: {self.problem}" + (f" {self.remedy}" if self.remedy else "")


class ScenarioError(InputError):
    """A scenario has faults; all that could be found are reported together.

    Parameters
    ----------
    faults
        The faults, in the order of the file.
    source
        Name of the file, or a word for where the scenario came from.
    """

    def __init__(self, faults: Sequence[Fault], *, source: str = "scenario") -> None:
        count = "1 fault" if len(faults) == 1 else f"{len(faults)} faults"
        # A fault is one line, whatever it quotes.
        lines = [f"  {printable(_shorten(str(fault)))}" for fault in faults[:MOST_FAULTS]]
        if len(faults) > MOST_FAULTS:
            lines.append(f"  … and {len(faults) - MOST_FAULTS} more")
        super().__init__("\n".join([f"{printable(source)}: {count}", *lines]))
        self.faults = tuple(faults)
        self.source = source

    def __reduce__(self) -> tuple[Any, ...]:
        """Say how to make the error again in another process."""
        return partial(type(self), source=self.source), (self.faults,)
