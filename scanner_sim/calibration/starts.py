"""Starting values of an adjustment: where stations and boards stand, from what the instrument believes as designed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scanner_sim.calibration.adjustment import Unknowns
from scanner_sim.calibration.network import FEWEST, Field, Poses
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.parameters import NAMES
from scanner_sim.pose.point_fit import point_fit
from scanner_sim.ranging.believed import believed_points

Array = NDArray[np.float64]
View = tuple[Array, Array]

_LINE = 0.05
"""Breadth of a board's targets over their length below which they stand on one line."""
_FLAT = 0.02
"""Thickness of a board's targets over their length below which they are seen from the front alone."""
_FACING = 0.5
"""Cosine of the angle of a flat board's normal to its z axis, below which the table does not say which side is its
front."""
_EXACT = 1e-3
"""Misfit over a board's length below which it is taken as it is."""
_MIRRORED = 0.25
"""Share of the misfit that a mirrored board leaves, below which the board is taken to be mirrored."""


def start_of(field: Field) -> Unknowns:
    """Return starting values: each board where its targets seem to be, station by station from the first board on.

    Raises
    ------
    InputError
        If a station or a board is not tied to the first board by boards of which enough targets were seen, or targets
        are numbered as in a mirror.
    """
    views = _views(field)
    stations: dict[int, View] = {}
    boards: dict[int, View] = {0: (np.eye(3), np.zeros(3))}
    while True:
        found = len(stations) + len(boards)
        for (station, board), (rotation, position) in views.items():
            if board in boards and station not in stations:
                stations[station] = _after(boards[board], _inverse((rotation, position)))
            elif station in stations and board not in boards:
                boards[board] = _after(stations[station], (rotation, position))
        if len(stations) + len(boards) == found:
            break
    _check_tied(field, stations, boards)
    return Unknowns(
        np.zeros(len(NAMES)),
        _poses(stations),
        _poses(boards),
        np.zeros_like(field.targets.places),
        np.zeros((len(field.stations), field.sightings.common.shape[2])),
    )


def _views(field: Field) -> dict[tuple[int, int], View]:
    """Return for each station and board of which it saw enough the board's pose in the scanner frame."""
    seen, targets = field.sightings, field.targets
    points = believed_points(seen.readings, field.design, np.zeros(len(NAMES)), field.encoder_period).point
    views: dict[tuple[int, int], View] = {}
    for station, number, chosen in field.views():
        local = targets.places[seen.target[chosen]]
        name = f"board {targets.boards[number]} as seen from station {field.stations[station]}"
        view = _view(local, points[chosen], name)
        if view is not None:
            views[station, number] = view
    return views


def _view(local: Array, measured: Array, name: str) -> View | None:
    """Return the pose of one board from one station; None where its targets stand on one line."""
    _, spread, axes = np.linalg.svd(local - local.mean(axis=0), full_matrices=False)
    if spread[1] < _LINE * spread[0]:
        return None
    rotation, position, misfit = fit_board(local, measured)
    if spread[2] < _FLAT * spread[0]:
        # A flat board in a mirror is about the same board from behind: its normal away from the front, z, is towards
        # the scanner. Where its origin lies does not count.
        away = axes[2] * np.sign(axes[2, 2])
        mirrored = bool(away[2] > _FACING and rotation @ away @ measured.mean(axis=0) < 0.0)
    else:
        _, _, other = fit_board(local * np.array([-1.0, 1.0, 1.0]), measured)
        mirrored = other < _MIRRORED * misfit and misfit > _EXACT * spread[0]
    if mirrored:
        raise InputError(
            f"The targets of {name} are numbered as in a mirror.",
            remedy="Turn the sign of one axis of its targets: seen from the front, x is to the right, y downwards.",
        )
    return rotation, position


def fit_board(local: Array, measured: Array) -> tuple[Array, Array, float]:
    """Return the rigid motion of points onto measured ones (Horn 1987), and the rms misfit [m]."""
    used = np.ones((len(local), 1), bool)
    rotation, position = point_fit(local.T[..., None], measured.T[..., None], used)
    left = measured - (local @ rotation[..., 0].T + position[:, 0])
    return rotation[..., 0], position[:, 0], float(np.sqrt(np.mean(left**2)))


def _after(outer: View, inner: View) -> View:
    """Return the pose of what has the pose ``inner`` in a frame that has the pose ``outer``."""
    return outer[0] @ inner[0], outer[0] @ inner[1] + outer[1]


def _inverse(pose: View) -> View:
    return pose[0].T, -pose[0].T @ pose[1]


def _poses(found: dict[int, View]) -> Poses:
    ordered = [found[number] for number in range(len(found))]
    return Poses(np.stack([one[0] for one in ordered]), np.stack([one[1] for one in ordered]))


def _check_tied(field: Field, stations: dict[int, View], boards: dict[int, View]) -> None:
    loose = [f"station {name}" for number, name in enumerate(field.stations) if number not in stations]
    loose += [f"board {name}" for number, name in enumerate(field.targets.boards) if number not in boards]
    if loose:
        raise InputError(
            f"{', '.join(loose)}: not tied to board {field.targets.boards[0]}, on which the field's axes stand.",
            remedy=f"Let each see {FEWEST} targets or more, not on one line, of a board that another one sees, too.",
        )
