"""What made a result: the versions of the programs, and nothing about host, user, paths or time.

The same scenario and seed give the same bytes on another machine with the same versions, so nothing that
changes from one machine or one hour to the next may enter a file.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version

PROGRAMS = ("scanner-sim", "mitsuba", "drjit", "numpy", "OpenEXR")
"""Distributions whose version can change the numbers or the bytes of a result."""


@cache
def _version(program: str) -> str:
    try:
        return version(program)
    except PackageNotFoundError:
        return "unknown"


def versions() -> dict[str, str]:
    """Return the version of each program; ``unknown`` where one was not installed as a package."""
    return {program: _version(program) for program in PROGRAMS}


def in_order(made_by: Mapping[str, str]) -> dict[str, str]:
    """Return the versions in one order, whatever order a file kept them in."""
    later = sorted(program for program in made_by if program not in PROGRAMS)
    return {program: made_by[program] for program in (*PROGRAMS, *later) if program in made_by}


def software(made_by: Mapping[str, str]) -> str:
    """Return one line that names the programs, for the ``software`` entry of a file's header."""
    return ", ".join(f"{program} {number}" for program, number in made_by.items())
