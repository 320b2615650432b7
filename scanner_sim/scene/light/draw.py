"""Sun and Earth drawn as an orbit may have them: together possible, and as often as the years bring them."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation as Turned

from scanner_sim.scene.light.lighting import Lighting
from scanner_sim.scene.light.orbit import OBLIQUITY
from scanner_sim.scene.poses import Rotation


def draw_lightings(
    lighting: Lighting, count: int, seed: int, *, any_attitude: bool = False
) -> Iterator[Lighting]:
    """Yield the lighting of a circular orbit at moments drawn from many years of it.

    The node, which precesses, the Sun's longitude and the place on the orbit are drawn evenly and independently;
    altitude and inclination stay. Where an orbit is held to the Sun, its node is not even: let ``anomaly`` vary alone.

    Parameters
    ----------
    lighting
        With an ``orbit``.
    count
        Number of moments.
    seed
        Of the draws.
    any_attitude
        Whether the scanner is turned anyhow, all attitudes alike, and not as the orbit says.

    Yields
    ------
    Lighting
        Its ``sky()`` has both directions in the scanner's frame and the share of the Sun that the Earth leaves
        visible; ``scenario.replace({"lighting": lighting})`` puts it into a scenario.

    Raises
    ------
    ValueError
        If the lighting has no ``orbit``.
    """
    orbit = lighting.orbit
    if orbit is None:
        raise ValueError("this lighting has no orbit")
    rng = np.random.default_rng(seed)
    node, longitude, anomaly = rng.uniform(-math.pi, math.pi, (3, count))
    turns = Turned.random(count, rng).as_rotvec() if any_attitude else np.zeros((count, 3))
    beta = beta_angles(orbit.inclination, node, longitude)
    for number in range(count):
        attitude = orbit.attitude
        if any_attitude:
            angle = float(np.linalg.norm(turns[number]))
            x, y, z = (turns[number] / angle).tolist()
            attitude = attitude.changed(rotation=Rotation(axis=(x, y, z), angle=angle))
        moved = orbit.changed(beta=float(beta[number]), anomaly=float(anomaly[number]), attitude=attitude)
        yield lighting.changed(orbit=moved)


def beta_angles(
    inclination: float, node: NDArray[np.float64], longitude: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return angles from an orbit's plane to the Sun [rad], positive to its normal; shape of ``node``.

    sin β is the product of the normal (sin i sin Ω, −sin i cos Ω, cos i) and the direction to the Sun,
    (cos λ, cos ε sin λ, sin ε sin λ).

    Parameters
    ----------
    inclination, node, longitude
        i, right ascension Ω of the ascending node and the Sun's ecliptic longitude λ [rad].
    """
    tilt, up = math.cos(OBLIQUITY), math.sin(OBLIQUITY)
    sine = math.sin(inclination) * (
        np.sin(node) * np.cos(longitude) - np.cos(node) * tilt * np.sin(longitude)
    ) + math.cos(inclination) * up * np.sin(longitude)
    return np.asarray(np.arcsin(np.clip(sine, -1.0, 1.0)))
