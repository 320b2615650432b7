"""Records of visits: what was measured beside what was true."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.arithmetic import applied, product
from scanner_sim.ranging.coordinates import angles_and_range, coordinates
from scanner_sim.tracking.errors import ErrorParts
from scanner_sim.tracking.measurement import Measurement
from scanner_sim.tracking.record import PatternRecord, TrackStatus, TrackTarget
from scanner_sim.tracking.samples import PatternSamples
from scanner_sim.tracking.state import Refusal, TrackCommand, TrackState

Array = NDArray[np.float64]

_UNKNOWN, _EMPTY = np.full(1, np.nan), np.zeros((1, 0))
NOTHING = Measurement(
    time=_UNKNOWN,
    position=np.full((1, 3), np.nan),
    covariance=np.full((1, 3, 3), np.nan),
    radius=_UNKNOWN,
    sigma_radius=_UNKNOWN,
    misfit=_UNKNOWN,
    fraction=np.zeros(1),
    found=np.zeros(1, dtype=np.bool_),
)
"""What a pattern that was not run sees."""
_NO_SAMPLES = PatternSamples(
    time=_EMPTY,
    theta=_EMPTY,
    phi=_EMPTY,
    signal=_EMPTY,
    sigma_signal=_EMPTY,
    range=_EMPTY,
    sigma_range=_EMPTY,
    status=np.zeros((1, 0), dtype=np.uint8),
)
"""Its voxels."""


class Recorder:
    """Makes the records of a run: the only place where truth and measurement meet.

    Parameters
    ----------
    scenario
        Scene and mirrors.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._separation = scenario.scanner.mirrors.axis_separation
        self._late = 0.5 * scenario.scanner.dwell + scenario.scanner.latency.whole
        self.follow(scenario)

    def follow(self, scenario: Scenario) -> None:
        """Go on with a scenario that differs in its moves."""
        self._items = {item.name: item for item in scenario.scene.objects}

    def record(
        self,
        number: int,
        target: TrackTarget,
        order: TrackCommand,
        after: TrackState,
        samples: PatternSamples,
        seen: Measurement,
        parts: ErrorParts,
        limited: bool,
        row: int = 0,
    ) -> PatternRecord:
        """Return what is kept of a visit.

        Parameters
        ----------
        number
            Of the visit.
        target, order
            What was looked for, and how.
        after
            What is remembered of it afterwards.
        samples, seen
            The voxels of patterns, and what they show.
        parts
            What the errors of the positions are made of.
        limited
            Whether the mirrors were at a limit.
        row
            Which of the patterns the visit's is.
        """
        found, shown = bool(seen.found[row]), samples.of(row)
        if after.refusal is Refusal.NONE:
            status = TrackStatus.MEASURED
        elif after.refusal is not Refusal.NOT_SEEN:
            status = TrackStatus.REFUSED
        else:
            status = TrackStatus.LIMITED if limited else TrackStatus.NOT_FOUND
        time = float(seen.time[row]) if found else float(shown.time.mean())
        position = seen.position[row] if found else np.full(3, np.nan)
        covariance = seen.covariance[row] if found else np.full((3, 3), np.nan)
        errors = parts.at(row)
        if not found:
            # Parts add up to the covariance: of a centre without a range neither is known.
            errors = ErrorParts(*(np.full_like(part, np.nan) for part in vars(errors).values()))
        point, by_place = point_of(position, self._separation)
        truth, truth_point = self.truth(target, time)
        return PatternRecord(
            number=number,
            target=target.name,
            time=time,
            mode=order.mode,
            after=after.mode,
            refusal=after.refusal,
            status=status,
            amplitude=order.amplitude,
            centre=order.position[:2],
            position=position,
            covariance=covariance,
            errors=errors,
            point=point,
            point_covariance=product(by_place, covariance, by_place.T),
            truth=truth,
            truth_point=truth_point,
            samples=shown,
            available=float(shown.time[0, -1]) + self._late,
        )

    def out_of_view(
        self, number: int, target: TrackTarget, order: TrackCommand, after: TrackState, time: float
    ) -> PatternRecord:
        """Return the record of a pattern that was not run, at the time [s] at which it would have been."""
        unknown = ErrorParts.all_white(NOTHING.covariance)
        shown = replace(_NO_SAMPLES, time=np.full((1, 1), time))
        record = self.record(number, target, order, after, shown, NOTHING, unknown, limited=False)
        return replace(record, status=TrackStatus.OUT_OF_VIEW, samples=_NO_SAMPLES)

    def truth(self, target: TrackTarget, time: float) -> tuple[Array, Array]:
        """Return the true (Θ, φ, R) of a target's centre at a time [s], and its x, y, z [m], each of shape (3,)."""
        pose = self._items[target.object].pose_at(time)[0]
        point = applied(pose[:3, :3], target.centre) + pose[:3, 3]
        distance, theta, phi = angles_and_range(point[0], point[1], point[2], self._separation)
        return np.array([theta, phi, distance]), point


def point_of(position: Array, axis_separation: float) -> tuple[Array, Array]:
    """Return the point x, y, z of a position (Θ, φ, R), shape (3,) [m], and its derivatives by it, shape (3, 3).

    Eq 3 of Blais, Beraldin, El-Hakim (2000); rows are x, y, z, columns Θ, φ, R.
    """
    theta, phi, r = (float(value) for value in position)
    point = np.array([float(value) for value in coordinates(r, theta, phi, axis_separation)])
    sine, cosine, down, ahead = np.sin(theta), np.cos(theta), np.sin(phi), np.cos(phi)
    reach = r * cosine - axis_separation
    by_place = np.array(
        [
            [r * cosine, 0.0, sine],
            [-r * sine * down, reach * ahead, cosine * down],
            [-r * sine * ahead, -reach * down, cosine * ahead],
        ]
    )
    return point, by_place
