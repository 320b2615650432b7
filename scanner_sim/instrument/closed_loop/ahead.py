"""What of visits goes before all that is told of the world, and may be done while nobody has asked for them yet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scanner_sim.instrument.closed_loop.saved_state import TrackerState
from scanner_sim.instrument.closed_loop.target_sensor import ExpectedPatterns
from scanner_sim.scan.schedule import PatternMotion
from scanner_sim.scan.ways import MirrorPair
from scanner_sim.tracking.state import TrackCommand

Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class Turn:
    """The pattern that a run is about to make: its state before, the target's index, the order and the time [s]."""

    run: int
    state: TrackerState
    index: int
    order: TrackCommand
    start: float


@dataclass(frozen=True)
class PatternsAhead:
    """Patterns that runs are about to make at the same of their targets: functions of their states alone.

    Attributes
    ----------
    turns
        The patterns.
    run_mirrors, expect
        Return how the mirrors run them and where they are afterwards, and what is known before they are measured.
    """

    turns: Sequence[Turn]
    run_mirrors: Callable[[Sequence[Turn]], tuple[PatternMotion, list[MirrorPair]]]
    expect: Callable[[Sequence[TrackCommand], PatternMotion, Numbers, Numbers], ExpectedPatterns]

    @cached_property
    def mirrors(self) -> tuple[PatternMotion, list[MirrorPair]]:
        """How the mirrors run the patterns, and where they are afterwards."""
        return self.run_mirrors(self.turns)

    @cached_property
    def numbers(self) -> tuple[Numbers, Numbers]:
        """Numbers of the visits and of the runs."""
        visit, run = np.array([(turn.state.visits, turn.run) for turn in self.turns], dtype=np.int64).T
        return visit, run

    @cached_property
    def expected(self) -> ExpectedPatterns:
        """What is known of the patterns before they are measured."""
        return self.expect([turn.order for turn in self.turns], self.mirrors[0], *self.numbers)

    def go_on(self) -> bool:
        """Do the next part that is not done yet; return whether there was one."""
        for part in ("mirrors", "expected"):
            if part not in vars(self):
                getattr(self, part)
                return True
        return False
