"""What a detector made of some voxels, and the light that it was made of: named columns, a row for each voxel.

The light stands before speckle and noise. From it and a seed both can be drawn again, without the scene.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.channels import CHANNEL
from scanner_sim.foundation.status import Status
from scanner_sim.products.layers import closed, flags, legends

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]

Form = Literal["one", "samples", "vector", "clusters"]
"""What a row of a column holds: a number, one for each sample or pixel, three, or one for each cluster of light."""

NUMBERS = ("u2", "i2", "i4")
"""Types of whole digital numbers, the smallest that holds all is taken."""

CLUSTERS = "clusters"
"""The column that tells how many clusters the light of each voxel has."""


class SignalColumn(NamedTuple):
    """A column: its ``name``, ``unit``, ``meaning`` and ``form``, and its NumPy type; ``number`` is any that holds it.

    ``wanted`` is False for what some sets do not have.
    """

    name: str
    unit: str
    meaning: str
    form: Form = "one"
    kind: str = "f4"
    wanted: bool = True


def of_channel(name: str, kind: str = "f4") -> SignalColumn:
    """Return the column that an image has as a layer."""
    return SignalColumn(name, CHANNEL[name].unit, CHANNEL[name].meaning, "one", kind)


WHERE = (
    SignalColumn("row", "1", "row in the raster, counted from 0", "one", "i4"),
    SignalColumn("column", "1", "column in the raster, counted from 0", "one", "i4"),
    SignalColumn(
        "theta_rad", "rad", "commanded deflection to the right in the middle of the dwell", "one", "f8"
    ),
    SignalColumn("phi_rad", "rad", "commanded deflection downwards", "one", "f8"),
)
"""Columns that every set begins with."""

READ = (
    SignalColumn(
        "theta_read_rad", "rad", "what the encoder of Θ reads, by which ranges are made", "one", "f8"
    ),
    SignalColumn("phi_read_rad", "rad", "what the encoder of φ reads", "one", "f8"),
)
"""Columns of the encoders, which every set has."""

SURFACE = (
    of_channel("truth.range_m"),
    of_channel("truth.object", "i4"),
    of_channel("truth.material", "i4"),
    SignalColumn(
        "surface_number", "1", "the renderer's number of the object, by which speckle is drawn", "one", "i4"
    ),
    SignalColumn(
        "surface_point_m", "m", "where the beam's axis meets the object, in its own frame", "vector"
    ),
    SignalColumn("beam_along", "1", "direction of the beam there, in the frame of the object", "vector"),
    SignalColumn("beam_across", "1", "direction in which Θ grows, likewise", "vector"),
    SignalColumn("beam_normal", "1", "direction across both, likewise", "vector"),
    SignalColumn("beam_radius_m", "m", "1/e² radius of the beam there"),
    SignalColumn(
        "beam_distance_m", "m", "way of the beam to there; its Rayleigh length where it meets nothing"
    ),
)
"""What a beam meets: by it speckle is drawn, which belongs to the surface."""


@dataclass(frozen=True)
class SignalAbout:
    """What is said of a set.

    Attributes
    ----------
    form
        Name and version of the columns.
    scenario
        The resolved scenario, as YAML.
    objects, materials
        Names behind the numbers of ``truth.object`` and ``truth.material``; number 1 is the first name.
    numbers
        What the digital numbers mean.
    made_by
        Versions of the programs that made it.
    """

    form: str
    scenario: str
    objects: tuple[str, ...]
    materials: tuple[str, ...]
    numbers: Mapping[str, float]
    made_by: Mapping[str, str]


@dataclass(frozen=True, eq=False, repr=False)
class SignalSet(ABC, Mapping[str, NDArray[Any]]):
    """Columns of n voxels by name, ``lines["number"]``: the first axis is the voxel, and nothing can be written to.

    Columns of clusters are one voxel after the other; column ``clusters`` tells how many each has.

    Parameters
    ----------
    columns
        The columns.
    about
        What is said of them.

    Raises
    ------
    ValueError
        If columns are missing or contradict one another.
    """

    columns: Mapping[str, NDArray[Any]]
    about: SignalAbout

    FORM: ClassVar[str]
    COLUMNS: ClassVar[tuple[SignalColumn, ...]]
    SAMPLE: ClassVar[str]

    def __post_init__(self) -> None:
        """Check the columns, put them in order and close them to writing."""
        checked = checked_columns(self.COLUMNS, self.columns)
        object.__setattr__(self, "columns", {name: closed(values) for name, values in checked.items()})

    @property
    def samples(self) -> int:
        """Samples of each record, or pixels of each line."""
        return int(self.columns["number"].shape[1])

    @property
    def row(self) -> NDArray[np.int32]:
        """Row of each voxel in the raster, shape (n,)."""
        return self["row"]

    @property
    def column(self) -> NDArray[np.int32]:
        """Column of each voxel in the raster, shape (n,)."""
        return self["column"]

    @property
    def number(self) -> NDArray[Any]:
        """Digital numbers, shape (n, samples)."""
        return self["number"]

    @property
    def status(self) -> NDArray[np.int32]:
        """Codes of :class:`~scanner_sim.foundation.status.Status`, shape (n,): the estimator's, without neighbours."""
        return self["status"]

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Where something was found, shape (n,)."""
        return np.equal(self.status, Status.VALID)

    @cached_property
    def first_cluster(self) -> NDArray[np.int64]:
        """Index of each voxel's first cluster in the columns of clusters, and their number: shape (n + 1,)."""
        return np.concatenate([[0], np.cumsum(self[CLUSTERS], dtype=np.int64)])

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column.

        Raises
        ------
        KeyError
            If there is none of that name; the message names those that there are.
        """
        if name not in self.columns:
            raise KeyError(f"no column {name!r} here; there are {', '.join(self.columns)}")
        return self.columns[name]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the columns."""
        return iter(self.columns)

    def __len__(self) -> int:
        """Return the number of columns; that of voxels is ``len(lines.row)``."""
        return len(self.columns)

    def __repr__(self) -> str:
        """Return a line that says what the set holds."""
        found = 100.0 * self.valid.mean() if len(self.row) else 0.0
        return f"{self.about.form}: {len(self.row):,} voxels of {self.samples} {self.SAMPLE}s, {found:.4g} % valid"

    def __reduce__(self) -> tuple[Any, ...]:
        """Say how to make the set again in another process."""
        return partial(type(self), dict(self.columns), self.about), ()

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Return the voxels of all parts as one set."""
        names = parts[0].columns
        return cls({name: np.concatenate([part[name] for part in parts]) for name in names}, parts[0].about)

    def to_xarray(self) -> xarray.Dataset:
        """Return all columns as an xarray dataset with units and meanings, and the names of codes.

        Clusters are a contiguous ragged array (CF conventions, sec. 9.3.3), which ``clusters`` counts.
        """
        import xarray

        sizes = {"one": (), "samples": (self.SAMPLE,), "vector": ("axis",)}
        about = {column.name: column for column in self.COLUMNS}
        names = legends(self.columns, self.about.objects, self.about.materials)
        variables = {}
        for name, values in self.columns.items():
            column = about[name]
            dims = ("cluster",) if column.form == "clusters" else ("voxel", *sizes[column.form])
            said: dict[str, object] = {"units": column.unit, "long_name": column.meaning}
            if name == CLUSTERS:
                said["sample_dimension"] = "cluster"
            if name in names:
                said |= flags(names[name])
            variables[name] = (dims, values, said)
        attributes = {"title": self.about.form, "scenario": self.about.scenario, **self.about.numbers}
        return xarray.Dataset(variables, attrs=attributes).assign_coords(self._coordinates())

    def _coordinates(self) -> dict[str, Any]:
        """Return the coordinates of the samples for xarray."""
        return {}


def checked_columns(
    columns: Iterable[SignalColumn], found: Mapping[str, NDArray[Any]]
) -> dict[str, NDArray[Any]]:
    """Return columns in their order, of voxels that ``row`` counts.

    Raises
    ------
    ValueError
        If one is missing, or has another type or shape than the others ask for.
    """
    ordered, rows, samples = {}, len(found["row"]), None
    for column in columns:
        if (values := found.get(column.name)) is None:
            if column.wanted:
                raise ValueError(f"the column {column.name} is missing")
            continue
        if column.form == "samples" and samples is None and values.ndim == 2:
            samples = values.shape[1]
        every = int(found[CLUSTERS].sum()) if column.form == "clusters" else rows
        shape = {"vector": (rows, 3), "samples": (rows, samples)}.get(column.form, (every,))
        kinds = (*NUMBERS, "f4") if column.kind == "number" else (column.kind,)
        if values.shape != shape or values.dtype not in [np.dtype(kind) for kind in kinds]:
            raise ValueError(
                f"the column {column.name} has the type {values.dtype} and the shape {values.shape}"
            )
        ordered[column.name] = values
    if "status" in ordered and not np.isin(ordered["status"], list(Status)).all():
        raise ValueError("the column status has codes that there are not")
    return ordered


def number_kind(whole: bool, least: int, largest: int) -> str:
    """Return the NumPy type of digital numbers between two ends; what is not rounded or has no ends is a float."""
    fits = (kind for kind in NUMBERS if np.iinfo(kind).min <= least and largest <= np.iinfo(kind).max)
    return next(fits, "f4") if whole else "f4"
