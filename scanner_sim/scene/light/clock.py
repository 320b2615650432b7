"""The light of a track over its time: for how long one sky serves.

What Sun and Earth light is rendered once and used again, so that the sky goes on in steps. By an orbit's clock it is
that of the middle of a second, in which the Sun turns by 1.1 mrad in a low orbit, a quarter of its radius, and of the
middle of 1/16 s where its visible share changes: by 0.8 % in a penumbra of 8 s. Errors are half of that. What a
controller tells of the light counts when it differs from what is in use by more than :data:`MOST_TURNED` or
:data:`MOST_DIMMED`, and at full light and in an eclipse at once.
"""

from __future__ import annotations

import math
from collections import OrderedDict

import numpy as np

from scanner_sim.scene.light.earth import angle_between
from scanner_sim.scene.light.lighting import LightChange, Lighting, Sky

MOST_TURNED = 0.5e-3
"""Angle by which Sun or Earth may be elsewhere than their light that is in use [rad]."""
MOST_DIMMED = 0.005
"""The same of the Sun's visible share."""
_INTERVAL, _HALVINGS = 1.0, 4
"""Longest time for which a sky serves [s], and how often it is halved in the penumbra."""
_MOST_KEPT = 8


class SkyClock:
    """The skies of a lighting, each the same object for as long as it serves.

    Parameters
    ----------
    lighting
        Sun and Earth.
    """

    def __init__(self, lighting: Lighting) -> None:
        self.lighting = lighting
        # What is told is handed in: a sky's moment may lie behind a change that does not hold yet.
        self._untold = lighting.model_copy(update={"changes": ()})
        self._kept: OrderedDict[tuple[LightChange | None, float], Sky] = OrderedDict()
        self._shares: dict[float, float] = {}

    def sky(self, time: float, change: LightChange | None = None) -> Sky:
        """Return the sky that serves at a time [s], with the change of it that holds; None before the first."""
        key = change, self._moment(time)
        if key in self._kept:
            self._kept.move_to_end(key)
        else:
            self._kept[key] = self._untold.sky(key[1], change)
            if len(self._kept) > _MOST_KEPT:
                self._kept.popitem(last=False)
        return self._kept[key]

    def follow(self, lighting: Lighting) -> None:
        """Go on with a lighting that differs in its changes alone."""
        self.lighting = lighting

    def _moment(self, time: float) -> float:
        """Return the moment whose sky serves at a time [s]."""
        if not self.lighting.runs:
            return 0.0
        block = math.floor(time / _INTERVAL)
        ends = [self._share(_INTERVAL * (block + end)) for end in (0, 1)]
        step = _INTERVAL if ends[0] == ends[1] and ends[0] in (0.0, 1.0) else _INTERVAL * 0.5**_HALVINGS
        return (math.floor(time / step) + 0.5) * step

    def _share(self, time: float) -> float:
        """Return the share of the Sun that the Earth leaves by the orbit's clock."""
        if time not in self._shares:
            if len(self._shares) > _MOST_KEPT:
                self._shares.clear()
            self._shares[time] = self._untold.sky(time).sun_visible
        return self._shares[time]


def differ(lighting: Lighting, used: LightChange | None, told: LightChange | None, time: float) -> bool:
    """Return whether the light that is told differs from what is in use by more than may be."""
    if used == told:
        return False
    if used is None or told is None:
        return True
    one, other = lighting.sky(time, used), lighting.sky(time, told)
    for name in ("sun_direction", "earth_direction"):
        before, after = getattr(one, name), getattr(other, name)
        if before is not None and angle_between(np.asarray(before), np.asarray(after)) > MOST_TURNED:
            return True
    shares = one.sun_visible, other.sun_visible
    full = shares[1] in (0.0, 1.0) and shares[0] != shares[1]
    return full or abs(shares[0] - shares[1]) > MOST_DIMMED
