"""Aims that a user made: whether they can be, and whether the scenario's scan has them, too."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.scan.protocol import Aim

_ANGLES = ("theta", "phi", "travel_theta", "travel_phi")
_MOST_SHOTS = 2**32
"""Numbers of shots that address random numbers."""


def aim_at(
    theta: ArrayLike,
    phi: ArrayLike,
    dwell: float,
    *,
    first: int = 0,
    travel_theta: ArrayLike = 0.0,
    travel_phi: ArrayLike = 0.0,
) -> Aim:
    """Return shots in directions, one after the other.

    Parameters
    ----------
    theta, phi, travel_theta, travel_phi
        Deflections and their changes during a dwell [rad]; they broadcast, and are taken in C order.
    dwell
        Time of each shot [s].
    first
        Number of the first shot: it begins ``first`` dwells after time 0.
    """
    try:
        angles = np.broadcast_arrays(
            *(np.asarray(given, dtype=np.float64) for given in (theta, phi, travel_theta, travel_phi))
        )
    except (TypeError, ValueError) as error:
        raise InputError(
            f"these are no angles: {error}.", remedy="Give numbers [rad] that broadcast."
        ) from None
    along, across, by_theta, by_phi = (np.ravel(angle).copy() for angle in angles)
    last = first + along.size
    if not 0 <= first < last <= _MOST_SHOTS:
        raise InputError(
            f"shots {first} to {last - 1} cannot be numbered.",
            remedy=f"Name some from 0 to {_MOST_SHOTS - 1}.",
        )
    shot = np.arange(first, last, dtype=np.float64)
    return Aim(shot.astype(np.uint32), along, across, (shot + 0.5) * dwell, by_theta, by_phi)


def check_aim(aim: Aim, limit: float) -> None:
    """Check that an aim is one of mirrors that deflect by up to a limit [rad].

    Raises
    ------
    InputError
        If columns are missing, of other lengths or types, or not finite, or an angle is beyond the limit.
    """
    for name in (*_ANGLES, "time", "shot"):
        values, kind = getattr(aim, name), np.uint32 if name == "shot" else np.float64
        if not isinstance(values, np.ndarray) or values.dtype != kind or values.shape != (np.size(aim.shot),):
            came = (
                f"{values.dtype} of shape {values.shape}" if isinstance(values, np.ndarray) else repr(values)
            )
            raise InputError(
                f"{name} of the aim is {came}, and not {kind.__name__} of shape ({np.size(aim.shot)},).",
                remedy="Give all columns of an aim the same length, or let Instrument.aim make it.",
            )
        if not np.isfinite(values).all():
            raise InputError(f"{name} of the aim is not finite.", remedy="Leave out what is no number.")
    if not aim.shot.size:
        raise InputError("an aim needs at least one shot.", remedy="Give at least one direction.")
    for name in _ANGLES:
        if (widest := float(np.abs(getattr(aim, name)).max())) > limit:
            raise InputError(
                f"{name} of the aim reaches {widest:.6g} rad, and the mirrors deflect by up to {limit:g} rad.",
                remedy="Narrow it, or raise scanner.mirrors.max_deflection.",
            )


def is_of_scan(aim: Aim, scenario: Scenario) -> bool:
    """Tell whether all shots of an aim look at rows in which the background of a scenario's scan is rendered.

    None do in a scan without rows before what moves: its background is one of each moment.
    """
    scan = scenario.scan
    if scan.layout == "image":
        theta, phi = scan.angles()
        row, column = np.divmod(aim.shot, np.uint32(scan.columns))
        inside = bool((aim.shot < scan.shots).all())
        return inside and np.array_equal(phi[row], aim.phi) and np.array_equal(theta[column], aim.theta)
    if scan.layout == "visits" or any(item.moves for item in scenario.scene.objects):
        return False
    return all(
        bool(((angle >= ends[0]) & (angle <= ends[1])).all())
        for angle, ends in ((aim.theta, scan.horizontal), (aim.phi, scan.vertical))
    )
