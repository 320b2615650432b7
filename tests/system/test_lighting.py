"""The lit scenarios show what they say, and their pictures come with them."""

from __future__ import annotations

import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy import stats
from typer.testing import CliRunner

from scanner_sim import load_scenario, simulate
from scanner_sim.cli import app
from scanner_sim.foundation.status import Status
from scanner_sim.instrument.memory import background_bins
from scanner_sim.instrument.photograph import take_photo
from scanner_sim.products.files.contents import LIT_PICTURES
from scanner_sim.products.image import RangeImage

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
SIZE = 64
SMALL = ["--device", "cpu"]
for setting in (
    "scan.rows=8",
    "scan.columns=16",
    "camera.interior={columns: 48, rows: 36, pixel_pitch: 130 um}",
    "transport.background_samples=2",
):
    SMALL += ["--set", setting]

pytestmark = pytest.mark.usefixtures("device")


@cache
def image(name: str, *, lit: bool = True, laser_off: float = 0.5) -> RangeImage:
    """A scenario of the conditions at a low resolution; ``lit`` False takes Sun and Earth away."""
    changes = [f"scan.rows={SIZE}", f"scan.columns={SIZE}", f"scanner.laser_off={laser_off}"]
    changes += ["transport.background_samples=2"]
    changes += [] if lit else ["lighting.sun=none", "lighting.earth=none"]
    return simulate(load_scenario(CONFIGS / f"lighting_{name}.yaml", changes), device="cpu")


def kept(name: str, laser_off: float = 0.5) -> float:
    """Share of the voxels that are measured in the dark and still are in the light.

    Those that are refused as mixed count as measured: their neighbours decide that, who may be lost in the light.
    """
    lit, dark = (
        np.isin(image(name, lit=light, laser_off=laser_off)["status"], (Status.VALID, Status.MIXED))
        for light in (True, False)
    )
    return float((lit & dark).sum() / dark.sum())


def full_well(name: str) -> float:
    return load_scenario(CONFIGS / f"lighting_{name}.yaml").scanner.position_sensor.full_well


def invoke(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.mark.slow
def test_the_dark_has_no_background() -> None:
    dark = image("dark")
    assert not dark["background"].any()
    assert np.array_equal(dark["status"], image("normal", lit=False)["status"])


@pytest.mark.slow
def test_shadow_is_where_the_scenario_says() -> None:
    """Claim: normal, partial and full shadow differ in how much of the Node the Sun reaches.

    Set-up: the three scenarios at 64 × 64; voxels on beta cloth, which covers the cone, over the background of
    the normal one's median there. Expected: near 1 in sunlight, a tenth or less in shadow, where only the Earth and
    other surfaces give light. Tolerance: half, and a fifth, between which hardly anything lies but shadow edges.
    """
    normal = image("normal")
    cloth = normal["truth.material"] == normal.materials.index("beta_cloth") + 1
    reference = float(np.median(normal["background"][cloth]))
    assert reference > 1e5
    lit = {name: image(name)["background"][cloth] / reference for name in ("partial_shadow", "full_shadow")}
    assert np.mean(normal["background"][cloth] > 0.5 * reference) > 0.7
    assert np.mean(lit["partial_shadow"] > 0.3) > 0.2
    assert np.mean(lit["partial_shadow"] < 0.2) > 0.2
    assert np.mean(lit["full_shadow"] < 0.2) > 0.95


@pytest.mark.slow
@pytest.mark.parametrize("name", ["back", "saturation"])
def test_the_sun_fills_pixels_of_its_own_rows_only(name: str) -> None:
    """Claim: Sun or glint saturate where they are seen, and take hardly any range with them.

    Set-up: at 64 × 64 the disc of 0.53° spans one or two rows. Expected: some voxels whose line holds a full pixel,
    all within three rows, a few without a range for it, and the others as in the dark. Tolerance: 1 % of the
    voxels, what all conditions but the first are allowed.
    """
    lit = image(name)
    full = lit["background_peak"] >= full_well(name)
    rows = np.flatnonzero(full.any(axis=1))
    assert rows.size
    assert np.ptp(rows) <= 2
    assert (lit["status"] == Status.SATURATED).any()
    assert not (lit["status"][~full.any(axis=1)] == Status.SATURATED).any()
    assert kept(name) >= 0.99


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "least"),
    [("full_shadow", 0.99), ("worst_case", 0.92), ("normal", 0.75), ("partial_shadow", 0.80)],
)
def test_most_voxels_stay(name: str, least: float) -> None:
    """Claim: with the filter, sunlight costs few voxels where the laser's return is not weak, and bends none.

    Set-up: each scenario with and without its light, the laser always on, 64 × 64. Expected: 0.99 without direct
    sunlight; under the Sun those are lost that reflect a twentieth of their neighbours, or away from the lens:
    black paint, nickel, rims of black discs. Measured are 0.994, 0.953, 0.81 and 0.87. Tolerance: some hundredths
    below. Of what stays, voxels that are right in the dark to 6 σ and wrong in the light are 5 in 1000: on gloss,
    where sunlight takes away the neighbours by which they had a large σ, and on shadows' edges. Of some 1500 voxels
    these are 7; a rate of 5e-3 gives more than 19 once in 10⁴.
    """
    assert kept(name, 0.0) >= least
    lit, dark = (image(name, lit=light, laser_off=0.0) for light in (True, False))

    def right(one: RangeImage) -> Any:
        return np.abs(one["range_m"] - one["truth.range_m"]) < 6.0 * one["sigma_range_m"]

    both = lit.valid & dark.valid & right(dark)
    assert np.count_nonzero(~right(lit)[both]) <= stats.binom(both.sum(), 5e-3).isf(1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["normal", "partial_shadow", "full_shadow", "saturation", "back", "worst_case", "worst_case_no_filter"],
)
def test_sunlight_costs_nothing_where_it_is_subtracted(name: str) -> None:
    """Claim: with the laser off for half of the dwell, at least 99 % of what is measured in the dark stays valid, and
    no more than 1 in 10 000 of that moves by more than 6 σ.

    Set-up: each scenario with and without its light, 64 × 64. Expected: what is lost lies at the threshold, where
    the background's noise decides, or beside full pixels. Tolerance: of some 2500 voxels 3 may move, what a rate of
    1e-4 exceeds once in 10⁴ seeds. Power: with the laser always on, normal conditions keep less than 90 %.
    """
    assert load_scenario(CONFIGS / f"lighting_{name}.yaml").scanner.laser_off == (
        0.0 if name == "worst_case_no_filter" else 0.5
    )
    assert kept(name) >= 0.99
    lit, dark = image(name), image(name, lit=False)
    both = lit.valid & dark.valid
    sigma = np.hypot(lit["sigma_range_m"], dark["sigma_range_m"])[both]
    moved = np.abs(lit["range_m"] - dark["range_m"])[both] > 6.0 * sigma
    assert moved.sum() <= stats.binom(both.sum(), 1e-4).isf(1e-4)


@pytest.mark.slow
def test_without_the_filter_the_shadow_edge_costs_voxels() -> None:
    """Claim (Figure 18): the filter is what makes the worst case harmless to a laser that always shines.

    Set-up: the same scene with and without it, 64 × 64. Expected: an open detector takes fifty times the light, and
    loses voxels at the edge and on sunlit discs: a quarter of them. Tolerance: between a tenth and a half more.
    """
    assert 0.1 < kept("worst_case", 0.0) - kept("worst_case_no_filter", 0.0) < 0.5
    with_filter, without = (image(f"worst_case{end}", laser_off=0.0) for end in ("", "_no_filter"))
    bright = with_filter["background"] > 1e5
    gain = np.median(without["background"][bright] / with_filter["background"][bright])
    assert 30.0 < gain < 80.0


@pytest.fixture(scope="module")
def normal(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run under the Sun: no test changes it."""
    folder = tmp_path_factory.mktemp("normal") / "out"
    assert invoke("run", CONFIGS / "lighting_normal.yaml", "-o", folder, *SMALL).exit_code == 0
    return folder


@pytest.mark.slow
def test_a_lit_run_writes_both_pictures_with_the_same_bytes(normal: Path, tmp_path: Path) -> None:
    result = invoke("run", CONFIGS / "lighting_normal.yaml", "-o", tmp_path / "again", *SMALL)
    assert result.exit_code == 0, result.output
    for name in LIT_PICTURES:
        assert (normal / name).read_bytes() == (tmp_path / "again" / name).read_bytes(), name
        with Image.open(normal / name) as picture:
            picture.load()
            assert np.unique(np.asarray(picture.convert("L"))).size > 8
    with Image.open(normal / "camera.png") as photo:
        assert photo.width == 48


@pytest.mark.slow
def test_pictures_of_an_earlier_light_do_not_stay(normal: Path, tmp_path: Path) -> None:
    config = CONFIGS / "lighting_normal.yaml"
    shutil.copytree(normal, tmp_path / "out")
    assert all((tmp_path / "out" / name).exists() for name in LIT_PICTURES)
    dark = ["--set", "lighting.sun=none", "--overwrite"]
    assert invoke("run", config, "-o", tmp_path / "out", *SMALL, *dark).exit_code == 0
    assert not any((tmp_path / "out" / name).exists() for name in LIT_PICTURES)


@pytest.mark.slow
def test_show_draws_the_background_as_the_run_did(normal: Path, tmp_path: Path) -> None:
    result = invoke("show", normal, "-o", tmp_path)
    assert result.exit_code == 0, result.output
    assert (tmp_path / "background.png").read_bytes() == (normal / "background.png").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["normal", "partial_shadow", "full_shadow", "saturation", "back"])
def test_a_photograph_shows_its_scene(name: str) -> None:
    """Claim: at least a quarter of each photograph is neither black nor full: its exposure fits its light.

    Set-up: the shipped scenario's camera with pixels of 40 µm that hold as much more. Whole frames have a third and
    more; of Earthshine exposed for 20 ms, as was once shipped, it was a fiftieth.
    """
    frame = ["camera.interior={columns: 160, rows: 120, pixel_pitch: 40 um}"]
    frame.append("camera.sensor.full_well=640000 electron")
    photo = take_photo(load_scenario(CONFIGS / f"lighting_{name}.yaml", frame), device="cpu")
    assert ((photo > 3) & (photo < 255)).mean() > 0.25


@pytest.mark.slow
def test_without_pictures_there_is_no_photograph(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The photograph costs as much as the scan: it is not even taken."""
    monkeypatch.setattr(
        "scanner_sim.instrument.photograph.take_photo", lambda *_, **__: pytest.fail("a photograph was taken")
    )
    arguments = ["--set", "output.pictures=false"]
    result = invoke("run", CONFIGS / "lighting_normal.yaml", "-o", tmp_path / "out", *SMALL, *arguments)
    assert result.exit_code == 0, result.output
    assert not list((tmp_path / "out").glob("*.png"))


def test_a_dry_run_names_them() -> None:
    lit = invoke("run", CONFIGS / "lighting_normal.yaml", "--dry-run").stdout
    dark = invoke("run", CONFIGS / "lighting_dark.yaml", "--dry-run").stdout
    assert all(name in lit and name not in dark for name in LIT_PICTURES)


def test_the_directions_of_a_background_are_counted_before_it_is_rendered() -> None:
    """Memory and time are told from this number: that of the panorama itself, within a pixel or two a row."""
    from scanner_sim.instrument.instrument import Instrument
    from scanner_sim.render.background.view import Rows, panorama_view

    scenario = load_scenario(CONFIGS / "lighting_normal.yaml", ["scanner.position_sensor.pitch=7 um"])
    scan, pixels = scenario.raster, scenario.scanner.position_sensor.pixels
    rows = Rows(scan.horizontal, scan.angles()[1])
    view = panorama_view(rows, Instrument(scenario, device="cpu").optics, pixels)
    assert background_bins(scenario) == pytest.approx(view.rows * view.bins, rel=0.02)
    assert background_bins(load_scenario(CONFIGS / "lighting_dark.yaml")) == 0
    assert background_bins(load_scenario(CONFIGS / "lighting_normal.yaml", ["ranging=tof"])) == 0


def test_a_background_of_hours_is_told_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pixels of 0.1 µm are legal: `check` tells the time, and `run` refuses what the memory does not hold."""
    fine = ["--set", "scanner.position_sensor.pitch=0.1 um"]
    told = invoke("check", CONFIGS / "lighting_worst_case.yaml", *fine)
    assert told.exit_code == 0
    assert "h on two processor cores" in told.stderr
    assert "processor cores" not in invoke("check", CONFIGS / "lighting_worst_case.yaml").stderr
    monkeypatch.setattr("scanner_sim.instrument.memory._free_memory", lambda: 8e9)
    refused = invoke("run", CONFIGS / "lighting_worst_case.yaml", *fine)
    assert refused.exit_code == 2
    assert "directions of the background take" in refused.stderr
    assert "scanner.position_sensor.pitch" in refused.stderr
