"""The verb ``campaign dataset``."""

from __future__ import annotations

from pathlib import Path

from scanner_sim.campaign.dataset.licences import NOT_STATED
from scanner_sim.campaign.dataset.pack import Dataset, DatasetChoices, write_dataset
from scanner_sim.cli.call import files_of
from scanner_sim.cli.progress import progress_bar
from scanner_sim.cli.report import warn
from scanner_sim.cli.tables import print_table


def make_dataset(
    folder: Path,
    output: Path,
    *,
    shares: tuple[float, float, float],
    apart: tuple[str, ...],
    layers: tuple[str, ...],
    licence: str,
    name: str,
    shard_bytes: int,
    overwrite: bool,
    quiet: bool,
) -> None:
    """Write a data set and say what is in it; faults as of :func:`write_dataset`."""
    choices = DatasetChoices(shares, apart, layers, licence, name, shard_bytes)
    with progress_bar("writing", quiet, "shards") as (advance, _):
        made = write_dataset(folder, output, choices, overwrite=overwrite, progress=advance)
    if quiet:
        return
    unknown = [file.name for file in made.licences if file.licence == NOT_STATED]
    if unknown:
        warn(
            f"nothing says under which licence {', '.join(unknown)} may be passed on; write it into FILE.license "
            "beside each, as a line SPDX-License-Identifier: CC-BY-4.0"
        )
    if not licence:
        warn("the data set has no licence: name one with --licence")
    print_table(_closing(made))


def _closing(made: Dataset) -> dict[str, str]:
    rows = {name: f"{count:,} views" for name, count in made.counts.items()}
    if made.left_out:
        rows["left out"] = f"{made.left_out:,} views that would share an object or a pose with another split"
    if made.failed:
        rows["failed"] = f"{made.failed:,} runs"
    if made.backdrop:
        rows["in all splits"] = f"{', '.join(sorted(made.backdrop))}: alike in every view"
    shards = [path for path in made.files if path.suffix == ".parquet"]
    others = [path for path in made.files if path.suffix != ".parquet"]
    return rows | {"shards": str(len(shards))} | files_of(others)
