"""Reading YAML files by the rules of scenarios: the text, the part that it holds, and every fault at its line."""

from __future__ import annotations

import difflib
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from scanner_sim.config.document import Document, Location, read_document, spell
from scanner_sim.config.faults import faults_found
from scanner_sim.config.scenario import Scenario
from scanner_sim.config.wording import shown
from scanner_sim.foundation.errors import Fault, InputError, ScenarioError
from scanner_sim.foundation.parts import Part
from scanner_sim.foundation.units import FROM_FILE

AnyPart = TypeVar("AnyPart", bound=Part)

LARGEST_FILE = 1_000_000
"""Bytes of a scenario file: thousands of objects need half of it, and reading it takes some twenty seconds."""


def read_part(path: Path, kind: type[AnyPart], what: str) -> tuple[AnyPart, Document]:
    """Read a file of another kind than a scenario by the same rules; relative paths in it count from its folder.

    Parameters
    ----------
    path
        A YAML file.
    kind
        The part that it holds.
    what
        A word for that, with its article.

    Returns
    -------
    AnyPart, Document
        What it holds, and the lines of its values.

    Raises
    ------
    InputError
        If the file cannot be read.
    ScenarioError
        If it has faults; it holds all that could be found, in the order of the file.
    """
    document = read_document(text_of(path))
    faults = list(document.faults)
    if document.readable and not isinstance(document.data, dict):
        problem = f"it holds {shown(document.data)} instead of the keys of {what}."
        faults.append(Fault("", problem, "Begin with 'schema: 1'.", document.line(())))
    if not isinstance(document.data, dict):
        raise ScenarioError(faults, source=str(path))
    try:
        folder = path.absolute().parent
        found = kind.model_validate(document.data, context={**FROM_FILE, "folder": folder})
    except ValidationError as error:
        faults += faults_in(error, document, {}, root=kind)
    if faults:
        raise ScenarioError(in_order(faults), source=str(path))
    return found, document


def faults_in(
    error: ValidationError,
    document: Document,
    origins: Mapping[Location, str],
    inside: Location = (),
    root: type[Part] = Scenario,
) -> list[Fault]:
    """Return what pydantic found, but for what is missing or doubtful because of faults of the text."""
    return [
        fault_at(document, origins, *found)
        for found in faults_found(error, document.data, inside, root)
        if not any(found.location[: len(location)] == location for location in document.broken)
    ]


def in_order(faults: list[Fault]) -> list[Fault]:
    """Return faults in the order of the file; those without a line are overrides', or of what is not there."""
    return sorted(faults, key=lambda fault: fault.line or 10**9)


def text_of(path: Path) -> str:
    """Return the text of a scenario file."""
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise InputError(f"{path} is a folder, not a scenario.", remedy=_scenario_in(path))
        if not stat.S_ISREG(mode):
            # A pipe that nobody writes to would be waited for without end.
            raise InputError(f"{path} is a pipe or a device, not a file.", remedy="Name a YAML file.")
        with path.open("rb") as stream:
            content = stream.read(LARGEST_FILE + 1)
    except FileNotFoundError:
        raise InputError(f"There is no file {path}.", remedy=_similar(path)) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path} cannot be read: {reason}.", remedy="Name a YAML file.") from None
    if len(content) > LARGEST_FILE:
        raise InputError(
            f"{path} is larger than {LARGEST_FILE / 1e6:.0f} MB, too large for a scenario.",
            remedy="Name a YAML file; large scenes belong into meshes or a Mitsuba XML file.",
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{path} is not a text in UTF-8 (line {line}).",
            remedy="Name a YAML file, saved in the encoding UTF-8.",
        ) from None


def _scenario_in(folder: Path) -> str:
    try:
        names = sorted(path.name for path in folder.iterdir() if path.suffix in (".yaml", ".yml"))
    except OSError:
        names = []
    return f"Did you mean {folder / names[0]}?" if names else "Name a YAML file."


def _similar(path: Path) -> str:
    try:
        names = [entry.name for entry in path.parent.iterdir() if entry.suffix in (".yaml", ".yml")]
    except (FileNotFoundError, NotADirectoryError):
        return f"The folder {path.parent} does not exist either."
    except OSError:
        names = []
    near = difflib.get_close_matches(path.name, names, n=1)
    return f"Did you mean {path.parent / near[0]}?" if near else "Check the name and the folder."


def fault_at(
    document: Document, origins: Mapping[Location, str], location: Location, problem: str, remedy: str
) -> Fault:
    """Return the fault of a location, named after the override that filled it, or with its line."""
    for length in range(len(location), 0, -1):
        if location[:length] in origins:
            where = f"{spell(location, document.data)}, set by {shown(origins[location[:length]])}"
            return Fault(where, problem, remedy)
    return Fault(spell(location, document.data), problem, remedy, document.line(location))
