"""An approach as a product: its epochs and their light, its tries, and what these tell of each method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

from scanner_sim.products.files.tables import Table
from scanner_sim.products.json_text import json_text
from scanner_sim.products.provenance import versions
from scanner_sim.products.timeline import Label


@dataclass(frozen=True)
class EpochRow:
    """A moment of the path, and its light.

    Attributes
    ----------
    orbit
        Number of the light under which the path is flown.
    epoch, time_s
        Number on the path, and time since its start [s].
    range_m
        Of the object's origin from the scanner's [m].
    array
        The targets that are followed.
    condition, condition_name
        Condition of Table 1: its number and name; -1 where the scanner does not see the array.
    sunlit_share
        Share of what it sees of the array that the Sun reaches.
    sun_visible_share
        Share of the Sun's disc that the Earth does not hide.
    background_electron
        Mean charge of sunlight from the array in a pixel and dwell [electron].
    """

    orbit: int
    epoch: int
    time_s: float
    range_m: float
    array: str
    condition: int
    condition_name: str
    sunlit_share: float
    sun_visible_share: float
    background_electron: float


@dataclass(frozen=True)
class ApproachRow:
    """One component of the pose by one method at one epoch; NaN where no try gave a pose.

    Attributes
    ----------
    orbit, epoch, time_s, range_m, condition_name
        As in :class:`EpochRow`.
    method, component, unit
        How, which shift or turn along the scanner's axes, and m or rad.
    tries, valid
        Number of tries, and of those whose last pose is valid.
    availability, availability_low, availability_high
        Share of valid ones, with its 95 % interval (Clopper and Pearson).
    error, error_low, error_high
        Root mean square of the errors of the valid ones, with its 95 % interval by χ².
    sigma
        Root mean square of their stated σ.
    bias
        Mean error.
    z
        Root mean square of error over σ; 1 where σ is right.
    covered
        Share within 1.96 σ; 0.95 where σ is right.
    """

    orbit: int
    epoch: int
    time_s: float
    range_m: float
    condition_name: str
    method: str
    component: str
    unit: str
    tries: int
    valid: int
    availability: float
    availability_low: float
    availability_high: float
    error: float
    error_low: float
    error_high: float
    sigma: float
    bias: float
    z: float
    covered: float


@dataclass(frozen=True)
class ConditionRow:
    """What a method gave in one condition of Table 1; NaN where there was no try or no pose.

    Attributes
    ----------
    method, condition, condition_name
        Which.
    epochs, tries, valid
        Moments of the paths in this condition, tries at them, and those that are valid.
    availability, availability_low, availability_high
        As in :class:`ApproachRow`.
    position_m, position_sigma_m, attitude_rad, attitude_sigma_rad
        Root mean squares of the distance from the true place and of the angle from the true attitude, and of what the
        stated covariances say of both.
    covered
        Share of all components within 1.96 σ.
    """

    method: str
    condition: int
    condition_name: str
    epochs: int
    tries: int
    valid: int
    availability: float
    availability_low: float
    availability_high: float
    position_m: float
    position_sigma_m: float
    attitude_rad: float
    attitude_sigma_rad: float
    covered: float


@dataclass(frozen=True, eq=False)
class ApproachStudy:
    """An approach that is done.

    Attributes
    ----------
    name
        Of its file.
    methods
        Their names, each with its words.
    labels
        The conditions of Table 1, by number.
    epochs, rows, conditions
        The tables.
    tries
        A row for each try and method, as columns: epoch, light, seed, status, errors and σ.
    faults
        What made runs fail, each once.
    warnings
        Sentences for the user.
    made_by
        Versions of the programs that made it.
    """

    name: str
    methods: Mapping[str, str]
    labels: tuple[Label, ...]
    epochs: tuple[EpochRow, ...]
    rows: tuple[ApproachRow, ...]
    conditions: tuple[ConditionRow, ...]
    tries: Table
    faults: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    made_by: Mapping[str, str] = field(default_factory=versions)

    @property
    def orbits(self) -> int:
        """Number of lights under which the path is flown."""
        return 1 + max(row.orbit for row in self.epochs)


def approach_json(study: ApproachStudy) -> str:
    """Return an approach as JSON, without its single tries."""
    return json_text(
        {
            "name": study.name,
            "methods": dict(study.methods),
            "conditions": [asdict(label) for label in study.labels],
            "epochs": [asdict(row) for row in study.epochs],
            "by_condition": [asdict(row) for row in study.conditions],
            "by_epoch": [asdict(row) for row in study.rows],
            "faults": list(study.faults),
            "warnings": list(study.warnings),
            "versions": dict(study.made_by),
        }
    )
