"""What commands say at their end of images, scenes, instruments, voxels and data sets: numbers, units and words."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scanner_sim.campaign.dataset.licences import NOT_STATED
from scanner_sim.cli import dataset, explaining, plan, running, showing, tables, tracking, viewing_scene
from scanner_sim.foundation.status import Status
from scanner_sim.products import comparison_page
from scanner_sim.products.files import contents
from scanner_sim.tracking.record import TrackStatus


class Image(dict[str, Any]):
    """Layers of a made-up image."""

    shape = (3, 4)

    @property
    def valid(self) -> np.ndarray:
        return np.asarray(self["status"] == 0)


def test_an_image_is_told_by_its_valid_ranges() -> None:
    """Claim: voxels, those with a range and their share; median and ends of ranges, median σ [mm]; where uneven light
    is more than noise, σ² by it above half; σ of the other ways; shares beyond 5 σ; and each other status."""
    status = np.zeros((3, 4), dtype=int)
    status[0] = [int(Status.BELOW_THRESHOLD), int(Status.SATURATED), int(Status.SATURATED), 0]
    range_m, sigma = np.arange(12.0).reshape(3, 4) + 1.0, np.full((3, 4), 2e-3)
    sigma[2] = 4e-3
    texture = np.zeros((3, 4))
    texture[1, 0], texture[1, 1], texture[1, 2] = 1.42e-3, 1.41e-3, 1.9e-3
    image: Any = Image(
        {"status": status, "range_m": range_m, "sigma_range_m": sigma, "sigma_texture_m": texture}
    )
    found = running.closing(image, [Path("f/range.exr"), Path("f/a.png")])
    assert found["voxels"] == "3 × 4"
    assert found["with a range"] == "9 (75 %)"
    assert found["range"] == "8 m median, 4 m to 12 m"
    assert found["σ of the range"] == "2 mm median"
    assert found["σ by uneven spots"] == "more than noise in 22 % of the ranges"
    assert found["saturated"].startswith("2 (")
    assert found["below threshold"] == f"1 ({Status.BELOW_THRESHOLD.sentence})"
    assert "valid" not in found
    assert not [name for name in found if "beyond" in name or "time of flight" in name]
    for way, metres in (("tof.", 3e-3), ("fused.", 1e-3)):
        image |= {
            f"{way}range_m": range_m, f"{way}sigma_range_m": np.full((3, 4), metres), f"{way}status": status
        }  # fmt: skip
    image["tof.sigma_range_m"][0, 0] = math.nan
    truth = range_m.copy()
    truth[1:, 0] += 9.9e-3, 20.1e-3
    truth[0, :2] = math.nan
    image["truth.range_m"] = truth
    found = running.closing(image, [])
    assert (found["σ of time of flight"], found["σ of both together"]) == ("3 mm median", "1 mm median")
    assert found["beyond 5 σ"] == "10 % of the ranges whose truth is known"
    assert found["beyond 5 σ of both together"] == "20 % of the ranges whose truth is known"


def test_a_data_set_is_told_by_split() -> None:
    made: Any = SimpleNamespace(
        counts={"train": 1200, "test": 3}, left_out=2, failed=1, backdrop={"wall", "floor"},
        files=[Path("a/u.parquet"), Path("a/v.parquet"), Path("a/README.md")],
    )  # fmt: skip
    found = dataset._closing(made)
    assert (found["train"], found["test"], found["shards"]) == ("1,200 views", "3 views", "2")
    assert found["left out"].startswith("2 views")
    assert found["failed"] == "1 runs"
    assert found["in all splits"] == "floor, wall: alike in every view"
    assert "README.md" in " ".join(found.values())
    assert "u.parquet" not in " ".join(found.values())
    made.left_out, made.failed, made.backdrop = 0, 0, ()
    assert dataset._closing(made).keys() & {"left out", "failed", "in all splits"} == set()


def test_objects_of_a_scene_are_told_one_by_one() -> None:
    """Claim: size along x, y, z, distance and triangles, and six materials at most."""
    one = SimpleNamespace(
        name="u", kind="mesh", moves=True, size=(1.0, 2.5, 0.125), distance=7.25, triangles=12345,
        materials=[f"m{n}" for n in range(7)],
    )  # fmt: skip
    still = SimpleNamespace(**{**vars(one), "moves": False, "materials": ["m"] * 6})
    view: Any = SimpleNamespace(objects=[one, still], seen=lambda which: "yes" if which is one else "no")
    head, first, second = viewing_scene._table(view)
    assert len(head) == len(first)
    cells = "u", "mesh, moves", "1 × 2.5 × 0.125", "7.25", "12,345", "m0, m1, m2, m3, m4, m5 …", "yes"
    assert first == cells
    assert (second[1], second[-2], second[-1]) == ("mesh", ", ".join(["m"] * 6), "no")


@pytest.mark.parametrize(
    ("far", "words"), [(math.inf, "0.5 m to infinity"), (20.0, "0.5 m to 20 m")], ids=["open", "closed"]
)
def test_ranges_are_told_by_their_ends(far: float, words: str) -> None:
    scanner: Any = SimpleNamespace(seen_by={"tof": (0.5, far), "triangulation": (0.5, far)}.__getitem__)
    assert explaining._seen(scanner, "tof") == f"{words} by time of flight"
    assert explaining._seen(scanner, "triangulation") == f"{words} on the array"
    scenario: Any = SimpleNamespace(scanner=scanner)
    assert plan._seen(scenario, "tof") == f"{words} by time of flight"
    assert plan._seen(scenario, "triangulation") == words


def test_an_instrument_is_told_in_usual_units() -> None:
    """Claim: base and focal length in mm, the f-number, half of the field in degrees, the beam in mm and mrad by
    twice its radius and half angle; power in mW, or µW below a hundredth, or energy
    [µJ] and full width [ns] of pulses."""
    laser = SimpleNamespace(
        power=0.015, wavelength=1.5e-6, waist_radius=2e-3, waist_distance=1.9, divergence=2.5e-4
    )
    pulse = SimpleNamespace(pulse_energy=2.5e-7, sigma=1e-9)
    receiver = SimpleNamespace(
        array_tilt="ideal",
        focus_distance="infinity",
        line_image=SimpleNamespace(slope=math.tan(math.radians(30.0))),
    )
    scanner: Any = SimpleNamespace(
        laser=laser, lidar=SimpleNamespace(pulse=pulse), rangefinders=("triangulation",), receiver=receiver,
        seeing=("triangulation", "tof"), seen_by={"triangulation": (1.0, math.inf), "tof": (0.5, 35.0)}.__getitem__,
    )  # fmt: skip
    sheet: Any = SimpleNamespace(
        line=1, baseline=0.2, half_field=math.radians(20.0), rate=18750.0, focal_length=0.1, aperture=0.025
    )
    found = explaining.instrument_properties(scanner, sheet)
    assert found["ranges on the axis"] == "1 m to infinity on the array; 0.5 m to 35 m by time of flight"
    assert found["field of view"] == "±20° on both axes"
    assert found["rate"] == "18750 voxels/s"
    waist = "at 1.5 µm, waist of 4 mm (1/e²) at 1.9 m, full divergence 0.5 mrad"
    assert found["beam"] == f"15 mW {waist}"
    assert found["receiver"] == "base 200 mm, f = 100 mm, f/4; array sharp at every range"
    laser.power = 5e-6
    assert explaining._light(scanner) == "5 µW"
    receiver.array_tilt = "scheimpflug"
    assert explaining._array(scanner) == "array tilted by 30°, Scheimpflug's condition"
    receiver.array_tilt = 0.5
    assert explaining._array(scanner) == "array tilted by 30°, in focus at infinity"
    receiver.focus_distance = 6.0
    assert explaining._array(scanner) == "array tilted by 30°, in focus at 6 m"
    scanner.rangefinders, sheet.line = ("tof",), None
    found = explaining.instrument_properties(scanner, sheet)
    assert found["beam"] == f"pulses of 0.25 µJ and 2.355 ns {waist}"
    assert found["receiver"] == "f = 100 mm, f/4"


@pytest.mark.parametrize(("number", "words"), [(1234.56, "1230"), (0.0123456, "0.0123"), (math.nan, "–")])
def test_three_digits_are_told(number: float, words: str) -> None:
    assert explaining.rounded(number) == words


def test_a_voxel_is_told_with_its_truth() -> None:
    """Claim: each number in its unit under its name; none where it is not known."""
    record: Any = SimpleNamespace(
        row=1, column=2, theta=math.radians(3.0), phi=math.radians(-4.0), status=Status.VALID, method="parabola",
        pixel_signal=np.array([5.0, 600.0, 7.0]), threshold=80.0, peak_px=9.25, sigma_peak_px=0.125, truth_peak_px=9.5,
        range_m=10.25, sigma_range_m=0.0125, sigma_texture_m=0.0015, truth_range_m=10.5, residual_m=-0.25,
        residual_px=-0.375,
    )  # fmt: skip
    found = showing._numbers(record)
    assert found == {
        "voxel": "row 1, column 2", "direction": "Θ 3.0000°, φ -4.0000°",
        "status": f"VALID: {Status.VALID.sentence}", "brightest pixel": "600 electrons (threshold 80)",
        "peak": "9.2500 ± 0.1250 px, parabola", "true peak": "9.5000 px", "range": "10.25000 ± 0.01250 m",
        "σ by uneven spots": "1.500 mm", "true range": "10.50000 m", "error": "-250.000 mm, -0.3750 px",
    }  # fmt: skip
    names = {
        "peak_px": "peak", "truth_peak_px": "true peak", "range_m": "range", "sigma_texture_m": "σ by uneven spots",
        "truth_range_m": "true range", "residual_m": "error",
    }  # fmt: skip
    for key, name in names.items():
        unknown: Any = SimpleNamespace(**{**vars(record), key: math.nan})
        assert [word for word, text in showing._numbers(unknown).items() if text == "none"] == [name]


def test_a_run_that_follows_is_told_by_status(
    told: Callable[[Any], list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: targets, then poses where there are any, then scanner beside camera where there is one; patterns, the time
    of the last one, and how many have each status."""
    lines = told(tracking)
    for name in ("_target_rows", "_pose_rows", "_beside_rows"):
        monkeypatch.setattr(tracking, name, lambda _, name=name: name)
    statuses = [TrackStatus.MEASURED, TrackStatus.MEASURED, TrackStatus.OUT_OF_VIEW]
    records = [SimpleNamespace(time=1.0 + n, status=status) for n, status in enumerate(statuses)]
    track: Any = SimpleNamespace(records=records, targets=range(2))
    camera: Any = SimpleNamespace(method="camera")
    for poses, expected in (((), 1), ((SimpleNamespace(method="xyz"),), 2), ((camera,), 3)):
        lines.clear()
        tracking._print_closing(track, poses, [])
        assert lines[:-1] == ["_target_rows", "_pose_rows", "_beside_rows"][:expected]
    assert lines[-1]["patterns"] == "3 of 2 targets"
    assert lines[-1]["time"] == "3 s on the instrument"
    assert lines[-1]["measured"] == f"2 ({TrackStatus.MEASURED.sentence})"
    assert lines[-1]["out of view"] == f"1 ({TrackStatus.OUT_OF_VIEW.sentence})"


def test_tables_are_aligned_in_a_pipe(capsys: pytest.CaptureFixture[str]) -> None:
    """Claim: columns as wide as their widest cell, two blanks between; to the left where asked, else to the right; of
    numbered files the first and the last are named."""
    tables.print_rows([("a", "bb", "c"), ("xxx", "y", "zz")], left=(0,))
    tables.print_table({"u": "one", "long": "two"})
    assert capsys.readouterr().out == "a    bb   c\nxxx   y  zz\nu     one\nlong  two\n"
    files = ["a_001.png", "b.csv", "a_002.png", "a_003.png", "c_12.csv", "c_13.csv"]
    assert tables.named_files(files) == "a_001.png … a_003.png, b.csv, c_12.csv, c_13.csv"


@pytest.mark.parametrize(("licence", "quiet"), [("", False), ("CC0-1.0", False), ("", True)])
def test_a_data_set_without_a_licence_is_warned_of(
    licence: str, quiet: bool, told: Callable[[Any], list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: choices go on as they are; what was made is told unless it is to be quiet, and which licences lack:
    that of the set, and those of meshes."""
    asked: list[Any] = []
    lines = told(dataset)

    meshes = [SimpleNamespace(name=name, licence=own) for name, own in (("p", NOT_STATED), ("q", "MIT"))]
    made = SimpleNamespace(licences=meshes)

    def write(campaign: Path, folder: Path, choices: Any, **options: Any) -> Any:
        asked.append((campaign, folder, choices, options["overwrite"]))
        return made

    monkeypatch.setattr(dataset, "write_dataset", write)
    monkeypatch.setattr(dataset, "_closing", lambda made: made)
    options: Any = {
        "shares": (5.0, 3.0, 2.0),
        "apart": ("pose",),
        "layers": ("u",),
        "licence": licence,
        "name": "n",
    }
    dataset.make_dataset(Path("a"), Path("b"), **options, shard_bytes=7, overwrite=True, quiet=quiet)
    ((campaign, folder, choices, overwrite),) = asked
    assert (campaign, folder, overwrite) == (Path("a"), Path("b"), True)
    assert (choices.shares, choices.apart, choices.layers) == ((5.0, 3.0, 2.0), ("pose",), ("u",))
    assert (choices.licence, choices.name, choices.shard_bytes) == (licence, "n", 7)
    if quiet:
        assert not lines
        return
    assert lines[0].startswith("nothing says under which licence p may be passed on")
    assert lines[1:-1] == ([] if licence else ["the data set has no licence: name one with --licence"])
    assert lines[-1] is made


@pytest.mark.parametrize(
    ("layout", "kind", "work"),
    [("image", "RUN", "_run_raster"), ("shots", "SHOTS", "_run_shots"), ("visits", "TRACK", "run_tracking")],
)
def test_a_scan_is_run_by_its_layout(layout: str, kind: str, work: str) -> None:
    """Claim: an image, a table of shots or a track, each into a folder of its own kind."""
    scenario: Any = SimpleNamespace(scan=SimpleNamespace(layout=layout))
    folder, asked = running._kind_and_work(scenario)
    assert folder is getattr(contents, kind)
    assert asked.__name__ == work


def test_the_power_of_a_law_is_that_of_its_weakest_check() -> None:
    checks = [SimpleNamespace(detects_90=a, detects_99=b) for a, b in ((0.1, 0.5), (0.2, 0.3), (0.15, 0.4))]
    finding: Any = SimpleNamespace(checks=checks)
    assert comparison_page.power_of(finding) == (0.2, 0.5)
