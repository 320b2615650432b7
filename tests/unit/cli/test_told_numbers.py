"""What commands tell of numbers: cells of tables, the names of pictures, and which runs there are."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import typer

from scanner_sim.cli import approaching, campaign, comparing, converting, explaining, showing, tracking
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.status import Status
from scanner_sim.instrument import simulate
from scanner_sim.products import comparison_page
from scanner_sim.products.files.shots_folder import write_shots
from scanner_sim.products.pictures import voxel
from scanner_sim.products.settings import Output
from scanner_sim.products.shots import ShotTable
from scanner_sim.tracking.record import TrackStatus
from scanner_sim.tracking.state import TrackMode
from scanner_sim.validation.compare import baseline as baselines
from scanner_sim.validation.compare import run


@pytest.mark.parametrize(
    ("tries", "valid", "expected"),
    [
        (0, 0, "–"),
        (4, 0, "0 %"),
        (4, 1, "25 %, 2 (3) mm, 0.57 (1.1)°"),
    ],
)
def test_a_cell_of_an_approach_tells_what_there_is(tries: int, valid: int, expected: str) -> None:
    """Claim: nothing without a try, the share alone without a pose, else errors in mm and degrees and their σ."""
    nothing = math.nan
    row: Any = SimpleNamespace(
        tries=tries, valid=valid, availability=valid / tries if tries else nothing,
        position_m=2e-3 if valid else nothing, position_sigma_m=3e-3 if valid else nothing,
        attitude_rad=0.01 if valid else nothing, attitude_sigma_rad=0.02 if valid else nothing,
    )  # fmt: skip
    assert approaching._cell(row) == expected


@pytest.mark.parametrize(("run", "known"), [(-1, False), (0, True), (4, True), (5, False)])
def test_runs_of_a_campaign_count_from_zero(run: int, known: bool) -> None:
    store: Any = SimpleNamespace(campaign=range(5))
    if known:
        campaign._check_run(store, run)
        return
    with pytest.raises(InputError, match=f"no run {run}") as fault:
        campaign._check_run(store, run)
    assert "0 to 4" in fault.value.remedy


@pytest.mark.parametrize("lined", [True, False])
def test_a_table_of_an_instrument_has_the_columns_of_its_array(lined: bool) -> None:
    """Claim: pixels, spots and the well of an array where there is one; lengths in mm, the well in %; the first and the
    last range stand in it, and each line is of one range."""
    ranges = np.geomspace(1.0, 100.0, 31)
    line = SimpleNamespace(pixel_m=1e-3 * ranges, image_px=2.0 * ranges, filled=1e-3 * ranges)
    sheet: Any = SimpleNamespace(
        spot_m=5e-3 * ranges, line=line if lined else None, lateral_m=7e-3 * ranges, range_m=ranges,
        sigma_m={"tof": 9e-3 * ranges},
    )  # fmt: skip
    head, *rows = explaining._table(sheet)
    factors = {"beam [mm]": 5.0, "σ across [mm]": 7.0}
    if lined:
        factors |= {"pixel [mm]": 1.0, "spot σ [pixel]": 2.0, "% of full well": 0.1}
    assert set(factors) < set(head)
    assert len(head) == len(factors) + 2
    assert ("pixel [mm]" in head) is lined
    for place in (0, -1):
        cells = dict(zip(head, rows[place], strict=True))
        for name, factor in factors.items():
            assert float(cells[name]) == pytest.approx(factor * ranges[place], rel=5e-3)
        assert float(rows[place][-1]) == pytest.approx(9.0 * ranges[place], rel=5e-3)


@pytest.mark.parametrize("both", [True, False])
def test_a_voxel_is_told_by_each_way_of_ranging(both: bool) -> None:
    """Claim: time of flight from its layers, both together from theirs, where there are any; the delay in ns; the row
    before the column."""
    layers = {}
    for number, prefix in enumerate(("tof.", "fused.") if both else ("tof.",), start=1):
        layers[f"{prefix}range_m"] = np.full((2, 3), 9.0)
        layers[f"{prefix}range_m"][1, 2] = number
        layers[f"{prefix}sigma_range_m"] = np.full((2, 3), 0.01 * number)
        layers[f"{prefix}status"] = np.full((2, 3), int(Status.VALID))
    layers["truth.range_m"] = np.arange(6.0).reshape(2, 3)
    waveforms: Any = SimpleNamespace(delay=np.array([40e-9]), sigma=np.array([2e-9]), echoes=np.array([3.0]))
    found = showing._timed_numbers(layers, 1, 2, waveforms)  # type: ignore[arg-type]
    assert found["range by time of flight"] == "1.00000 ± 0.01000 m"
    assert found.get("range by both") == ("2.00000 ± 0.02000 m" if both else None)
    assert (found["delay"], found["echoes"]) == ("40.0000 ± 2.0000 ns", "3")
    assert (found["voxel"], found["true range"]) == ("row 1, column 2", "5.00000 m")
    layers["tof.range_m"][1, 2] = math.nan
    layers["tof.status"][1, 2] = int(Status.BELOW_THRESHOLD)
    found = showing._timed_numbers(layers, 1, 2, waveforms)  # type: ignore[arg-type]
    assert found["range by time of flight"] == f"none: {Status.BELOW_THRESHOLD.sentence}"


def test_a_picture_of_a_voxel_is_named_by_its_place(
    tmp_path: Path, told: Callable[[Any], list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: voxel_ROW_COLUMN.png, beside the result, or in the folder that is asked for; the voxel is that one."""
    asked: list[tuple[int, int]] = []
    found = told(showing)
    image = SimpleNamespace(shape=(2, 3), scenario_yaml="")
    monkeypatch.setattr(showing, "_read", lambda _: (tmp_path / "range.exr", image))
    one = SimpleNamespace(rangefinders=("triangulation",))
    monkeypatch.setattr(showing, "scenario_from_text", lambda *_, **__: one)
    monkeypatch.setattr(simulate, "simulate_voxel", lambda _, row, column, **__: asked.append((row, column)))
    monkeypatch.setattr(voxel, "draw_voxel", lambda _, to: Path(to).write_bytes(b"PNG"))
    monkeypatch.setattr(showing, "_numbers", lambda _: {"peak": "1"})
    for folder in (None, tmp_path / "other"):
        showing.show_voxel(tmp_path, (1, 2), folder, device="cpu", overwrite=False)
        made = (folder or tmp_path) / "voxel_1_2.png"
        assert made.read_bytes() == b"PNG"
        assert found[-1] == {"peak": "1", "picture": str(made)}
    assert asked == [(1, 2), (1, 2)]
    for outside in ((2, 0), (0, 3), (-1, 0), (0, -1)):
        with pytest.raises(InputError, match="outside of the 2 × 3 raster"):
            showing.show_voxel(tmp_path, outside, None, device="cpu", overwrite=False)


@pytest.mark.parametrize("passed", [True, False])
def test_a_comparison_ends_with_its_verdict(monkeypatch: pytest.MonkeyPatch, passed: bool) -> None:
    """Claim: the status is 1 where a law is broken, 0 otherwise; the files are written before."""
    found = SimpleNamespace(passed=passed)
    written: list[set[str]] = []
    call: Any = SimpleNamespace(
        scenario=lambda: None, device="cpu", quiet=True, claimed=lambda _: nullcontext(),
        work=lambda *_: nullcontext((None, None)), write=lambda _, files: written.append(set(files)),
    )  # fmt: skip
    monkeypatch.setattr(run, "judge_laws", lambda *_, **__: found)
    for module, name in (
        (comparing, "comparison_json"), (comparing, "resolved_yaml"), (comparison_page, "comparison_page")
    ):  # fmt: skip
        monkeypatch.setattr(module, name, lambda *_: "")
    asked = {"target": None, "only": (), "seeds": 1, "level": 0.01, "quick": True, "baseline": None}
    with nullcontext() if passed else pytest.raises(typer.Exit) as status:
        comparing.compare_scenario(call, **asked)
    assert passed or status.value.exit_code == 1
    assert {"compare.html", "compare.png", "scenario.yaml"} < written[0]


def test_a_comparison_is_of_what_was_asked_against_what_was_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: each option arrives as itself; the new comparison is held against the earlier one, not the other way
    round, and what comes of that is written."""
    asked: list[Any] = []
    files: dict[str, Any] = {}
    call: Any = SimpleNamespace(
        scenario=lambda: "scenario", device="cpu", quiet=True, claimed=lambda _: nullcontext(),
        work=lambda *_: nullcontext(("advance", "say")), write=lambda _, made: files.update(made),
    )  # fmt: skip
    monkeypatch.setattr(run, "judge_laws", lambda *one, **more: asked.append((*one, more)) or "now")
    monkeypatch.setattr(baselines, "read_baseline", lambda path: f"before of {path}")
    monkeypatch.setattr(
        baselines, "against", lambda *both: asked.append(both) or SimpleNamespace(passed=True, of=both)
    )
    monkeypatch.setattr(comparing, "comparison_json", lambda found: ("json", found.of))
    monkeypatch.setattr(comparing, "resolved_yaml", lambda given: f"yaml of {given}")
    monkeypatch.setattr(comparison_page, "comparison_page", lambda found, text: ("page", found.of, text))
    more = {"only": ("a", "b"), "seeds": 3, "level": 0.01, "quick": True, "baseline": Path("old.json")}
    comparing.compare_scenario(call, target="40 % at 2 m, 7 m", **more)
    (setting, options), both = asked
    assert (setting.scenario, setting.seeds, setting.quick, setting.device) == ("scenario", 3, True, "cpu")
    assert (setting.target.reflectance, setting.target.ranges) == (0.4, (2.0, 7.0))
    assert options == {"only": ("a", "b"), "level": 0.01, "progress": "advance"}
    assert both == ("now", "before of old.json")
    assert files["compare.html"] == ("page", both, "yaml of scenario")
    assert files["scenario.yaml"] == "yaml of scenario"
    assert ("json", both) in files.values()


def test_shots_whose_layers_were_taken_out_are_not_shown(tmp_path: Path) -> None:
    """Claim: as of an image, a message names the first that is missing, and no picture is drawn."""
    layers = {name: np.zeros(2, np.float32) for name in ("status", "range_m", "Y", "truth.range_m")}
    shots = ShotTable(layers, np.arange(2.0), 0.1 * np.arange(2.0), np.zeros(2))
    write_shots(shots, tmp_path, Output(pictures=False))
    with pytest.raises(InputError, match="has no channel sigma_range_m"):
        showing.show_shots(tmp_path, None, overwrite=False)
    assert not list(tmp_path.glob("*.png"))


@pytest.mark.parametrize("folder", [True, False])
def test_points_are_written_beside_their_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: bool
) -> None:
    """Claim: into the folder of a result, or of its file, unless another is named."""
    result = tmp_path if folder else tmp_path / "range.exr"
    asked: list[tuple[Any, ...]] = []
    monkeypatch.setattr(converting, "convert", lambda *given, **_: asked.append(given) or ())
    for other in (None, tmp_path / "other"):
        converting.convert_result(result, ["las"], other, by="", overwrite=False, quiet=True)
        assert asked[-1] == (result, other or tmp_path, ["las"])


def test_a_visit_is_told_in_radians_and_microradians() -> None:
    """Claim: of Θ, φ [rad] and range [m] the measured and the true one, σ and error in µrad and mm."""
    record: Any = SimpleNamespace(
        number=3, target="node/1", time=1.5, mode=TrackMode.TRACK, after=TrackMode.SEARCH, status=TrackStatus.MEASURED,
        amplitude=2e-3, samples=SimpleNamespace(time=np.zeros((1, 7)), valid=np.arange(7)[None] < 5),
        position=np.array([0.1, 0.2, 9.0]) + np.array([1e-6, -2e-6, 3e-3]), truth=np.array([0.1, 0.2, 9.0]),
        covariance=np.diag([4e-12, 9e-12, 16e-6]),
    )  # fmt: skip
    found = tracking._numbers(record)
    assert found["voxels"] == "7, 5 with a range"
    assert found["amplitude"] == "2.000 mrad"
    assert found["Θ"] == "0.100001 rad ± 2 µrad, true 0.100000 rad, error +1 µrad"
    assert found["φ"] == "0.199998 rad ± 3 µrad, true 0.200000 rad, error -2 µrad"
    assert found["range"] == "9.003000 m ± 4 mm, true 9.000000 m, error +3 mm"
    record.position = np.full(3, math.nan)
    assert "range" not in tracking._numbers(record)


def test_conditions_of_an_approach_stand_under_their_names() -> None:
    """Claim: a line for each method in words, cells in the order of the conditions, and at last how many epochs each
    condition has, which are the same for every method."""
    row = SimpleNamespace(tries=0)
    rows = [
        SimpleNamespace(**vars(row), method=method, epochs=epochs if method == "uv" else 99)
        for method in ("uv", "xyz") for epochs in (5, 0, 7)
    ]  # fmt: skip
    labels = [SimpleNamespace(name=name) for name in ("lit", "shaded", "dark")]
    study: Any = SimpleNamespace(labels=labels, methods={"uv": "angles", "xyz": "points"}, conditions=rows)
    assert approaching.condition_table(study) == [
        ["method", "lit", "shaded", "dark"], ["angles", *3 * ["–"]], ["points", *3 * ["–"]], ["epochs", "5", "0", "7"],
    ]  # fmt: skip
