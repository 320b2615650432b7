"""What the pixels of a row look at: the angles of a panorama, and the rays through its bins."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_types import Float, UInt32, Vector3f
from scanner_sim.render.settings import ROW_SPACING
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout, device_frame

WINDOW = 200e-6
"""Length of the window in which the paper counts the background, along the line [m] (eq 18)."""

_QUANTILES = 1024


@dataclass(frozen=True)
class Rows:
    """Rows of φ in which the background is rendered, over a range of Θ.

    Attributes
    ----------
    horizontal
        First and last Θ of the shots [rad].
    phi
        φ of each row [rad], shape (rows,), in even steps.
    time
        When each row is looked at [s], shape (rows,), or (1,) for all alike; None leaves moving objects where the
        loaded scene has them.
    between
        Whether shots look between rows, and not each at the row that its number tells.
    """

    horizontal: tuple[float, float]
    phi: NDArray[np.float64]
    time: NDArray[np.float64] | None = None
    between: bool = False


@dataclass(frozen=True)
class PanoramaView:
    """The angles of a raster's panoramas.

    Attributes
    ----------
    phi
        φ of each row [rad], shape (rows,).
    first, step
        Angle of the first bin's centre, and of a bin [rad].
    bins
        Number of bins of a row.
    time, between
        Those of :class:`Rows`.
    """

    phi: NDArray[np.float64]
    first: float
    step: float
    bins: int
    time: NDArray[np.float64] | None = None
    between: bool = False
    start: ClassVar[None] = None

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.phi)

    @property
    def row_step(self) -> float:
        """Angle between rows [rad]; infinite where there is one row only."""
        return float(self.phi[1] - self.phi[0]) if self.rows > 1 else math.inf

    def lattice(self) -> tuple[Float, Float, Float]:
        """Return angle of the first bin's centre and of a bin [rad], and number of the last bin: opaque Dr.Jit."""
        first, step, last = (dr.opaque(mi.Float, value) for value in (self.first, self.step, self.bins - 1))
        return first, step, last

    def angles(self) -> Float:
        """Return φ of the rows [rad], Dr.Jit."""
        return mi.Float(self.phi.astype(np.float32))

    def quantiles(self, layout: OpticalLayout) -> Float:
        """Return the quantiles of the pixels' height [m], Dr.Jit."""
        return device_quantiles(self.pixel_height(layout), layout.point_spread)

    def pixel_height(self, layout: OpticalLayout) -> float:
        """Return the height [m] of the pixels with which a row is rendered."""
        return lowered_height(layout, self.row_step) if self.between else layout.height

    def row(self, shots: Shots, index: UInt32, columns: int) -> UInt32 | Float:
        """Return the rows of shots by their indices: by a raster's numbers, or where between the rows φ lies."""
        if self.between:
            at = (dr.gather(mi.Float, shots.phi, index) - dr.opaque(mi.Float, self.phi[0])) / dr.opaque(
                mi.Float, self.row_step
            )
            return dr.clip(at, 0.0, dr.opaque(mi.Float, self.rows - 1.0))
        return dr.gather(mi.UInt32, shots.number, index) // dr.opaque(mi.UInt32, columns)


@dataclass
class Window:
    """The angles of a panorama whose position may change without another kernel: a part of a lattice.

    What pixels see of it is interpolated between rows. That spreads light over a variance of a sixth of a row's step;
    the rows are rendered with pixels that are as much less high, so that the variance across is the pixels' own.

    Attributes
    ----------
    first, phi
        Angle of the first bin's centre, and φ of the first row [rad], Dr.Jit numbers.
    rows, bins
        Numbers of rows and bins: whole numbers to render it, or Dr.Jit ones to look at it.
    step, row_step
        Angle of a bin, and between rows [rad].
    heights
        Quantiles of the height, Dr.Jit: :func:`window_heights`. Only to render it.
    start
        Index of the first entry of its layers, Dr.Jit; None for 0.
    """

    first: Float
    phi: Float
    rows: UInt32
    bins: UInt32
    step: float
    row_step: float
    heights: Float = None
    start: UInt32 | None = None
    time: None = None

    def lattice(self) -> tuple[Float, Float, Float]:
        """Return angle of the first bin's centre and of a bin [rad], and number of the last bin, Dr.Jit."""
        return self.first, dr.opaque(mi.Float, self.step), mi.Float(self.bins) - 1.0

    def angles(self) -> Float:
        """Return φ of the rows [rad], Dr.Jit."""
        return dr.fma(dr.arange(mi.Float, self.rows), dr.opaque(mi.Float, self.row_step), self.phi)

    def quantiles(self, layout: OpticalLayout) -> Float:  # noqa: ARG002 (a raster's view needs it)
        """Return the quantiles of the pixels' height [m], Dr.Jit."""
        return self.heights

    def row(self, shots: Shots, index: UInt32, columns: int) -> Float:  # noqa: ARG002 (a raster's view needs it)
        """Return where between the rows shots look, by their indices, 0 to rows − 1."""
        at = (dr.gather(mi.Float, shots.phi, index) - self.phi) / dr.opaque(mi.Float, self.row_step)
        return dr.clip(at, 0.0, mi.Float(self.rows) - 1.0)


@dataclass
class WindowsBeside(Window):
    """Windows of patterns, whose layers lie one after the other: Dr.Jit entries for each pattern.

    ``shots`` is the number of shots of each.
    """

    shots: int = 1

    def at(self, index: UInt32) -> Window:
        """Return the window of each shot, by their indices."""
        pattern = index // dr.opaque(mi.UInt32, self.shots)
        first, phi = (dr.gather(mi.Float, values, pattern) for values in (self.first, self.phi))
        columns = (self.rows, self.bins, self.start)
        rows, bins, start = (dr.gather(mi.UInt32, values, pattern) for values in columns)
        return Window(first, phi, rows, bins, self.step, self.row_step, start=start)


def counted(number: int | UInt32, kind: Any = None) -> UInt32:
    """Return a number of rows, bins or samples as a Dr.Jit array: a kernel is then that of any number."""
    return number if dr.is_array_v(number) else dr.opaque(mi.UInt32 if kind is None else kind, number)


def window_position(first: float, phi: float) -> list[Float]:
    """Return first angle and first φ [rad] of a :class:`Window` as opaque Dr.Jit numbers."""
    return [dr.opaque(mi.Float, value) for value in (first, phi)]


def join_windows(
    positions: Sequence[tuple[float, float, int, int]], layers: Sequence[Sequence[Float]]
) -> list[Any]:
    """Return windows side by side: first angles and φ [rad], rows, bins and starts by pattern, and the layers, Dr.Jit.

    Parameters
    ----------
    positions
        First angle, first φ [rad], rows and bins of the window of each pattern.
    layers
        The layers of its panorama, as many for each.
    """
    first, phi, rows, bins = (np.array(column) for column in zip(*positions, strict=True))
    sizes = rows * bins
    angles = [mi.Float(for_device(values)) for values in (first, phi)]
    numbers = [mi.UInt32(for_device(values, np.uint32)) for values in (rows, bins, np.cumsum(sizes) - sizes)]
    return [*angles, *numbers, *(_joined(parts) for parts in zip(*layers, strict=True))]


def _joined(layers: Sequence[Float]) -> Float:
    """Return arrays one behind the other; ``dr.concat`` would compile a kernel for each size."""
    if len(layers) == 1:
        return layers[0]
    whole, start = dr.empty(mi.Float, sum(dr.width(layer) for layer in layers)), 0
    for layer in layers:
        at = dr.arange(mi.UInt32, dr.width(layer)) + dr.opaque(mi.UInt32, start)
        dr.scatter(whole, layer, at, mode=dr.ReduceMode.Permute)
        start += dr.width(layer)
    dr.eval(whole)
    return whole


def window_heights(layout: OpticalLayout, row_step: float) -> Float:
    """Return the quantiles of the height [m] of pixels whose rows are a step [rad] apart and interpolated, Dr.Jit."""
    return device_quantiles(lowered_height(layout, row_step), layout.point_spread)


def lowered_height(layout: OpticalLayout, row_step: float) -> float:
    """Return the height of pixels [m] which rows a step [rad] apart, interpolated, make as high as they are.

    h²/12 less (f δ)²/6, as a height: for steps up to 0.6 of a pixel's height, h/f.
    """
    spread = (layout.receiver.focal_length * row_step) ** 2
    return math.sqrt(max(layout.height**2 - 2.0 * spread, 0.0))


def row_spacing(layout: OpticalLayout) -> float:
    """Return the angle [rad] between rows that are dense enough to interpolate between them."""
    return ROW_SPACING * layout.height / layout.receiver.focal_length


def rows_between(
    horizontal: tuple[float, float], vertical: tuple[float, float], layout: OpticalLayout, time: float | None
) -> Rows:
    """Return even rows for shots anywhere between two Θ and two φ [rad], at a time [s] or as the scene was loaded."""
    step = row_spacing(layout)
    first = math.floor(vertical[0] / step) - 1
    # As many rows wherever the shots lie on the grid: kernels know the numbers of rows and bins.
    phi = step * (first + np.arange(math.ceil((vertical[1] - vertical[0]) / step) + 4, dtype=np.float64))
    return Rows(horizontal, phi, None if time is None else np.array([time]), between=True)


def panorama_view(rows: Rows, layout: OpticalLayout, pixels: int) -> PanoramaView:
    """Return the angles that the pixels of the line see in some rows."""
    image, step = layout.receiver.line_image, layout.pitch / layout.receiver.focal_length
    first = rows.horizontal[0] - math.atan(image.tangent(layout.offset + pixels * layout.pitch)) - step
    last = rows.horizontal[1] - math.atan(image.tangent(layout.offset)) + step
    bins = math.ceil((last - first) / step) + 1
    return PanoramaView(rows.phi, first, step, bins, rows.time, rows.between)


def rays_through(
    layout: OpticalLayout,
    view: PanoramaView | Window,
    row: UInt32,
    column: UInt32,
    along: Float,
    height: Float,
) -> tuple[Vector3f, Vector3f]:
    """Return the rays from the lens node through points of bins.

    Parameters
    ----------
    layout, view
        Optics and angles.
    row, column
        The bins; Dr.Jit, shape (n,).
    along
        Position along the row from the bin's centre [bin], shape (n,).
    height
        Place on the pixel across the row [m], shape (n,).

    Returns
    -------
    tuple
        Origins and unit directions, shape (n,).
    """
    first, step, _ = view.lattice()
    phi = dr.gather(mi.Float, view.angles(), row)
    frame = device_frame(layout, (mi.Float(column) + along) * step + first, phi)
    slope = height / dr.opaque(mi.Float, layout.receiver.focal_length)
    return mi.Point3f(frame.lens), dr.normalize(frame.along + frame.normal * slope)


def height_on_pixel(layout: OpticalLayout, view: PanoramaView | Window, across: Float) -> Float:
    """Return places across the row [m] by uniform numbers: the pixel's height blurred by the point spread."""
    table = view.quantiles(layout)
    at = across * _QUANTILES
    low = mi.UInt32(dr.minimum(at, _QUANTILES - 1.0))
    return dr.lerp(dr.gather(mi.Float, table, low), dr.gather(mi.Float, table, low + 1), at - mi.Float(low))


def device_quantiles(height: float, point_spread: float) -> Float:
    """Return :func:`height_quantiles` on the device, Dr.Jit."""
    return mi.Float(height_quantiles(height, point_spread).astype(np.float32))


def height_quantiles(height: float, point_spread: float) -> NDArray[np.float64]:
    """Return quantiles of the position across the line at which light that a pixel counts would land unblurred.

    The pixel's height convolved with the Gaussian point spread; one number through the quantile keeps points that
    are spread evenly so, where a sum of two would not.

    Parameters
    ----------
    height, point_spread
        Height of a pixel, and standard deviation of the point spread [m].

    Returns
    -------
    ndarray
        Positions [m] at equal steps of probability, both ends included; the Gaussian ends at 4 standard deviations.
    """
    probability = np.linspace(0.0, 1.0, _QUANTILES + 1)
    if point_spread <= 0.0:
        return height * (probability - 0.5)
    reach = 0.5 * height + 4.0 * point_spread
    position = np.linspace(-reach, reach, 8 * _QUANTILES + 1)

    def integral(x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the integral of the normal distribution function."""
        return np.asarray(
            0.5 * x * (1.0 + erf(x / math.sqrt(2.0))) + np.exp(-0.5 * x**2) / math.sqrt(2.0 * math.pi)
        )

    below = integral((position + 0.5 * height) / point_spread) - integral(
        (position - 0.5 * height) / point_spread
    )
    return np.interp(probability, (below - below[0]) / (below[-1] - below[0]), position)
