"""How a track is served, which keys a shell completes, what is drawn anew of a track, and the rate of a bar."""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import rich.console

from scanner_sim import Scenario, load_scenario
from scanner_sim.cli import plan, progress, running, serving, tables, tracking
from scanner_sim.foundation.errors import InputError, ScenarioError
from scanner_sim.products.files.contents import VOXELS, planned_track_files
from scanner_sim.products.settings import Output


class EndedError(Exception):
    """The server broke off."""


@pytest.mark.parametrize("local", [True, False])
@pytest.mark.parametrize("quiet", [True, False])
@pytest.mark.parametrize("end", ["client", "signal", "fault"])
def test_a_run_is_served_and_left_as_it_ended(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], local: bool, quiet: bool, end: str
) -> None:
    """Claim: it says where it listens before it serves; an address that others reach is warned of. A client's end
    leaves the folder; a signal the state too, with how to go on, and then has its usual effect; a fault the state
    alone."""
    done: list[Any] = []
    files = SimpleNamespace(
        save=lambda session: done.append(("save", session)) or ["state", "a"],
        write=lambda session: done.append(("write", session)) or ["a"],
        save_state=lambda session: done.append(("state", session)),
    )

    class Server:
        address = "tcp://there:1"

        def __init__(self, bind: str, patience: float) -> None:
            done.append(("bind", bind, patience))

        def serve(self, session: Any, realtime: float | None, stopped: Callable[[], bool]) -> None:
            done.append(("serve", session, realtime, stopped()))
            if end == "fault":
                raise EndedError

        def close(self) -> None:
            done.append("closed")

    @contextlib.contextmanager
    def signals() -> Iterator[list[int]]:
        yield [signal.SIGTERM] if end == "signal" else []

    server, session = (importlib.import_module(f"scanner_sim.serve.{name}") for name in ("server", "session"))
    device = importlib.import_module("scanner_sim.render.device")
    monkeypatch.setattr(server, "Server", Server)
    monkeypatch.setattr(server, "is_local", lambda address: address == "tcp://there:1" and local)
    monkeypatch.setattr(
        session, "Session", lambda *given, **how: ((given, how) and done.append(how)) or "session"
    )
    monkeypatch.setattr(device, "activate", lambda name, threads: done.append((name, threads)))
    monkeypatch.setattr(serving, "_Files", lambda *given: done.append(("files", *given[2:])) or files)
    monkeypatch.setattr(serving, "_ended_by_signals", signals)
    monkeypatch.setattr(serving.signal, "raise_signal", lambda number: done.append(number))
    monkeypatch.setattr(serving, "check_patterns", lambda scenarios: None)
    warned: list[str] = []
    monkeypatch.setattr(serving, "warn", warned.append)
    scenario = SimpleNamespace(following=None, output=SimpleNamespace(formats=()))
    call: Any = SimpleNamespace(
        scenario=lambda: scenario, claimed=lambda kind: contextlib.nullcontext(), device="cpu", quiet=quiet,
        config=Path("c.yaml"),
    )  # fmt: skip
    with pytest.raises(EndedError) if end == "fault" else contextlib.nullcontext():
        serving.serve_scenario(
            call, bind="tcp://*:1", realtime=2.0, state=Path("s"), resume=Path("r"), patience=9.0, threads=3
        )
    said = capsys.readouterr()
    assert json.loads(said.out) == {"address": "tcp://there:1", "protocol": 1, "realtime": 2.0}
    assert bool(warned) is not local
    last = {"client": ("write", "session"), "signal": ("save", "session"), "fault": ("state", "session")}[end]
    assert done[0] == ("files", Path("s"), Path("r"))
    assert done[1:] == [
        ("bind", "tcp://*:1", 9.0), ("cpu", 3), {"device": "cpu", "resume": Path("r"), "save": files.save},
        ("serve", "session", 2.0, end == "signal"), last, *([signal.SIGTERM] if end == "signal" else []), "closed",
    ]  # fmt: skip
    names = {"client": "written: a\n", "signal": "written: state, a\n", "fault": ""}[end]
    further = "go on with: --resume s\n" if end == "signal" else ""
    assert said.err == ("" if quiet else names) + further


def test_keys_that_a_shell_completes_are_values_that_can_be_replaced() -> None:
    """Claim: each is the place of a value, not of a block or of an entry of a list, once and in order; what one kind
    of scan or object alone has is none, what the instrument has is."""
    found = plan.keys()
    assert found == sorted(set(found))
    assert {"seed", "ranging", "scanner.laser.power", "scanner.lidar.pulse.repetition_rate", "processing.threshold",
            "scanner.filter.bandwidth"} <= set(found)  # fmt: skip
    assert not {"scan.rows", "scan.duration", "scanner", "scanner.laser", "scene", "lighting"} & set(found)
    assert not any("*" in key or "(" in key for key in found)
    scan = {"rows": 2, "columns": 2, "horizontal": (-0.1, 0.1), "vertical": (-0.1, 0.1)}
    known = load_scenario({"schema": 1, "scan": scan})
    assert not [key for key in found if key in unknown_to(known, key)]


def unknown_to(scenario: Scenario, key: str) -> list[str]:
    """Return the keys that a scenario does not know when a list of nonsense is put at one."""
    try:
        scenario.replace({key: [{"no": "value"}]})
    except ScenarioError as error:
        return [fault.location for fault in error.faults if "no such key" in fault.problem]
    return []


def test_a_track_is_drawn_anew_with_all_of_its_poses(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Claim: of those poses whose tables are there, by the scene that the run kept; beside the result what is ours is
    replaced, elsewhere only where it is said."""
    asked: list[Any] = []
    (tmp_path / tracking.POSES[1]).write_text("")
    files = "scanner_sim.products.files.track_folder"
    monkeypatch.setattr(
        "scanner_sim.products.track.read_track", lambda place: SimpleNamespace(scenario_yaml="text")
    )
    monkeypatch.setattr(
        "scanner_sim.products.pose.read_poses", lambda path: [f"{path.name} 1", f"{path.name} 2"]
    )
    monkeypatch.setattr(f"{files}.pictures_of", lambda made, poses, backdrop, rims: (poses, backdrop, rims))
    monkeypatch.setattr(tracking, "scenario_from_text", lambda text, name, stored: (text, name, stored))
    monkeypatch.setattr(
        tracking, "backdrop_of", lambda made, scenario, device: ("backdrop", scenario, device)
    )
    monkeypatch.setattr(tracking, "rims_of", lambda made: "rims")
    monkeypatch.setattr(
        tracking,
        "write_files",
        lambda folder, pictures, overwrite: asked.append((folder, pictures, overwrite)) or "paths",
    )
    monkeypatch.setattr(tracking, "_print_closing", lambda made, poses, paths: asked.append((poses, paths)))
    poses = [f"{tracking.POSES[1]} {number}" for number in (1, 2)]
    backdrop = ("backdrop", ("text", str(tmp_path), True), "cpu")
    for output, overwrite, replaced in (
        (None, False, True),
        (Path("o"), False, False),
        (Path("o"), True, True),
    ):
        asked.clear()
        tracking.show_track(tmp_path, output, device="cpu", overwrite=overwrite)
        assert asked == [(output or tmp_path, (poses, backdrop, "rims"), replaced), (poses, "paths")]
    (tmp_path / tracking.RELATIVE_POSES[1]).write_text("")
    asked.clear()
    tracking.show_track(tmp_path, None, device="cpu", overwrite=False)
    assert asked[0][1][0] == [*poses, *(f"{tracking.RELATIVE_POSES[1]} {number}" for number in (1, 2))]


@pytest.mark.parametrize(
    ("speed", "unit", "words"),
    [
        (None, "voxels", ""), (123.456, "", ""), (123.456, "voxels", "123 voxels/s"),
        (9999.0, "shots", "1e+04 shots/s"),
        (10_000.0, "shots", "10 k shots/s"), (234_567.0, "shots", "235 k shots/s"),
    ],
)  # fmt: skip
def test_a_bar_tells_the_rate_of_what_it_counts(
    monkeypatch: pytest.MonkeyPatch, speed: float | None, unit: str, words: str
) -> None:
    """Claim: three digits each second, in thousands from ten thousand on; nothing where nothing is counted or known."""
    screen = rich.console.Console(file=io.StringIO(), force_terminal=True)
    monkeypatch.setattr(progress, "Console", lambda **_: screen)
    kept: list[Any] = []
    whole = importlib.import_module("rich.progress")
    plain = whole.Progress

    def bar(*columns: Any, **how: Any) -> Any:
        kept.append(plain(*columns, **how))
        return kept[-1]

    monkeypatch.setattr(whole, "Progress", bar)
    with progress.progress_bar("first", False, unit) as (advance, say):
        (task,) = kept[0].tasks
        assert (task.description, task.total) == ("first", None)
        advance(3, 8)
        assert (task.completed, task.total) == (3, 8)
        say("then")
        assert (task.description, task.completed) == ("then", 0)
        *_, rate, _ = kept[0].columns
        assert str(rate.render(SimpleNamespace(speed=speed))) == words
    monkeypatch.setattr(progress, "Console", lambda **_: rich.console.Console(file=io.StringIO()))
    with progress.progress_bar("first", False, unit) as (advance, say):
        advance(1, 2)
        say("nothing in a pipe")
    assert len(kept) == 1


def test_serving_needs_its_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serving.importlib.util, "find_spec", lambda name: None if name == "zmq" else name)
    with pytest.raises(InputError, match="serving needs zmq, not installed") as fault:
        serving._check_installed()
    assert fault.value.remedy == "pip install 'scanner-sim[serve]'"
    monkeypatch.setattr(serving.importlib.util, "find_spec", lambda name: name)
    serving._check_installed()


@pytest.mark.parametrize(("pictures", "lit"), [(True, True), (True, False), (False, True)])
def test_shots_are_photographed_where_pictures_are_wanted_and_the_sun_shines(
    monkeypatch: pytest.MonkeyPatch, pictures: bool, lit: bool
) -> None:
    said: list[str] = []
    scenario: Any = SimpleNamespace(output=SimpleNamespace(pictures=pictures))

    @contextlib.contextmanager
    def work(stage: str, unit: str) -> Iterator[Any]:
        said.append(f"{stage} {unit}")
        yield "advance", said.append

    call: Any = SimpleNamespace(
        work=work,
        device="cpu",
        output=Path("o"),
        overwrite=True,
        quiet=True,
        warn=lambda words: said.extend(words),
    )
    written: list[Any] = []
    instrument = "scanner_sim.instrument"
    monkeypatch.setattr(running, "sunlit", lambda one: lit)
    monkeypatch.setattr(f"{instrument}.photograph.take_photo", lambda one, device: ("photo", one, device))
    monkeypatch.setattr(
        f"{instrument}.shots.simulate_shots", lambda one, device, progress: SimpleNamespace(warnings=["w"])
    )
    monkeypatch.setattr(
        "scanner_sim.products.files.shots_folder.write_shots",
        lambda *given, **how: written.append((given[1:], how)),
    )
    running._run_shots(scenario, call)
    taken = pictures and lit
    assert said == ["simulating shots", *(["taking the photograph"] if taken else []), "writing", "w"]
    camera = ("photo", scenario, "cpu") if taken else None
    assert written == [((Path("o"), scenario.output), {"camera": camera, "overwrite": True})]


def test_tables_are_framed_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: each cell once, row by row under its heading, and brackets of paths are no markup."""
    screen = io.StringIO()
    console = rich.console.Console(file=screen, width=80, force_terminal=False)
    monkeypatch.setattr(tables, "Console", lambda: console)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    tables.print_rows([("a", "b"), ("x[red]", "1"), ("y", "22")], left=(0,))
    lines = screen.getvalue().splitlines()
    cells = [
        [cell.strip() for cell in line.strip("│┃").replace("┃", "│").split("│")]
        for line in lines
        if "│" in line or "┃" in line
    ]
    assert cells == [["a", "b"], ["x[red]", "1"], ["y", "22"]]
    tables.print_table({"word": "a [phrase]"})
    assert screen.getvalue().splitlines()[-1].split(None, 1) == ["word", "a [phrase]"]


def test_voxels_of_patterns_are_written_where_they_are_wanted() -> None:
    every, fewer = (planned_track_files(Output(patterns=wanted), 1) for wanted in (True, False))
    assert set(every) - set(fewer) == {VOXELS}
    assert [name for name in every if name != VOXELS] == list(fewer)
