"""The self-calibration as a whole: from sightings to a calibration, and what it is worth on what was held out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.calibration.adjustment import Adjusted, adjust
from scanner_sim.calibration.holdout import Misfit, misfit
from scanner_sim.calibration.network import FEWEST, Field
from scanner_sim.calibration.observability import Combination, correlations, unobserved
from scanner_sim.calibration.setup import Setup, field_of
from scanner_sim.calibration.starts import start_of
from scanner_sim.calibration.tables import SightingTable
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.ranging.calibration import Calibration

Array = NDArray[np.float64]

_FULL = 1.0 - 1e-9
"""Weight of a sighting that is not doubted."""


@dataclass(frozen=True)
class SelfCalibrated:
    """The result of a self-calibration.

    Attributes
    ----------
    field, held
        What the adjustment went by, and what was held out; None where nothing was.
    adjusted
        What it found.
    calibration
        The instrument as it is believed now.
    unobserved
        Combinations of parameters of which the sightings know less than the tolerances.
    fitted, held_out
        Misfit of both fields before and after.
    """

    field: Field
    held: Field | None
    adjusted: Adjusted
    calibration: Calibration
    unobserved: tuple[Combination, ...]
    fitted: Misfit
    held_out: Misfit | None

    @property
    def values(self) -> Array:
        """Parameters that were looked for, in the order of ``field.sought``."""
        return np.asarray(self.adjusted.unknowns.parameters[[INDEX[name] for name in self.field.sought]])

    @property
    def sigma(self) -> Array:
        """Their standard deviations."""
        return np.asarray(np.sqrt(np.diagonal(self.adjusted.covariance)))

    @property
    def correlations(self) -> Array:
        """Their correlations."""
        return correlations(self.adjusted)

    @property
    def doubted(self) -> tuple[tuple[str, str, float], ...]:
        """Station, target and weight of each sighting that counts less, the least first."""
        seen, weights = self.field.sightings, self.adjusted.weights
        order = [int(one) for one in np.argsort(weights, kind="stable") if weights[one] < _FULL]
        return tuple(
            (
                self.field.stations[seen.station[one]],
                self.field.targets.names[seen.target[one]],
                float(weights[one]),
            )
            for one in order
        )


def self_calibrate(setup: Setup, table: SightingTable) -> SelfCalibrated:
    """Adjust the field of a table of sightings.

    Raises
    ------
    InputError
        If stations and boards do not hang together, a board is mirrored, or the adjustment does not settle.
    """
    everything = field_of(setup, table)
    kept = _kept(setup, everything)
    if not kept.any():
        raise InputError("All sightings are held out.", remedy="Write held_out for fewer boards or stations.")
    field = everything.seeing(kept)
    held = None if kept.all() else everything.seeing(~kept)
    adjusted = _settled(field)
    combinations = unobserved(field, adjusted)
    covariance = np.zeros((len(NAMES), len(NAMES)))
    index = [INDEX[name] for name in field.sought]
    covariance[np.ix_(index, index)] = adjusted.covariance
    parameters = adjusted.unknowns.parameters
    calibration = Calibration(parameters, covariance, field.design, field.encoder_period)
    return SelfCalibrated(
        field,
        held,
        adjusted,
        calibration,
        combinations,
        misfit(field, parameters),
        None if held is None or not _has_views(held) else misfit(held, parameters),
    )


def _kept(setup: Setup, field: Field) -> NDArray[np.bool_]:
    """Return which sightings the adjustment may see."""
    boards = {board.name for board in setup.plan.boards if board.held_out}
    stations = {station.name for station in setup.plan.stations if station.held_out}
    board_out = np.array([name in boards for name in field.targets.boards])
    station_out = np.array([name in stations for name in field.stations])
    seen = field.sightings
    return np.asarray(~(board_out[field.targets.board[seen.target]] | station_out[seen.station]))


def _has_views(field: Field) -> bool:
    """Return whether any station has seen enough of a board for a misfit."""
    seen = field.sightings
    view = seen.station * len(field.targets.boards) + field.targets.board[seen.target]
    return int(np.bincount(view).max()) >= FEWEST


def _settled(field: Field) -> Adjusted:
    start = start_of(field)
    try:
        adjusted = adjust(field, start)
    except np.linalg.LinAlgError:
        raise InputError(
            "The adjustment has no solution: its normal equations are singular.",
            remedy="Give survey its σ, and let each station see boards at two distances.",
        ) from None
    if adjusted.settled:
        return adjusted
    least = unobserved(field, adjusted)[:1]
    told = f" The sightings tell least of {least[0].words}." if least else ""
    raise InputError(
        f"The adjustment has not settled after {adjusted.steps} steps: its unit weight is {adjusted.unit_weight:.3g}."
        f"{told}",
        remedy="Add stations at another distance or turned about their z, or a scale bar; look for fewer parameters; "
        "or check names and units of sightings, boards and scale bars, if the unit weight is far above 1.",
    )
