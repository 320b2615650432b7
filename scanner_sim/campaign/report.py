"""A campaign as one page for a browser: everything is in the file, pictures too."""

from __future__ import annotations

import base64
import contextlib
import io
import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from numpy.typing import NDArray

from scanner_sim.campaign.dependence import MOST_LEVELS, Dependence, by_bin, by_level
from scanner_sim.campaign.measures import MEASURES
from scanner_sim.campaign.report_pictures import draw_measure
from scanner_sim.campaign.result import CampaignResult
from scanner_sim.campaign.store import MANIFEST, Store, column_of, is_number, units_of
from scanner_sim.config.document import Value
from scanner_sim.foundation.errors import printable
from scanner_sim.products.files.tables import Table

Array = NDArray[np.float64]

WORST = 5
"""Runs of a measure that are named as the worst."""
MOST_FAULTS = 20
"""Kinds of faults that are listed."""
_SHARES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)


@dataclass(frozen=True)
class MeasurePart:
    """What the page says of a measure: quantiles, what each key does to it, and its worst runs with their values."""

    name: str
    unit: str
    meaning: str
    runs: int
    quantiles: tuple[float, ...]
    dependences: tuple[Dependence, ...]
    worst: tuple[tuple[int, float, str], ...]
    picture: str

    @property
    def dead(self) -> tuple[Dependence, ...]:
        """Keys that change it by less than chance does."""
        return tuple(one for one in self.dependences if one.dead)


def report_page(store: Store) -> str:
    """Return the page of a campaign, finished or not."""
    table = CampaignResult(store).table()
    parts = [_part(store, table, name) for name in store.measures] if table else []
    manifest = json.loads((store.folder / MANIFEST).read_text(encoding="utf-8"))
    pages = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=lambda value: value if hasattr(value, "__html__") else printable(str(value), lines=True),
    )
    pages.filters["short"] = short
    return pages.get_template("report_page.html").render(
        folder=str(store.folder),
        runs=len(store.done),
        done=int(store.done.sum()),
        failed=store.failed,
        parts=[part for part in parts if part.runs],
        empty=[part for part in parts if not part.runs],
        faults=_faults(table),
        versions=manifest["versions"],
        plan=json.dumps(manifest["plan"], indent=2, ensure_ascii=False),
        seconds=float(np.sum(table["seconds"])) if table else 0.0,
    )


def dependences(store: Store, table: Table, measure: str) -> tuple[Dependence, ...]:
    """Return what each key does to a measure."""
    campaign = store.campaign
    values = np.full(len(campaign), np.nan)
    values[table["run"]] = table[measure]
    values = values.reshape(campaign.plan.shape)
    found = []
    for axis, group in enumerate(campaign.plan.vary):
        along = np.moveaxis(values, axis, 0).reshape(group.length, -1)
        points = [campaign.points(axis).at(point) for point in range(group.length)]
        numbers = {key: _numbers(store, key, [point[key] for point in points]) for key in group.keys}
        for key, at in numbers.items():
            if len(numbers) == 1 and not group.drawn and group.length <= MOST_LEVELS:
                found.append(by_level(key, measure, at, along))
                continue
            others = [one for name, one in numbers.items() if name != key]
            beside = np.stack(others, axis=1) if others else np.zeros((len(at), 0))
            found.append(by_bin(key, measure, at, _row_means(along), beside))
    return tuple(found)


def _numbers(store: Store, key: str, values: list[Value]) -> Array:
    """Return values of a key as numbers; words are numbered."""
    if not is_number(store.campaign, key):
        return np.arange(len(values), dtype=np.float64)
    return np.asarray(column_of(store.campaign, key, values), dtype=np.float64)


def _row_means(values: Array) -> Array:
    """Return the mean of the finite numbers of each row; NaN where there are none."""
    finite = np.isfinite(values)
    count = finite.sum(axis=1)
    total = np.where(finite, values, 0.0).sum(axis=1)
    means: Array = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return means


def _part(store: Store, table: Table, name: str) -> MeasurePart:
    values = table[name]
    good = np.isfinite(values)
    unit = units_of(store.campaign, store.measures).get(name, "1")
    about = MEASURES.get(name)
    meaning = "a measure of your own" if about is None else about.meaning
    if not good.any():
        return MeasurePart(name, unit, meaning, 0, (), (), (), "")
    best = float(np.median(values[good])) if about is None else about.best
    order = np.argsort(-np.abs(np.where(good, values - best, 0.0)), kind="stable")[: min(WORST, good.sum())]
    worst = tuple(
        (int(table["run"][row]), float(values[row]), _said(store, int(table["run"][row]))) for row in order
    )
    found = dependences(store, table, name)
    stream = io.BytesIO()
    draw_measure(stream, name, unit, values[good], found, units_of(store.campaign, store.measures))
    picture = "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode("ascii")
    quantiles = tuple(np.quantile(values[good], _SHARES).tolist())
    return MeasurePart(name, unit, meaning, int(good.sum()), quantiles, found, worst, picture)


def _said(store: Store, run: int) -> str:
    """Return the values of a run in words, numbers with four digits."""
    words = []
    for key, value in store.campaign.values(run).items():
        number, _, unit = str(value).partition(" ")
        with contextlib.suppress(ValueError):
            number = f"{float(number):.4g}"
        words.append(f"{key} {number} {unit}".rstrip())
    return ", ".join(words)


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
