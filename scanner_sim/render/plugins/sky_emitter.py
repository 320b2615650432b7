"""The Mitsuba emitter ``orbit_sky``: Sun and Earth around any scene.

Mitsuba allows one environment emitter per scene, so both are in one plugin. Register it with
:func:`register_orbit_sky`, then write for instance::

    <emitter type="orbit_sky">
        <vector name="sun_direction" x="-1" y="-1" z="-1"/>
        <vector name="earth_direction" x="0" y="1" z="0"/>
    </emitter>

Properties: ``sun_direction`` (from the scene; compulsory), ``sun_angular_radius`` [rad], ``irradiance`` of the Sun on a
plate that faces it, ``earth_direction`` to the Earth's centre (without it there is no Earth), ``earth_altitude`` and
``earth_radius`` [m], ``albedo``, and ``distance``, at which the sky is put for shadow rays: farther than any
two points of the scene. All but the last are found by ``mitsuba.traverse`` and may be changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from scanner_sim.foundation.device_types import (
    Float,
    Mask,
    Spectrum,
    SurfaceInteraction3f,
    Vector2f,
    Vector3f,
)
from scanner_sim.render.background.sky import (
    earth_radiance,
    pdf_earth,
    pdf_sun,
    sample_earth,
    sample_sun,
    sky_light,
    sun_radiance,
)
from scanner_sim.scene.files.plugins import once_per_variant, vectorised_only

_SKY_DISTANCE = 1e6
"""A python plugin is not told the size of the scene; in single precision directions stay exact to 1e-7 here."""


@once_per_variant
def register_orbit_sky() -> type:
    """Make ``orbit_sky`` known to Mitsuba's present variant, and return its class.

    Call it again after every change of the variant: a plugin belongs to the variant in which it was made.

    Raises
    ------
    InputError
        In a scalar variant, which has no arrays of rays.
    """
    vectorised_only("orbit_sky")
    made = _emitter_class()
    mi.register_emitter("orbit_sky", made)
    return made


def _emitter_class() -> type:
    """Return the plugin for the present variant, whose types its base class fixes."""

    class OrbitSky(mi.Emitter):
        """Sun and Earth as one environment emitter; see the module."""

        def __init__(self, props: Any) -> None:
            super().__init__(props)
            self.m_flags = int(mi.EmitterFlags.Infinite)
            self.m_needs_sample_3 = False
            self.sun_direction = _vector(props["sun_direction"])
            self.sun_angular_radius = _number(props.get("sun_angular_radius", 4.65e-3))
            self.irradiance = _number(props.get("irradiance", 1.0))
            self.earth = "earth_direction" in props
            self.earth_direction = _vector(props["earth_direction"] if self.earth else [0.0, 1.0, 0.0])
            self.earth_altitude = _number(props.get("earth_altitude", 400e3))
            self.earth_radius = _number(props.get("earth_radius", 6371e3))
            self.albedo = _number(props.get("albedo", 0.3))
            self.distance = _number(props.get("distance", _SKY_DISTANCE))
            self._prepare()

        def _prepare(self) -> None:
            """Place Sun and Earth, and share the samples between them if both give light."""
            self.light = sky_light(
                _host(self.sun_direction),
                float(_host(self.sun_angular_radius)[0]),
                _host(self.earth_direction) if self.earth else None,
                float(_host(self.earth_altitude)[0]),
                float(_host(self.earth_radius)[0]),
            )
            lit = float(_host(self.light.lit_to)[0]) > 0.0 and float(_host(self.albedo)[0]) > 0.0
            self.sun_share = dr.opaque(mi.Float, 0.5 if lit else 1.0)

        def traverse(self, cb: Any) -> None:
            """Show the parameters that may be changed."""
            for name in ("sun_direction", "sun_angular_radius", "irradiance", "albedo"):
                cb.put(name, getattr(self, name), mi.ParamFlags.NonDifferentiable)
            if self.earth:
                for name in ("earth_direction", "earth_altitude", "earth_radius"):
                    cb.put(name, getattr(self, name), mi.ParamFlags.NonDifferentiable)

        def parameters_changed(self, keys: Sequence[str] = ()) -> None:  # noqa: ARG002
            """Follow changed parameters."""
            self._prepare()

        def _radiance(self, direction: Vector3f) -> Float:
            sun, earth = sun_radiance(self.light, direction), earth_radiance(self.light, direction)
            return self.irradiance * (sun + self.albedo * earth)

        def _density(self, direction: Vector3f) -> Float:
            sun, earth = pdf_sun(self.light, direction), pdf_earth(self.light, direction)
            return self.sun_share * sun + (1.0 - self.sun_share) * earth

        def eval(self, si: SurfaceInteraction3f, active: Mask = True) -> Spectrum:
            """Return the radiance seen by a ray that leaves the scene."""
            return mi.Spectrum(self._radiance(-si.wi)) & active

        def sample_direction(
            self, it: mi.Interaction3f, sample: Vector2f, active: Mask = True
        ) -> tuple[Any, Spectrum]:
            """Choose a direction to the Sun or to the lit Earth; return it and radiance over density."""
            to_sun = sample.x < self.sun_share
            stretched = dr.select(
                to_sun,
                sample.x / dr.maximum(self.sun_share, 1e-6),
                (sample.x - self.sun_share) / dr.maximum(1.0 - self.sun_share, 1e-6),
            )
            u = mi.Point2f(stretched, sample.y)
            direction = dr.select(to_sun, sample_sun(self.light, u)[0], sample_earth(self.light, u)[0])
            density = self._density(direction)
            ds: Any = mi.DirectionSample3f()
            ds.p = it.p + direction * self.distance
            ds.n = mi.Normal3f(-direction)
            ds.uv = mi.Point2f(0.0)
            ds.time = it.time
            ds.pdf = dr.select(active, density, 0.0)
            ds.delta = False
            ds.d = direction
            ds.dist = self.distance
            ds.emitter = mi.EmitterPtr(self)
            valid = active & (density > 0.0)
            weight = dr.select(valid, self._radiance(direction) / dr.maximum(density, 1e-12), 0.0)
            return ds, mi.Spectrum(weight)

        def pdf_direction(self, it: mi.Interaction3f, ds: Any, active: Mask = True) -> Float:  # noqa: ARG002
            """Return the density of a direction under ``sample_direction``."""
            return dr.select(active, self._density(ds.d), 0.0)

        def eval_direction(self, it: mi.Interaction3f, ds: Any, active: Mask = True) -> Spectrum:  # noqa: ARG002
            """Return the radiance from a direction, not divided by its density."""
            return mi.Spectrum(self._radiance(ds.d)) & active

        def sample_ray(self, *_: Any) -> Any:
            """Refuse: rays from the sky need the size of the scene, of which a Python plugin is not told."""
            raise NotImplementedError(
                "orbit_sky cannot start rays; use an integrator that starts at the sensor."
            )

        def bbox(self) -> Any:
            """Return the empty box: the sky is nowhere."""
            return mi.ScalarBoundingBox3f()

        def to_string(self) -> str:
            """Return the parameters in one line."""
            return (
                f"OrbitSky[sun_direction={self.sun_direction}, sun_angular_radius={self.sun_angular_radius}, "
                f"irradiance={self.irradiance}, earth_direction={self.earth_direction if self.earth else None}, "
                f"earth_altitude={self.earth_altitude}, earth_radius={self.earth_radius}, albedo={self.albedo}]"
            )

    return OrbitSky


def _vector(value: Any) -> Vector3f:
    x, y, z = (float(entry) for entry in np.ravel(value))
    return mi.Vector3f(dr.opaque(mi.Float, x), dr.opaque(mi.Float, y), dr.opaque(mi.Float, z))


def _number(value: Float) -> Float:
    return dr.opaque(mi.Float, float(value))


def _host(value: Any) -> Any:
    return np.asarray(value.numpy(), dtype=np.float64).ravel()
