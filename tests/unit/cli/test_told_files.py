"""How verbs of acceptance, kept signals, pages and scenes put their work together, and what they tell at their end."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer

from scanner_sim.acceptance.verdicts import Verdict
from scanner_sim.cli import accepting, reprocessing, viewing, viewing_scene
from scanner_sim.foundation.errors import InputError
from scanner_sim.products.files import contents

Told = Callable[[Any], list[Any]]


def bar(said: list[str]) -> Any:
    return lambda *_: nullcontext(("advance", said.append))


def accepted(verdict: Verdict) -> Any:
    tests = [
        SimpleNamespace(
            artefact="bar", quantity="size", reference=1.001, measured=1.002, error=0.003, sigma=0.004,
            uncertainty=0.005, limit=0.006,
        )
    ]  # fmt: skip
    plan = SimpleNamespace(rule="simple", repetitions=7)
    return SimpleNamespace(
        verdict=verdict,
        tests=tests,
        verdict_of=lambda one: f"of {one.artefact}",
        setup=SimpleNamespace(plan=plan),
    )


@pytest.mark.parametrize("quiet", [True, False])
@pytest.mark.parametrize("verdict", list(Verdict))
def test_an_acceptance_test_ends_with_its_verdict(
    monkeypatch: pytest.MonkeyPatch, told: Told, verdict: Verdict, quiet: bool
) -> None:
    """Claim: status 1 unless the instrument passes, after all files are written; each test in mm in the order of the
    heading; the plan stands beside the report as it was read."""
    lines, written = told(accepting), {}
    found = accepted(verdict)
    for name, stub in {
        "read_setup": lambda plan: ("setup", plan), "text_of": lambda plan: "the plan",
        "accept": lambda setup, device, progress: found if (setup, device) == (("setup", Path("p")), "cpu") else None,
        "claim_folder": lambda *given: (written.update(claimed=given), nullcontext())[1],
        "progress_bar": bar([]), "drawn": lambda draw: draw("x"), "json_text": lambda content: ("json", content),
        "write_text": lambda path, text: text, "write_bytes": lambda path, content: content,
        "write_folder": lambda folder, kind, writers, overwrite: (
            written.update({name: write("p") for name, write in writers.items()}, into=(folder, kind, overwrite)),
            (folder / "acceptance.json", folder / "plan.yaml"))[1],
    }.items():  # fmt: skip
        monkeypatch.setattr(accepting, name, stub)
    for name in ("draw_deviations", "draw_errors", "draw_places"):
        monkeypatch.setattr(
            f"scanner_sim.acceptance.pictures.{name}", lambda *given, name=name: (name, *given)
        )
    monkeypatch.setattr("scanner_sim.acceptance.report.page", lambda *given: given)
    monkeypatch.setattr("scanner_sim.acceptance.report.remarks", lambda _: ("coarse",))
    monkeypatch.setattr("scanner_sim.acceptance.report.report", lambda one: ("report", one))
    with nullcontext() if verdict is Verdict.PASSES else pytest.raises(typer.Exit) as end:
        accepting.accept_plan(Path("p"), Path("o"), device="cpu", overwrite=True, quiet=quiet)
    assert verdict is Verdict.PASSES or end.value.exit_code == 1
    assert written["claimed"] == (Path("o"), True, contents.ACCEPTANCE)
    assert written["into"] == (Path("o"), contents.ACCEPTANCE, True)
    pictures = {f"{name}.png": (f"draw_{name}", found, "x") for name in ("errors", "places", "deviations")}
    assert {name: written[name] for name in pictures} == pictures
    assert written["acceptance.json"] == ("json", ("report", found))
    assert written["acceptance.html"] == (found, "the plan", pictures)
    assert written["plan.yaml"] == "the plan"
    if quiet:
        assert not lines
        return
    warning, (head, row), sentence, table = lines
    assert warning == "coarse"
    assert head == [
        "artefact",
        "test",
        "certified",
        "measured",
        "largest error",
        "σ",
        "U",
        "limit [mm]",
        "verdict",
    ]
    assert row == ["bar", "diameter", "1001.000", "1002.000", "3.000", "4.000", "5.000", "6.000", "of bar"]
    assert sentence.startswith("\nThe instrument passes. A result" if verdict is Verdict.PASSES else "\n")
    assert table["repetitions"].startswith("7, each")
    assert table["files"] == "acceptance.json, plan.yaml"


@pytest.mark.parametrize("quiet", [True, False])
@pytest.mark.parametrize(("whole", "versions", "output"), [(True, "now", None), (False, "then", Path("o"))])
def test_kept_light_is_processed_again(
    monkeypatch: pytest.MonkeyPatch,
    told: Told,
    whole: bool,
    versions: str,
    output: Path | None,
    quiet: bool,
    tmp_path: Path,
) -> None:
    """Claim: into the folder's name and ``_again``, never its own; light of other versions is warned of; an image where
    every voxel was kept, else lines and waveforms alone, each of its rangefinder."""
    lines, said, written = told(reprocessing), [], {}
    folder = tmp_path / "run"
    folder.mkdir()
    target = output or tmp_path / "run_again"
    scenario = SimpleNamespace(output="output")
    kept = SimpleNamespace(
        whole=whole, changed=lambda overrides: scenario if overrides == ["a=1"] else None,
        about={"u": SimpleNamespace(made_by={"p": versions})},
    )  # fmt: skip
    work = SimpleNamespace(parts=lambda name: f"parts of {name}", image=lambda advance: f"image, {advance}")
    reprocess = "scanner_sim.instrument.reprocess"
    monkeypatch.setattr(
        f"{reprocess}.KeptSignals", SimpleNamespace(find=lambda place: kept if place == folder else None)
    )
    monkeypatch.setattr(f"{reprocess}.Reprocessing", lambda *given, device: work)
    where = "scanner_sim.products.files.run_folder"
    monkeypatch.setattr(
        f"{where}.write_run", lambda *given, **options: written.update(given=given, **options) or [Path("x")]
    )
    monkeypatch.setattr(
        f"{where}.signal_writers",
        lambda parts: {name: (lambda _, one=one: one) for name, one in parts.items()},
    )
    for name, stub in {
        "recover": lambda place: said.append(f"recovered {place.name}"), "scenario_warnings": lambda of: ["w"],
        "versions": lambda: {"p": "now"}, "check_memory": lambda of: said.append("memory"),
        "claim_folder": lambda *given: (written.update(claimed=given), nullcontext())[1], "progress_bar": bar(said),
        "closing": lambda image, paths: {"image": image}, "resolved_yaml": lambda of: "yaml",
        "write_text": lambda path, text: text,
        "write_folder": lambda to, kind, writers, overwrite: (written.update(
            {name: write("p") for name, write in writers.items()}), [to / "x"])[1],
    }.items():  # fmt: skip
        monkeypatch.setattr(reprocessing, name, stub)
    reprocessing.reprocess_signals(folder, ["a=1"], output, device="cpu", overwrite=True, quiet=quiet)
    assert written["claimed"] == (target, True, contents.RUN if whole else contents.SIGNALS)
    assert said == ["recovered run", "memory", "writing"]
    if whole:
        assert written["given"] == ("image, advance", target, "output")
        assert (written["lines"], written["waveforms"]) == ("parts of triangulation", "parts of tof")
    else:
        assert written["scenario.yaml"] == "yaml"
        assert written[contents.LINES] == "parts of triangulation"
        assert written[contents.WAVEFORMS] == "parts of tof"
    warned = ["w"] + (
        ["the light was made by other versions of the programs: a run of now may differ"]
        if versions == "then"
        else []
    )
    if quiet:
        assert not lines
    else:
        assert lines[:-1] == warned
        assert ("image" in lines[-1]) is whole
        assert ("left out" in lines[-1]) is not whole
    with pytest.raises(InputError, match="whose light is read"):
        reprocessing.reprocess_signals(folder, ["a=1"], folder, device="cpu", overwrite=True, quiet=True)


@pytest.mark.parametrize("folder", [True, False])
@pytest.mark.parametrize("output", [None, Path("o.html")])
def test_a_page_is_made_beside_its_result(
    monkeypatch: pytest.MonkeyPatch, told: Told, tmp_path: Path, folder: bool, output: Path | None
) -> None:
    """Claim: titled as the folder of the result; one beside it is ours to make anew, another only where it is said."""
    lines, asked = told(viewing), []
    made = tmp_path / "page.html"
    made.write_bytes(b"x" * 1_234_567)
    result = tmp_path if folder else tmp_path / "range.exr"
    monkeypatch.setattr(viewing, "result_in", lambda place: ("found", "poses") if place == result else None)
    monkeypatch.setattr(viewing, "check_files", lambda files, overwrite: asked.append((files, overwrite)))
    monkeypatch.setattr(viewing, "progress_bar", bar([]))
    monkeypatch.setattr(
        "scanner_sim.instrument.viewing.view",
        lambda *given, **options: asked.append((given, options)) or made,
    )
    viewing.view_result(
        result, output, lines=False, largest_mb=9.0, device="cpu", overwrite=False, quiet=False
    )
    page, anew = output or tmp_path / viewing.PAGE, output is None
    assert asked[0] == ([page], anew)
    assert asked[1] == (("found", page), {
        "title": tmp_path.name, "lines": False, "folder": tmp_path, "poses": "poses", "largest_mb": 9.0,
        "device": "cpu",
        "progress": "advance", "overwrite": anew,
    })  # fmt: skip
    assert lines == [{"page": str(made), "size": "1.23 MB"}]


@pytest.mark.parametrize(("far", "words"), [(math.inf, "1.5 m to infinity"), (20.0, "1.5 m to 20 m")])
@pytest.mark.parametrize("objects", [(), ("u",)])
def test_a_scene_is_told_with_its_field(
    monkeypatch: pytest.MonkeyPatch, told: Told, far: float, words: str, objects: tuple[str, ...]
) -> None:
    lines = told(viewing_scene)
    warned: list[Any] = []
    horizontal, vertical = map(math.radians, (-3.0, 4.5)), map(math.radians, (-1.25, 2.0))
    field = SimpleNamespace(horizontal=tuple(horizontal), vertical=tuple(vertical), near=1.5, far=far)
    view = SimpleNamespace(objects=objects, field=field)
    monkeypatch.setattr(
        viewing_scene,
        "view_scene",
        lambda scenario, device: view if (scenario, device) == ("s", "cpu") else None,
    )
    monkeypatch.setattr(viewing_scene, "scene_warnings", lambda scenario, device: [f"of {scenario}"])
    monkeypatch.setattr(viewing_scene, "draw_scene", lambda *given: given)
    monkeypatch.setattr(
        viewing_scene,
        "write_file",
        lambda path, write, overwrite: warned.append((write("p"), overwrite)) or path,
    )
    monkeypatch.setattr(viewing_scene, "_table", lambda of: [of])
    call: Any = SimpleNamespace(
        scenario=lambda: "s", config=Path("f/c.yaml"), device="cpu", output=Path("o.png"), overwrite=True, quiet=False,
        warn=warned.extend,
    )  # fmt: skip
    viewing_scene.show_scene(call)
    title = "c.yaml: what stands before the scanner when the scan begins"
    assert warned == ["of s", ((view, title, "p"), True)]
    assert lines[:-1] == ([[view], ""] if objects else [])
    assert lines[-1] == {
        "field of view": "Θ -3 to 4.5 deg, φ -1.25 to 2 deg", "ranges seen": words, "picture": "o.png"
    }  # fmt: skip


@pytest.mark.parametrize("quiet", [True, False])
def test_a_run_that_follows_is_written_with_its_poses(
    monkeypatch: pytest.MonkeyPatch, told: Told, quiet: bool
) -> None:
    """Claim: the bar counts patterns, and never more than there are; then files with poses, pictures and frames as the
    scenario asks for, warnings, and the closing words."""
    from scanner_sim.cli import tracking

    lines, asked, said = told(tracking), [], []
    monkeypatch.setattr(tracking, "patterns", lambda _: 2)

    def track(scenario: Any, device: str, progress: Any) -> Any:
        for number in range(3):
            progress(0.5 * number, 9.0)
        return SimpleNamespace(warnings=["w"])

    monkeypatch.setattr("scanner_sim.instrument.closed_loop.track.track", track)
    monkeypatch.setattr(
        tracking, "write_tracking", lambda *given, **options: (asked.append(options), ("poses", "paths"))[1]
    )
    monkeypatch.setattr(tracking, "_print_closing", lambda *given: lines.append(given[1:]))
    call: Any = SimpleNamespace(
        work=lambda stage, unit: nullcontext((lambda *given: said.append(given), "say")), device="cpu", overwrite=True,
        quiet=quiet, warn=lambda sentences: said.extend(sentences),
    )  # fmt: skip
    tracking.run_tracking("scenario", call)  # type: ignore[arg-type]
    assert said == [(1, 2), (2, 2), (3, 3), "w"]
    assert asked[0]["overwrite"] is True
    assert asked[0]["say"] == "say"
    assert lines == ([] if quiet else [("poses", "paths")])


@pytest.mark.parametrize("pictures", [True, False])
@pytest.mark.parametrize("frames", [True, False])
def test_files_of_a_track_are_those_that_are_asked_for(
    monkeypatch: pytest.MonkeyPatch, pictures: bool, frames: bool
) -> None:
    from scanner_sim.cli import tracking

    said: list[Any] = []
    written: dict[str, Any] = {}
    kept = SimpleNamespace(keep="keep")
    monkeypatch.setattr("scanner_sim.products.files.frame_files.kept_frames", lambda camera, folder: nullcontext(
        kept if (camera, folder) == ("camera", "out") else None))  # fmt: skip
    monkeypatch.setattr("scanner_sim.products.files.track_folder.write_track", lambda *given, **options: (
        written.update(given=given, **options), ("a", "b"))[1])  # fmt: skip
    monkeypatch.setattr(tracking, "every_pose", lambda made, **options: (said.append(options), "poses")[1])
    monkeypatch.setattr(tracking, "backdrop_of", lambda *given: ("backdrop", *given))
    monkeypatch.setattr(tracking, "rims_of", lambda made: ("rims", made))
    output = SimpleNamespace(frames=frames, pictures=pictures)
    scenario: Any = SimpleNamespace(
        pose=SimpleNamespace(methods=("uv", "camera") if frames else ("uv",)), output=output, camera="camera"
    )
    call: Any = SimpleNamespace(device="cpu", output="out")
    found = tracking.write_tracking("made", scenario, call, overwrite=True, say=said.append, progress="bar")  # type: ignore[arg-type]
    assert found == ("poses", ("a", "b"))
    first = "taking the camera's frames" if frames else "estimating poses"
    poses = {"device": "cpu", "progress": "bar", "keep": "keep" if frames else None}
    assert said == [first, poses, *(["drawing"] if pictures else [])]
    assert written == {
        "given": ("made", "out", output), "poses": "poses", "rim": ("rims", "made"), "overwrite": True,
        "backdrop": ("backdrop", "made", scenario, "cpu") if pictures else None, "frames": kept if frames else None,
    }  # fmt: skip
