"""The form of a saved tracking run: what each number may be, checked before anything is made of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from scanner_sim.foundation.arithmetic import is_covariance
from scanner_sim.foundation.errors import Fault
from scanner_sim.foundation.parts import Count, Number, Part, Switch
from scanner_sim.scan.schedule import MOST_VISITS
from scanner_sim.scene.light.lighting import LightChange
from scanner_sim.scene.moves import Move
from scanner_sim.scene.poses import Name
from scanner_sim.tracking.record import FARTHEST, NEAREST, WIDEST
from scanner_sim.tracking.state import Refusal, TrackMode

FORMAT = 1
"""Version of the file's form."""
FASTEST = 1e7
"""Largest rate of a target or a mirror [rad/s, m/s]."""
VAGUEST = 1e12
"""Largest entry of a covariance that is told [rad, m, s]."""

_Time = Annotated[Number, Field(ge=0.0, le=1e9)]
_Angle = Annotated[Number, Field(ge=-WIDEST, le=WIDEST)]
_Rate = Annotated[Number, Field(ge=-FASTEST, le=FASTEST)]
_Range = Annotated[Number, Field(ge=NEAREST, le=FARTHEST)]
# Where a target that nobody sees is after 1e9 s at the largest rate, and how uncertain that is then.
_Predicted = Annotated[Number, Field(ge=-1e17, le=1e17)]
_Covariance = Annotated[Number, Field(ge=-1e33, le=1e33)]
_Counted = Annotated[Count, Field(ge=0, le=2**31)]
_Amplitude = Annotated[Number, Field(gt=0.0, lt=1.5)]
_Pair = tuple[_Angle, _Angle]
_Rates = tuple[_Rate, _Rate]
_Row = tuple[_Covariance, _Covariance, _Covariance, _Covariance, _Covariance, _Covariance]


class SavedMirrors(Part):
    """Both mirrors between two visits, Θ first [rad, s]."""

    angle: _Pair
    rate: _Rates
    command: _Pair
    slope: _Rates
    time: _Time


class SavedTrack(Part):
    """What is remembered of a target [rad, rad, m, s]."""

    mode: Literal[tuple(mode.value for mode in TrackMode)]  # type: ignore[valid-type]
    mean: tuple[_Predicted, _Predicted, _Predicted, _Rate, _Rate, _Rate]
    covariance: tuple[_Row, _Row, _Row, _Row, _Row, _Row]
    time: _Time
    expected: tuple[_Angle, _Angle, _Range]
    refusal: Literal[tuple(refusal.value for refusal in Refusal)]  # type: ignore[valid-type]
    patterns: _Counted
    seen: _Counted
    missed: _Counted
    searched: _Counted
    told: Switch = False

    def cross_checks(self) -> Iterator[Fault]:
        """Yield a matrix that is no covariance: not symmetric, or with a negative variance in some direction."""
        if not is_covariance(np.array(self.covariance, dtype=np.float64)):
            yield Fault("covariance", "this is no covariance: not symmetric, or a variance is negative.")


class SavedState(Part):
    """A tracking run between two visits."""

    visits: Annotated[Count, Field(ge=0, le=MOST_VISITS)]
    clock: _Time
    mirrors: SavedMirrors
    turn: _Counted
    skipped: _Counted
    tracks: tuple[SavedTrack, ...] = Field(min_length=1)
    followed: tuple[Switch, ...]
    amplitudes: tuple[_Amplitude | None, ...]
    used_moves: dict[Name, Move] = Field(default_factory=dict)
    used_light: LightChange | None = None
    said: tuple[str, ...] = ()

    def cross_checks(self) -> Iterator[Fault]:
        """Yield lists of unequal length, a turn beyond them, and mirrors that are ahead of the clock."""
        count = len(self.tracks)
        for name in ("followed", "amplitudes"):
            if (length := len(getattr(self, name))) != count:
                yield Fault(name, f"it has {length} entries, and there are {count} tracks.")
        for name in ("turn", "skipped"):
            if (number := getattr(self, name)) >= count:
                yield Fault(name, f"{number} is not below the number of tracks, {count}.")
        if self.mirrors.time > self.clock:
            yield Fault("mirrors.time", f"{self.mirrors.time:g} s is later than the clock, {self.clock:g} s.")


class SavedRun(Part):
    """A file of :meth:`scanner_sim.instrument.closed_loop.tracker.Tracker.save`."""

    format: Literal[1]
    made_by: str
    scenario: str
    state: SavedState
