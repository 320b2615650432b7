"""From the rows of an approach's campaign to its tables: tries, errors by epoch, and by condition of the light."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta, chi2

from scanner_sim.campaign.approach.methods import METHODS, Method
from scanner_sim.campaign.approach.reading import PlannedApproach
from scanner_sim.pose.status import PoseStatus
from scanner_sim.products.approach import ApproachRow, ApproachStudy, ConditionRow, EpochRow
from scanner_sim.products.files.tables import Table, texts
from scanner_sim.products.pose_study import COMPONENTS
from scanner_sim.products.timeline import Label
from scanner_sim.validation.studies.conditions import Condition

Array = NDArray[np.float64]

COVERED_SIGMAS = 1.959964
"""Standard deviations within which 95 % of normal errors lie."""
NO_RESULT = -1
"""Status of a try whose run gave no pose at all: it failed, or ended before a round of visits."""


def study_of(name: str, planned: PlannedApproach, table: Table, epochs: Sequence[EpochRow]) -> ApproachStudy:
    """Return the tables of an approach.

    Parameters
    ----------
    name
        Of its file.
    planned
        The approach.
    table
        Rows of its campaign, one for each run, in order.
    epochs
        Its epochs with their light, in the order of its points.
    """
    tries = _tries(planned, table, epochs)
    chosen = [METHODS[name] for name in planned.approach.methods]
    faults = sorted({str(fault) for fault in table["fault"]} - {""})
    return ApproachStudy(
        name=name,
        methods={method.name: method.words for method in chosen},
        labels=tuple(Label(condition.words, condition.meaning) for condition in Condition),
        epochs=tuple(epochs),
        rows=tuple(row for method in chosen for row in _by_epoch(method, tries, epochs)),
        conditions=tuple(
            _by_condition(method, code, tries, epochs) for method in chosen for code in Condition
        ),
        tries=tries,
        faults=tuple(faults),
    )


def _tries(planned: PlannedApproach, table: Table, epochs: Sequence[EpochRow]) -> Table:
    """Return a row for each method and try, as columns with units in their names."""
    parts = []
    for name in planned.approach.methods:
        method = METHODS[name]
        axis = planned.rangings.index(method.ranging)
        own = {key: values[table["axis_1"] == axis] for key, values in table.items()}
        at = [epochs[point] for point in own["axis_0"].tolist()]
        status = own[f"{method.pose}_status"]
        part: Table = {
            "orbit": np.array([row.orbit for row in at], dtype=np.int64),
            "epoch": np.array([row.epoch for row in at], dtype=np.int64),
            "time_s": np.array([row.time_s for row in at]),
            "range_m": np.array([row.range_m for row in at]),
            "array": texts([row.array for row in at]),
            "condition": np.array([row.condition for row in at], dtype=np.int64),
            "method": texts([name] * len(at)),
            "try": own["repeat"],
            "run": own["run"],
            "seed": own["seed"],
            "status": np.where(np.isnan(status), NO_RESULT, status).astype(np.int64),
        }
        for component in COMPONENTS:
            unit = unit_of(component)
            part[f"{component}_error_{unit}"] = own[f"{method.pose}_{component}"]
            part[f"{component}_sigma_{unit}"] = own[f"{method.pose}_{component}_sigma"]
        parts.append(part)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def unit_of(component: str) -> str:
    """Return the unit of a component of a pose."""
    return "m" if component.startswith("t_") else "rad"


def errors_of(tries: Table, chosen: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return errors and stated σ of the valid ones among chosen tries, each of shape (n, 6)."""
    good = chosen & (tries["status"] == PoseStatus.VALID)
    error, sigma = (
        np.stack([tries[f"{one}_{kind}_{unit_of(one)}"][good] for one in COMPONENTS], axis=1)
        for kind in ("error", "sigma")
    )
    return error, sigma


def share_interval(count: int, total: int) -> tuple[float, float, float]:
    """Return a share and its 95 % interval (Clopper and Pearson, Biometrika 26 (1934) 404); NaN of nothing."""
    if not total:
        return math.nan, math.nan, math.nan
    low = float(beta.ppf(0.025, count, total - count + 1)) if count else 0.0
    high = float(beta.ppf(0.975, count + 1, total - count)) if count < total else 1.0
    return count / total, low, high


def rms_interval(values: Array) -> tuple[float, float, float]:
    """Return a root mean square and its 95 % interval by χ² with as many degrees of freedom as there are values."""
    if not len(values):
        return math.nan, math.nan, math.nan
    size, freedom = _rms(values), len(values)
    low, high = (size * math.sqrt(freedom / float(chi2.ppf(share, freedom))) for share in (0.975, 0.025))
    return size, low, high


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else math.nan


def _by_epoch(method: Method, tries: Table, epochs: Sequence[EpochRow]) -> Iterator[ApproachRow]:
    for row in epochs:
        own = (tries["method"] == method.name) & (tries["orbit"] == row.orbit) & (tries["epoch"] == row.epoch)
        error, sigma = errors_of(tries, own)
        total, valid = int(own.sum()), len(error)
        for axis, component in enumerate(COMPONENTS):
            e, s = error[:, axis], sigma[:, axis]
            yield ApproachRow(
                row.orbit,
                row.epoch,
                row.time_s,
                row.range_m,
                row.condition_name,
                method.name,
                component,
                unit_of(component),
                total,
                valid,
                *share_interval(valid, total),
                *rms_interval(e),
                _rms(s),
                float(np.mean(e)) if valid else math.nan,
                _rms(e / s),
                float(np.mean(np.abs(e) <= COVERED_SIGMAS * s)) if valid else math.nan,
            )


def _by_condition(
    method: Method, condition: Condition, tries: Table, epochs: Sequence[EpochRow]
) -> ConditionRow:
    own = (tries["method"] == method.name) & (tries["condition"] == condition)
    error, sigma = errors_of(tries, own)
    total, valid = int(own.sum()), len(error)
    place, place_sigma, turn, turn_sigma = (
        _rms(np.linalg.norm(values[:, part], axis=1))
        for part in (slice(0, 3), slice(3, 6))
        for values in (error, sigma)
    )
    return ConditionRow(
        method.name,
        int(condition),
        condition.words,
        sum(row.condition == condition for row in epochs),
        total,
        valid,
        *share_interval(valid, total),
        place,
        place_sigma,
        turn,
        turn_sigma,
        float(np.mean(np.abs(error) <= COVERED_SIGMAS * sigma)) if valid else math.nan,
    )
