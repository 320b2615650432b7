"""Sun and Earth in the scene: the radiance that comes back along rays, by path tracing.

At each surface the Sun and the Earth are sampled on their own and by the surface's scattering, combined by the
balance heuristic (Veach, *Robust Monte Carlo methods for light transport simulation*, 1997, ch. 9). All is linear in
the Sun: radiance is per unit of its irradiance at the scene. Two bands travel together: paths are sampled in the
filter's band, and the throughput of the other follows from the ratio of the materials' reflectances.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from scanner_sim.render import sky
from scanner_sim.scene.loader import LoadedScene


@dataclass
class Radiance:
    """Radiance along rays per unit of the Sun's irradiance [1/sr], Dr.Jit arrays, in band and out of band.

    ``direct`` is what is seen of Sun and Earth themselves and the Sun's light from the first surface; ``indirect``
    the Earth's light from the first surface and all that met more: it varies slowly over a surface.
    """

    direct: Any
    direct_out: Any
    indirect: Any
    indirect_out: Any


@dataclass
class FirstHit:
    """The first surface along rays: material number (0 for none), normal and point."""

    material: Any
    normal: Any
    point: Any


@dataclass(frozen=True)
class Albedo:
    """The Earth's reflectance, in band and out of band."""

    in_band: float
    out_of_band: float


def trace_paths(
    loaded: LoadedScene,
    light: sky.SkyLight,
    albedo: Albedo,
    bounces: int,
    origin: Any,
    direction: Any,
    random: Any,
) -> tuple[Radiance, FirstHit]:
    """Estimate the radiance that comes along rays, one path each.

    Parameters
    ----------
    loaded
        The scene.
    light
        Sun and Earth.
    albedo
        Of the Earth.
    bounces
        Largest number of surfaces on a path.
    origin, direction
        Start of the rays, and where they look; Dr.Jit, shape (n,).
    random
        Function of a number of a draw, 0, 1, 2…, that returns four uniform random numbers of each ray.
    """
    earth_in, earth_out = dr.opaque(mi.Float, albedo.in_band), dr.opaque(mi.Float, albedo.out_of_band)
    count, limit = dr.width(direction), dr.opaque(mi.UInt32, bounces)

    def emitted(towards: Any, scattered: Any, delta: Any) -> tuple[Any, Any]:
        """Return Sun and Earth seen in a direction, weighted against sampling them."""
        sun, earth = sky.sun_radiance(light, towards), sky.earth_radiance(light, towards)
        by_sun, by_earth = sky.pdf_sun(light, towards), sky.pdf_earth(light, towards)
        weight_sun = dr.select(delta, 1.0, scattered / dr.maximum(scattered + by_sun, 1e-20))
        weight_earth = dr.select(delta, 1.0, scattered / dr.maximum(scattered + by_earth, 1e-20))
        return sun * weight_sun, earth * weight_earth

    def surface(state: Any, depth: Any) -> Any:
        ray, active, gain, ratio, pdf, delta, total, first = state
        si = loaded.mitsuba.ray_intersect(
            ray, mi.RayFlags.UV | mi.RayFlags.ShadingFrame, coherent=False, active=active
        )
        met = si.is_valid()
        hit = active & met & (depth < limit)
        early = depth == 0
        sun, earth = emitted(ray.d, pdf, delta)
        escaped = active & ~met
        # What is seen directly, or in the first mirror, is sharp; the rest is smooth.
        sharp = early | (delta & (depth == 1))
        sun, earth = dr.select(escaped, gain * sun, 0.0), dr.select(escaped, gain * earth, 0.0)
        _add(total, sharp, sun + earth_in * earth, ratio * (sun + earth_out * earth))

        number: Any = dr.select(hit, dr.reinterpret_array(mi.UInt32, si.shape), 0)
        material = dr.gather(mi.UInt32, loaded.material_of, number)
        first = FirstHit(
            dr.select(early, dr.select(hit, material, 0), first.material),
            dr.select(early & hit, si.n, first.normal),
            dr.select(early & hit, mi.Vector3f(si.p), first.point),
        )
        ratio = ratio * dr.select(hit, dr.gather(mi.Float, loaded.out_of_band_ratio, material), 1.0)
        drawn, more = random(2 * depth), random(2 * depth + 1)
        bsdf = si.bsdf()
        for sample, draw, radiance_of in (
            (mi.Point2f(drawn[0], drawn[1]), sky.sample_sun, sky.sun_radiance),
            (mi.Point2f(drawn[2], drawn[3]), sky.sample_earth, sky.earth_radiance),
        ):
            towards, density = draw(light, sample)
            value, scattered = bsdf.eval_pdf(mi.BSDFContext(), si, si.to_local(towards), hit)
            radiance = radiance_of(light, towards)
            useful = hit & (density > 0.0) & (value[0] > 0.0) & (radiance > 0.0)
            hidden = loaded.mitsuba.ray_test(si.spawn_ray(towards), coherent=False, active=useful)
            seen = dr.select(useful & ~hidden, gain * value[0] * radiance / (density + scattered), 0.0)
            if draw is sky.sample_sun:
                _add(total, early, seen, ratio * seen)
            else:
                _add(total, mi.Bool(False), earth_in * seen, ratio * earth_out * seen)

        sample, weight = bsdf.sample(mi.BSDFContext(), si, more[0], mi.Point2f(more[1], more[2]), hit)
        gain = gain * dr.select(hit, weight[0], 0.0)
        # Russian roulette: faint paths end early, the others stand for them.
        survival = dr.select(early, 1.0, dr.clip(gain, 0.1, 1.0))
        gain = dr.select(more[3] < survival, gain / survival, 0.0)
        ray = si.spawn_ray(si.to_world(sample.wo))
        delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
        return ray, hit & (gain > 0.0), gain, ratio, sample.pdf, delta, total, first

    zero = dr.zeros(mi.Float, count)
    start = (
        mi.Ray3f(origin, direction),
        dr.full(mi.Bool, True, count),
        dr.full(mi.Float, 1.0, count),
        dr.full(mi.Float, 1.0, count),
        zero,
        dr.full(mi.Bool, True, count),
        Radiance(mi.Float(zero), mi.Float(zero), mi.Float(zero), mi.Float(zero)),
        FirstHit(dr.zeros(mi.UInt32, count), dr.zeros(mi.Normal3f, count), dr.zeros(mi.Vector3f, count)),
    )

    def turn(depth: Any, *state: Any) -> Any:
        return (depth + 1, *surface(state, depth))

    loop: Any = dr.while_loop
    result = loop(
        (mi.UInt32(0), *start),
        lambda depth, ray, active, *rest: active & (depth <= limit),  # the last ray may still meet the sky
        turn,
        labels=(),
    )
    return result[-2], result[-1]


def _add(total: Radiance, sharp: Any, light: Any, light_out: Any) -> None:
    """Add light to the direct part where ``sharp``, else to the indirect one."""
    total.direct = total.direct + dr.select(sharp, light, 0.0)
    total.direct_out = total.direct_out + dr.select(sharp, light_out, 0.0)
    total.indirect = total.indirect + dr.select(sharp, 0.0, light)
    total.indirect_out = total.indirect_out + dr.select(sharp, 0.0, light_out)
