"""Columns of what errors of visits are made of: each part under its name, and the parts again from the columns."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from scanner_sim.products.error_columns import DITHER, ERRORS, error_columns, errors_from
from scanner_sim.tracking.errors import HARMONICS, ErrorParts

VISITS = 4


def matrices(rng: np.random.Generator, *shape: int) -> np.ndarray:
    """Return covariances of three coordinates of unlike sizes, nothing of them zero."""
    roots = rng.normal(size=(*shape, 3, 3)) * np.array([2e-5, 5e-5, 3e-4])[:, None]
    return np.asarray(roots @ np.swapaxes(roots, -1, -2))


def parts_of(seed: int, common: int) -> ErrorParts:
    """Return parts of four visits in which no number comes twice."""
    rng = np.random.default_rng(seed)
    shapes = {field.name: (VISITS,) for field in fields(ErrorParts)}
    shapes |= {"drift": (VISITS, 2), "offset": (VISITS, 2), "common": (VISITS, 3, common)}
    made = {name: rng.uniform(0.5, 3.0, shape) * 1e-4 for name, shape in shapes.items()}
    made |= {"white": matrices(rng, VISITS), "surface": matrices(rng, VISITS)}
    return ErrorParts(**made | {"dither": matrices(rng, VISITS, HARMONICS)})


@pytest.mark.parametrize("common", [0, 1, 3])
def test_parts_come_back_from_their_columns(common: int) -> None:
    """Claim: all of them, to rounding; white is what the others leave of the covariance of the whole."""
    parts = parts_of(5, common)
    columns = error_columns(parts)
    found = errors_from(columns, parts.whole)
    for field in fields(ErrorParts):
        np.testing.assert_allclose(
            getattr(found, field.name), getattr(parts, field.name), rtol=1e-9, atol=1e-20, err_msg=field.name
        )
    assert set(ERRORS) <= set(columns)
    other = parts.whole + matrices(np.random.default_rng(6), VISITS)
    np.testing.assert_allclose(
        errors_from(columns, other).white, parts.white + other - parts.whole, atol=1e-20
    )


def test_a_column_holds_what_its_name_says() -> None:
    """Claim: deviations are roots of the diagonals, covariances the entries of their two coordinates, and errors of the
    calibration and harmonics are counted from 1."""
    parts = parts_of(9, 2)
    columns = error_columns(parts)
    names = ("theta_rad", "phi_rad", "range_m")
    pairs = {"theta_phi_rad2": (0, 1), "theta_range_rad_m": (0, 2), "phi_range_rad_m": (1, 2)}
    expected = {
        "surface_turn_rad": parts.turn,
        "surface_approach_m": parts.approach,
        "surface_range_fades": parts.range_fades,
        "image_pixel": parts.image,
        "image_width_pixel": parts.image_width,
        "wobble_time_s": parts.wobble_time,
        "wobble_angle_rad": parts.wobble_angle,
        "sigma_pixels_range_m": np.sqrt(parts.pixels),
        "sigma_wobble_rad": np.sqrt(parts.wobble),
        "drift_theta_rad": parts.drift[:, 0],
        "drift_phi_rad": parts.drift[:, 1],
        "dwell_place": parts.dwell_place,
        "dwell_step": parts.dwell_step,
        "offset_theta": parts.offset[:, 0],
        "offset_phi": parts.offset[:, 1],
    }
    for axis, name in enumerate(names):
        expected[f"sigma_white_{name}"] = np.sqrt(parts.white[:, axis, axis])
        expected[f"sigma_surface_{name}"] = np.sqrt(parts.surface[:, axis, axis])
        for number in (1, 2):
            expected[f"common_{number}_{name}"] = parts.common[:, axis, number - 1]
        for number in range(1, HARMONICS + 1):
            expected[f"sigma_dither_{number}_{name}"] = np.sqrt(parts.dither[:, number - 1, axis, axis])
    for name, (one, other) in pairs.items():
        expected[f"cov_surface_{name}"] = parts.surface[:, one, other]
        for number in range(1, HARMONICS + 1):
            expected[f"cov_dither_{number}_{name}"] = parts.dither[:, number - 1, one, other]
    assert set(columns) == set(expected)
    assert len(DITHER) == 4 + 6 * HARMONICS
    for name, values in expected.items():
        np.testing.assert_allclose(columns[name], values, rtol=1e-12, err_msg=name)
