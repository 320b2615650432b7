"""What an equation, table or figure of the paper is to the program that makes it again."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TypeVar

import numpy as np

from scanner_sim.errors import InputError
from scanner_sim.render.device import DeviceChoice

T = TypeVar("T")


class Verdict(StrEnum):
    """How what was found stands to what was expected."""

    AGREES = "agrees"
    DIFFERS = "differs"
    UNPRINTED = "not printed"
    """The paper has no number here; what was found agrees with the closed form."""


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
    """What came of an item: its comparisons, and what draws its picture to a path."""

    rows: tuple[Row, ...]
    draw: Callable[[Path], None]


@dataclass(frozen=True)
class Item:
    """An equation, table or figure of the paper.

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
    """

    key: str
    title: str
    says: str
    how: str
    differences: str
    make: Callable[[Task], Outcome]
    aliases: tuple[str, ...] = ()
    also: str = ""

    @property
    def command(self) -> str:
        """The command that makes it again."""
        return f"scanner-sim reproduce --only {self.key}"


def judged(what: str, paper: str, expected: str, found: str, holds: bool | np.bool_) -> Row:
    """Return a row whose verdict follows from whether the claim holds; ``paper`` may be empty."""
    verdict = (Verdict.AGREES if paper else Verdict.UNPRINTED) if holds else Verdict.DIFFERS
    return Row(what, paper, expected, found, verdict)


def within(found: float, expected: float, share: float) -> bool:
    """Return whether a number lies within a share of what is expected of it."""
    return math.isclose(found, expected, rel_tol=share)
