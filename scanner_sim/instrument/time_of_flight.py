"""Time of flight before a scene: pulse, echoes, waveforms, delays, ranges.

One pulse belongs to each voxel. It is fired in the middle of the dwell, through the same mirrors as the light of the
triangulation, and its light passes the same filter.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from scanner_sim.config.scanner import Lidar, geometry_of
from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.photodiode.echo_speckle import echo_speckle
from scanner_sim.detector.photodiode.photodiode import (
    ELEMENTARY_CHARGE,
    Digitiser,
    PhotodiodeNoise,
    background_power,
)
from scanner_sim.detector.photodiode.pulse_response import PulseResponse
from scanner_sim.detector.photodiode.waveform import ClockErrors, Waveforms, record
from scanner_sim.foundation.channels import Channel
from scanner_sim.foundation.constants import SPEED_OF_LIGHT
from scanner_sim.foundation.device_streams import RunSeeds
from scanner_sim.foundation.device_types import Float
from scanner_sim.foundation.streams import Seed
from scanner_sim.instrument.background_rows import scan_rows
from scanner_sim.instrument.rangefinder import Reading
from scanner_sim.optics.band_irradiance import band_irradiance
from scanner_sim.optics.built_instrument import BuiltInstrument
from scanner_sim.optics.filter import laser_gain
from scanner_sim.products.waveforms import WaveformSet
from scanner_sim.ranging.departures import ideal_way
from scanner_sim.ranging.ranges import Deflections, Geometry, Layers, Ranges, ranges_with_points
from scanner_sim.ranging.time_of_flight import echo_range_by_theta, ranges_from_delays
from scanner_sim.render.background.panorama import Panorama
from scanner_sim.render.background.view import Rows
from scanner_sim.render.beam.kept_light import KeptLight, on_device, speckled
from scanner_sim.render.beam.light import Light, Truth
from scanner_sim.render.beam.path_projection import PathProjection
from scanner_sim.render.beam.splitter import BOUNCE_CLUSTERS, render_light
from scanner_sim.render.beam.surface_positions import SurfacePositions, coherence_of, surface_positions
from scanner_sim.render.field_of_view import (
    Field,
    batches_of_echoes,
    field_light,
    field_optics,
    field_panorama,
)
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout
from scanner_sim.scan.protocol import Aim
from scanner_sim.scene.files.loader import LoadedScene
from scanner_sim.signals.waveform.detection import Delays, PulseDetector, pulse_detector

Array = NDArray[np.float64]

_SAMPLES_TOGETHER = 1 << 24
"""Samples of waveforms that are kept at once: bounds the memory."""


@dataclass(frozen=True)
class EchoGroup:
    """Shots of a batch whose waveforms were recorded together: indices in the batch, records, delays."""

    index: NDArray[np.uint32]
    waveforms: Waveforms
    delays: Delays


@dataclass(frozen=True)
class EchoDelays:
    """The delays that were found of n shots, arrays of shape (n,).

    ``delay`` and its ``sigma`` [s], clock apart; ``signal`` height and its ``sigma_signal`` [A]; ``snr`` that over the
    noise without it; ``echoes`` their number; ``status`` codes.
    """

    delay: Array
    sigma: Array
    signal: Array
    sigma_signal: Array
    snr: Array
    echoes: NDArray[np.uint32]
    status: NDArray[np.uint32]

    @classmethod
    def empty(cls, n: int) -> EchoDelays:
        """Return the delays of n shots before any is found."""
        counts = (np.zeros(n, dtype=np.uint32) for _ in range(2))
        return cls(np.full(n, np.nan), np.full(n, np.nan), np.zeros(n), np.zeros(n), np.zeros(n), *counts)

    def fill(self, index: NDArray[np.uint32], found: Delays, digitiser: Digitiser) -> None:
        """Fill in the delays that were found of the shots at some indices."""
        self.delay[index] = found.seconds(digitiser)
        self.sigma[index] = found.sigma.numpy() / digitiser.rate
        self.signal[index] = found.signal.numpy()
        self.sigma_signal[index] = found.sigma_signal.numpy()
        self.snr[index] = found.snr.numpy()
        self.echoes[index] = found.echoes.numpy()
        self.status[index] = found.status.numpy()


class TimeOfFlight:
    """The pulsed laser and its photodiode before a loaded scene.

    Parameters
    ----------
    scenario
        Instrument, scene and processing.
    loaded
        The scene.
    optics
        The triangulation's optics; laser, lens and filter are shared.
    reuse
        A unit before the same scene, under the same light and with the same raster, whose background is used again.
    built
        The instrument as built; None is built as designed.
    geometry
        As it believes itself to be; by default as designed.
    """

    prefix = "tof."
    channels = (
        Channel(
            "tof.sigma_Y",
            "electron",
            "standard deviation of tof.Y by all but speckle",
            "signal",
        ),
    )

    def __init__(
        self,
        scenario: Scenario,
        loaded: LoadedScene,
        optics: OpticalLayout,
        reuse: TimeOfFlight | None = None,
        built: BuiltInstrument | None = None,
        geometry: Geometry | None = None,
    ) -> None:
        scanner = scenario.scanner
        self.clock = (
            ClockErrors() if built is None else ClockErrors(built.value("tof_zero"), built.value("tof_scale"))
        )
        self.reuse = reuse
        self.scenario, self.loaded, self.unit = scenario, loaded, scanner.lidar
        passed = float(laser_gain(scanner.filter, scanner.laser, self.unit.photodiode.response))
        self.bare = optics
        self.optics = dataclasses.replace(optics, filter_transmission=optics.filter_transmission * passed)
        self.geometry = geometry_of(scanner) if geometry is None else geometry
        self.baseline = scanner.receiver.baseline if self.unit.photodiode.place == "offset" else 0.0

    @property
    def gate(self) -> tuple[float, float]:
        """Ranges that count [m]: those that are recorded, within the processing's gate."""
        recorded, wanted = self.unit.digitiser.gate, self.scenario.processing.range_gate
        return recorded if wanted is None else (max(recorded[0], wanted[0]), min(recorded[1], wanted[1]))

    @cached_property
    def detector(self) -> PulseDetector:
        """Detection with its filters and tables."""
        unit = self.unit
        processing, laser = self.scenario.processing, self.scenario.scanner.laser
        return pulse_detector(unit.pulse, unit.photodiode, unit.digitiser, processing.pulse, laser)

    @cached_property
    def amperes_per_electron(self) -> float:
        """Height of an echo's current over its charge before the avalanche [A], for a surface that faces the beam."""
        rate, diode = self.unit.digitiser.rate, self.unit.photodiode
        variance = (diode.response_sigma * rate) ** 2
        response = PulseResponse.of(self.unit.pulse, rate)
        summit = response.values(np.linspace(*response.span(variance), 4097), variance).max() * rate
        return float(summit) * diode.gain * ELEMENTARY_CHARGE

    @cached_property
    def field(self) -> Field:
        """The photodiode's field of view."""
        # The square of the round field's solid angle; a field beside the laser reaches from infinity inwards.
        angle = self.unit.photodiode.field_of_view
        aside = 0.5 * angle if self.baseline else 0.0
        return Field(0.5 * math.sqrt(math.pi) * angle, aside, self.baseline)

    @property
    def sight(self) -> tuple[OpticalLayout, tuple[float, float]]:
        """Optics whose pixels are the bins of the field's background, and the angles between which it lies [rad]."""
        middle, half = -self.field.aside, 0.5 * self.field.side
        return field_optics(self.bare, self.field), (middle - half, middle + half)

    @cached_property
    def panorama(self) -> Panorama | None:
        """The background of the scenario's scan about the photodiode's lens; None in the dark."""
        if self.scenario.lighting.sky().dark:
            return None
        if self.reuse is not None:
            return self.reuse.panorama
        return self.panorama_of(scan_rows(self.scenario, self.sight[0]))

    def panorama_of(self, rows: Rows) -> Panorama:
        """Return what the photodiode sees of Sun and Earth in some rows."""
        scenario, sky = self.scenario, self.scenario.lighting.sky()
        return field_panorama(
            self.loaded,
            self.bare,
            self.field,
            sky,
            rows,
            scenario.transport,
            scenario.transport.seed_of_background(scenario.seed),
        )

    @cached_property
    def collected(self) -> tuple[float, float]:
        """Light on the photodiode [W] per radiance over the Sun's irradiance, in the filter's band and beyond it."""
        scanner, sun = self.scenario.scanner, self.scenario.lighting.sun
        if sun == "none":
            return 0.0, 0.0
        response = self.unit.photodiode.response
        bands = band_irradiance(sun, scanner.filter, response, scanner.laser.wavelength)
        lens = scanner.receiver
        transmission = lens.transmission * self.bare.filter_transmission
        field = self.unit.photodiode.field_of_view
        inside, outside = (
            background_power(float(band), lens.aperture_area, transmission, field) for band in bands
        )
        return inside, outside

    def listen(
        self, shots: Shots, detector: PulseDetector | None = None, panorama: Panorama | None = None
    ) -> tuple[Truth, Float, Iterator[EchoGroup]]:
        """Fire the pulses of n shots: their truth, their background [W] and the shots in groups.

        ``detector`` is that of an instrument that takes itself for another one than it is, ``panorama`` the background
        where it is not the raster's.
        """
        scenario = self.scenario
        columns = scenario.scan.shots_per_row
        seen = self.panorama if panorama is None else panorama
        light = field_light(seen, self.field, shots, columns, self.collected)
        light_seed = scenario.transport.seed_of_light(scenario.seed)
        speckle = self._speckle if scenario.scanner.laser.speckle else None
        truth, echoes = render_light(self.loaded, self.view, scenario.transport, shots, light_seed, speckle)
        found = self._recorded(echoes, light, self.detector if detector is None else detector, shots.seeds)
        return truth, light, found

    def _speckle(self, echoes: Light, shots: Shots, truth: Truth) -> Float:
        """Return what speckle makes of the echoes of shots whose chief rays meet something; a pulse lasts no dwell."""
        surfaces = surface_positions(self.loaded, self.optics, shots, truth)
        seed = self.scenario.seed if shots.seeds is None else shots.seeds.lanes
        return self._factors(echoes, surfaces, coherence_of(self.loaded, truth), seed)

    def _factors(self, echoes: Light, surfaces: SurfacePositions, coherence: Float, seed: Seed) -> Float:
        scanner = self.scenario.scanner
        aperture = scanner.receiver.aperture / scanner.laser.wavelength
        return echo_speckle(echoes, surfaces, coherence, aperture, seed)

    def keep(
        self, shots: Shots, background: Panorama | None = None
    ) -> tuple[KeptLight, NDArray[np.float32], NDArray[np.float32]]:
        """Return the light of n pulses before speckle, C² of it, and their background [W], all in NumPy's memory."""
        transport, columns = self.scenario.transport, self.scenario.scan.shots_per_row
        seen = self.panorama if background is None else background
        seed = transport.seed_of_light(self.scenario.seed)
        truth, echoes = render_light(self.loaded, self.view, transport, shots, seed)
        kept = KeptLight.of(self.loaded, self.optics, shots, truth, echoes)
        light = field_light(seen, self.field, shots, columns, self.collected)
        return kept, coherence_of(self.loaded, truth).numpy(), light.numpy()

    def read_kept(
        self,
        kept: KeptLight,
        shots: Shots,
        coherence: NDArray[np.float32],
        background: NDArray[np.float32],
    ) -> Iterator[EchoGroup]:
        """Record and time the waveforms of n shots whose light was kept, without the scene.

        Arguments as :meth:`keep` returns them, and the same shots.
        """
        scenario = self.scenario
        late = BOUNCE_CLUSTERS if scenario.transport.bounces > 1 else 0
        light = on_device(background)
        for group in kept.groups(shots.number.numpy()):
            part = group.light
            if scenario.scanner.laser.speckle:
                grain = on_device(coherence[group.index])
                factors = partial(self._factors, surfaces=group.surfaces, coherence=grain, seed=scenario.seed)
                part = speckled(part, late, factors)
            yield from self._recorded(iter([part]), light, self.detector)

    def expected(self, kept: KeptLight, shots: Shots) -> NDArray[np.float32]:
        """Return the current of kept light alone behind the electronics [A], shape (n, samples)."""
        unit = self.unit
        quiet = PhotodiodeNoise.model_validate(dict.fromkeys(PhotodiodeNoise.model_fields, False))
        diode = unit.photodiode.model_copy(update={"noise": quiet})
        step = np.float32(unit.digitiser.step(diode.saturation))
        found = np.zeros((len(kept.clusters), unit.digitiser.samples), dtype=np.float32)
        none = on_device(np.zeros(len(kept.clusters), dtype=np.float32))
        echoes = (group.light for group in kept.groups(shots.number.numpy()))
        for part, _ in batches_of_echoes(echoes, none, self._together):
            waveforms = record(
                part, part.shot, unit.pulse, diode, unit.digitiser, self.scenario.seed, clock=self.clock
            )
            found[part.index.numpy()] = waveforms.records() * step
        return found

    @property
    def view(self) -> PathProjection:
        """How the photodiode sees paths."""
        diode = self.unit.photodiode
        return PathProjection(self.optics, diode.place == "offset", diode.field_of_view)

    @property
    def _together(self) -> int:
        return max(1, _SAMPLES_TOGETHER // self.unit.digitiser.samples)

    def _recorded(
        self, echoes: Iterator[Light], light: Float, detector: PulseDetector, seeds: RunSeeds | None = None
    ) -> Iterator[EchoGroup]:
        """Yield the waveforms of echoes before a background [W] of all shots, and what is found in them.

        ``seeds`` are those of the runs that all shots belong to; by default the scenario's.
        """
        unit = self.unit
        for part, own in batches_of_echoes(echoes, light, self._together):
            seed = self.scenario.seed if seeds is None else seeds.take(part.index).lanes
            settings = unit.pulse, unit.photodiode, unit.digitiser
            waveforms = record(part, part.shot, *settings, seed, own, self.clock)
            yield EchoGroup(part.index.numpy(), waveforms, detector.detect(waveforms))

    def measure(
        self, aim: Aim, shots: Shots, deflections: Deflections, background: Panorama | None = None
    ) -> Reading:
        """Return what it reads of n shots: see :class:`~scanner_sim.instrument.rangefinder.Rangefinder`."""
        truth, light, groups = self.listen(shots, panorama=background)
        return self.reading(truth, self.gathered(len(aim.shot), groups), light.numpy(), deflections)

    def gathered(self, count: int, groups: Iterable[EchoGroup]) -> EchoDelays:
        """Return the delays of so many shots from their groups."""
        delays = EchoDelays.empty(count)
        for group in groups:
            delays.fill(group.index, group.delays, self.unit.digitiser)
        return delays

    def reading(
        self, truth: Truth, delays: EchoDelays, background: NDArray[np.float32], deflections: Deflections
    ) -> Reading:
        """Return ranges and layers of n shots from their delays and their background [W], shape (n,)."""
        signal = delays.signal / self.amperes_per_electron
        layers: Layers = {
            "tof.Y": signal,
            "tof.sigma_Y": delays.sigma_signal / self.amperes_per_electron,
            "tof.snr_detection": delays.snr,
            "tof.echoes": delays.echoes,
            "tof.background_w": background,
        }
        return Reading(truth, self.ranges(delays, deflections), layers)

    def _delay(self, delay: Array) -> Array:
        """Return delays [s] less what the instrument believes of its zero and scale."""
        known = self.geometry.calibration
        if known is None:
            return delay
        return (
            ideal_way(SPEED_OF_LIGHT * delay, known.value("tof_zero"), known.value("tof_scale"))
            / SPEED_OF_LIGHT
        )

    def ranges(self, delays: EchoDelays, deflections: Deflections) -> Ranges:
        """Return the ranges of n shots from the delays of their echoes, along measured deflections."""
        theta, d = deflections.theta, self.geometry.baseline if self.baseline else 0.0
        delay = self._delay(delays.delay)
        clock = self.unit.digitiser.jitter if self.unit.photodiode.noise.clock else 0.0
        alone = ranges_from_delays(delay, delays.sigma, delays.status, theta, clock, self.gate, d)
        by_theta = echo_range_by_theta(alone.range, delay, theta, d)
        return ranges_with_points(
            alone.range,
            np.hypot(alone.sigma, by_theta * deflections.sigma_theta),
            alone.status,
            alone.sigma,
            by_theta,
            deflections,
            self.geometry,
        )


def fitted_pulse(unit: Lidar, waveforms: WaveformSet, number: int) -> tuple[Array, Array] | None:
    """Return the unit's own pulse at the delay that was found, at the height that fits a record best.

    Parameters
    ----------
    unit
        The instrument as it knows itself.
    waveforms, number
        Records, and which of them.

    Returns
    -------
    tuple or None
        Times after the pulse [s] and currents [A]; the height is by least squares over the samples that are not
        clipped. None without an echo.
    """
    delay, rate = float(waveforms.delay[number]), waveforms.rate
    if not np.isfinite(delay):
        return None
    variance = (unit.photodiode.response_sigma * rate) ** 2
    response = PulseResponse.of(unit.pulse, rate)
    current = waveforms.number[number].astype(np.float64) * waveforms.step
    clipped = current >= unit.photodiode.saturation - waveforms.step
    known = response.values((waveforms.time - delay) * rate, variance) * ~clipped
    power = float(known @ known)
    if power == 0.0:
        return None
    early, late = response.span(variance)
    time = delay + np.linspace(early, late, 400) / rate
    return time, response.values((time - delay) * rate, variance) * float(known @ current) / power
