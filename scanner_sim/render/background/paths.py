"""Sun and Earth in the scene: the radiance that comes back along rays, by path tracing.

At each surface the Sun and the Earth are sampled on their own and by the surface's scattering, combined by the
balance heuristic (Veach, *Robust Monte Carlo methods for light transport simulation*, 1997, ch. 9). All is linear in
the Sun: radiance is per unit of its irradiance at the scene. Two bands travel together: paths are sampled in the
filter's band, and the throughput of the other follows from the ratio of the materials' reflectances. What reflects
nothing in band and something out of it has no such ratio: it scatters paths as if it reflected all, by the density of
its directions, which for a Lambertian surface is its law; out of band its reflectance counts, and in band 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi

from scanner_sim.foundation.device_loops import for_each
from scanner_sim.foundation.device_types import (
    Float,
    Mask,
    Ray3f,
    SurfaceInteraction3f,
    UInt32,
    Vector2f,
    Vector3f,
    Vector4f,
)
from scanner_sim.render.background import sky
from scanner_sim.render.rays import is_occluded, leaving_rays, one_kernel
from scanner_sim.render.transport import meet
from scanner_sim.scene.files.loader import LoadedScene


@dataclass
class Radiance:
    """Radiance along rays per unit of the Sun's irradiance [1/sr], Dr.Jit arrays, in band and out of band.

    ``direct`` is what is seen of Sun and Earth themselves and the Sun's light from the first surface; ``indirect``
    the Earth's light from the first surface and all that met more: it varies slowly over a surface.
    """

    direct: Float
    direct_out: Float
    indirect: Float
    indirect_out: Float


@dataclass
class FirstHit:
    """The first surface along rays: material number (0 for none), normal and point."""

    material: UInt32
    normal: Vector3f
    point: Vector3f


@dataclass
class _Surface:
    """A surface that paths meet.

    Attributes
    ----------
    si
        Where, of what shape.
    bands
        What counts in band and out of band of the light that it scatters.
    dark
        Whether it reflects nothing in band, but something out of it.
    """

    si: SurfaceInteraction3f
    bands: Vector2f
    dark: Mask


@dataclass
class Look:
    """A ray from the lens to the first surface of each lane, and the uniform numbers of its paths, four at a time.

    ``light`` are those for a point of the Sun's disc and one of the Earth, ``scatter`` tells those by which a path
    leaves the first surface, by its number, and ``random`` those of later surfaces, by its number and that of a draw
    from 2 on.
    """

    origin: Vector3f
    direction: Vector3f
    light: Vector4f
    scatter: Callable[[UInt32], Vector4f]
    random: Callable[[UInt32, UInt32], Vector4f]


@dataclass
class PathSums:
    """What several paths of each lane bring, in the units of :class:`Radiance`.

    ``least`` and ``most`` of their direct parts in band; the sums of the indirect ones.
    """

    least: Float
    most: Float
    indirect: Float
    indirect_out: Float


def trace_paths(
    loaded: LoadedScene,
    light: sky.SkyLight,
    bounces: int,
    origin: Vector3f,
    direction: Vector3f,
    random: Callable[[UInt32], Vector4f],
    active: Mask = True,
) -> tuple[Radiance, FirstHit]:
    """Estimate the radiance that comes along rays, one path each.

    Parameters
    ----------
    loaded
        The scene.
    light
        Sun and Earth.
    bounces
        Largest number of surfaces on a path.
    origin, direction
        Start of the rays, and where they look; Dr.Jit, shape (n,).
    random
        Function of a number of a draw, 0, 1, 2…, that returns four uniform random numbers of each ray.
    active
        Which rays there are.
    """
    tracer = _Tracer(loaded, light, dr.opaque(mi.UInt32, bounces))
    total, surface, first = tracer.see(origin, direction, random(mi.UInt32(0)), active)
    return tracer.follow(total, surface, random(mi.UInt32(1)), random), first


def sum_paths(
    loaded: LoadedScene,
    light: sky.SkyLight,
    bounces: int,
    view: Callable[[UInt32], Look],
    active: Mask,
    count: int,
    onward: int,
) -> tuple[PathSums, FirstHit]:
    """Follow several rays of each lane, one after the other: what neighbouring lanes do at a time runs alike.

    Parameters
    ----------
    loaded, light, bounces
        As for :func:`trace_paths`.
    view
        Function of the number of a ray that tells every lane's.
    active
        Which lanes there are, shape (n,).
    count
        Number of rays.
    onward
        Number of paths that go on from the first surface of each: what comes from beyond it scatters most.

    Returns
    -------
    tuple
        What the paths bring, and the first surfaces of the first.
    """
    width, together = dr.width(active), one_kernel(loaded)
    tracer, each = _Tracer(loaded, light, dr.opaque(mi.UInt32, bounces)), dr.opaque(mi.Float, onward)

    def follow(number: UInt32, sums: PathSums, first: FirstHit) -> tuple[PathSums, FirstHit]:
        look = view(number)
        seen, surface, met = tracer.see(look.origin, look.direction, look.light, active)
        sums = replace(
            sums,
            indirect=sums.indirect + each * seen.indirect,
            indirect_out=sums.indirect_out + each * seen.indirect_out,
        )

        def go_on(path: UInt32, sums: PathSums) -> tuple[PathSums]:
            found = tracer.follow(
                _dark(width), surface, look.scatter(path), lambda draw: look.random(path, draw)
            )
            direct = seen.direct + found.direct
            return (
                PathSums(
                    dr.minimum(sums.least, direct),
                    dr.maximum(sums.most, direct),
                    sums.indirect + found.indirect,
                    sums.indirect_out + found.indirect_out,
                ),
            )

        (sums,) = for_each(onward, go_on, sums, one_kernel=together)
        begins = number == 0
        return sums, FirstHit(
            dr.select(begins, met.material, first.material),
            dr.select(begins, met.normal, first.normal),
            dr.select(begins, met.point, first.point),
        )

    none = PathSums(dr.full(mi.Float, math.inf, width), *(dr.zeros(mi.Float, width) for _ in range(3)))
    first = FirstHit(dr.zeros(mi.UInt32, width), dr.zeros(mi.Vector3f, width), dr.zeros(mi.Vector3f, width))
    sums, first = for_each(count, follow, none, first, one_kernel=together)
    return sums, first


def trace_sharp(
    loaded: LoadedScene,
    light: sky.SkyLight,
    origin: Vector3f,
    direction: Vector3f,
    disc: Vector2f,
    mirror: Vector4f,
) -> tuple[Float, Float]:
    """Estimate the direct part of :func:`trace_paths` alone, with rays that run alike.

    Parameters
    ----------
    loaded, light, origin, direction
        As there.
    disc
        Uniform numbers for the point on the Sun's disc, ``mi.Point2f``, shape (n,).
    mirror
        Four uniform numbers for the choice among a first surface's lobes, shape (n,).

    Returns
    -------
    tuple
        Radiance in band and out of band per unit of the Sun's irradiance [1/sr], shape (n,).
    """
    tracer = _Tracer(loaded, light, mi.UInt32(1))
    total = _dark(dr.width(direction))
    surface, _ = tracer.begin(total, origin, direction, disc, coherent=True)
    delta = mi.BSDFFlags.Delta
    if any(mi.has_flag(shape.bsdf().flags(), delta) for shape in loaded.shapes if shape.bsdf()):
        ray, active, gain, _, mirrored = tracer.scatter(
            surface, surface.si.is_valid(), mi.Float(1.0), mirror, roulette=False
        )
        active &= mirrored
        escaped = active & ~is_occluded(loaded, ray, active=active)
        sun, earth = sky.sun_radiance(light, ray.d), sky.earth_radiance(light, ray.d)
        sun, earth = dr.select(escaped, gain * sun, 0.0), dr.select(escaped, gain * earth, 0.0)
        tracer.collect(total, True, sun, earth, surface.bands)
    return total.direct, total.direct_out


def _dark(count: int) -> Radiance:
    return Radiance(*(dr.zeros(mi.Float, count) for _ in range(4)))


class _Tracer:
    """One turn of a path, and what it needs to know."""

    def __init__(
        self,
        loaded: LoadedScene,
        light: sky.SkyLight,
        limit: UInt32,
    ) -> None:
        self._loaded, self._light, self._limit = loaded, light, limit

    def see(
        self, origin: Vector3f, direction: Vector3f, draws: Vector4f, active: Mask
    ) -> tuple[Radiance, _Surface, FirstHit]:
        """Return what comes from the sky and the first surface, by a point of the Sun's disc and one of the Earth."""
        total = _dark(dr.width(direction))
        surface, first = self.begin(total, origin, direction, mi.Point2f(draws[0], draws[1]), active=active)
        earth = self.sample_light(
            surface,
            surface.si.is_valid(),
            mi.Float(1.0),
            mi.Point2f(draws[2], draws[3]),
            sky.sample_earth,
            sky.earth_radiance,
        )
        self.collect(total, False, 0.0, earth, surface.bands)
        return total, surface, first

    def follow(
        self, total: Radiance, surface: _Surface, draws: Vector4f, random: Callable[[UInt32], Vector4f]
    ) -> Radiance:
        """Return a total with what one path brings that leaves a surface by four numbers, and by draws from 2 on."""
        gain = dr.full(mi.Float, 1.0, dr.width(total.direct))
        onward = self.scatter(surface, surface.si.is_valid(), gain, draws, roulette=False)
        loop: Any = dr.while_loop
        brought: Radiance
        *_, brought = loop(
            (mi.UInt32(1), *onward, surface.bands, total),
            lambda depth, ray, active, *rest: active,
            lambda *state: self.turn(random, *state),
            labels=(),
            mode=None if one_kernel(self._loaded) else "evaluated",
        )
        return brought

    def begin(
        self,
        total: Radiance,
        origin: Vector3f,
        direction: Vector3f,
        disc: Vector2f,
        *,
        coherent: bool = False,
        active: Mask = True,
    ) -> tuple[_Surface, FirstHit]:
        """Collect what is seen of the sky and the Sun's light from the first surface, with a point of its disc.

        Returns the surface, and its features.
        """
        light = self._light
        si = meet(self._loaded, origin, direction, active)
        hit = si.is_valid()
        sun, earth = sky.sun_radiance(light, direction), sky.earth_radiance(light, direction)
        escaped = active & ~hit
        self.collect(
            total, True, dr.select(escaped, sun, 0.0), dr.select(escaped, earth, 0.0), mi.Vector2f(1.0)
        )
        material = dr.gather(mi.UInt32, self._loaded.material_of, self.shape_of(si, hit))
        first = FirstHit(dr.select(hit, material, 0), mi.Vector3f(si.n), mi.Vector3f(si.p))
        surface = self.surface_of(si, material, hit)
        sun = self.sample_light(surface, hit, 1.0, disc, sky.sample_sun, sky.sun_radiance, coherent)
        self.collect(total, True, sun, 0.0, surface.bands)
        return surface, first

    def turn(
        self,
        random: Callable[[UInt32], Vector4f],
        depth: UInt32,
        ray: Ray3f,
        active: Mask,
        gain: Float,
        density: Float,
        delta: Mask,
        bands: Vector2f,
        total: Radiance,
    ) -> tuple[Any, ...]:
        """Follow paths to their next surface, the ``depth``-th after the first; past the limit only to the sky."""
        light = self._light
        si = meet(self._loaded, ray.o, ray.d, active, coherent=False)
        escaped = active & ~si.is_valid()
        sun = sky.sun_radiance(light, ray.d) * _heuristic(density, sky.pdf_sun(light, ray.d), delta)
        earth = sky.earth_radiance(light, ray.d) * _heuristic(density, sky.pdf_earth(light, ray.d), delta)
        sun, earth = dr.select(escaped, gain * sun, 0.0), dr.select(escaped, gain * earth, 0.0)
        # What is seen in a first mirror is sharp; the rest is smooth.
        self.collect(total, delta & (depth == 1), sun, earth, bands)

        hit = active & si.is_valid() & (depth < self._limit)
        material = dr.gather(mi.UInt32, self._loaded.material_of, self.shape_of(si, hit))
        surface = self.surface_of(si, material, hit)
        bands = bands * surface.bands
        draws = random(2 * depth)
        sun = self.sample_light(
            surface, hit, gain, mi.Point2f(draws[0], draws[1]), sky.sample_sun, sky.sun_radiance
        )
        # The Earth is faint: every other path asks for it, and counts it twice.
        asks = hit & (draws[2] < 0.5)
        draw_for_earth = mi.Point2f(2.0 * draws[2], draws[3])
        earth = 2.0 * self.sample_light(
            surface, asks, gain, draw_for_earth, sky.sample_earth, sky.earth_radiance
        )
        self.collect(total, False, sun, earth, bands)
        onward = self.scatter(surface, hit, gain, random(2 * depth + 1), roulette=True)
        return (depth + 1, *onward, bands, total)

    def sample_light(
        self,
        surface: _Surface,
        active: Mask,
        gain: Float,
        sample: Vector2f,
        draw: Callable[[sky.SkyLight, Vector2f], tuple[Vector3f, Float]],
        radiance_of: Callable[[sky.SkyLight, Vector3f], Float],
        coherent: bool = False,
    ) -> Float:
        """Return the light of Sun or Earth that a surface sends back, by sampling them."""
        si = surface.si
        towards, density = draw(self._light, sample)
        evaluated, scattered = si.bsdf().eval_pdf(mi.BSDFContext(), si, si.to_local(towards), active)
        value = dr.select(surface.dark, scattered, evaluated[0])
        radiance = radiance_of(self._light, towards)
        useful = active & (density > 0.0) & (value > 0.0) & (radiance > 0.0)
        hidden = is_occluded(self._loaded, leaving_rays(si, towards), coherent=coherent, active=useful)
        return dr.select(useful & ~hidden, gain * value * radiance / (density + scattered), 0.0)

    def scatter(
        self, surface: _Surface, hit: Mask, gain: Float, draws: Vector4f, *, roulette: bool
    ) -> tuple[Ray3f, Mask, Float, Float, Mask]:
        """Return the next rays, whether they live, their gain, density and whether a mirror sent them."""
        si = surface.si
        sample, weight = si.bsdf().sample(mi.BSDFContext(), si, draws[0], mi.Point2f(draws[1], draws[2]), hit)
        weight = dr.select(surface.dark & (sample.pdf > 0.0), 1.0, weight[0])
        gain = gain * dr.select(hit, weight, 0.0)
        if roulette:  # faint paths end early, the others stand for them
            survival = dr.clip(gain, 0.1, 1.0)
            gain = dr.select(draws[3] < survival, gain / survival, 0.0)
        delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
        return leaving_rays(si, si.to_world(sample.wo)), hit & (gain > 0.0), gain, sample.pdf, delta

    def shape_of(self, si: SurfaceInteraction3f, hit: Mask) -> UInt32:
        """Return the registry index of the surfaces, 0 for none."""
        return dr.select(hit, dr.reinterpret_array(mi.UInt32, si.shape), 0)

    def surface_of(self, si: SurfaceInteraction3f, material: UInt32, hit: Mask) -> _Surface:
        """Return the surface that is met, by the number of its material."""
        dark = hit & dr.gather(mi.Bool, self._loaded.dark_in_band, material)
        ratio = dr.gather(mi.Float, self._loaded.out_of_band_ratio, material)
        return _Surface(si, mi.Vector2f(dr.select(dark, 0.0, 1.0), dr.select(hit, ratio, 1.0)), dark)

    def collect(self, total: Radiance, sharp: Mask, sun: Float, earth: Float, bands: Vector2f) -> None:
        """Add light to the direct part where ``sharp``, else to the indirect one."""
        light = bands[0] * (sun + self._light.albedo * earth)
        light_out = bands[1] * (sun + self._light.albedo_out * earth)
        total.direct = total.direct + dr.select(sharp, light, 0.0)
        total.direct_out = total.direct_out + dr.select(sharp, light_out, 0.0)
        total.indirect = total.indirect + dr.select(sharp, 0.0, light)
        total.indirect_out = total.indirect_out + dr.select(sharp, 0.0, light_out)


def _heuristic(density: Float, other: Float, delta: Mask) -> Float:
    """Return the balance heuristic's weight of directions that a surface chose; a mirror leaves no choice."""
    return dr.select(delta, 1.0, density / dr.maximum(density + other, 1e-20))
