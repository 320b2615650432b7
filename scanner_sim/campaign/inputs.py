"""The files that a campaign is made of: digests of their content, and the commits of the checkouts that hold them."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from pathlib import Path

from scanner_sim.campaign.runs import Campaign, changed, dimension_of
from scanner_sim.config.document import Value
from scanner_sim.foundation.errors import ScenarioError
from scanner_sim.foundation.named_files import LARGEST_MESH, digest_of, read_ordinary
from scanner_sim.foundation.parts import Part
from scanner_sim.scene.files.mesh_files import files_of_mesh
from scanner_sim.scene.files.scene_rules import files_of_scene

_OF_ONE_CHECKOUT = ("GIT_DIR", "GIT_WORK_TREE", "GIT_COMMON_DIR")
"""Variables by which git, in its hooks, names its own checkout in the place of that about a folder."""
_GIT_SECONDS = 10.0
"""Time after which a commit is not waited for: a file system of a network may hang."""


def digests_of(campaign: Campaign) -> dict[str, str]:
    """Return the SHA-256 of each file that scenarios of a campaign name, and of those that XML scenes name.

    Raises
    ------
    InputError
        If one of them cannot be read.
    """
    files = {path for named in _named(campaign) for path in with_its_own(named)}
    return {str(path): digest_of(read_ordinary(path, LARGEST_MESH)).hex() for path in sorted(files)}


def commits_of(campaign: Campaign, files: Iterable[str]) -> dict[str, str]:
    """Return the commit of each git checkout in which the plan, its scenario or files stand, by the checkout's folder.

    It says where to look for them, and not that they are unchanged. Without git there are none.
    """
    folders = {campaign.folder, campaign.plan.base.parent, *(Path(file).parent for file in files)}
    return dict(sorted(found for folder in folders if (found := _commit(folder)) is not None))


def _named(campaign: Campaign) -> Iterator[Path]:
    """Yield the files that the base names, and those that take their place in some of the runs."""
    yield from _files(campaign.base)
    for group in campaign.plan.vary:
        for key, values in group.keys.items():
            words = [one for one in values.list or () if isinstance(one, str | dict) or _has_blocks(one)]
            for value in words if words and dimension_of(campaign.base, key) is None else ():
                try:
                    yield from _files(changed(campaign.base, {key: value}, campaign.folder, key))
                except ScenarioError:
                    # It fits other values than the base's, or its runs are rows with this fault.
                    continue


def _has_blocks(value: Value) -> bool:
    """Tell whether a value is a list of blocks, as ``scene.objects`` is."""
    return isinstance(value, list) and any(isinstance(one, dict) for one in value)


def _files(part: Part) -> Iterator[Path]:
    """Yield the files that a scenario names."""
    for name in type(part).model_fields:
        value = getattr(part, name)
        for one in value if isinstance(value, tuple) else (value,):
            if isinstance(one, Part):
                yield from _files(one)
            elif isinstance(one, Path):
                yield one


def with_its_own(path: Path) -> Iterator[Path]:
    """Yield a file of a scene or a mesh, and those that it names."""
    yield path
    if path.suffix.lower() == ".xml":
        yield from files_of_scene(path)
    else:
        yield from files_of_mesh(path)


def _commit(folder: Path) -> tuple[str, str] | None:
    """Return folder and commit of the checkout about a folder; None where there is none, or git does not trust it."""
    git = shutil.which("git")
    if git is None:
        return None
    environment = {name: value for name, value in os.environ.items() if name not in _OF_ONE_CHECKOUT}
    try:
        # This reads references only: no hook, filter or monitor that a checkout names is started.
        said = subprocess.run(
            [git, "-C", str(folder), "rev-parse", "--show-toplevel", "--verify", "HEAD"],
            capture_output=True,
            stdin=subprocess.DEVNULL,
            env=environment,
            text=True,
            timeout=_GIT_SECONDS,
            check=False,
        )
    except (OSError, subprocess.SubprocessError, UnicodeDecodeError):
        return None
    lines = said.stdout.splitlines()
    return (lines[0], lines[1]) if said.returncode == 0 and len(lines) == 2 else None
