"""YAML as it is meant here: the core schema of YAML 1.2, plain data only, every value with its line.

PyYAML follows YAML 1.1, where ``1e-9`` is a text, ``on`` is true and the last of two equal keys wins in silence.
Here ``1e-9`` is a number, only ``true`` and ``false`` are booleans, and a key given twice is a fault. Tags that
would make Python objects are faults too.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, TypeAlias, TypeVar

import yaml
from yaml.composer import Composer
from yaml.resolver import Resolver

from scanner_sim.foundation.errors import Fault

if yaml.__with_libyaml__:
    from yaml.cyaml import CParser  # type: ignore[attr-defined]

Location = tuple[str | int, ...]
"""Location of a value in a document: the keys and indices from the top down to it."""

Value: TypeAlias = bool | int | float | str | list["Value"] | dict[Any, "Value"] | None
"""Plain data, as YAML holds it; a mapping in Python may have any keys."""

MOST_VALUES = 200_000
"""Values of a document, with aliases written out: an alias bomb has billions."""
DEEPEST = 50
"""Levels of a document: an alias that contains itself has no end."""
LONGEST_NUMBER = 1000
"""Letters of a whole number; a longer one stays a text, which is refused where it stands."""

_TAG = "tag:yaml.org,2002:"
_SCALARS = (
    ("null", r"~|null|Null|NULL|", "~nN\0"),
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", "-+0123456789"),
    (
        "float",
        r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        "-+.0123456789",
    ),
)


Style = TypeVar("Style", bound=type[yaml.resolver.BaseResolver])


def core_schema(style: Style) -> Style:
    """Teach a loader or a dumper of PyYAML what plain scalars mean in YAML 1.2 (chapter 10.3.2)."""
    style.yaml_implicit_resolvers = {}
    for kind, pattern, first in _SCALARS:
        # PyYAML looks up the first character; an empty scalar has the empty one.
        letters = ["" if letter == "\0" else letter for letter in first]
        style.add_implicit_resolver(_TAG + kind, re.compile(rf"^(?:{pattern})$"), letters)
    return style


@core_schema
class _Loader(yaml.SafeLoader):
    """Composes nodes; the values are made here, so that no constructor of PyYAML ever runs."""


if yaml.__with_libyaml__:

    @core_schema
    class _FastLoader(Composer, CParser, Resolver):
        """The same from libyaml's events; nodes are put together in Python, whose recursion has an end."""

        def __init__(self, text: str) -> None:
            CParser.__init__(self, text)
            Composer.__init__(self)
            Resolver.__init__(self)


_ODD = re.compile("[\t?!\ufeff]")
"""What libyaml and PyYAML do not read alike: tabs, ``?`` within brackets, tags, marks of byte order."""


def _nodes(text: str) -> list[yaml.Node]:
    """Return the documents of a text. libyaml reads ten times as fast, but what is wrong with a text PyYAML says."""
    if yaml.__with_libyaml__ and not _ODD.search(text):
        with suppress(yaml.YAMLError, UnicodeEncodeError):
            return list(yaml.compose_all(text, Loader=_FastLoader))  # type: ignore[arg-type]
    return list(yaml.compose_all(text, Loader=_Loader))


@dataclass
class Document:
    """A YAML text, read.

    Attributes
    ----------
    data
        Dictionaries, lists, texts, numbers, booleans and None.
    lines
        Line of every value, counted from 1.
    faults
        What is wrong with the text itself.
    broken
        Locations of values that are missing or doubtful because of those faults.
    readable
        False where the text is no YAML at all, so that ``data`` means nothing.
    """

    data: Value = None
    lines: dict[Location, int] = field(default_factory=dict)
    faults: list[Fault] = field(default_factory=list)
    broken: set[Location] = field(default_factory=set)
    readable: bool = True

    def line(self, location: Location) -> int | None:
        """Return the line of a value, or of the nearest thing around it that the text has."""
        while location:
            if location in self.lines:
                return self.lines[location]
            location = location[:-1]
        return None


def read_document(text: str) -> Document:
    """Read a YAML text; faults are collected, not raised."""
    document = Document()
    try:
        nodes = _nodes(text)
        if len(nodes) > 1:
            line = nodes[1].start_mark.line + 1
            document.faults.append(
                Fault("", "a second document starts here.", "Keep one scenario per file; remove '---'.", line)
            )
        if nodes and nodes[0] is not None:
            budget = iter(range(MOST_VALUES))
            document.data = _value(nodes[0], (), document, budget)
    except _TooLargeError:
        _unreadable(document, "it repeats itself without end, or has too many values.", "Write aliases out.")
    except RecursionError:
        _unreadable(document, f"it is nested deeper than {DEEPEST} levels.", "Flatten it.")
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        _unreadable(document, "a character that YAML does not allow.", "Remove control characters.", line)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        problem, remedy = _syntax(error)
        _unreadable(document, problem, remedy, None if mark is None else mark.line + 1)
    return document


def spell(location: Sequence[str | int], data: Value = None) -> str:
    """Return a location as a user reads it: ``scene.objects[0].size (object 'wall')``."""
    text, names = "", []
    for step in location:
        text += f"[{step}]" if isinstance(step, int) else f".{step}"
        data = _inside(data, step)
        if isinstance(step, int) and isinstance(data, dict) and isinstance(data.get("name"), str):
            names.append(f" (object '{data['name']}')")
    return text.removeprefix(".") + "".join(names[:1])


def value_at(data: Value, location: Sequence[str | int]) -> Value:
    """Return the value at a location of plain data; None where there is nothing."""
    for step in location:
        data = _inside(data, step)
    return data


def _inside(data: Value, step: str | int) -> Value:
    if isinstance(data, dict):
        return data.get(step)
    if isinstance(data, list) and isinstance(step, int) and 0 <= step < len(data):
        return data[step]
    return None


class _TooLargeError(Exception):
    """The document has more values than anybody writes."""


def _unreadable(document: Document, problem: str, remedy: str, line: int | None = None) -> None:
    document.data, document.readable = None, False
    document.faults = [Fault("", f"this is not readable as YAML: {problem}", remedy, line)]


def _value(node: yaml.Node, location: Location, document: Document, budget: Iterator[int]) -> Value:
    """Return the value of a node and note the lines and faults in it."""
    if next(budget, None) is None:
        raise _TooLargeError
    if len(location) > DEEPEST:
        raise RecursionError
    document.lines.setdefault(location, node.start_mark.line + 1)
    if isinstance(node, yaml.MappingNode):
        known = node.tag == _TAG + "map"
        value: Value = _mapping(node, location, document, budget)
    elif isinstance(node, yaml.SequenceNode):
        known = node.tag == _TAG + "seq"
        value = [_value(item, (*location, i), document, budget) for i, item in enumerate(node.value)]
    else:
        known, value = _scalar(node)
    if not known:
        _note(
            document,
            location,
            f"the tag {node.tag.replace(_TAG, '!!')} is not allowed.",
            "Scenarios are plain data: remove the tag.",
            node,
        )
    return value


def _mapping(
    node: yaml.MappingNode, location: Location, document: Document, budget: Iterator[int]
) -> dict[str, Value]:
    result: dict[str, Value] = {}
    for key_node, value_node in node.value:
        if not isinstance(key_node, yaml.ScalarNode) or key_node.tag != _TAG + "str":
            shown = f"'{key_node.value}'" if isinstance(key_node, yaml.ScalarNode) else "a list or block"
            _note(document, location, f"{shown} cannot be a key.", "Keys are words.", key_node)
            continue
        key, here = key_node.value, (*location, key_node.value)
        if key == "<<":
            _note(
                document, here, "merge keys (<<) are not part of YAML 1.2.", "Write the keys out.", key_node
            )
        elif key in result:
            first = document.lines[here]
            last = key_node.start_mark.line + 1
            where = f"twice in line {first}" if first == last else f"in line {first} and again in line {last}"
            _note(document, here, f"this key is given {where}.", "Keep one of them.", key_node)
        else:
            document.lines[here] = key_node.start_mark.line + 1
            result[key] = _value(value_node, here, document, budget)
    return result


def _scalar(node: yaml.Node) -> tuple[bool, Value]:
    """Return whether the tag is known, and the value."""
    text: str = node.value
    try:
        match node.tag.removeprefix(_TAG):
            case "str":
                return True, text
            case "null":
                return True, None
            case "bool":
                return True, text.lower() == "true"
            case "int" if len(text) <= LONGEST_NUMBER:
                return True, int(text, 0) if text.startswith(("0o", "0x")) else int(text)
            case "int":
                return True, text
            case "float":
                word = text.lower()
                return True, float(word.replace(".", "") if word.endswith(("inf", "nan")) else word)
    except ValueError:
        # A tag that contradicts its text: the text itself is the better answer, as it is for thousands of digits.
        return True, text
    return False, text


def _note(document: Document, location: Location, problem: str, remedy: str, node: yaml.Node) -> None:
    document.faults.append(Fault(spell(location), problem, remedy, node.start_mark.line + 1))
    document.broken.add(location)


def _syntax(error: yaml.MarkedYAMLError) -> tuple[str, str]:
    """Translate what PyYAML says into what the user should look for."""
    problem, context = error.problem or "", error.context or ""
    if "'\\t'" in problem:
        return "a tab.", "Indent with spaces."
    if "mapping values are not allowed" in problem:
        return "a colon where no key can stand.", "Check the indentation, or quote text that holds ': '."
    if "undefined alias" in problem:
        return f"{problem.removeprefix('found ')}.", "Define it with & before it is used."
    if "flow" in context:
        return "a bracket or brace that is not closed, or a comma that is missing.", "Check the list."
    if "quoted" in context:
        return "a quotation mark that is not closed.", "Close it on the same line."
    if "block end" in problem or "could not find expected ':'" in problem:
        return (
            "a line that does not fit those above it.",
            "Check the indentation and the colon after the key.",
        )
    return f"{problem or context}.", "Check the line and the one above it."
