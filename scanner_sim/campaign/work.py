"""Runs of a campaign: their scenarios simulated together and measured, the fault of each told in its row."""

from __future__ import annotations

import contextlib
import pickle
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from pathlib import Path

from scanner_sim.campaign.measures import MEASURES, Outcome, measured
from scanner_sim.campaign.own_measure import OwnMeasure
from scanner_sim.campaign.runs import SEED, Campaign, changed
from scanner_sim.campaign.store import KEPT, Row
from scanner_sim.config.document import Value
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError, ScannerSimError, printable
from scanner_sim.instrument.camera_poses import KeepFrame
from scanner_sim.instrument.closed_loop.every_pose import every_pose
from scanner_sim.instrument.closed_loop.track import check_alike, track_many
from scanner_sim.instrument.shots import simulate_shots
from scanner_sim.instrument.simulate import simulate_many
from scanner_sim.products.files.frame_files import KeptFrames, kept_frames
from scanner_sim.products.files.run_folder import write_run
from scanner_sim.products.files.shots_folder import write_shots
from scanner_sim.products.files.track_folder import write_track
from scanner_sim.products.image import RangeImage
from scanner_sim.products.shots import ShotTable
from scanner_sim.render.device import activate
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.signals.named import NO_ESTIMATORS, NamedEstimators
from scanner_sim.tracking.record import Track

Made = RangeImage | ShotTable | Track
"""What a run gives before it is measured."""

LONGEST_FAULT = 900
"""Letters of a fault in a row."""


@dataclass(frozen=True)
class Job:
    """A run that is to be done.

    Attributes
    ----------
    run
        Its number.
    values
        What it has in the place of the base's values, but for its seed.
    seed
        Seed of its random numbers; -1 where the plan has put something else there.
    kept
        Folder for the whole result; None where it is not kept.
    """

    run: int
    values: Mapping[str, Value]
    seed: int
    kept: Path | None

    def failed(self, fault: str, seconds: float = 0.0) -> Row:
        """Return its row with a fault."""
        said = printable(" ".join(fault.split()))[:LONGEST_FAULT]
        return Row(self.run, self.seed, said, seconds, {})


@dataclass(frozen=True)
class Task:
    """What a worker needs for a batch of runs, small enough to be sent ten thousand times.

    Attributes
    ----------
    base
        The base scenario, pickled: workers keep the last one.
    folder
        Where relative paths in the runs' values count from.
    jobs
        The runs.
    measures, own
        Measures by name, and that of the user.
    estimators
        Those of the user.
    device, threads
        Where to compute.
    """

    base: bytes
    folder: Path
    jobs: tuple[Job, ...]
    measures: tuple[str, ...]
    own: OwnMeasure | None
    estimators: NamedEstimators
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


def task_of(campaign: Campaign, base: bytes, runs: Sequence[int], settings: Settings) -> Task:
    """Return the task of a batch of runs; ``base`` is the campaign's base scenario, pickled."""
    return Task(
        base,
        campaign.folder,
        tuple(_job(campaign, run, settings.folder.absolute() / KEPT) for run in runs),
        campaign.plan.measure,
        settings.own,
        settings.estimators,
        settings.device,
        settings.threads,
    )


def _job(campaign: Campaign, run: int, kept: Path) -> Job:
    values, keep = campaign.values(run), campaign.plan.keep.runs
    seed = values.get(SEED, campaign.seed(run))
    keeps = keep == "all" or (not isinstance(keep, str) and run in keep)
    return Job(run, values, seed if isinstance(seed, int) else -1, kept / f"{run:06d}" if keeps else None)


@lru_cache(maxsize=1)
def _base(content: bytes) -> Scenario:
    found: Scenario = pickle.loads(content)
    return found


class _Scenarios:
    """The scenarios of a task's runs; one that differs from the last in its seed alone is not checked again."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self._last: tuple[Mapping[str, Value], Scenario] | None = None

    def of(self, job: Job) -> Scenario:
        """Return the scenario of a run; faults as of :meth:`Campaign.scenario`."""
        if self._last is None or self._last[0] != job.values or SEED in job.values:
            base, folder = _base(self._task.base), self._task.folder
            self._last = job.values, changed(base, job.values, folder, f"run {job.run}")
        found = self._last[1]
        return found if SEED in job.values else found.model_copy(update={SEED: job.seed})


@lru_cache(maxsize=1)
def _ready(device: DeviceChoice, threads: int | None) -> None:
    """Choose the device for all runs of this process, so that none looks for its libraries again."""
    activate(device, threads)


def work(task: Task) -> tuple[Row, ...]:
    """Simulate and measure runs; whatever goes wrong with one is the fault of its row, and of no other."""
    start = time.perf_counter()
    found: list[tuple[Job, str, dict[str, float]]] = []
    possible: list[tuple[Job, Scenario]] = []
    scenarios = _Scenarios(task)
    for job in task.jobs:
        try:
            _ready(task.device, task.threads)
            task.estimators.register()
            possible.append((job, scenarios.of(job)))
        except Exception as error:
            found.append((job, _fault(error), {}))
    results = _results([scenario for _, scenario in possible], task.device, task.threads)
    for (job, scenario), made in zip(possible, results, strict=True):
        try:
            found.append((job, "", _measured(task, job, scenario, made)))
        except Exception as error:
            found.append((job, _fault(error), {}))
    # What is done together has no times of its own.
    seconds = (time.perf_counter() - start) / len(task.jobs)
    return tuple(
        job.failed(fault, seconds) if fault else Row(job.run, job.seed, "", seconds, measures)
        for job, fault, measures in found
    )


def _measured(task: Task, job: Job, scenario: Scenario, made: Made | Exception) -> dict[str, float]:
    """Return the measures of a run, and write its files where it is kept."""
    if isinstance(made, Exception):
        raise made
    with contextlib.ExitStack() as stack:
        frames = None
        if job.kept is not None and scenario.output.frames:
            frames = stack.enter_context(kept_frames(scenario.camera, job.kept))
        outcome = outcome_of(made, task.device, None if frames is None else frames.keep)
        found = measured(tuple(name for name in task.measures if name in MEASURES), outcome)
        if task.own is not None:
            found[task.own.column] = task.own.value(outcome)
        if job.kept is not None:
            write_outcome(outcome, scenario, job.kept, frames)
    return found


def _fault(error: Exception) -> str:
    if isinstance(error, ScannerSimError):
        return str(error)
    if isinstance(error, MemoryError):
        return "the memory is exhausted."
    return f"unexpected {type(error).__name__}: {error}"


def _results(
    scenarios: Sequence[Scenario], device: DeviceChoice, threads: int | None
) -> Iterator[Made | Exception]:
    """Yield what each scenario gave, or why it gave nothing: from where runs fail together they are made alone."""
    done = 0
    try:
        for made in simulated(scenarios, device, threads):
            yield made
            done += 1
    except Exception as error:
        if len(scenarios) == 1:
            yield error
            return
    for scenario in scenarios[done:]:
        yield from _results([scenario], device, threads)


def simulated(scenarios: Sequence[Scenario], device: DeviceChoice, threads: int | None) -> Iterator[Made]:
    """Simulate scenarios of any kind in their order, those together that are alike and next to one another.

    Raises
    ------
    ScannerSimError
        As :func:`~scanner_sim.instrument.simulate.simulate`.
    """
    for layout, some in groupby(scenarios, lambda scenario: scenario.scan.layout):
        if layout == "image":
            yield from simulate_many(some, device=device, threads=threads)
        elif layout == "shots":
            for scenario in some:
                yield simulate_shots(scenario, device=device, threads=threads)
        else:
            for alike in _side_by_side(some):
                yield from track_many(alike, device=device, threads=threads)


def _side_by_side(scenarios: Iterator[Scenario]) -> Iterator[list[Scenario]]:
    """Yield the scenarios in lists of those that are followed in lock-step."""
    waiting: list[Scenario] = []
    for scenario in scenarios:
        try:
            check_alike([*waiting[:1], scenario])
        except InputError:
            yield waiting
            waiting = []
        waiting.append(scenario)
    yield waiting


def outcome_of(made: Made, device: DeviceChoice = "auto", keep: KeepFrame | None = None) -> Outcome:
    """Return a result as measures take it: a track with its poses before the scanner; ``keep`` takes its frames."""
    if not isinstance(made, Track):
        return Outcome(scan=made)
    poses = every_pose(made, device=device, keep=keep)
    return Outcome(
        track=made, poses=tuple(one for one in poses if not one.relative_to), every_pose=tuple(poses)
    )


def write_outcome(
    outcome: Outcome, scenario: Scenario, folder: Path, frames: KeptFrames | None = None
) -> tuple[Path, ...]:
    """Write a whole result as ``scanner-sim run`` does, without photograph and waveforms; return the files."""
    output = scenario.output
    if outcome.track is not None:
        plain = output.changed(pictures=False)
        return write_track(
            outcome.track, folder, plain, poses=outcome.every_pose, frames=frames, overwrite=True
        )
    if isinstance(outcome.scan, ShotTable):
        return write_shots(outcome.scan, folder, output, overwrite=True)
    assert isinstance(outcome.scan, RangeImage)
    return write_run(outcome.scan, folder, output, overwrite=True)
