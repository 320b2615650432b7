"""What surfaces are in visible light."""

from __future__ import annotations

import pytest

from scanner_sim.scene.materials import MATERIALS, Material, ggx_albedo, normal_reflectance
from scanner_sim.scene.visible import VISIBLE, in_visible_light, is_known_in_visible_light


def test_every_material_of_the_library_has_a_value_and_a_source() -> None:
    assert set(VISIBLE) == set(MATERIALS)
    for name, item in MATERIALS.items():
        seen = in_visible_light(item)
        assert is_known_in_visible_light(item), name
        assert seen.reflectance == VISIBLE[name].reflectance
        assert 0.0 <= seen.diffuse_reflectance <= 1.0
        assert seen.source == VISIBLE[name].source


def test_metals_are_darker_and_dyes_black() -> None:
    assert normal_reflectance(0.963, 6.70) == pytest.approx(
        VISIBLE["evaporated_aluminium"].reflectance, abs=1e-3
    )
    for name in ("evaporated_aluminium", "nickel", "dyed_black_anodise", "solar_cell"):
        assert VISIBLE[name].reflectance < MATERIALS[name].reflectance, name


def test_a_material_of_ones_own_is_what_it_says_or_unknown() -> None:
    told = Material(name="paint", reflectance=0.1, reflectance_visible=0.7)
    assert in_visible_light(told).reflectance == 0.7
    assert is_known_in_visible_light(told)
    silent = Material(name="paint", reflectance=0.1)
    assert in_visible_light(silent) == silent
    assert not is_known_in_visible_light(silent)


def test_a_lobe_reflects_no_more_than_the_whole_does_in_visible_light() -> None:
    """Claim: share times ((n − 1)² + k²)/((n + 1)² + k²) times the rough lobe's albedo is the whole's reflectance where
    the lobe would reflect more, and else the share stays."""
    for name, known in VISIBLE.items():
        material = MATERIALS.get(name)
        if material is None or material.kind != "mixed" or known.eta is None or known.k is None:
            continue
        assert material.alpha is not None
        n, k = known.eta, known.k
        lobe = ((n - 1.0) ** 2 + k * k) / ((n + 1.0) ** 2 + k * k) * ggx_albedo(material.alpha)
        found = in_visible_light(material)
        assert found.specular_share == pytest.approx(min(material.specular_share, known.reflectance / lobe))
    own = Material(
        name="own", kind="mixed", reflectance=0.5, reflectance_visible=0.3, eta=1.4, k=7.0, alpha=0.2,
        specular_share=0.5, source="made up",
    )  # fmt: skip
    lobe = (0.4**2 + 49.0) / (2.4**2 + 49.0) * ggx_albedo(0.2)
    assert in_visible_light(own).specular_share == pytest.approx(0.3 / lobe)
