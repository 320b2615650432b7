"""Numbers of objects and materials stay what they are, whatever else a scene holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scanner_sim import RangeImage, load_scenario, read_range_image, simulate, write_run
from scanner_sim.campaign.reading import read_campaign
from scanner_sim.foundation.errors import ScenarioError
from scanner_sim.scene.labels import HIGHEST, Labels, LabelTable

SCAN = {"rows": 5, "columns": 5, "horizontal": ["-4 deg", "4 deg"], "vertical": ["-4 deg", "4 deg"]}
WALL = {"name": "wall", "shape": "rectangle", "size": (9.0, 9.0), "position": (0.0, 0.0, 9.0)}
WALL |= {"material": {"reflectance": 0.5}}
BALL = {"name": "ball", "shape": "sphere", "diameter": 0.4, "position": (0.0, 0.0, 8.0)}
BALL |= {"material": {"name": "paint", "reflectance": 0.5}}
BOX = {"name": "box", "shape": "box", "size": (0.4, 0.4, 0.4), "position": (0.5, 0.5, 8.0)}
BOX |= {"material": "z93_white"}


def simulated(objects: list[dict[str, Any]], labels: dict[str, dict[str, int]] | None = None) -> RangeImage:
    scene = {"objects": objects, "labels": labels or {}}
    return simulate(load_scenario({"schema": 1, "scene": scene, "scan": SCAN}), device="cpu")


def by_name(image: RangeImage) -> list[dict[str, np.ndarray]]:
    """Return where each object and each material is, by name."""
    pairs = (("truth.object", image.objects), ("truth.material", image.materials))
    return [
        {names[int(number) - 1]: image[layer] == number for number in np.unique(image[layer]) if number}
        for layer, names in pairs
    ]


def test_given_numbers_stay_and_others_follow_after_the_largest() -> None:
    table = LabelTable.of(("b", "new", "a", "b"), {"a": 5, "b": 2, "absent": 3})
    assert table.names == ("", "b", "absent", "", "a", "new")
    assert table.number_of.tolist() == [0, 2, 6, 5, 2]
    assert LabelTable.of(("b", "a"), {}).names == ("b", "a")
    assert LabelTable.of((), {}).number_of.tolist() == [0]


def test_labels_are_extended_as_long_as_there_are_numbers() -> None:
    full = Labels(objects={"a": HIGHEST - 1}).extended(("b", "a", "c"), ("m",))
    assert (full.objects, full.materials) == ({"a": HIGHEST - 1, "b": HIGHEST}, {"m": 1})


@pytest.mark.parametrize(
    ("objects", "told"),
    [
        ({"a": 1, "b": 1}, "1 is already the number of 'a'"),
        ({"a": 0}, "at least 1"),
        ({"a": HIGHEST + 1}, f"at most {HIGHEST}"),
        ({"a\nb": 1}, "this is no name"),
        ({"": 1}, "this is no name"),
    ],
)
def test_impossible_labels_are_refused(objects: dict[str, int], told: str) -> None:
    with pytest.raises(ScenarioError, match=told):
        load_scenario(
            {"schema": 1, "scene": {"objects": [WALL], "labels": {"objects": objects}}, "scan": SCAN}
        )


def test_images_of_one_table_agree_whatever_else_the_scene_holds(device: object, tmp_path: Path) -> None:
    """Claim: a name has one number in all images of a table, and each image and its file have the whole table.

    The scene's order changes, objects come and go, and the reflectance of a material that has a name changes.
    """
    labels = {"objects": {"ball": 3, "box": 7, "gone": 2}, "materials": {"paint": 4}}
    darker = {**BALL, "material": {"name": "paint", "reflectance": 0.2}}
    images = [
        simulated(scene, labels) for scene in ([WALL, BALL], [BALL, WALL], [BOX, darker], [BOX, darker, WALL])
    ]
    for image in images:
        objects, materials = by_name(image)
        assert image.objects[:7] == ("", "gone", "ball", "", "", "", "box")
        assert image.materials[3] == "paint"
        np.testing.assert_array_equal(objects["ball"], materials["paint"])
        assert objects["ball"].any()
    np.testing.assert_array_equal(images[2]["truth.object"] == 7, images[3]["truth.object"] == 7)
    write_run(images[0], tmp_path / "out")
    read = read_range_image(tmp_path / "out" / "range.exr")
    assert (read.objects, read.materials) == (images[0].objects, images[0].materials)
    about = read.to_xarray()["truth.object"].attrs
    assert about["flag_values"].tolist() == [0, 2, 3, 7, 8]
    assert about["flag_meanings"] == "nothing gone ball box wall"
    assert b"comment object 3 ball\n" in (tmp_path / "out" / "points.ply").read_bytes()


def test_labels_change_nothing_but_the_numbers(device: object) -> None:
    """Claim: every other layer has the same bytes: speckle is addressed by the renderer's own numbers."""
    plain, labelled = simulated([WALL, BALL]), simulated([WALL, BALL], {"objects": {"wall": 9, "ball": 1}})
    for name in plain.channels:
        if name != "truth.object":
            assert plain[name].tobytes() == labelled[name].tobytes(), name
    np.testing.assert_array_equal(by_name(plain)[0]["wall"], by_name(labelled)[0]["wall"])


def test_equal_materials_of_two_names_are_two(device: object) -> None:
    image = simulated([WALL, BALL])
    assert image.materials == ("reflectance_0.5", "paint")
    assert set(np.unique(image["truth.material"])) == {1.0, 2.0}


def test_the_runs_of_a_campaign_have_one_table(tmp_path: Path, small_scenario: str) -> None:
    """Claim: names of the base come first, then those that listed values bring; all runs have them all."""
    (tmp_path / "small.yaml").write_text(small_scenario, encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(
        "schema: 1\nbase: small.yaml\nvary:\n"
        "  - keys: {scene.objects.wall.material: [z93_white, {name: paint, reflectance: 0.3}, {reflectance: 0.1}]}\n"
        "  - keys: {seed: [1, 2]}\n",
        encoding="utf-8",
    )
    campaign = read_campaign(tmp_path / "plan.yaml")
    tables = [campaign.scenario(run).scene.labels for run in range(len(campaign))]
    assert tables == [tables[0]] * 6
    assert tables[0].objects == {"wall": 1}
    assert tables[0].materials == {"grey_reference": 1, "z93_white": 2, "paint": 3, "reflectance_0.1": 4}
