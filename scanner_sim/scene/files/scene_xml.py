"""Reading the elements of a Mitsuba scene in XML.

Includes and parameters are resolved here; :mod:`scanner_sim.scene.files.scene_rules` says what of the elements counts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.named_files import LARGEST_XML, file_beside, read_ordinary

MOST_ELEMENTS = 300_000
DEEPEST = 30
"""Elements within one another."""
MOST_FILES = 1000
"""Files that are included."""
LONGEST_VALUE = 10_000
"""Characters of a value: parameters made of parameters could grow without end."""


@dataclass
class Element:
    """An element of an XML file, and where it stands."""

    tag: str
    attributes: dict[str, str]
    line: int
    file: Path
    inside: list[Element] = field(default_factory=list)

    def fault(self, problem: str, remedy: str = "") -> NoReturn:
        """Say what is wrong with the element."""
        raise InputError(f"line {self.line} of {str(self.file)!r}: {problem}", remedy=remedy)


def read_scene(path: Path) -> Element:
    """Return the scene of an XML file with its includes and parameters resolved.

    Raises
    ------
    InputError
        If a file cannot be read, is no XML, or declares entities.
    """
    reader = _Reader(path.parent.resolve())
    scene = reader.tree(path)
    if scene.tag != "scene":
        scene.fault(f"the outermost element is {scene.tag!r}, not a scene.", "Wrap it in <scene>.")
    scene.inside = list(reader.resolve(scene, 0))
    return scene


class _Reader:
    """One scene, while it is read: the parameters so far, and how much there may still be."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._parameters: dict[str, str] = {}
        self._elements = 0
        self._files = 0

    def tree(self, path: Path) -> Element:
        """Return the outermost element of a file."""
        content = read_ordinary(path, LARGEST_XML)
        parser = expat.ParserCreate()
        outermost: list[Element] = []
        open_elements: list[Element] = []

        def start(tag: str, attributes: dict[str, str]) -> None:
            element = Element(tag, attributes, parser.CurrentLineNumber, path)
            self._elements += 1
            if self._elements > MOST_ELEMENTS or len(open_elements) >= DEEPEST:
                element.fault("the scene has too many elements, or too many within one another.")
            (open_elements[-1].inside if open_elements else outermost).append(element)
            open_elements.append(element)

        def text(characters: str) -> None:
            if characters.strip():
                open_elements[-1].fault("there is text between the elements.", "Write values as attributes.")

        def declaration(*_: object) -> NoReturn:
            raise InputError(
                f"the scene {str(path)!r} has a document type.", remedy="Remove the line <!DOCTYPE …>."
            )

        parser.StartElementHandler, parser.CharacterDataHandler = start, text
        parser.EndElementHandler = lambda tag: open_elements.pop()
        parser.StartDoctypeDeclHandler = declaration
        try:
            parser.Parse(content, True)
        except expat.ExpatError as error:
            reason = expat.ErrorString(error.code)
            raise InputError(f"line {error.lineno} of {str(path)!r} is no XML: {reason}.") from None
        except (ValueError, LookupError):  # an encoding that is none
            raise InputError(f"the scene {str(path)!r} is no XML.", remedy="Save it in UTF-8.") from None
        return outermost[0]

    def resolve(self, parent: Element, depth: int) -> Iterator[Element]:
        """Yield the elements within one: parameters filled in, included files in the place of their names."""
        for element in parent.inside:
            for name, value in element.attributes.items():
                element.attributes[name] = self._fill_parameters(element, value)
            if element.tag == "default":
                only(element, "name", "value")
                # What is given from outside counts more than a default; here only the first one does.
                self._parameters.setdefault(
                    required_attribute(element, "name"), required_attribute(element, "value")
                )
            elif element.tag == "include":
                only(element, "filename")
                yield from self._include(element, depth)
            else:
                element.inside = list(self.resolve(element, depth))
                yield element

    def _include(self, element: Element, depth: int) -> Iterator[Element]:
        self._files += 1
        if depth >= 15 or self._files > MOST_FILES:
            element.fault("files include one another too often.", "Look for a file that includes itself.")
        try:
            inner = self.tree(file_beside(required_attribute(element, "filename"), self._folder))
        except InputError as error:
            element.fault(error.message, error.remedy)
        holder = inner if inner.tag == "scene" else Element("scene", {}, inner.line, inner.file, [inner])
        yield from self.resolve(holder, depth + 1)

    def _fill_parameters(self, element: Element, value: str) -> str:
        """Return a value with its parameters, ``$name``, in place; of two names the longer one counts."""
        if "$" in value:
            for name in sorted(self._parameters, key=len, reverse=True):
                value = value.replace(f"${name}", self._parameters[name])
        if "$" in value:
            element.fault(
                f"{value[:80]!r} holds a parameter that has no value.", "Give it one with <default>."
            )
        if len(value) > LONGEST_VALUE:
            element.fault(f"a value has more than {LONGEST_VALUE} characters.")
        return value


def only(element: Element, *names: str) -> None:
    """Find attributes that an element does not have."""
    for name in element.attributes:
        if name not in names:
            element.fault(f"<{element.tag}> has no attribute {name!r}.", f"It has {', '.join(names)}.")


def required_attribute(element: Element, name: str) -> str:
    """Return an attribute that an element must have."""
    value = element.attributes.get(name)
    if not value:
        element.fault(f"<{element.tag}> lacks its {name}.")
    return value
