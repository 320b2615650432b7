"""The BSDF ``retroreflector``: samples against density, reciprocity, energy, and the paths that use it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, kstest

pytestmark = pytest.mark.usefixtures("device")

LEVEL = 1e-5
"""Of each statistical test: about ten of them fail together once in 10⁴ seeds."""
SIGMAS = 4.42
"""Standard errors beyond which a mean lies once in 10⁵ times, both sides."""

KINDS = ("bead_sheet", "corner_cube")


def plugin(kind: str, reflectance: float = 1.0, **numbers: float) -> dict[str, Any]:
    return {
        "type": "retroreflector",
        "kind": kind,
        "reflectance": {"type": "uniform", "value": reflectance},
        **numbers,
    }


def surface(wi: Any, count: int) -> Any:
    import drjit as dr
    import mitsuba as mi

    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.wi = vectors(wi)
    return si


def vectors(directions: Any) -> Any:
    import mitsuba as mi

    x, y, z = np.atleast_2d(np.asarray(directions, dtype=np.float32)).T
    return mi.Vector3f(*(mi.Float(np.ascontiguousarray(part)) for part in (x, y, z)))


def at(degrees: float, azimuth: float = 0.0) -> np.ndarray:
    polar, turn = np.deg2rad([degrees, azimuth])
    return np.array([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)])


def hemisphere(count: int, seed: int) -> np.ndarray:
    """Return directions, uniform over the upper hemisphere, shape (count, 3)."""
    rng = np.random.default_rng(seed)
    z, turn = rng.uniform(0.02, 1.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
    return np.stack([np.sqrt(1.0 - z**2) * np.cos(turn), np.sqrt(1.0 - z**2) * np.sin(turn), z], axis=1)


def sampled(
    bsdf: Any, wi: Any, count: int, seed: int, component: int | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return sampled directions (count, 3) and their weights (count,), of one component if it is named."""
    import mitsuba as mi

    context = mi.BSDFContext()
    if component is not None:
        context.component = component
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, count)
    sample, weight = bsdf.sample(context, surface(wi, count), sampler.next_1d(), sampler.next_2d())
    return np.asarray(sample.wo.numpy(), dtype=np.float64).T, np.asarray(weight[0].numpy(), dtype=np.float64)


@pytest.mark.parametrize(
    ("kind", "degrees", "half_width"),
    [
        ("bead_sheet", 0.0, 0.2),
        ("bead_sheet", 40.0, 0.1),
        ("bead_sheet", 75.0, 0.2),
        ("corner_cube", 30.0, 0.1),
        ("corner_cube", 56.0, 0.2),
    ],
)
def test_samples_follow_their_density(kind: str, degrees: float, half_width: float) -> None:
    """Claim: directions of ``sample`` have the density that ``pdf`` states.

    Set-up: Mitsuba's χ² harness over the sphere; lobes wide enough for its cells (the narrow ones are tested
    below by their cumulative distribution), at entrances up to grazing and at the cube's limit, 57°.
    Expected: p-value above 1e-5. A wrong Jacobian or share is refused with a p-value of 0.
    """
    import mitsuba as mi
    from mitsuba.chi2 import BSDFAdapter, ChiSquareTest, SphericalDomain

    extra = (
        f'<string name="kind" value="{kind}"/><float name="half_width" value="{half_width}"/>'
        '<float name="retro_share" value="0.7"/>'
    )
    sample, density = BSDFAdapter("retroreflector", extra, wi=[*map(float, at(degrees, 25.0))])
    test = ChiSquareTest(
        domain=SphericalDomain(),
        sample_func=sample,
        pdf_func=density,
        sample_dim=3,
        sample_count=400_000,
        res=101,
        ires=16,
    )
    mi.set_log_level(mi.LogLevel.Error)
    assert test.run(significance_level=LEVEL, quiet=True), test.messages


@pytest.mark.parametrize("half_width", [1.4e-4, 6.1e-3])
@pytest.mark.parametrize("kind", KINDS)
def test_narrow_lobe_has_its_width(kind: str, half_width: float) -> None:
    """Claim: of light along the normal, half of the lobe is within tan(δ/2) = α, in all directions alike.

    Set-up: 10⁵ samples of the lobe alone. Expected: the judge's share
    within δ is uniform between 0 and 1, and so is the azimuth. Tolerance: Kolmogorov–Smirnov at 1e-5. In single
    precision the narrowest lobe's directions are good to 1e-3 of its width, below the test's 8e-3.
    """
    import mitsuba as mi

    from scanner_sim.analytic.retroreflector import Sheet, lobe_within

    bsdf = mi.load_dict(plugin(kind, retro_share=1.0, half_width=half_width))
    wo, weight = sampled(bsdf, at(0.0), 100_000, seed=2, component=0)
    off = np.arctan2(np.hypot(wo[:, 0], wo[:, 1]), wo[:, 2])
    share = lobe_within(Sheet(1.0, 1.0, half_width, half_angle=0.66), off)
    assert kstest(share, "uniform").pvalue > LEVEL
    assert kstest(np.arctan2(wo[:, 1], wo[:, 0]) / (2.0 * np.pi) + 0.5, "uniform").pvalue > LEVEL
    assert weight.mean() == pytest.approx(1.0, abs=0.02)  # cubes fall from 1 at any entrance but 0


def test_lobe_points_back_and_not_to_the_mirror() -> None:
    """Claim: light returns the way it came, at any entrance, not to the mirrored direction.

    Set-up: 10⁵ samples at 35°, azimuth 70°. Expected: the share s E of them within 10 half widths of the way in,
    less 2 % in the lobe's tail; a hundred times fewer about the mirrored way. Tolerance: 4.42 standard errors and
    those 2 %.
    """
    import mitsuba as mi

    from scanner_sim.analytic.retroreflector import Sheet, entrance_share

    half_width, count = 6.1e-3, 100_000
    wi = at(35.0, 70.0)
    bsdf = mi.load_dict(
        plugin("bead_sheet", retro_share=0.6, half_width=half_width, entrance_half_angle=0.66)
    )
    wo, _ = sampled(bsdf, wi, count, seed=3)
    expected = 0.6 * float(entrance_share(Sheet(1.0, 0.6, half_width, half_angle=0.66), np.deg2rad(35.0)))
    back = (np.arccos(np.clip(wo @ wi, -1.0, 1.0)) < 10.0 * half_width).mean()
    mirror = (np.arccos(np.clip(wo @ (wi * [-1, -1, 1]), -1.0, 1.0)) < 10.0 * half_width).mean()
    error = SIGMAS * np.sqrt(expected * (1.0 - expected) / count)
    assert 0.98 * expected - error - 0.005 < back < expected + error + 0.005
    assert mirror < 0.01 * back


@pytest.mark.parametrize("kind", KINDS)
def test_reciprocity(kind: str) -> None:
    """Claim: f(ω_i, ω_o) = f(ω_o, ω_i), in the lobe and outside of it.

    Set-up: 20 000 pairs, half of them anywhere, half of them within a few degrees of each other; half width 2°.
    Expected: equal values. Tolerance: 2e-4 of the value, rounding of the lobe's flank in single precision.
    """
    import mitsuba as mi

    bsdf = mi.load_dict(plugin(kind, 0.8, retro_share=0.5, half_width=0.035))
    first = hemisphere(20_000, 4)
    second = hemisphere(20_000, 5)
    near = first[::2] + np.random.default_rng(6).normal(0.0, 0.04, (10_000, 3))
    near[:, 2] = np.abs(near[:, 2]) + 1e-3
    second[::2] = near / np.linalg.norm(near, axis=1, keepdims=True)

    def value(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        cosined = bsdf.eval(mi.BSDFContext(), surface(a, len(a)), vectors(b))[0].numpy()
        return np.asarray(cosined, dtype=np.float64) / b[:, 2]

    there, back = value(first, second), value(second, first)
    assert (there > 0.0).all()
    assert (there[::2] > 10.0 * np.median(there[1::2])).sum() > 1000  # many pairs are inside the lobe
    np.testing.assert_allclose(there, back, rtol=2e-4)


@pytest.mark.parametrize("share", [0.2, 1.0])
@pytest.mark.parametrize("kind", KINDS)
def test_white_furnace(kind: str, share: float) -> None:
    """Claim: a sheet returns its reflectance, at every angle of incidence, however wide its lobe is.

    Set-up: mean weight of 2¹⁸ samples for ρ = 1 and half widths of 0.35° and 2°, entrances from 0° to 88°; then the
    integral of ``eval`` over uniform directions for a lobe of 11°, which knows nothing of ``sample``. Expected: 1.
    Tolerance: 4.42 standard errors, and 1.5e-3 of the tabulated albedo. A lobe that is not compensated loses 2 to
    10 % for cubes along the normal.
    """
    import mitsuba as mi

    for half_width in (6.1e-3, 0.035):
        bsdf = mi.load_dict(plugin(kind, retro_share=share, half_width=half_width))
        for degrees in (0.0, 20.0, 45.0, 57.5, 75.0, 88.0):
            _, weight = sampled(bsdf, at(degrees), 1 << 18, seed=7)
            error = SIGMAS * weight.std() / np.sqrt(len(weight))
            assert weight.mean() == pytest.approx(1.0, abs=error + 1.5e-3)
    wide = mi.load_dict(plugin(kind, retro_share=share, half_width=0.2))
    out = hemisphere(1 << 19, 8)
    for degrees in (0.0, 30.0, 60.0):
        values = wide.eval(mi.BSDFContext(), surface(at(degrees), len(out)), vectors(out))[0].numpy()
        total = values.astype(np.float64) * 2.0 * np.pi * 0.98  # the hemisphere above z = 0.02
        error = SIGMAS * total.std() / np.sqrt(len(total))
        assert error < 0.03
        assert total.mean() == pytest.approx(1.0, abs=error + 2e-3)


def test_components_add_up() -> None:
    """Claim: lobe and base, asked for apart, are the whole; each samples itself.

    Set-up: contexts of one component each. Expected: values add up to rounding (1e-6); a lone component's mean
    weight is its own albedo: s E ρ, and ρ (1 − s E). Tolerance: 1 %, and the base's sampling error of 0.1 %.
    """
    import mitsuba as mi

    bsdf = mi.load_dict(plugin("bead_sheet", 0.8, retro_share=0.5))
    out = hemisphere(1000, 9)
    values = []
    for component, albedo in ((0, 0.4), (1, 0.4), (None, 0.8)):
        context = mi.BSDFContext()
        if component is not None:
            context.component = component
        _, weight = sampled(bsdf, at(0.0), 1 << 16, 10, component)
        assert weight.mean() == pytest.approx(albedo, rel=1e-2)
        values.append(bsdf.eval(context, surface(at(0.0), 1000), vectors(out))[0].numpy())
    np.testing.assert_allclose(values[0] + values[1], values[2], rtol=1e-6)


@pytest.mark.parametrize("integrator", ["path", "direct"])
def test_path_tracer_sees_the_reflectance(integrator: str) -> None:
    """Claim: Mitsuba's own integrators take the plugin: a sheet in a uniform sky shows ρ times its radiance.

    Set-up: an XML scene with a two-sided sheet of ρ = 0.6, share 0.4, turned by 30°, seen against a sky of 1.
    Expected: 0.6. Tolerance: 4.42 standard errors over 256 pixels, and 1.5e-3 of the tabulated albedo.
    """
    import mitsuba as mi

    mi.set_log_level(mi.LogLevel.Error)
    depth = '<integer name="max_depth" value="2"/>' if integrator == "path" else ""
    scene = mi.load_string(
        f"""<scene version="3.0.0"><integrator type="{integrator}">{depth}</integrator>
        <emitter type="constant"/><sensor type="perspective"><float name="fov" value="2"/>
        <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/>
        <string name="component_format" value="float32"/><rfilter type="box"/></film></sensor>
        <shape type="rectangle"><transform name="to_world"><rotate y="1" angle="210"/><translate z="5"/></transform>
        <bsdf type="twosided"><bsdf type="retroreflector"><string name="kind" value="corner_cube"/>
        <spectrum name="reflectance" value="0.6"/><float name="retro_share" value="0.4"/></bsdf></bsdf>
        </shape></scene>"""
    )
    image = np.asarray(mi.render(scene, spp=1024, seed=1), dtype=np.float64)[..., 0]
    error = SIGMAS * image.std() / np.sqrt(image.size)
    assert error < 2e-3
    assert image.mean() == pytest.approx(0.6, abs=error + 1e-3)


def test_chi_squared_of_the_narrow_lobe_askew() -> None:
    """Claim: at oblique entrance the narrow lobe's samples follow ``pdf`` too.

    Set-up: half width 0.35°, entrance 50°, everything in the lobe. 2·10⁵ samples in 24 × 24 cells of ±4 half widths
    about the way back, in the plane tangent there; the cells' probabilities by 8 × 8 points of ``pdf`` each.
    Expected: χ² with one degree of freedom fewer than cells (the rest of the sphere is one). Tolerance: 1e-5.
    """
    import mitsuba as mi

    half_width, count, cells, points = 6.1e-3, 200_000, 24, 8
    wi = at(50.0, 20.0)
    bsdf = mi.load_dict(plugin("bead_sheet", retro_share=1.0, half_width=half_width, entrance_half_angle=1.2))
    side = np.cross([0.0, 0.0, 1.0], wi)
    side /= np.linalg.norm(side)
    up = np.cross(wi, side)
    reach = 4.0 * half_width
    wo, _ = sampled(bsdf, wi, count, seed=11)
    ahead = wo @ wi
    edges = np.linspace(-reach, reach, cells + 1)
    seen, _, _ = np.histogram2d(
        np.where(ahead > 0.0, (wo @ side) / ahead, 9.0), (wo @ up) / ahead, bins=[edges, edges]
    )
    fine = (np.arange(cells * points) + 0.5) * (2.0 * reach / (cells * points)) - reach
    a, b = np.meshgrid(fine, fine, indexing="ij")
    directions = wi + a[..., None] * side + b[..., None] * up
    length = np.linalg.norm(directions, axis=-1, keepdims=True)
    flat = (directions / length).reshape(-1, 3)
    density = bsdf.pdf(mi.BSDFContext(), surface(wi, len(flat)), vectors(flat)).numpy().astype(np.float64)
    density = density.reshape(a.shape) / length[..., 0] ** 3 * (2.0 * reach / (cells * points)) ** 2
    expected = count * density.reshape(cells, points, cells, points).sum(axis=(1, 3))
    terms = np.append(
        ((seen - expected) ** 2 / expected).ravel(),
        ((count - seen.sum()) - (count - expected.sum())) ** 2 / (count - expected.sum()),
    )
    assert expected.min() > 5.0
    assert chi2.sf(terms.sum(), len(terms) - 1) > LEVEL
