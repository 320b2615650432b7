"""Reading a plan: everything that can be wrong with it is found before its first run."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np

from scanner_sim.campaign.measures import MEASURES
from scanner_sim.campaign.plan import Plan, Values
from scanner_sim.campaign.runs import Campaign, changed, dimension_of, ends_of, number_of, spelled
from scanner_sim.config.document import Document, Location, Value, spell
from scanner_sim.config.load import load_scenario
from scanner_sim.config.outline import slots_of_key
from scanner_sim.config.reading import read_part
from scanner_sim.config.replacing import location_of, steps_of
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import Fault, ScenarioError

CHECKED = 500
"""Points of a group, and runs, whose scenarios are made to see whether they are possible; of more, so many evenly."""
RIGHT = 0.5 * math.pi * (1.0 + 1e-12)
"""A right angle, however it was written [rad]."""
FAR_OUT = 6.0
"""Standard deviations within which a normal distribution must stay legal: two values in 10⁹ lie beyond."""


def read_campaign(path: Path) -> Campaign:
    """Return the campaign of a plan's file.

    Raises
    ------
    InputError
        If the plan or its scenario cannot be read.
    ScenarioError
        If either has faults: all that could be found, in the order of the plan.
    """
    plan, document = read_part(path, Plan, "a plan")
    folder = path.absolute().parent
    base = load_scenario(plan.base)
    faults: list[Fault] = []
    try:
        base = changed(base, plan.changes, folder, "set")
    except ScenarioError as error:
        raise ScenarioError(
            [_at(document, ("set",), fault) for fault in error.faults], source=str(path)
        ) from None
    campaign = Campaign(plan, base, folder)
    faults += _unfit_measures(campaign, document)
    for number, group in enumerate(plan.vary):
        unfit = [
            fault
            for key, values in group.keys.items()
            for fault in _unfit_values(campaign, key, values, document, ("vary", number, "keys", key))
        ]
        faults += unfit or _impossible_points(campaign, number, document)
    if faults:
        raise ScenarioError(faults, source=str(path))
    return Campaign(plan, _labelled(campaign), folder)


def _labelled(campaign: Campaign) -> Scenario:
    """Return the base with numbers for all objects and materials that its runs name: each has one in all of them.

    Those of the base come first, then what listed values bring. A reflectance that is drawn makes no name here: its
    material keeps its number where the scenario gives it a ``name``.
    """
    objects, materials = campaign.base.scene.names
    for number, group in enumerate(campaign.plan.vary):
        listed = [key for key, values in group.keys.items() if values.list and key.startswith("scene")]
        for point in range(group.length if listed else 0):
            values = campaign.points(number).at(point)
            with suppress(ScenarioError):
                own = changed(campaign.base, {key: values[key] for key in listed}, campaign.folder, "plan")
                objects, materials = (*objects, *own.scene.names[0]), (*materials, *own.scene.names[1])
    scene = campaign.base.scene
    labels = scene.labels.extended(objects, materials)
    return campaign.base.model_copy(update={"scene": scene.model_copy(update={"labels": labels})})


def _unfit_measures(campaign: Campaign, document: Document) -> Iterator[Fault]:
    """Yield measures of what the scenario does not make."""
    follows = campaign.base.scan.layout == "visits"
    for number, name in enumerate(campaign.plan.measure):
        if (MEASURES[name].of == "scan") == follows:
            fitting = ", ".join(one for one, about in MEASURES.items() if (about.of == "scan") != follows)
            what = "follows targets" if follows else "scans"
            problem = f"'{name}' is measured of another kind of result: the scenario {what}."
            line = document.line(("measure", number))
            yield Fault(f"measure[{number}]", problem, f"Possible: {fitting}.", line)


def _unfit_values(
    campaign: Campaign, key: str, values: Values, document: Document, location: Location
) -> Iterator[Fault]:
    """Yield what is wrong with the values of one key: no such key, no numbers of its dimension, out of its range."""
    if values.list is not None:
        # Seen point by point, with what varies beside it.
        return
    try:
        dimension = dimension_of(campaign.base, key)
        first, last = ends_of(values, dimension)
        cut = None if values.within is None else [number_of(end, dimension) for end in values.within]
    except ValueError as error:
        yield _at(document, location, Fault(key, f"{str(error).rstrip('.')}."))
        return
    form = values.form
    ends = [first, last] if cut is None else cut
    problem = ""
    if form == "normal" and last <= 0.0:
        problem = "the second number of normal is its standard deviation, which must be more than 0."
    elif (form != "normal" or cut is not None) and ends[0] >= ends[1]:
        problem = "the first value must be below the second."
    elif form in ("logarithmic", "log_uniform") and first <= 0.0:
        problem = f"{form} needs values above 0."
    elif form == "sine_uniform" and not (
        dimension and dimension.unit == "rad" and max(map(abs, ends)) <= RIGHT
    ):
        problem = "sine_uniform needs angles from -90 deg to 90 deg."
    if problem:
        example = "[-90 deg, 90 deg]" if form == "sine_uniform" else "[1, 2] with units"
        yield _at(document, location, Fault(key, problem, f"Write for example {form}: {example}."))
        return
    if form == "normal" and cut is None:
        ends = [first - FAR_OUT * last, first + FAR_OUT * last]
    illegal = (
        _illegal_end(campaign, key, spelled(end, dimension), values, document, location) for end in ends
    )
    yield from next(filter(None, map(list, illegal)), [])


def _illegal_end(
    campaign: Campaign, key: str, end: Value, values: Values, document: Document, location: Location
) -> Iterator[Fault]:
    """Yield that a form reaches a value which its key does not take, whatever else there is."""
    for fault in _faults_of(campaign.base, {key: end}, campaign.folder):
        if fault.location.partition(" ")[0] != _plain_name(campaign.base, key):
            # It contradicts something else: that is seen with what varies beside it.
            continue
        if not slots_of_key(location_of(campaign.base.model_dump(mode="json", by_alias=True), steps_of(key))):
            yield _at(document, location, fault)
            continue
        remedy = fault.remedy
        if values.form == "normal" and values.within is None:
            remedy = "Cut the distribution off with within: [first, last]."
        yield _at(document, location, Fault(key, f"{values.form} reaches {end}: {fault.problem}", remedy))


def _plain_name(base: Scenario, key: str) -> str:
    """Return a key as faults name it: objects by their index."""
    return spell(location_of(base.model_dump(mode="json", by_alias=True), steps_of(key)))


def _impossible_points(campaign: Campaign, number: int, document: Document) -> list[Fault]:
    """Return which values of a group are impossible whatever the others are.

    What only contradicts something else may go with other values of that: :func:`impossible_runs` tells it.
    """
    found: dict[Fault, None] = {}
    group = campaign.plan.vary[number]
    for point in _some(group.length):
        values = campaign.points(number).at(point)
        for fault in _faults_of(campaign.base, values, campaign.folder):
            key = _key_of(campaign.base, fault, list(group.keys))
            if key is None or fault not in _faults_of(campaign.base, {key: values[key]}, campaign.folder):
                continue
            location: Location = ("vary", number, "keys", key)
            location = location if group.keys[key].list is None else (*location, point)
            found.setdefault(_at(document, location, fault))
    return list(found)


def impossible_runs(campaign: Campaign) -> tuple[str, ...]:
    """Return a sentence for each contradiction among those of the campaign's runs that are looked at.

    Raises
    ------
    ScenarioError
        If none of them is possible.
    """
    found: dict[str, tuple[int, Fault]] = {}
    looked_at, bad = _some(len(campaign)), 0
    for run in looked_at:
        faults = _faults_of(campaign.base, campaign.changes(run), campaign.folder)
        bad += bool(faults)
        for fault in faults:
            found.setdefault(fault.location, (run, fault))
    if bad == len(looked_at):
        raise ScenarioError([fault for _, fault in found.values()], source="every run of the plan")
    return tuple(f"run {run} will be a row with its fault: {fault}" for run, fault in found.values())


def _some(count: int) -> list[int]:
    """Return all of so many numbers, or some of them evenly, the first and the last among them."""
    return sorted(set(np.linspace(0, count - 1, min(count, CHECKED)).round().astype(int).tolist()))


def _faults_of(base: Scenario, values: dict[str, Value], folder: Path) -> tuple[Fault, ...]:
    try:
        changed(base, values, folder, "plan")
    except ScenarioError as error:
        return error.faults
    return ()


def _key_of(base: Scenario, fault: Fault, keys: list[str]) -> str | None:
    """Return the key of which a fault speaks."""
    where = fault.location.partition(" ")[0]
    near = [key for key in keys if where.startswith((key, _plain_name(base, key)))]
    return max(near, key=len, default=None)


def _at(document: Document, location: Location, fault: Fault) -> Fault:
    """Return a fault of a scenario's key as one of the plan, with its line."""
    where = "vary" if location[0] == "vary" else str(location[0])
    if len(location) > 1:
        where += f"[{location[1]}]"
    return Fault(f"{where}, {fault.location}", fault.problem, fault.remedy, document.line(location))
