"""A scenario: everything that determines a result."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Annotated, ClassVar, Final, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag, ValidationInfo, field_validator

from scanner_sim.config.scanner import RangefinderName, Scanner
from scanner_sim.config.wording import inline_yaml
from scanner_sim.detector.frame.video_camera import VideoCamera
from scanner_sim.foundation.errors import Fault, InputError, at_most
from scanner_sim.foundation.html_text import html_box, html_folded, html_rows
from scanner_sim.foundation.parts import Count, Part
from scanner_sim.pose.identify_dots import FEWEST as FEWEST_DOTS
from scanner_sim.pose.settings import MOST_FRAMES, PoseSettings
from scanner_sim.products.settings import Output
from scanner_sim.render.settings import Transport
from scanner_sim.scan.fixed import FixedScan
from scanner_sim.scan.lissajous_scan import LissajousScan
from scanner_sim.scan.listed import ListedScan
from scanner_sim.scan.protocol import OpenScan, ScanSetup
from scanner_sim.scan.raster import RasterScan
from scanner_sim.scan.spiral import SpiralScan
from scanner_sim.scene.light.lighting import Lighting
from scanner_sim.scene.objects import Scene, TargetArray
from scanner_sim.signals.processing import MARGIN, Processing
from scanner_sim.tracking.record import TrackTarget
from scanner_sim.tracking.scan import TrackScan, resolve_targets

_UNSAID: Final = object()
"""What stands for a way of ranging before the instrument's own is taken."""
_RANGEFINDERS: dict[str, tuple[RangefinderName, ...]] = {
    "triangulation": ("triangulation",),
    "tof": ("tof",),
    "both": ("triangulation", "tof"),
}
"""What measures ranges, for each word of ``ranging``."""


def _kind_of_scan(value: object) -> str:
    """Return the tag of a scan; one without a type is a raster."""
    kind = value.get("type", "raster") if isinstance(value, dict) else getattr(value, "type", "raster")
    return f"({kind})"


ScanChoice = Annotated[
    Annotated[RasterScan, Tag("(raster)")]
    | Annotated[LissajousScan, Tag("(lissajous)")]
    | Annotated[SpiralScan, Tag("(spiral)")]
    | Annotated[ListedScan, Tag("(listed)")]
    | Annotated[FixedScan, Tag("(fixed)")]
    | Annotated[TrackScan, Tag("(track)")],
    Discriminator(_kind_of_scan),
]


def _values(data: object, key: str) -> Iterator[tuple[str, str]]:
    """Yield the key and the value, as YAML, of everything in plain data that is written."""
    if isinstance(data, dict) and data:
        for name, value in data.items():
            yield from _values(value, f"{key}.{name}")
    elif isinstance(data, list) and any(isinstance(value, dict | list) for value in data):
        for number, value in enumerate(data):
            yield from _values(value, f"{key}[{number}]")
    elif data is not None:
        yield key, inline_yaml(data)


def _first_words(section: dict[str, object]) -> str:
    """Return what stands first in a section: what it is of, mostly."""
    name, value = next(iter(section.items()), ("", ""))
    return f"{name} {value}" if isinstance(value, str | int | float) else ", ".join(section)


class Scenario(Part):
    """Instrument, scene, scan and processing: the same scenario gives the same bytes.

    In a file every dimensional number has a unit; from Python plain numbers are SI.
    """

    schema_version: Literal[1] = Field(alias="schema", examples=[1])
    """Version of the scenario's form."""
    seed: Count = Field(default=0, ge=0, lt=2**63)
    """Seed of every random number."""
    scanner: Scanner = Field(default_factory=lambda: Scanner.model_validate({}))
    """The instrument."""
    ranging: Literal["triangulation", "tof", "both"] = Field(
        default_factory=lambda: _UNSAID, validate_default=True
    )
    """How ranges are measured: by the line sensor, by time of flight (``scanner.lidar``), or both with their fusion. By
    default the line sensor, where the instrument has one."""
    scene: Scene = Scene()
    """What stands before it."""
    lighting: Lighting = Lighting()
    """Sun and Earth; dark by default."""
    scan: ScanChoice = Field(
        examples=[
            {
                "type": "raster",
                "rows": 256,
                "columns": 256,
                "horizontal": ["-15 deg", "15 deg"],
                "vertical": ["-15 deg", "15 deg"],
            }
        ]
    )
    """Where it points: a raster, a figure, a spiral, angles from a file, one direction, or patterns that follow
    targets."""
    transport: Transport = Transport()
    """How light is followed."""
    processing: Processing = Processing()
    """How signals become ranges."""
    pose: PoseSettings = PoseSettings()
    """How tracks become poses of objects."""
    camera: VideoCamera = VideoCamera()
    """The video camera beside the scanner; where the Sun shines, ``camera.png`` is its frame at the start of a scan
    that follows no targets."""
    output: Output = Output()
    """What is written."""

    replaced_by: ClassVar[Callable[[Scenario, Mapping[str, object]], Scenario]]
    """What :meth:`replace` does: ``config/load.py`` puts it here, whose words for faults need this class first."""

    @field_validator("ranging", mode="before")
    @classmethod
    def _instruments_own(cls, value: object, info: ValidationInfo) -> object:
        if value is not _UNSAID:
            return value
        scanner = info.data.get("scanner")
        return scanner.rangefinders[0] if isinstance(scanner, Scanner) else "triangulation"

    def replace(self, changes: Mapping[str, object]) -> Scenario:
        """Return a copy with other values, checked as if they had stood in the file.

        Parameters
        ----------
        changes
            Values by key: ``{"scanner.laser.power": "10 mW", "scene.objects.wall.position": (0, 0, 8)}``. Plain numbers
            are SI. Entries of a list go by their index or the name of an object. A block replaces a whole one, and is
            completed by the defaults; ``{"scanner": {"preset": "my_scanner.yaml"}}`` is another instrument.

        Returns
        -------
        Scenario

        Raises
        ------
        ScenarioError
            With all faults that could be found, each at its key, those of values that contradict one another too.
        """
        return type(self).replaced_by(self, changes)

    def _repr_html_(self) -> str:
        """Return what a notebook shows: every value, section by section."""
        return html_box(
            "Scenario",
            *(
                html_folded(f"{section}: {_first_words(value)}", html_rows(list(_values(value, section))))
                if isinstance(value, dict)
                else html_rows([(section, value)])
                for section, value in self.model_dump(mode="json", by_alias=True).items()
            ),
        )

    def cross_checks(self) -> Iterator[Fault]:
        """Yield angles beyond the mirrors, range gates beyond what is recorded, and settings that find no room."""
        yield from self.scan.faults(self.scan_setup)
        yield from self._camera_contradictions()
        if self.output.truth and self.scan.layout == "visits":
            problem = "a run that follows targets has the truth of its visits in its tables."
            yield Fault("output.truth", problem, "Write [], or a raster.")
        if self.output.jacobian and self.scan.layout == "visits":
            problem = "a run that follows targets has the common part of its visits in its tables."
            yield Fault("output.jacobian", problem, "Leave it out, or take a raster.")
        elif self.output.jacobian and self.processing.calibration is None:
            problem = "without a calibration no parameter has an error to be carried on."
            yield Fault("output.jacobian", problem, "Give processing.calibration, or leave it out.")
        if self.scan.layout == "visits" and self.transport.light_seed is not None:
            yield Fault(
                "transport.light_seed",
                "a run that follows targets draws its light and its noise together.",
                "Leave it out.",
            )
        if self.scan.layout == "visits" and "triangulation" not in self.scanner.rangefinders:
            yield Fault(
                "scan.type",
                "targets are told by the noise and the speckle of light on a line sensor, and the instrument has none.",
                "Choose an instrument with a position_sensor, or a scan that does not follow targets.",
            )
        for key, rangefinder in (("lines", "triangulation"), ("waveforms", "tof")):
            yield from self._kept_contradictions(key, rangefinder)
        checks = {"triangulation": self._line_contradictions, "tof": self._pulse_contradictions}
        missing = [name for name in self.rangefinders if name not in self.scanner.rangefinders]
        for rangefinder in self.rangefinders:
            yield from [self._missing(rangefinder)] if rangefinder in missing else checks[rangefinder]()
        if not missing and (blind := self.scanner.blindness(self.rangefinders)) is not None:
            yield Fault(f"scanner.{blind.location}", blind.problem, blind.remedy)

    @property
    def rangefinders(self) -> tuple[RangefinderName, ...]:
        """What measures ranges; the light of the first one is what tracking sees."""
        return _RANGEFINDERS[self.ranging]

    @property
    def scan_setup(self) -> ScanSetup:
        """What the scan is run with."""
        scanner = self.scanner
        return ScanSetup(self.scene, scanner.mirrors, scanner.galvanometers, scanner.dwell)

    @property
    def open_scan(self) -> OpenScan:
        """The scan, for what needs to know all aims beforehand.

        Raises
        ------
        InputError
            If the scenario follows targets.
        """
        if self.scan.layout == "visits":
            raise InputError(
                "this needs a scan that is known beforehand, and the scenario follows targets (scan.type: track).",
                remedy="Write scan: {type: raster, …}, or call track().",
            )
        return self.scan

    @property
    def raster(self) -> RasterScan:
        """The scan, for what needs a raster.

        Raises
        ------
        InputError
            If it is none.
        """
        if self.scan.layout != "image":
            other = "follows targets" if self.scan.layout == "visits" else "has none"
            raise InputError(
                f"this needs a raster, and the scenario {other} (scan.type: {self.scan.type}).",
                remedy="Write scan: {type: raster, rows: 256, columns: 256, horizontal: […], vertical: […]}.",
            )
        return self.scan

    @property
    def following(self) -> TrackScan:
        """The scan, for what follows targets.

        Raises
        ------
        InputError
            If it does not.
        """
        if self.scan.layout != "visits":
            raise InputError(
                f"this follows targets, and the scenario does not (scan.type: {self.scan.type}).",
                remedy="Write scan: {type: track, targets: [node/1], duration: 2 s}.",
            )
        return self.scan

    @property
    def targets(self) -> tuple[TrackTarget, ...]:
        """The targets that are followed, arrays taken apart; empty where none are."""
        if self.scan.layout != "visits":
            return ()
        return resolve_targets(self.scan, self.scene, self.scanner.mirrors.axis_separation)[0]

    @property
    def photographed(self) -> bool:
        """Whether the video camera takes frames: beside a track, before it, or for ``camera.png``."""
        if self.scan.layout == "visits":
            return "camera" in self.pose.methods or self.scan.tracker.start == "camera"
        return self.output.pictures and self.lighting.sky().sun_visible > 0.0

    def _camera_contradictions(self) -> Iterator[Fault]:
        """Yield why the video camera can have no poses beside a track, or none to begin it with."""
        starts = self.scan.layout == "visits" and self.scan.tracker.start == "camera"
        asked = [("pose.methods", "leave it out")] if "camera" in self.pose.methods else []
        asked += [("scan.tracker.start", "write expected")] if starts else []
        for location, otherwise in asked:
            yield from self._blind_camera(location, otherwise)
        if "camera" not in self.pose.methods and self.output.frames:
            problem = "there are no frames: the camera is not among the methods of poses."
            yield Fault("output.frames", problem, "Write pose: {methods: [camera, joint]}, or false.")
        if not asked or self.scan.layout != "visits" or "camera" not in self.pose.methods:
            return
        frames = len(self.camera.frame_times(self.scan.duration))
        if frames > MOST_FRAMES:
            problem = (
                f"{frames:,} frames in {self.scan.duration:.4g} s; {MOST_FRAMES} are possible beside a track."
            )
            rate = at_most(MOST_FRAMES / self.scan.duration)
            yield Fault("camera.frame_rate", problem, f"Write {rate} Hz or less, or shorten scan.duration.")

    def _blind_camera(self, location: str, otherwise: str) -> Iterator[Fault]:
        """Yield what keeps the camera from seeing arrays of dots that are followed."""
        if self.scan.layout != "visits":
            problem = f"camera works beside a run that follows targets, and scan.type is {self.scan.type}."
            yield Fault(location, problem, "Leave it out, or write scan: {type: track, …}.")
            return
        if self.lighting.sun == "none":
            problem = "camera sees by the Sun's light, and the scenario has no Sun."
            remedy = f"Write lighting: {{sun: {{direction: [0.3, -0.5, -0.8]}}}}, or {otherwise}."
            yield Fault(location, problem, remedy)
        layouts = [item.array for item in self.arrays_followed]
        if not any(
            min(one.rows, one.columns) > 1 and one.rows * one.columns >= FEWEST_DOTS for one in layouts
        ):
            wanted = f"a surveyed array of {FEWEST_DOTS} dots or more, not in one line,"
            problem = f"camera needs {wanted} among what is followed."
            remedy = f"Follow an object with array: {{rows: 2, columns: 2, …}}, or {otherwise}."
            yield Fault(location, problem, remedy)

    @property
    def arrays_followed(self) -> tuple[TargetArray, ...]:
        """The arrays of which a target is followed, or all; empty where none are."""
        followed = {target.object for target in self.targets}
        return tuple(
            item for item in self.scene.objects if isinstance(item, TargetArray) and item.name in followed
        )

    def _missing(self, rangefinder: RangefinderName) -> Fault:
        """Return the fault of a rangefinder that the instrument does not have."""
        part, other = (
            ("position sensor", "tof")
            if rangefinder == "triangulation"
            else ("time-of-flight unit", "triangulation")
        )
        problem = f"{self.scanner.preset} has no {part}, which {self.ranging} asks for."
        return Fault("ranging", problem, f"Write ranging: {other}, or choose an instrument that has one.")

    def _line_contradictions(self) -> Iterator[Fault]:
        pixels = self.scanner.position_sensor.pixels
        window = 2 * MARGIN.get(self.processing.peak, 0) + 1
        if window > pixels:
            yield Fault(
                "processing.peak",
                f"{self.processing.peak} reads {window} pixels, and the array has {pixels}.",
                "Choose another estimator, or raise scanner.position_sensor.pixels.",
            )
        gate = self.processing.range_gate
        nearest, farthest = self.scanner.nearest_range, self.scanner.farthest_range
        if gate is not None and (gate[1] <= nearest or gate[0] >= farthest):
            beyond = f"{nearest:.4g} m " + ("or more" if math.isinf(farthest) else f"to {farthest:.4g} m")
            yield Fault(
                "processing.range_gate",
                f"[{gate[0]:g} m, {gate[1]:g} m] lies outside of the ranges that the array sees, {beyond}.",
                "Move the gate, or change receiver.baseline, receiver.focal_length or the position_sensor.",
            )

    def _pulse_contradictions(self) -> Iterator[Fault]:
        lidar, gate = self.scanner.lidar, self.processing.range_gate
        if (rare := self.scanner.rare_pulses()) is not None:
            yield Fault(f"scanner.{rare.location}", rare.problem, rare.remedy)
        level, saturation = self.processing.pulse.level, lidar.photodiode.saturation
        if level is not None and level >= saturation:
            yield Fault(
                "processing.pulse.level",
                f"{level:.3g} A is not below the {saturation:.3g} A at which the amplifier saturates.",
                "Lower it, or raise scanner.lidar.photodiode.saturation.",
            )
        nearest, farthest = lidar.digitiser.gate
        if gate is not None and (gate[1] <= nearest or gate[0] >= farthest):
            yield Fault(
                "processing.range_gate",
                f"[{gate[0]:g} m, {gate[1]:g} m] lies outside of what the digitiser records, {nearest:.4g} m to "
                f"{farthest:.4g} m.",
                "Move the gate, or change scanner.lidar.digitiser.gate.",
            )

    def _kept_contradictions(self, key: str, rangefinder: str) -> Iterator[Fault]:
        """Yield why lines or waveforms cannot be kept."""
        chosen, scan, location = getattr(self.output, key), self.scan, f"output.{key}"
        if chosen == "none":
            return
        if scan.layout != "image":
            what = "a run that follows targets" if scan.layout == "visits" else f"a scan of type {scan.type}"
            yield Fault(location, f"{what} keeps no {key}.", "Write none, or a raster.")
        elif rangefinder not in self.rangefinders:
            other = "time of flight" if rangefinder == "triangulation" else "triangulation"
            remedy = f"Write ranging: {rangefinder} or both, or {location}: none."
            yield Fault(location, f"{other} has no {key}.", remedy)
        elif not isinstance(chosen, str) and (problem := scan.not_voxels(np.array(chosen).reshape(-1, 2))):
            yield Fault(location, *problem)
