"""The material library: numbers inside their sources' ranges, and BSDFs that carry exactly these numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from scanner_sim.foundation.errors import InputError
from scanner_sim.scene.materials import (
    MATERIALS,
    Material,
    UnknownMaterialError,
    ggx_albedo,
    material,
    mitsuba_bsdf,
    normal_reflectance,
)
from scanner_sim.scene.polarisation import speckle_contrast
from scanner_sim.scene.surfaces import Retroreflector, Surface

# Section "Materials at 1.5 µm" of the physics notes: stated values ± rounding, or stated ranges.
RANGES = {
    "evaporated_aluminium": (0.978, 0.978),
    "weathered_aluminium": (0.807, 0.807),
    "nickel": (0.804, 0.804),
    "z93_white": (0.80, 0.88),
    "beta_cloth": (0.70, 0.85),
    "aluminised_kapton": (0.80, 0.88),
    "black_paint": (0.04, 0.06),
    "dyed_black_anodise": (0.3, 0.6),
    "black_oxide": (0.05, 0.15),
    "oxidised_inconel": (0.10, 0.30),
    "solar_cell": (0.1, 0.5),
    "grey_reference": (0.5, 0.5),
}


@pytest.mark.parametrize("name", RANGES)
def test_reflectance_lies_in_the_stated_range(name):
    low, high = RANGES[name]
    assert low <= MATERIALS[name].reflectance <= high


@pytest.mark.parametrize("entry", MATERIALS.values(), ids=lambda entry: entry.name)
def test_entry_is_complete(entry):
    assert MATERIALS[entry.name] is entry
    assert entry.source != Material.model_fields["source"].default


def test_target_contrast_is_high():
    assert MATERIALS["target_white"].reflectance > 10 * MATERIALS["target_black"].reflectance


def test_fresnel_of_aluminium_and_nickel():
    assert normal_reflectance(1.45, 16.0) == pytest.approx(0.978, abs=5e-4)
    assert normal_reflectance(3.36, 7.05) == pytest.approx(0.804, abs=5e-4)
    assert normal_reflectance(1.5, 0.0) == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("depolarised", "contrast"), [(0.0, 1.0), (0.4, 0.824621), (0.5, 0.790569), (1.0, 0.707107)]
)
def test_speckle_of_light_that_is_polarised_in_part(depolarised: float, contrast: float) -> None:
    """√((1 + P²)/2) with P = 1 − share, by hand: P = 0.6 gives √0.68, P = 0.5 √0.625."""
    assert speckle_contrast(depolarised) == pytest.approx(contrast, abs=5e-7)


def test_albedo_of_the_rough_lobe():
    # Without masking the integral is 1/(1 + α²); masking takes more at high roughness.
    assert ggx_albedo(1e-3) == pytest.approx(1.0, abs=1e-5)
    assert ggx_albedo(0.4) == pytest.approx(0.787, abs=1e-3)  # sampled with the renderer, 2¹⁸ directions
    for alpha in (0.1, 0.3, 1.0):
        assert ggx_albedo(alpha) < 1.0 / (1.0 + alpha**2)


def test_unknown_name_gives_the_nearest():
    with pytest.raises(UnknownMaterialError, match="Did you mean 'beta_cloth'") as caught:
        material("beta_clth")
    assert isinstance(caught.value, InputError)
    assert isinstance(caught.value, LookupError)
    assert "z93_white" in caught.value.remedy


def test_unknown_name_far_from_all_lists_the_library():
    with pytest.raises(UnknownMaterialError) as caught:
        material("qqqq")
    assert "Did you mean" not in str(caught.value)
    assert all(name in caught.value.remedy for name in MATERIALS)


@pytest.mark.parametrize(
    "wrong",
    [
        {"reflectance": 1.2},
        {"reflectance": -0.1},
        {"reflectance": math.nan},
        {"reflectance": 0.5, "eta": 1.4},
        {"reflectance": 0.5, "specular_share": 0.2},
        {"reflectance": 0.5, "kind": "mixed", "eta": 1.45, "k": 16.0, "specular_share": 0.4},
        {
            "reflectance": 0.5,
            "kind": "rough_conductor",
            "eta": 1.45,
            "k": 16.0,
            "alpha": 0.1,
            "specular_share": 1.0,
        },
        {"reflectance": 0.2, "kind": "mixed", "eta": 1.45, "k": 16.0, "alpha": 0.1, "specular_share": 0.5},
        {"reflectance": 0.5, "kind": "mixed", "eta": 1.45, "k": 16.0, "alpha": 0.1},
        {"reflectance": 0.5, "colour": "white"},
        {"reflectance": 0.5, "kind": "retroreflector"},
        {"reflectance": 0.5, "retro": {"kind": "bead_sheet"}},
        {"reflectance": 0.5, "kind": "retroreflector", "retro": {"kind": "bead_sheet"}, "alpha": 0.1},
        {
            "reflectance": 0.5,
            "kind": "retroreflector",
            "retro": {"kind": "bead_sheet", "refractive_index": 1.5},
        },
        {
            "reflectance": 0.5,
            "kind": "retroreflector",
            "retro": {"kind": "corner_cube", "entrance_half_angle": 0.7},
        },
        {"reflectance": 0.5, "kind": "retroreflector", "retro": {"half_width": 1e-5}},
    ],
)
def test_impossible_materials_are_refused(wrong):
    with pytest.raises(ValidationError):
        Material(name="wrong", **wrong)


def test_a_material_cannot_be_changed():
    with pytest.raises(ValidationError):
        MATERIALS["nickel"].reflectance = 0.1
    with pytest.raises(TypeError):
        MATERIALS["nickel"] = MATERIALS["z93_white"]


@pytest.mark.parametrize("entry", MATERIALS.values(), ids=lambda entry: entry.name)
def test_the_renderer_holds_exactly_the_numbers(entry, device):
    import mitsuba as mi

    held = mi.traverse(mi.load_dict(mitsuba_bsdf(entry)))
    values = {key: float(np.asarray(held[key]).ravel()[0]) for key in held.keys()}  # noqa: SIM118

    def of(suffix):
        found = [value for key, value in values.items() if key.startswith("brdf_0") and key.endswith(suffix)]
        return found[0] if found else None

    if entry.kind == "diffuse":
        assert of("reflectance.value") == np.float32(entry.reflectance)
        return
    if entry.retro is not None:
        name, value = entry.retro.entrance
        assert of("reflectance.value") == np.float32(entry.reflectance)
        assert of("retro_share") == np.float32(entry.retro.retro_share)
        assert of("half_width") == np.float32(entry.retro.half_width)
        assert of(name) == np.float32(value)
        return
    assert of("eta.value") == np.float32(entry.eta)
    assert of("k.value") == np.float32(entry.k)
    assert of("alpha.value") == np.float32(entry.alpha)
    if entry.kind == "mixed":
        assert of("weight.value") == np.float32(entry.specular_share)
        assert of("reflectance.value") == np.float32(entry.diffuse_reflectance)


@pytest.mark.parametrize(
    "name", ["z93_white", "weathered_aluminium", "aluminised_kapton", "nickel", "oxidised_inconel"]
)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_white_furnace(name, side, device):
    """Claim: a surface in a uniform world reflects its stated hemispherical reflectance, from either side.

    Set-up: mean of the weight of 2¹⁸ sampled directions at normal incidence, fixed seed.
    Expected: the library's reflectance; for a bare metal, times the single-bounce albedo of its roughness.
    Tolerance: 0.5 %: the sampling error of the mean is 0.1 %, Fresnel changes 0.2 % over the lobe. A wrong
    share or roughness, a wrong blend order or a one-sided BSDF is far outside.
    """
    import drjit as dr
    import mitsuba as mi

    entry = MATERIALS[name]
    bsdf = mi.load_dict(mitsuba_bsdf(entry))
    count = 1 << 18
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(7, count)
    surface = dr.zeros(mi.SurfaceInteraction3f, count)
    surface.wi = mi.Vector3f(0.0, 0.0, side)
    _, weight = bsdf.sample(mi.BSDFContext(), surface, sampler.next_1d(), sampler.next_2d())
    measured = float(np.asarray(weight[0], dtype=np.float64).mean())
    expected = entry.reflectance if entry.kind != "rough_conductor" else entry.specular_reflectance
    assert measured == pytest.approx(expected, rel=5e-3)


def test_a_surface_is_known_by_its_name_or_its_numbers():
    """Claim: by those that are written: reflectance, that out of band, and the share that loses its polarisation."""
    assert Surface(reflectance=0.3).known_as == "reflectance_0.3"
    own = {"reflectance": 0.3, "reflectance_out_of_band": 0.5, "depolarisation": 0.2}
    assert Surface(**own).known_as == "reflectance_0.3_0.5_depolarising_0.2"
    assert Surface(**own, name="paint").known_as == "paint"


def test_what_a_mirror_or_a_retro_reflector_returns_keeps_its_polarisation() -> None:
    """Claim: other light has lost it, none of a metal's and all of a matt surface's; a stated share counts."""
    seen = set()
    for known in MATERIALS.values():
        free = known.model_copy(update={"depolarisation": None})
        kept = {"diffuse": 0.0, "rough_conductor": 1.0}.get(known.kind, known.specular_share)
        if known.retro is not None:
            kept = known.retro.retro_share
        assert free.depolarised_share == pytest.approx(1.0 - kept, abs=1e-12)
        assert free.model_copy(update={"depolarisation": 0.37}).depolarised_share == 0.37
        seen.add(round(kept, 6))
    assert len(seen) > 4


@pytest.mark.parametrize(
    ("off", "possible"), [(1.9e-3, True), (-1.9e-3, True), (2.1e-3, False), (-2.1e-3, False)]
)
def test_a_metal_reflects_what_its_index_does(off, possible):
    """Claim: a stated reflectance is that of n and k to the third digit, ((n − 1)² + k²)/((n + 1)² + k²)."""
    own = ((2.1 - 1.0) ** 2 + 5.0**2) / ((2.1 + 1.0) ** 2 + 5.0**2)
    metal = {"kind": "rough_conductor", "eta": 2.1, "k": 5.0, "alpha": 0.2, "specular_share": 1.0}
    if possible:
        assert Material(name="metal", reflectance=own + off, **metal).diffuse_reflectance == 0.0
        return
    with pytest.raises(ValidationError, match=f"reflect {own:.3f}, but reflectance is"):
        Material(name="metal", reflectance=own + off, **metal)


@pytest.mark.parametrize(
    "change",
    [
        {"reflectance": 0.41},
        {"reflectance_out_of_band": 0.41},
        {"reflectance_visible": 0.41},
        {"depolarisation": 0.41},
        {"retro_share": 0.41},
        {"half_width": 0.0101},
        {"entrance_half_angle": 0.41},
        {"kind": "corner_cube"},
        {"kind": "corner_cube", "refractive_index": 1.41},
    ],
)
def test_materials_that_differ_in_one_number_are_two(change: dict[str, Any]) -> None:
    """Claim: no two described materials share a name among the renderer's, named by the scenario or not."""
    from scanner_sim.scene.files.shapes import _material_of

    plain: dict[str, Any] = {"reflectance": 0.4}
    kinds = [(Surface, plain), (Retroreflector, plain | {"type": "retroreflector", "half_width": 0.01})]
    for kind, numbers in kinds:
        if set(change) <= set(kind.model_fields):
            for name in (None, "paint"):
                one, other = (kind(**(numbers | more), name=name) for more in ({}, change))
                assert _material_of(one).name != _material_of(other).name
                if name is not None:
                    assert one.known_as == other.known_as == name
                elif "reflectance_visible" not in change:
                    assert one.known_as != other.known_as
    numbers = plain | {"type": "retroreflector", "kind": "corner_cube"}
    cubes = {Retroreflector(**numbers, refractive_index=index).known_as for index in (1.0, 1.5, 1.6)}
    assert len(cubes) == 3
