"""A run as a whole, from the records of its visits."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from scanner_sim.config import resolved_yaml
from scanner_sim.config.scenario import Scenario
from scanner_sim.products.provenance import versions
from scanner_sim.ranging.axes import Axes
from scanner_sim.tracking.record import PatternRecord, Track, TrackStatus, TrackTarget


def made_by() -> str:
    """Return name and version of the program."""
    return f"scanner-sim {versions()['scanner-sim']}"


def track_of(
    scenario: Scenario, records: tuple[PatternRecord, ...], axes: Axes, said: Iterable[str] = ()
) -> Track:
    """Return a run of a scenario with everything that is kept of it beside its records.

    ``axes`` of the mirrors are those that its instrument believes; ``said`` are warnings about the scene.
    """
    return Track(
        records=records,
        targets=scenario.targets,
        seed=scenario.seed,
        scenario_yaml=resolved_yaml(scenario),
        made_by=made_by(),
        axes=axes,
        warnings=(*said, *_warnings(scenario.targets, records)),
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
