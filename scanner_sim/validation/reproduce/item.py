"""What an equation, table or figure of the paper, or a published fact, is to the program that makes it again."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TypeVar

import numpy as np

from scanner_sim.foundation.errors import InputError
from scanner_sim.render.libraries import DeviceChoice

T = TypeVar("T")

_REACH = 3.0
"""Standard errors that are granted to each side of what is printed."""


class Verdict(StrEnum):
    """How what was found stands to what was expected."""

    AGREES = "agrees"
    DIFFERS = "differs"
    ALIKE = "alike in kind"
    """The paper has words or a picture here; what was found is of that kind, by a bound of our own."""
    CHOSEN = "by construction"
    """What was found follows from numbers that were chosen from the paper: no agreement."""
    UNPRINTED = "not printed"
    """The paper has no number here; what was found agrees with the closed form."""
    NOT_JUDGED = "not judged"
    """What is published is of something that the simulator does not have, or the sample is too small to tell."""
    NO_INSTRUMENT = "no such instrument"
    """The instrument that it is published of is not among the shipped ones."""


@dataclass(frozen=True)
class Row:
    """One comparison.

    Attributes
    ----------
    what
        The quantity.
    paper
        What the paper says of it; empty where it says nothing.
    expected
        By the equation as it is meant, or a closed form; empty where there is none.
    found
        In simulated data.
    verdict
        Of the last against the paper, or where it says nothing, against the closed form.
    """

    what: str
    paper: str
    expected: str
    found: str
    verdict: Verdict


@dataclass(frozen=True)
class Task:
    """How an item is to be made.

    Attributes
    ----------
    quick
        Fewer and smaller, for a first look.
    device
        Where to compute.
    repository
        Folder that holds ``configs`` and ``scenes``.
    seed
        Seed of the random numbers.
    """

    quick: bool
    device: DeviceChoice
    repository: Path
    seed: int = 2000

    def choose(self, whole: T, quick: T) -> T:
        """Return the first for a whole run and the second for a quick one."""
        return quick if self.quick else whole

    def config(self, name: str) -> Path:
        """Return the file of a shipped scenario.

        Raises
        ------
        InputError
            If the repository is not there.
        """
        path = self.repository / "configs" / f"{name}.yaml"
        if not path.is_file():
            raise InputError(
                f"{path} is not there, and this item is made from it.",
                remedy="Run scanner-sim reproduce in the folder of the repository.",
            )
        return path


@dataclass(frozen=True)
class Outcome:
    """What came of an item: its comparisons, and what draws its picture to a path, if it has one."""

    rows: tuple[Row, ...]
    draw: Callable[[Path], None] | None = None


@dataclass(frozen=True)
class Item:
    """An equation, table or figure of the paper, or a published fact.

    Attributes
    ----------
    key
        By which it is asked for, as ``fig12``.
    title
        Its name and subject.
    says
        What the paper says.
    how
        From which simulated data it is made.
    differences
        Where both differ and why; what cannot be compared.
    make
        The work.
    aliases
        Other keys by which it may be asked for.
    also
        Other commands that give the same; empty if there is none.
    options
        With which the verb makes the page that it stands on.
    inputs
        What its result depends on beside the programs' versions, by name: where one has changed it is made again.
    copied
        Whether its result is that of another page: it is always made again.
    """

    key: str
    title: str
    says: str
    how: str
    differences: str
    make: Callable[[Task], Outcome]
    aliases: tuple[str, ...] = ()
    also: str = ""
    options: str = ""
    inputs: Mapping[str, str] = field(default_factory=dict)
    copied: bool = False

    @property
    def command(self) -> str:
        """The command that makes it again."""
        return f"scanner-sim reproduce {self.options}--only {self.key}"


def row_of_claim(what: str, paper: str, expected: str, found: str, holds: bool | np.bool_) -> Row:
    """Return a row whose verdict follows from whether the claim holds; ``paper`` may be empty.

    A claim about a number bounds it from both sides, unless the paper itself prints a bound: better than printed is no
    agreement.
    """
    verdict = (Verdict.AGREES if paper else Verdict.UNPRINTED) if holds else Verdict.DIFFERS
    return Row(what, paper, expected, found, verdict)


def alike(what: str, paper: str, expected: str, found: str, holds: bool | np.bool_) -> Row:
    """Return a row for words of the paper, which bound no number."""
    return Row(what, paper, expected, found, Verdict.ALIKE if holds else Verdict.DIFFERS)


def chosen(what: str, paper: str, expected: str, found: str, holds: bool | np.bool_) -> Row:
    """Return a row for what was chosen from the paper and hence cannot bear it out; it differs if it does not hold."""
    return Row(what, paper, expected, found, Verdict.CHOSEN if holds else Verdict.DIFFERS)


def against_print(
    what: str,
    paper: str,
    printed: tuple[float, float],
    found: float,
    error: float,
    unit: str,
    expected: str = "",
) -> Row:
    """Return a row for a printed size of an error: found within the print, or by which factor smaller or larger.

    Parameters
    ----------
    what, paper, expected
        As for :class:`Row`.
    printed
        Ends of what the digits of the paper leave open.
    found, error
        What was found, and its standard error; three of them are allowed beyond each end.
    unit
        Of these numbers, in words.
    """
    low, high = printed
    text = f"{found:.2g} {unit}"
    if found < low - _REACH * error:
        text += f", {low / found:.2g} times less"
    elif found > high + _REACH * error:
        text += f", {found / high:.2g} times more"
    return row_of_claim(what, paper, expected, text, low - _REACH * error <= found <= high + _REACH * error)


def within(found: float, expected: float, share: float) -> bool:
    """Return whether a number lies within a share of what is expected of it."""
    return math.isclose(found, expected, rel_tol=share)
