"""Instruments as files: each value with its mark and its source, and how a scenario takes them over.

The shipped ones lie in the folder ``presets`` and go by their names; one of the user's own goes by its path.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from scanner_sim.config.document import Document, Location, Value, read_document, spell
from scanner_sim.config.wording import capital, choice, inline_yaml, shown
from scanner_sim.foundation.errors import Fault, InputError, ScenarioError
from scanner_sim.foundation.named_files import read_text_file
from scanner_sim.foundation.parts import nearest_file

DEFAULT = "nrc_2000"
"""Preset of a scenario that names none."""
MARKS: Mapping[str, str] = {
    "printed": "in the document that the preset is about",
    "literature": "in other papers, standards or data sheets of such parts",
    "assumed": "printed nowhere; the source says why it is this value",
}
"""How sure a value is, and what each mark means."""

_SHIPPED = Path(__file__).with_name("presets")
_SUFFIXES = (".yaml", ".yml")
_LARGEST = 1_000_000
"""Bytes of a file."""
_LONGEST_LINE = 20
"""Presets of which each extends the next."""
_KEYS = ("schema", "extends", "about", "scanner")
ONE_OF = ("peak_power", "energy")
"""Keys of a pulse that exclude one another: the one that a scenario gives stands in the place of the preset's."""


class Stated(NamedTuple):
    """A value as a preset spells it, its mark, and where it comes from."""

    value: Value
    mark: str
    source: str


class Preset(NamedTuple):
    """An instrument's file, read.

    ``name`` is what a scenario calls it, or its absolute path; ``values`` is the block ``scanner`` that stands for it;
    ``stated`` has each value by its location in the file; ``document`` has the lines, and the faults found so far;
    ``base`` is the instrument that it extends, whose values are in ``values`` and ``stated`` too.
    """

    name: str
    about: str
    values: Mapping[str, Any]
    stated: Mapping[Location, Stated]
    document: Document
    base: Preset | None = None


def shipped_presets() -> tuple[str, ...]:
    """Return the names of the shipped presets."""
    return tuple(sorted(path.stem for path in _SHIPPED.glob("*.yaml")))


def preset_text(name: str, folder: str | Path = "") -> str:
    """Return the text of a shipped preset, or of a file whose path counts from a folder.

    Raises
    ------
    InputError
        If there is none, or its file cannot be read.
    """
    return read_text_file(_path(name, folder), _LARGEST)


def read_preset(name: str, folder: str | Path = "", inside: tuple[str, ...] = ()) -> Preset:
    """Read a preset; faults of its text are noted in its document, others raised as by :func:`preset_text`.

    Whether its values make a scanner is seen when one is made of them. ``inside`` are the presets that extend it.
    """
    if not _is_file(name):
        return _shipped(name)
    path = _path(name, folder)
    return _parse(path.as_posix(), read_text_file(path, _LARGEST), path.parent, inside)


@cache
def _shipped(name: str) -> Preset:
    return _parse(name, preset_text(name), _SHIPPED, ())


def _is_file(name: str) -> bool:
    return name.endswith(_SUFFIXES)


def _path(name: str, folder: str | Path) -> Path:
    if _is_file(name):
        path = Path(os.path.abspath(Path(folder, os.path.expanduser(name))))
        if not os.path.exists(path):
            raise InputError(f"there is no file {path}.", remedy=capital(nearest_file(path, _SUFFIXES)))
        return path
    if name not in shipped_presets():
        remedy = f"{choice(name, shipped_presets())} Or name a file, as my_scanner.yaml."
        raise InputError(f"there is no preset {shown(name)}.", remedy=remedy)
    return _SHIPPED / f"{name}.yaml"


def preset_of(block: Mapping[str, Any], folder: str | Path = "") -> Preset | None:
    """Return the preset that a block ``scanner`` names; None where the block leaves nothing out.

    A scenario that came with a result leaves nothing out: it asks for no file, which may be gone or may have changed.

    Raises
    ------
    InputError
        As :func:`read_preset`.
    """
    if _whole(block, _shipped(DEFAULT).values):
        return None
    name = block.get("preset", DEFAULT)
    if not isinstance(name, str):
        raise InputError(
            f"{shown(name)} is not the name of a preset.", remedy=f"Write for example {DEFAULT}."
        )
    return read_preset(name, folder)


def fill(block: Mapping[str, Any], preset: Preset | None) -> dict[str, Any]:
    """Return a block ``scanner`` with all that it leaves out as a preset has it.

    Raises
    ------
    ScenarioError
        If the preset's text, or that of one that it extends, has faults.
    """
    if preset is None:
        return dict(block)
    if preset.base is not None:
        fill({}, preset.base)
    if preset.document.faults:
        raise ScenarioError(preset.document.faults, source=preset.name)
    return {**_over(preset.values, block), "preset": preset.name}


def _whole(block: object, wanted: object) -> bool:
    """Return whether a block leaves out nothing of another; the word for a part that is not there says all."""
    if block == "none":
        return True
    if not isinstance(block, Mapping) or not isinstance(wanted, Mapping):
        return block is not None
    given = any(block.get(key) is not None for key in ONE_OF)
    return all((given and key in ONE_OF) or _whole(block.get(key), value) for key, value in wanted.items())


def _over(preset: object, block: object) -> Any:
    """Return a block laid over that of a preset; what is no block replaces what lies below it."""
    if not isinstance(block, Mapping) or not isinstance(preset, Mapping):
        return block
    given = any(block.get(key) is not None for key in ONE_OF)
    below = {key: value for key, value in preset.items() if not (given and key in ONE_OF)}
    above = {key: _over(preset.get(key), value) for key, value in block.items() if given or key not in ONE_OF}
    return below | above


def _parse(name: str, text: str, folder: Path, inside: tuple[str, ...]) -> Preset:
    """Return a preset from its text; names of files in it count from its folder."""
    document = read_document(text)
    data, stated = document.data, dict[Location, Stated]()
    preset = Preset(name, "", {}, stated, document)
    if not document.readable:
        return preset
    if not isinstance(data, dict):
        _note(document, (), f"it holds {shown(data)} instead of keys.", f"Write {', '.join(_KEYS)}.")
        return preset
    for key in data:
        if key not in _KEYS:
            _note(document, (key,), "there is no such key.", choice(key, _KEYS))
    version, about, block = (data.get(key) for key in ("schema", "about", "scanner"))
    if version != 1 or version is True:
        problem = f"{shown(version)} is no version that this program reads."
        _note(document, ("schema",), problem, "Write 'schema: 1'.")
    if not isinstance(about, str):
        remedy = "Write what the instrument is, and where that is printed."
        _note(document, ("about",), f"{shown(about)} is not a sentence.", remedy)
    if not isinstance(block, dict):
        _note(document, ("scanner",), f"{shown(block)} is not a block of keys.", "Copy a shipped preset.")
        return preset
    if "preset" in block:
        remedy = "Write 'extends: NAME' beside scanner."
        _note(document, ("scanner", "preset"), "a preset has no preset of its own.", remedy)
    preset = preset._replace(about=str(about), values=_values(block, ("scanner",), document, stated, folder))
    return preset if data.get("extends") is None else _extended(preset, data["extends"], folder, inside)


def _extended(preset: Preset, extends: Value, folder: Path, inside: tuple[str, ...]) -> Preset:
    """Return a preset laid over the one that it extends."""
    line = (*inside, preset.name)
    try:
        if not isinstance(extends, str):
            remedy = f"Write for example 'extends: {DEFAULT}'."
            raise InputError(f"{shown(extends)} is not the name of a preset.", remedy=remedy)
        other = _path(extends, folder).as_posix()
        if other in line:
            around = " extends ".join(Path(one).name for one in (*line[line.index(other) :], other))
            raise InputError(f"{around}: a circle.", remedy="Let one of them extend nothing.")
        if len(line) > _LONGEST_LINE:
            raise InputError(
                f"{_LONGEST_LINE} presets extend one another up to here.", remedy="Extend a nearer one."
            )
        base = read_preset(extends, folder, line)
    except InputError as error:
        _note(preset.document, ("extends",), error.message, error.remedy)
        # What is wrong beside it is told, too.
        base = read_preset(DEFAULT)
    kept = {
        at: _inherited(base, at) for at in base.stated if not any(_replaces(own, at) for own in preset.stated)
    }
    return preset._replace(
        values=_over(base.values, preset.values), stated={**kept, **preset.stated}, base=base
    )


def _inherited(base: Preset, location: Location) -> Stated:
    """Return a value as what extends its preset has it: printed elsewhere, with the name of who said it."""
    found = base.stated[location]
    if base.base is not None and location in base.base.stated and found == _inherited(base.base, location):
        return found
    mark = "literature" if found.mark == "printed" else found.mark
    return found._replace(mark=mark, source=f"{Path(base.name).name}: {found.source}")


def _replaces(own: Location, other: Location) -> bool:
    """Return whether a value stands in the place of another: at it, above or below it, or excludes it."""
    short = min(len(own), len(other))
    twins = own[:-1] == other[:-1] and own[-1] in ONE_OF and other[-1] in ONE_OF
    return own[:short] == other[:short] or twins


def _values(
    node: Value, here: Location, document: Document, stated: dict[Location, Stated], folder: Path
) -> Any:
    """Return what stands at a location without marks and sources, which are kept apart."""
    if not isinstance(node, dict):
        wanted = inline_yaml({"value": node, "mark": "assumed", "source": "my data sheet"})
        _note(document, here, f"{shown(node)} has no mark and no source.", f"Write for example {wanted}.")
        return node
    if not any(key in node for key in Stated._fields):
        return {key: _values(item, (*here, key), document, stated, folder) for key, item in node.items()}
    value, mark, source = (node.get(key) for key in Stated._fields)
    for key in node:
        if key not in Stated._fields:
            _note(document, (*here, key), "there is no such key beside a value.", choice(key, Stated._fields))
    if value is None or isinstance(value, dict):
        _note(document, here, f"{shown(value)} is not a value.", "Write it below the key value.")
    if str(mark) not in MARKS:
        _note(document, (*here, "mark"), f"{shown(mark)} is not a mark.", choice(mark, tuple(MARKS)))
    if not isinstance(source, str) or not source.strip():
        remedy = "Write where the value is from, or why it is this one."
        _note(document, (*here, "source"), f"{shown(source)} is not a source.", remedy)
    stated[here] = Stated(value, str(mark), str(source))
    if isinstance(value, str) and value.lower().endswith(".csv"):
        return str(folder / os.path.expanduser(value))
    return value


def _note(document: Document, location: Location, problem: str, remedy: str) -> None:
    document.faults.append(Fault(spell(location), problem, remedy, document.line(location)))
    document.broken.add(location)
