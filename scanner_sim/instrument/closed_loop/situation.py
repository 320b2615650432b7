"""Where things are and how they are lit for one pattern: what the motions of a scenario, its moves and its light say.

The background is rendered once and used again, so that it knows moves in steps: an object that is moved by its
controller stands in the background where the state that it had at some visit takes it, as long as no corner of it is
farther than a quarter of a bin from where it is in truth. Then its state of that visit counts. Together with a time
slot (:mod:`scanner_sim.instrument.closed_loop.windows`) the background is at most three quarters of a bin off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from scanner_sim.config.scenario import Scenario
from scanner_sim.instrument.time_slots import angles_moved, corners_of
from scanner_sim.scene.files.loader import LoadedScene
from scanner_sim.scene.light.clock import SkyClock, differ
from scanner_sim.scene.light.lighting import LightChange, Sky
from scanner_sim.scene.moves import Move, Moves, RigidMotion
from scanner_sim.scene.objects import Posed

_MOST_BINS = 0.25
"""Bins by which a corner may be elsewhere than where the background takes it."""


@dataclass(frozen=True)
class InUse:
    """What the background uses of what was told: of each object that was moved its state, and the light.

    ``moves`` are pairs of names and states, in the order of the scene; ``light`` is None before the first change.
    """

    moves: tuple[tuple[str, Move], ...] = ()
    light: LightChange | None = None


@dataclass(frozen=True)
class Situation:
    """Where things are about one pattern, and how they are lit.

    ``items`` are the moving objects, in the order of the loaded scene's bodies; ``background`` the same as the
    background has them; ``sky`` lights them.
    """

    items: tuple[Posed, ...]
    background: tuple[Posed, ...]
    sky: Sky


class Situations:
    """The situations of a run.

    Parameters
    ----------
    scenario, loaded
        The run's scenario, and its scene.
    step
        Angle of a bin of the background [rad].
    like
        Situations of a run beside it: objects that are equal are then the same.
    """

    def __init__(
        self, scenario: Scenario, loaded: LoadedScene, step: float, like: Situations | None = None
    ) -> None:
        self._corners, self._step, self._like = corners_of(loaded), step, like
        self._clock = SkyClock(scenario.lighting)
        self._kept: tuple[InUse, tuple[Posed, ...]] | None = None
        self._dark: bool | None = None
        self.follow(scenario)

    def follow(self, scenario: Scenario) -> None:
        """Go on with a scenario that differs in its moves and in the changes of its light."""
        self._scenario = scenario
        self._items = _moving(scenario.scene.objects)
        if self._like is not None:
            pairs = zip(self._items, self._like._items, strict=True)
            self._items = tuple(other if own == other else own for own, other in pairs)
        if scenario.lighting is not self._clock.lighting or self._dark is None:
            self._clock.follow(scenario.lighting)
            self._dark = scenario.lighting.sky().dark

    def at(self, time: float, used: InUse) -> tuple[Situation, InUse]:
        """Return the situation about a time [s], and what the background uses from then on."""
        lighting = self._scenario.lighting
        if self._dark:
            return Situation(self._items, self._items, self._clock.sky(time)), used
        told = {
            item.name: move
            for item in self._scenario.scene.objects
            if isinstance(item.motion, Moves) and (move := item.motion.in_force(time)) is not None
        }
        moves = used.moves
        if set(told) != {name for name, _ in moves} or self._apart(time, used):
            moves = tuple(told.items())
        light = lighting.change_at(time)
        if not differ(lighting, used.light, light, time):
            light = used.light
        now = used if moves == used.moves and light == used.light else InUse(moves, light)
        return Situation(self._items, self._standing(now), self._clock.sky(time, light)), now

    def _apart(self, time: float, used: InUse) -> bool:
        """Return whether anything is farther from where the background has it than it may be."""
        if not used.moves:
            return False
        return any(
            float(angles_moved(corners, own.pose_at(time), other.pose_at(time)).max())
            > _MOST_BINS * self._step
            for corners, own, other in zip(self._corners, self._items, self._standing(used), strict=True)
        )

    def _standing(self, used: InUse) -> tuple[Posed, ...]:
        """Return the moving objects as the background has them: of what is told for later it knows nothing yet."""
        told = {item.name: item.motion for item in self._items if isinstance(item.motion, Moves)}
        if not told:
            return self._items
        if self._kept is None or self._kept[0].moves != used.moves:
            motions: dict[str, RigidMotion] = {
                name: motion.before for name, motion in told.items() if motion.before is not None
            }
            motions.update((name, Moves(type="moves", moves=(move,))) for name, move in used.moves)
            self._kept = used, _moving(self._scenario.scene.moved(motions).objects)
        return self._kept[1]


def _moving(objects: Sequence[Posed]) -> tuple[Posed, ...]:
    """Return the objects that move."""
    return tuple(item for item in objects if item.moves)
