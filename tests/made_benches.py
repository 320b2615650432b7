"""Instruments that answer by a law: what experiments make of ranges is then known by hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, TypeVar

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from scanner_sim.validation.reproduce.item import Row, Task, Verdict

AGREES, DIFFERS, UNPRINTED, CHOSEN, ALIKE = (
    Verdict.AGREES,
    Verdict.DIFFERS,
    Verdict.UNPRINTED,
    Verdict.CHOSEN,
    Verdict.ALIKE,
)
Array = NDArray[np.float64]
T = TypeVar("T")
Law = Callable[[Any, Any], Mapping[str, Any]]
"""From what was asked for, and its shots, to their layers."""


class Benches:
    """Stands where the instruments of an experiment stood: keeps what was asked for, and answers by a law."""

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, module: ModuleType, law: Law, nearest: float = 1.5625
    ) -> None:
        self.asked: list[Any] = []
        self.shots: list[Any] = []
        self._law, self._nearest = law, nearest
        monkeypatch.setattr(module, "bench", self._bench)
        monkeypatch.setattr(module, "layers_of", self._layers)

    def _bench(self, _: Any, objects: Any, scanner: Any = None, *, step: int = 0, **rest: Any) -> Any:
        first = objects[0] if objects else {}
        made = SimpleNamespace(
            objects=objects,
            distance=first["position"][2] if objects else math.nan,
            reflectance=first.get("material", {}).get("reflectance", math.nan),
            scanner=scanner or {},
            step=step,
            rest=rest,
            scenario=SimpleNamespace(scanner=SimpleNamespace(nearest_range=self._nearest)),
        )
        self.asked.append(made)
        return made

    def _layers(self, made: Any, shots: Any) -> Mapping[str, Any]:
        self.shots.append(shots)
        return self._law(made, shots)


class QuickTask(Task):
    """A quick task which takes care that a whole one would be no smaller."""

    def choose(self, whole: T, quick: T) -> T:
        """Return the second, which is less: a number, a duration, a shorter list or one of less, a wider mesh."""
        assert _amount(whole) >= _amount(quick), (whole, quick)
        return super().choose(whole, quick)


def _amount(value: Any) -> tuple[float, ...]:
    if isinstance(value, str):
        return (float(value.split()[0]),)
    if isinstance(value, float):
        return (1.0 / value,)
    return (float(len(value)), *value) if isinstance(value, tuple | list) else (float(value),)


def quick_task(repository: Path = Path()) -> Task:
    """Return a quick task of a repository."""
    return QuickTask(quick=True, device="cpu", repository=repository)


def verdicts(rows: Sequence[Row]) -> list[Verdict]:
    """Return what rows of a figure are judged to be."""
    return [row.verdict for row in rows]


def signs(shots: Any) -> Array:
    """Return errors of ±1, as many of either: their mean is 0 and their mean square 1."""
    return np.where(shots.shot % 2 == 0, 1.0, -1.0)


def triangulated(shots: Any, R: float, sigma: float, way: str = "") -> dict[str, Array]:
    """Return true ranges, and those of one rangefinder, which err by ±σ."""
    truth = np.full(shots.shot.size, R)
    return {"truth.range_m": truth, f"{way}range_m": truth + sigma * signs(shots)}


def drawn(monkeypatch: pytest.MonkeyPatch, module: ModuleType, made: Any) -> list[Axes]:
    """Return the panels of what an experiment of a module draws; nothing is written."""
    panels: list[Axes] = []

    def sheet(path: Path, title: str, about: str, draw: Any, count: int = 1, **_: Any) -> None:
        panels.extend(Figure().subplots(1, count, squeeze=False)[0])
        draw(panels)

    monkeypatch.setattr(module, "sheet", sheet)
    made.draw(Path())
    return panels
