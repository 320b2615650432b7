"""What a tracking run says of each visit to a target, and the run as a whole."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.html_text import html_box, html_rows
from scanner_sim.ranging.axes import Axes
from scanner_sim.tracking.errors import ErrorParts
from scanner_sim.tracking.measurement import TargetAppearance
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.state import Refusal, TrackMode

Array = NDArray[np.float64]

WIDEST = 10.0
"""Largest angle at which a target may be looked for [rad]: mirrors reach none beyond."""
NEAREST, FARTHEST = 1e-6, 1e6
"""Ends of the ranges at which it may [m]."""


class TrackStatus(IntEnum):
    """Outcome of one visit to a target. The codes are stable: new ones are added at the end."""

    MEASURED = 0
    NOT_FOUND = 1
    REFUSED = 2
    OUT_OF_VIEW = 3
    LIMITED = 4

    @property
    def sentence(self) -> str:
        """What the code says, in words."""
        return _SENTENCES[self]


_SENTENCES = {
    TrackStatus.MEASURED: "the target was measured, and the tracker took the place",
    TrackStatus.NOT_FOUND: "the pattern shows no target",
    TrackStatus.REFUSED: "something was seen whose size, shape or place is not the target's",
    TrackStatus.OUT_OF_VIEW: "the pattern would leave the field of view, and was not run",
    TrackStatus.LIMITED: "nothing was found, and the mirrors were at their limits during the pattern",
}


def is_place(position: Array) -> bool:
    """Tell whether a target may be looked for at (Θ, φ, R), shape (3,): what a saved run may hold, too."""
    return bool((np.abs(position[:2]) <= WIDEST).all() and NEAREST <= position[2] <= FARTHEST)


@dataclass(frozen=True)
class TrackTarget:
    """A target of a run.

    Attributes
    ----------
    name
        ``node/1`` for the first member of the array ``node``, row by row from the top left; else the object's name.
    object
        Name of the object that carries it.
    appearance
        What the tracker knows of it.
    expected
        (Θ, φ, R) where it is looked for first, shape (3,) [rad, rad, m].
    centre
        Its centre in the object's frame, shape (3,) [m]: truth, which the tracker does not see.
    """

    name: str
    object: str
    appearance: TargetAppearance
    expected: Array
    centre: Array


@dataclass(frozen=True)
class PatternRecord:
    """One visit to one target.

    Attributes
    ----------
    number
        Number of the visit in the run, from 0.
    target
        Name of the target.
    time
        Of the measured position [s]; the middle of the pattern where nothing was found.
    mode, after
        In which mode the pattern was run, and the mode after it.
    refusal
        Why the measurement was not taken.
    status
        :class:`TrackStatus`; 0 where the target was measured.
    amplitude
        Amplitude of the pattern along Θ [rad], without the sign of an inversion.
    centre
        Commanded centre (Θ, φ), shape (2,) [rad].
    position, covariance
        Measured (Θ, φ, R), shape (3,), and its covariance (3, 3) [rad, m]; NaN where none was found. A refused position
        stays here, so that what was refused can be seen.
    errors
        What the covariance is made of, and what other visits and targets have of it; all NaN where none was found.
    point, point_covariance
        The same as x, y, z [m] in the scanner frame.
    truth
        True (Θ, φ, R) of the target's centre at ``time``, shape (3,).
    truth_point
        True x, y, z [m], shape (3,).
    samples
        Voxels of the pattern, arrays (1, points); (1, 0) where no pattern was run.
    available
        When the measurement is there [s]: at the end of the pattern and after ``scanner.latency``. It is valid at
        ``time``.
    """

    number: int
    target: str
    time: float
    mode: TrackMode
    after: TrackMode
    refusal: Refusal
    status: TrackStatus
    amplitude: float
    centre: Array
    position: Array
    covariance: Array
    errors: ErrorParts
    point: Array
    point_covariance: Array
    truth: Array
    truth_point: Array
    samples: PatternSamples
    available: float = math.nan


@dataclass(frozen=True)
class Track:
    """A tracking run, finished or interrupted.

    Attributes
    ----------
    records
        Visits in the order of time.
    targets
        The targets, in the order in which they are visited.
    seed
        Seed of every random number.
    scenario_yaml
        The resolved scenario.
    made_by
        Name and version of the program.
    axes
        Axes of the mirrors as the instrument believes them, by which voxels of patterns are placed.
    warnings
        Sentences on results that look unintended.
    """

    records: tuple[PatternRecord, ...]
    targets: tuple[TrackTarget, ...]
    seed: int
    scenario_yaml: str
    made_by: str
    axes: Axes
    warnings: tuple[str, ...] = ()

    def of(self, target: str) -> tuple[PatternRecord, ...]:
        """Return the visits to a target."""
        return tuple(record for record in self.records if record.target == target)

    def _repr_html_(self) -> str:
        """Return what a notebook shows: each target, how often it was measured, and how precisely."""
        rows = []
        for target in self.targets:
            own = self.of(target.name)
            measured = [one for one in own if one.status is TrackStatus.MEASURED]
            sigmas = [one.covariance[2, 2] for one in measured]
            sigma = f"{1e3 * float(np.sqrt(np.median(sigmas))):.3g} mm" if sigmas else "none"
            last = own[-1].after.value if own else "never visited"
            rows.append((target.name, len(own), len(measured), sigma, last))
        duration = max((record.time for record in self.records), default=0.0)
        return html_box(
            f"Track of {len(self.records)} visits in {duration:.4g} s, seed {self.seed}",
            html_rows(rows, ("target", "visits", "measured", "median σ of R", "state at the end")),
            html_rows([("warning", text) for text in self.warnings]) if self.warnings else "",
        )
