"""The runs of a plan: which values each has, and the scenario that these make.

Run i depends on the plan and i alone: not on who makes it, or on which were made before.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, qmc

from scanner_sim.campaign.plan import Group, Plan, Values
from scanner_sim.campaign.sensitivity import design_of, seeded_as
from scanner_sim.config.document import Value
from scanner_sim.config.load import replaced
from scanner_sim.config.outline import slots_of_key
from scanner_sim.config.replacing import location_of, steps_of
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.units import FROM_FILE, Dimension

Array = NDArray[np.float64]

SEED = "seed"
"""The key that every run has a value of its own for, unless it varies by itself."""


@dataclass(frozen=True)
class Campaign:
    """A plan with its base scenario.

    Attributes
    ----------
    plan
        What varies.
    base
        The scenario of which every run is a change; ``plan.changes`` is in it already.
    folder
        Where relative paths in the plan's values count from.
    """

    plan: Plan
    base: Scenario
    folder: Path
    _points: dict[int, Points] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __len__(self) -> int:
        """Return the number of runs."""
        return self.plan.runs

    def place(self, run: int) -> tuple[int, ...]:
        """Return where a run stands on each axis: the groups, then the repetition, which varies fastest."""
        return tuple(int(step) for step in np.unravel_index(run, self.plan.shape))

    def values(self, run: int) -> dict[str, Value]:
        """Return what a run has in the place of the base's values, by key, spelled as in a file."""
        place, found = self.place(run), dict[str, Value]()
        for number in range(len(self.plan.vary)):
            found |= self.points(number).at(place[number])
        return found

    def seed(self, run: int) -> int:
        """Return the seed of a run: by the plan's seed and its number, or that of the run whose seed it shares."""
        place = list(self.place(run))
        for number, group in enumerate(self.plan.vary):
            if group.sample == "saltelli":
                place[number] = seeded_as(place[number], len(group.keys))
        shared = int(np.ravel_multi_index(place, self.plan.shape))
        state = np.random.SeedSequence([self.plan.seed, 0, shared]).generate_state(1, np.uint64)
        return int(state[0] >> np.uint64(1))

    def changes(self, run: int) -> dict[str, Value]:
        """Return all that a run has in the place of the base's values."""
        return {SEED: self.seed(run), **self.values(run)}

    def scenario(self, run: int) -> Scenario:
        """Return the scenario of a run.

        Raises
        ------
        ScenarioError
            If its values are impossible.
        """
        return changed(self.base, self.changes(run), self.folder, f"run {run}")

    def points(self, number: int) -> Points:
        """Return the values of a group."""
        if number not in self._points:
            self._points[number] = Points(self.plan.vary[number], number, self)
        return self._points[number]


def changed(base: Scenario, changes: Mapping[str, Value], folder: Path, name: str) -> Scenario:
    """Return a scenario with values as a file spells them; faults as of :meth:`Scenario.replace`."""
    return replaced(base, changes, name=name, context={**FROM_FILE, "folder": folder})


class Points:
    """The values of a group's keys, point by point."""

    def __init__(self, group: Group, number: int, campaign: Campaign) -> None:
        self._group = group
        self._dimensions = {
            key: dimension_of(campaign.base, key) for key, values in group.keys.items() if values.list is None
        }
        self._drawn = _shares(group, number, campaign.plan.seed)

    def at(self, point: int) -> dict[str, Value]:
        """Return the value of each key at a point."""
        found, column = dict[str, Value](), 0
        for key, values in self._group.keys.items():
            if values.list is not None:
                found[key] = values.list[point]
                continue
            dimension = self._dimensions[key]
            if values.drawn:
                number = drawn_value(values, dimension, float(self._drawn[point, column]))
                column += 1
            else:
                number = grid_value(values, dimension, point)
            found[key] = spelled(number, dimension)
        return found


def _shares(group: Group, number: int, seed: int) -> Array:
    """Return the drawn points of a group in the unit cube, shape (points, drawn keys), within the open interval."""
    columns = sum(values.drawn for values in group.keys.values())
    if not columns:
        return np.zeros((0, 0))
    rng = np.random.default_rng(np.random.SeedSequence([seed, 1, number]))
    if group.sample == "saltelli":
        both = qmc.Sobol(2 * columns, scramble=True, rng=rng).random(group.count)
        points = design_of(both[:, :columns], both[:, columns:])
    elif group.sample == "sobol":
        points = qmc.Sobol(columns, scramble=True, rng=rng).random(group.length)
    elif group.sample == "latin_hypercube":
        points = qmc.LatinHypercube(columns, rng=rng).random(group.length)
    else:
        points = rng.random((group.length, columns))
    least = 2.0**-53
    inside: Array = np.clip(points, least, 1.0 - least)
    return inside


def dimension_of(base: Scenario, key: str) -> Dimension | None:
    """Return the dimension of what stands at a key; None where it has none."""
    location = location_of(base.model_dump(mode="json", by_alias=True), steps_of(key))
    slots = slots_of_key(location)
    return next((slot.dimension for slot in slots if slot.dimension is not None), None)


def number_of(value: Any, dimension: Dimension | None) -> float:
    """Return a bound of a distribution in SI units.

    Raises
    ------
    ValueError
        With a sentence, if it is no number with a unit of that dimension.
    """
    if dimension is not None and isinstance(value, str):
        return dimension.parse(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"'{value}' is not a number")
    if dimension is not None and dimension.unit != "1":
        raise ValueError(f"{value!r} has no unit; write for example {dimension.sample}")
    return float(value)


def ends_of(values: Values, dimension: Dimension | None) -> tuple[float, float]:
    """Return the two numbers of a form, in SI units; faults as of :func:`number_of`."""
    first, last = getattr(values, values.form)
    return number_of(first, dimension), number_of(last, dimension)


def drawn_value(values: Values, dimension: Dimension | None, share: float) -> float:
    """Return the quantile of a distribution at a share between 0 and 1."""
    first, last = ends_of(values, dimension)
    if values.form == "uniform":
        return first + share * (last - first)
    if values.form == "log_uniform":
        return float(first * (last / first) ** share)
    if values.form == "sine_uniform":
        return math.asin(math.sin(first) + share * (math.sin(last) - math.sin(first)))
    below, above = 0.0, 1.0
    if values.within is not None:
        ends = [number_of(end, dimension) for end in values.within]
        below, above = (float(norm.cdf((end - first) / last)) for end in ends)
    return first + last * float(norm.ppf(below + share * (above - below)))


def grid_value(values: Values, dimension: Dimension | None, point: int) -> float:
    """Return a value of an even spacing; its ends are exact."""
    first, last = ends_of(values, dimension)
    steps = (values.count or 2) - 1
    if point in (0, steps):
        return last if point else first
    if values.form == "linear":
        return first + (last - first) * point / steps
    return float(first * (last / first) ** (point / steps))


def spelled(number: float, dimension: Dimension | None) -> Value:
    """Return a number as a file spells it; reading it gives the same number."""
    return number if dimension is None else dimension.format(number)
