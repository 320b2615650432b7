"""The verb ``approach``: its folder, the same bytes however it is made, and σ that holds on the way."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from claims import mean_square
from PIL import Image
from typer.testing import CliRunner

from scanner_sim.campaign.approach.results import errors_of
from scanner_sim.cli import app
from scanner_sim.products.files.tables import read_parquet

SMALL = """\
schema: 1
base: {base}
seed: {seed}
object: vehicle
trajectory: {{type: clohessy_wiltshire, position: [-9 m, 0 m, 0 m], velocity: [8 mm/s, 0 m/s, 0 m/s]}}
epochs: {{count: {epochs}, end: 300 s}}
arrays: [{{array: far}}]
offset: [1 mrad, -1 mrad, 20 mm]
methods: [{methods}]
tries: {tries}
duration: 0.16 s
"""
FILES = {
    "approach.html",
    "approach.json",
    "epochs.csv",
    "approach.csv",
    "conditions.csv",
    "tries.parquet",
    "approach.png",
    "conditions.png",
}

pytestmark = pytest.mark.usefixtures("device")


def write(root: Path, folder: Path, epochs: int = 1, methods: str = "uv, joint", tries: int = 2) -> Path:
    base = root / "configs" / "approach" / "vehicle.yaml"
    text = SMALL.format(base=base, seed=4, epochs=epochs, methods=methods, tries=tries)
    path = folder / "small.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def invoke(*arguments: object) -> Any:
    return CliRunner().invoke(app, ["approach", *map(str, arguments)])


def contents(folder: Path) -> dict[str, str]:
    """Return a digest of each file: pytest takes minutes to show how megabytes differ."""
    return {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in sorted(FILES)}


@pytest.fixture(scope="module")
def alone(repo_root: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A plan, and the folder that one process made of it: no test changes either."""
    folder = tmp_path_factory.mktemp("alone")
    path = write(repo_root, folder)
    result = invoke(path, "-o", folder / "out", "--device", "cpu")
    assert result.exit_code == 0, result.output
    assert "back illumination" in result.output
    return path, folder / "out"


@pytest.mark.slow
def test_an_approach_writes_its_folder_and_a_killed_one_goes_on(
    alone: tuple[Path, Path], tmp_path: Path
) -> None:
    """Claim: tries, tables and picture are there, and the same bytes where half of the rows had to be made again.

    Set-up: what a program that is killed leaves is a file of rows that ends in the middle of a line, and no part.
    """
    path, made = alone
    shutil.copytree(made, tmp_path / "out")
    whole = contents(tmp_path / "out")
    told = json.loads((made / "approach.json").read_text(encoding="utf-8"))
    assert [row["condition_name"] for row in told["epochs"]] == ["full target shadow"]
    tries, _ = read_parquet(tmp_path / "out" / "tries.parquet")
    assert len(tries["try"]) == 2 * 2
    error, sigma = errors_of(tries, np.ones(4, dtype=np.bool_))
    assert len(error) == 4
    assert np.abs(error[:, :3]).max() < 5e-3
    assert (np.abs(error) < 6.0 * sigma).all()
    with Image.open(tmp_path / "out" / "approach.png") as picture:
        assert picture.width > 1000

    (part,) = (tmp_path / "out" / "parts").iterdir()
    rows, _ = read_parquet(part)
    part.unlink()
    names = [name for name in rows if name.startswith(("uv_", "joint_"))]
    line = {key: rows[key][0].item() for key in ("run", "seed", "seconds")}
    line |= {"fault": "", "measures": {name: float(rows[name][0]) for name in names}}
    (tmp_path / "out" / "rows.jsonl").write_text(json.dumps(line) + '\n{"run": 1, "see', encoding="utf-8")
    again = invoke(path, "-o", tmp_path / "out", "--device", "cpu", "-q")
    assert again.exit_code == 0, again.output
    assert contents(tmp_path / "out") == whole


def test_an_approach_is_checked_and_listed_without_a_try(repo_root: Path, tmp_path: Path) -> None:
    path = write(repo_root, tmp_path, epochs=3)
    result = invoke(path, "-o", tmp_path / "out", "--dry-run")
    assert result.exit_code == 0
    assert "150.0 s" in result.output
    assert not (tmp_path / "out").exists()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").touch()
    refused = invoke(path, "-o", tmp_path / "out")
    assert refused.exit_code == 2
    assert "holds other files" in refused.output
    path.write_text(path.read_text(encoding="utf-8").replace("300 s", "3000 s"), encoding="utf-8")
    refused = invoke(path, "-o", tmp_path / "out")
    assert refused.exit_code == 2
    assert "at 1500 s" in refused.output


@pytest.mark.pinned
@pytest.mark.slow
def test_workers_give_the_same_bytes(alone: tuple[Path, Path], tmp_path: Path) -> None:
    path, made = alone
    result = invoke(path, "-o", tmp_path / "2", "--device", "cpu", "--workers", 2, "-q")
    assert result.exit_code == 0, result.output
    assert contents(made) == contents(tmp_path / "2")


@pytest.mark.slow
def test_the_stated_sigma_holds_on_the_way(repo_root: Path, tmp_path: Path) -> None:
    """Claim: error over stated σ of a pose has a mean square of one, in each component.

    Set-up: 24 tries at one epoch by both methods; tries have seeds of their own, so they are independent. Expected: χ²
    of 24 degrees of freedom for each of twelve components, at a twelfth of the level each. Errors of twice their σ are
    found with 90 %: four times the variance.
    """
    path = write(repo_root, tmp_path, epochs=1, tries=24)
    result = invoke(path, "-o", tmp_path / "out", "--device", "cpu", "-q")
    assert result.exit_code == 0, result.output
    tries, _ = read_parquet(tmp_path / "out" / "tries.parquet")
    for method in ("uv", "joint"):
        error, sigma = errors_of(tries, tries["method"] == method)
        assert len(error) == 24
        for axis in range(6):
            claim = mean_square(error[:, axis] / sigma[:, axis], level=1e-3 / 12.0)
            assert claim, (method, axis)
            assert claim.finds < 3.0
