"""What is drawn about the points of a result: the scanner's field of view, where it ends near and far, and the Sun."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.products.view.packing import packed
from scanner_sim.ranging.axes import Axes
from scanner_sim.ranging.triangulation import range_from_position

Array = NDArray[np.float64]

_STEPS = 25
"""Points along an edge of the field of view."""


@dataclass(frozen=True)
class Surroundings:
    """What a page needs to know of the scenario beside the result, SI: its instrument as built.

    Attributes
    ----------
    horizontal, vertical
        First and last deflection Θ and φ of the scan, or of the mirrors where targets are followed [rad].
    near, far
        Nearest and farthest range on the axis that is measured [m]: ends of the array and of the gate. ``far`` may be
        infinite.
    array
        Position p of the far and of the near end of the array [m], by which both follow Θ; None for time of flight.
    scale, baseline
        Scale of the array, the focal length of an upright one in the focal plane, and base [m].
    axes
        Of the mirrors.
    gate
        The range gate [m], which ends both; by time of flight alone no wider than the digitiser's.
    sun
        Unit vector towards the Sun in the scanner's frame, shape (3,); None without one.
    sun_visible
        Share of its disc that the Earth does not hide.
    slope
        Slope of the array against the lens.
    """

    horizontal: tuple[float, float]
    vertical: tuple[float, float]
    array: tuple[float, float] | None
    gate: tuple[float, float]
    scale: float
    baseline: float
    axes: Axes
    sun: Array | None = None
    sun_visible: float = 0.0
    slope: float = 0.0

    @property
    def near(self) -> float:
        """Nearest range on the axis [m]."""
        return float(self.ends(np.zeros(1))[0][0])

    @property
    def far(self) -> float:
        """Farthest range on the axis [m], or infinity."""
        return float(self.ends(np.zeros(1))[1][0])

    def ends(self, theta: Array) -> tuple[Array, Array]:
        """Return nearest and farthest range [m] at deflections Θ [rad] (eq 1): of the array, and of the gate."""
        near, far = np.full_like(theta, self.gate[0]), np.full_like(theta, self.gate[1])
        if self.array is not None:
            p_far, p_near = self.array
            seen = range_from_position(p_near, theta, self.scale, self.baseline, self.slope)
            near = np.maximum(near, seen)
            if p_far > 0.0:
                seen = range_from_position(p_far, theta, self.scale, self.baseline, self.slope)
                far = np.minimum(far, seen)
        return near, far

    def drawn(self, farthest: float) -> dict[str, Any]:
        """Return the outlines as data of a page; the far end stands at ``farthest`` [m] where there is none."""
        theta = np.linspace(*self.horizontal, _STEPS)
        phi = np.linspace(*self.vertical, _STEPS)
        outlines = []
        for name, end in zip(("near", "far"), self.ends(theta), strict=True):
            r = np.minimum(end, farthest)
            edges = [self._line(r, theta, np.full_like(theta, side)) for side in self.vertical]
            edges += [
                self._line(np.full_like(phi, r[at]), np.full_like(phi, theta[at]), phi) for at in (0, -1)
            ]
            outlines += [{"name": name, "points": packed(edge)} for edge in edges]
        reach = np.minimum(self.ends(theta)[1], farthest)
        for at in (0, -1):
            for side in self.vertical:
                ray = self._line(np.array([0.0, reach[at]]), np.full(2, theta[at]), np.full(2, side))
                outlines.append({"name": "ray", "points": packed(ray)})
        return {
            "outlines": outlines,
            "near": self.near,
            "far": self.far if np.isfinite(self.far) else None,
            "drawn_far": min(self.far, farthest),
            "sun": None if self.sun is None else [float(part) for part in self.sun],
            "sun_visible": self.sun_visible,
        }

    def _line(self, r: Array, theta: Array, phi: Array) -> Array:
        """Return points at ranges and deflections, shape (n, 3) [m]; what would lie behind the mirrors is at them."""
        return np.stack(self.axes.point(np.maximum(r, self.axes.separation), theta, phi), axis=-1)
