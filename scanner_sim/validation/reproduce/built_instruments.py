"""Figures 12, 13 and 15 again, with an instrument that is uncalibrated, calibrated and perfect.

The tolerances (``tolerances.yaml``) stood before the figures. One instrument is drawn from them and calibrates itself
on the shipped field, through light, detector and estimator; what is left of its errors is the covariance of that
calibration. What errors of the instrument do to ranges and poses follows from the derivatives that the products
themselves have; the judge has geometry of its own (:mod:`scanner_sim.analytic.instrument_errors`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scanner_sim.analytic.instrument_errors import EFFECTS, Sighted
from scanner_sim.calibration.plan import Tolerances
from scanner_sim.calibration.selfcal import self_calibrate
from scanner_sim.calibration.setup import Setup, read_setup
from scanner_sim.calibration.simulated import simulated_sightings
from scanner_sim.config.calibration import calibration_text
from scanner_sim.config.document import read_document
from scanner_sim.config.load import load_scenario
from scanner_sim.foundation.errors import ScenarioError
from scanner_sim.foundation.parameters import INDEX, NAMES, PARAMETERS
from scanner_sim.pose.estimate import estimate_pose
from scanner_sim.pose.target_layouts import square
from scanner_sim.pose.transforms import vector_from_rotation
from scanner_sim.ranging.calibration import Calibration, position_in_common
from scanner_sim.ranging.coordinates import angles_and_range
from scanner_sim.validation.reproduce.bench import BASE, FOCAL, SEPARATION
from scanner_sim.validation.reproduce.item import Task

Array = NDArray[np.float64]
Kind = Literal["perfect", "calibrated", "uncalibrated"]
Method = Literal["uv", "xyz", "joint"]

KINDS: tuple[Kind, ...] = ("perfect", "calibrated", "uncalibrated")
FILE = "tolerances.yaml"
"""The tolerances, beside this module."""
SERIAL = 7
"""Serial number of the instrument that is drawn: that of the shipped field's own."""
SQUARE = square(1.0).points
"""The array of Figure 15 [m], shape (4, 3)."""
_STEP = 0.1
"""Standard deviations by which readings are moved for the derivatives of a pose."""


def tolerances() -> Tolerances:
    """Return σ of each parameter as built: limits over √3 (JCGM 100:2008, 4.3.7).

    Raises
    ------
    ScenarioError
        If the file is no YAML.
    """
    document = read_document(files(__package__).joinpath(FILE).read_text(encoding="utf-8"))
    if document.faults or not isinstance(document.data, dict):
        raise ScenarioError(document.faults, source=FILE)
    listed: dict[str, Mapping[str, object]] = document.data["parameters"]  # type: ignore[assignment]
    limits = Tolerances.model_validate({name: entry["limit"] for name, entry in listed.items()})
    return limits.model_copy(update={name: value / math.sqrt(3.0) for name, value in limits.given.items()})


def built_text(sigma: Tolerances) -> str:
    """Return ``scanner.as_built`` of the instrument that is drawn from tolerances, as YAML in one line."""
    spelt = (
        f"{name}: {{tolerance: {PARAMETERS[INDEX[name]].dimension.format(value)}}}"
        for name, value in sigma.given.items()
    )
    return f"{{seed: {SERIAL}, {', '.join(spelt)}}}"


@dataclass(frozen=True, eq=False)
class BuiltInstruments:
    """One instrument, and what is believed of it.

    Attributes
    ----------
    built, true
        It as a scenario has it, and its true parameters, shape (parameters,).
    calibration
        Its calibration as a file, which names its design.
    believed
        Calibrations by kind: nothing known but the tolerances, the self-calibration, and everything known.
    """

    built: str
    true: Array
    calibration: str
    believed: Mapping[Kind, Calibration]


@cache
def built_instruments(task: Task) -> BuiltInstruments:
    """Return the instrument of a task, calibrated on the shipped field of two boards and four stations."""
    shipped, sigma = read_setup(task.config("calibration/two_boards")), tolerances()
    built = built_text(sigma)
    base = load_scenario(shipped.plan.base, [f"scanner.as_built={built}"])
    plan = shipped.plan.model_copy(update={"parameters": sigma, "seed": task.seed})
    setup = replace(shipped, plan=plan, base=base)
    sightings, _ = simulated_sightings(setup, device=task.device)
    found = self_calibrate(setup, sightings).calibration
    as_built = base.scanner.as_built
    if as_built is None:
        raise AssertionError("the instrument of the field departs from its design")
    return BuiltInstruments(
        built,
        as_built.parameters(base.seed),
        calibration_text(found, base.scanner, "two boards, four stations"),
        {
            "perfect": _known_to(setup, np.zeros(len(NAMES))),
            "calibrated": replace(found, values=np.zeros(len(NAMES))),
            "uncalibrated": _known_to(setup, np.array([sigma.given.get(name, 0.0) for name in NAMES])),
        },
    )


def _known_to(setup: Setup, sigma: Array) -> Calibration:
    return Calibration(np.zeros(len(NAMES)), np.diag(sigma**2), setup.design)


def estimator_of(points: Array, distance: float, method: Method, sigma: Sequence[float]) -> Array:
    """Return the derivatives of a facing array's pose by what is measured of its targets.

    Parameters
    ----------
    points
        Targets of the array [m], shape (n, 3).
    distance
        Of its origin, on the axis [m].
    method
        As of :func:`~scanner_sim.pose.estimate.estimate_pose`; ``xyz`` with equal weights, as eq 11 has it.
    sigma
        Standard deviations of Θ, φ [rad] and R [m], by which the targets count.

    Returns
    -------
    ndarray
        Of (t, ω) by (Θ, φ, R) of each target, shape (6, n, 3), by central differences.
    """
    truth = sighted_at(points, distance)
    steps = _STEP * np.asarray(sigma)
    moves = np.eye(truth.size).reshape(truth.size, *truth.shape) * steps
    readings = truth + np.concatenate([moves, -moves])
    found = estimate_pose(
        points,
        readings[..., 0],
        readings[..., 1],
        None if method == "uv" else readings[..., 2],
        sigma_theta=sigma[0],
        sigma_phi=sigma[1],
        sigma_range=None if method == "uv" else sigma[2],
        axis_separation=SEPARATION,
        method=method,
        point_weights="equal" if method == "xyz" else "covariance",
    )
    pose = np.concatenate([found.position, vector_from_rotation(found.rotation)], axis=1)
    up, down = pose.reshape(2, *truth.shape, 6)
    return np.moveaxis((up - down) / (2.0 * steps[:, None]), -1, 0)


def sighted_at(points: Array, distance: float) -> Array:
    """Return true (Θ, φ, R) of the targets of a facing array on the axis [rad, m], shape (n, 3)."""
    x, y, z = (points + np.array([0.0, 0.0, distance])).T
    r, theta, phi = angles_and_range(x, y, z, SEPARATION)
    return np.stack([theta, phi, r], axis=-1)


def pose_sigma(estimator: Array, own: Sequence[float], shared: Array) -> Array:
    """Return σ of (t, ω), shape (6,).

    ``estimator`` from :func:`estimator_of`; ``own`` standard deviations of (Θ, φ, R) that each target has for itself;
    ``shared`` what k errors of unit variance do to all of them, shape (n, 3, k).
    """
    alone = np.einsum("anq,q->a", estimator**2, np.asarray(own) ** 2)
    together = np.einsum("anq,nqk->ak", estimator, shared)
    return np.asarray(np.sqrt(alone + (together**2).sum(axis=1)))


def shared_errors(believed: Calibration, points: Array, distance: float) -> Array:
    """Return what the errors of a calibration do to (Θ, φ, R) of an array's targets, shape (n, 3, k)."""
    return position_in_common(believed, "triangulation", sighted_at(points, distance))


def closed_effects(points: Array, distance: float) -> Array:
    """Return the judge's errors of the points of an array per value of each parameter, shape (n, 3, parameters)."""
    theta, phi, r = sighted_at(points, distance).T
    seen = Sighted(r, theta, phi, FOCAL, BASE, SEPARATION)
    none = np.zeros((len(r), 3))
    own = EFFECTS["triangulation"]
    return np.stack([own[name](seen) if name in own else none for name in NAMES], axis=-1)


def closed_depth(
    points: Array, distance: float, method: Method, sigma: Sequence[float], covariance: Array
) -> float:
    """Return σ of the depth of a facing square by errors of its instrument, to first order [m].

    Points: the mean of δz. Angles, each weighted by w = 1/σ²: −R² Σ(w_Θ x δΘ + w_φ y δφ)/Σ(w_Θ x² + w_φ y²)
    (:mod:`scanner_sim.analytic.pose`), with z′ = z − D_g, ρ² = y² + z′², tan Θ = x/(ρ + D_g), tan φ = y/z′.
    """
    effects = closed_effects(points, distance)
    if method == "xyz":
        depth = effects[:, 2].mean(axis=0)
    else:
        (x, y, z), (dx, dy, dz) = points.T[..., None], np.moveaxis(effects, 1, 0)
        z = z + distance - SEPARATION
        off = np.hypot(y, z)
        theta = ((off + SEPARATION) * dx - x * (y * dy + z * dz) / off) / (x**2 + (off + SEPARATION) ** 2)
        phi = (z * dy - y * dz) / off**2
        wide, high = (1.0 / one**2 for one in sigma[:2])
        moved = (wide * x * theta + high * y * phi).sum(axis=0)
        depth = -(distance**2) * moved / (wide * x**2 + high * y**2).sum()
    return float(np.sqrt(depth @ covariance @ depth))
