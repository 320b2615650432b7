"""Every layer of a range image, once: files, tables, pictures, documents and the estimate of memory follow from it.

A row more and the layer's values, in ``ranging/ranges.py`` or where an instrument makes them, are a new channel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

from scanner_sim.foundation.parameters import PARAMETERS

Kind = Literal["aim", "point", "measured", "sigma", "signal", "status", "truth", "number"]
"""What a layer holds: when and where a shot points; a range or coordinate, which is finite wherever ``status`` is 0;
another measured number, or what the instrument states of its error; a signal, which is there without a range too; a
status; a truth that only the simulator knows; the number of a name, which is a truth as well."""

Scale = Literal["linear", "logarithmic", "slope", "grey"]
"""How values become colours: evenly; by their logarithm; the inclination of what they are the range of; in grey levels
without axes, a dot for each voxel, the largest the darkest."""

_LINE, _PULSE = ("triangulation",), ("tof",)


@dataclass(frozen=True)
class Picture:
    """How a channel is drawn.

    Attributes
    ----------
    file, meaning
        Name of the file, and what it shows, for documents.
    title, label
        Heading of the picture and of its colour bar.
    colours, scale
        Matplotlib's colour map, and how values become colours.
    dark
        Value below which all is as dark as the end of a logarithmic scale; without it, 0 and less is no value.
    sunlit
        Drawn under the Sun only, where any value is above 0.
    """

    file: str
    meaning: str
    title: str = ""
    label: str = ""
    colours: str = "gray"
    scale: Scale = "linear"
    dark: float | None = None
    sunlit: bool = False


@dataclass(frozen=True)
class Channel:
    """One layer of a range image.

    Attributes
    ----------
    name, unit, meaning
        Name, unit and what it holds, in one sentence.
    kind
        What sort of number it holds.
    rangefinders
        Those that must be there for it; whichever there are for none.
    prefix
        Of the layers of the same rangefinder; its ``status`` tells where measured layers are NaN.
    vertex
        Name among the properties of a point cloud's vertices; empty for none.
    pictures
        How a run draws it.
    asked
        Word of ``output.truth`` that asks for it, ``calibration`` where a calibration with errors does, or
        :data:`JACOBIAN` with the name of a calibrated parameter; empty for what every result has.
    """

    name: str
    unit: str
    meaning: str
    kind: Kind
    rangefinders: tuple[str, ...] = ()
    prefix: str = ""
    vertex: str = ""
    pictures: tuple[Picture, ...] = ()
    asked: str = ""

    @property
    def whole(self) -> bool:
        """Whether it holds whole numbers that stand for names."""
        return self.kind in ("status", "number")

    @property
    def measured(self) -> bool:
        """Whether it is NaN where nothing was measured."""
        return self.kind in ("point", "measured", "sigma")


# fmt: off
_RANGE = Picture(
    "range.png", "range in colours; voxels without one in the colour of their status",
    "Range", "range [m]", "viridis_r",
)
_SHADED = Picture(
    "shaded.png", "derivative of the range in grey levels",
    "Range derivative, towards lower right", "slope [°]", "gray_r", "slope",
)
_SIGNAL = Picture(
    "signal.png", "returned signal on a logarithmic scale",
    "Returned signal", "signal [electrons]", "magma", "logarithmic",
)
_BACKGROUND = Picture(
    "background.png", "under the Sun: charge of sunlight and Earthshine about the spot",
    "Background of Sun and Earth", "charge in 200 µm of the line [electrons]", "inferno", "logarithmic",
    dark=1.0, sunlit=True,
)
_GREY = Picture("tof.png", "with time of flight: its range in grey levels, a dot for each voxel", scale="grey")

_POINT = (
    Channel("range_m", "m", "measured range: path from the first mirror axis to the surface", "point",
            pictures=(_RANGE, _SHADED)),
    Channel("sigma_range_m", "m", "standard deviation of range_m that the instrument states", "sigma",
            vertex="sigma_range_m"),
    Channel("sigma_common_m", "m", "part of sigma_range_m that all voxels have in common: the errors of the "
            "calibration, which no mean makes smaller", "sigma", asked="calibration"),
    Channel("P.X", "m", "measured point, to the right of the scanner", "point", vertex="x"),
    Channel("P.Y", "m", "measured point, downwards", "point", vertex="y"),
    Channel("P.Z", "m", "measured point, away from the scanner", "point", vertex="z"),
    Channel("sigma_x_m", "m", "standard deviation of P.X that the instrument states, about the true point", "sigma"),
    Channel("sigma_y_m", "m", "standard deviation of P.Y that the instrument states", "sigma"),
    Channel("sigma_z_m", "m", "standard deviation of P.Z that the instrument states", "sigma"),
    Channel("cov_xy_m2", "m2", "covariance of P.X and P.Y that the instrument states", "sigma"),
    Channel("cov_xz_m2", "m2", "covariance of P.X and P.Z that the instrument states", "sigma"),
    Channel("cov_yz_m2", "m2", "covariance of P.Y and P.Z that the instrument states", "sigma"),
)
"""Layers of a range and its point, which every rangefinder has."""
_UNEVEN = Channel(
    "sigma_texture_m", "m", "part of sigma_range_m: what light or a surface that is uneven over the spot may move the "
    "range by, seen in the neighbours", "sigma", vertex="sigma_texture_m",
)
# fmt: on


def _by(channel: Channel, prefix: str, way: str, rangefinders: tuple[str, ...]) -> Channel:
    """Return a layer as another rangefinder has it, or several."""
    meaning = f"{channel.meaning}, {way}"
    return Channel(
        prefix + channel.name, channel.unit, meaning, channel.kind, rangefinders, prefix, asked=channel.asked
    )


def _point_by(
    prefix: str, way: str, rangefinders: tuple[str, ...], *pictures: Picture
) -> tuple[Channel, ...]:
    """Return the layers of another rangefinder, or of several; the pictures are of its range."""
    status = Channel("status", "1", "as status", "status")
    return tuple(
        replace(
            _by(channel, prefix, way, rangefinders), pictures=pictures if channel.name == "range_m" else ()
        )
        for channel in (*_POINT, status)
    )


# fmt: off
CHANNELS: tuple[Channel, ...] = (
    *_POINT,
    Channel("Y", "electron",
            "returned signal: charge of the detected peak, before any avalanche; 0 below the threshold", "signal",
            vertex="intensity", pictures=(_SIGNAL,)),
    Channel("snr", "1", "laser light on the array over background in a window of 200 µm, I_laser/I_sun (eqs 18, 19); "
            "inf in the dark", "signal", _LINE),
    Channel("snr_detection", "1", "charge of the brightest pixel over its standard deviation", "signal", _LINE),
    Channel("background", "electron",
            "charge of Sun and Earth in a window of 200 µm about the laser's spot while it shines, noise-free",
            "signal", _LINE, pictures=(_BACKGROUND,)),
    Channel("background_error", "electron", "standard error of background from the finite number of light paths",
            "signal", _LINE),
    Channel("background_peak", "electron",
            "charge of Sun and Earth on the brightest pixel of the line while the laser shines, noise-free",
            "signal", _LINE),
    Channel("peak_px", "pixel", "detected position on the line sensor; the centre of pixel i is at i",
            "measured", _LINE),
    Channel("sigma_peak_px", "pixel", "standard deviation of peak_px that the instrument states", "sigma", _LINE),
    _UNEVEN,
    Channel("status", "1", "0 where a range was measured, otherwise why there is none", "status"),
    *_point_by("tof.", "by time of flight", _PULSE, _GREY),
    _by(_UNEVEN, "tof.", "by time of flight", _PULSE),
    Channel("tof.Y", "electron",
            "charge of the detected echo before the avalanche, from its height, of a clipped one from its length",
            "signal", _PULSE),
    Channel("tof.snr_detection", "1", "height of the echo over the noise of a sample without it", "signal", _PULSE),
    Channel("tof.echoes", "1", "number of echoes in the waveform", "signal", _PULSE),
    Channel("tof.background_w", "W", "light of Sun and Earth on the photodiode, noise-free", "signal", _PULSE),
    *_point_by("fused.", "from triangulation and time of flight", _LINE + _PULSE),
    Channel("truth.range_m", "m", "true range along the chief ray; the instrument does not know it", "truth"),
    Channel("truth.theta_rad", "rad", "true deflection of the beam to the right, in the middle of the dwell", "truth"),
    Channel("truth.phi_rad", "rad", "true deflection of the beam downwards", "truth"),
    Channel("truth.object", "1", "number of the object hit by the chief ray, from 1; 0 for nothing", "number",
            vertex="truth_object"),
    Channel("truth.material", "1", "number of the material hit by the chief ray, from 1; 0 for nothing", "number",
            vertex="truth_material"),
    Channel("truth.P.X", "m", "true point where the chief ray meets a surface, whatever the instrument believes of "
            "itself: to the right", "truth", asked="point"),
    Channel("truth.P.Y", "m", "the same point: downwards", "truth", asked="point"),
    Channel("truth.P.Z", "m", "the same point: away from the scanner", "truth", asked="point"),
    Channel("truth.normal.X", "1", "unit normal of the surface that the chief ray meets, on the scanner's side: to the "
            "right", "truth", vertex="nx", asked="normal"),
    Channel("truth.normal.Y", "1", "the same normal: downwards", "truth", vertex="ny", asked="normal"),
    Channel("truth.normal.Z", "1", "the same normal: away from the scanner, so 0 or less for what faces it", "truth",
            vertex="nz", asked="normal"),
    Channel("truth.incidence_rad", "rad", "angle between that normal and the way back along the beam, 0 to π/2",
            "truth", asked="incidence"),
)
# fmt: on
"""Every layer that a range image can have, but derivatives, in the order of presentation; a run holds those of its
rangefinders."""

JACOBIAN = "J."
"""Begin of the names of derivatives by the parameters of the instrument, after that of the way of ranging."""
MOVED = ("X", "Y", "Z", "R")
"""What they are derivatives of, which their names end in: the point, along each axis, and its range."""
_PER = {"m": "1", "rad": "m rad-1", "1": "m", "rad^-2": "m rad2"}


def _derivatives(prefix: str, way: str, rangefinders: tuple[str, ...]) -> tuple[Channel, ...]:
    """Return the layers of the derivatives of one way of ranging."""
    return tuple(
        Channel(
            f"{prefix}{JACOBIAN}{parameter.name}.{moved}",
            _PER[parameter.dimension.unit],
            f"derivative of {prefix + ('range_m' if moved == 'R' else 'P.' + moved)}{way} by the believed "
            f"{parameter.name}: {parameter.meaning}",
            "measured",
            rangefinders,
            prefix,
            asked=JACOBIAN + parameter.name,
        )
        for parameter in PARAMETERS
        for moved in MOVED
    )


DERIVATIVES: tuple[Channel, ...] = (
    *_derivatives("", "", ()),
    *_derivatives("tof.", ", by time of flight,", _PULSE),
    *_derivatives("fused.", ", from triangulation and time of flight,", _LINE + _PULSE),
)
"""Layers that ``output.jacobian`` asks for, of those parameters whose calibration has an error."""

CHANNEL: Mapping[str, Channel] = MappingProxyType(
    {channel.name: channel for channel in (*CHANNELS, *DERIVATIVES)}
)
"""Both tables by name."""

MEASURED_BY: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        status.name: tuple(
            channel.name
            for channel in CHANNEL.values()
            if channel.measured and channel.prefix == status.prefix
        )
        for status in CHANNELS
        if status.kind == "status"
    }
)
"""For each layer of status, the layers that are NaN wherever it is not 0."""


def channels_by(rangefinders: Sequence[str], truth: Sequence[str] = ()) -> tuple[Channel, ...]:
    """Return the channels that some rangefinders make, with those that are asked for beside."""
    return tuple(
        channel
        for channel in CHANNEL.values()
        if set(channel.rangefinders) <= set(rangefinders) and channel.asked in ("", *truth)
    )


def layer_bytes(rangefinders: Sequence[str], truth: Sequence[str] = ()) -> int:
    """Return the bytes of a voxel in the layers of :func:`channels_by`, float32 each."""
    return 4 * len(channels_by(rangefinders, truth))
