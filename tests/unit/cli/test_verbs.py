"""What verbs of the command line ask of the program: each option arrives as itself, others have their defaults.

The functions that do the work are replaced by one that notes what it is given.
"""

from __future__ import annotations

import importlib
import inspect
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

import scanner_sim.cli
from scanner_sim.cli import app, campaigns, looking, options, studies
from scanner_sim.cli.call import Call
from scanner_sim.cli.options import beside

P = Path
AUTO = {"device": "auto", "overwrite": False, "quiet": False}
GIVEN = {"device": "cpu", "overwrite": True, "quiet": True}
ON_CPU = "--device cpu --overwrite --quiet"


def _call(output: str, config: str = "a.b/c.yaml") -> Call:
    return Call(P(config), P(output), [], "auto", overwrite=False, quiet=False)


FULL = "a.b/c.yaml -o there --set x=1 --set y=2 --seed 0 --peak m:f --pulse m:g --device cpu"
CALL = Call(P("a.b/c.yaml"), P("there"), ["m:f", "m:g", "x=1", "y=2", "seed=0"], "cpu", False, False)

CASES: list[tuple[str, str, dict[str, Any]]] = [
    ("run a.b/c.yaml", "running.run_scenario", {"call": _call("output/c"), "dry_run": False}),
    (f"run {FULL} --dry-run", "running.run_scenario", {"call": CALL, "dry_run": True}),
    ("run c.yaml --overwrite", "running.run_scenario", {
        "call": Call(P("c.yaml"), P("output/c"), [], "auto", overwrite=True, quiet=False), "dry_run": False}),
    ("run c.yaml -q", "running.run_scenario", {
        "call": Call(P("c.yaml"), P("output/c"), [], "auto", overwrite=False, quiet=True), "dry_run": False}),
    ("check c.yaml", "checking.check_scenario", {"config": P("c.yaml"), "overrides": []}),
    ("check c.yaml --set x=1 --seed 3 --peak m:f", "checking.check_scenario", {
        "config": P("c.yaml"), "overrides": ["m:f", "x=1", "seed=3"]}),
    ("scene a.b/c.yaml", "viewing_scene.show_scene", {"call": _call("output/c_scene.png")}),
    ("show d --voxel 3 5", "showing.show_voxel", {
        "result": P("d"), "voxel": (3, 5), "output": None, "device": "auto", "overwrite": False}),
    ("show d --voxel 0 0 -o e --device cpu --overwrite", "showing.show_voxel", {
        "result": P("d"), "voxel": (0, 0), "output": P("e"), "device": "cpu", "overwrite": True}),
    ("show d --pattern 0 -o e", "tracking.show_pattern", {
        "result": P("d"), "number": 0, "output": P("e"), "overwrite": False}),
    ("show d -o e --overwrite", "showing.show_result", {"result": P("d"), "output": P("e"), "overwrite": True}),
    ("show d", "showing.show_result", {"result": P("d"), "output": None, "overwrite": False}),
    ("convert d --to laz --to e57", "converting.convert_result", {
        "result": P("d"), "to": ["laz", "e57"], "output": None, "by": "", "overwrite": False, "quiet": False}),
    ("convert d --to pcd -o e --by tof --overwrite", "converting.convert_result", {
        "result": P("d"), "to": ["pcd"], "output": P("e"), "by": "tof", "overwrite": True, "quiet": False}),
    ("reprocess d", "reprocessing.reprocess_signals", {
        "folder": P("d"), "overrides": [], "output": None, **AUTO}),
    (f"reprocess d --set x=1 --seed 3 --peak m:f --pulse m:g -o e {ON_CPU}", "reprocessing.reprocess_signals", {
        "folder": P("d"), "overrides": ["m:f", "m:g", "x=1", "seed=3"], "output": P("e"), **GIVEN}),
    ("view d", "viewing.view_result", {
        "result": P("d"), "output": None, "lines": True, "largest_mb": 60.0, **AUTO}),
    (f"view d -o e --no-lines --size 7 {ON_CPU}", "viewing.view_result", {
        "result": P("d"), "output": P("e"), "lines": False, "largest_mb": 7.0, **GIVEN}),
    ("difference d e", "differing.compare_results", {
        "first": P("d"), "second": P("e"), "output": None, "overwrite": False, "quiet": False}),
    ("difference d e -o f --overwrite", "differing.compare_results", {
        "first": P("d"), "second": P("e"), "output": P("f"), "overwrite": True, "quiet": False}),
    ("orbit a.b/c.yaml", "orbit.orbit_scenario", {"call": _call("output/c_orbit"), "steps": 90}),
    (f"orbit {FULL} --steps 7", "orbit.orbit_scenario", {"call": CALL, "steps": 7}),
    ("calibrate a.b/c.yaml", "calibrating.calibrate_scenario", {"call": _call("c_bias.csv")}),
    ("selfcal a.b/c.yaml", "self_calibrating.self_calibrate_plan", {
        "plan": P("a.b/c.yaml"), "output": P("c_calib.yaml"), **AUTO}),
    (f"selfcal c.yaml -o e {ON_CPU}", "self_calibrating.self_calibrate_plan", {
        "plan": P("c.yaml"), "output": P("e"), **GIVEN}),
    ("acceptance a.b/c.yaml", "accepting.accept_plan", {
        "plan": P("a.b/c.yaml"), "output": P("output/c"), **AUTO}),
    (f"acceptance c.yaml -o e {ON_CPU}", "accepting.accept_plan", {
        "plan": P("c.yaml"), "output": P("e"), **GIVEN}),
    ("budget a.b/c.yaml", "budgeting.budget_scenario", {
        "call": _call("output/c_budget"), "count": 12, "reflectance": 0.5, "sweep": None, "image": False}),
    (f"budget {FULL} --distances 7 --reflectance 0.3 --sweep 2mrad --image", "budgeting.budget_scenario", {
        "call": CALL, "count": 7, "reflectance": 0.3, "sweep": "2mrad", "image": True}),
    ("pose-study a.b/c.yaml", "pose_study.study_scenario", {
        "call": _call("output/c_pose_study"), "diameter": None, "quick": False}),
    (f"pose-study {FULL} --diameter 0.2 --quick", "pose_study.study_scenario", {
        "call": CALL, "diameter": 0.2, "quick": True}),
    ("approach a.b/c.yaml", "approaching.fly_approach", {
        "file": P("a.b/c.yaml"), "folder": P("output/c"), "workers": 0, "peak": None, "pulse": None, "dry_run": False,
        "device": "auto", "quiet": False}),
    ("approach c.yaml -o e --workers 3 --peak m:f --pulse m:g --dry-run --device cpu", "approaching.fly_approach", {
        "file": P("c.yaml"), "folder": P("e"), "workers": 3, "peak": "m:f", "pulse": "m:g", "dry_run": True,
        "device": "cpu", "quiet": False}),
    ("approach c.yaml --quiet", "approaching.fly_approach", {
        "file": P("c.yaml"), "folder": P("output/c"), "workers": 0, "peak": None, "pulse": None, "dry_run": False,
        "device": "auto", "quiet": True}),
    ("compare a.b/c.yaml", "comparing.compare_scenario", {
        "call": _call("output/c_compare"), "target": None, "only": [], "seeds": 1, "level": 1e-3, "quick": False,
        "baseline": None}),
    (f"compare {FULL} --target t --only u --only v --seeds 3 --level 0.02 --quick --baseline w",
     "comparing.compare_scenario", {
        "call": CALL, "target": "t", "only": ["u", "v"], "seeds": 3, "level": 0.02, "quick": True,
        "baseline": P("w")}),
    ("reproduce", "reproducing.reproduce_book", {
        "folder": P("output/paper"), "only": (), "family": False, "quick": False, "seed": 2000, **AUTO}),
    ("reproduce --only u --family -o e --seed 0 --overwrite", "reproducing.reproduce_book", {
        "folder": P("e"), "only": ["u"], "family": True, "quick": False, "seed": 0, **AUTO, "overwrite": True}),
    ("reproduce --quick --device cpu -q", "reproducing.reproduce_book", {
        "folder": P("output/paper"), "only": (), "family": False, "quick": True, "seed": 2000, "device": "cpu",
        "overwrite": False, "quiet": True}),
    ("serve a.b/c.yaml", "serving.serve_scenario", {
        "call": _call("output/c_served"), "bind": "tcp://127.0.0.1:*", "realtime": None,
        "state": P("output/c_served.state"), "resume": None, "patience": 10.0, "threads": 1}),
    (f"serve {FULL} --bind u --realtime 2 --state v --resume w --patience 3 --threads 4", "serving.serve_scenario", {
        "call": CALL, "bind": "u", "realtime": 2.0, "state": P("v"), "resume": P("w"), "patience": 3.0,
        "threads": 4}),
    ("campaign a.b/c.campaign.yaml", "campaign.run_campaign", {
        "plan": P("a.b/c.campaign.yaml"), "folder": P("output/c"), "workers": None, "scheduler": None,
        "measure": None, "peak": None, "pulse": None, "dry_run": False, "device": "auto", "quiet": False}),
    ("campaign run c -o e --workers 0 --scheduler u --measure v --peak m:f --pulse m:g --dry-run --device cpu",
     "campaign.run_campaign", {
        "plan": P("c"), "folder": P("e"), "workers": 0, "scheduler": "u", "measure": "v", "peak": "m:f",
        "pulse": "m:g", "dry_run": True, "device": "cpu", "quiet": False}),
    ("campaign status d", "campaign.print_status", {"folder": P("d")}),
    ("campaign show d --run 3", "campaign.show_run", {"folder": P("d"), "run": 3, "scenario": False}),
    ("campaign show d --run 0 --scenario", "campaign.show_run", {"folder": P("d"), "run": 0, "scenario": True}),
    ("campaign rerun d --run 3", "campaign.rerun", {
        "folder": P("d"), "run": 3, "output": None, "device": "auto", "overwrite": False}),
    ("campaign rerun d --run 3 -o e --device cpu --overwrite", "campaign.rerun", {
        "folder": P("d"), "run": 3, "output": P("e"), "device": "cpu", "overwrite": True}),
    ("campaign report d", "campaign.write_report", {"folder": P("d")}),
    ("campaign dataset g/d", "dataset.make_dataset", {
        "folder": P("g/d"), "output": P("g/d_dataset"), "shares": (80.0, 10.0, 10.0), "apart": ("object", "pose"),
        "layers": (), "licence": "", "name": "", "shard_bytes": 256 * 1024**2, "overwrite": False, "quiet": False}),
    ("campaign dataset d -o e --shares 5 3 2 --apart pose --layer u --layer v --license l --name n --shard-size 3"
     " --overwrite", "dataset.make_dataset", {
        "folder": P("d"), "output": P("e"), "shares": (5.0, 3.0, 2.0), "apart": ("pose",), "layers": ("u", "v"),
        "licence": "l", "name": "n", "shard_bytes": 3 * 1024**2, "overwrite": True, "quiet": False}),
    ("instruments", "explaining.list_instruments", {}),
    ("instruments n", "explaining.print_instrument", {"name": "n", "picture": None, "overwrite": False}),
    ("instruments n --picture p --overwrite", "explaining.print_instrument", {
        "name": "n", "picture": P("p"), "overwrite": True}),
    ("instruments n --yaml", "explaining.print_instrument_file", {"name": "n"}),
    ("instruments n --diff o", "explaining.print_differences", {"name": "n", "other": "o"}),
    ("info", "checking.print_info", {}),
]  # fmt: skip


@pytest.fixture
def said(monkeypatch: pytest.MonkeyPatch) -> None:
    """Estimators of one's own are named, and not imported."""

    def taken(peak: str | None, pulse: str | None) -> list[str]:
        return [name for name in (peak, pulse) if name is not None]

    monkeypatch.setattr(options, "own_estimators", taken)


@pytest.mark.usefixtures("said")
@pytest.mark.parametrize(
    ("line", "work", "expected"), CASES, ids=lambda value: value if isinstance(value, str) else ""
)
def test_options_arrive_as_they_are_given(
    line: str, work: str, expected: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: a verb asks one function, with each option's value under its own name, and defaults as stated."""
    module = importlib.import_module(f"scanner_sim.cli.{work.split('.')[0]}")
    name = work.split(".")[1]
    form = inspect.signature(getattr(module, name))
    asked: list[dict[str, Any]] = []

    def note(*values: Any, **named: Any) -> None:
        asked.append(dict(form.bind(*values, **named).arguments))

    monkeypatch.setattr(module, name, note)
    ended = CliRunner().invoke(app, line.split())
    assert ended.exit_code == 0, ended.output
    assert asked == [expected]


@pytest.mark.parametrize(
    ("line", "module", "work"),
    [
        ("show d --voxel 0 0", scanner_sim.cli, "showing.show_voxel"),
        ("view d", looking, "viewing.view_result"),
        ("campaign show d --run 0", campaigns, "campaign.show_run"),
        ("campaign rerun d --run 0", campaigns, "campaign.rerun"),
        ("campaign dataset d", campaigns, "dataset.make_dataset"),
        ("selfcal c", studies, "self_calibrating.self_calibrate_plan"),
        ("acceptance c", studies, "accepting.accept_plan"),
    ],
)
def test_estimators_of_ones_own_are_known_before_a_result_is_read(
    line: str, module: ModuleType, work: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: what finds peaks is named by --peak and what times echoes by --pulse, and both before the work begins."""
    asked: list[tuple[Any, ...]] = []
    place, name = work.split(".")
    monkeypatch.setattr(module, "own_estimators", lambda *both: asked.append(both))
    monkeypatch.setattr(
        importlib.import_module(f"scanner_sim.cli.{place}"), name, lambda *_, **__: asked.append(())
    )
    ended = CliRunner().invoke(app, [*line.split(), "--peak", "m:f", "--pulse", "m:g"])
    assert ended.exit_code == 0, ended.output
    assert asked == [("m:f", "m:g"), ()]


@pytest.mark.parametrize(
    ("line", "allowed"),
    [
        ("orbit c --steps", ("1", "100000", "0", "100001")),
        ("budget c --distances", ("2", "200", "1", "201")),
        ("budget c --reflectance", ("0.001", "1", "0.00099", "1.001")),
        ("pose-study c --diameter", ("0.001", "10", "0.00099", "10.01")),
        ("approach c --workers", ("0", "1024", "-1", "1025")),
        ("campaign run c --workers", ("0", "1024", "-1", "1025")),
        ("compare c --seeds", ("1", "1000", "0", "1001")),
        ("serve c --realtime", ("0.001", "1000", "0.00099", "1001")),
        ("serve c --patience", ("0.1", "1e5", "0.099", "100001")),
        ("serve c --threads", ("1", "1024", "0", "1025")),
        ("view d --size", ("2", "1e9", "1.99", "0")),
        ("campaign dataset d --shard-size", ("1", "4096", "0", "-1")),
        ("show d --pattern", ("0", "9999999", "-1", "-2")),
        ("reproduce --seed", ("0", "9999999", "-1", "-2")),
    ],
)
def test_options_end_where_they_say(
    line: str, allowed: tuple[str, str, str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: the first two values are taken, the others, just outside, are refused with exit status 2."""
    for _, work, _ in CASES:
        module, name = work.split(".")
        monkeypatch.setattr(importlib.import_module(f"scanner_sim.cli.{module}"), name, lambda *_, **__: None)
    for value, status in zip(allowed, (0, 0, 2, 2), strict=True):
        assert CliRunner().invoke(app, [*line.split(), value]).exit_code == status, value


@pytest.mark.parametrize(
    ("folder", "place"),
    [
        (".", "d/e_again"),
        ("..", "d_again"),
        ("f", "d/e/f_again"),
        ("f/.", "d/e/f_again"),
        ("../g", "d/g_again"),
    ],
)
def test_what_stands_beside_a_folder_is_named_as_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: str, place: str
) -> None:
    """Claim: next to it, also where the folder is the working folder or that about it."""
    (tmp_path / "d" / "e").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "d" / "e")
    assert beside(Path(folder), "_again").resolve() == tmp_path / place


@pytest.mark.parametrize(
    ("line", "work", "place"),
    [
        ("campaign dataset .", "dataset.make_dataset", "d_dataset"),
        ("serve c -o .", "serving.serve_scenario", "d.state"),
    ],
)
def test_the_working_folder_is_a_folder_like_any(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str, work: str, place: str
) -> None:
    (tmp_path / "d").mkdir()
    monkeypatch.chdir(tmp_path / "d")
    asked: list[Any] = []
    module, function = work.split(".")
    monkeypatch.setattr(
        importlib.import_module(f"scanner_sim.cli.{module}"),
        function,
        lambda *given, **more: asked.extend((*given, *more.values())),
    )
    ended = CliRunner().invoke(app, line.split())
    assert ended.exit_code == 0, ended.output
    assert tmp_path / place in asked


WRITTEN = [
    ("run", "DIR", "Folder of the result.", "output/ and CONFIG's name"),
    ("scene", "PNG", "The picture.", "output/ and CONFIG's name with _scene.png"),
    ("show", "DIR", "Folder of the pictures.", "beside the result"),
    ("convert", "DIR", "Folder of the files.", "beside the result"),
    ("reprocess", "DIR", "Folder of the result.", "DIR with _again"),
    ("view", "HTML", "The page.", "view.html beside the result"),
    ("difference", "DIR", "Folder of the comparison.", "output/ and SECOND_less_FIRST"),
    ("orbit", "DIR", "Folder of the result.", "output/ and CONFIG's name with _orbit"),
    ("calibrate", "FILE", "Table of the errors, a CSV file.", "CONFIG's name with _bias.csv"),
    (
        "selfcal", "FILE", "The calibration, a YAML file; report, tables and pictures stand beside it.",
        "BOARDS' name with _calib.yaml",
    ),
    ("acceptance", "DIR", "Folder of the report and its pictures.", "output/PLAN's name"),
    ("budget", "DIR", "Folder of the result.", "output/ and CONFIG's name with _budget"),
    ("pose-study", "DIR", "Folder of the result.", "output/ and CONFIG's name with _pose_study"),
    ("approach", "DIR", "Folder of the result.", "output/ and APPROACH's name"),
    ("compare", "DIR", "Folder of the result.", "output/ and CONFIG's name with _compare"),
    ("reproduce", "DIR", "Folder of results, pictures and page.", True),
    ("serve", "DIR", "Folder of the result.", "output/ and CONFIG's name with _served"),
    ("campaign run", "DIR", "Folder of the campaign.", "output/ and PLAN's name"),
    ("campaign rerun", "DIR", "Folder of the result.", "again/ and the number, in the campaign's"),
    ("campaign dataset", "DIR", "Folder of the data set.", "DIR with _dataset"),
]  # fmt: skip


def test_help_says_what_a_verb_writes_and_where() -> None:
    """Claim: every verb with -o says what stands there, in a sentence, and where it does so by default; the word for
    its value is what it is: a folder, or a file of a kind. A default that the verb works out is told in words."""
    found: list[tuple[Any, ...]] = []

    def visit(command: Any, name: str) -> None:
        for word, below in getattr(command, "commands", {}).items():
            visit(below, f"{name} {word}".strip())
        for option in command.params:
            if "-o" in option.opts:
                assert "--output" in option.opts
                found.append((name, option.metavar, option.help, option.show_default))

    visit(typer.main.get_command(app), "")
    assert sorted(found) == sorted(WRITTEN)
    # What they say is what they do: output/ and the name, as the cases above have it.
    calls = {line.split()[0]: more["call"] for line, _, more in CASES if "call" in more and " -" not in line}
    for name, _, _, where in WRITTEN:
        if name in calls:
            stem, ending = calls[name].config.stem, str(where).partition(" with ")[2]
            folder = "output" if str(where).startswith("output/ and") else ""
            assert calls[name].output == P(folder, f"{stem}{ending}"), name
    assert len(calls) >= 8
