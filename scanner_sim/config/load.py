"""Loading: from a file or a mapping, with overrides, to a scenario or to all of its faults."""

from __future__ import annotations

import difflib
import stat
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from scanner_sim.config.document import (
    Document,
    Location,
    Value,
    read_document,
    spell,
    value_at,
)
from scanner_sim.config.faults import faults_found
from scanner_sim.config.preset import DEFAULT, Preset, fill, preset_of, read_preset
from scanner_sim.config.replacing import make_room, plain, put, put_overrides, steps_of
from scanner_sim.config.scanner import FILLED, Scanner
from scanner_sim.config.scenario import Scenario
from scanner_sim.config.wording import shown
from scanner_sim.foundation.errors import Fault, InputError, ScenarioError
from scanner_sim.foundation.parts import Part
from scanner_sim.foundation.units import FROM_FILE
from scanner_sim.signals.own import STORED

AnyPart = TypeVar("AnyPart", bound=Part)

LARGEST_FILE = 1_000_000
"""Bytes of a scenario file: thousands of objects need half of it, and reading it takes some twenty seconds."""


def load_scenario(source: str | Path | Mapping[str, object], overrides: Sequence[str] = ()) -> Scenario:
    """Load a scenario.

    Parameters
    ----------
    source
        A YAML file, or the same as a mapping. In a file a unit is compulsory on every dimensional number; in a
        mapping a plain number is SI. Relative paths in it count from the file's folder, or from the working
        folder for a mapping.
    overrides
        Values that replace those of the source, each as ``a.b.c=VALUE`` with VALUE as YAML would have it:
        ``scanner.laser.power=20 mW``. A step may be an index of a list or the name of an object:
        ``scene.objects.wall.position=[0 m, 0 m, 8 m]``.

    Returns
    -------
    Scenario

    Raises
    ------
    InputError
        If the file cannot be read.
    ScenarioError
        If the scenario has faults; it holds all that could be found, in the order of the file.
    """
    if isinstance(source, Mapping):
        try:
            document = Document(plain(source))
        except RecursionError:
            raise ScenarioError([Fault("", "it is nested without end.", "Flatten it.")]) from None
        return _load(document, "scenario", {}, overrides)
    path = Path(source)
    return _load(
        read_document(_text(path)), str(path), {**FROM_FILE, "folder": path.absolute().parent}, overrides
    )


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
    document = read_document(_text(path))
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
        faults += _faults(error, document, {}, root=kind)
    if faults:
        raise ScenarioError(_in_order(faults), source=str(path))
    return found, document


def scenario_from_text(
    text: str, *, name: str, overrides: Sequence[str] = (), stored: bool = False
) -> Scenario:
    """Load a scenario from YAML as :func:`load_scenario` does; ``name`` says in messages where it came from.

    Relative paths count from the working folder. One that is ``stored`` with a result may name an estimator that is
    not registered here: it can be read, and is refused when it is to be simulated again.
    """
    return _load(read_document(text), name, {**FROM_FILE, **(STORED if stored else {})}, overrides)


def load_stored(path: Path) -> Scenario:
    """Load the scenario of a result from its file, as :func:`scenario_from_text` does."""
    context = {**FROM_FILE, **STORED, "folder": path.absolute().parent}
    return _load(read_document(_text(path)), str(path), context, ())


def replaced(
    scenario: Scenario,
    changes: Mapping[str, object],
    *,
    name: str = "scenario",
    context: Mapping[str, object] | None = None,
) -> Scenario:
    """Return a scenario with other values, as :meth:`~scanner_sim.config.scenario.Scenario.replace` says.

    Parameters
    ----------
    scenario
        The scenario, which stays as it is.
    changes
        Values by key.
    name
        Where the changes came from, for messages.
    context
        Of validation: :data:`~scanner_sim.foundation.units.FROM_FILE` where units are compulsory, the ``folder`` from
        which relative paths count.
    """
    document = Document(scenario.model_dump(mode="json", by_alias=True))
    faults: list[Fault] = []
    for key, value in changes.items():
        try:
            put(document.data, steps_of(key), plain(value))
        except ValueError as error:
            faults.append(Fault(str(key), str(error)))
    make_room(document.data, changes)
    if "scanner.preset" in changes and "scanner" not in changes:
        problem = "every value of this scenario's instrument is written out, so another preset changes none of them."
        remedy = "Replace the block as a whole: scanner: {preset: my_scanner.yaml}."
        faults.append(Fault("scanner.preset", problem, remedy))
    if faults:
        raise ScenarioError(faults, source=name)
    return _load(document, name, context or {}, ())


Scenario.replaced_by = replaced


def _load(document: Document, name: str, context: Mapping[str, object], overrides: Sequence[str]) -> Scenario:
    """Return the scenario of a document, or raise all of its faults."""
    if not document.readable:
        raise ScenarioError(document.faults, source=name)
    if not isinstance(document.data, dict):
        raise ScenarioError([_no_scenario(document)], source=name)
    faults = list(document.faults)
    origins = put_overrides(document, overrides, faults)
    if (version := _version_fault(document, origins)) is not None:
        raise ScenarioError([version], source=name)
    _fill_scanner(document, context.get("folder", ""), origins, faults)
    try:
        scenario = Scenario.model_validate(document.data, context={**context, **FILLED})
    except ValidationError as error:
        faults += _faults(error, document, origins)
    if faults:
        raise ScenarioError(_in_order(faults), source=name)
    return scenario


def _faults(
    error: ValidationError,
    document: Document,
    origins: Mapping[Location, str],
    inside: Location = (),
    root: type[Part] = Scenario,
) -> list[Fault]:
    """Return what pydantic found, but for what is missing or doubtful because of faults of the text."""
    return [
        _fault(document, origins, *found)
        for found in faults_found(error, document.data, inside, root)
        if not any(found.location[: len(location)] == location for location in document.broken)
    ]


def _in_order(faults: list[Fault]) -> list[Fault]:
    """Return faults in the order of the file; those without a line are overrides', or of what is not there."""
    return sorted(faults, key=lambda fault: fault.line or 10**9)


def load_scanner(preset: str, folder: str | Path = "") -> Scanner:
    """Load an instrument.

    Parameters
    ----------
    preset
        Name of a shipped preset, or a YAML file.
    folder
        Where the file's path counts from; by default the working folder.

    Raises
    ------
    InputError
        If there is no such preset, or its file cannot be read.
    ScenarioError
        If it has faults; it holds all that could be found, in the order of the file.
    """
    return _scanner(read_preset(preset, folder))


def _scanner(preset: Preset) -> Scanner:
    """Return the scanner of a preset, or raise all of its faults; those of what it extends are told by themselves."""
    if preset.base is not None:
        _scanner(preset.base)
    document = preset.document
    data: dict[str, Value] = {"scanner": {**preset.values, "preset": preset.name}}
    faults = list(document.faults)
    try:
        scanner = Scanner.model_validate(data["scanner"], context={**FROM_FILE, **FILLED})
    except ValidationError as error:
        faults += _faults(error, Document(data, document.lines, broken=document.broken), {}, ("scanner",))
    if faults:
        raise ScenarioError(_in_order(faults), source=preset.name)
    return scanner


def _fill_scanner(
    document: Document, folder: object, origins: Mapping[Location, str], faults: list[Fault]
) -> None:
    """Put into a scenario's scanner what its preset says; faults in the preset's file are told by themselves."""
    assert isinstance(document.data, dict)
    block = document.data.get("scanner", {})
    if not isinstance(block, dict):
        return
    try:
        preset = preset_of(block, str(folder))
    except InputError as error:
        faults.append(_fault(document, origins, ("scanner", "preset"), error.message, error.remedy))
        preset = read_preset(DEFAULT)
    if preset is not None:
        _scanner(preset)
        document.data["scanner"] = fill(block, preset)


def _text(path: Path) -> str:
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


def _no_scenario(document: Document) -> Fault:
    if document.data is None:
        return Fault("", "it is empty.", "Begin with 'schema: 1'; the folder configs has examples.")
    return Fault(
        "", f"it holds {shown(document.data)} instead of keys.", "Begin with 'schema: 1'.", document.line(())
    )


def _version_fault(document: Document, origins: Mapping[Location, str]) -> Fault | None:
    """Return the fault of a scenario of another version: all others would be misleading."""
    version = value_at(document.data, ("schema",))
    if version is None or (version == 1 and isinstance(version, int) and version is not True):
        return None
    problem = f"{shown(version)} is no version that this program reads."
    newer = isinstance(version, int) and version > 1
    remedy = "Install a newer scanner-sim, or write 'schema: 1'." if newer else "Write 'schema: 1'."
    return _fault(document, origins, ("schema",), problem, remedy)


def _fault(
    document: Document, origins: Mapping[Location, str], location: Location, problem: str, remedy: str
) -> Fault:
    """Return the fault of a location, named after the override that filled it, or with its line."""
    for length in range(len(location), 0, -1):
        if location[:length] in origins:
            where = f"{spell(location, document.data)}, set by {shown(origins[location[:length]])}"
            return Fault(where, problem, remedy)
    return Fault(spell(location, document.data), problem, remedy, document.line(location))
