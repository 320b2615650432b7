"""A campaign in this process, batch after batch."""

from __future__ import annotations

import pickle
from collections.abc import Callable

import numpy as np

from scanner_sim.campaign.batches import Batches
from scanner_sim.campaign.store import Store
from scanner_sim.campaign.work import Settings, task_of, work

Progress = Callable[[int, int, int], None]
"""Called with the runs done, those in all, and those that failed."""


def run_serially(store: Store, settings: Settings, progress: Progress) -> None:
    """Do the runs that have no row yet; faults as of :meth:`~scanner_sim.campaign.store.Store.add`."""
    base = pickle.dumps(store.campaign.base)
    batches = Batches(store.campaign, np.flatnonzero(~store.done))
    while runs := batches.take("this process"):
        for row in work(task_of(store.campaign, base, runs, settings)):
            store.add(row)
        progress(int(store.done.sum()), len(store.done), store.failed)
    store.pack()
