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
