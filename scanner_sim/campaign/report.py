"""A campaign as one page for a browser: everything is in the file, pictures too."""

from __future__ import annotations

import contextlib
import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scanner_sim.campaign.dependence import MOST_LEVELS, Dependence, by_bin, by_level
from scanner_sim.campaign.measures import MEASURES
from scanner_sim.campaign.plan import Group
from scanner_sim.campaign.report_pictures import draw_measure, draw_sensitivity
from scanner_sim.campaign.result import CampaignResult
from scanner_sim.campaign.runs import Campaign
from scanner_sim.campaign.sensitivity import BESIDE_KEYS, A, B
from scanner_sim.campaign.store import MANIFEST, Store, column_of, is_number, units_of
from scanner_sim.config.document import Value
from scanner_sim.config.wording import inline_yaml
from scanner_sim.products.files.tables import Table
from scanner_sim.products.page_template import page_template, picture_address

Array = NDArray[np.float64]

WORST = 5
"""Runs of a measure that are named as the worst."""
SLIGHT = 0.05
"""Share of a measure's median below which a change is called slight."""
MOST_FAULTS = 20
"""Kinds of faults that are listed."""
_SHARES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)


@dataclass(frozen=True)
class MeasurePart:
    """What the page says of a measure: quantiles, what each key does to it with a verdict, and its worst runs."""

    name: str
    unit: str
    meaning: str
    runs: int
    quantiles: tuple[float, ...]
    dependences: tuple[tuple[Dependence, str], ...]
    worst: tuple[tuple[int, float, str], ...]
    picture: str
    sensitivity: str = ""
    """Picture of its Sobol's indices; empty without Saltelli's design."""


def report_page(store: Store) -> str:
    """Return the page of a campaign, finished or not."""
    table = CampaignResult(store).table()
    parts = [_part(store, table, name) for name in store.measures] if table else []
    manifest = json.loads((store.folder / MANIFEST).read_text(encoding="utf-8"))
    return page_template(Path(__file__).with_name("report_page.html"), short=short).render(
        folder=str(store.folder),
        runs=len(store.done),
        done=int(store.done.sum()),
        failed=store.failed,
        parts=[part for part in parts if part.runs],
        empty=[part for part in parts if not part.runs],
        faults=_faults(table),
        numbered=_numbered(store.campaign),
        versions=manifest["versions"],
        plan=json.dumps(manifest["plan"], indent=2, ensure_ascii=False),
        seconds=float(np.sum(table["seconds"])) if table else 0.0,
    )


def dependences(store: Store, measure: str) -> tuple[Dependence, ...]:
    """Return what each key does to a measure."""
    campaign = store.campaign
    values, found = CampaignResult(store).measured(measure), []
    chosen = [_independent(group) for group in campaign.plan.vary]
    for axis, which in enumerate(chosen):
        values = np.take(values, which, axis)
    for axis, (group, which) in enumerate(zip(campaign.plan.vary, chosen, strict=True)):
        along = np.moveaxis(values, axis, 0).reshape(len(which), -1)
        points = [campaign.points(axis).at(point) for point in which.tolist()]
        numbers = {key: _numbers(store, key, [point[key] for point in points]) for key in group.keys}
        if not group.drawn and group.length <= MOST_LEVELS:
            key, *beside = numbers
            found.append(by_level(key, measure, numbers[key], along, tuple(beside)))
            continue
        for key, at in numbers.items():
            others = [one for name, one in numbers.items() if name != key]
            found.append(by_bin(key, measure, at, along, np.array(others).reshape(len(others), len(at)).T))
    return tuple(found)


def _independent(group: Group) -> NDArray[np.int64]:
    """Return the points of a group that are drawn independently: of Saltelli's design two of each row, A and B."""
    points = np.arange(group.length)
    if group.sample == "saltelli":
        points = points.reshape(-1, len(group.keys) + BESIDE_KEYS)[:, [A, B]].ravel()
    return points


def _numbers(store: Store, key: str, values: list[Value]) -> Array:
    """Return values of a key as numbers; words are numbered."""
    if not is_number(store.campaign, key):
        return np.arange(len(values), dtype=np.float64)
    return np.asarray(column_of(store.campaign, key, values), dtype=np.float64)


def _verdict(one: Dependence, unit: str, median: float) -> str:
    """Return what is to be said of a dependence."""

    def amount(value: float) -> str:
        percent = 100.0 * value / abs(median) if median else 0.0
        share = f" ({percent:.{0 if percent >= 10.0 else 1}f} % of the median)" if median else ""
        return f"{short(value, 2)} {unit}".removesuffix(" 1") + share

    if math.isnan(one.interval):
        return "too few runs to tell"
    if one.dead:
        return f"dead: no change beyond chance; one of {amount(one.seen)} would have been seen"
    return f"slight: {amount(one.change)}" if one.change < SLIGHT * abs(median) else ""


def _part(store: Store, table: Table, name: str) -> MeasurePart:
    values = table[name]
    good = np.isfinite(values)
    unit = units_of(store.campaign, store.measures).get(name, "1")
    about = MEASURES.get(name)
    meaning = "a measure of your own" if about is None else about.meaning
    quantiles = tuple(np.quantile(values[good], _SHARES).tolist()) if good.any() else ()
    if not good.any() or np.ptp(values[good]) == 0.0:
        return MeasurePart(name, unit, meaning, int(good.sum()), quantiles, (), (), "")
    best = float(np.median(values[good])) if about is None else about.best
    away = np.where(good, np.abs(values - best), -1.0)
    order = np.argsort(-away, kind="stable")[: min(WORST, good.sum())]
    worst = tuple(
        (int(table["run"][row]), float(values[row]), _said(store, int(table["run"][row]))) for row in order
    )
    found = dependences(store, name)
    units = units_of(store.campaign, store.measures)
    told = tuple((one, _verdict(one, unit, float(np.median(values[good])))) for one in found)
    picture = picture_address(lambda to: draw_measure(to, name, unit, values[good], found, units))
    indices = ""
    if any(group.sample == "saltelli" for group in store.campaign.plan.vary):
        sensitivity = CampaignResult(store).sensitivity(name)
        if sensitivity["total_order"].notnull().any():
            indices = picture_address(lambda to: draw_sensitivity(to, sensitivity))
    return MeasurePart(name, unit, meaning, int(good.sum()), quantiles, told, worst, picture, indices)


def _said(store: Store, run: int) -> str:
    """Return the values of a run in words, numbers with four digits."""
    words = []
    for key, value in store.campaign.values(run).items():
        number, _, unit = (value if isinstance(value, str) else inline_yaml(value)).partition(" ")
        with contextlib.suppress(ValueError):
            number = f"{float(number):.4g}"
        words.append(f"{key} {number} {unit}".rstrip())
    return ", ".join(words)


def _numbered(campaign: Campaign) -> list[tuple[str, str]]:
    """Return each key whose values are words, with these as they are numbered in pictures."""
    found = []
    for number, group in enumerate(campaign.plan.vary):
        for key in (key for key in group.keys if not is_number(campaign, key)):
            values = [
                campaign.points(number).at(point)[key] for point in range(min(group.length, MOST_LEVELS))
            ]
            found.append((key, "; ".join(f"{n} {inline_yaml(value)}" for n, value in enumerate(values))))
    return found


def _faults(table: Table) -> list[tuple[int, str, int]]:
    """Return how many runs have each fault, the fault, and the first of them; the most frequent first."""
    if not table:
        return []
    bad = table["fault"] != ""
    faults, first, counts = np.unique(table["fault"][bad].astype(str), return_index=True, return_counts=True)
    runs = table["run"][bad]
    listed = sorted(zip(counts.tolist(), faults.tolist(), runs[first].tolist(), strict=True), reverse=True)
    return listed[:MOST_FAULTS]


def short(value: float, digits: int = 4) -> str:
    """Return a number with few digits; a dash where there is none."""
    return "–" if math.isnan(value) else f"{value:.{digits}g}"
