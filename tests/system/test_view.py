"""The page of a result and the comparison of two, by the command line and from Python; a browser draws the page."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import html5lib
import numpy as np
import pytest
from claims import mean_square
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from scanner_sim import (
    RangeImage,
    difference_of,
    read_range_image,
    read_track,
    simulate,
    simulate_lines,
    simulate_waveforms,
    view,
)
from scanner_sim.cli import app
from scanner_sim.config import scenario_from_text
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.status import Status
from scanner_sim.pose.series import PoseSeries
from scanner_sim.products.pose import read_poses
from scanner_sim.products.view.packing import unpacked
from scanner_sim.products.view.signals import WINDOW

pytestmark = pytest.mark.usefixtures("device")

NASTY = "</script><script>document.title = 'taken'</script><b>bold</b>"
SCENE = """\
schema: 1
seed: 1
ranging: both
scene:
  objects:
    - {name: wall, shape: rectangle, size: [8 m, 8 m], position: [0 m, 0 m, 9 m], material: grey_reference}
    - {name: ball, shape: sphere, diameter: 0.6 m, position: [0 m, 0 m, 7 m], material: z93_white}
lighting: {sun: {direction: [-0.35, -0.45, -0.8]}}
scan: {type: raster, rows: 12, columns: 10, horizontal: [-4 deg, 4 deg], vertical: [-4 deg, 4 deg]}
output: {pictures: false, points: false}
"""
TRACK = """\
schema: 1
seed: 4
scene:
  objects:
    - name: node
      array: {diameter: 100 mm, rows: 2, columns: 2, spacing: [1 m, 1 m], plate: 300 mm}
      position: [0 m, 0 m, 8 m]
scan: {type: track, duration: 0.2 s, targets: [node]}
output: {pictures: false}
"""
SPIRAL = """\
schema: 1
seed: 1
scene:
  objects:
    - {name: wall, shape: rectangle, size: [8 m, 8 m], position: [0 m, 0 m, 9 m], material: grey_reference}
scan: {type: spiral, radius: 2 deg, turns: 3, points: 40}
output: {pictures: false, points: false}
"""


def command(*words: object, exit_code: int = 0) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == exit_code, result.output
    assert "Traceback" not in result.output
    return result.output


def run(folder: Path, text: str, name: str) -> Path:
    (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    command("run", folder / f"{name}.yaml", "-o", folder / name, "--device", "cpu", "-q")
    return folder / name


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(tmp_path_factory.mktemp("results"), SCENE, "run")


@pytest.fixture(scope="module")
def image(folder: Path) -> RangeImage:
    return read_range_image(folder / "range.exr")


@pytest.fixture(scope="module")
def page(folder: Path) -> Path:
    path = folder.parent / "page.html"
    told = command("view", folder, "-o", path, "--device", "cpu")
    assert str(path) in re.sub(r"\s", "", told)
    return path


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(tmp_path_factory.mktemp("tracked"), TRACK, "track")


def parsed(page: Path) -> Element:
    """Return the page as browsers read it: without a fault, it asks for nothing and runs its own two scripts alone."""
    text = page.read_text(encoding="utf-8")
    tree = html5lib.HTMLParser(strict=True, namespaceHTMLElements=False).parse(text)
    found: Element = tree
    scripts = list(found.iter("script"))
    assert [one.get("type") for one in scripts] == ["application/json", None, None]
    for element in found.iter():
        assert not {"src", "href", "srcset", "style"} & set(element.attrib)
        assert not any(name.startswith("on") for name in element.attrib)
        assert element.tag not in ("link", "iframe", "object", "img")
    (policy,) = (one.get("content") for one in found.iter("meta") if one.get("http-equiv"))
    assert policy is not None
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    return found


def data_of(page: Path) -> dict[str, Any]:
    (text,) = (one.text for one in parsed(page).iter("script") if one.get("type") == "application/json")
    assert text is not None
    found: dict[str, Any] = json.loads(text)
    return found


def drawn(page: Path, place: str, profile: Path) -> str | None:
    """Return what a headless Chromium made of the page, offline; None where there is none."""
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if browser is None:
        return None
    software = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    offline = [
        "--headless",
        "--no-sandbox",
        "--host-resolver-rules=MAP * ~NOTFOUND",
        "--virtual-time-budget=20000",
    ]
    command = [
        browser,
        *software,
        *offline,
        f"--user-data-dir={profile}",
        "--dump-dom",
        f"{page.as_uri()}#{place}",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    # A command of that name that opens nothing is no browser.
    return None if done.returncode else done.stdout


def panel(dom: str) -> str:
    """Return the text at the side of a page that was drawn."""
    tree = html5lib.parse(dom, namespaceHTMLElements=False)
    assert tree.get("data-state") == "ready"
    (found,) = (one for one in tree.iter("aside") if one.get("id") == "panel")
    return " ".join(" ".join(found.itertext()).split())


def test_the_page_holds_the_layers_of_the_result(page: Path, image: RangeImage) -> None:
    data = data_of(page)
    for name in ("range_m", "truth.range_m", "tof.range_m", "fused.range_m", "status", "truth.object"):
        assert np.array_equal(unpacked(data["layers"][name]), image[name].ravel(), equal_nan=True), name
    for name in ("sigma_range_m", "Y", "background"):
        assert unpacked(data["layers"][name]) == pytest.approx(
            image[name].ravel(), rel=2.5e-4, nan_ok=True
        ), name
    valid = image.valid.ravel()
    assert unpacked(data["position"])[valid] == pytest.approx(image.points(), rel=1e-5, abs=1e-6)
    # Without a range the true place: eq 3 with R, Θ and φ of the truth, but for the errors of the mirrors.
    unseen = ~valid & np.isfinite(image["truth.range_m"].ravel())
    depth = np.linalg.norm(unpacked(data["position"]), axis=1)[unseen]
    assert depth == pytest.approx(image["truth.range_m"].ravel()[unseen], rel=2e-3)
    assert data["objects"] == ["wall", "ball"]
    assert data["surroundings"]["sun"] == pytest.approx(np.array([-0.35, -0.45, -0.8]) / np.sqrt(0.965))
    assert {
        "range",
        "signal",
        "σ of the range",
        "status",
        "error",
        "error over σ",
        "object",
        "background",
    } <= {shade["name"] for shade in data["shades"]}
    assert data["notes"] == list(image.warnings)


def test_the_page_holds_the_lines_and_waveforms_of_the_run(page: Path, image: RangeImage) -> None:
    scenario = scenario_from_text(image.scenario_yaml, name="stored", stored=True)
    lines, waveforms = simulate_lines(scenario, device="cpu"), simulate_waveforms(scenario, device="cpu")
    kept = {one["kind"]: one for one in data_of(page)["signals"]}
    for kind, whole in (("line", lines), ("waveform", waveforms)):
        first, number = unpacked(kept[kind]["first"]), unpacked(kept[kind]["number"])
        assert number.dtype == whole.number.dtype
        at = first[:, None] + np.arange(WINDOW[kind])
        assert np.array_equal(number, np.take_along_axis(whole.number, at, axis=1)), kind
    peak = lines["peak_px"]
    found = np.isfinite(peak)
    inside = (unpacked(kept["line"]["first"]) <= peak) & (
        peak < unpacked(kept["line"]["first"]) + WINDOW["line"]
    )
    assert inside[found].all()


def test_lines_of_the_disk_are_those_that_are_simulated(page: Path, tmp_path: Path) -> None:
    """Claim: a run that has kept its lines and waveforms has the same page, though its scene cannot be loaded."""
    text = SCENE.replace("points: false", "points: false, lines: all, waveforms: all")
    kept = run(tmp_path, text, "kept")
    found = read_range_image(kept / "range.exr")
    view(found, tmp_path / "kept.html", folder=kept, device="cpu")
    assert data_of(tmp_path / "kept.html")["signals"] == data_of(page)["signals"]


def test_a_small_page_is_thinned_out_and_says_so(image: RangeImage, tmp_path: Path) -> None:
    path = view(image, tmp_path / "small.html", largest_mb=0.703, device="cpu")
    data = data_of(path)
    assert path.stat().st_size < 0.703e6
    step = data["step"]
    assert step > 1
    assert data["shape"] == [-(-12 // step), -(-10 // step)]
    assert unpacked(data["layers"]["range_m"]) == pytest.approx(
        image["range_m"][::step, ::step].ravel(), nan_ok=True
    )
    assert all("below 0.703 MB" in note for note in data["notes"][:1])
    rows = unpacked(data["signals"][0]["row"])
    assert len(rows) > 0
    assert not (rows % step).any()
    plain = data_of(view(image, tmp_path / "plain.html", lines=False))
    assert plain["signals"] == []


@pytest.mark.slow
def test_a_browser_shows_a_voxel(page: Path, image: RangeImage, tmp_path: Path) -> None:
    """Claim: the panel tells the numbers of the image, and draws line and waveform.

    Where there is no Chromium the parser's reading of the other tests stands alone.
    """
    both = image.valid & np.isfinite(image["tof.range_m"]) & (image["truth.object"] == 2)
    row, column = np.argwhere(both)[0]
    dom = drawn(page, f"voxel={row},{column}", tmp_path / "profile")
    if dom is None:
        pytest.skip("there is no Chromium here")
    said = panel(dom)
    assert f"row {row}, column {column}" in said
    for name in ("range_m", "tof.range_m", "fused.range_m", "truth.range_m"):
        assert f"{image[name][row, column]:.4f} m" in said, name
    assert Status.VALID.sentence in said
    assert "ball, z93_white" in said
    assert "digital number" in said
    assert "echo" in said
    (side,) = re.findall(r"<aside.*?</aside>", dom, re.DOTALL)
    assert side.count("<rect") >= WINDOW["line"] + WINDOW["waveform"]
    assert f"peak {image['peak_px'][row, column]:.2f}" in said
    assert 'class="gl"' in dom, "the points are drawn"
    assert "to the Sun" in dom


def test_a_name_that_is_markup_stays_a_text(image: RangeImage, tmp_path: Path) -> None:
    """Claim: names that a file holds, though no scenario may, run nothing: in data, title, legend and table."""
    changed = dataclasses.replace(image, objects=("wall", NASTY))
    path = view(changed, tmp_path / "nasty.html", title=NASTY, lines=False)
    assert data_of(path)["objects"] == ["wall", NASTY]
    row, column = np.argwhere(~image.valid & (image["truth.object"] == 2))[0]
    dom = drawn(path, f"voxel={row},{column}&colour=object", tmp_path / "profile")
    if dom is None:
        pytest.skip("there is no Chromium here")
    assert f"{NASTY}, " in panel(dom)
    assert Status(int(image["status"][row, column])).sentence in panel(dom)
    tree = html5lib.parse(dom, namespaceHTMLElements=False)
    assert [one.text for one in tree.iter("title")] == [NASTY]
    assert not list(tree.iter("b"))
    assert len(list(tree.iter("script"))) == 3


def test_the_page_of_a_track_holds_its_visits_and_poses(tracked: Path, tmp_path: Path) -> None:
    command("view", tracked, "-o", tmp_path / "track.html", "--device", "cpu", "-q")
    data, track = data_of(tmp_path / "track.html"), read_track(tracked)
    visits = {name: unpacked(packed) for name, packed in data["visits"].items()}
    assert visits["time"] == pytest.approx([one.time for one in track.records], rel=1e-6)
    errors = [one.position[2] - one.truth[2] for one in track.records]
    assert visits["error"] == pytest.approx(errors, rel=1e-6, nan_ok=True)
    names = [data["targets"][number]["name"] for number in visits["target"]]
    assert names == [one.target for one in track.records]
    first = unpacked(data["patterns"]["first"])
    measured = [
        int(np.isfinite(one.samples.range[0][one.samples.status[0] == 0]).sum()) for one in track.records
    ]
    assert np.diff(first).tolist() == measured
    assert {pose["object"] for pose in data["poses"]} == {"node"}
    poses = read_poses(tracked / "pose.parquet")
    for kept, series in zip(data["poses"], poses, strict=True):
        assert (kept["object"], kept["method"]) == (series.name, series.method)
        assert unpacked(kept["error"]) == pytest.approx(off(series), rel=1e-6, nan_ok=True)
        assert unpacked(kept["sigma"]) == pytest.approx(sigmas(series), rel=2.5e-4, nan_ok=True)
    dom = drawn(tmp_path / "track.html", "time=0.16", tmp_path / "profile")
    if dom is None:
        return
    said = panel(dom)
    last = [one for one in track.records if one.target == "node/1" and one.time <= 0.16][-1]
    assert last.after.value in said
    (cells,) = re.findall(r"node/1 \w+" + 3 * r" ([+−]?\d+\.?\d*)", said)
    error, sigma = last.position[2] - last.truth[2], np.sqrt(last.covariance[2, 2])
    told = [float(cell.replace("−", "-")) for cell in cells]
    assert told[:2] == pytest.approx([1e3 * error, 1e3 * sigma], rel=6e-3)
    assert told[2] == pytest.approx(error / sigma, rel=6e-2)
    assert "error of the range" in said
    assert "0.160 s" in dom
    # Of each method the pose before the moment: error and σ of place [mm] and of attitude [mrad].
    rows = re.findall(r"node (uv|xyz|joint)" + 4 * r" (\d+\.?\d*)", said)
    assert [row[0] for row in rows] == [series.method for series in poses]
    for row, series in zip(rows, poses, strict=True):
        now = np.flatnonzero(series.time <= 0.16)[-1]
        told = np.stack([off(series)[now], sigmas(series)[now]], axis=1).ravel()
        assert [float(cell) for cell in row[1:]] == pytest.approx(1e3 * told, rel=6e-3)


def off(series: PoseSeries) -> NDArray[np.float64]:
    """Return how far poses lie from the truth [m], and by what angle they are turned against it [rad]."""
    good = np.equal(series.status, 0)
    found = np.full((len(good), 2), np.nan)
    found[good, 0] = np.linalg.norm(series.position[good] - series.truth_position[good], axis=1)
    true, seen = (Rotation.from_matrix(one[good]) for one in (series.truth_rotation, series.rotation))
    found[good, 1] = (true.inv() * seen).magnitude()
    return found


def sigmas(series: PoseSeries) -> NDArray[np.float64]:
    """Return σ of place [m] and of attitude [rad], of all three axes together."""
    return np.stack(
        [np.linalg.norm(series.sigma[:, part], axis=1) for part in (np.s_[:3], np.s_[3:])], axis=1
    )


def test_the_page_of_a_track_holds_the_outlines_of_its_discs(tracked: Path, tmp_path: Path) -> None:
    """Claim: discs of 100 mm of an array that faces the scanner have half axes of 50 mm along x and y."""
    command("view", tracked, "-o", tmp_path / "track.html", "--device", "cpu", "-q")
    visits = data_of(tmp_path / "track.html")["visits"]
    outline = unpacked(visits["outline"])
    assert outline.shape == (len(unpacked(visits["time"])), 2, 3)
    facing = np.broadcast_to(0.05 * np.eye(3)[:2], outline.shape)
    assert outline == pytest.approx(facing, rel=2.5e-4, abs=1e-9)


def test_shots_have_a_page_without_lines(tmp_path: Path) -> None:
    out = run(tmp_path, SPIRAL, "spiral")
    command("view", out, "--device", "cpu", "-q")
    command("view", out, "--device", "cpu", "-q")  # the page beside the result is ours to write anew
    data = data_of(out / "view.html")
    assert not data["raster"]
    assert any("shots have none" in note for note in data["notes"])
    told = command("difference", out, out, "-o", tmp_path / "self")
    assert "both have seed 1" in " ".join(told.split())
    assert json.loads((tmp_path / "self" / "difference.json").read_text())["status_changes"] == []


def test_bad_input_of_view_has_one_message(
    folder: Path, page: Path, image: RangeImage, tmp_path: Path
) -> None:
    (tmp_path / "range.exr").write_bytes(b"nothing")
    for words, said in (
        ((tmp_path / "none",), "There is no folder"),
        ((tmp_path,), "range.exr"),
        ((folder, "-o", page), "exists already"),
        ((folder, "-o", tmp_path), "folder"),
    ):
        told = command("view", *words, exit_code=2)
        assert said in told
        assert told.count("error:") == 1
    with pytest.raises(InputError, match="no layer range_m"):
        view(image.keeping(["Y"]), tmp_path / "page.html")
    assert not (tmp_path / "page.html").exists()


def test_two_runs_of_other_seeds_differ_by_their_sigma() -> None:
    """Claim: differences over σ of both have a mean square of 1, for a wall in the dark.

    Set-up: 48 × 64 voxels of a wall, two seeds. What both runs share cancels in the difference though each σ holds it:
    the surface's speckle and the pixels' unlike response are therefore off. Level 10⁻⁴ (claims.py).
    """
    text = """\
schema: 1
scanner: {laser: {speckle: false}, position_sensor: {noise: {prnu: false}}}
scene:
  objects:
    - {name: wall, shape: rectangle, size: [8 m, 8 m], position: [0 m, 0 m, 9 m], material: grey_reference}
scan: {type: raster, rows: 48, columns: 64, horizontal: [-4 deg, 4 deg], vertical: [-3 deg, 3 deg]}
"""
    first, second = (
        simulate(scenario_from_text(text, name="wall", overrides=[f"seed={seed}"]), device="cpu")
        for seed in (1, 2)
    )
    (one,) = difference_of(first, second).ranges
    pull = one.over_sigma[np.isfinite(one.over_sigma)]
    assert pull.size > 3000
    assert mean_square(pull)


@pytest.mark.slow
def test_the_difference_of_two_runs_is_told_drawn_and_refused(folder: Path, tmp_path: Path) -> None:
    other = run(tmp_path, SCENE.replace("seed: 1", "seed: 2"), "other")
    out = tmp_path / "difference"
    told = command("difference", folder, other / "range.exr", "-o", out)
    assert "scenarios differ in  seed" in told
    numbers = json.loads((out / "difference.json").read_text(encoding="utf-8"))
    assert numbers["seeds"] == [1, 2]
    assert numbers["changed_keys"] == ["seed"]
    assert set(numbers["ranges"]) == {"range", "range by time of flight", "range by both"}
    found = difference_of(read_range_image(folder / "range.exr"), read_range_image(other / "range.exr"))
    assert numbers["ranges"]["range"]["both"] == int(np.isfinite(found.ranges[0].difference).sum())
    assert (out / "difference.png").stat().st_size > 10_000
    for words, said in (
        ((folder, other, "-o", out), "already holds a result"),
        ((folder, tmp_path / "none"), "There is no folder"),
    ):
        assert said in command("difference", *words, exit_code=2)
    small = run(tmp_path, SCENE.replace("rows: 12", "rows: 6"), "small")
    assert "different scans: 12 × 10 and 6 × 10" in command("difference", folder, small, exit_code=2)


def test_a_track_is_no_scan_to_compare(folder: Path, tracked: Path) -> None:
    assert "is a tracking run" in command("difference", folder, tracked, exit_code=2)
