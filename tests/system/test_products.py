"""The files of a real run, read by programs that are not ours."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from scanner_sim.config import load_scenario
from scanner_sim.config.calibration import calibration_text, design_of
from scanner_sim.foundation.channels import CHANNELS, DERIVATIVES
from scanner_sim.foundation.parameters import INDEX, NAMES
from scanner_sim.instrument.simulate import simulate
from scanner_sim.products.files.contents import CALIBRATION, FILES, TIMED_PICTURES
from scanner_sim.products.files.exr import read_range_image
from scanner_sim.products.files.run_folder import write_run
from scanner_sim.products.image import RangeImage
from scanner_sim.ranging.calibration import Calibration
from scanner_sim.render.device import Device

SCENARIO = """\
schema: 1
seed: 7
ranging: both
scanner: {preset: nrc_2000}
scene:
  objects:
    - {name: wall, shape: rectangle, size: [1.2 m, 1.2 m], position: [0.2 m, 0.1 m, 6 m], material: {reflectance: 0.5},
       rotation: {axis: y, angle: 20 deg}}
scan: {type: raster, rows: 24, columns: 32, horizontal: [-9 deg, 9 deg], vertical: [-7 deg, 7 deg]}
"""


@pytest.fixture(scope="module")
def run(device: Device, tmp_path_factory: pytest.TempPathFactory) -> tuple[RangeImage, Path]:
    """An image with a wall in the midst of nothing, and its output folder."""
    place = tmp_path_factory.mktemp("products")
    (place / "wall.yaml").write_text(SCENARIO)
    scanner = load_scenario(place / "wall.yaml").scanner
    covariance = np.zeros((len(NAMES), len(NAMES)))
    covariance[INDEX["base"], INDEX["base"]] = 1e-4**2
    believed = Calibration(np.zeros(len(NAMES)), covariance, design_of(scanner))
    (place / "believed.yaml").write_text(calibration_text(believed, scanner))
    asked = [
        "output.truth=[normal, incidence, point]",
        "processing.calibration=believed.yaml",
        "output.jacobian=true",
    ]
    image = simulate(load_scenario(place / "wall.yaml", asked), device="cpu")
    assert 0.1 < image.valid.mean() < 0.9
    write_run(image, place / "out")
    return image, place / "out"


def test_mitsuba_reads_every_channel_of_the_exr(run: tuple[RangeImage, Path]) -> None:
    """Claim: layers and header are read as they were. By two threads: Mitsuba waits for ever where there is one."""
    import drjit as dr
    import mitsuba as mi

    image, folder = run
    threads = dr.thread_count()
    dr.set_thread_count(max(threads, 2))
    try:
        bitmap = mi.Bitmap(str(folder / "range.exr"))
    finally:
        dr.set_thread_count(threads)
    assert bitmap.component_format() == mi.Struct.Type.Float32
    names = [bitmap.struct_()[index].name for index in range(bitmap.channel_count())]
    derived = {channel.name for channel in DERIVATIVES if channel.asked == "J.base"}
    assert set(names) == {channel.name for channel in CHANNELS} | derived
    layers = np.array(bitmap)
    for index, name in enumerate(names):
        np.testing.assert_array_equal(layers[..., index], image[name], err_msg=name)
    assert bitmap.metadata()["scannerSim.scenario"] == image.scenario_yaml


def test_trimesh_reads_the_points(run: tuple[RangeImage, Path]) -> None:
    image, folder = run
    cloud = trimesh.load(folder / "points.ply")
    np.testing.assert_array_equal(cloud.vertices, image.points())
    extra = cloud.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_array_equal(extra["intensity"].ravel(), image["Y"][image.valid])
    assert set(np.unique(extra["truth_object"])) <= {0, 1}


def test_pictures_and_summary_belong_to_the_image(run: tuple[RangeImage, Path]) -> None:
    image, folder = run
    assert {path.name for path in folder.iterdir()} == {*FILES, CALIBRATION, *TIMED_PICTURES}
    for name in ("range.png", "shaded.png", "signal.png", "tof.png"):
        with Image.open(folder / name) as picture:
            picture.verify()
    found = json.loads((folder / "summary.json").read_text())
    assert found["valid_share"] == image.valid.mean()
    assert found["truth"]["voxels_by_object"][1]["name"] == "wall"


def test_the_written_scenario_gives_the_same_bytes_again(
    run: tuple[RangeImage, Path], tmp_path: Path
) -> None:
    """Claim: an output folder is enough to repeat its run, bit for bit, in every file."""
    _, folder = run
    again = simulate(load_scenario(folder / "scenario.yaml"), device="cpu")
    write_run(again, tmp_path / "again")
    for name in FILES:
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes(), name


def test_the_read_image_is_as_good_as_the_simulated_one(run: tuple[RangeImage, Path], tmp_path: Path) -> None:
    """Claim: every other file can be made from range.exr alone."""
    _, folder = run
    write_run(read_range_image(folder / "range.exr"), tmp_path / "copy")
    for name in FILES:
        assert (tmp_path / "copy" / name).read_bytes() == (folder / name).read_bytes(), name
