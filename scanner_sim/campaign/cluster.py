"""A campaign on Dask: on processes of this machine, or on a cluster by the address of its scheduler.

The scheduler is Dask's. Here stands which runs are on their way, and that a row is written the moment it comes.
"""

from __future__ import annotations

import contextlib
import logging
import pickle
from collections.abc import Iterator
from dataclasses import replace

import dask
import numpy as np
from distributed import Client, Future, KilledWorker, LocalCluster, as_completed

from scanner_sim.campaign.runs import SEED
from scanner_sim.campaign.serial import Progress
from scanner_sim.campaign.store import Row, Store
from scanner_sim.campaign.work import Settings, task_of, work
from scanner_sim.foundation.errors import InputError, RunError

DEATHS = 10
"""Deaths of its worker after which a run is given up: one that takes more memory than there is kills each."""
AHEAD = 3
"""Runs on their way to each worker: enough that none waits, few enough that the scheduler's memory stays flat."""


@contextlib.contextmanager
def client_of(workers: int, scheduler: str | None) -> Iterator[Client]:
    """Connect to a scheduler, or start workers on this machine: a process and one thread for each.

    Raises
    ------
    InputError
        If there is no scheduler at that address.
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
            local = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                dashboard_address=None,
                # A run asks for memory itself, and is refused with a sentence.
                memory_limit=0,
                silence_logs=logging.CRITICAL,
            )
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


def run_on(client: Client, store: Store, settings: Settings, progress: Progress) -> None:
    """Do the runs that have no row yet on the workers of a cluster.

    Raises
    ------
    RunError
        If the disk is full or fails, or the scheduler is lost: the rows before stay.
    """
    settings = replace(settings, threads=1)
    base = pickle.dumps(store.campaign.base)
    left = iter(np.flatnonzero(~store.done).tolist())
    numbers: dict[object, int] = {}

    def sent(count: int) -> list[Future[Row]]:
        futures = []
        for run in (next(left, None) for _ in range(count)):
            if run is None:
                break
            task = task_of(store.campaign, base, run, settings)
            # Not pure: two campaigns on one cluster are no one another's results.
            future = client.submit(work, task, pure=False)
            numbers[future.key] = run
            futures.append(future)
        return futures

    client.wait_for_workers(1, timeout=120)
    ready = as_completed(sent(AHEAD * max(len(client.nthreads()), 1)), raise_errors=False)
    try:
        for future in ready:
            run = numbers.pop(future.key)
            store.add(_row(future, run, store))
            future.release()
            progress(int(store.done.sum()), len(store.done), store.failed)
            for another in sent(1):
                ready.add(another)
    except (OSError, TimeoutError) as error:
        raise RunError(
            f"the scheduler is lost: {error}; every row before stays.", remedy="The same command goes on."
        ) from None
    if not store.done.all():
        raise RunError("the scheduler is lost; every row before stays.", remedy="The same command goes on.")
    store.pack()


def _row(future: Future[Row], run: int, store: Store) -> Row:
    """Return the row of a run that has ended, with its fault where its worker did not survive it."""
    if future.status == "finished":
        return future.result()
    if future.status == "error":
        error = future.exception()
        died = isinstance(error, KilledWorker)
        fault = (
            f"its worker died {DEATHS + 1} times." if died else f"unexpected {type(error).__name__}: {error}"
        )
        seed = store.campaign.changes(run)[SEED]
        return Row(run, seed if isinstance(seed, int) else -1, fault, 0.0, {})
    raise RunError("the scheduler is lost; every row before stays.", remedy="The same command goes on.")
