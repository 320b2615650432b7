"""What a table of shots may hold: finite times that ascend from 0, and deflections."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from scanner_sim.foundation.status import Status
from scanner_sim.products.files import shots_folder
from scanner_sim.products.settings import Output
from scanner_sim.products.shots import ShotTable

TIMES, ANGLES = np.array([0.0, 1e-3, 5e-3]), np.array([-2.0, 0.0, 2.0])


def table(**changed: Any) -> ShotTable:
    layers = {
        "status": np.full(3, Status.VALID, np.float32),
        **{name: np.ones(3, np.float32) for name in ("range_m", "P.X", "P.Y", "P.Z")},
    }
    return ShotTable(**{"channels": layers, "time": TIMES, "theta": ANGLES, "phi": -ANGLES} | changed)


def test_a_table_at_its_limits_is_taken_and_closed() -> None:
    made = table()
    assert (len(made), made.shape) == (3, (3,))
    for values in (made.time, made.theta, made.phi):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0
    assert replace(made, seed=4).seed == 4


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        *((name, bad, f"^{name} must be 3 finite float64 numbers$") for name in ("theta", "phi") for bad in (
            np.zeros(2), np.zeros(4), np.zeros((3, 1)), np.zeros(3, np.float32), np.array([0.0, np.nan, 0.0]),
            np.array([0.0, np.inf, 0.0]),
        )),
        *(("time", bad, "^time must be 3 finite float64 numbers$") for bad in (
            np.array([0.0, 1.0, np.inf]), np.arange(3), np.array([0.0, np.nan, 1.0]), TIMES[:, None],
        )),
        *(("time", bad, "^time must ascend from 0") for bad in (
            np.array([0.0, 1e-3, 1e-3]), np.array([0.0, 1e-3, 0.9e-3]), np.array([-1e-9, 1e-3, 5e-3]),
        )),
        *((name, bad, "^theta and phi must be deflections$") for name in ("theta", "phi") for bad in (
            ANGLES * 1.0001, np.array([0.0, 0.0, -2.0001]),
        )),
    ],
)  # fmt: skip
def test_tables_that_contradict_themselves_are_refused(name: str, values: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        table(**{name: values})


def test_a_table_says_what_its_codes_and_columns_are() -> None:
    """Claim: each code has its name and sentence; each column's unit is the one that its name ends in."""
    said: Any = shots_folder.about_shots(table(seed=12))
    assert said["status"] == {str(int(code)): f"{code.name}: {code.sentence}" for code in Status}
    assert said["seed"] == 12
    units = {name: about["unit"] for name, about in said["columns"].items()}
    angles_and_times = {"time_s": "s", "theta_rad": "rad", "phi_rad": "rad"}
    points = dict.fromkeys(("range_m", "P.X", "P.Y", "P.Z"), "m")
    assert units == {"shot": "1", "status": "1"} | angles_and_times | points
    assert all(len(about["meaning"]) > 10 for about in said["columns"].values())


def test_a_table_has_a_shot() -> None:
    none = np.zeros(0)
    with pytest.raises(ValueError, match="there must be a shot"):
        table(time=none, theta=none, phi=none)


@pytest.mark.parametrize("lit", [True, False])
def test_the_folder_of_shots_has_what_is_planned(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, lit: bool
) -> None:
    """Claim: what the camera sees is written where it sees something, as it is; other files by their own writers."""
    asked: list[Any] = []
    monkeypatch.setattr(
        shots_folder, "write_folder", lambda *given, **how: asked.append((given, how)) or ("paths",)
    )
    photo = np.arange(12, dtype=np.uint8).reshape(3, 4)
    made = table(scenario_yaml="the scenario")
    paths = shots_folder.write_shots(made, tmp_path, Output(), camera=photo if lit else None, overwrite=True)
    (((folder, _, writers), how),) = asked
    assert (paths, folder, how) == (("paths",), tmp_path, {"overwrite": True})
    assert list(writers) == list(shots_folder.planned_shot_files(Output(), lit=lit, calibrated=False))
    assert ("camera.png" in writers) is lit
    for name in ("scenario.yaml", "summary.json", *(["camera.png"] if lit else [])):
        writers[name](tmp_path / name)
    assert (tmp_path / "scenario.yaml").read_text() == "the scenario"
    assert '"shots": 3' in (tmp_path / "summary.json").read_text()
    if lit:
        np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "camera.png")), photo)


@pytest.mark.parametrize("still", [False, True])
def test_files_that_need_a_layer_are_left_out_without_it(still: bool, tmp_path: Path) -> None:
    """Claim: as of an image: points without coordinates, and the ranges as dots without ranges, or over time, in one
    direction, without their σ or the truth; the table itself is written and comes back."""
    made = table(**({"theta": 0.0 * ANGLES, "phi": 0.0 * ANGLES} if still else {}))
    wide = dict(made.channels) | dict.fromkeys(("sigma_range_m", "truth.range_m"), made["range_m"])
    whole = replace(made, channels=wide)
    points, over_time = ("P.X", "P.Y", "P.Z"), ("range_m", "sigma_range_m", "truth.range_m")
    for number, (kept, left_out) in enumerate((
        ((*points, *over_time), set()), (points, {"range.png"}), (over_time, {"points.ply"}),
        (points[1:], {"range.png", "points.ply"}), (over_time[:2], {"points.ply", *(["range.png"] if still else [])}),
    )):  # fmt: skip
        folder = tmp_path / str(number)
        paths = shots_folder.write_shots(whole.keeping(kept), folder)
        planned = set(shots_folder.planned_shot_files(Output()))
        assert {path.name for path in paths} == planned - left_out
        assert set(shots_folder.read_shots(folder).channels) == {*kept, "status"}


@pytest.mark.parametrize("lit", [True, False])
def test_pictures_of_shots_are_planned_where_they_are_asked_for(lit: bool) -> None:
    """Claim: without pictures none is written, the camera's either; without points no file of them, and all else."""
    every = shots_folder.planned_shot_files(Output(), lit=lit)
    bare = shots_folder.planned_shot_files(Output(pictures=False), lit=lit)
    assert set(every) - set(bare) == {"range.png", "status.png", *(["camera.png"] if lit else [])}
    assert not any(name.endswith(".png") for name in bare)
    flat = shots_folder.planned_shot_files(Output(points=False), lit=lit)
    assert set(every) - set(flat) == {"points.ply"}


def test_shots_come_back_as_they_were_written(tmp_path: Path) -> None:
    """Claim: each column by its own name; Θ and φ of this table differ in sign."""
    made = table(seed=9, scenario_yaml="the scenario", made_by={"scanner-sim": "1.0"}, warnings=("one",))
    shots_folder.write_shots(made, tmp_path / "out", Output(pictures=False))
    found = shots_folder.read_shots(tmp_path / "out")
    for name in ("time", "theta", "phi"):
        np.testing.assert_array_equal(getattr(found, name), getattr(made, name))
    assert found.channels.keys() == made.channels.keys()
    for name in made.channels:
        np.testing.assert_array_equal(found[name], made[name])
    assert (found.seed, found.scenario_yaml, found.warnings) == (9, "the scenario", ("one",))
