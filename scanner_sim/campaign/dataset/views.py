"""What a campaign's kept runs show: each a view of some objects, which poses they have, and what they are made of."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scanner_sim.campaign.inputs import with_its_own
from scanner_sim.campaign.store import KEPT, Store
from scanner_sim.config.scenario import Scenario
from scanner_sim.foundation.errors import InputError
from scanner_sim.foundation.named_files import LARGEST_MESH, digest_of, read_ordinary
from scanner_sim.products.files.contents import RUN, SHOTS

RESULTS = {"image": RUN, "shots": SHOTS}
"""Folders of results that a data set is made of, by the layout of their scans."""
_PLACED = {"name", "parent", "position", "rotation", "motion", "label_parts"}
"""Keys of an object that say where it is, and what it and its parts are called."""
_PAINTED = {"material", "materials", "disc"}
"""Keys of what it is made of: the same shape in another paint is the same object."""
_PAINTS = {".mtl", ".png", ".jpg", ".jpeg"}
"""Endings of the files that a mesh names for its colours."""
_DECIMALS = 9
"""Of metres and of the entries of a matrix: poses that agree in these are the same."""


@dataclass(frozen=True)
class ViewedObject:
    """An object of a view.

    Attributes
    ----------
    name
        In the scenario.
    shape
        What tells its shape from others, whatever it is called or made of: digits of a SHA-256.
    file
        The file that holds it; None of shapes that the scenario describes.
    poses
        ``scanner_from_object`` when the scan begins and when it ends, shape (2, 4, 4).
    in_parts
        Whether its parts have numbers of their own in ``truth.object``, and names that begin with its own.
    """

    name: str
    shape: str
    file: Path | None
    poses: NDArray[np.float64]
    in_parts: bool = False

    @property
    def pose(self) -> str:
        """What tells its poses from others."""
        rounded = np.round(self.poses, _DECIMALS) + 0.0  # no negative zero
        return hashlib.sha256(rounded.tobytes()).hexdigest()[:16]


@dataclass(frozen=True)
class View:
    """A kept run: its number, its folder, its scenario, and the objects before the scanner."""

    run: int
    folder: Path
    scenario: Scenario
    objects: tuple[ViewedObject, ...]


def views_of(store: Store) -> tuple[View, ...]:
    """Return the views of a campaign in the order of their runs; runs that failed are left out.

    Raises
    ------
    InputError
        If runs are not done or not kept, none has a result, or they are those of a tracker.
    """
    undone = int((~store.done).sum())
    if undone:
        raise InputError(
            f"{undone} of {len(store.done)} runs in {store.folder} are not done.",
            remedy="Give the command of the campaign again: it goes on.",
        )
    failed = {
        int(run)
        for table in store.rows()
        for run in table["run"][np.asarray(table["fault"] != "", dtype=np.bool_)]
    }
    runs = [run for run in range(len(store.done)) if run not in failed]
    if not runs:
        raise InputError(f"every run in {store.folder} has failed.", remedy="campaign status says why.")
    shapes = _Shapes()
    return tuple(_view(store, run, shapes) for run in runs)


def backdrop_of(views: Sequence[View]) -> frozenset[str]:
    """Return the names of objects that stand in every view, of the same shape and at the same pose."""
    kept: set[tuple[str, str, str]] = {(one.name, one.shape, one.pose) for one in views[0].objects}
    for view in views[1:]:
        kept &= {(one.name, one.shape, one.pose) for one in view.objects}
    return frozenset(name for name, _, _ in kept) if len(views) > 1 else frozenset()


def files_of_shape(path: Path) -> tuple[Path, ...]:
    """Return a file and those that it names for its shapes: included scenes, meshes, buffers; by where they lie.

    Raises
    ------
    InputError
        If a scene cannot be read.
    """
    others = {file.resolve() for file in with_its_own(path)} - {path.resolve()}
    return path, *sorted(file for file in others if file.suffix.lower() not in _PAINTS)


def _view(store: Store, run: int, shapes: _Shapes) -> View:
    folder = store.folder / KEPT / f"{run:06d}"
    scenario = store.campaign.scenario(run)
    if scenario.scan.layout not in RESULTS:
        raise InputError(
            f"run {run} in {store.folder} is neither a range image nor shots.",
            remedy="Take a plan, and a base, that give no run a tracker's scan.",
        )
    result = folder / RESULTS[scenario.scan.layout].result
    if not result.is_file():
        raise InputError(
            f"run {run} was not kept: there is no {result}.",
            remedy="Write 'keep: {runs: all}' into the plan, and run it into a new folder.",
        )
    ends = np.array((0.0, scenario.open_scan.scan_time(scenario.scan_setup)))
    found = [
        ViewedObject(
            item.name,
            *shapes.of(item),
            np.asarray(item.pose_at(ends)),
            bool(getattr(item, "label_parts", False)),
        )
        for item in scenario.scene.objects
    ]
    if scenario.scene.file is not None:
        still = np.tile(np.eye(4), (2, 1, 1))
        found.insert(
            0,
            ViewedObject(
                scenario.scene.file.stem, shapes.of_file(scenario.scene.file), scenario.scene.file, still
            ),
        )
    return View(run, folder, scenario, tuple(found))


class _Shapes:
    """What tells shapes apart; each file is read once."""

    def __init__(self) -> None:
        self._digests: dict[Path, str] = {}

    def of(self, item: Any) -> tuple[str, Path | None]:
        """Return what tells the shape of an object of a scenario, and its file."""
        plain = item.model_dump(mode="json", by_alias=True, exclude=_PLACED | _PAINTED)
        file: Path | None = getattr(item, "mesh", None) or getattr(item, "file", None)
        if file is not None:
            plain |= {key: self.of_file(file) for key in ("mesh", "file") if key in plain}
        text = json.dumps(plain, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16], file

    def of_file(self, path: Path) -> str:
        """Return what tells the content of a file, with those that it names for its shapes."""
        if path not in self._digests:
            content = [digest_of(read_ordinary(file, LARGEST_MESH)) for file in files_of_shape(path)]
            whole = content[0] if len(content) == 1 else digest_of(b"".join(content))
            self._digests[path] = whole.hex()[:16]
        return self._digests[path]
