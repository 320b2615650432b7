"""The folder of a scan without rows: its table of shots, summary, points and pictures, and the reading of the table."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.csv
from numpy.typing import NDArray

from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.status import Status
from scanner_sim.products.files.contents import CALIBRATION, SHOT_TABLE, SHOTS, planned_shot_files
from scanner_sim.products.files.folder import write_folder, write_text
from scanner_sim.products.files.tables import Columns, read_about, read_result, write_parquet
from scanner_sim.products.formats.writers import format_writers
from scanner_sim.products.pictures.shots import PICTURES_OF_SHOTS, pictures_of_shots
from scanner_sim.products.pictures.style import save_grey
from scanner_sim.products.points import write_ply
from scanner_sim.products.settings import Output
from scanner_sim.products.shots import AIMED, COLUMN, ShotTable
from scanner_sim.products.summary import shots_json
from scanner_sim.products.true_poses import TruePoses


@dataclass(frozen=True)
class _AboutShots:
    """What a table of shots says of itself beside its columns."""

    seed: int
    scenario: str
    warnings: tuple[str, ...]
    objects: tuple[str, ...]
    materials: tuple[str, ...]
    versions: dict[str, str]
    poses: dict[str, Any] | None = None
    calibration: str = ""


def write_shots(
    shots: ShotTable,
    folder: str | Path,
    output: Output | None = None,
    *,
    camera: NDArray[np.uint8] | None = None,
    overwrite: bool = False,
) -> tuple[Path, ...]:
    """Write all files of a scan without rows, as :func:`~scanner_sim.products.files.folder.write_folder` does.

    Parameters
    ----------
    shots
        The result.
    folder
        Where to write; made where it is missing, with its parents.
    output
        Which files; by default all.
    camera
        Grey levels of what a video camera sees, shape (rows, columns), for ``camera.png``; None writes none.
    overwrite
        Replace an existing result.

    Returns
    -------
    tuple of Path
        The files written; of a table without some of its layers not those that need them.

    Raises
    ------
    InputError, RunError
        As there.
    """
    output = output or Output()
    writers: dict[str, Callable[[Path], None]] = {
        SHOT_TABLE: lambda path: write_parquet(path, shots.columns, about_shots(shots)),
        "shots.csv": lambda path: _write_csv(path, shots.columns),
        "scenario.yaml": lambda path: write_text(path, shots.scenario_yaml),
        "summary.json": lambda path: write_text(path, shots_json(shots)),
        CALIBRATION: lambda path: write_text(path, shots.calibration_yaml),
        **{name: partial(PICTURES_OF_SHOTS[name], shots) for name in pictures_of_shots(shots)},
        **format_writers(shots, output.formats),
    }
    if all(name in shots for name in ("P.X", "P.Y", "P.Z")):
        writers["points.ply"] = lambda path: write_ply(path, shots)
    if camera is not None:
        writers["camera.png"] = lambda path: save_grey(camera, path)
    planned = planned_shot_files(output, lit=camera is not None, calibrated=bool(shots.calibration_yaml))
    chosen = {name: writers[name] for name in planned if name in writers}
    return write_folder(folder, SHOTS, chosen, overwrite=overwrite)


def about_shots(shots: ShotTable) -> dict[str, object]:
    """Return what a table of shots cannot say by its columns, as plain data for its metadata."""
    return {
        "seed": shots.seed,
        "scenario": shots.scenario_yaml,
        "warnings": list(shots.warnings),
        "objects": list(shots.objects),
        "materials": list(shots.materials),
        "versions": dict(shots.made_by),
        **({} if shots.poses is None else {"poses": shots.poses.plain()}),
        **({"calibration": shots.calibration_yaml} if shots.calibration_yaml else {}),
        "status": {str(int(code)): f"{code.name}: {code.sentence}" for code in Status},
        "columns": {
            name: {"unit": COLUMN[name].unit, "meaning": COLUMN[name].meaning} for name in shots.columns
        },
    }


def read_shots(folder: str | Path) -> ShotTable:
    """Return the shots that a folder holds.

    Parameters
    ----------
    folder
        Where :func:`write_shots` wrote them.

    Returns
    -------
    ShotTable
        As they were written.

    Raises
    ------
    InputError
        If there is no table of shots, or it is broken.
    """
    folder = Path(folder)
    columns, said = read_result(folder, SHOT_TABLE, "a scan without rows")
    try:
        about = read_about(said, _AboutShots)
        aimed = [_column(columns, channel.name) for channel in AIMED]
        if not np.array_equal(aimed[0], np.arange(len(aimed[0]))):
            raise ValueError("shots are not numbered in order")
        return ShotTable(
            channels={name: values for name, values in columns.items() if name not in _AIMED_NAMES},
            time=aimed[1],
            theta=aimed[2],
            phi=aimed[3],
            objects=about.objects,
            materials=about.materials,
            seed=about.seed,
            scenario_yaml=about.scenario,
            warnings=about.warnings,
            made_by=about.versions,
            poses=None if about.poses is None else TruePoses.of_plain(about.poses),
            calibration_yaml=about.calibration,
        )
    except (ValueError, TypeError, LookupError, AttributeError) as error:
        raise InputError(
            f"The table in {folder} is damaged or not of this version: {error}.",
            remedy="Run its scenario.yaml again.",
        ) from None


_AIMED_NAMES = frozenset(channel.name for channel in AIMED)


def _column(columns: Columns, name: str) -> NDArray[np.float64]:
    if name not in columns:
        raise ValueError(f"the column {name} is missing")
    return columns[name]


def _write_csv(path: Path, columns: Columns) -> None:
    """Write a table with a heading; nothing for NaN."""
    table = pyarrow.table({name: pyarrow.array(values, from_pandas=True) for name, values in columns.items()})
    # Through memory: on a full disk the error is then the operating system's, with its code.
    stream = io.BytesIO()
    plain = pyarrow.csv.WriteOptions(quoting_style="none")
    pyarrow.csv.write_csv(table, stream, plain)
    path.write_bytes(stream.getvalue())
