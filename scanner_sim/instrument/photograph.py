"""The video camera at work: light, sensor and exposure control make frames of a scene."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.frame.exposure import AutomaticExposure
from scanner_sim.detector.frame.sensor import expose, pattern_of
from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.frame_stage import Shots, Stage
from scanner_sim.optics.pixel_window import NOWHERE, PixelWindow
from scanner_sim.products.frames import Frames, FrameTruth, shown
from scanner_sim.render.device import activate
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scene.files.loader import LoadedScene, load_scene
from scanner_sim.scene.light.lighting import Lighting
from scanner_sim.scene.visible import unknown_visible

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
    return Frames(**joined, truth=FrameTruth(electrons, where), notes=parts[0].notes)


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
    stage = Stage.of(loaded, camera, lighting, seed)
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
            notes=(*loaded.notes, *map(unknown_visible, loaded.unknown_visible)),
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


class _Part(NamedTuple):
    """One frame or several; see :class:`~scanner_sim.products.frames.Frames`."""

    counts: NDArray[np.uint16]
    saturated: NDArray[np.bool_]
    exposure: Floats
    electrons: NDArray[np.float32]
    sigma: NDArray[np.float32]
    share: Floats


def _taken(stage: Stage, begins: Floats, poses: Floats, look: Look | None) -> Iterator[_Part]:
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
            at_first = Shots(begins[:1], np.array([_INSTANT]), poses[:1], 0, roughly)
            first = _first_exposure(stage, at_first)
        for number in range(chosen.start, chosen.stop):
            seen = number - (1 if control is None else control.lag)
            exposures.append(
                first if control is None or seen < 0 else control.following(exposures[seen], levels[seen])
            )
        times = np.array(exposures[chosen])
        rates, variances = stage.lit(Shots(begins[chosen], times, poses[chosen], start, window), samples)
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


def _first_exposure(stage: Stage, shot: Shots) -> float:
    """Return the exposure of the first frames [s], from a glance at the first of them."""
    own = stage.camera.exposure
    if not isinstance(own, AutomaticExposure):
        return own.time
    if own.start is not None:
        return own.start
    rate, _ = stage.lit(shot, _GLANCE)
    return own.settled(stage.camera.sensor, rate[0])


def _ascending(times: ArrayLike) -> Floats:
    begins = np.atleast_1d(np.asarray(times, dtype=np.float64))
    if begins.ndim != 1 or not begins.size or not np.isfinite(begins).all() or (np.diff(begins) <= 0.0).any():
        raise InputError("frames need times that ascend, shape (frames,), and one at least.")
    return begins
