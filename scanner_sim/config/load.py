"""Loading: from a file or a mapping, with overrides, to a scenario or to all of its faults."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from pydantic import ValidationError

from scanner_sim.config.calibration import believed_instrument
from scanner_sim.config.document import (
    Document,
    Location,
    Value,
    read_document,
    value_at,
)
from scanner_sim.config.preset import DEFAULT, Preset, fill, preset_of, read_preset
from scanner_sim.config.reading import fault_at, faults_in, in_order, text_of
from scanner_sim.config.replacing import make_room, plain, put, put_overrides, steps_of
from scanner_sim.config.scanner import FILLED, Scanner
from scanner_sim.config.scenario import Scenario
from scanner_sim.config.wording import shown
from scanner_sim.foundation.errors import Fault, InputError, ScenarioError
from scanner_sim.foundation.units import FROM_FILE
from scanner_sim.signals.own import STORED

_WRITTEN_OUT = (
    "every value of this scenario's instrument is written out, so another preset changes none of them.",
    "Replace the block as a whole: scanner: {preset: my_scanner.yaml}.",
)
"""What is wrong with another preset of an instrument that leaves nothing out, and what helps."""


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
        read_document(text_of(path)), str(path), {**FROM_FILE, "folder": path.absolute().parent}, overrides
    )


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
    return _load(read_document(text_of(path)), str(path), context, ())


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
        faults.append(Fault("scanner.preset", *_WRITTEN_OUT))
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
        faults += faults_in(error, document, origins)
    if faults:
        raise ScenarioError(in_order(faults), source=name)
    believed_instrument(scenario)
    return scenario


def load_scanner(preset: str | Path, folder: str | Path = "") -> Scanner:
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
    return _scanner(read_preset(str(preset), folder))


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
        faults += faults_in(error, Document(data, document.lines, broken=document.broken), {}, ("scanner",))
    if faults:
        raise ScenarioError(in_order(faults), source=preset.name)
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
        faults.append(fault_at(document, origins, ("scanner", "preset"), error.message, error.remedy))
        preset = read_preset(DEFAULT)
    if preset is None and ("scanner", "preset") in origins:
        faults.append(fault_at(document, origins, ("scanner", "preset"), *_WRITTEN_OUT))
    if preset is not None:
        _scanner(preset)
        document.data["scanner"] = fill(block, preset)


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
    return fault_at(document, origins, ("schema",), problem, remedy)
