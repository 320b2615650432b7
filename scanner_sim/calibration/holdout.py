"""How well a calibration holds where it was not made: boards that the adjustment has not seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scanner_sim.calibration.network import Field
from scanner_sim.calibration.starts import fit_board
from scanner_sim.foundation.parameters import NAMES
from scanner_sim.pose.transforms import cross_matrix
from scanner_sim.ranging.believed import believed_points

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Misfit:
    """How far points lie from their boards after the best rigid fit of each view, rms over what noise alone leaves.

    Attributes
    ----------
    designed, calibrated
        With the instrument as designed, and with the parameters that were found: 1 is pure noise.
    views, targets
        Of how many views and sightings.
    """

    designed: float
    calibrated: float
    views: int
    targets: int

    @property
    def improvement(self) -> float:
        """Share of the rms that the calibration takes away."""
        return 1.0 - self.calibrated / self.designed


def misfit(field: Field, parameters: Array) -> Misfit:
    """Return the misfit of a field's views, each board from each station fitted by itself.

    Points are weighed by the readings' σ and the survey's; a view with n targets leaves 3n − 6 degrees of freedom. The
    rigid fit is one Gauss-Newton step from the closed form of Horn, exact to second order in the misfit.

    Parameters
    ----------
    field
        Boards that the adjustment has not seen, or those that it has.
    parameters
        Of the instrument, as they were found, shape (23,).
    """
    designed, freedom, views = _squares(field, np.zeros(len(NAMES)))
    calibrated, _, _ = _squares(field, parameters)
    root = [float(np.sqrt(squares / freedom)) for squares in (designed, calibrated)]
    return Misfit(root[0], root[1], views, len(field.sightings))


def _squares(field: Field, parameters: Array) -> tuple[float, int, int]:
    """Return the sum of squares over σ of all views, its degrees of freedom, and the number of views."""
    seen, targets = field.sightings, field.targets
    believed = believed_points(seen.readings, field.design, parameters, field.encoder_period)
    by_noise = believed.by_readings @ seen.root
    covariance = by_noise @ np.swapaxes(by_noise, 1, 2) + targets.sigma**2 * np.eye(3)
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    total, freedom, views = 0.0, 0, 0
    for _, _, chosen in field.views():
        local, scaled = targets.places[seen.target[chosen]], whiten[chosen]
        rotation, position, _ = fit_board(local, believed.point[chosen])
        turned = local @ rotation.T
        left = np.einsum("nij,nj->ni", scaled, believed.point[chosen] - turned - position).ravel()
        moves = np.concatenate([scaled, -scaled @ cross_matrix(turned)], axis=-1).reshape(-1, 6)
        # What the view's sightings have in common is a number of unit variance each, found with the rigid motion.
        together = (scaled @ believed.by_readings[chosen] @ seen.common[chosen]).reshape(len(left), -1)
        known = np.concatenate([np.zeros((together.shape[1], 6)), np.eye(together.shape[1])], axis=1)
        system = np.concatenate([np.concatenate([moves, together], axis=1), known])
        left = np.concatenate([left, np.zeros(together.shape[1])])
        left = left - system @ np.linalg.lstsq(system, left, rcond=None)[0]
        total += float(left @ left)
        freedom += 3 * int(chosen.sum()) - 6
        views += 1
    return total, freedom, views
