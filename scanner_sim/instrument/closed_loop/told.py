"""What a program tells a run between two visits of the world before the scanner: how an object moves, how it is lit.

Both become part of the run's scenario, as motions of the kind ``moves`` and as ``lighting.changes``: what was told is
kept, and the same scenario gives the same run again.
"""

from __future__ import annotations

import math
from itertools import combinations_with_replacement
from operator import mul
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import ValidationError

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.arithmetic import is_covariance
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.parts import Part
from scanner_sim.instrument.closed_loop.state_file import FASTEST, VAGUEST
from scanner_sim.scene.light.lighting import LightChange
from scanner_sim.scene.moves import Move, Moves
from scanner_sim.scene.objects import Posed

_ORTHOGONAL = 1e-6
"""Largest entry of RᵀR − 1 of a rotation that is one."""
LATE = 1e-9
"""Time [s] by which a command may be late by rounding."""


def with_move(
    scenario: Scenario,
    name: str,
    pose: ArrayLike,
    *,
    velocity: ArrayLike,
    turn_rate: ArrayLike,
    time: float | None,
    clock: float,
) -> Scenario:
    """Return a scenario in which an object goes on from a pose; see :meth:`Tracker.move`.

    Raises
    ------
    InputError
        If there is no such object, it cannot move, the pose is none, or the time is measured already.
    """
    matrix = np.asarray(pose, dtype=np.float64)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all() or not (matrix[3] == (0, 0, 0, 1)).all():
        raise InputError(
            f"this is no pose of '{name}'.", remedy="Give a 4 × 4 matrix whose last row is 0, 0, 0, 1."
        )
    rotation = matrix[:3, :3]
    if not _is_rotation(rotation.T.tolist()):
        raise InputError(
            f"the pose of '{name}' holds no rotation.",
            remedy="Its first three columns must be right-handed axes.",
        )
    return with_state(
        scenario,
        name,
        time=time,
        clock=clock,
        position=tuple(matrix[:3, 3].tolist()),
        quaternion=_quaternion(rotation.tolist()),
        velocity=_numbers(velocity),
        turn_rate=_numbers(turn_rate),
    )


def with_state(
    scenario: Scenario, name: str, *, time: float | None, clock: float, **state: tuple[float, ...]
) -> Scenario:
    """Return a scenario in which an object goes on from a state.

    Parameters
    ----------
    scenario, name
        The run, and the object's name.
    time, clock
        From when on, by default from the clock's time [s], until which everything is measured.
    state
        ``position``, ``quaternion`` (w, x, y, z), ``velocity`` and ``turn_rate`` of
        :class:`~scanner_sim.scene.moves.Move`.

    Raises
    ------
    InputError
        If there is no such object, it cannot move, the numbers are no state, or the time is measured already.
    """
    item, at = _movable(scenario, name), _time(time, clock, f"'{name}' is moved")
    move = _checked(Move, f"'{name}' cannot be moved so", time=at, **state)
    known = item.motion if isinstance(item.motion, Moves) else None
    if known is None:
        motion = Moves(type="moves", moves=(move,), before=item.motion)
    else:
        told = _before(known.moves, at, f"'{name}' was moved")
        motion = known.model_copy(update={"moves": (*told, move)})
    return scenario.model_copy(update={"scene": scenario.scene.moved({name: motion})})


def with_light(
    scenario: Scenario,
    *,
    sun: ArrayLike | None,
    earth: ArrayLike | None,
    visible: float | None,
    time: float | None,
    clock: float,
) -> Scenario:
    """Return a scenario that is lit otherwise from a time on; see :meth:`Tracker.light`.

    Raises
    ------
    InputError
        If there is no Sun, a direction or share is none, or the time is measured already.
    """
    lighting, at = scenario.lighting, _time(time, clock, "the light is changed")
    if lighting.sun == "none":
        raise InputError(
            "without a Sun there is no light to change.",
            remedy="Give the scenario a lighting.sun or an orbit.",
        )
    change = _checked(
        LightChange,
        "there is no such light",
        time=at,
        sun=None if sun is None else _numbers(sun),
        earth=None if earth is None else _numbers(earth),
        visible=None if visible is None else float(visible),
    )
    changes = (*_before(lighting.changes, at, "the light was changed"), change)
    return scenario.model_copy(update={"lighting": lighting.model_copy(update={"changes": changes})})


def check_knowledge(rates: ArrayLike | None, covariance: ArrayLike | None) -> None:
    """Check what somebody knows of a target's motion.

    Raises
    ------
    InputError
        If rates are not three numbers, a covariance is none of three or six, or they are beyond all targets.
    """
    if rates is not None:
        given = np.asarray(rates, dtype=np.float64)
        if given.shape != (3,) or not np.isfinite(given).all():
            raise InputError("these are no rates.", remedy="Give those of Θ, φ and range, per second.")
        if np.abs(given).max() > FASTEST:
            raise InputError(
                "these are no rates of a target.", remedy=f"At most {FASTEST:g} rad/s and m/s are possible."
            )
    if covariance is not None:
        matrix = np.asarray(covariance, dtype=np.float64)
        if matrix.shape not in ((3, 3), (6, 6)) or not np.isfinite(matrix).all():
            raise InputError("this is no covariance.", remedy="Give a matrix of 3 × 3 or 6 × 6 numbers.")
        if not is_covariance(matrix):
            raise InputError("this is no covariance.", remedy="It is symmetric, and no variance is negative.")
        if np.abs(matrix).max() > VAGUEST:
            raise InputError(
                "with this covariance nothing is known.", remedy=f"Entries up to {VAGUEST:g} are possible."
            )


def _quaternion(rows: list[list[float]]) -> tuple[float, float, float, float]:
    """Return (w, x, y, z) of a rotation by its rows, by way of the largest of them (Shepperd 1978)."""
    diagonal = [rows[axis][axis] for axis in range(3)]
    trace, i = sum(diagonal), max(range(3), key=diagonal.__getitem__)
    j, k = (i + 1) % 3, (i + 2) % 3
    found = [0.0] * 4
    if diagonal[i] > trace:
        found[1 + i], found[0] = 1.0 - trace + 2.0 * diagonal[i], rows[k][j] - rows[j][k]
        found[1 + j], found[1 + k] = rows[j][i] + rows[i][j], rows[k][i] + rows[i][k]
    else:
        found = [1.0 + trace, rows[2][1] - rows[1][2], rows[0][2] - rows[2][0], rows[1][0] - rows[0][1]]
    w, x, y, z = found
    length = math.sqrt(x * x + y * y + z * z + w * w)
    return w / length, x / length, y / length, z / length


def _is_rotation(axes: list[list[float]]) -> bool:
    """Return whether three axes are of unit length, at right angles, and right-handed."""
    products = (sum(map(mul, one, other)) for one, other in combinations_with_replacement(axes, 2))
    (a, b, c), other, third = axes
    (d, e, f), (g, h, i) = other, third
    handed = a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)
    even = zip(products, (1.0, 0.0, 0.0, 1.0, 0.0, 1.0), strict=True)
    return handed > 0.0 and all(abs(found - wanted) <= _ORTHOGONAL for found, wanted in even)


def _movable(scenario: Scenario, name: str) -> Posed:
    """Return an object that can be moved."""
    item = next((item for item in scenario.scene.objects if item.name == name), None)
    if item is None:
        names = ", ".join(item.name for item in scenario.scene.objects if item.motion is not None)
        raise InputError(
            f"there is no object '{name}'.", remedy=f"Those that can be moved: {names or 'none'}."
        )
    if item.motion is None:
        remedy = "Give it a motion in the scenario, {type: twist} for one at rest."
        if item.moves:
            remedy = f"Move '{item.parent}', to which it is fixed, or give it a motion of its own."
        raise InputError(f"'{name}' is not declared to move.", remedy=remedy)
    return item


def _time(time: float | None, clock: float, what: str) -> float:
    """Return from when on something is told."""
    if time is None:
        return clock
    if not math.isfinite(time) or time < clock - LATE:
        raise InputError(
            f"{what} at {time:.9g} s, and until {clock:.9g} s everything is measured.",
            remedy="What is past stays: name a time from Tracker.time on.",
        )
    return max(float(time), clock)


def _before(known: tuple[Any, ...], time: float, what: str) -> tuple[Any, ...]:
    """Return what was told before a time; what was told for the same time is told anew."""
    if known and known[-1].time > time:
        raise InputError(
            f"{what} for {known[-1].time:.9g} s already, later than {time:.9g} s.",
            remedy="Tell what happens in the order of time.",
        )
    return known[:-1] if known and known[-1].time == time else known


def _numbers(values: ArrayLike) -> tuple[float, ...]:
    numbers: NDArray[np.float64] = np.asarray(values, dtype=np.float64)
    return tuple(numbers.ravel().tolist())


def _checked(kind: type[Part], what: str, **values: Any) -> Any:
    """Return a part of a scenario from numbers of a program."""
    try:
        return kind(**values)
    except ValidationError as error:
        details = error.errors(include_url=False)[0]
        place = ".".join(map(str, details["loc"])) or "it"
        raise InputError(
            f"{what}: {place}: {details['msg']}.", remedy="All numbers are finite, in SI."
        ) from None
