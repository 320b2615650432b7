"""What stands still before a video camera: scene, lens and light, and the charge that they bring to its pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scanner_sim.detector.frame.glare import PointLight, strewn
from scanner_sim.detector.frame.sensor import FrameSensor
from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.foundation.constants import PLANCK, SPEED_OF_LIGHT
from scanner_sim.optics.band_irradiance import band_irradiance
from scanner_sim.optics.pixel_window import PixelWindow
from scanner_sim.render.background.sky import light_of
from scanner_sim.render.frame.lens_table import pixel_view_factors
from scanner_sim.render.frame.light import FrameTracer, frame_light
from scanner_sim.render.frame.optics import FrameOptics, is_hidden
from scanner_sim.render.frame.window_light import window_light
from scanner_sim.scene.files.loader import LoadedScene
from scanner_sim.scene.light.lighting import Lighting, Sky, Sun

Floats = NDArray[np.float64]


class Shots(NamedTuple):
    """Frames that are followed in one go: when and how long they are exposed, poses, number of the first, window."""

    begins: Floats
    exposures: Floats
    poses: Floats
    first: int
    window: PixelWindow | None


@dataclass(frozen=True)
class Stage:
    """All that is the same for all frames: scene, camera, Sun and Earth, seed, and what follows from them."""

    loaded: LoadedScene
    camera: VideoCamera
    lighting: Lighting
    optics: FrameOptics
    rates: Floats
    seed: int

    @classmethod
    def of(cls, loaded: LoadedScene, camera: VideoCamera, lighting: Lighting, seed: int) -> Stage:
        """Return the stage of a camera before a scene."""
        sun = Sun() if lighting.sun == "none" else lighting.sun
        optics = FrameOptics.of(camera.true_interior, camera.lens.point_spread)
        return cls(loaded, camera, lighting, optics, electron_rates(camera, sun), seed)

    @property
    def stands(self) -> bool:
        """Whether Sun and Earth are the same for all frames."""
        return not (self.lighting.runs or self.lighting.changes)

    def lit(self, shot: Shots, samples: tuple[int, int]) -> tuple[Floats, Floats]:
        """Return mean photo-electrons per second of frames behind the lens, and their variance by samples.

        Sun and Earth stand where they are when the first of the frames begins.
        """
        sky = self.lighting.sky(float(shot.begins[0]))
        if sky.dark:
            nothing = np.zeros((len(shot.begins), *self.rates.shape))
            return nothing, nothing
        view = self.optics.view(self.loaded, shot.poses, shot.begins, shot.exposures, max(samples))
        tracer = FrameTracer(
            self.loaded,
            light_of(sky, visible=True),
            view,
            shot.first,
            self.camera.sampling.bounces,
            self.seed,
        )
        found = (
            frame_light(tracer, samples)
            if shot.window is None
            else window_light(tracer, samples, shot.window)
        )
        centre, glare = self.camera.true_interior.centre, self.camera.lens.glare
        sharp = found.radiance * self.rates
        beside = [self._sun_beside(sky, *one) for one in zip(shot.begins, shot.poses, strict=True)]
        rate = np.stack([strewn(glare, one, centre, sun) for one, sun in zip(sharp, beside, strict=True)])
        variance = found.variance.astype(np.float64)
        return rate, variance * np.square((1.0 - glare.veil - glare.ghost) * self.rates)

    def _sun_beside(self, sky: Sky, begin: float, pose: Floats) -> PointLight | None:
        """Return the Sun where it shines onto the lens, but not into the frame."""
        sun = sky.sun_direction
        if sun is None or self.camera.lens.glare.veil == 0.0 or sky.sun_visible == 0.0:
            return None
        interior = self.camera.true_interior
        towards = pose[:3, :3].T @ sun
        u, v = interior.project(towards)
        reach = sky.sun_angular_radius * interior.scale
        ends = np.array([interior.columns, interior.rows]) - 0.5 + reach
        inside = -0.5 - reach < u < ends[0] and -0.5 - reach < v < ends[1]
        if inside or not np.isfinite(u + v):
            return None
        if is_hidden(self.loaded, pose[:3, 3], sun, begin):
            return None
        return PointLight((float(u), float(v)), sky.sun_visible * self._sun_rate(float(towards[2])))

    def _sun_rate(self, cosine: float) -> float:
        """Return the electrons per second of the whole image of the whole Sun at a cosine to the lens's axis."""
        middle = np.unravel_index(np.argmax(self.rates), self.rates.shape)
        factors = pixel_view_factors(self.camera.true_interior)
        return float(self.rates[middle] / factors[middle] * cosine)


def photon_irradiance(sun: Sun, sensor: FrameSensor) -> float:
    """Return the photons of the Sun in the sensor's band on a plate that faces it [1/s/m²]: ∫ E λ/(hc) dλ."""
    reference = 550e-9
    _, equivalent = band_irradiance(sun, "none", sensor.band, reference)
    return float(equivalent) * reference / (PLANCK * SPEED_OF_LIGHT)


def electron_rates(camera: VideoCamera, sun: Sun) -> Floats:
    """Return the photo-electrons per second of each pixel for a radiance of 1/sr per unit of the Sun's irradiance.

    Φ η T A cosθ dΩ, with Φ the Sun's photons, η the quantum efficiency, T the transmission, A = π (f/2N)² the entrance
    pupil; shape (rows, columns). In an even image π L/(4N²) cos⁴θ p² (Horn, *Robot vision*, section 10.3).
    """
    interior = camera.true_interior
    pupil = 0.25 * np.pi * (interior.focal_length / camera.lens.f_number) ** 2
    gain = photon_irradiance(sun, camera.sensor) * camera.sensor.quantum_efficiency * camera.lens.transmission
    return gain * pupil * pixel_view_factors(interior)
