"""Columns of a track's table that say what the errors of its visits are made of."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scanner_sim.products.files.tables import Columns, Table
from scanner_sim.tracking.errors import HARMONICS, ErrorParts

Array = NDArray[np.float64]

_ANGULAR = ("theta_rad", "phi_rad", "range_m")
_SURFACE = tuple(f"surface_{name}" for name in _ANGULAR)
_CROSS = {(0, 1): "theta_phi_rad2", (0, 2): "theta_range_rad_m", (1, 2): "phi_range_rad_m"}
"""Ends of the names of covariances."""
_SURFACE_CROSS, *SURFACE_OF_RANGE = (f"cov_surface_{name}" for name in _CROSS.values())
"""Covariances of the surface's part between angles and range."""
_PART = {
    "turn": "surface_turn_rad",
    "approach": "surface_approach_m",
    "range_fades": "surface_range_fades",
    "image": "image_pixel",
    "image_width": "image_width_pixel",
    "wobble_time": "wobble_time_s",
    "wobble_angle": "wobble_angle_rad",
}
"""Columns of fields of :class:`~scanner_sim.tracking.errors.ErrorParts` as they are."""
_PART_SIGMA = {"pixels": "sigma_pixels_range_m", "wobble": "sigma_wobble_rad"}
"""Columns of their variances."""
_PLACES = ("dwell_place", "dwell_step", "offset_theta", "offset_phi")
DITHER = (
    *_PLACES,
    *(
        f"{kind}_dither_{number}_{name}"
        for number in range(1, HARMONICS + 1)
        for kind, names in (("sigma", _ANGULAR), ("cov", tuple(_CROSS.values())))
        for name in names
    ),
)
"""Columns of where the dwells lie, and of what that makes."""
_DRIFT = ("drift_theta_rad", "drift_phi_rad")
ERRORS = (
    *(f"sigma_{name}" for name in _SURFACE),
    _SURFACE_CROSS,
    *SURFACE_OF_RANGE,
    *_PART.values(),
    *_PART_SIGMA.values(),
    *_DRIFT,
    *DITHER,
)
"""Columns from which the parts are read."""


def error_columns(parts: ErrorParts) -> Table:
    """Return the columns of the parts of errors."""
    columns: Table = {}
    for prefix, matrices in (("white_", parts.white), ("surface_", parts.surface)):
        sigmas = np.sqrt(np.maximum(np.diagonal(matrices, axis1=1, axis2=2), 0.0))
        columns |= {f"sigma_{prefix}{name}": row for name, row in zip(_ANGULAR, sigmas.T, strict=True)}
    columns[_SURFACE_CROSS] = parts.surface[:, 0, 1]
    columns |= {name: parts.surface[:, axis, 2] for axis, name in enumerate(SURFACE_OF_RANGE)}
    columns |= {name: getattr(parts, field) for field, name in _PART.items()}
    columns |= {name: np.sqrt(getattr(parts, field)) for field, name in _PART_SIGMA.items()}
    columns |= dict(zip(_DRIFT, parts.drift.T, strict=True))
    columns |= dict(zip(DITHER, _dither_columns(parts), strict=True))
    for number in range(parts.common.shape[-1]):
        columns |= {
            _common(number, name): parts.common[:, axis, number] for axis, name in enumerate(_ANGULAR)
        }
    return columns


def _dither_columns(parts: ErrorParts) -> Iterator[Array]:
    """Yield the columns of :data:`DITHER`."""
    yield from (parts.dwell_place, parts.dwell_step, *parts.offset.T)
    for matrix in np.moveaxis(parts.dither, 1, 0):
        yield from np.sqrt(np.diagonal(matrix, axis1=1, axis2=2)).T
        yield from (matrix[:, one, other] for one, other in _CROSS)


def _dither(columns: Columns, count: int) -> dict[str, Array]:
    """Return the fields of :class:`~scanner_sim.tracking.errors.ErrorParts` of :data:`DITHER`."""
    place, step, *rest = (columns[name] for name in DITHER)
    offset, rest = np.stack(rest[:2], axis=1), rest[2:]
    found = np.zeros((count, HARMONICS, 3, 3))
    for number in range(HARMONICS):
        own = rest[6 * number : 6 * number + 6]
        for axis in range(3):
            found[:, number, axis, axis] = own[axis] ** 2
        for (one, other), values in zip(_CROSS, own[3:], strict=True):
            found[:, number, one, other] = found[:, number, other, one] = values
    return {"dither": found, "dwell_place": place, "dwell_step": step, "offset": offset}


def _common(number: int, name: str) -> str:
    """Return the column of what an error of the calibration makes of a coordinate."""
    return f"common_{number + 1}_{name}"


def common_columns(columns: Columns) -> list[tuple[str, ...]]:
    """Return the columns of what each error of the calibration makes of (Θ, φ, R), as many as there are."""
    numbers = itertools.takewhile(lambda number: _common(number, _ANGULAR[0]) in columns, itertools.count())
    return [tuple(_common(number, name) for name in _ANGULAR) for number in numbers]


def errors_from(columns: Columns, covariance: Array) -> ErrorParts:
    """Return the parts of errors from their columns; white is what they leave of the covariance."""
    surface = np.zeros_like(covariance)
    drift = np.stack([columns[name] for name in _DRIFT], axis=1)
    plain = {field: columns[name] for field, name in _PART.items()}
    names = common_columns(columns)
    common = np.zeros((len(covariance), 3, len(names)))
    for number, own in enumerate(names):
        common[:, :, number] = np.stack([columns[name] for name in own], axis=1)
    # Of what was refused a fit may state any uncertainty.
    with np.errstate(over="ignore", invalid="ignore"):
        for axis, name in enumerate(_SURFACE):
            surface[:, axis, axis] = columns[f"sigma_{name}"] ** 2
        surface[:, 0, 1] = surface[:, 1, 0] = columns[_SURFACE_CROSS]
        for axis, name in enumerate(SURFACE_OF_RANGE):
            surface[:, axis, 2] = surface[:, 2, axis] = columns[name]
        squared = {field: columns[name] ** 2 for field, name in _PART_SIGMA.items()}
        rest = ErrorParts(
            white=np.zeros_like(surface),
            surface=surface,
            drift=drift,
            common=common,
            **_dither(columns, len(covariance)),
            **plain,
            **squared,
        )
        return replace(rest, white=covariance - rest.whole)
