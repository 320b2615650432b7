"""Results for other programs from the command line: with the run or afterwards, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from scanner_sim.cli import app
from scanner_sim.products.files.contents import FORMAT_FILES

pytestmark = pytest.mark.usefixtures("device")

for _module in ("laspy", "pye57", "rosbags"):
    pytest.importorskip(_module, reason="the extra formats is not installed")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, small_scenario: str) -> Path:
    """A run that has written every format beside its own files."""
    found = tmp_path_factory.mktemp("convert")
    (found / "small.yaml").write_text(small_scenario, encoding="utf-8")
    every = f"output.formats=[{', '.join(FORMAT_FILES)}]"
    status, said = command("run", found / "small.yaml", "-o", found / "run", "--set", every)
    assert status == 0, said
    return found


def command(*words: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(word) for word in words])
    return result.exit_code, result.output


def test_with_the_run_and_afterwards_are_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    words = [word for name in FORMAT_FILES for word in ("--to", name)]
    status, said = command("convert", folder / "run", *words, "-o", tmp_path / "out")
    assert status == 0, said
    names = {name for names in FORMAT_FILES.values() for name in names}
    assert {path.name for path in (tmp_path / "out").iterdir()} == names
    for name in names:
        assert (tmp_path / "out" / name).read_bytes() == (folder / "run" / name).read_bytes(), name


def test_a_run_without_formats_has_the_same_other_files(folder: Path, tmp_path: Path) -> None:
    """Only what tells the scenario differs: the cloud has the same bytes, and a new run takes the old formats away."""
    status, said = command("run", folder / "small.yaml", "-o", tmp_path / "run")
    assert status == 0, said
    assert (tmp_path / "run" / "points.ply").read_bytes() == (folder / "run" / "points.ply").read_bytes()
    assert command("convert", tmp_path / "run" / "range.exr", "--to", "las", "-q") == (0, "")
    assert (tmp_path / "run" / "points.las").exists()
    assert command("run", folder / "small.yaml", "-o", tmp_path / "run", "--overwrite", "-q")[0] == 0
    assert not (tmp_path / "run" / "points.las").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("{run}", "--to", "lass"), "'lass' is no format."),
        (("{run}", "--to", "lass"), "Did you mean 'las'?"),
        (("{run}",), "--to"),
        (("{run}/nowhere", "--to", "las"), "There is no folder"),
        (("{run}/summary.json", "--to", "las"), "is no folder"),
        (("{run}/..", "--to", "las"), "holds no result with points"),
        (("{run}", "--to", "las"), "exists already"),
        (("{run}", "--to", "las", "-o", "{run}/summary.json"), "Choose another folder"),
        (("{run}", "--to", "las", "--by", "fused", "-o", "{run}/new"), "no layer 'fused.P.X'"),
        (("{run}", "--to", "las", "--by", "lidar", "-o", "{run}/new"), "'lidar' is no rangefinder"),
    ],
)
def test_what_cannot_be_converted_is_told_once(folder: Path, words: tuple[str, ...], said: str) -> None:
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}
    status, output = command("convert", *(word.format(run=folder / "run") for word in words))
    assert status == 2, output
    assert said in " ".join(output.split())
    assert "Traceback" not in output
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()} == before


def test_an_unknown_format_of_a_scenario_is_a_fault_at_its_key(folder: Path, tmp_path: Path) -> None:
    status, output = command(
        "run", folder / "small.yaml", "-o", tmp_path / "x", "--set", "output.formats=[las, e58]"
    )
    assert status == 2
    assert "output.formats[1]" in output
    assert "Did you mean 'e57'?" in output
    assert not (tmp_path / "x").exists()


def test_a_missing_library_is_told_before_the_work(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda *_: None)
    status, output = command(
        "run", folder / "small.yaml", "-o", tmp_path / "x", "--set", "output.formats=[e57]"
    )
    assert status == 2
    assert "pip install 'scanner-sim[e57]'" in output
    assert not (tmp_path / "x").exists()
