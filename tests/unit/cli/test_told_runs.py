"""How verbs do their runs: what is asked of whom, in which order, what is refused before, and what is told after."""

from __future__ import annotations

import contextlib
import importlib
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import scanner_sim
from scanner_sim.foundation.errors import InputError, RunError

campaign: Any = importlib.import_module("scanner_sim.cli.campaign")
"""The module: the package gives its name to the verb."""

Told = Callable[[Any], list[Any]]


class Store(SimpleNamespace):
    """A made-up folder of a campaign of six runs."""

    def __init__(self, **more: Any) -> None:
        told: dict[str, Any] = {
            "done": np.array([True, True, False, True, False, False]), "failed": 2, "folder": Path("f"), "packed": 0,
            "measures": ("u", "own"), "campaign": SimpleNamespace(base="base"),
        }  # fmt: skip
        super().__init__(**told | more)

    def pack(self) -> None:
        self.packed += 1


def done_runs(
    monkeypatch: pytest.MonkeyPatch,
    workers: int | None,
    gpus: tuple[str, ...] | None,
    scheduler: str | None,
    **more: Any,
) -> tuple[list[Any], list[str], Store]:
    """Do the runs of a campaign on what there is; return who was asked for what, what the bar said, and the folder."""
    asked: list[Any] = []
    said: list[str] = []
    store = Store(**more)

    @contextlib.contextmanager
    def opened(*given: Any) -> Iterator[Store]:
        asked.append(("opened", *given))
        yield store

    @contextlib.contextmanager
    def bar(stage: str, *_: Any) -> Iterator[Any]:
        said.append(stage)
        yield lambda done, runs: asked.append(("advance", done, runs)), said.append

    @contextlib.contextmanager
    def client(*given: Any) -> Iterator[str]:
        asked.append(("client", *given))
        yield "client"

    def run(name: str) -> Callable[..., None]:
        def doing(*given: Any) -> None:
            asked.append((name, *given[:-1]))
            for done, failed in ((4, 2), (5, 3), (6, 3)):
                given[-1](done, 6, failed)

        return doing

    gpu = None if gpus is None else "a GPU"
    for name, stub in {
        "scanner_sim.campaign.store.opened": opened, "scanner_sim.campaign.serial.run_serially": run("serially"),
        "scanner_sim.campaign.cluster.client_of": client, "scanner_sim.campaign.cluster.run_on": run("on"),
        "scanner_sim.render.device.activate": lambda device: SimpleNamespace(gpu=gpu),
        "scanner_sim.render.libraries.visible_gpus": lambda: gpus,
    }.items():  # fmt: skip
        monkeypatch.setattr(name, stub)
    monkeypatch.setattr(campaign, "progress_bar", bar)
    monkeypatch.setattr(campaign, "_cores", lambda: 5)
    runs: Any = SimpleNamespace(plan=SimpleNamespace(measure=("u", "v")))
    settings: Any = SimpleNamespace(folder=Path("f"), device="cpu", own=SimpleNamespace(column="own"))
    campaign.do_runs(runs, settings, workers, scheduler, False)
    assert asked[0] == ("opened", Path("f"), runs, ("u", "v", "own"))
    return asked[1:], said, store


@pytest.mark.parametrize(
    ("workers", "gpus", "scheduler", "client"),
    [
        (0, None, None, None),
        (2, None, None, (2, None, ())),
        (9, None, None, (3, None, ())),
        (None, None, None, (3, None, ())),
        (None, ("a", "b"), None, (2, None, ("a", "b"))),
        (1, ("a", "b"), None, (1, None, ("a", "b"))),
        (0, None, "tcp://x", (0, "tcp://x", ())),
    ],
)
def test_runs_that_are_left_are_done_where_it_is_asked(
    monkeypatch: pytest.MonkeyPatch,
    workers: int | None,
    gpus: tuple[str, ...] | None,
    scheduler: str | None,
    client: tuple[Any, ...] | None,
) -> None:
    """Claim: without workers in this process; else on as many as asked, one for each GPU or core unless said, and no
    more than runs are left, which are three; on a scheduler whatever is said. The bar tells failures as they become
    more."""
    asked, said, store = done_runs(monkeypatch, workers, gpus, scheduler)
    if client is None:
        assert asked[0][:2] == ("serially", store)
    else:
        assert asked[0] == ("client", *client)
        assert asked[1][:3] == ("on", "client", store)
    assert asked[-3:] == [("advance", done, 6) for done in (4, 5, 6)]
    assert said == ["3 runs", "3 runs, 3 failed"]
    assert store.packed == 1


def test_more_workers_than_gpus_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="3 workers need a GPU each, and 2 can be seen") as fault:
        done_runs(monkeypatch, 3, ("a", "b"), None)
    assert "--workers 2" in fault.value.remedy


def test_a_campaign_that_is_done_asks_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, _, store = done_runs(monkeypatch, 2, None, None, done=np.ones(6, bool))
    assert asked == []
    assert store.packed == 1


@pytest.mark.parametrize(
    ("workers", "scheduler", "there", "refused"),
    [
        (0, None, False, False), (2, None, False, True), (None, None, False, True), (0, "tcp://x", False, True),
        (2, None, True, False),
    ],
)  # fmt: skip
def test_several_workers_need_dask(
    monkeypatch: pytest.MonkeyPatch, workers: int | None, scheduler: str | None, there: bool, refused: bool
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: "spec" if there else None)
    with pytest.raises(InputError, match="need Dask") if refused else contextlib.nullcontext():
        campaign.need_dask(workers, scheduler)


@pytest.mark.parametrize("quiet", [True, False])
@pytest.mark.parametrize(
    ("dry", "workers", "shown"), [(True, None, 4), (True, 0, 1), (True, 3, 3), (False, 3, None)]
)
def test_a_plan_is_checked_before_its_runs(
    monkeypatch: pytest.MonkeyPatch,
    told: Told,
    dry: bool,
    workers: int | None,
    shown: int | None,
    quiet: bool,
) -> None:
    """Claim: estimators are known before the plan is read; warnings of base and runs unless it is quiet; a dry run
    shows the plan for as many workers as cores unless said, one at least, and does nothing; else the runs, then their
    state."""
    lines = told(campaign)
    order: list[Any] = []
    runs: Any = SimpleNamespace(base="base")
    estimators = SimpleNamespace(register=lambda: order.append("registered"))

    class Named:
        @staticmethod
        def of(*given: Any) -> Any:
            order.append(given)
            return estimators

    stubs: dict[str, Any] = {
        "scanner_sim.signals.named.NamedEstimators": Named,
        "scanner_sim.campaign.reading.read_campaign": lambda path: (order.append(path), runs)[1],
        "scanner_sim.campaign.reading.impossible_runs": lambda of: ["of its runs"],
    }
    for name, stub in stubs.items():
        monkeypatch.setattr(name, stub)
    monkeypatch.setattr(campaign, "scenario_warnings", lambda base: [f"of {base}"])
    monkeypatch.setattr(campaign, "_cores", lambda: 4)
    monkeypatch.setattr(campaign, "_print_plan", lambda *given: order.append(("plan", *given)))
    monkeypatch.setattr(campaign, "need_dask", lambda *given: order.append(("dask", *given)))
    monkeypatch.setattr(campaign, "do_runs", lambda of, settings, *given: order.append(
        ("runs", of, settings.folder, settings.own, settings.device, settings.estimators, *given)))  # fmt: skip
    monkeypatch.setattr(campaign, "print_status", lambda folder: order.append(("status", folder)))
    campaign.run_campaign(
        Path("p.yaml"), Path("f"), workers=workers, scheduler="s", measure=None, peak="a:b", pulse="c:d", dry_run=dry,
        device="cpu", quiet=quiet,
    )  # fmt: skip
    assert lines == ([] if quiet else ["of base", "of its runs"])
    first = [("a:b", "c:d"), "registered", Path("p.yaml")]
    doing: list[Any] = [("plan", runs, Path("f"), shown)] if dry else [
        ("dask", 3, "s"), ("runs", runs, Path("f"), None, "cpu", estimators, 3, "s", quiet)]  # fmt: skip
    status = [] if dry or quiet else [("status", Path("f"))]
    assert order == first + doing + status


def test_the_state_of_a_campaign_is_told_by_medians(monkeypatch: pytest.MonkeyPatch, told: Told) -> None:
    """Claim: done and failed runs, median and the middle nine tenths of what is known of each measure with its unit,
    and the five most frequent faults, the most frequent first; those that are equally frequent in one line."""
    lines = told(campaign)
    u = np.append(np.linspace(0.0, 20.0, 21), math.nan)
    faults = ["", *["a"] * 3, *["b"] * 5, *["c"] * 2, *["d"] * 4, "e", *["f"] * 6]
    store = Store(failed=21, done=np.arange(2222) < 1234, measures=("u", "v", "w"))
    table = {
        "u": u,
        "v": np.full(22, 3.0),
        "w": np.full(22, math.nan),
        "fault": np.array(faults, dtype=object),
    }
    monkeypatch.setattr(
        "scanner_sim.campaign.store.reopened", lambda folder: store if folder == Path("f") else None
    )
    monkeypatch.setattr("scanner_sim.campaign.store.units_of", lambda *_: {"u": "m", "v": "1"})
    monkeypatch.setattr(
        "scanner_sim.campaign.result.CampaignResult", lambda _: SimpleNamespace(table=lambda: table)
    )
    campaign.print_status(Path("f"))
    assert lines == [{
        "runs": "1,234 of 2,222 done", "failed": "21", "folder": "f", "u": "10 m median, 1 to 19 in nine of ten runs",
        "v": "3 median, 3 to 3 in nine of ten runs", "6 ×": "f", "5 ×": "b", "4 ×": "d", "3 ×": "a", "2 ×": "c",
    }]  # fmt: skip
    table["fault"] = np.array(["a", "b", "c", "c", "", "d"], dtype=object)
    assert campaign._medians(store) == {**dict(list(lines[0].items())[3:5]), "2 ×": "c", "1 ×": "a; b; d"}
    store.failed = 0
    assert "2 ×" not in campaign._medians(store)
    table = {}
    assert campaign._medians(store) == {}


@pytest.mark.parametrize(
    ("row", "again", "fault", "same"),
    [
        ({"u": 2.5, "fault": ""}, 2.5, None, True), ({"u": math.nan, "fault": ""}, math.nan, None, True),
        ({"u": 2.0, "fault": ""}, 2.5, "run 3 gives other numbers than before: u", False),
        ({"u": 2.0, "fault": "it fell"}, 2.5, None, False), (None, 2.5, None, False),
    ],
)  # fmt: skip
@pytest.mark.parametrize("output", [Path("o"), None])
def test_a_run_again_is_compared_with_its_row(
    monkeypatch: pytest.MonkeyPatch,
    told: Told,
    row: Any,
    again: float,
    fault: str | None,
    same: bool,
    output: Path | None,
) -> None:
    """Claim: only measures of the program's own are made again, into a folder of the run's number unless one is named;
    frames of poses on the device of the run; a fault where a number moved, after it was told; nothing to compare with
    where the run failed or was not done."""
    lines = told(campaign)
    asked: list[Any] = []
    runs: Any = type("Runs", (), {"__len__": lambda _: 5, "scenario": lambda _, run: f"scenario {run}"})()
    store = Store(campaign=runs)
    for name, stub in {
        "scanner_sim.campaign.measures.MEASURES": {"u": 1, "other": 2},
        "scanner_sim.campaign.measures.measured": lambda names, outcome: dict.fromkeys(names, again) | {"of": outcome},
        "scanner_sim.campaign.store.reopened": lambda _: store,
        "scanner_sim.campaign.work.outcome_of": lambda made, device: f"outcome of {made} on the {device}",
    }.items():  # fmt: skip
        monkeypatch.setattr(name, stub)
    monkeypatch.setattr(campaign, "_row_of", lambda _, run: row if run == 3 else None)
    monkeypatch.setattr(
        campaign, "run_into_folder", lambda scenario, call: (asked.append((scenario, call)), "made")[1]
    )
    monkeypatch.setattr(
        campaign, "_spelled", lambda _, values: {name: str(value) for name, value in values.items()}
    )
    with pytest.raises(RunError, match=fault) if fault else contextlib.nullcontext():
        campaign.rerun(Path("f"), 3, output, device="cpu", overwrite=True)
    ((scenario, call),) = asked
    assert scenario == "scenario 3"
    assert call.output == (output or Path("f") / "again" / "000003")
    assert (call.device, call.overwrite, call.quiet) == ("cpu", True, False)
    expected = {"run": "3", "u": str(again), "of": "outcome of made on the cpu"}
    assert lines == [expected | ({"row": "the same numbers"} if same else {})]


def test_a_row_is_found_in_whichever_part_it_stands() -> None:
    parts = [
        {"run": np.array([4, 1]), "u": np.array([0.4, 0.1])},
        {"run": np.array([3]), "u": np.array([0.3])},
    ]
    store: Any = SimpleNamespace(rows=lambda: parts)
    assert [campaign._row_of(store, run) for run in (1, 3, 2)] == [
        {"run": 1, "u": 0.1},
        {"run": 3, "u": 0.3},
        None,
    ]


@pytest.mark.parametrize("scenario", [True, False])
def test_a_run_is_shown_by_its_scenario_or_its_row(
    monkeypatch: pytest.MonkeyPatch, told: Told, scenario: bool
) -> None:
    lines = told(campaign)
    runs = type("Runs", (), {"__len__": lambda _: 5, "scenario": lambda _, run: f"scenario {run}"})()
    store = Store(campaign=runs)
    monkeypatch.setattr("scanner_sim.campaign.store.reopened", lambda _: store)
    monkeypatch.setattr(campaign, "resolved_yaml", lambda of: f"{of}:\n")
    monkeypatch.setattr(campaign, "_about_run", lambda _, run: {"run": str(run)})
    campaign.show_run(Path("f"), 4, scenario=scenario)
    assert lines == (["scenario 4:\n"] if scenario else [{"run": "4"}])


def test_the_page_of_a_campaign_stands_in_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Claim: the page of the campaign that is there, in the place of an earlier one, and where it is is said."""
    campaign = importlib.import_module("scanner_sim.cli.campaign")
    monkeypatch.setattr("scanner_sim.campaign.store.reopened", lambda folder: f"store of {folder}")
    monkeypatch.setattr("scanner_sim.campaign.report.report_page", lambda store: f"page of {store}")
    for _ in (1, 2):
        campaign.write_report(tmp_path)
        assert (tmp_path / "report.html").read_text(encoding="utf-8") == f"page of store of {tmp_path}"
        assert capsys.readouterr().out.split() == ["page", str(tmp_path / "report.html")]


def test_shipped_scenarios_are_those_of_the_working_folder_if_it_has_some(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from scanner_sim.cli import reproducing

    monkeypatch.chdir(tmp_path)
    assert reproducing.repository() == Path(scanner_sim.__file__).resolve().parents[1]
    (tmp_path / "configs").mkdir()
    assert reproducing.repository() == tmp_path
