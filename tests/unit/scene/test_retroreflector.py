"""Retro-reflectors in scenarios, in Mitsuba's files and as a plugin: spelling, numbers, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scanner_sim import load_scenario
from scanner_sim.config import resolved_yaml, scenario_warnings
from scanner_sim.foundation.errors import ScenarioError
from scanner_sim.scene.objects import Scene
from scanner_sim.scene.retroreflectors import NARROWEST, RetroLobe, roughness
from scanner_sim.scene.surfaces import Retroreflector

SCAN = {"rows": 2, "columns": 2, "horizontal": (-0.01, 0.01), "vertical": (-0.01, 0.01)}
DISC = {"name": "disc", "shape": "disc", "diameter": 0.2, "position": (0.0, 0.0, 5.0)}
PLAIN = {"type": "retroreflector", "reflectance": 0.5}
XML = """<scene version="3.0.0"><bsdf type="twosided" id="shiny"><bsdf type="retroreflector" name="nested">
<string name="kind" value="corner_cube"/><spectrum name="reflectance" value="0.4"/></bsdf></bsdf>
<shape type="rectangle"><ref id="shiny"/></shape></scene>"""


def scenario(material: Any, **parts: Any) -> Any:
    return load_scenario(
        {"schema": 1, "scan": SCAN, "scene": {"objects": [{**DISC, "material": material}]}, **parts}
    )


def test_scenario_in_yaml_and_python_is_the_same(tmp_path: Path) -> None:
    text = tmp_path / "scenario.yaml"
    text.write_text(
        "schema: 1\nscan: {rows: 2, columns: 2, horizontal: [-0.01 rad, 0.01 rad], vertical: [-0.01 rad, 0.01 rad]}\n"
        "scene:\n  objects:\n    - name: disc\n      shape: disc\n      diameter: 0.2 m\n"
        "      position: [0 m, 0 m, 5 m]\n"
        "      material: {type: retroreflector, kind: corner_cube, reflectance: 60 %, reflectance_out_of_band: 0.3,\n"
        "        retro_share: 40 %, half_width: 1 mrad, refractive_index: 1.45}\n",
        encoding="utf-8",
    )
    written = load_scenario(text)
    numbers = {"reflectance": 0.6, "reflectance_out_of_band": 0.3, "retro_share": 0.4, "half_width": 1e-3}
    assert written == scenario({**PLAIN, "kind": "corner_cube", "refractive_index": 1.45, **numbers})
    again = tmp_path / "again.yaml"
    again.write_text(resolved_yaml(written), encoding="utf-8")
    assert load_scenario(again) == written


@pytest.mark.parametrize(
    ("change", "place", "words"),
    [
        ({"kind": "mirror"}, "material.kind", "corner_cube"),
        ({"reflectance": 1.5}, "material.reflectance", "at most"),
        ({"retro_share": 0.0}, "material.retro_share", "more than"),
        ({"half_width": 1e-5}, "material.half_width", "at least"),
        ({"half_width": 1.0}, "material.half_width", "at most"),
        ({"refractive_index": 1.5}, "material.refractive_index", "corner_cube"),
        ({"kind": "corner_cube", "entrance_half_angle": 0.7}, "material.entrance_half_angle", "bead_sheet"),
        ({"type": "retro"}, "material.type", "retroreflector"),
        ({"colour": 1}, "material.colour", "no such key"),
    ],
)
def test_what_is_refused_is_named_with_its_place(change: dict[str, Any], place: str, words: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario({**PLAIN, **change})
    assert place in str(caught.value)
    assert words in str(caught.value)


def test_roughness_is_that_of_half_the_gain() -> None:
    lobe = RetroLobe(half_width=0.01)
    tilt = np.tan(0.005) / lobe.alpha
    assert (1.0 + tilt**2) ** -2 == pytest.approx(0.5)
    assert roughness(NARROWEST) > 1e-4  # below this Mitsuba's microfacets would widen the lobe
    assert lobe.entrance[0] == "entrance_half_angle"
    assert RetroLobe(kind="corner_cube").entrance == ("refractive_index", 1.5)


def test_a_retro_reflector_above_the_brightest_surface_is_doubted() -> None:
    assert any("max_reflectance" in sentence for sentence in scenario_warnings(scenario("retro_sheet")))
    assert any("max_reflectance" in sentence for sentence in scenario_warnings(scenario(PLAIN)))
    allowed = {"validation": {"max_reflectance": 3000.0}}
    for processing in (allowed, {"validation": {"max_reflectance": None}}):
        found = scenario_warnings(scenario("retro_sheet", processing=processing))
        assert not [sentence for sentence in found if "max_reflectance" in sentence]
    assert not [
        sentence for sentence in scenario_warnings(scenario("target_white")) if "max_reflectance" in sentence
    ]


def test_loader_shares_equal_materials_and_knows_both_bands(device: Any) -> None:
    from scanner_sim.scene.files.loader import load_scene

    first = {**PLAIN, "reflectance_out_of_band": 0.25}
    objects = [
        {**DISC, "name": name, "material": material}
        for name, material in (("a", first), ("b", first), ("c", PLAIN), ("d", "corner_cube_array"))
    ]
    loaded = load_scene(Scene.model_validate({"objects": objects}))
    assert len(loaded.materials) == 3
    assert loaded.materials[2] == "corner_cube_array"
    assert loaded.out_of_band_ratio.numpy().tolist() == [1.0, 0.5, 1.0, 1.0]
    assert not loaded.dark_in_band.numpy().any()
    assert all(shape.bsdf().id() in loaded.materials for shape in loaded.mitsuba.shapes())
    assert isinstance(Retroreflector.model_validate(first).lobe, RetroLobe)


def test_files_of_mitsuba_may_name_it(device: Any, tmp_path: Path) -> None:
    from scanner_sim.scene.files.loader import load_scene

    file = tmp_path / "sheet.xml"
    file.write_text(XML, encoding="utf-8")
    loaded = load_scene(Scene.model_validate({"file": str(file)}))
    assert loaded.materials == ("shiny",)
    assert "corner_cube" in str(loaded.mitsuba.shapes()[0].bsdf())


def value(bsdf: Any, offset: float) -> float:
    import drjit as dr
    import mitsuba as mi

    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(0.0, 0.0, 1.0)
    angle = dr.opaque(mi.Float, offset)
    return float(bsdf.eval(mi.BSDFContext(), si, mi.Vector3f(dr.sin(angle), 0.0, dr.cos(angle)))[0][0])


@pytest.mark.parametrize(
    ("kind", "own", "changed"),
    [("bead_sheet", "entrance_half_angle", 0.3), ("corner_cube", "refractive_index", 2.0)],
)
def test_parameters_may_be_changed_without_compiling_again(
    device: Any, kind: str, own: str, changed: float
) -> None:
    import drjit as dr
    import mitsuba as mi

    def made(**numbers: float) -> Any:
        reflectance = {"type": "uniform", "value": numbers.pop("reflectance", 0.5)}
        return mi.load_dict({"type": "retroreflector", "kind": kind, "reflectance": reflectance, **numbers})

    bsdf, new = made(), {"reflectance": 0.9, "retro_share": 0.7, "half_width": 0.05, own: changed}
    before = value(bsdf, 0.2)
    parameters = mi.traverse(bsdf)
    for name, number in new.items():
        parameters["reflectance.value" if name == "reflectance" else name] = number
    parameters.update()
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory):
        dr.kernel_history_clear()
        after = value(bsdf, 0.2)
        kernels = [entry for entry in dr.kernel_history() if entry["type"] == dr.KernelType.JIT]
    assert kernels
    assert all(entry["cache_hit"] for entry in kernels)
    assert after == pytest.approx(value(made(**new), 0.2), rel=1e-5)
    assert after != pytest.approx(before, rel=0.1)
    assert f"kind={kind}" in str(bsdf)
    assert f"{own}={changed:g}" in str(bsdf)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"kind": "cats_eye"}, "bead_sheet, corner_cube"),
        ({"half_width": 1e-6}, "half_width"),
        ({"retro_share": 1.5}, "retro_share"),
        ({"kind": "corner_cube", "refractive_index": 0.5}, "refractive_index"),
    ],
)
def test_the_plugin_refuses_numbers_out_of_range(device: Any, settings: dict[str, Any], words: str) -> None:
    import mitsuba as mi

    with pytest.raises(Exception, match=words):
        mi.load_dict({"type": "retroreflector", **settings})


def test_registration_is_kept_for_the_variant(device: Any) -> None:
    from scanner_sim.render.plugins.retroreflector import register_retroreflector

    assert register_retroreflector() is register_retroreflector()


def test_back_of_a_sheet_and_light_from_below_are_dark(device: Any) -> None:
    import drjit as dr
    import mitsuba as mi

    bsdf = mi.load_dict({"type": "retroreflector"})
    si = dr.zeros(mi.SurfaceInteraction3f)
    for wi, wo in ((-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)):
        si.wi = mi.Vector3f(0.0, 0.0, wi)
        found, density = bsdf.eval_pdf(mi.BSDFContext(), si, mi.Vector3f(0.0, 0.0, wo))
        assert found[0][0] == 0.0
        assert density[0] == 0.0


def test_renderer_and_scenario_have_the_same_sheet_by_default(device: Any) -> None:
    import mitsuba as mi

    bsdf, lobe = mi.load_dict({"type": "retroreflector"}), RetroLobe()
    assert lobe.half_width == pytest.approx(math.radians(0.35))
    found = [float(np.ravel(np.asarray(part))[0]) for part in (bsdf.half_width, bsdf.retro_share)]
    assert found == pytest.approx([lobe.half_width, lobe.retro_share])


@pytest.mark.parametrize("index", [1.0, 1.3, 1.57])
def test_a_cube_returns_what_both_discs_of_its_aperture_share(index: float, device: object) -> None:
    """Claim: from any side it returns the common area of the round aperture and its image, displaced by 2√2 tan β'
    radii, β' inside of the glass: by strips across both; nothing where they part, 35.3° for a hollow one."""
    import mitsuba as mi

    from scanner_sim.render.plugins.retroreflector import cube_entrance

    angle = np.radians([0.0, 10.0, 25.0, 35.0, 35.6, 36.5, 40.0, 55.0, 70.0, 89.0])
    found = cube_entrance(mi.Float(np.cos(angle).tolist()), mi.Float(index)).numpy()
    inside = np.arcsin(np.sin(angle) / index)
    strip = (np.arange(20_000) + 0.5) / 20_000.0
    # Half of the chord at the height y, less half of the displacement, both ways.
    left = np.maximum(np.sqrt(1.0 - strip**2) - np.sqrt(2.0) * np.tan(inside)[:, None], 0.0)
    np.testing.assert_allclose(found, 4.0 * left.mean(axis=1) / math.pi, atol=2e-5)


def test_a_bead_sheet_returns_half_at_its_half_angle(device: object) -> None:
    """Claim: 2^(−(tan β/tan β_½)²): a half at β_½, 1 straight on, a sixteenth at twice its tangent, none at grazing."""
    import mitsuba as mi

    from scanner_sim.render.plugins.retroreflector import bead_entrance

    half = 0.6
    angle = np.array(
        [0.0, half, math.atan(2.0 * math.tan(half)), math.atan(math.tan(half) / math.sqrt(2.0)), 1.5707]
    )
    found = bead_entrance(mi.Float(np.cos(angle).tolist()), mi.Float(half)).numpy()
    np.testing.assert_allclose(found, [1.0, 0.5, 1.0 / 16.0, math.sqrt(0.5), 0.0], atol=1e-6)
