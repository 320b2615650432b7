"""What is drawn anew of results, what a plan of a run tells, and what a check warns of."""

from __future__ import annotations

import platform
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from scanner_sim.cli import checking, plan, showing
from scanner_sim.foundation.errors import InputError
from scanner_sim.products.files.contents import RUN, SHOTS, TRACK

Told = Callable[[Any], list[Any]]


@pytest.mark.parametrize("output", [None, Path("o")])
@pytest.mark.parametrize("shots", [True, False])
def test_pictures_are_drawn_anew_beside_their_result(
    monkeypatch: pytest.MonkeyPatch, told: Told, tmp_path: Path, output: Path | None, shots: bool
) -> None:
    """Claim: those beside the result are ours to draw anew, elsewhere only where it is said; each by its own name."""
    lines, asked = told(showing), []
    pictures = "scanner_sim.products.pictures"
    monkeypatch.setattr(
        showing, "_read", lambda place: (tmp_path / "range.exr", "image") if place == tmp_path else None
    )
    monkeypatch.setattr(f"{pictures}.image.pictures_of", lambda _: ("a.png", "b.png"))
    monkeypatch.setattr(f"{pictures}.image.draw_picture", lambda *given: given)
    monkeypatch.setattr(
        "scanner_sim.products.files.shots_folder.read_shots", lambda place: f"shots of {place}"
    )
    monkeypatch.setattr(showing, "_check_shown", lambda path, found: None)
    monkeypatch.setattr(f"{pictures}.shots.PICTURES_OF_SHOTS", {"c.png": lambda *given: ("c", *given)})
    monkeypatch.setattr("scanner_sim.cli.running.closing", lambda *given: given)
    monkeypatch.setattr("scanner_sim.cli.running.closing_shots", lambda *given: given)
    monkeypatch.setattr(showing, "write_files", lambda folder, writers, overwrite: asked.append(
        (folder, {name: write("p") for name, write in writers.items()}, overwrite)) or "paths")  # fmt: skip
    if shots:
        showing.show_shots(tmp_path, output, overwrite=False)
        drawn: dict[str, Any] = {"c.png": ("c", f"shots of {tmp_path}", "p")}
    else:
        showing.show_result(tmp_path, output, overwrite=False)
        drawn = {name: ("image", name, "p") for name in ("a.png", "b.png")}
    assert asked == [(output or tmp_path, drawn, output is None)]
    assert lines == [(f"shots of {tmp_path}" if shots else "image", "paths")]


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ((), "There is no result"), ((SHOTS.result,), "holds shots"), ((TRACK.result,), "holds a tracking run"),
        ((RUN.result, SHOTS.result), None), ((RUN.result,), "has no channel"),
    ],
)  # fmt: skip
def test_voxels_are_those_of_a_raster(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, files: tuple[str, ...], words: str | None
) -> None:
    """Claim: of a folder or of its file; with all channels that are told of a voxel."""
    for name in files:
        (tmp_path / name).touch()
    channels = dict.fromkeys(showing._SHOWN)
    if words == "has no channel":
        channels.pop(showing._SHOWN[-1])
    monkeypatch.setattr("scanner_sim.products.files.exr.read_range_image", lambda path: channels)
    for place in (tmp_path, tmp_path / RUN.result):
        if words in (None, "has no channel") or place is tmp_path:
            with pytest.raises(InputError, match=words) if words else nullcontext():
                assert showing._read(place) == (tmp_path / RUN.result, channels)
    with pytest.raises(InputError, match="There is no result"):
        showing._read(tmp_path / "other.exr")


def test_a_plan_tells_what_a_run_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: ranges of each rangefinder in their order, objects by name, memory in GB, time with that of the start,
    room on the disk in MB where lines are kept, and the files."""
    monkeypatch.setattr(plan, "_pointing", lambda _: {"voxels": "so many"})
    monkeypatch.setattr(plan, "_seen", lambda _, name: f"{name} sees")
    monkeypatch.setattr(plan, "memory", lambda _: 2.34e9)
    monkeypatch.setattr(plan, "run_seconds", lambda _: 60.0)
    monkeypatch.setattr(plan, "disk", lambda _: 1_234.5e6)
    monkeypatch.setattr(plan, "_files", lambda _: ("a_001.png", "a_002.png", "b.csv"))
    scene = SimpleNamespace(objects=[SimpleNamespace(name="u"), SimpleNamespace(name="v")])
    scenario: Any = SimpleNamespace(rangefinders=("tof", "triangulation"), scene=scene)
    assert plan.plan(scenario, Path("f")) == {
        "voxels": "so many", "ranges seen": "tof sees, triangulation sees", "objects": "u, v", "memory": "about 2.3 GB",
        "time": f"about {plan.START_SECONDS + 60.0:.0f} s on two processor cores",
        "disk": "about 1,234 MB of lines and waveforms", "folder": "f", "files": "a_001.png … a_002.png, b.csv",
    }  # fmt: skip
    scene.objects = []
    monkeypatch.setattr(plan, "disk", lambda _: 0)
    found = plan.plan(scenario, Path("f"))
    assert found["objects"] == "none of their own"
    assert "disk" not in found


@pytest.mark.parametrize("there", [True, False])
def test_a_check_warns_and_opens_the_scene(
    monkeypatch: pytest.MonkeyPatch, told: Told, capsys: pytest.CaptureFixture[str], there: bool
) -> None:
    """Claim: warnings of the scenario, of its time, and of its files, which are opened where anything can render; then
    the scenario in full."""
    lines = told(checking)

    def activate(device: str) -> None:
        if not there:
            raise InputError("nothing renders.")

    monkeypatch.setattr(checking, "load_scenario", lambda *given: ("scenario", *given))
    monkeypatch.setattr(checking, "scenario_warnings", lambda _: ["w"])
    monkeypatch.setattr(checking, "slow", lambda _: ["s"])
    monkeypatch.setattr(checking, "resolved_yaml", lambda scenario: f"{scenario}\n")
    monkeypatch.setattr("scanner_sim.render.device.activate", activate)
    monkeypatch.setattr("scanner_sim.instrument.scene_warnings.scene_warnings", lambda _: ["of its files"])
    checking.check_scenario(Path("c.yaml"), ["a=1"])
    last = "of its files" if there else (
        "the files of the scene were not opened, because nothing here can render: nothing renders."
    )  # fmt: skip
    assert lines == ["w", "s", last]
    assert capsys.readouterr().out == f"{('scenario', Path('c.yaml'), ['a=1'])}\n"


@pytest.mark.parametrize("llvm", [None, SimpleNamespace(version=(19, 1, 7), path="/lib/llvm.so")])
@pytest.mark.parametrize("gpu", [None, "a GPU"])
def test_what_the_program_runs_on_is_told(
    monkeypatch: pytest.MonkeyPatch, told: Told, llvm: Any, gpu: str | None
) -> None:
    lines = told(checking)
    device = SimpleNamespace(llvm=llvm, gpu=gpu, variant="mono", threads=3)
    monkeypatch.setattr("scanner_sim.render.device.activate", lambda _: device)
    monkeypatch.setattr("scanner_sim.products.provenance.versions", lambda: {"scanner-sim": "9"})
    checking.print_info()
    (table,) = lines
    assert table["LLVM"].startswith("none; " if llvm is None else "19.1.7 (/lib/llvm.so); ")
    assert table["GPU"] == (gpu or "none that is usable")
    assert (table["variant"], table["threads"], table["scanner-sim"]) == ("mono", "3", "9")
    assert table["Python"].startswith(platform.python_version())
    assert platform.machine() in table["system"]


def test_what_is_known_is_told_before_nothing_can_compute(
    monkeypatch: pytest.MonkeyPatch, told: Told
) -> None:
    lines = told(checking)

    def activate(_: str) -> None:
        raise InputError("nothing renders.")

    monkeypatch.setattr("scanner_sim.render.device.activate", activate)
    with pytest.raises(InputError, match="nothing renders"):
        checking.print_info()
    (table,) = lines
    assert "Python" in table
    assert "LLVM" not in table
