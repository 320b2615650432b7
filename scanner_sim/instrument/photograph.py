"""The video camera at work: light, sensor and exposure control make frames of a scene."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.frame.exposure import AutomaticExposure
from scanner_sim.detector.frame.glare import PointLight, strewn
from scanner_sim.detector.frame.sensor import FrameSensor, expose, pattern_of
from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.foundation.constants import PLANCK, SPEED_OF_LIGHT
from scanner_sim.foundation.errors import InputError
from scanner_sim.optics.band_irradiance import band_irradiance
from scanner_sim.optics.pixel_window import NOWHERE, PixelWindow
from scanner_sim.products.frames import Frames, FrameTruth, shown
from scanner_sim.render.background.sky import light_of
from scanner_sim.render.device import activate
from scanner_sim.render.frame.lens_table import pixel_view_factors
from scanner_sim.render.frame.light import FrameTracer, frame_light
from scanner_sim.render.frame.optics import FrameOptics, is_hidden
from scanner_sim.render.frame.window_light import window_light
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scene.files.loader import LoadedScene, load_scene
from scanner_sim.scene.light.lighting import Lighting, Sky, Sun

Floats = NDArray[np.float64]
Look = Callable[[], PixelWindow | None]

_AT_ONCE = 16
"""Most frames whose light is followed in one go: 50 MB of results for 640 × 480 pixels."""
_MOST_FRAMES = 100_000
_INSTANT, _GLANCE = 1e-6, (4, 4)
"""Exposure [s] and paths with which the control looks at the first frame's light."""


def photograph(
    loaded: LoadedScene,
    camera: VideoCamera,
    lighting: Lighting,
    times: ArrayLike,
    *,
    seed: int = 0,
    mounts: ArrayLike | None = None,
) -> Frames:
    """Return frames of a scene.

    Parameters
    ----------
    loaded
        The scene, loaded with ``load_scene(scene, band="visible")``.
    camera
        The camera.
    lighting
        Sun and Earth; without a Sun frames hold dark current and noise.
    times
        When the exposures begin [s], ascending, shape (frames,); a fixed time apart where the exposure is automatic.
    seed
        Seed of paths, noise and the sensor's pattern. The same seed gives the same bytes, on any number of threads.
    mounts
        Poses of the camera in the scanner's frame as they are believed, shape (frames, 4, 4), in the place of
        ``camera.mount``: a camera that moves from frame to frame, and rests during each.

    Returns
    -------
    Frames

    Raises
    ------
    InputError
        If there are no frames, too many, or times that do not ascend; or if poses are not as many.
    """
    parts = list(frames_in_turn(loaded, camera, lighting, times, seed=seed, mounts=mounts))
    joined = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in (
            "counts", "saturated", "exposure_s", "time_s", "available_s", "sample_sigma", "noise_share"
        )
    }  # fmt: skip
    electrons, where = (
        np.concatenate([getattr(part.truth, name) for part in parts])
        for name in ("electrons", "scanner_from_camera")
    )
    return Frames(**joined, truth=FrameTruth(electrons, where), notes=loaded.notes)


def frames_in_turn(
    loaded: LoadedScene,
    camera: VideoCamera,
    lighting: Lighting,
    times: ArrayLike,
    *,
    seed: int = 0,
    mounts: ArrayLike | None = None,
    look: Look | None = None,
) -> Iterator[Frames]:
    """Yield the frames of :func:`photograph` one by one, for those who keep none; arguments and errors as there.

    ``look`` is called before each frame for the window of it that its receiver looks at, None for all. Beyond it light
    is followed coarsely, and ``sample_sigma`` is infinite.
    """
    begins = _ascending(times)
    poses = (
        np.broadcast_to(camera.scanner_from_camera, (len(begins), 4, 4))
        if mounts is None
        else np.asarray(mounts)
    )
    if poses.shape != (len(begins), 4, 4):
        raise InputError(
            f"{len(begins)} frames need as many poses of the camera; these have shape {poses.shape}."
        )
    stage = _Stage.of(loaded, camera, lighting, seed)
    true = poses @ camera.error_of_mount
    for number, part in enumerate(_taken(stage, begins, true, look)):
        begin = begins[number : number + 1]
        yield Frames(
            counts=part.counts,
            saturated=part.saturated,
            exposure_s=part.exposure,
            time_s=begin + 0.5 * part.exposure,
            available_s=begin + part.exposure + camera.latency,
            sample_sigma=part.sigma,
            noise_share=part.share,
            truth=FrameTruth(part.electrons, true[number : number + 1]),
            notes=loaded.notes,
        )


@guest()
def take_frames(
    scenario: Scenario, frames: int, *, start: float = 0.0, device: DeviceChoice = "auto"
) -> Frames:
    """Return frames of a scenario's video camera, one after the other at its frame rate.

    Parameters
    ----------
    scenario
        Scene, lighting and camera; its scan is not looked at.
    frames
        How many.
    start
        When the first begins, since the start of the scan [s].
    device
        Where to compute.

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the device cannot be used, or there are no frames or too many.
    """
    if not 1 <= frames <= _MOST_FRAMES:
        raise InputError(f"{frames} frames cannot be taken; 1 to {_MOST_FRAMES:,} are possible.")
    activate(device)
    loaded = load_scene(scenario.scene, band="visible")
    times = start + np.arange(frames) / scenario.camera.frame_rate
    return photograph(loaded, scenario.camera, scenario.lighting, times, seed=scenario.seed)


def take_photo(scenario: Scenario, *, device: DeviceChoice = "auto") -> NDArray[np.uint8]:
    """Return what a screen shows of the frame that a scenario's video camera takes at time 0.

    Parameters
    ----------
    scenario
        Scene, lighting and camera.
    device
        Where to compute.

    Returns
    -------
    ndarray
        Grey levels 0 to 255, shape (rows, columns), uint8.

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the device cannot be used.
    """
    return shown(take_frames(scenario, 1, device=device).counts[0], scenario.camera.sensor)


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


class _Part(NamedTuple):
    """One frame or several; see :class:`~scanner_sim.products.frames.Frames`."""

    counts: NDArray[np.uint16]
    saturated: NDArray[np.bool_]
    exposure: Floats
    electrons: NDArray[np.float32]
    sigma: NDArray[np.float32]
    share: Floats


class _Shots(NamedTuple):
    """Frames that are followed in one go: when and how long they are exposed, poses, number of the first, window."""

    begins: Floats
    exposures: Floats
    poses: Floats
    first: int
    window: PixelWindow | None


@dataclass(frozen=True)
class _Stage:
    """All that is the same for all frames."""

    loaded: LoadedScene
    camera: VideoCamera
    lighting: Lighting
    optics: FrameOptics
    rates: Floats
    seed: int

    @classmethod
    def of(cls, loaded: LoadedScene, camera: VideoCamera, lighting: Lighting, seed: int) -> _Stage:
        sun = Sun() if lighting.sun == "none" else lighting.sun
        optics = FrameOptics.of(camera.true_interior, camera.lens.point_spread)
        return cls(loaded, camera, lighting, optics, electron_rates(camera, sun), seed)

    @property
    def stands(self) -> bool:
        """Whether Sun and Earth are the same for all frames."""
        return not (self.lighting.runs or self.lighting.changes)

    def lit(self, shot: _Shots, samples: tuple[int, int]) -> tuple[Floats, Floats]:
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


def _taken(stage: _Stage, begins: Floats, poses: Floats, look: Look | None) -> Iterator[_Part]:
    """Yield frames, as many at a time as wait neither for one another's exposures nor for their receiver."""
    camera = stage.camera
    pattern = pattern_of(camera.sensor, stage.rates.shape, stage.seed)
    control = camera.exposure if isinstance(camera.exposure, AutomaticExposure) else None
    together = min(_AT_ONCE, len(begins) if control is None else control.lag)
    together = together if look is None and stage.stands else 1
    exposures: list[float] = []
    levels: list[float] = []
    samples = (camera.sampling.samples, camera.sampling.edge_samples)
    for start in range(0, len(begins), together):
        chosen = slice(start, min(start + together, len(begins)))
        window = None if look is None else look()
        if not start:
            roughly = None if window is None else NOWHERE
            at_first = _Shots(begins[:1], np.array([_INSTANT]), poses[:1], 0, roughly)
            first = _first_exposure(stage, at_first)
        for number in range(chosen.start, chosen.stop):
            seen = number - (1 if control is None else control.lag)
            exposures.append(
                first if control is None or seen < 0 else control.following(exposures[seen], levels[seen])
            )
        times = np.array(exposures[chosen])
        rates, variances = stage.lit(_Shots(begins[chosen], times, poses[chosen], start, window), samples)
        for number, (rate, variance) in enumerate(zip(rates, variances, strict=True), start):
            time = exposures[number]
            made = expose(camera.sensor, rate, time, pattern, stage.seed, number)
            if control is not None:
                levels.append(control.level(camera.sensor, made.counts))
            noise, followed = camera.sensor.variance(np.asarray(rate * time), time), np.isfinite(variance)
            yield _Part(
                made.counts[None],
                made.saturated[None],
                np.array([time]),
                (rate * time).astype(np.float32)[None],
                (np.sqrt(variance) * time).astype(np.float32)[None],
                np.array([variance[followed].mean() * time**2 / noise[followed].mean()]),
            )


def _first_exposure(stage: _Stage, shot: _Shots) -> float:
    """Return the exposure of the first frames [s], from a glance at the first of them."""
    own = stage.camera.exposure
    if not isinstance(own, AutomaticExposure):
        return own.time
    if own.start is not None:
        return min(max(own.start, own.shortest), own.longest)
    rate, _ = stage.lit(shot, _GLANCE)
    return own.settled(stage.camera.sensor, rate[0])


def _ascending(times: ArrayLike) -> Floats:
    begins = np.atleast_1d(np.asarray(times, dtype=np.float64))
    if begins.ndim != 1 or not begins.size or not np.isfinite(begins).all() or (np.diff(begins) <= 0.0).any():
        raise InputError("frames need times that ascend, shape (frames,), and one at least.")
    return begins
