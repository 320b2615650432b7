"""The verb ``pose-study``."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from scanner_sim.cli.call import Call, files_of
from scanner_sim.cli.tables import print_rows, print_table
from scanner_sim.config import resolved_yaml
from scanner_sim.products.files.contents import POSE_STUDY
from scanner_sim.products.pose_study import COMPONENTS, PoseStudy, study_json


def study_scenario(call: Call, *, diameter: float | None, quick: bool) -> None:
    """Study the poses of arrays as a scenario's instrument measures them, into a folder.

    Raises
    ------
    ScannerSimError
        If the scenario, the folder or the device cannot be used, or the disk fails.
    """
    from scanner_sim.products.files.tables import records_csv
    from scanner_sim.products.pictures.pose_study import draw_arrays, draw_figure_15

    scenario = call.scenario()
    from scanner_sim.validation.compare.pose_forms import with_closed_forms
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
    with call.claimed(POSE_STUDY):
        with call.work("targets and poses") as (advance, _):
            pools, rows = measure_study(scenario, plan, target, device=call.device, progress=advance)
        targets = target_rows(pools)
        rows = with_closed_forms(rows, plan.arrays, targets, REFERENCE)
        study = PoseStudy(
            base=BASE.name,
            base_size=BASE.size,
            targets=targets,
            rows=rows,
            exponents=exponents_of(rows, BASE.name, BASE.size, REFERENCE),
            gains=gains_of(rows, BASE.name, BASE.size),
        )
        paths = call.write(
            POSE_STUDY,
            {
                "pose_study.json": study_json(study),
                "pose_study.csv": records_csv(study.rows),
                "exponents.csv": records_csv(study.exponents),
                "gains.csv": records_csv(study.gains),
                "targets.csv": records_csv(study.targets),
                "figure_15.png": partial(draw_figure_15, study),
                "arrays.png": partial(draw_arrays, study),
                "scenario.yaml": resolved_yaml(scenario),
            },
        )
    if call.quiet:
        return
    print_rows(exponent_rows(study), left=(0, 1))
    print_rows(gain_rows(study), left=(0, 1, 2))
    print_table(files_of(paths))


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
