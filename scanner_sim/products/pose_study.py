"""The pose study as a product: its rows, tables and the folder they are written to."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

from scanner_sim.products.json_text import json_text
from scanner_sim.products.provenance import versions

COMPONENTS = ("t_x", "t_y", "t_z", "omega_x", "omega_y", "omega_z")
"""Components of a pose: shifts [m] and turns [rad] along the scanner's axes."""

Method = Literal["uv", "xyz", "joint"]
Source = Literal["none", "triangulation", "tof"]


@dataclass(frozen=True)
class TargetRow:
    """What the instrument errs about single targets at one range; NaN where nothing was found.

    Attributes
    ----------
    range_m
        Distance of the targets [m].
    quantity, unit
        ``theta``, ``phi``, ``range_triangulation`` or ``range_tof``; rad or m.
    scatter, stated
        Root mean squares of the errors and of the stated standard deviations.
    common
        Root mean square of the part that all targets share which the spot finds at one position of its pixel.
    voxel
        Median of the stated standard deviation of a single voxel.
    found
        Share of the patterns in which it was found.
    observations
        Patterns.
    """

    range_m: float
    quantity: str
    unit: str
    scatter: float
    stated: float
    common: float
    voxel: float
    found: float
    observations: int


@dataclass(frozen=True)
class PoseRow:
    """The error of one component of the pose of a facing array, by one method, at one range.

    Attributes
    ----------
    array, targets, size_m
        Layout, number of its targets, side of the square it fits into [m].
    range_m
        Of the array's origin [m].
    method, ranging
        ``uv``, ``xyz`` (points that count alike, eq 11) or ``joint``; ``triangulation``, ``tof`` or, for ``uv``,
        ``none``.
    component, unit
        One of :data:`COMPONENTS`; m or rad.
    simulated, low, high
        Root mean square of the errors of poses from simulated observations, and its 95 % interval (χ²).
    stated
        Root mean square of the standard deviation that the estimator stated.
    bias
        Mean error.
    analytic
        Closed form, with the scatter of single targets at this range, its common part apart.
    constant
        Closed form, with the scatter of single targets at one range carried to all: angles and times of flight as they
        are, triangulation as R².
    voxel
        Closed form, with ranges as a single voxel measures them and not a pattern's mean.
    ambiguous, poses
        Share of the poses with a second one that fits nearly as well, and their number.
    """

    array: str
    targets: int
    size_m: float
    range_m: float
    method: Method
    ranging: Source
    component: str
    unit: str
    simulated: float
    low: float
    high: float
    stated: float
    bias: float
    analytic: float
    constant: float
    voxel: float
    ambiguous: float
    poses: int

    @property
    def mode(self) -> tuple[str, str]:
        """Method and ranging."""
        return self.method, self.ranging


@dataclass(frozen=True)
class Exponent:
    """How an error grows: the exponent of range, size or number of targets, over rows alike in all else.

    Attributes
    ----------
    of
        ``range``, ``size`` or ``targets``.
    array, size_m, range_m
        What was kept; empty or NaN for what was not.
    method, ranging, component
        As in :class:`PoseRow`.
    simulated, standard_error
        Exponent of the simulated errors, and its standard error, widened where a power is not their law.
    analytic, constant
        Exponents of the closed forms.
    printed
        What the paper reads from Figure 15, or NaN.
    """

    of: str
    array: str
    size_m: float
    range_m: float
    method: str
    ranging: str
    component: str
    simulated: float
    standard_error: float
    analytic: float
    constant: float
    printed: float


@dataclass(frozen=True)
class Gain:
    """By how much a method is better than points alone: the error of ``xyz`` over that of ``method``.

    ``standard_error`` is that of ``simulated``; ``analytic`` and ``voxel`` are of the closed forms, the second with
    ranges as a single voxel measures them; ``printed`` is the paper's "10X", of no named range or component.
    """

    range_m: float
    ranging: str
    method: str
    component: str
    simulated: float
    standard_error: float
    analytic: float
    voxel: float
    printed: float = 10.0


@dataclass(frozen=True)
class PoseStudy:
    """All tables of a study; ``base`` is the array of Figure 15."""

    base: str
    base_size: float
    targets: tuple[TargetRow, ...]
    rows: tuple[PoseRow, ...]
    exponents: tuple[Exponent, ...]
    gains: tuple[Gain, ...]


def study_json(study: PoseStudy) -> str:
    """Return a study as JSON; null for NaN."""
    names = ("targets", "rows", "exponents", "gains")
    tables = {name: [asdict(row) for row in getattr(study, name)] for name in names}
    result = {"base": study.base, "base_size_m": study.base_size, **tables, "versions": dict(versions())}
    return json_text(result, indent=1)
