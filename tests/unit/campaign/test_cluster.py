"""What is asked of Dask: workers with GPUs of their own, and runs that kill their workers."""

from __future__ import annotations

import contextlib
import ctypes
import os
from collections.abc import Iterator
from itertools import cycle
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from scanner_sim.campaign.reading import read_campaign
from scanner_sim.campaign.runs import Campaign
from scanner_sim.campaign.store import PARTS, Row, opened
from scanner_sim.campaign.work import Settings, Task
from scanner_sim.cli import app
from scanner_sim.foundation.errors import InputError, RunError
from scanner_sim.products.files.tables import read_parquet
from scanner_sim.render import device as device_module
from scanner_sim.render import libraries

KilledWorker = pytest.importorskip("distributed", reason="the extra campaign is not installed").KilledWorker
cluster = pytest.importorskip(
    "scanner_sim.campaign.cluster", reason="the extra campaign is not installed", exc_type=ImportError
)


@pytest.fixture
def plan(tmp_path: Path, small_scenario: str) -> Path:
    (tmp_path / "small.yaml").write_text(small_scenario, encoding="utf-8")
    (tmp_path / "plan.yaml").write_text("schema: 1\nbase: small.yaml\nrepeat: 20\n", encoding="utf-8")
    return tmp_path / "plan.yaml"


@pytest.mark.parametrize(
    ("workers", "gpus", "seen"),
    [
        (2, (), [None, None]),
        (2, ("0", "1"), ["0", "1"]),
        (1, ("3", "GPU-5"), ["3"]),
    ],
)
def test_a_worker_sees_the_gpu_of_its_own(
    workers: int, gpus: tuple[str, ...], seen: list[str | None]
) -> None:
    """Claim: a process of one thread for each GPU, and CUDA is shown no other."""
    specs = cluster.worker_specs(workers, gpus)
    assert [spec["options"].get("env", {}).get("CUDA_VISIBLE_DEVICES") for spec in specs] == seen
    assert {spec["options"]["nthreads"] for spec in specs} == {1}


def test_workers_of_this_machine_are_as_many_as_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: without a scheduler they are started here, numbered from 0, one for each GPU; with one nothing is."""
    asked: list[tuple[str, Any]] = []

    class Local(contextlib.nullcontext):  # type: ignore[type-arg]
        def __str__(self) -> str:
            return "local"

    def started(**more: Any) -> Any:
        asked.append(
            ("cluster", {number: spec["options"].get("env") for number, spec in more["workers"].items()})
        )
        return Local()

    def client(*given: Any, **more: Any) -> Any:
        asked.append(("client", given))
        return contextlib.nullcontext(f"client of {given[0]}")

    monkeypatch.setattr(cluster, "SpecCluster", started)
    monkeypatch.setattr(cluster, "Client", client)
    for gpus, envs in (((), [None] * 3), (("4", "7", "9"), [{"CUDA_VISIBLE_DEVICES": one} for one in "479"])):
        with cluster.client_of(3, None, gpus) as found:
            assert found == "client of local"
        (one, seen), (other, given) = asked
        assert (one, seen, other) == ("cluster", dict(enumerate(envs)), "client")
        assert len(given) == 1
        asked.clear()
    with cluster.client_of(3, "tcp://there:1") as found:
        assert found == "client of tcp://there:1"
    assert asked == [("client", ("tcp://there:1",))]


def test_a_run_kills_its_worker_eleven_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: ten deaths of its worker do not end a run on this machine, but one more does, as the guide says; what the
    process has for other clusters of its own comes back."""
    key, config = "distributed.scheduler.allowed-failures", cluster.dask.config
    before = config.get(key)
    deaths: list[int] = []

    def started(**_: Any) -> Any:
        # Dask's scheduler reads it when it is made.
        deaths.append(config.get(key))
        return contextlib.nullcontext()

    monkeypatch.setattr(cluster, "SpecCluster", started)
    monkeypatch.setattr(cluster, "Client", contextlib.nullcontext)
    with cluster.client_of(1, None):
        assert deaths == [10]
    assert config.get(key) == before != 10


@pytest.mark.slow
def test_dask_shows_its_processes_what_was_asked() -> None:
    with cluster.client_of(2, None, ("4", "7")) as client:
        seen = client.run(os.getenv, "CUDA_VISIBLE_DEVICES")
    assert sorted(seen.values()) == ["4", "7"]


class Driver:
    """A CUDA driver with three GPUs."""

    def cuDeviceGetCount(self, count: object) -> int:
        ctypes.cast(count, ctypes.POINTER(ctypes.c_int))[0] = 3
        return 0


@pytest.mark.parametrize(
    ("gpu", "chosen", "seen"),
    [("H100", None, ("0", "1", "2")), ("H100", "2, GPU-8f", ("2", "GPU-8f")), (None, "0", ())],
)
def test_the_gpus_are_those_that_the_user_leaves_visible(
    monkeypatch: pytest.MonkeyPatch, gpu: str | None, chosen: str | None, seen: tuple[str, ...]
) -> None:
    monkeypatch.setattr(libraries, "gpu_name", lambda: gpu)
    monkeypatch.setattr(ctypes, "CDLL", lambda name: Driver())
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    if chosen is not None:
        monkeypatch.setenv("CUDA_VISIBLE_DEVICES", chosen)
    assert libraries.visible_gpus.__wrapped__() == seen


def test_workers_are_as_many_as_gpus_and_no_more(plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: without --workers one for each GPU; more than there are is refused before anything is written."""
    asked: list[tuple[object, ...]] = []

    @contextlib.contextmanager
    def client_of(*words: object) -> Iterator[None]:
        asked.append(words)
        yield None

    monkeypatch.setattr(device_module, "activate", lambda device: SimpleNamespace(gpu="H100"))
    monkeypatch.setattr(libraries, "visible_gpus", lambda: ("0", "1", "2"))
    monkeypatch.setattr(cluster, "client_of", client_of)
    monkeypatch.setattr(cluster, "run_on", lambda *words: None)
    words = ["campaign", str(plan), "-o", str(plan.parent / "out"), "--quiet"]
    refused = CliRunner().invoke(app, [*words, "--workers", "4"])
    assert (refused.exit_code, "4 workers need a GPU each, and 3 can be seen" in refused.stderr) == (2, True)
    assert not (plan.parent / "out").exists()
    assert CliRunner().invoke(app, words).exit_code == 0
    assert asked == [(3, None, ("0", "1", "2"))]


class Ready:
    """Futures that end in the order in which they were sent; those that nobody may take never end."""

    def __init__(self) -> None:
        self.waiting: list[SimpleNamespace] = []

    def add(self, future: SimpleNamespace) -> None:
        if future.status != "pending":
            self.waiting.append(future)

    def __iter__(self) -> Iterator[SimpleNamespace]:
        while self.waiting:
            yield self.waiting.pop(0)


class Client:
    """Two workers that die of run 2, and take with them all that is on its way to them, as Dask counts it.

    One that is ``gone`` takes nothing: what is bound to it waits.
    """

    loop = None

    def __init__(self, campaign: Campaign, gone: str = "") -> None:
        self.campaign, self.gone, self.sent = campaign, gone, list[list[int]]()
        self.ready, self.beside, self.wished = Ready(), list[str](), list[str]()

    def nthreads(self) -> dict[str, int]:
        return {"tcp://a": 1, "tcp://b": 1}

    def wait_for_workers(self, *_: object, **__: object) -> None:
        pass

    def submit(
        self,
        _: object,
        task: Task,
        *,
        workers: list[str] | None,
        allow_other_workers: bool = False,
        **__: object,
    ) -> SimpleNamespace:
        runs = [job.run for job in task.jobs]
        self.sent.append(runs)
        self.wished += workers or ()
        if workers is None:  # to be done alone
            # Dask refuses others beside nobody.
            assert not allow_other_workers
            self.beside += [future.key for future in self.ready.waiting]
        waits = workers == [self.gone] and not allow_other_workers
        dies = 2 in runs or (len(runs) > 1 and 7 not in runs)
        rows = tuple(Row(run, self.campaign.seed(run), "", 0.1, {"sigma_range": 0.1}) for run in runs)
        return SimpleNamespace(
            key=str(runs),
            status="pending" if waits else "error" if dies else "finished",
            result=lambda: rows,
            exception=lambda: KilledWorker("task", None, 10),
            release=lambda: None,
        )


def test_a_run_that_kills_its_worker_is_a_row_and_those_beside_it_have_theirs(
    plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: runs that Dask gives up with others are done again, each with nothing on its way; one has the fault."""
    campaign = read_campaign(plan)
    client, most = Client(campaign), list[int]()
    monkeypatch.setattr(cluster, "as_completed", lambda **_: client.ready)
    with opened(plan.parent / "out", campaign, campaign.plan.measure) as store:
        cluster.run_on(client, store, Settings(plan.parent / "out"), lambda done, *_: most.append(done))
        (table,) = store.rows()
    faults = dict(zip(table["run"].tolist(), table["fault"].tolist(), strict=True))
    assert faults == {run: "its worker died 11 times." if run == 2 else "" for run in range(20)}
    together = [runs for runs in client.sent if len(runs) > 1]
    assert client.sent[: len(together)] == together, "alone means after all others"
    assert client.beside == [], "and with nothing on its way"
    assert most[-1] == 20


def test_batches_for_a_worker_that_is_gone_are_done_by_the_other(
    plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Claim: each batch is wished to a worker, one in turn to each, and bound to none: where one takes nothing any more
    all runs have a row."""
    campaign = read_campaign(plan)
    client = Client(campaign, gone="tcp://b")
    monkeypatch.setattr(cluster, "as_completed", lambda **_: client.ready)
    with opened(plan.parent / "out", campaign, campaign.plan.measure) as store:
        cluster.run_on(client, store, Settings(plan.parent / "out"), lambda *_: None)
        assert store.done.all()
    assert client.wished[:4] == ["tcp://a", "tcp://b"] * 2


@pytest.mark.parametrize("away", [1, 2, 3])
def test_a_campaign_outlives_looks_that_find_no_worker(
    plan: Path, monkeypatch: pytest.MonkeyPatch, away: int
) -> None:
    """Claim: while there is none, as when the only one is restarted, at the start or later, what is left waits: each
    run is done and has its row, in batches again where the worker is back."""
    campaign = read_campaign(plan)
    client, looks = Client(campaign), cycle([*away * [{}], {"tcp://a": 1}])
    monkeypatch.setattr(client, "nthreads", lambda: next(looks))
    monkeypatch.setattr(cluster, "LOOKS", -1.0)
    monkeypatch.setattr(cluster, "as_completed", lambda **_: client.ready)
    with opened(plan.parent / "out", campaign, campaign.plan.measure) as store:
        cluster.run_on(client, store, Settings(plan.parent / "out"), lambda *_: None)
        (table,) = store.rows()
    assert sorted(table["run"].tolist()) == list(range(20))
    assert [run for run, fault in zip(table["run"], table["fault"], strict=True) if fault] == [2]
    assert max(map(len, client.sent)) > 1


def test_workers_of_several_threads_are_refused(plan: Path) -> None:
    """Claim: the renderer shares its settings among the threads of a process, so such a cluster is no cluster."""
    fake = SimpleNamespace(
        nthreads=lambda: {"tcp://a": 1, "tcp://b": 8}, wait_for_workers=lambda *_, **__: None, loop=object()
    )
    campaign = read_campaign(plan)
    with (
        opened(plan.parent / "out", campaign, campaign.plan.measure) as store,
        pytest.raises(InputError, match="several threads"),
    ):
        cluster.run_on(fake, store, Settings(plan.parent / "out"), lambda *_: None)


def test_workers_are_looked_for_once_a_second(plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Claim: what came or went is seen after a second, and not asked for at each batch."""
    clock, there = [1000.0], [{"tcp://a": 1}]
    asked: list[float] = []
    monkeypatch.setattr(cluster.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(cluster, "as_completed", lambda **_: Ready())
    fake = SimpleNamespace(nthreads=lambda: asked.append(clock[0]) or there[0], loop=None)
    campaign = read_campaign(plan)
    with opened(plan.parent / "out", campaign, campaign.plan.measure) as store:
        dispatch = cluster._Dispatch(fake, store, Settings(plan.parent / "out"))
    assert dispatch._present() == ("tcp://a",)
    there[0] = {"tcp://a": 1, "tcp://b": 1}
    for moment, seen in ((1000.9, ("tcp://a",)), (1001.1, ("tcp://a", "tcp://b"))):
        clock[0] = moment
        assert dispatch._present() == seen
    assert asked == [1000.0, 1001.1]


@pytest.mark.parametrize("done", [0, 3, 20])
def test_a_cluster_that_ends_early_is_lost(plan: Path, monkeypatch: pytest.MonkeyPatch, done: int) -> None:
    """Claim: where batches end before all runs have a row, it is said, and the rows before stay; those of a whole
    campaign are one part in Parquet, as the manual has users read them."""
    campaign = read_campaign(plan)
    future = SimpleNamespace(release=lambda: None)
    rows = [Row(run, campaign.seed(run), "", 0.1, {"sigma_range": 0.1}) for run in range(done)]
    monkeypatch.setattr(cluster, "as_completed", lambda **_: [future] if done else [])
    monkeypatch.setattr(cluster._Dispatch, "fill", lambda self: None)
    monkeypatch.setattr(cluster._Dispatch, "received", lambda self, future: rows)
    fake = SimpleNamespace(wait_for_workers=lambda *_, **__: None, loop=None)
    ends = contextlib.nullcontext() if done == 20 else pytest.raises(RunError, match="scheduler is lost")
    with opened(plan.parent / "out", campaign, campaign.plan.measure) as store:
        with ends:
            cluster.run_on(fake, store, Settings(plan.parent / "out"), lambda *_: None)
        assert store.done.sum() == done
    parts = [
        read_parquet(path)[0]["run"].tolist() for path in (plan.parent / "out" / PARTS).glob("*.parquet")
    ]
    assert parts == ([list(range(20))] if done == 20 else [])
