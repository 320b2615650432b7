"""Numbers of objects and materials in results: those that a scenario gives, and the next ones for all others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from scanner_sim.foundation.errors import Fault, printable
from scanner_sim.foundation.parts import Count, Part

HIGHEST = 65_535
"""Largest number: images of labels hold 16 bits mostly."""

Numbers = dict[str, Annotated[Count, Field(ge=1, le=HIGHEST)]]


class Labels(Part):
    """Numbers by name, which stay whatever else the scene holds; names that it does not hold keep theirs, too.

    What has no number here is numbered after the largest one, in the order of the scene.
    """

    objects: Numbers = Field(default={}, examples=[{"wall": 1, "panel": 2}])
    """Numbers of ``truth.object`` by the names of objects."""
    materials: Numbers = Field(default={}, examples=[{"z93_white": 1, "paint": 2}])
    """Numbers of ``truth.material`` by the names of materials: of the library, or ``name`` of one's own."""

    def __hash__(self) -> int:
        """Return the same for equal labels: scenarios are keys of caches."""
        return hash((frozenset(self.objects.items()), frozenset(self.materials.items())))

    def cross_checks(self) -> Iterator[Fault]:
        """Yield names that no line can hold, and numbers that are given twice."""
        for key, numbers in (("objects", self.objects), ("materials", self.materials)):
            first: dict[int, str] = {}
            for name, number in numbers.items():
                if not name or not name.isprintable():
                    yield Fault(f"{key}.{printable(name)}", "this is no name.", "Write for example wall: 1.")
                if first.setdefault(number, name) != name:
                    yield Fault(
                        f"{key}.{name}",
                        f"{number} is already the number of '{first[number]}'.",
                        "Give each name a number of its own.",
                    )

    def extended(self, objects: Sequence[str], materials: Sequence[str]) -> Labels:
        """Return the labels with further names, each numbered after the largest one, as long as there are numbers."""
        both = _extended(self.objects, objects), _extended(self.materials, materials)
        kept = [{name: number for name, number in all_of.items() if number <= HIGHEST} for all_of in both]
        return Labels(objects=kept[0], materials=kept[1])


def label_of_part(owner: str, part: str) -> str:
    """Return the name in results of a part of an object that is an object of its own there."""
    return f"{owner}.{part}"


def is_label_of_part(label: str, owner: str) -> bool:
    """Tell whether a name in results is that of a part of an object; names in scenarios have no dot."""
    return label.startswith(label_of_part(owner, ""))


@dataclass(frozen=True)
class LabelTable:
    """The names behind the numbers of one layer, and the number of each thing that the renderer counts.

    Attributes
    ----------
    names
        Number k is entry k − 1; numbers that nobody has are empty.
    number_of
        Number of the renderer's k-th thing, from 1, shape (things + 1,); nothing is 0.
    """

    names: tuple[str, ...]
    number_of: NDArray[np.uint32]

    @classmethod
    def same(cls, names: Sequence[str]) -> LabelTable:
        """Return the table of things that are counted by their numbers."""
        return cls(tuple(names), np.arange(len(names) + 1, dtype=np.uint32))

    @classmethod
    def of(cls, things: Sequence[str], given: Mapping[str, int]) -> LabelTable:
        """Return the table of things by their names, several of which may be equal."""
        numbers = _extended(given, things)
        names = [""] * max(numbers.values(), default=0)
        for name, number in numbers.items():
            names[number - 1] = name
        return cls(tuple(names), np.array([0, *(numbers[name] for name in things)], dtype=np.uint32))


def _extended(given: Mapping[str, int], names: Sequence[str]) -> dict[str, int]:
    numbers = dict(given)
    last = max(numbers.values(), default=0)
    for name in names:
        if name not in numbers:
            last += 1
            numbers[name] = last
    return numbers
