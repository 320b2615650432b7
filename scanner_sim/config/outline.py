"""The outline of a scenario: which keys are legal where, read from the types of the parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import Tag
from pydantic.fields import FieldInfo

from scanner_sim.config.document import Value, value_at
from scanner_sim.config.preset import DEFAULT, read_preset
from scanner_sim.config.scenario import Scenario
from scanner_sim.config.wording import inline_yaml
from scanner_sim.foundation.parts import Part
from scanner_sim.foundation.units import Dimension

EACH = "*"
"""Stands for any index of a list."""


@dataclass
class Slot:
    """One entry of the outline: its location, and the part, the dimension and the field there."""

    location: tuple[str, ...] = ()
    part: type[Part] | None = None
    dimension: Dimension | None = None
    choices: tuple[str | int, ...] = ()
    field: FieldInfo | None = None
    root: type[Part] = Scenario

    @property
    def keys(self) -> tuple[str, ...]:
        """The legal keys below this location."""
        return () if self.part is None else tuple(key_of(*item) for item in self.part.model_fields.items())

    @property
    def example(self) -> str:
        """What a user could write here, as YAML."""
        if self.field is not None and self.field.examples:
            return inline_yaml(self.field.examples[0])
        if self.dimension is not None:
            return self.default or str(self.dimension.examples[0])
        if self.choices:
            return inline_yaml(self.choices[0])
        if self.part is not None:
            return f"{{{self.keys[0]}: {slot_at((*self.location, self.keys[0]), self.root).example}}}"
        return inline_yaml(self._unwritten)

    @property
    def default(self) -> str:
        """The default as YAML; empty where there is none, or where it is no plain value."""
        value = self._unwritten
        if not isinstance(value, bool | int | float | str):
            return ""
        return (
            str(self.dimension.format(value))
            if isinstance(value, float) and self.dimension
            else inline_yaml(value)
        )

    @property
    def preset(self) -> Value:
        """What the instrument of a scenario that names none has here, as its file spells it; None elsewhere."""
        steps = [step for step in self.location if not step.startswith("(")]
        if self.root is not Scenario or steps[:1] != ["scanner"]:
            return None
        return value_at(dict(read_preset(DEFAULT).values), steps[1:])

    @property
    def _unwritten(self) -> Any:
        """What a scenario has here that does not write it."""
        if self.preset is not None:
            return self.preset
        return None if self.field is None or self.field.is_required() else self.field.default


@cache
def outline(root: type[Part] = Scenario) -> dict[tuple[str, ...], Slot]:
    """Return every location of a scenario, or of another kind of file; union tags in parentheses are steps, too."""
    slots: dict[tuple[str, ...], Slot] = {}
    _visit(root, (), (), None, slots)
    for slot in slots.values():
        slot.root = root
    return slots


def slot_at(location: tuple[str | int, ...], root: type[Part] = Scenario) -> Slot:
    """Return the slot of a location as pydantic names it, tags included; an empty one outside of the outline."""
    slots, here = outline(root), tuple[str, ...]()
    for step in location:
        # Any key of a mapping that is not a part, and any index of a list.
        here = (*here, step) if isinstance(step, str) and (*here, step) in slots else (*here, EACH)
    return slots.get(here, Slot(root=root))


def slots_of_key(steps: Sequence[str | int]) -> list[Slot]:
    """Return what may stand at a key of a scenario, whatever the kinds of what is around it."""
    return _by_key().get(tuple(EACH if isinstance(step, int) else step for step in steps), [])


@cache
def _by_key() -> dict[tuple[str, ...], list[Slot]]:
    """Return the slots of a scenario by their locations without tags."""
    found: dict[tuple[str, ...], list[Slot]] = {}
    for location, slot in outline().items():
        found.setdefault(tuple(step for step in location if not step.startswith("(")), []).append(slot)
    return found


def locations_of_key(key: str, root: type[Part] = Scenario) -> list[str]:
    """Return the locations where a key is legal, as a user would write them."""
    found = {
        ".".join(step for step in (*location, key) if not step.startswith("(")).replace(f".{EACH}", "[…]")
        for location, slot in outline(root).items()
        if key in slot.keys
    }
    return sorted(found, key=lambda text: (text.count("."), text))


def kinds_of_key(key: str, slot: Slot) -> list[str]:
    """Return of what may stand in a slot's place, as scans of another type, the kinds that have a key."""
    if not slot.location or not slot.location[-1].startswith("("):
        return []
    return sorted(
        location[-1].strip("()")
        for location, other in outline(slot.root).items()
        if location[:-1] == slot.location[:-1] and location[-1].startswith("(") and key in other.keys
    )


def key_of(name: str, field: FieldInfo) -> str:
    """Return the key of a field in files."""
    return field.alias or name


def _visit(
    kind: Any, metadata: Any, location: tuple[str, ...], field: FieldInfo | None, slots: dict[Any, Slot]
) -> None:
    if get_origin(kind) is Annotated:
        kind, *inner = get_args(kind)
        tag = next((item.tag for item in inner if isinstance(item, Tag)), None)
        return _visit(kind, inner, location if tag is None else (*location, tag), field, slots)
    slot = slots.setdefault(location, Slot(location, field=field))
    slot.dimension = next((item for item in metadata if isinstance(item, Dimension)), slot.dimension)
    if get_origin(kind) in (Union, UnionType):
        for choice in get_args(kind):
            _visit(choice, (), location, field, slots)
    elif get_origin(kind) is dict:
        _visit(get_args(kind)[1], (), (*location, EACH), field, slots)
    elif get_origin(kind) is tuple:
        _visit(get_args(kind)[0], (), (*location, EACH), field, slots)
    elif get_origin(kind) is Literal:
        slot.choices = get_args(kind)
    elif isinstance(kind, type) and issubclass(kind, Part):
        slot.part = kind
        for name, inside in kind.model_fields.items():
            _visit(inside.annotation, inside.metadata, (*location, key_of(name, inside)), inside, slots)
