"""A tracking run from a scenario, as a whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from scanner_sim.config.scenario import Scenario
from scanner_sim.instrument.closed_loop.tracker import Tracker, made_by
from scanner_sim.instrument.memory import check_patterns
from scanner_sim.render.guest import guest
from scanner_sim.render.libraries import DeviceChoice
from scanner_sim.tracking.record import PatternRecord, Track, TrackStatus, TrackTarget

Progress = Callable[[float, float], None]
"""Called with the time that is done and the time in all [s]."""


@guest()
def track(
    scenario: Scenario,
    *,
    device: DeviceChoice = "auto",
    threads: int | None = None,
    progress: Progress | None = None,
) -> Track:
    """Follow the targets of a scenario for the time that it says.

    Parameters
    ----------
    scenario
        Instrument, scene and a scan of type ``track``.
    device, threads
        Where to compute; the result does not depend on the threads.
    progress
        Called after each visit.

    Returns
    -------
    Track

    Raises
    ------
    ScenarioError
        If the scene cannot be loaded.
    InputError
        If the device cannot be used, the scenario scans a raster, or the memory that is free does not hold the result.
    """
    check_patterns(scenario)
    tracker = Tracker(scenario, device=device, threads=threads)
    records = []
    for record in tracker:
        records.append(record)
        if progress is not None:
            progress(min(tracker.state.clock, tracker.scan.duration), tracker.scan.duration)
    return track_of(tracker, tuple(records))


def track_of(tracker: Tracker, records: tuple[PatternRecord, ...]) -> Track:
    """Return a run of a tracker with everything that is kept of it beside its records."""
    return Track(
        records=records,
        targets=tracker.targets,
        seed=tracker.scenario.seed,
        scenario_yaml=tracker.scenario_yaml,
        made_by=made_by(),
        warnings=tuple(_warnings(tracker.targets, records)),
    )


def _warnings(targets: tuple[TrackTarget, ...], records: tuple[PatternRecord, ...]) -> Iterator[str]:
    """Yield sentences on results that look unintended."""
    for target in targets:
        own = [record for record in records if record.target == target.name]
        if not own:
            yield f"'{target.name}' was never visited: the run is too short"
        elif not any(record.status == TrackStatus.MEASURED for record in own):
            most = max(set(TrackStatus), key=lambda code: sum(record.status == code for record in own))
            yield f"'{target.name}' was never measured; mostly: {most.sentence}"
