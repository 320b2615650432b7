"""The command line from outside: verbs, exit statuses, what is printed where, and how a run ends early."""

from __future__ import annotations

import errno
import importlib
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from typer.testing import CliRunner

from scanner_sim import load_scenario, simulate
from scanner_sim.cli import app
from scanner_sim.config import load_scanner, resolved_yaml
from scanner_sim.config.preset import shipped_presets
from scanner_sim.products.files.contents import FILES
from scanner_sim.products.files.exr import read_range_image

# Says when the first batch is about to be measured.
BEGUN = """
from scanner_sim.cli import main
from scanner_sim.instrument.instrument import Instrument
measure = Instrument.measure
def told(*arguments, **more):
    print("begun", flush=True)
    return measure(*arguments, **more)
Instrument.measure = told
main()
"""
# The package's own attribute of that name is the function.
FLOW = importlib.import_module("scanner_sim.instrument.simulate")
WRITTEN = {name for name in FILES if not name.endswith(".png")}

pytestmark = pytest.mark.usefixtures("device")


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small_scenario: str) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "small.yaml"
    path.write_text(small_scenario, encoding="utf-8")
    return path


def invoke(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def in_a_shell(*arguments: object, **options: Any) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "scanner_sim", *map(str, arguments)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8", **options
    )


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("verb", ["run", "check", "show", "info", "instruments", "schema"])
def test_every_verb_explains_itself(verb: str) -> None:
    result = invoke(verb, "--help")
    assert result.exit_code == 0
    assert "Usage" in result.stdout
    assert verb in invoke("--help").stdout


def test_the_version_is_printed() -> None:
    assert invoke("--version").stdout.startswith("scanner-sim ")


@pytest.mark.parametrize(
    "arguments",
    [["nix"], ["run"], ["run", "a.yaml", "--seed", "x"], ["run", "a.yaml", "--device", "tpu"],
     ["show", "a", "--voxel", "1"]],
)  # fmt: skip
def test_wrong_usage_is_bad_input(arguments: list[str]) -> None:
    assert invoke(*arguments).exit_code == 2


def test_run_writes_a_result_beside_its_name(config: Path, tmp_path: Path) -> None:
    result = invoke("run", config, "--device", "cpu", "--set", "scan.motion=stepped")
    assert result.exit_code == 0
    assert {path.name for path in (tmp_path / "output" / "small").iterdir()} == WRITTEN
    assert re.search(r"with a range +48 \(100 %\)", result.stdout)
    assert result.stderr == ""


def test_quiet_is_quiet(config: Path) -> None:
    result = invoke("run", config, "-q")
    assert (result.exit_code, result.output) == (0, "")


def test_the_resolved_scenario_gives_the_same_bytes(config: Path, tmp_path: Path) -> None:
    assert invoke("run", config, "-o", "a", "--seed", 5, "--set", "scan.rows=7").exit_code == 0
    assert invoke("run", "a/scenario.yaml", "-o", "deep/b").exit_code == 0
    assert content(tmp_path / "a") == content(tmp_path / "deep" / "b")
    image = read_range_image(tmp_path / "a" / "range.exr")
    assert (image.seed, image.shape) == (5, (7, 8))


def test_python_and_the_command_line_give_the_same_arrays(config: Path, tmp_path: Path) -> None:
    assert invoke("run", config, "-o", "a").exit_code == 0
    written = read_range_image(tmp_path / "a" / "range.exr")
    image = simulate(load_scenario(config))
    assert {name: layer.tobytes() for name, layer in image.channels.items()} == {
        name: layer.tobytes() for name, layer in written.channels.items()
    }


def test_an_existing_result_stays_unless_it_may_be_replaced(config: Path, tmp_path: Path) -> None:
    assert invoke("run", config, "-o", "a").exit_code == 0
    (tmp_path / "a" / "notes.txt").write_text("mine")
    before = content(tmp_path / "a")
    result = invoke("run", config, "-o", "a", "--seed", 9)
    assert result.exit_code == 2
    assert "already holds a result" in result.stderr
    assert "--overwrite" in result.stderr
    assert content(tmp_path / "a") == before
    assert invoke("run", config, "-o", "a", "--seed", 9, "--overwrite").exit_code == 0
    after = content(tmp_path / "a")
    assert after["range.exr"] != before["range.exr"]
    assert after["notes.txt"] == b"mine"


def test_a_dry_run_tells_and_does_nothing(config: Path, tmp_path: Path) -> None:
    result = invoke("run", config, "--dry-run")
    assert result.exit_code == 0
    for words in ("6 rows × 8 columns = 48", "1.563 m to infinity", "memory", "range.exr", "small"):
        assert words in result.stdout
    assert list(tmp_path.iterdir()) == [config]


def test_check_prints_the_resolved_scenario(config: Path) -> None:
    sets = ["scan.rows=9", "scan.motion=stepped"]
    result = invoke("check", config, *[word for one in sets for word in ("--set", one)])
    assert result.exit_code == 0
    assert result.stdout == resolved_yaml(load_scenario(config, sets))
    assert result.stderr == ""


def test_check_warns_of_what_makes_little_sense(config: Path) -> None:
    result = invoke("check", config, "--set", "processing.threshold=0")
    assert result.exit_code == 0
    assert "warning: processing.threshold" in result.stderr


def test_schema_prints_json() -> None:
    assert json.loads(invoke("schema").stdout)["title"] == "Scanner Sim scenario"


def test_instruments_lists_prints_and_checks_them(tmp_path: Path) -> None:
    """Claim: what it prints of a shipped one is, saved, an instrument of one's own with the same values."""
    told = invoke("instruments").stdout
    assert re.search(r"nrc_2000 +Prototype of F. Blais", told)
    assert re.search(r"pulsed_scanner +1.5 m to 500 m by time of flight +±50° +100000 /s", told)
    text = invoke("instruments", "nrc_2000", "--yaml").stdout
    own = tmp_path / "mine.yaml"
    own.write_text(text, encoding="utf-8")
    assert invoke("instruments", str(own), "--yaml").stdout == text
    assert load_scanner(str(own)).model_copy(update={"preset": "nrc_2000"}) == load_scanner("nrc_2000")
    own.write_text(text.replace("value: 15 mW", "value: 15"), encoding="utf-8")
    refused = invoke("instruments", str(own))
    assert refused.exit_code == 2
    assert "scanner.laser.power: 15 has no unit" in refused.stderr


@pytest.mark.slow
def test_an_instrument_is_explained_drawn_and_told_from_another(tmp_path: Path) -> None:
    """Claim: the table has ranges and errors, the values their sources, and only what differs is told as different."""
    picture, own = tmp_path / "head.png", tmp_path / "mine.yaml"
    told = invoke("instruments", "nrc_2000", "--picture", str(picture)).stdout
    assert "1.563 m to infinity on the array; 0.5 m to 35 m by time of flight" in told
    assert "σ triangulation [mm]" in told
    assert re.search(r"laser.power +15 mW +printed +the paper, below eq 19", told)
    with Image.open(picture) as drawn:
        assert drawn.size > (600, 600)
    assert "exists already" in invoke("instruments", "nrc_2000", "--picture", str(picture)).stderr
    own.write_text(
        "schema: 1\nextends: nrc_2000\nabout: a shorter base\n"
        "scanner: {receiver: {baseline: {value: 150 mm, mark: assumed, source: my drawing}}}\n",
        encoding="utf-8",
    )
    lines = invoke("instruments", "nrc_2000", "--diff", str(own)).stdout.splitlines()
    assert [line.split()[0] for line in lines[1:]] == ["ranges", "receiver", "receiver.baseline"]
    assert re.search(r"0.2 m \(assumed\) +0.15 m \(assumed\)", lines[-1])
    assert "have the same values" in invoke("instruments", str(own), "--diff", str(own)).stdout
    assert "no instrument is named" in invoke("instruments", "--yaml").stderr


@pytest.mark.parametrize(
    "name",
    [
        name if name == "pulsed_scanner" else pytest.param(name, marks=pytest.mark.slow)
        for name in shipped_presets()
    ],
)
def test_every_shipped_instrument_is_explained_and_drawn(name: str, tmp_path: Path) -> None:
    """Claim: the columns are those of what it has; no cell of a way of ranging is empty at all ranges."""
    told = invoke("instruments", name, "--picture", str(tmp_path / "head.png")).stdout
    scanner = load_scanner(name)
    assert ("[mm]  pixel [mm]" in told) is ("triangulation" in scanner.seeing)
    assert ("σ time of flight [mm]" in told) is ("tof" in scanner.seeing)
    rows = [line.split() for line in told.split("range [m]")[1].split("\n\n")[0].splitlines()[1:]]
    assert len(rows) == 8
    assert all(any(cell != "–" for cell in column) for column in zip(*rows, strict=True))
    with Image.open(tmp_path / "head.png") as drawn:
        assert drawn.size > (600, 600)


def test_info_names_what_it_runs_on() -> None:
    result = invoke("info")
    assert result.exit_code == 0
    for word in ("scanner-sim", "mitsuba", "LLVM", "GPU", "threads", "Python"):
        assert word in result.stdout


def test_show_draws_a_result_and_explains_a_voxel(config: Path, tmp_path: Path) -> None:
    assert invoke("run", config, "-o", "a").exit_code == 0
    assert invoke("show", "a").exit_code == 0
    assert {path.name for path in (tmp_path / "a").iterdir()} == set(FILES)
    result = invoke("show", "a/range.exr", "--voxel", 2, 3, "-o", "pictures")
    assert result.exit_code == 0
    assert (tmp_path / "pictures" / "voxel_2_3.png").stat().st_size > 5000
    image = read_range_image(tmp_path / "a" / "range.exr")
    assert f"{image['range_m'][2, 3]:.5f} ±" in result.stdout
    assert f"{image['peak_px'][2, 3]:.4f} ±" in result.stdout


@pytest.mark.slow
def test_show_replaces_no_picture_elsewhere_unless_told(config: Path, tmp_path: Path) -> None:
    assert invoke("run", config, "-o", "a").exit_code == 0
    picture = tmp_path / "mine" / "shaded.png"
    picture.parent.mkdir()
    picture.write_bytes(b"mine")
    result = invoke("show", "a", "-o", "mine")
    assert result.exit_code == 2
    assert "shaded.png exists already" in result.stderr
    assert content(picture.parent) == {"shaded.png": b"mine"}
    assert invoke("show", "a", "-o", "mine", "--overwrite").exit_code == 0
    assert picture.read_bytes() != b"mine"
    assert invoke("show", "a").exit_code == 0
    assert invoke("show", "a").exit_code == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["show", "nowhere"], "There is no result"),
        (["show", "small.yaml"], "small.yaml"),
        (["show", "a", "--voxel", "6", "0"], "outside of the 6 × 8 raster"),
        (["show", "a", "--voxel", "0", "-1"], "outside of the 6 × 8 raster"),
        (["show", "a", "-o", "small.yaml/x"], "small.yaml"),
    ],
)
def test_show_refuses_what_it_cannot_show(config: Path, arguments: list[str], words: str) -> None:
    assert invoke("run", config, "-o", "a").exit_code == 0
    result = invoke(*arguments)
    assert result.exit_code in (1, 2)
    assert words in result.stderr
    assert "Traceback" not in result.output


def test_a_full_disk_leaves_nothing_half_written(
    config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert invoke("run", config, "-o", "a").exit_code == 0
    before = content(tmp_path / "a")

    def fail(path: Path, image: object) -> None:
        path.write_bytes(b"half")
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr("scanner_sim.products.files.run_folder.write_ply", fail)
    for folder in ("a", "new"):
        result = invoke("run", config, "-o", folder, "--overwrite")
        assert result.exit_code == 1
        assert "is full" in result.stderr
        assert "Make room" in result.stderr
    assert content(tmp_path / "a") == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "small.yaml"]


@pytest.mark.parametrize(
    ("folder", "words"), [("small.yaml", "is not a folder"), ("small.yaml/deep", "small.yaml"), ("/proc/x", "/proc/x")]
)  # fmt: skip
def test_an_unwritable_folder_is_refused_before_the_work(
    config: Path, folder: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if folder.startswith("/proc") and sys.platform != "linux":
        pytest.skip("only Linux has a folder that nobody may write to")
    monkeypatch.setattr(FLOW, "simulate", lambda *_, **__: pytest.fail("the work began"))
    result = invoke("run", config, "-o", folder)
    assert result.exit_code == 2
    assert words in result.stderr
    assert "Traceback" not in result.output


def test_an_image_larger_than_the_memory_is_refused(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scanner_sim.instrument.memory._free_memory", lambda: 1e9)
    result = invoke("run", config, "--set", "scan.rows=8192", "--set", "scan.columns=8192")
    assert result.exit_code == 2
    assert "GB are free" in result.stderr
    assert "Reduce scan.rows" in result.stderr


@pytest.mark.parametrize(
    ("raised", "status", "words"),
    [
        (KeyboardInterrupt(), 130, "stopped: interrupted; nothing is half-written."),
        (MemoryError(), 1, "memory is exhausted"),
        (RuntimeError("strange"), 1, "unexpected RuntimeError: strange\nThis is a fault of the program."),
    ],
)
def test_an_early_end_is_one_message(
    config: Path,
    tmp_path: Path,
    raised: BaseException,
    status: int,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise raised

    monkeypatch.setattr("scanner_sim.products.files.run_folder.write_ply", fail)
    result = invoke("run", config, "-o", "a")
    assert result.exit_code == status
    assert words in result.stderr
    assert "Traceback" not in result.output
    assert list(tmp_path.iterdir()) == [config]


def test_a_traceback_can_be_asked_for(config: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("strange")

    monkeypatch.setattr(FLOW, "simulate", fail)
    monkeypatch.setenv("SCANNER_SIM_DEBUG", "1")
    assert isinstance(invoke("run", config).exception, RuntimeError)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_a_run_cleanly(
    config: Path, tmp_path: Path, number: signal.Signals, status: int
) -> None:
    arguments = ["run", str(config), "--set", "scan.rows=8192", "--set", "scan.columns=1024", "-o", "a"]
    command = [sys.executable, "-c", BEGUN, *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == status, errors
    assert "Traceback" not in errors
    assert list(tmp_path.iterdir()) == [config]


@pytest.mark.slow
def test_a_reader_that_leaves_is_no_error() -> None:
    with in_a_shell("schema") as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode == 0


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="the system has no /dev/full")
def test_a_full_output_stream_is_one_message() -> None:
    with open("/dev/full", "w") as full:
        process = subprocess.run(
            [sys.executable, "-m", "scanner_sim", "schema"], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert process.returncode == 1
    assert process.stderr == "error: No space left on device.\nMake room on the disk.\n"


def test_help_loads_nothing_that_takes_long() -> None:
    """What makes ``scanner-sim --help`` quick, without a clock: none of the slow libraries is loaded for it."""
    code = (
        "import sys; from scanner_sim.cli import app; app(['--help'], standalone_mode=False); "
        "sys.exit(str({'numpy', 'pydantic', 'yaml', 'pint', 'mitsuba', 'drjit', 'matplotlib'} & sys.modules.keys()))"
    )
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert process.stderr.strip() == "set()"
