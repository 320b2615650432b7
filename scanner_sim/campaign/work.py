"""One run of a campaign: its scenario simulated and measured, its fault told where it has one."""

from __future__ import annotations

import pickle
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from scanner_sim.campaign.measures import MEASURES, Outcome, measured
from scanner_sim.campaign.own_measure import OwnMeasure
from scanner_sim.campaign.runs import SEED, Campaign, changed
from scanner_sim.campaign.store import KEPT, Row
from scanner_sim.config.document import Value
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import ScannerSimError, printable
from scanner_sim.instrument.closed_loop.poses import poses_of
from scanner_sim.instrument.closed_loop.track import track
from scanner_sim.instrument.memory import check_memory
from scanner_sim.instrument.shots import simulate_shots
from scanner_sim.instrument.simulate import simulate
from scanner_sim.pose.series import PoseSeries
from scanner_sim.products.files.run_folder import write_run
from scanner_sim.products.files.shots_folder import write_shots
from scanner_sim.products.files.track_folder import write_track
from scanner_sim.products.image import RangeImage
from scanner_sim.products.shots import ShotTable
from scanner_sim.render.device import activate
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.signals.named import NO_ESTIMATORS, NamedEstimators

LONGEST_FAULT = 900
"""Letters of a fault in a row."""


@dataclass(frozen=True)
class Task:
    """What a worker needs for a run, small enough to be sent ten thousand times.

    Attributes
    ----------
    base
        The base scenario, pickled: workers keep the last one.
    changes
        What the run has in the place of its values.
    folder
        Where relative paths in them count from.
    run
        Number of the run.
    measures, own
        Measures by name, and that of the user.
    estimators
        Those of the user.
    kept
        Folder for the whole result; None where it is not kept.
    device, threads
        Where to compute.
    """

    base: bytes
    changes: Mapping[str, Value]
    folder: Path
    run: int
    measures: tuple[str, ...]
    own: OwnMeasure | None
    estimators: NamedEstimators
    kept: Path | None
    device: DeviceChoice
    threads: int | None


@dataclass(frozen=True)
class Settings:
    """What all runs of a campaign have in common beside its plan."""

    folder: Path
    own: OwnMeasure | None = None
    device: DeviceChoice = "auto"
    threads: int | None = None
    estimators: NamedEstimators = NO_ESTIMATORS


def task_of(campaign: Campaign, base: bytes, run: int, settings: Settings) -> Task:
    """Return the task of a run; ``base`` is the campaign's base scenario, pickled."""
    keep = campaign.plan.keep.runs
    kept = keep == "all" or (not isinstance(keep, str) and run in keep)
    return Task(
        base,
        campaign.changes(run),
        campaign.folder,
        run,
        campaign.plan.measure,
        settings.own,
        settings.estimators,
        settings.folder.absolute() / KEPT / f"{run:06d}" if kept else None,
        settings.device,
        settings.threads,
    )


@lru_cache(maxsize=1)
def _base(content: bytes) -> Scenario:
    found: Scenario = pickle.loads(content)
    return found


@lru_cache(maxsize=1)
def _ready(device: DeviceChoice, threads: int | None) -> None:
    """Choose the device for all runs of this process, so that none looks for its libraries again."""
    activate(device, threads)


def work(task: Task) -> Row:
    """Simulate and measure a run; whatever goes wrong is the fault of its row."""
    start, found, fault = time.perf_counter(), dict[str, float](), ""
    try:
        _ready(task.device, task.threads)
        task.estimators.register()
        scenario = changed(_base(task.base), task.changes, task.folder, f"run {task.run}")
        outcome = simulated(scenario, task.device, task.threads)
        found = measured(tuple(name for name in task.measures if name in MEASURES), outcome)
        if task.own is not None:
            found[task.own.column] = task.own.value(outcome)
        if task.kept is not None:
            write_outcome(outcome, scenario, task.kept)
    except ScannerSimError as error:
        fault = str(error)
    except MemoryError:
        fault = "the memory is exhausted."
    except Exception as error:
        fault = f"unexpected {type(error).__name__}: {error}"
    said = printable(" ".join(fault.split()))[:LONGEST_FAULT]
    seed = task.changes[SEED]
    return Row(
        task.run,
        seed if isinstance(seed, int) else -1,
        said,
        time.perf_counter() - start,
        {} if fault else found,
    )


def simulated(scenario: Scenario, device: DeviceChoice, threads: int | None) -> Outcome:
    """Simulate a scenario of any kind; faults as of :func:`~scanner_sim.instrument.simulate.simulate`."""
    check_memory(scenario)
    if scenario.scan.layout == "image":
        return Outcome(scan=simulate(scenario, device=device, threads=threads))
    if scenario.scan.layout == "shots":
        return Outcome(scan=simulate_shots(scenario, device=device, threads=threads))
    made = track(scenario, device=device, threads=threads)
    poses: tuple[PoseSeries, ...] = poses_of(made)
    return Outcome(track=made, poses=tuple(one for one in poses if not one.relative_to))


def write_outcome(outcome: Outcome, scenario: Scenario, folder: Path) -> tuple[Path, ...]:
    """Write a whole result as ``scanner-sim run`` does, without the photograph and waveforms; return the files."""
    output = scenario.output
    if outcome.track is not None:
        plain = output.changed(pictures=False)
        return write_track(outcome.track, folder, plain, poses=outcome.poses, overwrite=True)
    if isinstance(outcome.scan, ShotTable):
        return write_shots(outcome.scan, folder, output, overwrite=True)
    assert isinstance(outcome.scan, RangeImage)
    return write_run(outcome.scan, folder, output, overwrite=True)
