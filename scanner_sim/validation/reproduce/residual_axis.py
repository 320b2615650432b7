"""The printed gain of ten on an axis of residuals: what angles and ranges gain together, by how well pixels are known.

A residual is what a calibration leaves of the position of the spot, each target's own, as that of a distortion that
differs over the field. A common one does to depth and tilt the same or less.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from scanner_sim.analytic.pose import square_joint, square_points
from scanner_sim.products.pose_study import COMPONENTS
from scanner_sim.validation.reproduce.bench import BASE, FOCAL, PITCH, Array
from scanner_sim.validation.reproduce.built_instruments import SQUARE, estimator_of, pose_sigma
from scanner_sim.validation.reproduce.drawing import BLUE, GREEN, RED, logarithms
from scanner_sim.validation.reproduce.item import Row, row_of_claim, within

TEN = 10.0
"""The printed gain."""
_RESIDUALS = np.geomspace(1e-3, 1.0, 31)
"""Residuals of the position of the spot [pixel]."""
_DECADES = (0.001, 0.01, 0.1, 1.0)
_PARTS = {"t_z": ("depth", BLUE), "omega_x": ("tilt", RED), "t_x": ("lateral", GREEN)}
"""Components of the pose that a range has a part in."""
_ROLL = COMPONENTS.index("omega_z")
_FIRST_ORDER = 0.05
"""How far closed forms, which neglect (h/R)² and D_g/R, may be off: both are below 1 % at 10 m."""
_TENTH = 0.1
"""Residual at which the roll is told [pixel]; beyond it D_g/R of a range's error turns the array, too."""
_SIDE = 1.0
"""Of the square of targets [m]."""


def per_pixel(distance: float) -> float:
    """Return by how much the range moves with a pixel [m]: eq 4."""
    return distance**2 / (FOCAL * BASE) * PITCH


@dataclass(frozen=True, eq=False)
class ResidualAxis:
    """Gains of the joint estimate over points along the axis.

    Attributes
    ----------
    distance, angle, noise
        Range [m], and σ of a target's angles [rad] and range [m] without residuals.
    aware, unaware
        Error by points over error by both, where the weights know of the residual and where they do not, shape
        (residuals, 6).
    """

    distance: float
    angle: float
    noise: float
    aware: Array
    unaware: Array

    @classmethod
    def at(cls, distance: float, angle: float, noise: float) -> ResidualAxis:
        """Return the axis for a range, by the derivatives of the estimates themselves."""
        believed = (angle, angle, noise)
        points, blind = (estimator_of(SQUARE, distance, method, believed) for method in ("xyz", "joint"))
        none = np.zeros((len(SQUARE), 3, 1))
        aware, unaware = [], []
        for residual in (_RESIDUALS * per_pixel(distance)).tolist():
            whole = (angle, angle, math.hypot(noise, residual))
            alone = pose_sigma(points, whole, none)
            aware.append(alone / pose_sigma(estimator_of(SQUARE, distance, "joint", whole), whole, none))
            unaware.append(alone / pose_sigma(blind, whole, none))
        return cls(distance, angle, noise, np.array(aware), np.array(unaware))

    def rows(self) -> list[Row]:
        """Return where each component gains ten, and what it gains at most, beside closed forms."""
        rows = [row for name in _PARTS for row in self._places(name)]
        index = int(np.abs(np.log(_RESIDUALS / _TENTH)).argmin())
        gain = float(self.aware[index, _ROLL])
        what = f"roll: what joint gains over xyz at {_TENTH:g} pixel"
        return [*rows, row_of_claim(what, "", "1.00", f"{gain:.2f}", within(gain, 1.0, _FIRST_ORDER))]

    def _places(self, name: str) -> tuple[Row, Row]:
        words, column = _PARTS[name][0], COMPONENTS.index(name)
        place, closed = _crossing(self.aware[:, column]), _crossing(self._closed(words))
        most, bound = float(self.unaware[:, column].max()), self._bound(words)
        return (
            row_of_claim(
                f"{words}: residual from which joint gains ten over xyz, if the weights know it",
                "",
                f"{closed:.3f} pixel",
                f"{place:.3f} pixel",
                within(place, closed, _FIRST_ORDER),
            ),
            row_of_claim(
                f"{words}: most that it gains anywhere, if they do not",
                "",
                f"{bound:.2f}",
                f"{most:.2f}",
                within(most, bound, _FIRST_ORDER),
            ),
        )

    def _closed(self, words: str) -> Array:
        """Return the gain by the closed forms of a square, the weights knowing, shape (residuals,)."""
        whole = np.hypot(self.noise, _RESIDUALS * per_pixel(self.distance)).tolist()
        forms = (square_points, square_joint)
        points, both = (
            np.array([getattr(form(self.angle, one, self.distance, _SIDE), words) for one in whole])
            for form in forms
        )
        return np.asarray(points / both)

    def _bound(self, words: str) -> float:
        """Return 1/w, w the share that ranges have in the joint depth or tilt by the weights of noise.

        The residual enters the joint estimate by that share. Of the depth w = (4/σ_R²)/(4/σ_R² + 2a²/(σ²R⁴)), of the
        tilt (a²/σ_R²)/(a²/σ_R² + a⁴/(4σ²R⁴)), and of the lateral place, which ranges enter by the tilt, the same.
        """
        ratio = (self.noise * _SIDE / (self.angle * self.distance**2)) ** 2
        return 1.0 + ratio * (0.5 if words == "depth" else 0.25)

    def draw(self, axes: Axes) -> None:
        """Draw the gains over the residual, and the printed one."""
        for name, (words, colour) in _PARTS.items():
            column = COMPONENTS.index(name)
            axes.plot(_RESIDUALS, self.aware[:, column], color=colour, label=words)
            axes.plot(_RESIDUALS, self.unaware[:, column], color=colour, ls="--")
        axes.plot([], [], color="black", ls="--", label="weights do not know")
        axes.axhline(TEN, color="black", lw=0.8, ls=":")
        axes.set(
            xscale="log",
            yscale="log",
            xlabel="residual [pixel]",
            ylabel="error of xyz over joint",
            ylim=(0.3, 40.0),
        )
        logarithms(axes)
        axes.set_xticks(_DECADES, [f"{one:g}" for one in _DECADES])


def _crossing(gain: Array) -> float:
    """Return the residual at which a rising gain is ten [pixel]; NaN beyond the axis."""
    return float(np.exp(np.interp(math.log(TEN), np.log(gain), np.log(_RESIDUALS), math.nan, math.nan)))
