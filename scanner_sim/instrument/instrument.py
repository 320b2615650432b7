"""An instrument before a scene: from an aim to what its rangefinders measure of it.

Aim → shots → rangefinders, each with light, detector and estimator of its own → fusion → samples. Truth goes past the
estimators, straight into columns of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scanner_sim.config.built import instrument_as_built, scanner_as_built
from scanner_sim.config.calibration import believed_instrument, geometry_believed
from scanner_sim.config.scenario import Scenario
from scanner_sim.detector.encoders import read_encoders, readings
from scanner_sim.foundation.channels import CHANNEL, MEASURED_BY
from scanner_sim.foundation.device_streams import RunSeeds, device_seeds
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.background_rows import rows_about
from scanner_sim.instrument.common_errors import ReadingsOfTheta, add_common_errors
from scanner_sim.instrument.line_readings import ShotGroup
from scanner_sim.instrument.optics_as_built import optics_as_built
from scanner_sim.instrument.own_aims import aim_at, check_aim, is_of_scan
from scanner_sim.instrument.rangefinder import LIGHT, SIGMA_Y, Rangefinder, Reading
from scanner_sim.instrument.samples import Samples
from scanner_sim.instrument.time_of_flight import TimeOfFlight
from scanner_sim.instrument.time_slots import TimeSlots, by_slot
from scanner_sim.instrument.together import lanes_of, need_one_light, takes_seeds
from scanner_sim.instrument.triangulation import Triangulation
from scanner_sim.ranging.fusion import fuse_points
from scanner_sim.ranging.ranges import Columns, Deflections, Layers, layers_of
from scanner_sim.render.background.panorama import Panorama
from scanner_sim.render.beam.chief_surface import chief_surface
from scanner_sim.render.beam.light import Truth
from scanner_sim.render.device import activate
from scanner_sim.render.guest import Stay, guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.render.shots import Pointing, Shots, true_shots
from scanner_sim.scan.protocol import Aim
from scanner_sim.scene.files.loader import LoadedScene, Pose, load_scene


class Instrument:
    """An instrument before a loaded scene, ready to measure any aim.

    Parameters
    ----------
    scenario
        Instrument, scene and processing. Its scan counts for the background alone, which is rendered for it.
    device, threads
        Where to compute.
    reuse
        An instrument before the same scene, with the same optics, raster and light: what it has loaded and rendered of
        these is used again.

    Attributes
    ----------
    rangefinders
        What measures each shot, as ``ranging`` says. Columns without a prefix are of the first.
    built, true_scanner
        The instrument as built, None where it is as designed, and the design with its true lengths: light and detectors
        follow them, and no estimator knows them.

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the device cannot be used.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        device: DeviceChoice = "auto",
        threads: int | None = None,
        reuse: Instrument | None = None,
    ) -> None:
        self.built = instrument_as_built(scenario)
        self.true_scanner = scanner_as_built(scenario.scanner, self.built)
        self.scenario = scenario
        self.reuse = reuse
        with guest():
            activate(device, threads)
            self._stay = Stay()
            self.loaded: LoadedScene = load_scene(scenario.scene) if reuse is None else reuse.loaded
        self.optics = optics_as_built(self.true_scanner, self.built)
        self.geometry = geometry_believed(scenario.scanner, believed_instrument(scenario))
        ways = {"triangulation": "triangulation", "tof": "time_of_flight"}
        self.rangefinders: tuple[Rangefinder, ...] = tuple(
            getattr(self, ways[name]) for name in scenario.rangefinders
        )

    @cached_property
    def triangulation(self) -> Triangulation:
        """The line sensor's half, whether the scenario ranges by it or not."""
        reuse = None if self.reuse is None else self.reuse.triangulation
        return Triangulation(self.scenario, self.loaded, self.optics, reuse, self.true_scanner, self.geometry)

    @cached_property
    def time_of_flight(self) -> TimeOfFlight:
        """The photodiode's half, whether the scenario ranges by it or not."""
        reuse = None if self.reuse is None else self.reuse.time_of_flight
        return TimeOfFlight(self.scenario, self.loaded, self.optics, reuse, self.built, self.geometry)

    def aim(
        self,
        theta: ArrayLike,
        phi: ArrayLike,
        *,
        first: int = 0,
        travel_theta: ArrayLike = 0.0,
        travel_phi: ArrayLike = 0.0,
    ) -> Aim:
        """Return shots in directions [rad], one dwell after the other.

        Arguments as those of :func:`~scanner_sim.instrument.own_aims.aim_at`.
        """
        dwell = self.scenario.scanner.dwell
        return aim_at(theta, phi, dwell, first=first, travel_theta=travel_theta, travel_phi=travel_phi)

    def measure(
        self,
        aim: Aim,
        *,
        backgrounds: Sequence[Panorama | None] | None = None,
        seeds: Sequence[int] | None = None,
        noise_alone: bool = False,
    ) -> Samples:
        """Return what is measured of the shots of an aim.

        Parameters
        ----------
        aim
            The shots. Their numbers address the random numbers: the same number meets the same errors.
        backgrounds
            What each rangefinder sees of Sun and Earth, from :meth:`backgrounds`. By default it is that of the
            scenario's scan where this has the shots in rows of its own, or nothing moves; else it is rendered for them,
            slot by slot where objects move (:meth:`backgrounds_by_slot`).
        seeds
            Of runs that differ in nothing else, all of which measure the aim: their samples stand one run after the
            other, and each run's are those that it has alone. By default the scenario's. Several are possible where
            :attr:`takes_seeds` says so.
        noise_alone
            Leave the errors of the calibration out of σ, for what compares voxels.

        Raises
        ------
        InputError
            If the aim cannot be, or not every rangefinder has a background.
        """
        check_aim(aim, self.scenario.scanner.mirrors.max_deflection)
        if backgrounds is not None and len(backgrounds) != len(self.rangefinders):
            raise InputError(
                f"{len(backgrounds)} backgrounds are not one for each of {len(self.rangefinders)} rangefinders.",
                remedy="Take what Instrument.backgrounds returns.",
            )
        if seeds is not None:
            need_one_light(self.scenario)
        with self._stay.resume():
            if backgrounds is not None or is_of_scan(aim, self.scenario):
                return self._read_runs(aim, backgrounds, seeds, noise_alone)
            if self.scenario.lighting.sky().dark or not self.loaded.bodies:
                return self._read_runs(aim, self.backgrounds(aim), seeds, noise_alone)
            begins = np.arange(1 if seeds is None else len(seeds))[:, None] * len(aim.shot)
            parts, places = [], []
            for shots, seen in self.backgrounds_by_slot(aim):
                parts.append(self._read_runs(aim.part(shots), seen, seeds, noise_alone))
                places.append((begins + shots).ravel())
            return Samples.in_order(parts, places)

    def _read_runs(
        self,
        aim: Aim,
        backgrounds: Sequence[Panorama | None] | None,
        seeds: Sequence[int] | None,
        noise_alone: bool,
    ) -> Samples:
        """Return the same as :meth:`measure` before backgrounds that are known."""
        if seeds is None:
            return self._stated(self.read(aim, backgrounds), aim, noise_alone)
        each, own = aim.repeated(len(seeds)), device_seeds(np.array(seeds, dtype=np.uint64))
        samples = self.read(each, backgrounds, RunSeeds.of(own, len(each.shot)))
        return self._stated(samples, each, noise_alone)

    def measure_together(
        self,
        aim: Aim,
        scenarios: Sequence[Scenario],
        *,
        backgrounds: Sequence[Panorama | None] | None = None,
    ) -> Samples:
        """Return what is measured of the shots of an aim in scenarios that are :func:`alike`, one after the other.

        Parameters
        ----------
        aim
            Shots of the scan.
        scenarios
            The instrument's own among them.
        backgrounds
            As of :meth:`measure`; σ are of noise alone.
        """
        with self._stay.resume():
            each, seeds, poses = lanes_of(scenarios, self.loaded, aim)
            return self.read(each, backgrounds, seeds, poses)

    def _stated(self, samples: Samples, aim: Aim, noise_alone: bool) -> Samples:
        """Return samples with the errors of the calibration in their σ, unless these are to be of noise alone."""
        if not noise_alone:
            scenario, derived = self.scenario, self.scenario.output.jacobian
            readings = ReadingsOfTheta(scenario.scanner.mirrors, aim.theta, aim.time)
            add_common_errors(
                samples.measured, scenario.rangefinders, self.geometry, readings, jacobian=derived
            )
        return samples

    @property
    def takes_seeds(self) -> bool:
        """Whether runs of several seeds can be measured together: they see one light, before one instrument."""
        return takes_seeds(self.scenario)

    def backgrounds(self, aim: Aim) -> list[Panorama | None]:
        """Return what the rangefinders see of Sun and Earth about the shots of an aim; None in the dark.

        Objects that move stand where they are in the middle of the aim's time.
        """
        if self.scenario.lighting.sky().dark:
            return [None] * len(self.rangefinders)
        time = 0.5 * float(aim.time.min() + aim.time.max()) if self.loaded.bodies else None
        with self._stay.resume():
            return [
                rangefinder.panorama_of(rows_about([aim], [time], rangefinder.sight[0])[0])
                for rangefinder in self.rangefinders
            ]

    def backgrounds_by_slot(self, aim: Aim) -> Iterator[tuple[NDArray[np.intp], list[Panorama]]]:
        """Yield the shots of an aim, as indices of shape (n,), with what the rangefinders see of Sun and Earth then.

        A slot's shots see an even grid of rows about them, all of one size, of objects that stand as in its middle.
        Approximations: in a slot none moves by more than a bin of the first rangefinder (those that are faster than a
        bin in 1/64 s move by more); two rows are interpolated.
        """
        layout, _ = self.rangefinders[0].sight
        slots = TimeSlots(self.loaded, layout.pitch / layout.receiver.focal_length)
        shots, times = zip(*by_slot(aim, slots), strict=True)
        parts = [aim.part(one) for one in shots]
        rows = [rows_about(parts, times, rangefinder.sight[0]) for rangefinder in self.rangefinders]
        for one, *own in zip(shots, *rows, strict=True):
            with self._stay.resume():
                seen = [finder.panorama_of(row) for finder, row in zip(self.rangefinders, own, strict=True)]
            yield one, seen

    def read(
        self,
        aim: Aim,
        backgrounds: Sequence[Panorama | None] | None = None,
        seeds: RunSeeds | None = None,
        poses: tuple[Pose, ...] | None = None,
    ) -> Samples:
        """Return the same as :meth:`measure` of an aim that can be; backgrounds are by default those of the scan.

        ``seeds`` of the runs that the shots belong to, where these are several, and the ``poses`` of what moves, where
        they are not the scenario's.
        """
        shots, pointing = self.fire(aim, seeds, poses)
        deflections = self.deflections(aim, pointing, seeds=seeds)
        seen = [None] * len(self.rangefinders) if backgrounds is None else backgrounds
        found = [
            rangefinder.measure(aim, shots, deflections, background)
            for rangefinder, background in zip(self.rangefinders, seen, strict=True)
        ]
        return self.samples(aim, pointing, deflections, found, self._surfaces(shots))

    def _surfaces(self, shots: Shots) -> Layers:
        """Return the truth of the surfaces that shots meet, as far as the scenario asks for it."""
        asked = set(self.scenario.output.truth)
        if asked.isdisjoint(("point", "normal", "incidence")):
            return {}
        point, normal, incidence = chief_surface(self.loaded, self.optics, shots)
        layers = {f"P.{axis}": part for axis, part in zip("XYZ", point, strict=True)}
        layers |= {f"normal.{axis}": part for axis, part in zip("XYZ", normal, strict=True)}
        layers["incidence_rad"] = incidence
        return {name: values for name, values in layers.items() if CHANNEL[f"truth.{name}"].asked in asked}

    def samples(
        self,
        aim: Aim,
        pointing: Pointing,
        deflections: Deflections,
        found: Sequence[Reading],
        surfaces: Columns = MappingProxyType({}),
    ) -> Samples:
        """Return what all rangefinders read of an aim as samples, triangulation and time of flight fused.

        ``surfaces`` is further truth.
        """
        ranges = [reading.ranges for reading in found]
        measured: Layers = {}
        if [type(one) for one in self.rangefinders] == [Triangulation, TimeOfFlight]:
            triangulated, echo = ranges
            fused, *ranges = fuse_points(triangulated, echo, deflections, self.geometry)
            measured |= layers_of(fused, "fused.")
        for rangefinder, reading, own in zip(self.rangefinders, found, ranges, strict=True):
            measured |= reading.layers | layers_of(own, rangefinder.prefix)
            for name in MEASURED_BY.get(f"{rangefinder.prefix}status", ()):
                if name in reading.layers:
                    measured[name][own.status != Status.VALID] = np.nan
        if first := self.rangefinders[0].prefix:
            measured |= layers_of(ranges[0]) | {name: measured[first + name] for name in LIGHT}
        met = found[-1].truth
        truth = {
            "range_m": met.distance.numpy(),
            "theta_rad": aim.theta + pointing.theta,
            "phi_rad": aim.phi + pointing.phi,
            "object": self.loaded.object_labels.number_of[met.object.numpy()],
            "material": self.loaded.material_labels.number_of[met.material.numpy()],
            **surfaces,
        }
        known = (SIGMA_Y, *(channel for rangefinder in self.rangefinders for channel in rangefinder.channels))
        return Samples(measured, truth, {channel.name: channel for channel in known})

    def expose(self, aim: Aim) -> tuple[Truth, Iterator[ShotGroup]]:
        """Render the shots of an aim, expose the line to them and read it: their truth, and the shots in groups."""
        return self.triangulation.expose(self.fire(aim)[0])

    def fire(
        self, aim: Aim, seeds: RunSeeds | None = None, poses: tuple[Pose, ...] | None = None
    ) -> tuple[Shots, Pointing]:
        """Return the shots of an aim as the mirrors' errors let them go, and these errors; the rest as of `read`."""
        scanner, transport = self.scenario.scanner, self.scenario.transport
        seed = transport.seed_of_light(self.scenario.seed) if seeds is None else seeds
        own = self.loaded.poses_at(aim.time) if poses is None else poses
        share = scanner.exposure / scanner.dwell
        return true_shots(aim, scanner.mirrors, seed, share, own, self.built)

    def deflections(
        self,
        aim: Aim,
        pointing: Pointing,
        normals: Sequence[NDArray[np.float32]] | None = None,
        *,
        seeds: RunSeeds | None = None,
    ) -> Deflections:
        """Return what the encoders read, with what the instrument knows of their errors.

        ``normals`` are the standard normal numbers of their noise, where they are drawn already; ``seeds`` as of
        :meth:`read`.
        """
        scanner, shaft = (
            self.scenario.scanner,
            (aim.theta + pointing.seen_theta, aim.phi + pointing.seen_phi),
        )
        mirrors, share = scanner.mirrors, scanner.exposure / scanner.dwell
        if normals is None:
            own = self.scenario.seed if seeds is None else seeds.lanes
            theta, phi = read_encoders(aim.shot, *shaft, mirrors, own)
        else:
            theta, phi = readings(*shaft, normals[0], normals[1], mirrors)
        if self.geometry.calibration is not None:
            theta, phi = self.geometry.calibration.deflections(theta, phi)
        along, down = mirrors.reading_sigma(np.array([theta, phi]), aim.time)
        return Deflections(theta, phi, along, down, share * aim.travel_theta, share * aim.travel_phi)
