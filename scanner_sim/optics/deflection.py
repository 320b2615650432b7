"""The two deflecting mirrors: where the laser and the receiver stand and look (eqs 1 and 3).

The first mirror turns the beam by Θ in a plane; the second turns that plane, with laser *and* receiver in it,
by φ about the line x ∥, z = D_g. Laser and receiver are virtual points that move with φ. See
:mod:`scanner_sim.foundation.frames` for the axes. The equations are those of Blais, Beraldin, El-Hakim (2000), section
2.2, and hold exactly in this model; the mirrors are infinitely thin and of unlimited size.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from scanner_sim.foundation.device_types import FloatLike, Vector3f
from scanner_sim.foundation.parts import Part
from scanner_sim.foundation.units import (
    Angle,
    AnglePerKelvin,
    Length,
    Ratio,
    RatioPerKelvin,
    TemperatureDifference,
    TemperatureRate,
    Time,
)

Array = NDArray[np.float64]

ERRORS: dict[str, tuple[str, ...]] = {
    "jitter": ("jitter",),
    "wobble": ("wobble",),
    "synchronisation": ("synchronisation",),
    "readout": ("readout_noise", "readout_step"),
    "drift": ("drift_zero", "drift_scale"),
}
"""Sources of the mirrors' errors, and the keys of :class:`Mirrors` that make each."""


class TemperatureCourse(Part):
    """How far the mirrors' temperature is from that of their calibration: rate · t + amplitude · sin(2π t/period)."""

    amplitude: TemperatureDifference = Field(ge=0.0, le=200.0)
    """Amplitude of the periodic part."""
    period: Time = Field(ge=1e-3, le=1e9)
    """Period of that part."""
    rate: TemperatureRate = Field(ge=-10.0, le=10.0)
    """Steady change since the calibration, which was at the first shot."""

    def difference(self, time: Array) -> Array:
        """Return the difference [K] at times [s] since the first shot, any shape."""
        return np.asarray(self.rate * time + self.amplitude * np.sin(2.0 * math.pi * time / self.period))

    def spread(self, time: Array) -> Array:
        """Return what the instrument expects of the difference [K, rms] at times [s], any shape.

        It knows the course but neither its phase nor its sign: hypot(rate · t, amplitude/√2).
        """
        return np.hypot(self.rate * time, self.amplitude * math.sqrt(0.5))


class Mirrors(Part):
    """The two galvanometer mirrors."""

    axis_separation: Length = Field(ge=0.0, le=1.0)
    """Distance D_g between the two deflection axes (eq 3)."""
    max_deflection: Angle = Field(gt=0.0, lt=1.5)
    """Largest optical deflection of each axis, to both sides."""
    jitter: Angle = Field(ge=0.0, le=1e-2)
    """Standard deviation of the pointing error common to laser and receiver, per axis and shot (repeatability)."""
    jitter_seen: Ratio = Field(ge=0.0, le=1.0)
    """Share of the jitter's variance that the angle encoders read, because it is a motion of the shafts."""
    wobble: Angle = Field(ge=0.0, le=1e-2)
    """Standard deviation of the cross-axis error of each mirror, common to laser and receiver; encoders miss it."""
    wobble_angle: Angle = Field(ge=1e-4, le=10.0)
    """Deflection of the wobbling mirror over which its wobble changes."""
    wobble_time: Time = Field(ge=1e-4, le=1e6)
    """Time over which the wobble changes; within it a motion that is repeated wobbles alike."""
    synchronisation: Angle = Field(ge=0.0, le=1e-3)
    """Standard deviation of the angle between projection and reception, per shot: it moves the spot on the sensor."""
    readout_noise: Angle = Field(ge=0.0, le=1e-2)
    """Standard deviation of the angle encoders' noise, per axis and shot."""
    readout_step: Angle = Field(ge=0.0, le=1e-2)
    """Step of the angle encoders; 0 for none."""
    drift_zero: AnglePerKelvin = Field(ge=-1e-2, le=1e-2)
    """Drift of the encoders' zero with temperature, both axes."""
    drift_scale: RatioPerKelvin = Field(ge=-1e-2, le=1e-2)
    """Drift of the encoders' scale with temperature, both axes."""
    temperature: TemperatureCourse
    """Temperature of the mirrors, by which they drift."""

    def still(self, *, but: str | None = None) -> Mirrors:
        """Return the mirrors without errors, or with those of one of the sources in :data:`ERRORS`."""
        quiet = {key: 0.0 for source, keys in ERRORS.items() if source != but for key in keys}
        return self.model_copy(update=quiet)

    def steady(self) -> Mirrors:
        """Return the mirrors at the temperature of their calibration."""
        return self.changed(temperature=self.temperature.changed(amplitude=0.0, rate=0.0))

    def drift(self, deflection: Array, time: Array) -> Array:
        """Return by how much a drifted mirror points beyond its encoder's reading: ΔT (zero + scale · deflection).

        ``deflection`` [rad] and ``time`` since the first shot [s] broadcast. The servo holds the reading, so the mirror
        is what moves.
        """
        return self.temperature.difference(time) * (self.drift_zero + self.drift_scale * deflection)

    def reading_sigma(self, deflection: Array, time: Array) -> Array:
        """Return the standard deviation [rad] of an encoder's reading about the true deflection.

        Independent parts: jitter that it does not see, the other mirror's wobble, its own noise, its step q (q²/12, as
        for a uniform error; Bennett, *Bell System Technical Journal* 27, 1948) and the expected drift.

        Parameters
        ----------
        deflection
            Θ or φ [rad].
        time
            Since the first shot [s]; they broadcast.
        """
        constant = (1.0 - self.jitter_seen) * self.jitter**2 + self.wobble**2
        constant += self.readout_noise**2 + self.readout_step**2 / 12.0
        drift = self.temperature.spread(time) * (self.drift_zero + self.drift_scale * deflection)
        return np.sqrt(constant + drift**2)


def wobble_correlation(apart: ArrayLike) -> Array:
    """Return the correlation of a mirror's wobble at two deflections or times, any shape.

    Parameters
    ----------
    apart
        Their distance over ``wobble_angle`` or ``wobble_time``. A wobble at another deflection and another time has the
        product of both correlations.

    Notes
    -----
    Independent numbers at whole positions, between which their weights are cos s and sin s, s = ½π u²(3 − 2u), share
    cos(s(u) − s(u′)) within one cell and sin s(u) cos s(u′) in the next; the mean over u. 0 from two cells on.
    """
    return np.interp(np.abs(np.asarray(apart, dtype=np.float64)), _APART, _SHARED, right=0.0)


def _step(part: Array) -> Array:
    return np.asarray(0.5 * math.pi * part**2 * (3.0 - 2.0 * part))


def _shared() -> Array:
    first = (np.arange(64) + 0.5) / 64
    second = first + _APART[:, None]
    here, there = _step(first), _step(second - np.floor(second))
    both = np.where(
        second < 1.0, np.cos(there - here), np.where(second < 2.0, np.sin(here) * np.cos(there), 0.0)
    )
    return np.asarray(both.mean(axis=1))


_APART = np.arange(65) / 32.0
_SHARED = _shared()
WOBBLE_LASTS = float(_SHARED.sum() - 0.5) / 32.0
"""Integral of :func:`wobble_correlation`: a wobble that fades by exp(−t/τ) has as much in a long mean."""


class Frame(NamedTuple):
    """Axes and points of the deflected optics in the scanner frame: triples (x, y, z), or a renderer's vectors.

    ``along`` is the direction of the beam u, ``across`` the transverse direction n in the plane of
    triangulation (positive towards +x), ``normal`` their common normal (towards +y), ``laser`` and ``lens`` the virtual
    positions of the laser's origin and of the receiver's node.
    """

    along: Vector3f
    across: Vector3f
    normal: Vector3f
    laser: Vector3f
    lens: Vector3f


def deflected_frame(
    sin_theta: FloatLike,
    cos_theta: FloatLike,
    sin_phi: FloatLike,
    cos_phi: FloatLike,
    axis_separation: FloatLike,
    baseline: FloatLike,
) -> Frame:
    """Return the deflected optics for the sines and cosines of (Θ, φ).

    Parameters
    ----------
    sin_theta, cos_theta, sin_phi, cos_phi
        Arrays of one shape (NumPy or Dr.Jit).
    axis_separation, baseline
        D_g and d [m].

    Returns
    -------
    Frame
        u = (sinΘ, cosΘ sinφ, cosΘ cosφ), n = (cosΘ, −sinΘ sinφ, −sinΘ cosφ), laser at
        (0, −D_g sinφ, D_g (1 − cosφ)), lens node at (d, −D_g sinφ, D_g (1 − cosφ)): eq 3 with the second
        mirror acting on the laser and on the receiver alike.
    """
    zero = 0.0 * sin_phi
    y = -axis_separation * sin_phi
    z = axis_separation * (1.0 - cos_phi)
    return Frame(
        along=(sin_theta, cos_theta * sin_phi, cos_theta * cos_phi),
        across=(cos_theta, -sin_theta * sin_phi, -sin_theta * cos_phi),
        normal=(zero, cos_phi, -sin_phi),
        laser=(zero, y, z),
        lens=(zero + baseline, y, z),
    )


def turned_axis_frame(
    sin_theta: FloatLike,
    cos_theta: FloatLike,
    sin_phi: FloatLike,
    cos_phi: FloatLike,
    axis_separation: FloatLike,
    baseline: FloatLike,
    offset: FloatLike,
    skew: FloatLike,
) -> Frame:
    """Return the deflected optics of an instrument whose second axis is not where it should be.

    Parameters
    ----------
    sin_theta, cos_theta, sin_phi, cos_phi, axis_separation, baseline
        As of :func:`deflected_frame`.
    offset, skew
        The axis passes through (0, e, D_g) along (cos s, sin s, 0): e [m] and s [rad], small.

    Returns
    -------
    Frame
        The plane of triangulation and its optics, turned about that axis by φ (Rodrigues): with an offset and a skew of
        0 that is :func:`deflected_frame`.
    """
    across = skew * (1.0 - skew * skew / 6.0)
    along = 1.0 - 0.5 * skew * skew * (1.0 - skew * skew / 12.0)
    versed = 1.0 - cos_phi

    def turned(x: FloatLike, y: FloatLike, z: FloatLike) -> tuple[FloatLike, FloatLike, FloatLike]:
        on_axis = along * x + across * y
        return (
            cos_phi * x - sin_phi * across * z + versed * along * on_axis,
            cos_phi * y + sin_phi * along * z + versed * across * on_axis,
            cos_phi * z + sin_phi * (across * x - along * y),
        )

    def placed(x: FloatLike) -> tuple[FloatLike, FloatLike, FloatLike]:
        moved = turned(x, zero - offset, zero - axis_separation)
        return moved[0], moved[1] + offset, moved[2] + axis_separation

    zero = 0.0 * sin_phi
    return Frame(
        along=turned(sin_theta, zero, cos_theta),
        across=turned(cos_theta, zero, -sin_theta),
        normal=turned(zero, zero + 1.0, zero),
        laser=placed(zero),
        lens=placed(zero + baseline),
    )
