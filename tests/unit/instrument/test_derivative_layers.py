"""Derivatives by calibrated parameters as layers and columns: held to σ, to files and to what the instrument ranges."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pint
import pytest
from numpy.typing import NDArray

from scanner_sim import (
    Instrument,
    Scenario,
    ScenarioError,
    load_scenario,
    parameter_jacobian,
    simulate,
    simulate_shots,
)
from scanner_sim.config.calibration import calibration_text, design_of, read_calibration
from scanner_sim.config.scanner import geometry_of
from scanner_sim.foundation.channels import DERIVATIVES
from scanner_sim.foundation.parameters import INDEX, NAMES, PARAMETERS
from scanner_sim.instrument.common_errors import ReadingsOfTheta, add_common_errors, derivatives
from scanner_sim.products.files.exr import read_range_image
from scanner_sim.products.files.run_folder import write_run
from scanner_sim.products.files.shots_folder import read_shots, write_shots
from scanner_sim.ranging.calibration import Calibration

Array = NDArray[np.float64]

PERIOD = 0.3
STEP = {
    "base": 2e-4, "focal_length": 1e-4, "axis_separation": 2e-4, "axis_offset": 2e-4, "axis_skew": 2e-4,
    "theta_zero": 1e-4, "phi_zero": 1e-4, "theta_scale": 5e-4, "phi_scale": 5e-4, "theta_cubic": 4e-3,
    "phi_cubic": 4e-3, "theta_sine": 2e-4, "theta_cosine": 2e-4, "phi_sine": 2e-4, "phi_cosine": 2e-4,
    "array_offset": 2e-6, "array_scale": 5e-4, "array_tilt": 5e-3, "radial_1": 0.2, "radial_2": 1.0,
    "tangential": 5e-3, "tof_zero": 2e-3, "tof_scale": 5e-4,
}  # fmt: skip
"""Steps that move some point by a tenth of a millimetre or more, but ``radial_2``: of its fifth power hardly any is
left at a tenth of a radian."""

pytestmark = pytest.mark.usefixtures("device")


def unread() -> ReadingsOfTheta:
    """Return readings of three shots whose σ nobody may ask for."""
    mirrors: Any = SimpleNamespace(reading_sigma=lambda *_: pytest.fail("σ of Θ is in fused ranges alone"))
    return ReadingsOfTheta(mirrors, np.zeros(3), np.zeros(3))


def wall(**scan: Any) -> Scenario:
    """Return a wall before the prototype with all its noise, by both ways of ranging."""
    raster = {"type": "raster", "rows": 5, "columns": 6, "horizontal": [0.0, 0.02], "vertical": [0.1, 0.12]}
    return load_scenario(
        {
            "schema": 1, "ranging": "both", "scan": scan or raster,
            "scene": {"objects": [
                {"shape": "rectangle", "name": "wall", "material": "grey_reference", "position": [0, 0, 2.5],
                 "size": [9.0, 9.0]}
            ]},
        }
    )  # fmt: skip


def believing(found: Scenario, folder: Path, values: Mapping[str, float], names: Sequence[str]) -> Scenario:
    """Return a scenario with a calibration of which some parameters err, each pair correlated by a half."""
    given = np.array([values.get(name, 0.0) for name in NAMES])
    sigma = np.array([STEP[name] if name in names else 0.0 for name in NAMES])
    covariance = 0.5 * (np.eye(len(NAMES)) + 1.0) * sigma * sigma[:, None]
    own = Calibration(given, covariance, design_of(found.scanner), PERIOD)
    (folder / "calibration.yaml").write_text(calibration_text(own, found.scanner), encoding="utf-8")
    changes = {"processing.calibration": str(folder / "calibration.yaml"), "output.jacobian": True}
    return found.replace(changes)


def slopes_of(layers: Any, name: str, prefix: str) -> Array:
    """Return the layers of derivatives by a parameter, the point's and the range's, shape (4, ...)."""
    return np.stack([np.asarray(layers[f"{prefix}J.{name}.{moved}"], dtype=np.float64) for moved in "XYZR"])


UNIT = {
    "base": "m", "theta_zero": "rad", "phi_zero": "rad", "array_tilt": "rad", "tof_zero": "m", "tof_scale": "1"
}  # fmt: skip
FREE = ("base", "theta_zero", "phi_zero", "array_tilt", "tof_zero", "tof_scale")


def assert_common(result: Any, stored: Path, found: Scenario) -> None:
    """Hold √(J C Jᵀ), C from a file beside the result, to the common part of σ.

    Six numbers of single precision are left 1e-5: of correlated errors, none nearly cancels another.
    """
    assert result.calibration_yaml == stored.read_text(encoding="utf-8")
    known = read_calibration(stored, found.scanner)
    assert known.uncertain == FREE
    index = [INDEX[name] for name in FREE]
    covariance = known.covariance[np.ix_(index, index)]
    for prefix in ("", "tof.", "fused."):
        by = np.stack([slopes_of(result, name, prefix)[3] for name in FREE], axis=-1)
        common = np.sqrt(np.einsum("...p,pq,...q->...", by, covariance, by))
        np.testing.assert_allclose(common, result[f"{prefix}sigma_common_m"], rtol=1e-5)
        assert np.isfinite(common).any()


def test_layers_give_the_common_part(tmp_path: Path) -> None:
    """Claim: √(J C Jᵀ) is ``sigma_common_m`` for every way of ranging, from the files of a run alone; and
    ``parameter_jacobian`` tells the same of each, to the rounding of the points from which it begins.

    Mirrors point where they are commanded to 20 µrad, five times of which are left for the angle.
    """
    found = believing(wall(), tmp_path, {}, FREE)
    write_run(simulate(found), tmp_path / "out", found.output)
    image = read_range_image(tmp_path / "out" / "range.exr")
    assert_common(image, tmp_path / "out" / "believed.yaml", found)
    for prefix in ("", "tof.", "fused."):
        told = parameter_jacobian(image, prefix=prefix)
        for name in FREE:
            own = told.sel(parameter=name)
            both = np.concatenate([np.moveaxis(own.point.values, -1, 0), own.range.values[None]])
            layers = slopes_of(image, name, prefix)
            np.testing.assert_allclose(both, layers, rtol=1e-5, atol=1e-5 * np.abs(layers).max())
        # Some, in another order than that of all: the covariance and the units are those of the same.
        some = list(FREE[:0:-2])
        told = parameter_jacobian(image, some, prefix=prefix)
        assert list(told.unit.values) == [UNIT[name] for name in some]
        index = [INDEX[name] for name in some]
        wanted = read_calibration(tmp_path / "out" / "believed.yaml", found.scanner).covariance
        np.testing.assert_array_equal(told.covariance, wanted[np.ix_(index, index)])
    # A sine and a cosine of the encoder's period move a point as the angle's zero does, times sin and cos 2π Θ/period.
    for angle, axis, ends in (("theta", 0, (0.0, 0.02)), ("phi", 1, (0.1, 0.12))):
        told = parameter_jacobian(image, [f"{angle}_{name}" for name in ("zero", "sine", "cosine")])
        zero, sine, cosine = np.moveaxis(told.point.values[:, :, axis], -1, 0)
        even = np.linspace(*ends, zero.shape[1 - axis])
        place = np.broadcast_to(even if axis == 0 else even[:, None], zero.shape)
        np.testing.assert_allclose(
            np.arctan2(sine / zero, cosine / zero), math.tau * place / PERIOD, atol=math.tau * 1e-4 / PERIOD
        )


def test_pulses_alone_are_the_same_with_and_without_their_prefix(tmp_path: Path) -> None:
    """Claim: what time of flight alone has measured stands under its own names and without their prefix, each with the
    calibration's share of σ, covariances and derivatives; ``parameter_jacobian`` tells both."""
    image = simulate(believing(wall().replace({"ranging": "tof"}), tmp_path, {}, FREE))
    assert np.nanmin(image["sigma_common_m"]) > 0.0
    derived = [f"J.{name}.{moved}" for name in FREE for moved in "XYZR"]
    sigmas = [f"sigma_{name}_m" for name in ("range", "x", "y", "z", "common")]
    for name in ("range_m", *sigmas, "cov_xy_m2", "cov_xz_m2", "cov_yz_m2", *derived):
        np.testing.assert_array_equal(image[f"tof.{name}"], image[name], err_msg=name)
    told = [parameter_jacobian(image, prefix=prefix) for prefix in ("", "tof.")]
    for kind in ("point", "range"):
        assert np.isfinite(told[0][kind]).any()
        np.testing.assert_array_equal(told[0][kind], told[1][kind])
    assert float(np.abs(told[1].range.sel(parameter="array_tilt")).max()) == 0.0


def test_points_have_the_covariance_of_what_they_share(tmp_path: Path) -> None:
    """Claim: beside the same run without a calibration, all six numbers of a point's covariance grow by J C Jᵀ, by both
    ways of ranging. Tolerance: single precision of covariances, of which a tenth and more is common."""
    plain = wall()
    one, other = simulate(believing(plain, tmp_path, {}, FREE)), simulate(plain)
    sigma = np.array([STEP[name] for name in FREE])
    shared = 0.5 * (np.eye(len(FREE)) + 1.0) * sigma * sigma[:, None]
    for prefix in ("", "tof."):
        by = np.stack([slopes_of(one, name, prefix)[:3] for name in FREE], axis=-1)
        wanted = np.einsum("a...p,pq,b...q->ab...", by, shared, by)
        for i, j, name in (
            (0, 0, "sigma_x_m"), (1, 1, "sigma_y_m"), (2, 2, "sigma_z_m"),
            (0, 1, "cov_xy_m2"), (0, 2, "cov_xz_m2"), (1, 2, "cov_yz_m2"),
        ):  # fmt: skip
            before, after = (image[prefix + name].astype(np.float64) for image in (other, one))
            grown = after**2 - before**2 if i == j else after - before
            scale = np.sqrt(wanted[i, i] * wanted[j, j]).max()
            assert np.isfinite(grown).any()
            np.testing.assert_allclose(
                grown[np.isfinite(grown)], wanted[i, j][np.isfinite(grown)], atol=1e-4 * scale, err_msg=name
            )


def test_a_known_vibration_moves_points_and_no_range(tmp_path: Path) -> None:
    """Claim: covariances of points are larger by a turn of the whole scanner, of every way of ranging; no range is, and
    nothing is common; the files say what was believed."""
    plain = wall()
    text = calibration_text(
        Calibration(np.zeros(len(NAMES)), np.zeros((len(NAMES),) * 2), design_of(plain.scanner)),
        plain.scanner,
    )
    (tmp_path / "calibration.yaml").write_text(
        text + "vibration: {turn: [[1 Hz, 1e-8 rad^2/Hz], [50 Hz, 1e-9 rad^2/Hz]]}\n"
    )
    knowing = plain.replace({"processing.calibration": str(tmp_path / "calibration.yaml")})
    one, other = simulate(knowing), simulate(plain)
    known = read_calibration(tmp_path / "calibration.yaml", plain.scanner).vibration
    assert known is not None
    turn = known.deviations[0]
    for prefix in ("", "tof.", "fused."):
        np.testing.assert_array_equal(one[f"{prefix}sigma_range_m"], other[f"{prefix}sigma_range_m"])
        assert f"{prefix}sigma_common_m" not in one.channels
        x, y, z = (one[f"{prefix}P.{axis}"].astype(np.float64) for axis in "XYZ")
        for name, wanted in (
            ("sigma_x_m", y**2 + z**2),
            ("sigma_y_m", x**2 + z**2),
            ("sigma_z_m", x**2 + y**2),
        ):
            more = np.square(one[prefix + name], dtype=np.float64) - np.square(
                other[prefix + name], dtype=np.float64
            )
            np.testing.assert_allclose(
                more, turn**2 * wanted, rtol=1e-3, atol=1e-6 * np.nanmax(one[prefix + name]) ** 2
            )
        for name, wanted in (("cov_xy_m2", x * y), ("cov_xz_m2", x * z), ("cov_yz_m2", y * z)):
            crossed = one[prefix + name].astype(np.float64) - other[prefix + name]
            np.testing.assert_allclose(crossed, -(turn**2) * wanted, atol=1e-3 * turn**2 * 9.0, err_msg=name)
    assert "vibration:" in one.calibration_yaml


def test_columns_give_the_common_part(tmp_path: Path) -> None:
    """Claim: the same of a scan without rows and its Parquet table."""
    spiral = {"type": "spiral", "radius": 0.1, "turns": 2, "points": 20}
    found = believing(wall(**spiral), tmp_path, {}, FREE)
    write_shots(simulate_shots(found), tmp_path / "out", found.output)
    assert_common(read_shots(tmp_path / "out"), tmp_path / "out" / "believed.yaml", found)


@pytest.mark.parametrize("name", NAMES)
def test_layers_are_differences_of_the_ranging(name: str, tmp_path: Path) -> None:
    """Claim: half the difference of what the instrument measures, believing +v and −v, is v times the layers.

    Light and noise are the same in both. To 1 % of the largest: noise of some millimetres moves the place at which the
    derivative is taken by 1e-3 of the range, the second order falls out of the difference; and twice what single
    precision leaves of a point at 3 m.
    """
    theta, phi = (grid.ravel() for grid in np.meshgrid(np.linspace(-0.3, 0.3, 4), np.linspace(-0.28, 0.3, 3)))
    found = []
    for sign in (1.0, -1.0):
        bench = Instrument(believing(wall(), tmp_path, {name: sign * STEP[name]}, [name]))
        found.append(bench.measure(bench.aim(theta, phi)))
    above, below = found
    for prefix in ("", "tof."):
        told = 0.5 * STEP[name] * (slopes_of(above, name, prefix) + slopes_of(below, name, prefix))
        keys = [*(f"{prefix}P.{axis}" for axis in "XYZ"), f"{prefix}range_m"]
        moved = 0.5 * np.stack([np.asarray(above[key], dtype=np.float64) - below[key] for key in keys])
        np.testing.assert_allclose(
            moved, told, rtol=0.0, atol=0.01 * np.abs(told).max() + 5e-7, err_msg=prefix or "triangulation"
        )


def test_a_voxel_without_a_range_has_no_derivatives() -> None:
    """Claim: NaN of every parameter, of those too that move no point, and the others' are what they are without it."""
    scanner = wall().scanner
    x, y, z = (np.array([[0.1, value, 0.3]]) for value in (np.nan, np.nan, np.nan))
    y[0, ::2], z[0, ::2] = [0.2, -0.1], [2.0, 3.0]
    layers = {"P.X": x, "P.Y": y, "P.Z": z, "range_m": np.where(np.isnan(x), np.nan, np.hypot(x, z))}
    geometry, design = geometry_of(scanner), design_of(scanner)
    ranges, points = derivatives(layers, "", ("triangulation",), geometry, unread(), design, PERIOD)
    known = np.array([True, False, True])
    assert np.isfinite(ranges[known]).all()
    assert np.isfinite(points[known]).all()
    assert np.isnan(ranges[~known]).all()
    assert np.isnan(points[~known]).all()
    alone = {name: values[:, ::2] for name, values in layers.items()}
    apart = derivatives(alone, "", ("triangulation",), geometry, unread(), design, PERIOD)
    np.testing.assert_array_equal(ranges[known], apart[0])
    np.testing.assert_array_equal(points[known], apart[1])
    (last,) = derivatives(layers, "", ("triangulation",), geometry, unread(), design, PERIOD, slice(2, 3))[0]
    np.testing.assert_array_equal(last, ranges[2])


@pytest.mark.parametrize("sigma_theta", [0.0, 2e-3])
def test_what_is_fused_has_the_mean_of_both_derivatives(sigma_theta: float) -> None:
    """Claim: by the shares of the least variance of triangulation and pulse, 0.8 and 0.2 where they are independent,
    range and point alike; of one alone where only it is valid. Errors of Θ are in both beside the laser: their
    covariance is that of difference quotients of both ranges."""
    scanner = wall().scanner
    geometry, design = replace(geometry_of(scanner), pulse_by="offset"), design_of(scanner)
    layers = {
        "P.X": np.array([[0.1, 0.2, -0.1]]),
        "P.Y": np.array([[0.2, -0.1, 0.3]]),
        "P.Z": np.full((1, 3), 2.0),
    }
    layers["range_m"] = np.sqrt(sum(layers[f"P.{axis}"] ** 2 for axis in "XYZ"))
    layers |= {"sigma_range_m": np.full((1, 3), 1e-3), "tof.sigma_range_m": np.full((1, 3), 2e-3)}
    layers |= {"status": np.array([[0, 1, 0]]), "tof.status": np.array([[0, 0, 1]])}
    mirrors: Any = SimpleNamespace(reading_sigma=lambda theta, _: np.full(theta.shape, sigma_theta))
    read = ReadingsOfTheta(mirrors, np.zeros(3), np.zeros(3))
    both = [derivatives(layers, "", by, geometry, read, design, PERIOD) for by in (
        ("triangulation", "offset"), ("triangulation",), ("offset",),
    )]  # fmt: skip
    (r, *_), d = layers["range_m"], geometry.baseline
    _, (theta, *_), _ = geometry.sight_of(*(layers[f"P.{axis}"][0] for axis in "XYZ"))
    way = r[0] + math.sqrt(r[0] ** 2 + d**2 - 2.0 * r[0] * d * math.sin(theta))
    tangent = d * math.cos(theta) / (r[0] - d * math.sin(theta))
    ends = [theta - 1e-6, theta + 1e-6]
    by_line, by_pulse = (
        (values[1] - values[0]) / 2e-6
        for values in (
            [d * math.cos(end) / tangent + d * math.sin(end) for end in ends],
            [(way**2 - d**2) / (2.0 * (way - d * math.sin(end))) for end in ends],
        )
    )
    shares = np.linspace(0.0, 1.0, 100_001)
    of_all = (1.0 - shares) ** 2 * 1e-6 + shares**2 * 4e-6
    of_all += 2.0 * shares * (1.0 - shares) * by_line * by_pulse * sigma_theta**2
    best = float(shares[np.argmin(of_all)])
    assert (best == pytest.approx(0.2)) is (sigma_theta == 0.0)
    for fused, one, other in zip(*both, strict=True):
        assert not np.allclose(one, other)
        for voxel, weights in enumerate(((1.0 - best, best), (0.0, 1.0), (1.0, 0.0))):
            near = 1e-12 if voxel else 1e-4
            np.testing.assert_allclose(
                fused[voxel], weights[0] * one[voxel] + weights[1] * other[voxel], rtol=near, atol=near
            )


def test_without_a_calibration_nobody_asks_for_the_errors_of_readings() -> None:
    """Claim: layers of an instrument as designed stay as they are without a look at σ of Θ."""
    layers: Any = {}
    add_common_errors(layers, ("triangulation", "tof"), geometry_of(wall().scanner), unread())
    assert layers == {}


def test_derivatives_without_a_calibration_are_refused() -> None:
    with pytest.raises(ScenarioError, match=r"Give processing\.calibration"):
        wall().replace({"output.jacobian": True})


def test_derivatives_of_a_track_are_refused() -> None:
    disc = {"target": "wall", "kind": "raised", "diameter": 0.1}
    scan = {"type": "track", "targets": [disc], "duration": 0.25}
    with pytest.raises(ScenarioError, match=r"output\.jacobian"):
        wall(**scan).replace({"output.jacobian": True, "ranging": "triangulation"})


def test_a_derivative_times_its_parameter_is_a_length() -> None:
    """Claim: of every layer, point and range, by the units that are written; and it says what it is a derivative of."""
    register: Any = pint.UnitRegistry()
    unit = {parameter.name: parameter.dimension.unit for parameter in PARAMETERS}
    for channel in DERIVATIVES:
        name, moved = channel.name.split("J.")[1].split(".")
        parts = [part.replace("-1", "^-1").replace("rad2", "rad^2") for part in channel.unit.split()]
        whole = register.parse_expression(" * ".join([*parts, unit[name]]))
        assert register.Quantity(whole).units == register.metre, channel.name
        of = "range_m" if moved == "R" else f"P.{moved}"
        assert f" {channel.prefix}{of}" in channel.meaning
