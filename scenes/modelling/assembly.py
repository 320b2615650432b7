"""The Node and Z1 with their targets, and the list of where these are."""

from __future__ import annotations

import json
from pathlib import Path

from modelling import node, z1
from modelling.fittings import target_plate
from modelling.solids import Array, placed
from modelling.writing import Model

PLATE_RATIO = 1.8
"""Side of a target's plate over the diameter of its disc."""


class Targets:
    """Puts targets on a model and remembers their poses."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._list: list[dict[str, object]] = []

    def __call__(self, name: str, module_from_target: Array, diameter: float) -> None:
        part = f"targets_{name.rsplit('_', 1)[0]}"
        for colour, solid in target_plate(diameter, PLATE_RATIO * diameter, 0.03, segments=64).items():
            self._model.add(part, colour, placed(solid, module_from_target))
        self._list.append(
            {
                "name": name,
                "centre_m": [round(float(value), 6) + 0.0 for value in module_from_target[:3, 3]],
                "normal": [round(float(value), 6) + 0.0 for value in -module_from_target[:3, 2]],
                "diameter_m": diameter,
            }
        )

    def write(self, path: Path) -> None:
        """Write name, centre, outward normal and diameter of every target, in the module frame."""
        lines = ",\n  ".join(json.dumps(entry) for entry in self._list)
        path.write_text(f"[\n  {lines}\n]\n", encoding="utf-8")


def node_and_z1() -> tuple[Model, Targets]:
    model = Model()
    targets = Targets(model)
    node.build(model, targets)
    z1.build(model, targets)
    return model, targets
