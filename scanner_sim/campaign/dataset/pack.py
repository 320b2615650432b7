"""The kept runs of a campaign as a data set: shards, their description, and a page for people."""

from __future__ import annotations

import csv
import hashlib
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from scanner_sim.campaign.dataset.croissant import croissant
from scanner_sim.campaign.dataset.licences import NOT_STATED, LicensedFile, licences_of
from scanner_sim.campaign.dataset.shards import Field, fields_of, row_bytes, shard_bytes
from scanner_sim.campaign.dataset.splits import SPLITS, Splits, split_views
from scanner_sim.campaign.dataset.views import View, views_of
from scanner_sim.campaign.store import reopened
from scanner_sim.foundation.errors import InputError
from scanner_sim.products.files.exchange import exchange, failure, held, unwritable
from scanner_sim.products.files.folder import write_text
from scanner_sim.products.json_text import json_text
from scanner_sim.products.provenance import software, versions

DESCRIPTION, INDEX, PAGE = "croissant.json", "views.csv", "README.md"
SHARD_BYTES = 256 << 20
"""Bytes of the layers of a shard before compression."""
_OURS = re.compile(rf"(?:{'|'.join(SPLITS)})-\d{{5}}-of-\d{{5}}\.parquet")
"""Names of shards."""


@dataclass(frozen=True)
class DatasetChoices:
    """What a data set is made with.

    Attributes
    ----------
    shares
        Of train, validation and test.
    apart
        What no two splits share: ``object``, ``pose`` or both.
    layers
        Layers that are kept beside status and the mask of objects; all for none.
    licence
        Of the data set: an SPDX identifier or an address.
    name
        Of the data set; that of its folder for an empty word.
    shard_bytes
        Bytes of the layers of a shard before compression.
    """

    shares: tuple[float, float, float] = (80.0, 10.0, 10.0)
    apart: tuple[str, ...] = ("object", "pose")
    layers: tuple[str, ...] = ()
    licence: str = ""
    name: str = ""
    shard_bytes: int = SHARD_BYTES


@dataclass(frozen=True)
class Dataset:
    """What was written: its files, the views of each split, and those that belong to none."""

    files: tuple[Path, ...]
    counts: dict[str, int]
    left_out: int
    failed: int
    backdrop: frozenset[str]
    licences: tuple[LicensedFile, ...]


def write_dataset(
    campaign: str | Path,
    folder: str | Path,
    choices: DatasetChoices | None = None,
    *,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Dataset:
    """Write the kept runs of a campaign as a data set, whole or not at all.

    Parameters
    ----------
    campaign
        Folder of a campaign with ``keep: {runs: all}``.
    folder
        Where to write; files of an earlier data set go, any other stays.
    choices
        Splits, layers and licence.
    overwrite
        Replace a data set that is there.
    progress
        Called with the shards done and those in all.

    Returns
    -------
    Dataset

    Raises
    ------
    InputError
        If the campaign is not done or its runs were not kept, the views cannot be divided so, or the folder is taken.
    RunError
        If the disk fails.
    """
    choices, folder = choices or DatasetChoices(), Path(folder)
    _check(choices)
    store = reopened(Path(campaign))
    views = views_of(store)
    splits = split_views(views, choices.shares, choices.apart, store.campaign.plan.seed)
    fields, files = fields_of(views, choices.layers), licences_of(views)
    shards = _shards(views, splits, max(1, choices.shard_bytes // row_bytes(fields)))
    made: dict[str, str] = {}

    def write_shard(name: str, split: str, own: Sequence[View], path: Path) -> None:
        content = shard_bytes(own, split, fields)
        made[name] = hashlib.sha256(content).hexdigest()
        path.write_bytes(content)
        if progress is not None:
            progress(len(made), len(shards))

    title = choices.name or folder.absolute().name
    failed = len(store.done) - len(views)
    page = _page(title, choices, views, splits, files, fields, failed)

    def describe(path: Path) -> None:
        about = croissant(
            title, _summary(views, splits, failed), choices.licence, software(versions()), made, fields, files
        )
        write_text(path, json_text(about))

    writers: dict[str, Callable[[Path], None]] = {
        name: partial(write_shard, name, split, own) for name, (split, own) in shards.items()
    }
    writers[INDEX] = lambda path: write_text(path, _index(views, splits))
    writers[PAGE] = lambda path: write_text(path, page)
    writers[DESCRIPTION] = describe
    _exchanged(folder, writers, overwrite)
    counts = {name: splits.count(name) for name in SPLITS}
    paths = tuple(folder / name for name in writers)
    return Dataset(paths, counts, splits.count(""), failed, splits.backdrop, files)


def _check(choices: DatasetChoices) -> None:
    if min(choices.shares) < 0.0 or not 0.0 < sum(choices.shares) < float("inf"):
        raise InputError("shares must not be negative, nor all 0.", remedy="Write for example 80 10 10.")
    unknown = [word for word in choices.apart if word not in ("object", "pose")]
    if unknown or not choices.apart:
        problem = f"'{unknown[0]}' is nothing" if unknown else "there is nothing"
        raise InputError(f"{problem} that keeps splits apart.", remedy="Write object, pose, or both.")


def _shards(views: Sequence[View], splits: Splits, most: int) -> dict[str, tuple[str, list[View]]]:
    """Return the views of each shard by its name, at most so many, in the order of their runs."""
    found = {}
    for split in SPLITS:
        own = [view for view, name in zip(views, splits.of_view, strict=True) if name == split]
        parts = [own[first : first + most] for first in range(0, len(own), most)]
        for number, part in enumerate(parts):
            found[f"{split}-{number:05d}-of-{len(parts):05d}.parquet"] = (split, part)
    return found


def _exchanged(folder: Path, writers: dict[str, Callable[[Path], None]], overwrite: bool) -> None:
    """Put the files into the folder, in the place of an earlier data set."""
    try:
        with held(folder):
            there = {path.name for path in folder.iterdir()}
            if DESCRIPTION in there and not overwrite:
                raise InputError(
                    f"{folder} already holds a data set.",
                    remedy="Choose another folder with -o, or add --overwrite.",
                )
            ours = [name for name in there if name in (DESCRIPTION, INDEX, PAGE) or _OURS.fullmatch(name)]
            if DESCRIPTION not in there and ours:
                raise InputError(
                    f"{folder} holds {', '.join(sorted(ours))} but no {DESCRIPTION}: these are not ours to replace.",
                    remedy="Choose another folder with -o.",
                )
            exchange(folder, writers, ours, mark=DESCRIPTION)
    except (NotADirectoryError, FileExistsError, PermissionError) as error:
        raise unwritable(folder, error) from None
    except OSError as error:
        raise failure(folder, error) from None


def _summary(views: Sequence[View], splits: Splits, failed: int) -> str:
    what = "range images" if views[0].scenario.scan.layout == "image" else "shots"
    counts = ", ".join(f"{splits.count(name)} {name}" for name in SPLITS)
    return (
        f"Simulated {what} of an auto-synchronised laser scanner with their standard deviations, statuses, poses "
        f"and masks of objects. Views: {counts}; left out {splits.count('')}, failed {failed}. "
        f"No two splits share {' or '.join(f'an {word}' if word[0] == 'o' else f'a {word}' for word in splits.apart)}."
    )


def _index(views: Sequence[View], splits: Splits) -> str:
    """Return a table of all views: which split each is in, and by which shapes and poses."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(("run", "split", "shapes", "poses"))
    for view, split in zip(views, splits.of_view, strict=True):
        own = [one for one in view.objects if one.name not in splits.backdrop]
        table.writerow(
            (
                view.run,
                split or "left out",
                " ".join(one.shape for one in own),
                " ".join(one.pose for one in own),
            )
        )
    return text.getvalue()


def _page(
    title: str,
    choices: DatasetChoices,
    views: Sequence[View],
    splits: Splits,
    files: Sequence[LicensedFile],
    fields: Sequence[Field],
    failed: int,
) -> str:
    backdrop = ", ".join(sorted(splits.backdrop)) or "none"
    sources = [f"| {file.name} | {file.licence} | {file.holder or '–'} | `{file.sha256}` |" for file in files]
    columns = [f"| `{one.name}` | {one.unit if one.unit != '1' else ''} | {one.meaning} |" for one in fields]
    lines = [
        f"# {title}",
        "",
        _summary(views, splits, failed),
        "",
        f"Objects that stand in every view alike, and are in all splits: {backdrop}.",
        f"Licence of the data set: {choices.licence or NOT_STATED}.",
        "",
        "## What the shapes came from",
        "",
        "| file | licence | copyright | SHA-256 |",
        "|---|---|---|---|",
        *(sources or ["| none: the scenario describes every shape | | | |"]),
        "",
        "## Columns",
        "",
        "Arrays are lists, row by row. NaN where nothing was measured: `status` says why.",
        "",
        "| column | unit | meaning |",
        "|---|---|---|",
        *columns,
        "",
    ]
    return "\n".join(lines)
