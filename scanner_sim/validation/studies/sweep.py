"""One orbit, swept: the conditions of Table 1 for each target, from geometry and light."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config import resolved_yaml
from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.line.exposure import electrons_per_watt
from scanner_sim.foundation.errors import InputError
from scanner_sim.instrument.instrument import Instrument
from scanner_sim.products.timeline import ConditionGroup, Label, TargetTimeline, Timeline
from scanner_sim.ranging.coordinates import angles_and_range
from scanner_sim.ranging.triangulation import position_from_range
from scanner_sim.render.background import illumination as light
from scanner_sim.render.background.illumination import Sight, SurfaceSamples, half_height, visible_samples
from scanner_sim.render.background.sky import light_of
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.scene.light.lighting import Sky, orbit_times
from scanner_sim.scene.objects import TargetArray
from scanner_sim.validation.studies.conditions import ESTIMATES, Condition, classify

Progress = Callable[[int, int], None]
"""Called with the moments done and the moments in all."""

POINTS = 600
"""Largest number of points on what the scanner sees of a target."""
GRID = (96, 128)
"""Lines of sight over the field of view, down and across."""


@guest()
def sweep_orbit(
    scenario: Scenario, steps: int = 90, *, device: DeviceChoice = "auto", progress: Progress | None = None
) -> Timeline:
    """Follow the light on each target along one orbit.

    Targets are the scenario's target arrays or, where it has none, all of its objects. The scene stands still
    before the scanner; Sun and Earth go round.

    Parameters
    ----------
    scenario
        With an orbit in its lighting.
    steps
        Evenly spaced moments.
    device
        Where to compute.
    progress
        Called after each moment.

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the lighting has no orbit or cannot be followed all along it, if there is nothing to look at, or the
        device cannot be used.
    """
    period = scenario.lighting.period
    if period is None:
        raise InputError(
            "the scenario has no orbit to sweep.",
            remedy="Write lighting: {orbit: {altitude: 400 km, beta: 30 deg}}, or tle with line1, line2 and time.",
        )
    if steps < 1:
        raise InputError("an orbit needs at least one step.")
    times = orbit_times(scenario.lighting, steps)
    try:
        skies = [scenario.lighting.sky(float(after)) for after in times]
    except ValueError as error:
        raise InputError(f"the orbit cannot be followed: {error}.", remedy="Use newer elements.") from None
    stage = _Stage(scenario, device)
    moments = []
    for step, sky in enumerate(skies):
        moments.append(stage.look(sky))
        if progress is not None:
            progress(step + 1, steps)
    visible = np.array([sky.sun_visible for sky in skies])
    in_view = np.array([moment.in_view for moment in moments])
    brightest = np.array([moment.brightest for moment in moments])
    full_well = scenario.scanner.position_sensor.full_well
    tracks = []
    for number, name in enumerate(stage.names):
        lit, earth, background, behind = (
            np.array([moment.targets[number][entry] for moment in moments]) for entry in range(4)
        )
        condition = classify(visible, in_view, brightest, full_well, lit)
        tracks.append(TargetTimeline(name, condition, lit, earth, background, behind))
    nowhere = np.full(3, np.nan)
    return Timeline(
        times=times,
        period=period,
        sun_direction=np.array([nowhere if s.sun_direction is None else s.sun_direction for s in skies]),
        sun_visible=visible,
        sun_in_view=in_view,
        brightest=brightest,
        full_well=full_well,
        tracks=tuple(tracks),
        labels=tuple(Label(condition.words, condition.meaning) for condition in Condition),
        groups=tuple(ConditionGroup(e.name, e.share, tuple(map(int, e.conditions))) for e in ESTIMATES),
        scenario_yaml=resolved_yaml(scenario),
        warnings=stage.warnings,
    )


class NothingSeenError(InputError):
    """The scanner sees no target: the scene is empty, or all of it is hidden."""


class _Moment(NamedTuple):
    """What one moment shows.

    The Sun's share in view, the largest charge, and of each target: share in sunlight, light of the Earth, background,
    share with the Sun behind.
    """

    in_view: float
    brightest: float
    targets: list[tuple[float, float, float, float]]


class _Stage:
    """The instrument before its targets, ready for any sky."""

    def __init__(self, scenario: Scenario, device: DeviceChoice) -> None:
        instrument = Instrument(scenario, device=device)
        self._instrument, self._scenario, self._seed = instrument, scenario, scenario.seed
        sensor = scenario.scanner.position_sensor
        electrons = electrons_per_watt(sensor, scenario.scanner.laser.wavelength, scenario.scanner.exposure)
        through = instrument.triangulation.throughput
        # Any pixel may look at any position: the one that makes most of it counts.
        self._gain = tuple(
            electrons * float(table.numpy().max()) for table in (through.in_band, through.out_of_band)
        )
        image = scenario.scanner.receiver.line_image
        self._reach = tuple(
            math.atan(image.tangent(end)) for end in (sensor.offset, sensor.offset + sensor.length)
        )
        self._targets()
        self._grid = self._field_of_view()

    def _targets(self) -> None:
        loaded = self._instrument.loaded
        arrays = tuple(item.name for item in self._scenario.scene.objects if isinstance(item, TargetArray))
        wanted = arrays or loaded.objects
        found: dict[str, SurfaceSamples] = {}
        for name in wanted:
            samples = visible_samples(loaded, loaded.objects.index(name) + 1, POINTS, self._seed)
            if samples.count:
                found[name] = samples
        if not found:
            raise NothingSeenError(
                "the scanner sees no target: the scene is empty, or all of it is hidden.",
                remedy="Put an object with 'array' or any other object before the scanner.",
            )
        self.names = tuple(found)
        self.warnings = tuple(
            f"'{name}' was left out: the scanner does not see it" for name in wanted if name not in found
        )
        self._samples = list(found.values())
        self._sights = [self._sight(samples) for samples in self._samples]

    def _sight(self, samples: SurfaceSamples) -> Sight:
        """Return the lines of sight from the lens to points, as each is measured."""
        geometry = self._instrument.geometry
        x, y, z = samples.point.numpy().astype(np.float64)
        r, theta, phi = angles_and_range(x, y, z, geometry.axis_separation)
        focal = self._scenario.scanner.receiver.focal_length
        p = position_from_range(r, theta, focal, geometry.baseline)
        return Sight(theta - np.arctan(p / focal), phi)

    def _field_of_view(self) -> Sight:
        """Return an even grid of all that the pixels see during the scan."""
        scan, (near, far) = self._scenario.raster, self._reach
        rows, columns = GRID
        angle = np.linspace(scan.horizontal[0] - far, scan.horizontal[1] - near, columns)
        phi = np.linspace(*scan.vertical, rows)
        across, down = np.meshgrid(angle, phi)
        return Sight(across.ravel(), down.ravel())

    def look(self, sky: Sky) -> _Moment:
        """Return what one sky makes of the targets."""
        instrument, seed = self._instrument, self._seed
        loaded, optics = instrument.loaded, instrument.optics
        if sky.sun_visible == 0.0:
            return _Moment(0.0, 0.0, [(0.0, 0.0, 0.0, 0.0)] * len(self.names))
        lamp = light_of(sky)
        sights = [self._grid, *self._sights]
        every = light.Sight(
            np.concatenate([sight.angle for sight in sights]), np.concatenate([sight.phi for sight in sights])
        )
        bounces = self._scenario.transport.background_bounces
        whole_in, whole_out, sharp_in, sharp_out = light.trace_sunlight(
            loaded, optics, lamp, every, bounces, seed
        )
        charge = self._gain[0] * whole_in + self._gain[1] * whole_out
        glint = self._gain[0] * sharp_in + self._gain[1] * sharp_out
        ends = np.cumsum([len(sight.angle) for sight in sights])
        parts = np.split(charge, ends[:-1])[1:]
        sun, free = light.sun_at(loaded, optics, lamp, seed)
        targets = [
            (
                light.sunlit_share(loaded, lamp, samples, seed),
                light.earth_irradiance(loaded, lamp, sky.albedo, samples, seed),
                float(part.mean()),
                self._sun_behind(samples, sun, free),
            )
            for samples, part in zip(self._samples, parts, strict=True)
        ]
        return _Moment(self._sun_in_view(sun, free), float(glint.max()), targets)

    def _sun_in_view(self, sun: Sight, free: NDArray[np.bool_]) -> float:
        """Return the share of the Sun's disc that some pixel sees during the scan."""
        scan, (near, far), margin = self._scenario.raster, self._reach, half_height(self._instrument.optics)
        across = (sun.angle >= scan.horizontal[0] - far) & (sun.angle <= scan.horizontal[1] - near)
        down = (sun.phi >= scan.vertical[0] - margin) & (sun.phi <= scan.vertical[1] + margin)
        return float(np.mean(free & across & down))

    def _sun_behind(self, samples: SurfaceSamples, sun: Sight, free: NDArray[np.bool_]) -> float:
        """Return the share of a target's points at whose measurement a pixel looks into the Sun."""
        if not free.any():
            return 0.0
        x, y, z = samples.point.numpy().astype(np.float64)
        _, theta, phi = angles_and_range(x, y, z, self._instrument.geometry.axis_separation)
        (near, far), margin = self._reach, half_height(self._instrument.optics)
        first, last = sun.angle[free].min(), sun.angle[free].max()
        top, bottom = sun.phi[free].min(), sun.phi[free].max()
        across = (theta - near >= first) & (theta - far <= last)
        down = (phi + margin >= top) & (phi - margin <= bottom)
        return float(np.mean(across & down))
