"""A campaign on Dask: on processes of this machine, or on a cluster by the address of its scheduler.

The scheduler is Dask's. Here stands which batches are on their way, and that a row is written the moment it comes.
"""

from __future__ import annotations

import contextlib
import logging
import pickle
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import dask
import numpy as np
from distributed import Client, Future, KilledWorker, Nanny, Scheduler, SpecCluster, as_completed

from scanner_sim.campaign.batches import Batches
from scanner_sim.campaign.serial import Progress
from scanner_sim.campaign.store import Row, Store
from scanner_sim.campaign.work import Settings, task_of, work
from scanner_sim.foundation.errors import InputError, RunError

DEATHS = 10
"""Deaths of its worker after which a run is given up: one that takes more memory than there is kills each."""
AHEAD = 2
"""Batches on their way to each worker: enough that none waits, few enough that the scheduler's memory stays flat."""
LOOKS = 1.0
"""Seconds between two looks at which workers there are: a cluster's come one by one, and go."""

WAITS = 600
"""Seconds to wait for the first worker: on a cluster its job may be queued."""

_HERE = {"host": "127.0.0.1", "dashboard": False, "dashboard_address": "127.0.0.1:0"}
"""Nothing of a cluster on this machine can be reached from another one."""

Rows = tuple[Row, ...]


@contextlib.contextmanager
def client_of(workers: int, scheduler: str | None, gpus: Sequence[str] = ()) -> Iterator[Client]:
    """Connect to a scheduler, or start workers on this machine: a process and one thread for each.

    Parameters
    ----------
    workers
        Their number on this machine.
    scheduler
        Address of a scheduler; None starts workers.
    gpus
        The GPU of each worker, as CUDA names it; none where they compute on the processor.

    Raises
    ------
    InputError
        If there is no scheduler at that address.
    RunError
        If a worker on this machine does not start.
    """
    with contextlib.ExitStack() as stack:
        stack.enter_context(
            dask.config.set(
                {
                    "distributed.scheduler.allowed-failures": DEATHS,
                    "distributed.worker.daemon": True,
                    "distributed.admin.tick.limit": "1h",
                }
            )
        )
        if scheduler is None:
            try:
                local = SpecCluster(
                    workers=dict(enumerate(worker_specs(workers, gpus))),
                    scheduler={"cls": Scheduler, "options": {**_HERE, "port": 0}},
                    silence_logs=logging.CRITICAL,
                )
            except RuntimeError as error:
                # One that is killed before it has begun ends the start of all.
                raise RunError(
                    f"the workers did not start: {error}", remedy="The same command goes on."
                ) from None
            stack.enter_context(local)
            yield stack.enter_context(Client(local))
            return
        try:
            client = Client(scheduler, timeout=20, name="scanner-sim")
        except (OSError, ValueError, TimeoutError) as error:
            raise InputError(
                f"there is no Dask scheduler at {scheduler}: {error}.",
                remedy="Start one with: dask scheduler",
            ) from None
        yield stack.enter_context(client)


def worker_specs(workers: int, gpus: Sequence[str]) -> list[dict[str, Any]]:
    """Return what Dask is asked for: processes of one thread, each of which sees the GPU of its own and no other."""
    options = {
        **_HERE,
        "nthreads": 1,
        # A run asks for memory itself, and is refused with a sentence.
        "memory_limit": 0,
        "silence_logs": logging.CRITICAL,
    }
    seen: list[dict[str, Any]] = [{"env": {"CUDA_VISIBLE_DEVICES": gpu}} for gpu in gpus]
    return [{"cls": Nanny, "options": options | own} for own in (seen[:workers] or [{}] * workers)]


class _Dispatch:
    """The batches that are on their way to workers.

    Batches of one set go to the worker that has its scene. That is a wish: where this worker is gone, or another has
    nothing to do, Dask gives them away. When a worker dies, Dask counts it against all that was on its way to it. The
    runs of a batch that is given up for that are therefore done at the end, each with nothing else on its way: what
    kills its worker then is the run.
    """

    def __init__(self, client: Client, store: Store, settings: Settings) -> None:
        self._client, self._campaign, self._settings = client, store.campaign, settings
        self._base = pickle.dumps(store.campaign.base)
        self._batches = Batches(store.campaign, np.flatnonzero(~store.done))
        self._sent: dict[object, tuple[str, list[int]]] = {}
        self._suspects: list[int] = []
        self._workers: tuple[str, ...] = ()
        self._looked = -LOOKS
        self.ready = as_completed(raise_errors=False, loop=client.loop)

    def fill(self) -> None:
        """Send batches until each worker has some, one in turn to each."""
        on_way = [worker for worker, _ in self._sent.values()]
        for _ in range(AHEAD):
            for worker in self._present() if len(self._batches) else ():
                if on_way.count(worker) < AHEAD and (runs := self._batches.take(worker, len(self._workers))):
                    self._send(runs, worker)
                    on_way.append(worker)
        if not self._sent and not self._suspects:
            # No worker is there, as while the only one is restarted: one run waits for the next that comes.
            self._suspects += self._batches.take("", len(self._batches))
        if not self._sent and self._suspects:
            self._send([self._suspects.pop()], "")

    def _send(self, runs: list[int], worker: str) -> None:
        """Send a batch to a worker, or where Dask likes."""
        task = task_of(self._campaign, self._base, runs, self._settings)
        # Not pure: two campaigns on one cluster are no one another's results.
        future = self._client.submit(
            work, task, pure=False, workers=[worker] if worker else None, allow_other_workers=bool(worker)
        )
        self._sent[future.key] = (worker, runs)
        self.ready.add(future)

    def received(self, future: Future[Rows]) -> Rows:
        """Return the rows of a batch that has ended: none yet where its runs are to be done one by one."""
        worker, runs = self._sent.pop(future.key)
        if future.status == "finished":
            return future.result()
        if future.status != "error":
            raise _lost()
        if worker:
            self._suspects += runs
            return ()
        error = future.exception()
        if isinstance(error, KilledWorker):
            # A scheduler of the user's has a limit of its own.
            fault = f"its worker died {getattr(error, 'allowed_failures', DEATHS) + 1} times."
        else:
            fault = f"unexpected {type(error).__name__}: {error}"
        (job,) = task_of(self._campaign, self._base, runs, self._settings).jobs
        return (job.failed(fault),)

    def _present(self) -> tuple[str, ...]:
        """Return the addresses of the workers; faults as of :func:`run_on`."""
        if time.monotonic() - self._looked > LOOKS:
            threads = self._client.nthreads()
            if max(threads.values(), default=1) > 1:
                raise InputError(
                    "a worker of this cluster has several threads, and the renderer works in one.",
                    remedy="Start workers with --nthreads 1, as many as there are cores.",
                )
            self._workers, self._looked = tuple(threads), time.monotonic()
        return self._workers


def run_on(client: Client, store: Store, settings: Settings, progress: Progress) -> None:
    """Do the runs that have no row yet on the workers of a cluster.

    Raises
    ------
    InputError
        If its workers have more than one thread.
    RunError
        If the disk is full or fails, no worker comes, or the scheduler is lost: the rows before stay.
    """
    dispatch = _Dispatch(client, store, replace(settings, threads=1))
    try:
        client.wait_for_workers(1, timeout=WAITS)
    except TimeoutError:
        raise RunError(
            f"the scheduler has had no worker for {WAITS} s.",
            remedy="Start workers; the same command goes on.",
        ) from None
    try:
        dispatch.fill()
        for future in dispatch.ready:
            for row in dispatch.received(future):
                store.add(row)
            future.release()
            progress(int(store.done.sum()), len(store.done), store.failed)
            dispatch.fill()
    except (OSError, TimeoutError) as error:
        raise _lost(f": {error}") from None
    if not store.done.all():
        raise _lost()
    store.pack()


def _lost(why: str = "") -> RunError:
    return RunError(
        f"the scheduler is lost{why}; every row before stays.", remedy="The same command goes on."
    )
