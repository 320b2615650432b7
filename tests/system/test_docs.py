"""The documents keep their promises: every example in them runs, the reference is complete, and the site builds."""

from __future__ import annotations

import importlib
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import pytest
import yaml
from typer.testing import CliRunner

from scanner_sim.cli import app
from scanner_sim.config import load_scanner, load_scenario, scenario_from_text
from scanner_sim.config.preset import read_preset, shipped_presets
from scanner_sim.foundation.channels import CHANNELS
from scanner_sim.foundation.parameters import NAMES
from scanner_sim.products.files import contents
from scanner_sim.signals.processing import PEAKS
from scanner_sim.signals.waveform.settings import PULSES
from scanner_sim.validation.studies.pose_study import StudyPlan

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = sorted(path for path in DOCS.rglob("*.md") if "```" in path.read_text(encoding="utf-8"))
FOLDERS = ("tests", "benchmarks", "docs", "scenes", "configs")
"""Beside the package what holds programs."""
SMALL = {
    "run": [
        *("--set", "scan.rows=16", "--set", "scan.columns=16", "--set", "scan.motion=stepped"),
        *(
            "--set",
            "transport.background_samples=2",
            "--set",
            "camera.interior={columns: 48, rows: 36, pixel_pitch: 130 um}",
            "--overwrite",
        ),
    ],
    "orbit": ["--steps", "2", "--overwrite"],
    "budget": ["--distances", "2", "--overwrite"],
    "compare": ["--only", "points", "--only", "sigma_read", "--overwrite"],
    "difference": ["--overwrite"],
    "pose-study": ["--overwrite"],
    "calibrate": ["--overwrite"],
    "approach": ["--dry-run"],
}
"""What makes each verb quick: it comes last, so that it holds where the example asks for more, and changes no word of
the example."""
SHOTS = {
    "track": ["--set", "scan.duration=0.4 s", "--overwrite"],
    "spiral": ["--overwrite"],
    "listed": ["--overwrite"],
}
"""The same for runs of scans that are no rasters."""
FRAMES = {
    "camera_dots.yaml": {
        "pixel_pitch: 10 um, columns: 640, rows: 480": "pixel_pitch: 20 um, columns: 320, rows: 240"
    },
    "camera_and_scanner.yaml": {
        "\ncamera:\n": "\ncamera:\n  interior: {pixel_pitch: 20 um, columns: 320, rows: 240}\n"
    },
}
"""What makes frames of shipped scenarios small."""
BASE = """\
schema: 1
scene: {objects: [{name: wall, shape: sphere, diameter: 1 m, position: [0 m, 0 m, 9 m], material: nickel}]}
scan: {type: raster, rows: 4, columns: 4, horizontal: [-1 deg, 1 deg], vertical: [-1 deg, 1 deg]}
"""


class Example(NamedTuple):
    """A fenced block of a page."""

    language: str
    title: str
    text: str


def examples(page: Path) -> list[Example]:
    blocks = re.findall(
        r"^```(\w+)(?: title=\"([^\"]+)\")?\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S
    )
    return [Example(*block) for block in blocks]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, repo_root: Path) -> Iterator[Path]:
    """A folder that looks like the repository's root, in which examples may leave files."""
    # Budgets and studies take fewer places and poses than can be asked for.
    monkeypatch.setattr(importlib.import_module("scanner_sim.validation.studies.budget"), "PIXEL_PHASES", 2)
    plan = StudyPlan.__init__
    monkeypatch.setattr(
        StudyPlan,
        "__init__",
        lambda self, distances, arrays, *_: plan(self, distances, arrays, poses=40, positions=1, patterns=1),
    )
    (tmp_path / "scenes").symlink_to(repo_root / "scenes")
    (tmp_path / "configs").mkdir()
    for path in (repo_root / "configs").iterdir():
        (tmp_path / "configs" / path.name).symlink_to(path)
    smaller_acceptance(tmp_path / "configs" / "acceptance")
    smaller_frames(tmp_path / "configs")
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    # What an example registers is no estimator of the next test's.
    PEAKS.clear()
    PULSES.clear()


@pytest.mark.slow
@pytest.mark.usefixtures("device")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).with_suffix("").as_posix())
def test_every_example_runs(page: Path, folder: Path) -> None:
    """In the order of the page: what one example writes the next may read."""
    names: dict[str, Any] = {}
    for example in examples(page):
        if example.language == "yaml":
            check_yaml(example, folder)
        elif example.language == "python":
            if example.title:
                (folder / example.title).write_text(example.text, encoding="utf-8")
            exec(compile(example.text.replace("spp=256", "spp=64"), str(page), "exec"), names)
        elif example.language == "sh":
            for line in example.text.splitlines():
                run_line(line)
        else:
            assert example.language == "text", f"```{example.language} is no kind of example"


def smaller_acceptance(folder: Path) -> None:
    """Put plans of acceptance tests in place of the shipped ones that measure each artefact once, in fewer voxels."""
    shipped = folder.resolve()
    folder.unlink()
    folder.mkdir()
    for path in shipped.iterdir():
        text = path.read_text(encoding="utf-8").replace("repetitions: 3", "repetitions: 1")
        (folder / path.name).write_text(text.replace("across: 40", "across: 20"), encoding="utf-8")


def smaller_frames(folder: Path) -> None:
    """Put scenarios in the places of shipped ones whose camera has a quarter of the pixels, of the same field, and
    follows less light to edges."""
    for name, changes in FRAMES.items():
        text = (folder / name).read_text(encoding="utf-8")
        for old, new in (*changes.items(), ("edge_samples: 256", "edge_samples: 16")):
            assert old in text
            text = text.replace(old, new)
        (folder / name).unlink()
        (folder / name).write_text(text, encoding="utf-8")


def check_yaml(example: Example, folder: Path) -> None:
    """A whole file is loaded, and kept where it has a name; a part of a scenario is put into a small one."""
    if example.title:
        (folder / example.title).write_text(example.text, encoding="utf-8")
        if example.title.endswith("_scanner.yaml"):
            load_scanner(example.title)
        else:
            load_scenario(example.title)
        return
    whole = yaml.safe_load(BASE) | yaml.safe_load(example.text)
    scenario_from_text(yaml.safe_dump(whole, allow_unicode=True), name=str(folder / "example.yaml"))


def run_line(line: str) -> None:
    """Run one command; results are made small, and pictures once of each kind of run on a page."""
    program, verb, *arguments = shlex.split(line, comments=True)
    assert program == "scanner-sim", line
    small = SMALL.get(verb, [])
    if verb == "run":
        text = Path(arguments[0]).read_text(encoding="utf-8")
        scan = re.search(r"type: (track|spiral|listed)", text)
        small = SHOTS.get(scan[1] if scan else "", small)
        # The pictures of a page's first run of a kind stand for those of the others.
        drawn = Path(f".drawn_{scan[1] if scan else 'raster'}{'_lit' * ('lighting:' in text)}")
        if drawn.exists():
            small = [*small, "--set", "output.pictures=false"]
        drawn.touch()
    if verb == "show" and "--voxel" in arguments:
        small = ["--voxel", "3", "3"]
    if verb == "campaign" and arguments[0].startswith("configs"):
        arguments[0] = str(small_plan(Path(arguments[0])))
    result = CliRunner().invoke(app, [verb, *arguments, *small])
    assert result.exit_code == 0, f"{line}\n{result.output}"


def small_plan(path: Path) -> Path:
    """Write a plan with two points where it has more, or six for three splits, and with little of the Sun's light."""
    text = path.read_text(encoding="utf-8")
    text = re.sub(
        r"^  output\.pictures: false$", r"\g<0>\n  transport.background_samples: 2", text, flags=re.M
    )
    # Of five directions in which a sensor looks, two.
    text = re.sub(r"^ *- \{forward: (?:port|zenith|nadir), .*\n", "", text, flags=re.M)
    text = re.sub(r"count: \d+", "count: 6" if "keep:" in text else "count: 2", text)
    small = Path(f"small_{path.name}").absolute()
    small.write_text(text.replace("base: ../", f"base: {path.parents[1].resolve()}/"), encoding="utf-8")
    return small


@pytest.mark.parametrize(("maker", "page"), [("speckle", "light"), ("budgets", "budget")])
def test_tables_are_made_by_the_closed_forms(
    maker: str, page: str, repo_root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: the numbers of these tables on the pages of the theory are those of the judge's closed forms."""
    monkeypatch.syspath_prepend(str(repo_root / "docs"))
    made = importlib.import_module(maker).tables()
    text = (repo_root / "docs" / "theory" / f"{page}.md").read_text(encoding="utf-8")
    assert made in text, f"run: python docs/{maker}.py"


def test_each_room_says_what_it_leaves_out() -> None:
    """Claim: every page of the theory but its index and the judge's tells what is not modelled."""
    rooms = {path.stem: path.read_text(encoding="utf-8") for path in (DOCS / "theory").glob("*.md")}
    assert not {room for room, text in rooms.items() if "Not modelled:" not in text} - {"index", "judge"}


@pytest.fixture
def reference(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(DOCS))
    return importlib.import_module("reference_pages")


def test_the_reference_has_every_key(reference: ModuleType) -> None:
    """Claim: each key of each part of a scenario stands on the page of keys, under its part."""
    page = reference.scenario_page()
    sections = dict(re.findall(r"^## (\w+) \{#\w+\}\n(.*?)(?=^## |\Z)", page, re.M | re.S))
    missing = {
        f"{slot.part.__name__}.{key}"
        for slot in importlib.import_module("scanner_sim.config.outline").outline().values()
        if slot.part is not None
        for key in slot.keys
        if f"| `{key}` |" not in sections.get(slot.part.__name__, "")
    }
    assert not missing
    described = re.findall(r"^\| `(\w+)` \| [^\n]*\|\s*\|$", page, re.M)
    assert not described, f"without a meaning: {described}"


def test_the_reference_has_every_value_of_an_instrument_with_its_source(reference: ModuleType) -> None:
    sections = dict(re.findall(r"^## (\w+)\n(.*?)(?=^## |\Z)", reference.instruments_page(), re.M | re.S))
    for name in shipped_presets():
        for location, stated in read_preset(name).stated.items():
            (row,) = re.findall(rf"^\| `{re.escape('.'.join(location[1:]))}` \| .*$", sections[name], re.M)
            assert row.endswith(f"| {stated.mark} | {stated.source} |")


def test_the_page_on_mirrors_has_the_values_of_the_instrument() -> None:
    """Claim: the table of the mirrors' errors, written by hand, says what the file of the instrument says."""
    mirrors = read_preset("nrc_2000").values["mirrors"]
    rows = re.findall(
        r"^\| (`\w+`(?:, `\w+`)*) \| (\d[^|]*) \|",
        (DOCS / "theory/optics.md").read_text(encoding="utf-8"),
        re.M,
    )
    said = {
        key.strip("`"): value.replace("µ", "u")
        for keys, values in rows
        for key, value in zip(keys.split(", "), values.split(", "), strict=True)
    }
    assert len(said) == 8
    assert said == {
        key: f"{value:g}" if isinstance(value, float) else value
        for key, value in mirrors.items()
        if key in said
    }


def test_the_reference_has_every_channel_file_and_verb(reference: ModuleType) -> None:
    files, commands = reference.files_page(), reference.command_page()
    assert not {channel.name for channel in CHANNELS if f"| `{channel.name}` |" not in files}
    assert not {name for name in NAMES if f"| `J.{name}.…` |" not in files}
    for name, known in reference.FOLDERS.values():
        assert set(getattr(contents, name).files) == set(known), name
    verbs = {
        command.name or command.callback.__name__.replace("_", "-")
        for command in app.registered_commands
        if command.callback
    }
    assert not {verb for verb in verbs if f"## scanner-sim {verb} " not in commands}


def test_links_of_the_pages_lead_somewhere_in_the_repository(repo_root: Path) -> None:
    """Claim: who reads a page without the site finds what it points to."""
    astray = []
    for page in (repo_root / "docs").rglob("*.md"):
        for link in re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8")):
            if "://" not in link and not (page.parent / link).exists():
                astray.append(f"{page.name}: {link}")
    assert not astray


def test_files_that_the_pages_name_are_there(repo_root: Path) -> None:
    """Claim: a path leads from the repository, the package, the tests or the documents; a name alone is some file's,
    or that of an example on the page."""
    homes = [repo_root / name for name in ("", "scanner_sim", "tests", "docs")]
    names = {path.name for room in ("scanner_sim", *FOLDERS) for path in (repo_root / room).rglob("*.py")}
    lost, named = [], 0
    for page in [*DOCS.rglob("*.md"), *repo_root.glob("*.md")]:
        text = page.read_text(encoding="utf-8")
        for name in re.findall(r"`(?:python )?([\w./-]+\.py)\b", text):
            named += 1
            known = name in names or f'title="{name}"' in text
            if not (any((home / name).exists() for home in homes) if "/" in name else known):
                lost.append(f"{page.name}: {name}")
    assert named > 100
    assert lost == []


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path: Path, repo_root: Path) -> None:
    """Claim: every link, anchor and picture leads somewhere, and every docstring of the reference can be read."""
    pytest.importorskip("mkdocs", reason="the extra docs is not installed")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=repo_root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site" / "reference" / "scenario.html").is_file()
