"""The verb ``pose-study``."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from scanner_sim.analytic.pose import facing_errors
from scanner_sim.cli.progress import progress_bar
from scanner_sim.cli.report import scenario_of
from scanner_sim.cli.scenarios import load_and_warn
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.config import resolved_yaml
from scanner_sim.pose.target_layouts import Layout
from scanner_sim.products.files.contents import POSE_STUDY
from scanner_sim.products.files.folder import claim_folder
from scanner_sim.products.pose_study import COMPONENTS, PoseRow, PoseStudy, TargetRow
from scanner_sim.render.libraries import DeviceChoice


def study_scenario(
    config: Path,
    folder: Path,
    overrides: Sequence[str],
    *,
    diameter: float | None,
    quick: bool,
    device: DeviceChoice,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Study the poses of arrays as a scenario's instrument measures them, into a folder.

    Raises
    ------
    ScannerSimError
        If the scenario, the folder or the device cannot be used, or the disk fails.
    """
    from scanner_sim.products.files.pose_study_folder import write_pose_study

    scenario = load_and_warn(config, overrides, quiet)
    from scanner_sim.validation.studies.pose_laws import exponents_of, gains_of
    from scanner_sim.validation.studies.pose_study import (
        BASE,
        REFERENCE,
        measure_study,
        plan_study,
        target_rows,
    )
    from scanner_sim.validation.studies.target_grid import StudyTarget

    target = StudyTarget.of(scenario, diameter)
    plan = plan_study(scenario, target, quick=quick)
    with claim_folder(folder, overwrite, POSE_STUDY):
        with progress_bar("targets and poses", quiet) as (advance, _), scenario_of(config):
            pools, rows = measure_study(scenario, plan, target, device=device, progress=advance)
        targets = target_rows(pools)
        rows = closed_forms(rows, plan.arrays, targets, REFERENCE)
        study = PoseStudy(
            base=BASE.name,
            base_size=BASE.size,
            targets=targets,
            rows=rows,
            exponents=exponents_of(rows, BASE.name, BASE.size, REFERENCE),
            gains=gains_of(rows, BASE.name, BASE.size),
        )
        paths = write_pose_study(study, folder, scenario_yaml=resolved_yaml(scenario), overwrite=overwrite)
    if quiet:
        return
    print_rows(exponent_rows(study), left=(0, 1))
    print_rows(gain_rows(study), left=(0, 1, 2))
    print_table({"folder": str(folder), "files": ", ".join(path.name for path in paths)})


def closed_forms(
    rows: Sequence[PoseRow], arrays: Sequence[Layout], targets: Sequence[TargetRow], reference: float
) -> tuple[PoseRow, ...]:
    """Return the rows with their closed forms: see :class:`~scanner_sim.products.pose_study.PoseRow`.

    Parameters
    ----------
    rows
        Of a study.
    arrays
        The layouts that stand in them.
    targets
        Errors of single targets, at the same ranges.
    reference
        Range whose errors the constant law takes [m]; the nearest to it that was measured.
    """
    layouts = {(item.name, item.size): item for item in arrays}
    found = {(row.range_m, row.quantity): row for row in targets}
    middle = min({row.range_m for row in targets}, key=lambda distance: abs(distance - reference))

    def errors(row: PoseRow, at: float, growth: float = 1.0, *, single: bool = False) -> float:
        """Return a closed form with the single targets' errors at a range, those of ranges times a growth."""
        # Angles alone have no ranges: any will do.
        ranging = "triangulation" if row.ranging == "none" else row.ranging
        own = [found[at, name] for name in ("theta", "phi", f"range_{ranging}")]
        common = [item.common for item in own]
        alone = [math.sqrt(max(item.scatter**2 - item.common**2, 0.0)) for item in own]
        if single:
            alone[2] = math.hypot(own[2].voxel, alone[2])
        if not alone[2] > 0.0:
            return math.nan
        alone[2], common[2] = alone[2] * growth, common[2] * growth
        every = facing_errors(
            layouts[row.array, row.size_m].points,
            row.range_m,
            row.method,
            (alone[0], alone[1], alone[2]),
            (common[0], common[1], common[2]),
        )
        return float(every[COMPONENTS.index(row.component)])

    return tuple(
        replace(
            row,
            analytic=errors(row, row.range_m),
            constant=errors(
                row, middle, (row.range_m / middle) ** 2 if row.ranging == "triangulation" else 1.0
            ),
            voxel=errors(row, row.range_m, single=True),
        )
        for row in rows
    )


def exponent_rows(study: PoseStudy) -> list[list[str]]:
    """Return the exponents of range of the base array as a table: simulated ± standard error (analytic)."""
    chosen = [
        item
        for item in study.exponents
        if item.of == "range" and item.array == study.base and item.size_m == study.base_size
    ]
    table = [["exponent of range (closed)", "ranges by", *COMPONENTS, "paper"]]
    for method, ranging in dict.fromkeys((item.method, item.ranging) for item in chosen):
        own = {item.component: item for item in chosen if (item.method, item.ranging) == (method, ranging)}
        cells = [
            f"{item.simulated:.2f} ± {item.standard_error:.2f} ({item.analytic:.2f})"
            for item in (own[name] for name in COMPONENTS if name in own)
        ]
        printed = next(iter(own.values())).printed
        table.append([method, ranging, *cells, "–" if np.isnan(printed) else f"R^{printed:g}"])
    return table


def gain_rows(study: PoseStudy) -> list[list[str]]:
    """Return the gains over points as a table: simulated (analytic; analytic with the ranges of single voxels)."""
    table = [["gain over xyz (closed; one voxel's range)", "ranges by", "range", *COMPONENTS, "paper"]]
    key: Callable[..., tuple[str, str, float]] = lambda gain: (gain.method, gain.ranging, gain.range_m)  # noqa: E731
    for method, ranging, distance in sorted(dict.fromkeys(map(key, study.gains))):
        own = {gain.component: gain for gain in study.gains if key(gain) == (method, ranging, distance)}
        gains = [own[name] for name in COMPONENTS]
        cells = [f"{gain.simulated:.2f} ({gain.analytic:.2f}; {gain.voxel:.2f})" for gain in gains]
        table.append([method, ranging, f"{distance:g} m", *cells, "10"])
    return table
