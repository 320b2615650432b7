"""All the light on the line: the laser's through the filter, and the background.

A pixel of area a at a position p of the sensor looks at an angle ψ to the lens's axis, atan(p/f) on an upright one in
the focal plane, and collects L A a cos⁴ψ / f² of a background of radiance L (Pedrotti, *Introduction to optics*, 3rd
ed., ch. 5; on the axis this is eq 18). A tilted array, or one farther behind the lens, sees less of it where the image
is larger (:mod:`scanner_sim.optics.line_image`). What passes the filter depends on ψ as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from scanner_sim.foundation.device_memory import for_device
from scanner_sim.foundation.device_numbers import beside
from scanner_sim.foundation.device_types import Float, UInt32
from scanner_sim.render.background.panorama import Panorama
from scanner_sim.render.background.view import WINDOW
from scanner_sim.render.beam.light import Light
from scanner_sim.render.shots import Shots
from scanner_sim.render.transport import OpticalLayout


class Throughput:
    """What each pixel makes of the light, Dr.Jit tables of shape (pixels,).

    Parameters
    ----------
    layout
        The optics.
    pixels
        Number of pixels.
    laser
        Share of the laser's light that the filter passes at each pixel, of its peak transmission, shape (pixels,).
    in_band, out_of_band
        The Sun's irradiance that the detector counts behind the filter at each pixel [W/m²], shape (pixels,), in
        watts that free as many electrons as watts of the laser's wavelength.
    stray
        Share of all light that is scattered evenly over the pixels.
    """

    def __init__(
        self,
        layout: OpticalLayout,
        pixels: int,
        laser: NDArray[np.float64],
        in_band: NDArray[np.float64],
        out_of_band: NDArray[np.float64],
        stray: float = 0.0,
    ) -> None:
        receiver = layout.receiver
        self.pixels, self.stray = pixels, stray
        position = layout.offset + (np.arange(pixels) + 0.5) * layout.pitch
        tangent, seen = receiver.line_image.tangent(position), receiver.line_image.at(position, 1.0, 1.0)
        gain = receiver.aperture_area * receiver.transmission * layout.filter_transmission
        collected = gain * layout.pitch * layout.height / receiver.focal_length**2 / (1.0 + tangent**2) ** 2
        collected = collected / (seen.along * seen.across)
        self.window = WINDOW / layout.pitch
        self.laser = _table(laser)
        self.angle = _table(np.arctan(tangent))
        self.in_band = _table(collected * in_band)
        self.out_of_band = _table(collected * out_of_band)


@dataclass
class LinkBudget:
    """The light of m shots as the paper counts it, Dr.Jit arrays of shape (m,) [W].

    ``laser`` is I_laser, the laser light that reaches the array (eq 19); ``field``, of which the paper does not tell,
    that with what falls beside the array, a share of which is stray light; ``background`` I_sun, that of Sun and Earth
    in a window of 200 µm about the laser's light (eq 18), or about the middle of the array where there is none;
    ``background_error`` the standard error of that from the finite number of paths.
    """

    laser: Float
    field: Float
    background: Float
    background_error: Float


@dataclass
class KnownBackground:
    """The background of m shots where it is known pixel by pixel.

    ``power`` [W], a Dr.Jit array of shape (m · pixels,), the pixels of a shot side by side, or None in the dark; and
    how the light of each shot was counted.
    """

    power: Float | None
    budget: LinkBudget


@dataclass
class Incident:
    """All the light on the line of a group of m shots.

    Attributes
    ----------
    light
        The laser's.
    shots
        The m shots.
    columns
        Voxels of a row, by which a shot's number gives its row.
    throughput
        Of the pixels.
    panorama
        The background, or None in the dark.
    speckle
        What multiplies the laser's light on (pixel, index of the shot), or None for light without speckle.
    known
        The background in the panorama's stead, where it is kept from earlier.
    """

    light: Light
    shots: Shots
    columns: int
    throughput: Throughput
    panorama: Panorama | None
    speckle: Callable[[UInt32, UInt32], Float] | None = None
    known: KnownBackground | None = None

    def __post_init__(self) -> None:
        self.light.extent()  # here, since a loop that is being recorded can evaluate nothing
        self._veil: Float | None = None
        self._unlit_veil: Float | None = None
        if self.throughput.stray > 0.0:
            self._veil, self._unlit_veil = self._scattered()

    @property
    def is_lit(self) -> bool:
        """Whether anything but the laser lights the line."""
        return self.panorama is not None or (self.known is not None and self.known.power is not None)

    def pair(self, pixel: UInt32, index: UInt32) -> tuple[Float, Float, Float]:
        """Return the power [W] on pixels of shots by their indices, 0 to m − 1, and on the next ones.

        And the larger of what the background has on both. Dr.Jit arrays of one shape.
        """
        found, brightest = [], mi.Float(0.0)
        for step, laser in enumerate(self.light.pair(pixel, index)):
            at = pixel + step
            power = laser * self._at_pixel(self.throughput.laser, at)
            if self.speckle is not None:
                power *= self.speckle(at, index)
            if self.is_lit:
                beneath = self.background(at, index)
                power = power + beneath
                brightest = dr.maximum(brightest, beneath)
            found.append(self._veiled(power, self._veil, index))
        return found[0], found[1], brightest

    def unlit(self, pixel: UInt32, index: UInt32) -> Float:
        """Return the power [W] on pixels of shots without the laser: the background, part of which is scattered."""
        return self._veiled(self.background(pixel, index), self._unlit_veil, index)

    def _veiled(self, power: Float, veil: Float | None, index: UInt32) -> Float:
        """Return what scattering leaves of the power [W] on pixels, with what it brings there from everywhere."""
        if veil is None:
            return power
        return dr.opaque(mi.Float, 1.0 - self.throughput.stray) * power + dr.gather(mi.Float, veil, index)

    def _scattered(self) -> tuple[Float, Float | None]:
        """Return the power [W] that is scattered onto each pixel of the shots, shape (m,): its share of all light.

        And the same of the background alone, None in the dark.
        """
        index, share = dr.arange(mi.UInt32, self.light.shots), self.throughput.stray / self.throughput.pixels
        whole, unlit = dr.zeros(mi.Float, self.light.shots), None
        for _, amount in self._passed(index):
            whole = whole + amount
        if self.is_lit:
            around = self._whole_background(index)
            whole, unlit = whole + around, around * dr.opaque(mi.Float, share)
        veil = whole * dr.opaque(mi.Float, share)
        dr.eval(veil, unlit)
        return veil, unlit

    def _passed(self, index: UInt32) -> Iterator[tuple[Float, Float]]:
        """Yield where clusters of laser light lie [pixel], and what the filter passes of each [W].

        As it does at the pixel nearest to it; a cluster may lie beside the array.
        """
        light, last = self.light, self.throughput.pixels - 1
        shots = dr.opaque(mi.UInt32, light.shots)
        for number in range(light.count):
            at = index + number * shots
            position, amount = dr.gather(mi.Float, light.position, at), dr.gather(mi.Float, light.amount, at)
            nearest = mi.UInt32(dr.clip(dr.round(position), 0.0, last))
            yield position, amount * self._at_pixel(self.throughput.laser, nearest)

    def _whole_background(self, index: UInt32) -> Float:
        """Return the background's power [W] on all pixels together."""
        return dr.while_loop(
            (mi.UInt32(0), dr.zeros(mi.Float, dr.width(index))),
            lambda pixel, _: pixel < self.throughput.pixels,
            lambda pixel, total: (pixel + 1, total + self.background(pixel, index)),
        )[1]

    def background(self, pixel: UInt32, index: UInt32) -> Float:
        """Return the background's power [W] alone."""
        if self.known is not None and self.known.power is not None:
            pixels = dr.opaque(mi.UInt32, self.throughput.pixels)
            return dr.gather(mi.Float, self.known.power, index * pixels + pixel, pixel < pixels)
        if self.panorama is None:
            return dr.zeros(mi.Float, dr.width(pixel))
        return self._background(self.panorama.seen_by(index), pixel, index)

    def _background(self, panorama: Panorama, pixel: UInt32, index: UInt32) -> Float:
        """Return the background's power [W] of a panorama as the shots see it."""
        in_band, out_of_band = (
            self._look_up(panorama, layer, pixel, index) for layer in (panorama.in_band, panorama.out_of_band)
        )
        return in_band * self._at_pixel(self.throughput.in_band, pixel) + out_of_band * self._at_pixel(
            self.throughput.out_of_band, pixel
        )

    def line(self, index: int, *, background: bool = True) -> NDArray[np.float64]:
        """Return the power [W] on every pixel of the shot with an index, or what the laser adds, shape (pixels,)."""
        pixel = dr.arange(mi.UInt32, self.throughput.pixels)
        indices = dr.full(mi.UInt32, index, self.throughput.pixels)
        power = self.pair(pixel, indices)[0] - (0.0 if background else self.unlit(pixel, indices))
        return np.asarray(power.numpy(), dtype=np.float64)

    def lines(self) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Return the laser's and the background's power [W] on all pixels, each (m, pixels); no background: None.

        The laser's is that before speckle, and of both nothing is scattered.
        """
        m, pixels = self.light.shots, self.throughput.pixels
        lane, width = dr.arange(mi.UInt32, m * pixels), dr.opaque(mi.UInt32, pixels)
        index, pixel = lane // width, lane % width
        laser = self.light.power(pixel, index) * self._at_pixel(self.throughput.laser, pixel)
        background = self.background(pixel, index) if self.is_lit else None
        dr.eval(laser, background)
        return laser.numpy().reshape(m, pixels), (
            None if background is None else background.numpy().reshape(m, pixels)
        )

    def link_budget(self) -> LinkBudget:
        """Return the light of each shot as the paper counts it."""
        if self.known is not None:
            return self.known.budget
        index, last = dr.arange(mi.UInt32, self.light.shots), self.throughput.pixels - 1
        laser, field, moment = mi.Float(0.0), mi.Float(0.0), mi.Float(0.0)
        for position, passed in self._passed(index):
            amount = dr.select((position > -0.5) & (position < last + 0.5), passed, 0.0)
            laser += amount
            field += passed
            moment += amount * position
        centre = dr.select(laser > 0.0, moment / laser, 0.5 * last)
        # The window's pixels, the outer ones in part.
        reach = math.ceil(0.5 * self.throughput.window + 1.0)
        (end,) = beside(centre, 0.5 * self.throughput.window + 0.5)
        window, gain, gain_out = mi.Float(0.0), mi.Float(0.0), mi.Float(0.0)
        panorama = None if self.panorama is None else self.panorama.seen_by(index)
        for step in range(-reach, reach + 1):
            pixel = dr.round(centre) + step
            apart = dr.abs(pixel - centre)
            share = dr.clip(end - apart, 0.0, 1.0)
            inside = (pixel >= 0.0) & (pixel <= last) & (share > 0.0)
            nearest_pixel = mi.UInt32(dr.clip(pixel, 0.0, last))
            if panorama is not None:
                window += dr.select(inside, share * self._background(panorama, nearest_pixel, index), 0.0)
            gain += dr.select(inside, share * self._at_pixel(self.throughput.in_band, nearest_pixel), 0.0)
            gain_out += dr.select(
                inside, share * self._at_pixel(self.throughput.out_of_band, nearest_pixel), 0.0
            )
        error = self._error(mi.UInt32(dr.clip(dr.round(centre), 0.0, last)), index, gain, gain_out)
        dr.eval(laser, field, window, error)
        return LinkBudget(laser, field, window, error)

    def _error(self, middle: UInt32, index: UInt32, gain: Float, gain_out: Float) -> Float:
        """Return the standard error [W] of the background in a window about a pixel; both bands err together."""
        if self.panorama is None:
            return dr.zeros(mi.Float, dr.width(index))
        panorama = self.panorama.seen_by(index)
        error, error_out = (
            self._look_up(panorama, layer, middle, index) for layer in (panorama.error, panorama.error_out)
        )
        return gain * error + gain_out * error_out

    def _look_up(self, panorama: Panorama, layer: Float, pixel: UInt32, index: UInt32) -> Float:
        """Return a layer of a panorama, as the shots see it, where pixels look."""
        row = panorama.view.row(self.shots, index, self.columns)
        angle = dr.gather(mi.Float, self.shots.theta, index) - self._at_pixel(self.throughput.angle, pixel)
        return panorama.look(layer, row, angle)

    def _at_pixel(self, table: Float, pixel: UInt32) -> Float:
        """Return what a table holds of pixels, 0 beyond the line."""
        return dr.gather(mi.Float, table, pixel, pixel < self.throughput.pixels)


def _table(values: NDArray[np.float64]) -> Float:
    return mi.Float(for_device(values))
