"""What surfaces are in visible light."""

from __future__ import annotations

import pytest

from scanner_sim.scene.materials import MATERIALS, Material, normal_reflectance
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
