"""The error budget as a product: rows, tables and the folder they are written to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scanner_sim.products.json_text import json_text
from scanner_sim.products.provenance import versions

Mode = Literal["triangulation", "tof", "fused"]
"""Ways of ranging."""


@dataclass(frozen=True)
class BudgetRow:
    """The range error that one source makes at one distance; NaN where it is not known.

    Attributes
    ----------
    mode
        Way of ranging.
    source
        Name of the source, or ``all``.
    range_m
        Distance of the facing target [m].
    analytic_m
        Standard deviation by closed forms [m].
    simulated_m, low_m, high_m
        Standard deviation of simulated ranges, and its 95 % interval (χ²; of sun and stray by the normal law) [m].
    freedom
        Degrees of freedom of it.
    """

    mode: Mode
    source: str
    range_m: float
    analytic_m: float
    simulated_m: float
    low_m: float
    high_m: float
    freedom: int


@dataclass(frozen=True, eq=False)
class Dominance:
    """Parts of the stated variance of the range over an image.

    Attributes
    ----------
    sources
        Their names.
    variances
        Shape (sources, rows, columns) [m²]; NaN where there is no range.
    theta, phi
        Deflections of the columns and of the rows [rad].
    mode
        Way of ranging.
    """

    sources: tuple[str, ...]
    variances: NDArray[np.float64]
    theta: NDArray[np.float64]
    phi: NDArray[np.float64]
    mode: Mode

    @property
    def largest(self) -> NDArray[np.intp]:
        """Number of the source with the largest part, shape (rows, columns); −1 where there is no range."""
        known = np.isfinite(self.variances).all(axis=0)
        return np.where(known, np.nan_to_num(self.variances).argmax(axis=0), -1)

    def shares(self) -> dict[str, float]:
        """Return for each source the share of the measured voxels in which its part is the largest."""
        measured = self.largest[self.largest >= 0]
        count = max(measured.size, 1)
        return {name: float(np.sum(measured == number) / count) for number, name in enumerate(self.sources)}


def crossing(rows: Sequence[BudgetRow], column: Literal["analytic_m", "simulated_m"]) -> float:
    """Return the range [m] from which time of flight is the more precise, by interpolation in logarithms.

    NaN where the budget has only one way of ranging, or where the curves do not cross.
    """
    curves = [
        {row.range_m: getattr(row, column) for row in rows if row.mode == mode and row.source == "all"}
        for mode in ("triangulation", "tof")
    ]
    known = [x for x in curves[0] if x in curves[1] and curves[0][x] > 0.0 and curves[1][x] > 0.0]
    x = np.log(np.array(sorted(known)))
    ratio = np.array([math.log(curves[0][position] / curves[1][position]) for position in sorted(known)])
    after = np.flatnonzero((ratio[1:] >= 0.0) & (ratio[:-1] < 0.0)) if len(known) > 1 else np.array([], int)
    if not after.size:
        return math.nan
    i = int(after[0])
    return float(np.exp(x[i] - ratio[i] * (x[i + 1] - x[i]) / (ratio[i + 1] - ratio[i])))


def budget_json(
    rows: Sequence[BudgetRow],
    reflectance: float,
    dominance: Dominance | None,
    sweep: float = math.nan,
    at_rest: float = math.nan,
) -> str:
    """Return the budget as JSON, with the reflectance of the target and the shares of an image; null for NaN.

    Shares are those of the one way of ranging that ``mode_of_voxels_dominated`` names.

    ``crossing`` is the range from which time of flight is the more precise, where there is one; ``at_rest_m`` the same
    by the closed forms without the sweep of ``sweep_rad``, which averages speckle.
    """
    names: tuple[Literal["analytic_m", "simulated_m"], ...] = ("analytic_m", "simulated_m")
    crossings: dict[str, float] = {name: crossing(rows, name) for name in names}
    result = {
        "crossing": crossings | {"at_rest_m": at_rest},
        "sweep_rad": sweep,
        "reflectance": reflectance,
        "rows": [asdict(row) for row in rows],
        "share_of_voxels_dominated": None if dominance is None else dominance.shares(),
        "mode_of_voxels_dominated": None if dominance is None else dominance.mode,
        "versions": dict(versions()),
    }
    return json_text(result)
