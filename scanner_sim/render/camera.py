"""The picture of an ordinary video camera at the scanner (Figure 1 of the paper): saturated whites, black shadows.

The scene under Sun and Earth, path-traced by Mitsuba from the scanner's origin over the field of view of the scan. Grey
like the cameras of the time: the surfaces reflect what they were loaded with, so hand over a scene
that was loaded with visible reflectances where they differ from those at the laser's wavelength.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.render.camera_settings import LEAST_FIELD, Camera
from scanner_sim.render.plugins.sky_emitter import register_orbit_sky
from scanner_sim.scene.files.loader import LoadedScene
from scanner_sim.scene.files.plugins import build_plugin

_PATHS_AT_ONCE = 2**20
_GLARE_WIDTH = 2.0
"""Half width of the bright core of the strewn light [pixel]."""


@dataclass(frozen=True)
class Photograph:
    """A picture: row 0 is the top (smallest φ), column 0 the left (smallest Θ).

    Attributes
    ----------
    grey
        What the camera shows, shape (rows, columns), uint8.
    linear
        Radiance times π in units of the Sun's irradiance, float32: 1 is a perfectly white wall that faces the Sun.
    """

    grey: NDArray[np.uint8]
    linear: NDArray[np.float32]


def photograph(
    loaded: LoadedScene,
    camera: Camera,
    horizontal: tuple[float, float],
    vertical: tuple[float, float],
    sun_direction: ArrayLike | None,
    sun_angular_radius: float,
    earth_direction: ArrayLike | None,
    earth_altitude: float = 400e3,
    earth_radius: float = 6371e3,
    seed: int = 0,
) -> Photograph:
    """Return what the camera sees.

    Parameters
    ----------
    loaded
        The scene; objects that move are not in the picture.
    camera
        The camera.
    horizontal, vertical
        First and last Θ and φ of the field of view [rad].
    sun_direction, sun_angular_radius, earth_direction, earth_altitude, earth_radius
        As in :func:`scanner_sim.render.background.sky.sky_light`. Without a Sun all is black.
    seed
        Seed of the paths. The same seed gives the same picture on any number of threads.

    Returns
    -------
    Photograph
        The picture.
    """
    left, right = _edges(horizontal)
    top, bottom = _edges(vertical)
    rows = max(1, round(camera.width * (bottom - top) / (right - left)))
    linear = np.zeros((rows, camera.width), dtype=np.float32)
    if sun_direction is not None:
        sky = {
            "type": "orbit_sky",
            "sun_direction": _listed(sun_direction),
            "sun_angular_radius": sun_angular_radius,
            "albedo": camera.albedo,
        }
        if earth_direction is not None:
            sky |= {
                "earth_direction": _listed(earth_direction),
                "earth_altitude": earth_altitude,
                "earth_radius": earth_radius,
            }
        scene = _lit_scene(loaded, sky)
        lower = (left, top)
        step = ((right - left) / camera.width, (bottom - top) / rows)
        linear = math.pi * _trace(scene, camera, linear.shape, lower, step, seed)
    return Photograph(develop(camera, linear), linear)


def develop(camera: Camera, linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the grey levels of a picture: exposure, glare, saturation, black level, gamma and steps.

    Parameters
    ----------
    camera
        The camera.
    linear
        Brightness, 1 for a white wall that faces the Sun, shape (rows, columns).

    Returns
    -------
    ndarray
        Grey levels 0 to 255, uint8.
    """
    from scipy.signal import fftconvolve

    exposed = camera.exposure * linear.astype(np.float64)
    if camera.glare > 0.0:
        strewn = fftconvolve(exposed, _glare_kernel(*exposed.shape), mode="same")
        exposed = (1.0 - camera.glare) * exposed + camera.glare * np.maximum(strewn, 0.0)
    black = 2.0**-camera.stops
    signal = np.clip((exposed - black) / (1.0 - black), 0.0, 1.0) ** (1.0 / camera.gamma)
    steps = 2**camera.bits - 1
    grey: NDArray[np.uint8] = np.rint(255.0 / steps * np.rint(steps * signal)).astype(np.uint8)
    return grey


def _edges(angles: tuple[float, float]) -> tuple[float, float]:
    """Return the ends of the picture in the plane at unit distance; a line gets some width."""
    first, last = angles
    if last - first < LEAST_FIELD:
        middle = 0.5 * (first + last)
        first, last = middle - 0.5 * LEAST_FIELD, middle + 0.5 * LEAST_FIELD
    return math.tan(first), math.tan(last)


def _listed(direction: ArrayLike) -> list[float]:
    return [float(entry) for entry in np.ravel(direction)]


def _lit_scene(loaded: LoadedScene, sky: dict[str, Any]) -> mi.Scene:
    """Return the scene's shapes under the sky."""
    register_orbit_sky()
    shapes = {f"shape_{number}": shape for number, shape in enumerate(loaded.mitsuba.shapes())}
    scene: mi.Scene = build_plugin({"type": "scene", "sky": sky, **shapes})
    return scene


def _trace(
    scene: mi.Scene,
    camera: Camera,
    shape: tuple[int, int],
    lower: tuple[float, float],
    step: tuple[float, float],
    seed: int,
) -> NDArray[np.float32]:
    """Return the mean radiance of every pixel.

    Pixels are added up here: a Mitsuba film adds with atomic operations, in an order that no run repeats.
    """
    integrator: Any = build_plugin({"type": "path", "max_depth": camera.bounces + 1})
    # Stratified, so that the emitter's choice between Sun and Earth is no source of noise.
    sampler: Any = build_plugin({"type": "multijitter", "sample_count": camera.samples})
    samples = sampler.sample_count()
    sampler.set_samples_per_wavefront(samples)
    rows, columns = shape
    pixels, batch = rows * columns, max(1, _PATHS_AT_ONCE // samples)
    found = np.empty(pixels, dtype=np.float32)
    for turn, start in enumerate(range(0, pixels, batch)):
        count = min(batch, pixels - start)
        sampler.seed(seed + 0x9E3779B1 * turn & 0xFFFFFFFF, count * samples)
        pixel = dr.arange(mi.UInt32, count * samples) // samples + dr.opaque(mi.UInt32, start)
        row = pixel // columns
        jitter, column = sampler.next_2d(), pixel - row * columns
        x = dr.opaque(mi.Float, lower[0]) + (mi.Float(column) + jitter.x) * dr.opaque(mi.Float, step[0])
        y = dr.opaque(mi.Float, lower[1]) + (mi.Float(row) + jitter.y) * dr.opaque(mi.Float, step[1])
        ray = mi.Ray3f(mi.Point3f(0.0), dr.normalize(mi.Vector3f(x, y, 1.0)))
        radiance = integrator.sample(scene, sampler, ray)[0][0]
        found[start : start + count] = (dr.block_sum(radiance, samples) / samples).numpy()
    return found.reshape(shape)


def _glare_kernel(rows: int, columns: int) -> NDArray[np.float64]:
    """Return strewn light that falls off with the cube of the distance, normalised, twice the picture's size."""
    y, x = np.ogrid[-rows : rows + 1, -columns : columns + 1]
    kernel: NDArray[np.float64] = (1.0 + (x**2 + y**2) / _GLARE_WIDTH**2) ** -1.5
    kernel /= kernel.sum()
    return kernel
