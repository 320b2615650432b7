"""The folder of a pose study."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from scanner_sim.products.files.contents import POSE_STUDY
from scanner_sim.products.files.folder import write_folder, write_text
from scanner_sim.products.files.tables import records_csv
from scanner_sim.products.pictures.pose_study import draw_arrays, draw_figure_15
from scanner_sim.products.pose_study import PoseStudy, study_json


def write_pose_study(
    study: PoseStudy, folder: str | Path, *, scenario_yaml: str, overwrite: bool = False
) -> tuple[Path, ...]:
    """Write tables, pictures and scenario, as :func:`scanner_sim.products.files.folder.write_folder` does.

    Raises
    ------
    InputError, RunError
        As there.
    """
    writers: dict[str, Callable[[Path], None]] = {
        "pose_study.json": lambda path: write_text(path, study_json(study)),
        "pose_study.csv": lambda path: write_text(path, records_csv(study.rows)),
        "exponents.csv": lambda path: write_text(path, records_csv(study.exponents)),
        "gains.csv": lambda path: write_text(path, records_csv(study.gains)),
        "targets.csv": lambda path: write_text(path, records_csv(study.targets)),
        "figure_15.png": lambda path: draw_figure_15(study, path),
        "arrays.png": lambda path: draw_arrays(study, path),
        "scenario.yaml": lambda path: write_text(path, scenario_yaml),
    }
    return write_folder(folder, POSE_STUDY, writers, overwrite=overwrite)
