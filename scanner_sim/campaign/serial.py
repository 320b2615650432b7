"""A campaign in this process, run after run."""

from __future__ import annotations

import pickle
from collections.abc import Callable

import numpy as np

from scanner_sim.campaign.store import Store
from scanner_sim.campaign.work import Settings, task_of, work

Progress = Callable[[int, int, int], None]
"""Called with the runs done, those in all, and those that failed."""


def run_serially(store: Store, settings: Settings, progress: Progress) -> None:
    """Do the runs that have no row yet; faults as of :meth:`~scanner_sim.campaign.store.Store.add`."""
    base = pickle.dumps(store.campaign.base)
    for run in np.flatnonzero(~store.done).tolist():
        store.add(work(task_of(store.campaign, base, run, settings)))
        progress(int(store.done.sum()), len(store.done), store.failed)
    store.pack()
