"""The video camera beside the scanner, with all that makes its frames."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from scanner_sim.detector.frame.exposure import AutomaticExposure, ExposureChoice
from scanner_sim.detector.frame.glare import Glare
from scanner_sim.detector.frame.sensor import FrameSensor
from scanner_sim.foundation.errors import Fault, at_most
from scanner_sim.foundation.parts import Count, Number, Part
from scanner_sim.foundation.units import Angle, Frequency, Length, Ratio, Time
from scanner_sim.optics.interior_orientation import InteriorOrientation
from scanner_sim.scene.poses import Position, Turns, placement_matrix

_DIFFRACTION_WAVELENGTH = 550e-9
_DIFFRACTION = 0.42
"""σ of the Gaussian nearest to Airy's pattern, in λN: 0.21 λ/NA (Zhang, Zerubia and Olivo-Marin, *Appl. Opt.* 46, 2007,
1819, Table 3) with NA = 1/(2N)."""


class VideoOrientation(InteriorOrientation):
    """Interior orientation of the video camera, as a calibration tells it; by default 30° × 23° without distortion."""

    focal_length: Length = Field(default=12e-3, ge=1e-4, le=10.0)
    """Distance of the lens from the pixels, at which the camera is focused (the calibrated focal length)."""
    pixel_pitch: Length = Field(default=10e-6, ge=1e-7, le=1e-3)
    """Distance of neighbouring pixels, along rows and columns (assumed)."""
    columns: Count = Field(default=640, ge=8, le=16384)
    """Pixels of a row."""
    rows: Count = Field(default=480, ge=8, le=16384)
    """Pixels of a column."""


class CameraLens(Part):
    """How much light a camera's lens collects, and how sharp: in focus at every distance."""

    f_number: Number = Field(default=8.0, ge=0.5, le=128.0)
    """Focal length over the diameter of the entrance pupil."""
    transmission: Ratio = Field(default=0.85, gt=0.0, le=1.0)
    """Share of the light that passes lens and filter (assumed)."""
    aberration: Length = Field(default=3e-6, ge=0.0, le=1e-3)
    """Standard deviation, per axis, of a point's image on the sensor, without diffraction (assumed)."""
    glare: Glare = Glare()
    """Strewn light."""

    @property
    def point_spread(self) -> float:
        """Standard deviation of a point's image [m], per axis, with diffraction at 550 nm."""
        return math.hypot(self.aberration, _DIFFRACTION * _DIFFRACTION_WAVELENGTH * self.f_number)


class CameraMount(Part):
    """Where the camera stands in the scanner's frame; by default at its origin, looking along z, with v along y."""

    position: Position = (0.0, 0.0, 0.0)
    """Position of the lens."""
    rotation: Turns = ()
    """Turns about it, the first one first."""


class CameraAsBuilt(Part):
    """What the camera is beyond what its calibration says; an estimator never sees it."""

    focal_length: Length = Field(default=0.0, ge=-0.1, le=0.1)
    """Error of the focal length."""
    principal_point: tuple[Number, Number] = (0.0, 0.0)
    """Error of the principal point (u, v), in pixels."""
    k1: Number = Field(default=0.0, ge=-10.0, le=10.0)
    """Error of k₁."""
    k2: Number = Field(default=0.0, ge=-100.0, le=100.0)
    """Error of k₂."""
    k3: Number = Field(default=0.0, ge=-1000.0, le=1000.0)
    """Error of k₃."""
    p1: Number = Field(default=0.0, ge=-1.0, le=1.0)
    """Error of p₁."""
    p2: Number = Field(default=0.0, ge=-1.0, le=1.0)
    """Error of p₂."""
    mount: CameraMount = CameraMount()
    """Error of the mount: position and turns in the camera's own frame."""


class CameraDoubt(Part):
    """Standard deviations of a calibration: by how much ``interior`` and ``mount`` may be wrong. 0: they are right."""

    focal_length: Length = Field(default=0.0, ge=0.0, le=0.1)
    """Of the focal length."""
    principal_point: tuple[Number, Number] = (0.0, 0.0)
    """Of the principal point (u, v), in pixels."""
    k1: Number = Field(default=0.0, ge=0.0, le=10.0)
    """Of k₁."""
    k2: Number = Field(default=0.0, ge=0.0, le=100.0)
    """Of k₂."""
    k3: Number = Field(default=0.0, ge=0.0, le=1000.0)
    """Of k₃."""
    p1: Number = Field(default=0.0, ge=0.0, le=1.0)
    """Of p₁."""
    p2: Number = Field(default=0.0, ge=0.0, le=1.0)
    """Of p₂."""
    position: Length = Field(default=0.0, ge=0.0, le=10.0)
    """Of the mount's place, along each axis."""
    rotation: Angle = Field(default=0.0, ge=0.0, le=0.5)
    """Of its attitude, about each axis."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield standard deviations below 0."""
        if min(self.principal_point) < 0.0:
            yield Fault("principal_point", "a standard deviation is below 0.", "Write [0.1, 0.1].")

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Of :data:`~scanner_sim.optics.interior_orientation.PARAMETERS`, shape (8, 8)."""
        u, v = self.principal_point
        found = [self.focal_length, u, v, self.k1, self.k2, self.k3, self.p1, self.p2]
        return np.diag(np.square(found))

    @property
    def mount_covariance(self) -> NDArray[np.float64]:
        """Of the mount's (δt, δω), shape (6, 6)."""
        return np.diag(np.square([self.position] * 3 + [self.rotation] * 3))


class FrameSampling(Part):
    """How finely light is followed to a pixel."""

    samples: Literal[4, 16, 64, 256] = 16
    """Paths of light per pixel, in strata of its footprint."""
    edge_samples: Literal[4, 16, 64, 256, 1024] = 64
    """The same where brightness or material changes within a pixel or its neighbours. Write 256 where centres of dots
    are to be right to 0.005 pixel."""
    bounces: Count = Field(default=4, ge=1, le=16)
    """Surfaces that the light may meet."""


class VideoCamera(Part):
    """A video camera that looks where the scanner looks, under the same Sun and Earth."""

    interior: VideoOrientation = VideoOrientation()
    """Interior orientation: what estimators believe."""
    as_built: CameraAsBuilt = CameraAsBuilt()
    """How the camera differs from that."""
    calibration: CameraDoubt = CameraDoubt()
    """How well ``interior`` and ``mount`` are known."""
    lens: CameraLens = CameraLens()
    """Light and sharpness."""
    mount: CameraMount = CameraMount()
    """Where it stands."""
    sensor: FrameSensor = FrameSensor()
    """Charges and numbers."""
    exposure: ExposureChoice = AutomaticExposure(type="automatic")
    """How long its frames are exposed."""
    frame_rate: Frequency = Field(default=30.0, ge=1e-3, le=1e6)
    """Frames a second."""
    latency: Time = Field(default=1.0 / 30.0, ge=0.0, le=100.0)
    """From the end of an exposure until the frame can be read."""
    sampling: FrameSampling = FrameSampling()
    """How finely light is followed."""

    def cross_checks(self) -> Iterator[Fault]:
        """Yield exposures that are longer than a frame, and errors that make another camera of it."""
        own = self.exposure
        longest = own.longest if isinstance(own, AutomaticExposure) else own.time
        if longest > (1.0 + 1e-9) / self.frame_rate:
            name = "longest" if isinstance(own, AutomaticExposure) else "time"
            yield Fault(
                f"exposure.{name}",
                f"{longest:.4g} s is longer than a frame of {1.0 / self.frame_rate:.4g} s.",
                f"Write {at_most(1.0 / self.frame_rate, 4)} s or less, or lower frame_rate.",
            )
        try:
            self.true_interior  # noqa: B018 (whether there is one)
        except ValidationError:
            yield Fault(
                "as_built",
                "with these errors there is no interior orientation: no focal length, or a distortion that folds.",
                "Write errors that are small beside the values of interior.",
            )

    def frame_times(self, duration: float) -> NDArray[np.float64]:
        """Return when the frames of a run of some duration [s] begin: at 0, then at the frame rate, shape (n,)."""
        return np.arange(max(math.ceil(duration * self.frame_rate * (1.0 - 1e-9)), 1)) / self.frame_rate

    @property
    def true_interior(self) -> InteriorOrientation:
        """The interior orientation by which light is imaged."""
        own, error = self.interior, self.as_built
        u, v = own.centre
        return InteriorOrientation(
            focal_length=own.focal_length + error.focal_length,
            pixel_pitch=own.pixel_pitch,
            columns=own.columns,
            rows=own.rows,
            principal_point=(u + error.principal_point[0], v + error.principal_point[1]),
            **{name: getattr(own, name) + getattr(error, name) for name in ("k1", "k2", "k3", "p1", "p2")},
        )

    @property
    def scanner_from_camera(self) -> NDArray[np.float64]:
        """The pose of the mount as it is believed, shape (4, 4)."""
        return placement_matrix(self.mount.position, self.mount.rotation)

    @property
    def error_of_mount(self) -> NDArray[np.float64]:
        """``believed_from_true`` of the camera's frame, shape (4, 4)."""
        error = self.as_built.mount
        return placement_matrix(error.position, error.rotation)
